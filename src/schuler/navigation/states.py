"""Error budget and filter states of a configuration: the IMU's, and those that the configured aids need."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError
from schuler.filtering.limits import MAX_STATES, MOST_CHANNELS
from schuler.filtering.states import (
    AMBIGUITIES,
    BLOCKS,
    CHANNELS,
    NAVIGATION,
    StateLayout,
    StateModel,
    block_names,
    layout_for,
)
from schuler.gnss.carrier import carrier_phases
from schuler.gnss.ranges import Ranges
from schuler.gnss.slow_errors import slow_channels
from schuler.navigation.config import NavigationConfig
from schuler.sensors import catalogue
from schuler.sensors.sheets import AccelerometerSheet, GyroSheet, sheet_keys
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.sensors.spec_file import configured_spec
from schuler.sensors.typical import with_typical_biases, with_typical_scales


def imu_spec(config: NavigationConfig, notes: list[str] | None = None) -> ImuSpec:
    """Error budget of the IMU a configuration names or describes; ``notes`` gets what was taken for unstated values.

    A turn-on bias that a data sheet leaves out, here or in the catalogue, is not zero: what is typical of the class is
    taken, also of a grade ("consumer"), which says that the part is not known. One that is stated stays, zero too, and
    so do the budget of a file and the set of a simulation by its own name ("flenniken-consumer"). So it is with scale
    factors and misalignments where the configured states estimate them.
    """
    section = config.imu
    if section.spec is not None:
        return _complete(configured_spec(section.spec))
    if section.catalogue is not None:
        spec, entry = catalogue.spec(section.catalogue), catalogue.entry(section.catalogue)
        unstated = entry.unstated
        by_grade = entry.kind == "grade" and catalogue.plain(section.catalogue) != catalogue.plain(entry.name)
        if by_grade:
            unstated = tuple(f"{which}.turn_on_bias" for which in ("gyro", "accel"))
        scales = [field for field in _estimated(config) if _is_zero(spec, field) and (by_grade or entry.is_device)]
    else:
        try:
            gyro, accel = TriadSpec.gyro(**section.gyro), TriadSpec.accelerometer(**section.accel)  # type: ignore[arg-type]
        except TypeError as error:
            raise ConfigError(
                f"imu: {error}; see docs/sensors.md for the data-sheet values that can be given"
            ) from None
        spec = ImuSpec(name="as configured", gyro=gyro, accel=accel)
        sheets = (("gyro", section.gyro, GyroSheet), ("accel", section.accel, AccelerometerSheet))
        unstated = tuple(
            f"{which}.turn_on_bias"
            for which, given, sheet in sheets
            if not any(sheet_keys(sheet)[key][0] == "turn_on_bias" for key in given if key != "density")
        )
        stated = {f"{w}.{sheet_keys(sheet)[k][0]}" for w, given, sheet in sheets for k in given if k != "density"}
        scales = [field for field in _estimated(config) if field not in stated]
    spec, sentences = with_typical_biases(spec, unstated)
    spec, more = with_typical_scales(spec, scales)
    if notes is not None:
        notes += [*sentences, *more]
    return spec


_SCALES = {
    "S_a": "accel.scale_factor",
    "S_g": "gyro.scale_factor",
    "M_a": "accel.misalignment",
    "M_a6": "accel.misalignment",
    "M_g": "gyro.misalignment",
}


def _estimated(config: NavigationConfig) -> list[str]:
    """Scale factors and misalignments of the budget that the states estimate without a model of their own."""
    blocks = [name for name in block_names(config.filter.states) if name not in config.filter.models]
    return [_SCALES[name] for name in blocks if name in _SCALES]


def _is_zero(spec: ImuSpec, field: str) -> bool:
    which, _, name = field.partition(".")
    return bool(getattr(getattr(spec, which), name) == 0.0)


def white_noise_psd(config: NavigationConfig, spec: ImuSpec) -> tuple[FloatArray, FloatArray]:
    """Power spectral densities of the white noise in the filter: the budget's, times the configured factors squared.

    Returns
    -------
    ndarray, ndarray, shapes (3,)
        Of the gyroscopes [(rad/s)^2/Hz] and the accelerometers [(m/s^2)^2/Hz].
    """
    noise = config.filter.noise
    return (
        np.full(3, (spec.gyro.random_walk * noise.gyro) ** 2),
        (spec.accel.random_walk * np.array(noise.accel_axes)) ** 2,
    )


def _complete(spec: ImuSpec) -> ImuSpec:
    """The budget of a file, unless one triad has no entry at all: it was identified from a log without that triad."""
    for which, sensors in (("gyro", "gyroscopes"), ("accel", "accelerometers")):
        if not any(getattr(spec, which).to_dict().values()):
            raise ConfigError(
                f"imu.spec: expected the noise of gyroscopes and accelerometers, got nothing of the {sensors} of "
                f"{spec.name}: put random_walk into its section [{which}], or name the IMU by imu.catalogue"
            )
    return spec


def state_layout(config: NavigationConfig, spec: ImuSpec, ranges: Ranges | None = None) -> StateLayout:
    """State layout of a configuration: from the IMU's budget, what the aids need, and the models given instead."""
    return StateLayout(_block_models(config, spec, ranges))


