"""Noise terms that a recording can tune, and a prepared run with other values of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.measurements import LATERAL, POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY, VERTICAL
from schuler.filtering.states import StateLayout
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.slow import scaled_start
from schuler.recording.series import ImuSeries

#: Kinds of measurements whose innovations tune: what receivers give, weighed by the filter.
TUNING_KINDS = (POSITION, VELOCITY, PSEUDORANGE, RANGE_RATE)

_ACROSS, _DOWN, _ALL = (1.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
#: Terms that scale the covariance of measurements: kind, and the components they act on.
MEASURED = {
    "position": (POSITION, _ACROSS),
    "height": (POSITION, _DOWN),
    "velocity": (VELOCITY, _ACROSS),
    "climb": (VELOCITY, _DOWN),
    "pseudorange": (PSEUDORANGE, _ALL),
    "range_rate": (RANGE_RATE, _ALL),
    "lateral": (LATERAL, _ALL),
    "vertical": (VERTICAL, _ALL),
}
#: Terms of the IMU: white noise by triad, and the wander of its biases by state block. The accelerometer nearest to the
#: vertical has the gravity, and most of what shakes; the other two are tuned together.
WHITE = {"gyro": 0, "accel": 1, "accel_down": 1}
_WANDER = {"gyro_bias": ("b_g_run", "b_g"), "accel_bias": ("b_a_run", "b_a")}
#: The latter.
WANDERS = tuple(_WANDER)
#: Factor on the sigma of a slow error of positions, which a run has only where it is recognised.
SLOW = "slow"
#: All terms, in the order of tables.
TERMS = (*WHITE, *_WANDER, *MEASURED)

_UNSTATED = 1e5  # a larger sigma says that a component was not measured [m, m/s]
_TYPICAL = 0.03 / np.sqrt(300.0)  # wander of a bias whose budget states none, per turn-on sigma [1/sqrt(s)]


def terms_of(prepared: PreparedRun) -> tuple[str, ...]:
    """Terms that act in a run: those of its states and of the measurements it has."""
    schedule = prepared.schedule
    sigma = np.sqrt(np.einsum("nii->ni", schedule.R))
    present = [name for name, triad in WHITE.items() if prepared.psd[triad].max() > 0.0]
    present += [name for name in _WANDER if wandering(prepared.layout, name) is not None]
    for name, (kind, components) in MEASURED.items():
        if kind == POSITION and prepared.ranges is not None:
            continue  # by carriers with held integers: a factor by component would turn the directions they measure
        column = int(np.argmax(components))
        if np.any((schedule.kind == kind) & (sigma[:, column] < _UNSTATED)):
            present.append(name)
    return tuple(name for name in TERMS if name in present)


def vertical_axis(imu: ImuSeries) -> int:
    """Axis of the accelerometers that is nearest to the vertical in the mean over a log, however the IMU is mounted."""
    return int(np.argmax(np.abs(imu.accel.mean(axis=0))))


def by_axis(factors: Mapping[str, float], vertical: int) -> tuple[float, float, float]:
    """Factors on the noise of the accelerometers x, y, z."""
    level, down = factors.get("accel", 1.0), factors.get("accel_down", 1.0)
    x, y, z = (down if k == vertical else level for k in range(3))
    return x, y, z


def wandering(layout: StateLayout, term: str) -> str | None:
    """State block whose driving noise a term scales; None if the run does not estimate it."""
    return next((name for name in _WANDER[term] if name in layout.models), None)


def with_wander(prepared: PreparedRun) -> PreparedRun:
    """The run with biases that wander a little where its budget states none, so that a factor can act."""
    models = dict(prepared.layout.models)
    for term in _WANDER:
        name = wandering(prepared.layout, term)
        if name is not None and models[name].noise == 0.0:
            models[name] = replace(models[name], noise=models[name].sigma * _TYPICAL)
    return replace(prepared, layout=StateLayout(models))


def with_factors(prepared: PreparedRun, factors: Mapping[str, float]) -> PreparedRun:
    """The run with noise multiplied by factors on 1-sigma values.

    Parameters
    ----------
    prepared : PreparedRun
    factors : mapping of str to float
        By the names of :data:`TERMS` and :data:`SLOW`; 1 where left out.
    """
    models, initial = dict(prepared.layout.models), prepared.initial
    if SLOW in factors:
        model, factor = models["b_r"], factors[SLOW]
        models["b_r"] = replace(model, sigma=model.sigma * factor, noise=model.noise * factor)
        initial = scaled_start(initial, prepared.layout, factor)
    for term in _WANDER:
        name = wandering(prepared.layout, term)
        if name is not None and term in factors:
            models[name] = replace(models[name], noise=models[name].noise * factors[term])
    gyro, accel = prepared.psd
    if "gyro" in factors:
        gyro = gyro * factors["gyro"] ** 2
    if "accel" in factors or "accel_down" in factors:
        accel = accel * np.square(by_axis(factors, vertical_axis(prepared.imu)))
    schedule = prepared.schedule
    D = component_factors(schedule.kind, factors)
    return replace(
        prepared,
        layout=StateLayout(models),
        initial=initial,
        psd=(gyro, accel),
        schedule=replace(schedule, R=schedule.R * D[:, :, None] * D[:, None, :]),
    )


def component_factors(kind: IntArray, factors: Mapping[str, float]) -> FloatArray:
    """Factors on the 1-sigma values of each component of measurements. Shape (m, 3)."""
    D = np.ones((len(kind), 3))
    for name, (code, components) in MEASURED.items():
        if name in factors:
            D[kind == code] *= np.where(np.array(components) > 0.0, factors[name], 1.0)
    return D
