"""Find the poses and turns of a session, and the plateaus of a rate table, in a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.bench.faces import FACES, faces_of
from schuler.calibration.bench.poses import poses_of
from schuler.calibration.bench.turns import Turns, turns_of
from schuler.calibration.result.parameters import AXES
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import static_intervals
from schuler.units import DEG, G0

#: A turn may differ from its nominal angle by this share, and turn about other axes by this share.
TOLERANCE = 0.2
_POSE_S = 1.0  # shortest pose [s]


def ferraris_sections(
    imu: ImuSeries, *, turn_angle: float = 2.0 * np.pi, gravity: float = G0
) -> tuple[list[tuple[float, float]], list[tuple[float, float]], FloatArray, tuple[str, ...]]:
    """Poses on faces, and turns between them, of a session without labels.

    Parameters
    ----------
    imu : ImuSeries
        Rates. [rad/s], [m/s^2]
    turn_angle : float
        Magnitude of the angle of each turn. [rad]
    gravity : float
        [m/s^2]

    Returns
    -------
    rest, turns : list of (start, stop)
        [s]
    angle : ndarray, shape (n, 3)
        Angle of each turn times its axis; its sign is that of the gyroscope. [rad]
    notes : tuple of str
        What was found.

    Raises
    ------
    InputError
        If fewer than two intervals at rest are found.

    Notes
    -----
    A turn is what lies between two neighbouring intervals at rest on the same face if the integral of the rate, less
    the bias of these two, is ``turn_angle`` within 20 % about one axis and less than 20 % of it about the others.
    """
    at_rest = static_intervals(imu, window_s=0.5, min_s=_POSE_S, gravity=gravity)
    if len(at_rest) < 2:
        raise InputError(
            f"imu: expected intervals at rest before and after each turn, found {len(at_rest)}; hold still for "
            f"{_POSE_S:g} s between movements, or give sections"
        )
    spans = [(float(a), float(b)) for a, b in zip(at_rest.start, at_rest.stop, strict=True)]
    poses = poses_of(imu, spans, gravity=gravity)
    faces = faces_of(poses)
    rest = [span for span, good in zip(spans, faces.usable, strict=True) if good]
    turns, angles = [], []
    dt = imu.interval
    for k in range(len(spans) - 1):
        a, b = int(at_rest.index[k, 1]), int(at_rest.index[k + 1, 0])
        if b - a < 20 or faces.names[k] != faces.names[k + 1] or not faces.usable[k : k + 2].all():
            continue
        bias = 0.5 * (poses.omega[k] + poses.omega[k + 1])
        angle = (imu.gyro[a:b] - bias).sum(axis=0) * dt
        j = int(np.abs(angle).argmax())
        others = np.delete(angle, j)
        if abs(abs(angle[j]) - turn_angle) < TOLERANCE * turn_angle and np.abs(others).max() < TOLERANCE * turn_angle:
            turns.append((float(imu.t[a]), float(imu.t[b - 1])))
            angles.append(np.eye(3)[j] * np.copysign(turn_angle, angle[j]))
    how = ", ".join(f"{'+' if v.sum() > 0.0 else '-'}{AXES[int(np.abs(v).argmax())]}" for v in angles)
    lacking = [f for f in FACES if f in faces.missing]
    notes = (
        f"found {len(rest)} poses on faces ({'all six' if not lacking else 'without ' + ', '.join(lacking)}) and "
        f"{len(turns)} turns{f' about {how}, signs from the gyroscopes' if how else ''}",
    )
    return rest, turns, np.array(angles).reshape(-1, 3), notes


def rate_plateaus(
    imu: ImuSeries,
    rates: ArrayLike,
    *,
    min_s: float = 5.0,
    window_s: float = 0.5,
    tolerance: float = 0.1,
    settle_s: float = 1.0,
    whole_turns: bool = True,
) -> Turns:
    """Turns at constant rates in the log of a rate table.

    Parameters
    ----------
    imu : ImuSeries
    rates : array_like, shape (k,)
        Rates the table was set to, magnitudes. [rad/s]
    min_s : float
        Shortest plateau. [s]
    window_s : float
        Window in which the rate has to be steady. [s]
    tolerance : float
        A plateau belongs to a rate if its mean is as close as this, relative.
    settle_s : float
        Cut off at both ends. [s]
    whole_turns : bool
        Cut each plateau to a whole number of turns if it holds one, so that the horizontal part of Earth rate and a
        tilt of the axis average out.

    Returns
    -------
    Turns
        About +-x, +-y or +-z of the unit, as the largest component says.

    Raises
    ------
    InputError
        If a rate is not positive or no plateau is found.

    Notes
    -----
    A window is steady if its standard deviation is at most three times that of the quietest fifth of the windows that
    turn, and its mean differs from that of its neighbours by no more than that noise and the tolerance of a table
    explain.
    """
    rates = as_floats(rates, "rates", (None,))
    if (rates <= 0.0).any() or not len(rates):
        raise InputError(f"rates: expected positive rates in rad/s, got {rates.tolist()}")
    if len(imu) < 2:
        raise InputError("turns on a table: expected a log of several samples, got one")
    series = imu.rates()
    W = max(round(window_s * imu.rate_hz), 5)
    n = len(series) // W
    blocks = series.gyro[: n * W].reshape(n, W, 3)
    mean, spread = blocks.mean(axis=1), blocks.std(axis=1).max(axis=1)
    j = np.abs(mean).argmax(axis=1)
    largest = mean[np.arange(n), j]
    nearest = np.abs(np.abs(largest)[:, None] - rates).argmin(axis=1)
    close = np.abs(np.abs(largest) - rates[nearest]) < tolerance * rates[nearest]
    if close.any():
        quiet = np.sort(spread[close])[: max(1, int(close.sum()) // 5)].mean()
        steady = close & (spread <= 3.0 * quiet)
    else:
        quiet, steady = 0.0, close
    step = 5.0 * quiet / np.sqrt(W) + 1e-3 * rates[nearest]
    spans: list[tuple[float, float]] = []
    given: list[FloatArray] = []
    k = 0
    while k < n:
        last = k
        while (
            last + 1 < n and steady[k] and steady[last + 1] and np.abs(mean[last + 1] - mean[last]).max() <= step[last]
        ):
            last += 1
        if steady[k]:
            start = float(series.t[k * W]) + settle_s
            stop = float(series.t[(last + 1) * W - 1]) - settle_s
            rate = float(np.copysign(rates[nearest[k]], largest[k]))
            period = 2.0 * np.pi / abs(rate)
            if whole_turns and stop - start >= period:
                stop = start + period * np.floor((stop - start) / period) - imu.interval
            if stop - start >= min_s:
                spans.append((start, stop))
                given.append(np.eye(3)[j[k]] * rate)
        k = last + 1
    if not spans:
        listed = ", ".join(f"{r / DEG:.3g}" for r in rates)
        raise InputError(f"imu: found no plateau of {min_s:g} s or longer at {listed} deg/s; check rates and units")
    return turns_of(imu, spans, rate=np.array(given))


def sections_by_label(labels: Sequence[str], t: ArrayLike) -> dict[str, tuple[float, float]]:
    """First and last time of each run of a label, for a log whose samples are labelled ``x_p``, ``x_rot``, ...

    Raises
    ------
    InputError
        If a label occurs in two places.
    """
    times = as_floats(t, "t", (len(labels),))
    out: dict[str, tuple[float, float]] = {}
    first = 0
    for k in range(1, len(labels) + 1):
        if k == len(labels) or labels[k] != labels[first]:
            if labels[first] in out:
                raise InputError(f"labels: expected each section once, but {labels[first]!r} comes twice")
            out[labels[first]] = (float(times[first]), float(times[k - 1]))
            first = k
    return out
