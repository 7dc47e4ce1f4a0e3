"""Calibration of gyroscopes by the rotation of their own platform: biases, scale factor and installation errors.

A platform that rests, then turns about one axis, shows of every gyroscope its bias and its response to a rate about
that axis: the errors that rotation itself brings in and no revolution cancels. Turned about more axes, it shows the
other columns of M as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments
from schuler.rotary import gimbals
from schuler.rotary.calibration_result import RotationCalibration, Stretch
from schuler.rotary.encoder import Platform
from schuler.rotary.schedule import Schedule
from schuler.units import DEG, DEG_PER_HR

_TURN = 2.0 * np.pi
_PIECE = 10.0  # of a rest, at least: enough pieces to see whether noise is white [s]
_MOVING = 100.0 * DEG_PER_HR  # a platform slower than this rests [rad/s]
_STEADY = 0.01  # a rate that changes by a larger share within a stretch is no constant rate


def calibrate_rotation(
    increments: Increments,
    platform: Platform,
    body: NavState,
    *,
    spans: Sequence[tuple[float, float]] | None = None,
    axes: ArrayLike | None = None,
    random_walk: ArrayLike | None = None,
    whole_revolutions: bool = True,
    earth_rotation: bool = True,
) -> RotationCalibration:
    """Biases and responses of gyroscopes on a platform at rest and turning, by weighted least squares.

    Parameters
    ----------
    increments : Increments
        IMU axes, on a vehicle at rest.
    platform : Platform
        Schedule or encoder readings.
    body : NavState
        Attitude and place of the vehicle, for the Earth's rate: an error of a degree leaves up to 0.26 deg/h.
    spans : sequence of (float, float), optional
        Stretches of constant rate, at rest and turning. Default: those between the breakpoints of a schedule; encoder
        readings have none. [s]
    axes : array_like, shape (m, 3), optional
        Directions, IMU axes, whose responses are sought. Default: the axes of the IMU along which the platform turns
        if it turns about those only, else directions that span its rates.
    random_walk : array_like, shape () or (3,), optional
        Angle random walk for weights and covariance, e.g. of
        :func:`~schuler.rotary.calibration.allan_random_walk`. Default: from differences of the samples.
        [rad/sqrt(s)]
    whole_revolutions : bool
        Cut turning spans to whole revolutions, which also average what depends on the angle (g-sensitivity, tilt of
        the axis, an error of ``body``).
    earth_rotation : bool
        False leaves the Earth's rate in, as the thesis does: it ends in biases and responses.

    Returns
    -------
    RotationCalibration

    Raises
    ------
    InputError
        If a span lies outside the log, is too short for a revolution or not of constant rate, or the rates do not
        separate biases from responses.

    Notes
    -----
    Stretch j of length T gives ``reading - omega = bias + sum_a response_a (axis_a . omega)`` with weight
    ``T / random_walk^2``, where omega is the platform's and the Earth's rate together; what M does to the Earth's rate
    across the axes is left out (1000 ppm of it are 0.015 deg/h). Du estimates in two steps, which is the same for one
    rest and one rotation. Calibrate at the rate of operation: the scale factors of MEMS depend on it.

    References
    ----------
    Du (2015), section 3.4 and eqs. (3.39)-(3.47), where the Earth's rate is projected with the transposed matrix and
    then dropped; dropped it costs up to 15 deg/h of bias.

    Examples
    --------
    A NAV440 that rests for a minute and turns for six revolutions::

        calibration = calibrate_rotation(log, schedule, body, spans=[(0, 60), (60, 132)])
        print(calibration.summary())
        navigated = mechanize_rotating(calibration.compensated(log.between(132, 432)), start, schedule)
    """
    chosen = _spans(increments, platform, spans)
    noise = differenced_random_walk(increments, chosen) if random_walk is None else np.broadcast_to(
        as_floats(random_walk, "random_walk"), (3,)
    )  # fmt: skip
    if not np.all(noise > 0.0):
        raise InputError(
            f"random_walk: expected positive numbers, got {noise}; give the noise of the gyroscopes for a log without"
        )
    notes: list[str] = []
    stretches: list[Stretch] = []
    for span in chosen:
        stretches += _stretches(increments, platform, body, span, whole_revolutions, earth_rotation, notes)
    if not earth_rotation:
        notes.append("the Earth's rate was left in: up to 15 deg/h of the biases and responses are its")
    return estimate(stretches, noise, axes=axes, notes=notes)


def estimate(
    stretches: Sequence[Stretch], random_walk: FloatArray, *, axes: ArrayLike | None = None, notes: Sequence[str] = ()
) -> RotationCalibration:
    """Least squares over stretches, e.g. of several recordings.

    Parameters
    ----------
    stretches : sequence of Stretch
    random_walk : ndarray, shape (3,)
        [rad/sqrt(s)]
    axes, notes
        See :func:`calibrate_rotation`.

    Raises
    ------
    InputError
        If the rates do not separate biases from responses.
    """
    if not stretches:
        raise InputError("expected at least one stretch at rest and one turning")
    rates = np.array([s.platform for s in stretches])
    directions = _directions(rates) if axes is None else _orthonormal(as_floats(axes, "axes", (None, 3)))
    T = np.array([s.duration for s in stretches])
    omega = np.array([s.expected for s in stretches])
    Z = np.array([s.reading for s in stretches]) - omega
    h = np.concatenate((np.ones((len(T), 1)), omega @ directions.T), axis=1)  # rows of H, the same for the three axes
    scale = np.concatenate(([1.0], np.maximum(np.abs(h[:, 1:]).max(axis=0), DEG_PER_HR)))
    singular = np.linalg.svd(h / scale, compute_uv=False)
    if len(T) < h.shape[1] or singular[-1] < 1e-3 * singular[0]:
        raise InputError(
            f"the {len(T)} stretches at rates of {np.unique(np.round(rates / DEG, 3), axis=0).tolist()} deg/s do not "
            f"separate {h.shape[1] - 1} responses from the biases; add a rest, or a rotation at another rate or the "
            "other way"
        )
    normal = (h * T[:, None]).T @ h
    inverse = np.linalg.inv(normal)
    x = inverse @ ((h * T[:, None]).T @ Z)  # (1 + m, 3)
    residual = (Z - h @ x) * np.sqrt(T)[:, None] / random_walk
    covariance = np.einsum("ab,ij->aibj", inverse, np.diag(random_walk**2)).reshape(3 * len(x), 3 * len(x))
    return RotationCalibration(
        axes=directions, bias=x[0], response=x[1:], covariance=covariance,
        random_walk=np.array(random_walk, dtype=np.float64), chi_square=float(np.sum(residual**2)),
        degrees=3 * (len(T) - len(x)), stretches=tuple(stretches), notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _spans(
    increments: Increments, platform: Platform, spans: Sequence[tuple[float, float]] | None
) -> list[tuple[float, float]]:
    begin, end = increments.start, float(increments.t[-1])
    if spans is None:
        if not isinstance(platform, Schedule):
            raise InputError("encoder readings do not say where the rate is constant: give spans=[(start, stop), ...]")
        edges = np.concatenate(([begin], platform.breakpoints(begin, end), [end]))
        steady = []
        for a, b in pairwise(edges):
            if b - a > 1.0 and not np.any(platform.accelerations(np.array([0.5 * (a + b)]))):
                steady.append((float(a), float(b)))
        return steady
    chosen = [(float(a), float(b)) for a, b in spans]
    for a, b in chosen:
        if not (begin - 1e-6 <= a < b <= end + 1e-6):
            raise InputError(f"spans: expected stretches within the log, {begin:.3f}..{end:.3f} s, got {a}..{b} s")
    if not chosen:
        raise InputError("spans: expected at least one")
    return chosen


def _stretches(
    increments: Increments,
    platform: Platform,
    body: NavState,
    span: tuple[float, float],
    whole_revolutions: bool,
    earth_rotation: bool,
    notes: list[str],
) -> list[Stretch]:
    """Means over a span: of whole revolutions one by one, of a rest in pieces."""
    part = increments.between(*span)
    limits = np.concatenate(([part.start], part.t))
    angle = platform.angles(limits)
    turned = angle[-1] - angle[0]
    duration = limits[-1] - limits[0]
    rates = np.abs(turned) / duration
    fastest = int(np.argmax(rates))
    if rates[fastest] < _MOVING:
        edges = np.linspace(limits[0], limits[-1], max(int(duration / _PIECE), 1) + 1)
    else:
        line = angle[0, fastest] + turned[fastest] * (limits - limits[0]) / duration
        allowed = max(_STEADY * abs(turned[fastest]), 0.5 * DEG)
        if np.abs(angle[:, fastest] - line).max() > allowed:
            raise InputError(
                f"the platform's rate is not constant within {span[0]:.3f}..{span[1]:.3f} s (off a line by "
                f"{np.abs(angle[:, fastest] - line).max() / DEG:.2f} deg); give spans without run-up and reversals"
            )
        period = _TURN / rates[fastest]
        count = int(np.floor(duration / period + 1e-6))
        if whole_revolutions and count == 0:
            raise InputError(
                f"the span {span[0]:.3f}..{span[1]:.3f} s holds {abs(turned[fastest]) / _TURN:.2f} revolutions; give "
                "one at least, or pass whole_revolutions=False"
            )
        if whole_revolutions:
            if duration - count * period > 0.5 * increments.dt[0]:
                notes.append(f"the last {duration - count * period:.2f} s of a span are no whole revolution: left out")
            edges = limits[0] + period * np.arange(count + 1)
        else:
            edges = limits[[0, -1]]
    stretches = []
    nearest = np.searchsorted(limits, edges + 1e-9 - 0.5 * part.dt[0])
    for a, b in pairwise(nearest):
        stretches.append(_mean(part, platform, body, int(a), int(min(b, len(part))), earth_rotation))
    return stretches


def _mean(part: Increments, platform: Platform, body: NavState, a: int, b: int, earth_rotation: bool) -> Stretch:
    """Mean of intervals a to b - 1 and what is true of them."""
    t0, h = part.t[a:b] - part.dt[a:b], part.dt[a:b]
    T = float(np.sum(h))
    middle = t0 + 0.5 * h
    angles = platform.angles(middle)
    ends = platform.angles(np.array([t0[0], part.t[b - 1]]))
    rates = np.diff(platform.angles(np.append(t0, part.t[b - 1])), axis=0) / h[:, None]
    # over the stretch the angle counts, not how its readings scatter
    rates += (ends[1] - ends[0]) / T - np.sum(rates * h[:, None], axis=0) / T
    turning = gimbals.omega_bs_s(platform.axes, angles, rates, platform.C_mount)
    own = np.sum(turning * h[:, None], axis=0) / T
    own[np.abs(own) < 1e-12] = 0.0
    expected = own.copy()
    if earth_rotation:
        C_nb = frames.C_en(body.llh).T @ rotation.dcm_from_quat(body.q_eb)
        earth_b = C_nb.T @ earth.earth_rate_ned(body.llh[0])
        C_bs = gimbals.C_bs(platform.axes, angles, platform.C_mount)
        expected += np.sum(np.einsum("nji,j->ni", C_bs, earth_b) * h[:, None], axis=0) / T
    reading = np.sum(part.dtheta_ib_b[a:b], axis=0) / T
    return Stretch(float(t0[0]), float(part.t[b - 1]), reading, expected, own)


def _directions(rates: FloatArray) -> FloatArray:
    """Axes of the IMU along which there was rotation if there was none across them, else an orthonormal basis."""
    size = float(np.abs(rates).max())
    if size < _MOVING:
        raise InputError("the platform never turns, so responses cannot be seen; give a span in which it does")
    _, s, Vt = np.linalg.svd(rates, full_matrices=False)
    rank = int(np.sum(s > 1e-3 * s[0]))
    used = np.any(np.abs(rates) > 1e-3 * size, axis=0)
    if int(used.sum()) == rank:
        return np.asarray(np.eye(3)[used])
    basis = Vt[:rank].copy()
    for row in basis:  # towards the larger positive component, so that signs do not depend on rounding
        row *= np.sign(row[np.argmax(np.abs(row))])
    return basis


def _orthonormal(axes: FloatArray) -> FloatArray:
    unit = np.stack([gimbals.axis_vector(u) for u in axes])
    if not np.allclose(unit @ unit.T, np.eye(len(unit)), atol=1e-6):
        raise InputError("axes: expected perpendicular directions")
    return unit


_LEAST = 20  # differences of the Allan deviation at its averaging time, that do not overlap


def differenced_random_walk(increments: Increments, spans: Sequence[tuple[float, float]]) -> FloatArray:
    """Angle random walk from differences of consecutive samples within spans, at rest or turning evenly.

    Parameters
    ----------
    increments : Increments
        IMU axes.
    spans : sequence of (float, float)
        [s]

    Returns
    -------
    ndarray, shape (3,)
        [rad/sqrt(s)]

    Notes
    -----
    Right for white noise. A filter in the sensor that makes samples resemble each other makes it too small; then use
    :func:`allan_random_walk`.
    """
    squares, count = np.zeros(3), 0
    for start, stop in spans:
        part = increments.between(start, stop)
        rate = part.dtheta_ib_b / part.dt[:, None]
        squares += np.sum(0.5 * np.diff(rate, axis=0) ** 2 * part.dt[1:, None], axis=0)
        count += len(part) - 1
    return np.asarray(np.sqrt(squares / max(count, 1)))


def allan_random_walk(increments: Increments, span: tuple[float, float], *, tau_s: float = 1.0) -> FloatArray:
    """Angle random walk from the Allan deviation of a rest, ``sigma(tau) sqrt(tau)``.

    Parameters
    ----------
    increments : Increments
        IMU axes, evenly sampled.
    span : (float, float)
        At rest. [s]
    tau_s : float
        Where the curve falls with the square root: beyond the sensor's filter, before its instability. [s]

    Returns
    -------
    ndarray, shape (3,)
        [rad/sqrt(s)]

    Raises
    ------
    InputError
        If the rest is shorter than twenty times ``tau_s``.

    References
    ----------
    Du (2015), section 4.1, where the NAV440's 0.4 deg/sqrt(h) are found this way; IEEE Std 952, annex C.
    """
    from schuler.characterisation.allan import allan_deviation

    part = increments.between(*span)
    duration = float(np.sum(part.dt))
    if duration < _LEAST * tau_s:
        raise InputError(
            f"span: expected a rest of at least {_LEAST * tau_s:g} s for an averaging time of {tau_s:g} s, "
            f"got {duration:g} s; rest longer or pass a shorter tau_s"
        )
    rate_hz = len(part) / duration
    deviations = [
        allan_deviation(axis / part.dt, rate_hz, taus=[tau_s], noise=0.0).deviation[0] for axis in part.dtheta_ib_b.T
    ]
    return np.asarray(np.array(deviations) * np.sqrt(tau_s))
