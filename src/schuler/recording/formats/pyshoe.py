"""PyShoe's motion-capture trials: an IMU on a shoe, the author's labels, thresholds and errors, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames, units
from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_vector3
from schuler.exceptions import FileFormatError
from schuler.files import sha256
from schuler.plotting.notebook import Abridged
from schuler.recording.formats import matlab
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase

#: The author's detectors, in the order of ``trial_error``: likelihood ratio, angular rate energy, acceleration
#: variance, memory-based graph-theoretic detector, and the speed of the motion capture itself.
DETECTORS = ("shoe", "ared", "amvd", "mbgtd", "vicon")
#: Noise that the author's SHOE statistic is relative to, and his gravity. [m/s^2], [rad/s], [m/s^2]
AUTHOR_SIGMA_ACCEL, AUTHOR_SIGMA_GYRO, AUTHOR_GRAVITY = 0.00098, 8.7266463e-5, 9.8029
#: Where the trials were recorded: the university's campus at Downsview, Toronto.
PLACE_DEG = (43.782, -79.466, 150.0)


@dataclass(frozen=True, repr=False)
class PyShoeTrial(Abridged):
    """One trial.

    Attributes
    ----------
    recording : Recording
        IMU, and as reference the motion capture, put down at :data:`PLACE_DEG` with its x axis to the north.
    position_n : ndarray, shape (n, 3)
        Motion capture at the IMU samples, in right-handed axes with the third one down. [m]
    labels : dict of str to ndarray of bool, shape (n,)
        The author's zero-velocity samples by detector.
    thresholds : dict of str to float
        The thresholds that made the labels: for each trial those with the least error against the motion capture.
    errors : dict of str to float
        The author's error by detector, see :func:`schuler.navigation.foot.errors.walk_errors`, ``author_error``. [m]
    best : str
        Detector with the least error.
    """

    recording: Recording
    position_n: FloatArray
    labels: dict[str, BoolArray]
    thresholds: dict[str, float]
    errors: dict[str, float]
    best: str


def is_pyshoe(path: Path | str) -> bool:
    """Whether a file looks like one of these trials, from the names in it."""
    try:
        return {"imu", "ts", "gt", "trial_error"} <= matlab.load(Path(path)).keys()
    except FileFormatError:
        return False


def read_pyshoe(path: Path | str, *, uniform_clock: bool = True, place_llh: ArrayLike | None = None) -> PyShoeTrial:
    """Read a processed trial, ``data/vicon/processed/*.mat``.

    Parameters
    ----------
    path : Path or str
    uniform_clock : bool
        Replace the stamps, which jitter by milliseconds with their arrival at the computer, by as many equally spaced
        ones from the first to the last: the sensor samples with its own clock.
    place_llh : array_like, shape (3,), optional
        Place given to the motion capture: latitude, longitude [rad], height [m].

    Raises
    ------
    FileFormatError
        If the file is not a trial, or its arrays do not fit together.

    Notes
    -----
    The sensor, on top of the shoe, has x forward, y right and z down. The motion capture's columns are a left-handed
    set, with the third one up: turning its sign makes north, east, down axes with an unknown heading. It has jumps of
    up to 0.8 m in some trials, which are left as they are.

    References
    ----------
    Wagstaff, Peretroukhin, Kelly (2020), Robust data-driven zero-velocity detection for foot-mounted inertial
    navigation, and the data set's own description.
    """
    path = Path(path)
    contents = matlab.load(path)
    imu, t, gt = (_array(contents, name, path) for name in ("imu", "ts", "gt"))
    t = t.ravel()
    n = len(t)
    if imu.shape != (n, 6) or gt.shape != (n, 3) or n < 2:
        raise FileFormatError(
            f"expected imu of shape (n, 6), gt (n, 3) and ts of n values, got {imu.shape}, {gt.shape} and {n}", path
        )
    if not (np.isfinite(imu).all() and np.isfinite(gt).all() and np.isfinite(t).all() and np.all(np.diff(t) > 0.0)):
        raise FileFormatError("expected finite numbers and increasing times in imu, gt and ts", path)
    notes = ["Accelerations in m/s^2 and rates in rad/s, forward, right, down."]
    if uniform_clock:
        jitter = float(np.abs(t - np.linspace(t[0], t[-1], n)).max())
        t = np.linspace(t[0], t[-1], n)
        notes.append(f"Time stamps were made equally spaced; they had been off by up to {1e3 * jitter:.1f} ms.")
    jumps = int(np.sum(np.linalg.norm(np.diff(gt, axis=0), axis=1) > 0.05))
    if jumps:
        notes.append(f"The motion capture jumps by more than 5 cm from one sample to the next {jumps} times.")
    position = gt * np.array([1.0, 1.0, -1.0])
    lat, lon, height = PLACE_DEG
    llh = np.array([lat * units.DEG, lon * units.DEG, height]) if place_llh is None else as_vector3(place_llh, "place")
    recording = Recording(
        imu=ImuSeries(t, imu[:, 3:].copy(), imu[:, :3].copy()),
        reference=Trajectory(t, frames.ecef_from_ned(position - position[0], llh)),
        metadata=Metadata(
            name=path.stem, time=TimeBase("local"), sources={path.name: sha256(path)}, notes=tuple(notes),
            options={"format": "pyshoe", "uniform_clock": uniform_clock},
        ),
    )  # fmt: skip
    errors = _array(contents, "trial_error", path).ravel()
    if len(errors) != len(DETECTORS):
        raise FileFormatError(f"expected {len(DETECTORS)} values in trial_error, got {len(errors)}", path)
    labels = {d: _array(contents, f"zv_{d}_opt", path).ravel().astype(bool) for d in DETECTORS}
    short = [d for d, label in labels.items() if len(label) != n]
    if short:
        raise FileFormatError(f"expected {n} labels in zv_{short[0]}_opt, got {len(labels[short[0]])}", path)
    thresholds = {d: float(_array(contents, f"G_{d}_opt", path).ravel()[0]) for d in DETECTORS}
    best = str(np.asarray(contents.get("best_detector", [""])).ravel()[0]).strip()
    return PyShoeTrial(
        recording, position, labels, thresholds, dict(zip(DETECTORS, map(float, errors), strict=True)), best
    )


def _array(contents: dict[str, Any], name: str, path: Path) -> FloatArray:
    if name not in contents:
        held = ", ".join(k for k in contents if not k.startswith("__"))
        raise FileFormatError(f"expected an array {name!r} as in PyShoe's processed trials; the file has {held}", path)
    return np.asarray(contents[name], dtype=np.float64)