def sensor_layout(config: NavigationConfig, spec: ImuSpec) -> StateLayout:
    """The sensor blocks of a configuration's layout, which come first among its parameters."""
    return StateLayout({name: m for name, m in _block_models(config, spec, None).items() if BLOCKS[name][0][0] >= 0})


def _block_models(config: NavigationConfig, spec: ImuSpec, ranges: Ranges | None) -> dict[str, StateModel]:
    given = {name: StateModel(model.sigma, model.noise, model.tau_s) for name, model in config.filter.models.items()}
    states = config.filter.states
    required = aiding_models(config, ranges)
    if isinstance(states, tuple):
        unmodelled = tuple(name for name in states if name not in given and name not in required)
        budgeted = layout_for(spec, unmodelled).models
        models = {name: budgeted.get(name) or required.get(name) or given[name] for name in states}
    else:
        models = layout_for(spec, states).models
    models = {**models, **required, **given}
    for numbered in (CHANNELS, AMBIGUITIES):  # where room is short, slow errors without a state count as white noise
        room = MAX_STATES - len(NAVIGATION) * 3 - sum(len(BLOCKS[name]) for name in models if name not in numbered)
        models = {name: model for name, model in models.items() if name not in numbered[max(room, 0) :]}
    return models


def aiding_models(config: NavigationConfig, ranges: Ranges | None) -> dict[str, StateModel]:
    """State blocks that the configured aids need, by name.

    Parameters
    ----------
    config : NavigationConfig
    ranges : Ranges, optional
        Ranges of a tightly coupled run: its receiver clocks become states. Noise that is left to the log the
        configuration has as numbers (:meth:`schuler.navigation.inputs.satellites.Points.put_into`).
    """
    aiding, gnss = config.aiding, config.gnss
    models: dict[str, StateModel] = {}

    def constant(name: str, sigma: float) -> None:
        if sigma > 0.0:
            models[name] = StateModel.constant(max(sigma, models[name].sigma if name in models else 0.0))

    constant("lever", gnss.lever_sigma_m)
    constant("delay", gnss.delay_sigma_s)
    slow = gnss.correlated
    if gnss.coupling == "loose" and slow.position_sigma_m > 0.0:
        models["b_r"] = StateModel.gauss_markov(slow.position_sigma_m, slow.position_tau_s)
    if gnss.coupling == "loose" and slow.velocity_sigma_m_s > 0.0:
        models["b_v"] = StateModel.gauss_markov(slow.velocity_sigma_m_s, slow.velocity_tau_s)
    if aiding.non_holonomic is not None:
        constant("mount", aiding.non_holonomic.mount_sigma_deg * units.DEG)
        constant("lever_v", aiding.non_holonomic.lever_sigma_m)
    if aiding.odometer is not None:
        constant("odometer", aiding.odometer.scale_sigma)
        constant("mount", aiding.odometer.mount_sigma_deg * units.DEG)
    if aiding.heading is not None:
        constant("b_heading", aiding.heading.bias_sigma_deg * units.DEG)
    if aiding.barometer is not None and aiding.barometer.bias_sigma_m > 0.0:
        models["baro"] = StateModel.random_walk(aiding.barometer.bias_sigma_m, aiding.barometer.bias_noise_m)
    if ranges is not None:
        tight = gnss.tight
        models |= clock_models(
            ranges,
            offset_sigma=tight.clock_sigma_m,
            drift_sigma=tight.clock_drift_sigma_m_s,
            offset_noise=float(tight.clock_noise_m),
            drift_noise=tight.clock_drift_noise_m_s,
            between_sigma=tight.clock_sigma_m,
            between_noise=tight.system_noise_m,
        )
        if slow.position_sigma_m > 0.0:
            channels = slow_channels(ranges, slow.position_tau_s, MOST_CHANNELS).max(initial=0)
            model = StateModel.gauss_markov(slow.position_sigma_m, slow.position_tau_s)
            models |= dict.fromkeys(CHANNELS[:channels], model)
        if tight.carrier != "off":
            channels = carrier_phases(ranges, float(tight.carrier_sigma_m), MOST_CHANNELS).channel.max(initial=0)
            models |= dict.fromkeys(AMBIGUITIES[:channels], StateModel.random_walk(0.0, tight.carrier_walk_m))
    return models


def clock_models(
    ranges: Ranges,
    *,
    offset_sigma: float,
    drift_sigma: float,
    offset_noise: float,
    drift_noise: float,
    between_sigma: float,
    between_noise: float = 0.0,
) -> dict[str, StateModel]:
    """State blocks of the receiver clock, and of the other systems' clocks against the first one's.

    Parameters
    ----------
    ranges : Ranges
    offset_sigma, drift_sigma : float
        Initial 1-sigma of the first clock. [m], [m/s]
    offset_noise, drift_noise : float
        Root densities of white frequency noise and of the random walk of frequency. [m/sqrt(s)], [m/s/sqrt(s)]
    between_sigma, between_noise : float
        Initial 1-sigma of the other clocks against it [m], and their wander [m/sqrt(s)].
    """
    models = {
        "clock": StateModel.random_walk(offset_sigma, offset_noise),
        "clock_drift": StateModel.random_walk(drift_sigma, drift_noise),
    }
    for i in range(1, len(ranges.groups)):
        models[f"clock_{i + 1}"] = StateModel.random_walk(between_sigma, between_noise)
    return models
