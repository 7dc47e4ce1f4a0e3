"""Contradictions within GNSS solutions: positions against velocities, clocks against the IMU's, rejected fixes."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import FORCED, KINDS, POSITION, REJECTED, VELOCITY
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.timebase import WEEK_S

#: Beginning of the note on noise that the filter had to enlarge.
LARGER = "innovations show that the"
#: Beginning of the note on a slow error of positions that a run does not have.
SLOW_LEFT = "GNSS positions seem to have a slow error that their accuracies leave out"
#: Beginnings of the notes on claims without fixes: what stretches made without contradict, and what none tested.
UNAIDED_WRONG = "claims without fixes are too small"
UNAIDED_UNTESTED = "claims without fixes are not tested"

_MOVING = 1.0  # speed from which a direction means something [m/s]
_PAIRS = 20  # fewer do not convict
_BETWEEN = 2.0  # acceleration between two fixes that neither velocity shows [m/s^2]
_ACCELERATION = 20.0  # of a vehicle whose velocity is not measured, at most [m/s^2]
_MEDIAN_1D, _MEDIAN_2D = 0.6745, 1.1774  # of the size of normal errors of one and two components, in sigmas
_ALONE = 1.5  # a single fix is off its neighbours' line twice as far as they seem off theirs, because of it


def no_overlap(imu: ImuSeries, gnss: GnssSeries) -> None:
    """Raise if no fix lies within the IMU log, and say how far the clocks are apart.

    Raises
    ------
    InputError
        Naming the number of GPS weeks if that explains it.
    """
    if np.any((gnss.t >= imu.t[0]) & (gnss.t <= imu.t[-1])):
        return
    weeks = round(float(gnss.t[0] - imu.t[0]) / WEEK_S)
    shifted = gnss.t - weeks * WEEK_S
    text = (
        f"no GNSS fix lies within the IMU log (fixes {gnss.t[0]:.3f}..{gnss.t[-1]:.3f} s, IMU {imu.t[0]:.3f}.."
        f"{imu.t[-1]:.3f} s): check the clocks (recording hints time and offset)"
    )
    if weeks and np.any((shifted >= imu.t[0]) & (shifted <= imu.t[-1])):
        text += f"; {weeks:+d} GPS week{'s' if abs(weeks) > 1 else ''} would explain it: a week number is wrong"
    raise InputError(text)


def frozen(gnss: GnssSeries) -> BoolArray:
    """Fixes whose position equals the one before to the last digit although they claim to move. Shape (n,).

    A receiver that lost its satellites, or a driver that repeats the last message with new stamps. Half a metre a step
    is required, more than any receiver's rounding; without velocities no fix is marked.
    """
    same = np.zeros(len(gnss), dtype=bool)
    if gnss.v_n is None or len(gnss) < 2:
        return same
    repeated = np.all(gnss.llh[1:] == gnss.llh[:-1], axis=1)
    speed = np.linalg.norm(gnss.v_n[:, :2], axis=1)
    same[1:] = repeated & (np.minimum(speed[1:], speed[:-1]) * np.diff(gnss.t) > 0.5)
    return same


def blunders(gnss: GnssSeries) -> BoolArray:
    """Single fixes that jump off the way of their neighbours and back. Shape (n,).

    Parameters
    ----------
    gnss : GnssSeries

    Notes
    -----
    A fix is compared with the line between the one before and the one after it, bent by the acceleration between their
    velocities. Beyond six 1-sigma, stated or by the median of all fixes so compared, whichever is larger, and what a
    vehicle may turn or accelerate in between (with velocities half their change over the longer step and half a metre,
    without 20 m/s^2), it is off if its neighbours, compared in the same way, seem off by clearly less and to the other
    side, as they do because of it. A step that stays, scatter, and two wrong fixes in a row are not marked.
    """
    off = np.zeros(len(gnss), dtype=bool)
    if len(gnss) < 5:
        return off
    before, after = np.diff(gnss.t)[:-1], np.diff(gnss.t)[1:]
    w = (after / (before + after))[:, None]
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh), gnss.llh[0])
    e = r[1:-1] - w * r[:-2] - (1.0 - w) * r[2:]
    var = np.einsum("nii->ni", gnss.cov_r_n)
    var = var[1:-1] + w**2 * var[:-2] + (1.0 - w) ** 2 * var[2:]
    slack = 0.5 * _ACCELERATION * before * after
    if gnss.v_n is not None and np.isfinite(gnss.v_n[:, :2]).all():
        change = np.nan_to_num(gnss.v_n[2:] - gnss.v_n[:-2])
        e += 0.5 * change * (before * after / (before + after))[:, None]
        slack = np.minimum(slack, 0.5 + 0.5 * np.maximum(before, after) * np.linalg.norm(change, axis=1))
    for part, median in ((slice(0, 2), _MEDIAN_2D), (slice(2, 3), _MEDIAN_1D)):
        size = np.linalg.norm(e[:, part], axis=1)
        scatter = float(np.median(size)) / median  # accuracies may be stated far too small
        far = size > 6.0 * np.maximum(np.sqrt(var[:, part].max(axis=1)), scatter) + slack
        for to in (-1, 1):
            beside, same = np.roll(size, to), np.sum(e[:, part] * np.roll(e[:, part], to, axis=0), axis=1)
            far &= (size > _ALONE * beside) & (same < 0.0)
        off[2:-2] |= far[1:-1]
    return off


def held(gnss: GnssSeries) -> tuple[BoolArray, float]:
    """Rows that repeat a fix which a driver holds at a higher rate, and how often each fix is given.

    Parameters
    ----------
    gnss : GnssSeries

    Returns
    -------
    repeated : ndarray of bool, shape (n,)
        Rows that say nothing new. Where the receiver stands and its fixes do not change for longer, one row in as many
        as a fix is held in motion is left.
    times : float
        Rows a fix, 1 where nothing is held.

    Notes
    -----
    A row is the same if position and velocity are, to the last digit. A fix is held if, where the position changes,
    hardly any row stands alone; a receiver that writes few digits has such runs at rest, but not in motion.
    """
    same = np.all(gnss.llh[1:] == gnss.llh[:-1], axis=1)
    if gnss.v_n is not None:
        same &= np.all((gnss.v_n[1:] == gnss.v_n[:-1]) | np.isnan(gnss.v_n[1:]), axis=1)
    first = np.flatnonzero(np.concatenate(([True], ~same)))
    none = np.zeros(len(gnss), dtype=bool), 1.0
    if len(first) < _PAIRS or len(first) > 0.75 * len(gnss):
        return none
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh[first]), gnss.llh[0])[:, :2]
    sigma = np.sqrt(np.einsum("nii->n", gnss.cov_r_n[first][:, :2, :2]))
    moved = np.linalg.norm(np.diff(r, axis=0), axis=1)
    length = np.diff(first)
    moving = moved > np.maximum(0.1 * float(np.quantile(moved, 0.9)), 1e-3)
    if moving.sum() < _PAIRS or np.ptp(r, axis=0).max() < 10.0 * float(np.median(sigma)):
        return none
    times = float(np.median(length[moving]))
    if times < 2.0 or np.mean(length[moving] == 1) > 0.1:
        return none
    row = np.arange(len(gnss))
    since = row - first[np.searchsorted(first, row, side="right") - 1]
    return since % max(round(times), 2) != 0, times


def contradictions(gnss: GnssSeries, *, delay: float = 0.0, used: bool = True) -> list[str]:
    """Sentences on velocities that do not fit the positions.

    Parameters
    ----------
    gnss : GnssSeries
    delay : float
        Configured delay of the velocities. [s]
    used : bool
        Whether velocities are measurements, so that their lateness matters.

    Returns
    -------
    list of str
        Velocities that seem late, positions that jump.

    Raises
    ------
    InputError
        If the velocities do not go where the positions go, but do with a sign turned or two columns exchanged.

    Notes
    -----
    Displacements between fixes are compared with the integrals of velocity (trapezoid). Directions are judged over
    stretches long enough to move ten sigmas. A lateness tau leaves ``tau * a`` between the mean velocity of an interval
    and its displacement, with ``a`` the acceleration: a regression, given where it is six standard errors large.
    """
    if gnss.v_n is None or gnss.cov_v_n is None or len(gnss) < _PAIRS:
        return []
    dt = np.diff(gnss.t)
    unbroken = dt <= max(2.0, 2.5 * float(np.median(dt)))
    r_n = np.einsum(
        "nji,nj->ni", frames.C_en(gnss.llh[:-1]), np.diff(frames.ecef_from_llh(gnss.llh), axis=0)
    )  # displacement in each step, north-east-down
    by_v = 0.5 * (gnss.v_n[1:] + gnss.v_n[:-1]) * dt[:, None]
    sigma_r = np.sqrt(np.einsum("nii->n", gnss.cov_r_n[:, :2, :2]))
    sigma_v = np.sqrt(np.einsum("nii->n", gnss.cov_v_n[:, :2, :2]))
    _directions(r_n, by_v, dt, unbroken, float(np.median(sigma_r)))
    sentences = []
    if used:
        sentences += _lateness(r_n, by_v, np.diff(gnss.v_n, axis=0), dt, unbroken, delay)
    late = 0.5 * np.abs(delay) * np.linalg.norm(np.diff(gnss.v_n, axis=0)[:, :2], axis=1)
    gap = np.linalg.norm((r_n - by_v)[:, :2], axis=1)
    allowed = 6.0 * np.hypot(np.hypot(sigma_r[1:], sigma_r[:-1]), dt * np.hypot(sigma_v[1:], sigma_v[:-1]))
    # a turn between fixes: the trapezoid misses a' dt^3 / 12, a fifth of the change of velocity is far above it
    allowed += 0.2 * dt * np.linalg.norm(np.diff(gnss.v_n, axis=0)[:, :2], axis=1) + late
    # and what leaves no change of velocity: an acceleration for half the time, and back
    allowed += 0.25 * _BETWEEN * np.maximum(dt, 1.0) ** 2
    jump = np.flatnonzero(unbroken & (gap > allowed))
    if len(jump):
        worst = int(jump[np.argmax(gap[jump])])
        sentences.append(
            f"GNSS positions jump against their own velocities at {len(jump)} of {len(dt)} steps, the most by "
            f"{gap[worst]:.1f} m at {gnss.t[worst + 1]:.3f} s: wrong fixes, stamps that step, or accuracies too good "
            "to be true (gnss.position_sigma_floor_m)"
        )
    return sentences


def _directions(r_n: FloatArray, by_v: FloatArray, dt: FloatArray, unbroken: BoolArray, sigma: float) -> None:
    """Raise if displacements go along the velocities with a sign turned or columns exchanged, not along them."""
    speed = np.linalg.norm(by_v[:, :2], axis=1) / dt
    moving = unbroken & (speed > _MOVING)
    if moving.sum() < _PAIRS:
        return
    typical = float(np.median(speed[moving] * dt[moving]))
    length = 1
    while length * typical < 10.0 * sigma and length < len(dt) // _PAIRS:
        length *= 2
    edge = np.arange(0, len(dt) - length + 1, length)
    good = np.add.reduceat(moving.astype(int), edge)[: len(edge)] >= length
    d, v = (np.add.reduceat(x[:, :2], edge)[: len(edge)][good] for x in (r_n, by_v))
    if length * typical < 5.0 * sigma or len(d) < _PAIRS:
        return

    def along(candidate: FloatArray) -> float:
        return float(np.sum(d * candidate) / np.sqrt(np.sum(d**2) * np.sum(candidate**2) + 1e-300))

    given = along(v)
    others = {
        "the velocity has the wrong sign": -v,
        "latitude and longitude, or north and east velocity, are exchanged": v[:, ::-1],
        "the east velocity has the wrong sign": v * (1.0, -1.0),
        "the north velocity has the wrong sign": v * (-1.0, 1.0),
        "latitude and longitude are exchanged and signs are wrong": -v[:, ::-1],
    }
    best = max(others, key=lambda name: along(others[name]))
    if given < 0.7 and along(others[best]) > 0.9:
        raise InputError(
            f"GNSS positions do not go where GNSS velocities say (correlation {given:+.2f}); they would if {best} "
            f"({along(others[best]):+.2f}): correct the columns of the GNSS file, or leave its velocities out"
        )


def _lateness(
    r_n: FloatArray, by_v: FloatArray, change: FloatArray, dt: FloatArray, unbroken: BoolArray, delay: float
) -> list[str]:
    """A sentence if velocities are later or earlier than the configuration says."""
    e = ((r_n - by_v) / dt[:, None])[unbroken, :2]
    a = (change / dt[:, None])[unbroken, :2]
    size = np.linalg.norm(e, axis=1)
    keep = size <= 5.0 * np.median(size) + 1e-9  # without jumps, which do not depend on clocks
    e, a = e[keep], a[keep]
    power = float(np.sum(a * a))
    if len(e) < 2 * _PAIRS or power <= 0.0:
        return []
    tau = float(np.sum(e * a)) / power
    error = float(np.sqrt(np.sum((e - tau * a) ** 2) / (2 * len(e)) / power))
    if abs(tau - delay) < max(6.0 * error, 0.01):
        return []
    return [
        f"GNSS velocities seem to be {tau:.3f} s late against their positions (+-{error:.3f} s), and "
        f"gnss.velocity_delay_s is {delay:g}"
    ]


def enlargement(note: str) -> float:
    """Factor on 1-sigma values that a note beginning with :data:`LARGER` states."""
    return float(note.partition("up to ")[2].partition(" ")[0])


def rejections(
    kind: IntArray,
    status: IntArray,
    t: FloatArray,
    R: FloatArray,
    noise_factors: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> list[str]:
    """Sentences on fixes that were turned away or let in against the gate, and on noise that grew, after a run.

    Parameters
    ----------
    kind, status : ndarray of int, shape (m,)
    t : ndarray, shape (m,)
        [s]
    R : ndarray, shape (m, 3, 3)
    noise_factors : tuple of float
        Of :class:`~schuler.filtering.engine.ForwardRun`.
    """
    sentences = []
    names = ("noise of the IMU is", "1-sigma of GNSS positions is", "1-sigma of GNSS velocities is")
    entries = ("[imu]", "gnss.sigma_scale, floors", "gnss.sigma_scale, floors")
    for name, factor, entry in zip(names, noise_factors, entries, strict=True):
        if factor > 1.0:
            sentences.append(
                f"{LARGER} {name} larger than stated: it was taken up to {factor**0.5:.2g} times as "
                f"large ({entry}; filter.adaptive)"
            )
    for code in (POSITION, VELOCITY):
        mine = kind == code
        out, forced = mine & (status == REJECTED), mine & (status == FORCED)
        if not mine.any() or (out.sum() < 0.05 * mine.sum() and not forced.any()):
            continue
        sigma = float(np.sqrt(np.median(np.einsum("nii->ni", R[out | forced]))))
        first = t[out | forced][0]
        unit = "m" if code == POSITION else "m/s"
        sentences.append(
            f"{int(out.sum())} of {int(mine.sum())} GNSS {KINDS[code]} fixes were rejected, the first at {first:.3f} s"
            + (
                f", and {int(forced.sum())} readmitted with an enlarged covariance (filter.hold_s)"
                if forced.any()
                else ""
            )
            + f"; they claim {sigma:.3g} {unit}: they are wrong, or that is too good (gnss.sigma_scale, floors), or "
            "the IMU is worse than configured, or the clocks differ (gnss.delay_sigma_s)"
        )
    return sentences
