"""What a configuration says of the IMU: its error budget, and the states a filter has for it."""

from __future__ import annotations

from schuler.exceptions import ConfigError
from schuler.filtering.states import BLOCKS, StateLayout, StateModel, layout_for
from schuler.gnss.ranges import Ranges
from schuler.navigation.aids.aiding import aiding_models
from schuler.navigation.config import NavigationConfig
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.sensors.spec_file import configured_spec


def imu_spec(config: NavigationConfig) -> ImuSpec:
    """Error budget of the IMU a configuration names or describes."""
    section = config.imu
    if section.catalogue is not None:
        return catalogue.spec(section.catalogue)
    if section.spec is not None:
        return configured_spec(section.spec)
    try:
        gyro, accel = TriadSpec.gyro(**section.gyro), TriadSpec.accelerometer(**section.accel)  # type: ignore[arg-type]
    except TypeError as error:
        raise ConfigError(f"imu: {error}; see docs/sensors.md for the data-sheet values that can be given") from None
    return ImuSpec(name="as configured", gyro=gyro, accel=accel)


def state_layout(config: NavigationConfig, spec: ImuSpec, ranges: Ranges | None = None) -> StateLayout:
    """State layout of a configuration: from the IMU's budget, what the aids need, and the models given instead."""
    return StateLayout(_models(config, spec, ranges))


def sensor_layout(config: NavigationConfig, spec: ImuSpec) -> StateLayout:
    """The sensor blocks of a configuration's layout, which are the first parameters of the whole one."""
    return StateLayout({name: m for name, m in _models(config, spec, None).items() if BLOCKS[name][0][0] >= 0})


def _models(config: NavigationConfig, spec: ImuSpec, ranges: Ranges | None) -> dict[str, StateModel]:
    given = {name: StateModel(model.sigma, model.noise, model.tau_s) for name, model in config.filter.models.items()}
    states = config.filter.states
    needed = aiding_models(config, ranges)
    if isinstance(states, tuple):
        named = tuple(name for name in states if name not in given and name not in needed)
        fitted = layout_for(spec, named).models
        models = {name: fitted.get(name) or needed.get(name) or given[name] for name in states}
    else:
        models = layout_for(spec, states).models
    return {**models, **needed, **given}
