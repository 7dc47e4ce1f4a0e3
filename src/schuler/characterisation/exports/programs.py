"""Programs that an identified noise model can be written for, and the writing of their configurations."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler.characterisation.exports import autopilots, numbers, visual_inertial
from schuler.characterisation.result import AxisNoise, NoiseIdentification
from schuler.exceptions import InputError
from schuler.files import write_text
from schuler.sensors.spec import ImuSpec
from schuler.sensors.spec_file import spec_text
from schuler.units import DEG_PER_HR

_COMMON = ("axes", "inflation", "horizon_s", "rate_hz")
_FIELDS = {"Q": "quantisation", "N": "random_walk", "B": "bias_instability", "K": "rate_random_walk", "R": "rate_ramp"}


class Export(NamedTuple):
    """A program that can be written for.

    Attributes
    ----------
    function : callable
        From :class:`~schuler.characterisation.exports.numbers.Numbers` and its own keywords to text; for ``schuler``
        from the result itself.
    suffix : str
        Customary ending of the file's name.
    description : str
        One line.
    """

    function: Callable[..., str]
    suffix: str
    description: str


def schuler(result: NoiseIdentification | ImuSpec) -> str:
    """Our own specification file, for ``imu.spec`` of scenarios and navigation; nothing is converted or inflated.

    Parameters
    ----------
    result : NoiseIdentification or ImuSpec

    Raises
    ------
    InputError
        If a triad of an identification has no axis left.
    """
    if isinstance(result, ImuSpec):
        return spec_text(result)
    if result.spec is None:
        raise InputError(f"{result.name}: a triad has no axis left, so there is no budget; see the refused axes")
    axes = {name: _axis_table(axis) for name, axis in result.axes.items()}
    return _of_spread(result) + spec_text(result.spec, result.spec_sigma, axes, result.provenance)


def _of_spread(result: NoiseIdentification) -> str:
    """Comment on a turn-on bias that is the spread of several switch-ons, whose mean another file has."""
    means = [float(np.abs(t.mean).max()) for axis, t in result.turn_on.items() if axis.startswith("gyro")]
    if not means:
        return ""
    return (
        "# turn_on_bias of the gyroscopes is their spread from one switch-on to the next, with the mean taken off.\n"
        f"# The mean, up to {max(means) / DEG_PER_HR:.3g} deg/h, is b_g of calibration.yaml beside this file:\n"
        "# give both to schuler navigate, or make turn_on_bias larger by that much.\n"
    )


EXPORTS: dict[str, Export] = {
    "ardupilot": Export(autopilots.ardupilot, ".param", "ArduPilot EKF3 parameters (EK3_GYRO_P_NSE, ...)"),
    "gtsam": Export(visual_inertial.gtsam, ".py", "GTSAM preintegration parameters as a Python function"),
    "kalibr": Export(visual_inertial.kalibr, ".yaml", "Kalibr imu.yaml"),
    "kf-gins": Export(autopilots.kf_gins, ".yaml", "KF-GINS imunoise block"),
    "openvins": Export(visual_inertial.openvins, ".yaml", "OpenVINS kalibr_imu_chain.yaml"),
    "px4": Export(autopilots.px4, ".params", "PX4 EKF2 parameters (EKF2_GYR_NOISE, ...) for QGroundControl"),
    "schuler": Export(schuler, ".toml", "our own specification file, for the imu.spec entry"),
    "vins": Export(visual_inertial.vins, ".yaml", "VINS-Mono and VINS-Fusion noise block (acc_n, gyr_n, ...)"),
}


def export_text(result: NoiseIdentification | ImuSpec, name: str, **options: Any) -> str:
    """Configuration of another program as text.

    Parameters
    ----------
    result : NoiseIdentification or ImuSpec
    name : str
        A key of :data:`EXPORTS`.
    axes : {"worst", "rms"}
        How the three axes of an identification become one number.
    inflation : float or (float, float)
        Factor on all root densities and standard deviations, or one on white noise and one on bias random walks.
    horizon_s : float, optional
        Averaging time at which the bias random walk is matched to all wandering terms. Left out: K where it was
        identified, else matched at 100 s. [s]
    rate_hz : float, optional
        Sampling rate, if not that of the log. [Hz]
    **options
        The program's own, see its function.

    Returns
    -------
    str
        The same for the same input.

    Raises
    ------
    InputError
        If the name or an option is unknown, a number impossible, or a triad without white noise.
    """
    if name not in EXPORTS:
        raise InputError(f"expected one of {', '.join(EXPORTS)}, got {name!r}")
    function = EXPORTS[name].function
    own = list(inspect.signature(function).parameters)[1:]
    shared = () if function is schuler else _COMMON
    for key in options:
        if key not in (*shared, *own):
            options_text = ", ".join((*shared, *own)) or "none"
            raise InputError(f"{name}: unknown option {key!r}; known are {options_text}")
    if function is schuler:
        return function(result)
    chosen = numbers.common(**{key: value for key, value in options.items() if key in shared})
    return function(numbers.numbers(result, chosen), **{k: v for k, v in options.items() if k in own})


def export(result: NoiseIdentification | ImuSpec, name: str, path: Path | str, **options: Any) -> Path:
    """Write the configuration of another program to a file, which appears only when it is complete.

    Parameters
    ----------
    result, name, **options
        See :func:`export_text`.
    path : Path or str

    Returns
    -------
    Path
        The file.
    """
    return write_text(path, export_text(result, name, **options))


def _axis_table(axis: AxisNoise) -> dict[str, Any]:
    table: dict[str, Any] = {_FIELDS[letter]: estimate.value for letter, estimate in axis.terms.items()}
    if axis.gauss_markov:
        table["gauss_markov"] = [[sigma.value, tau.value] for sigma, tau in axis.gauss_markov]
    return table
