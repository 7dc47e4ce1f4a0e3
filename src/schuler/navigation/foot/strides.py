"""Strides: motions of the foot between two rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.standstill.intervals import Rests, rests_from_mask

_FEW = 6.0  # strides; fewer prove nothing
_LEAST_SHARE = 0.6  # of the repetitions of the motion: 0.63 or more on all walks that came out well, 0.47 where not
# velocity left at a stance: 0.6 of the speed at most on walks and runs that came out well, 1.4 where gyros were clipped
_MOST_OF_SPEED = 0.8
# and at the first three: as that of later ones where the start was at rest, nine times where it was not
_FIRST, _MOST_OF_USUAL = 3, 5.0
_LEAST_RESIDUAL_M_S = 0.5  # less is a shuffle's
_LONGEST_M, _HIGHEST_M = 3.0, 0.6  # a sprinter's stride; a knee


@dataclass(frozen=True)
class Strides:
    """Strides of one foot, from the middle of a rest to the middle of the next.

    Attributes
    ----------
    start, stop : ndarray, shape (k,)
        Middle of the rest before and after. [s]
    index : ndarray of int, shape (k, 2)
        Samples of these two times.
    lift, contact : ndarray, shape (k,)
        When the foot leaves the rest before and when it comes to the one after. [s]
    displacement_n : ndarray, shape (k, 3)
        North, east, down. [m]
    length : ndarray, shape (k,)
        Horizontal. [m]
    clearance : ndarray, shape (k,)
        Greatest height of the IMU above the straight line between the two rests. [m]
    turn : ndarray, shape (k,)
        Change of heading. [rad]
    walking : ndarray of bool, shape (k,)
        Long enough to be a stride; the others are shuffles.
    """

    start: FloatArray
    stop: FloatArray
    index: IntArray
    lift: FloatArray
    contact: FloatArray
    displacement_n: FloatArray
    length: FloatArray
    clearance: FloatArray
    turn: FloatArray
    walking: BoolArray

    def __len__(self) -> int:
        return len(self.start)

    @property
    def duration(self) -> FloatArray:
        """From the middle of one rest to the middle of the next. Shape (k,). [s]"""
        return self.stop - self.start

    @property
    def swing(self) -> FloatArray:
        """Time between the two rests. Shape (k,). [s]"""
        return self.contact - self.lift

    @property
    def speed(self) -> FloatArray:
        """Length over duration. Shape (k,). [m/s]"""
        return self.length / self.duration

    @property
    def frequency(self) -> FloatArray:
        """Strides in a second; the cadence in steps a minute is 120 times this. Shape (k,). [Hz]"""
        return 1.0 / self.duration

    @property
    def distance(self) -> float:
        """Sum of the lengths. [m]"""
        return float(self.length.sum())

    def doubts(self, expected: float | None, residual: ArrayLike = ()) -> list[str]:
        """Sentences on strides that no gait has, the likeliest cause first; empty where there is nothing to doubt.

        Parameters
        ----------
        expected : float, optional
            Strides that the repetitions of the motion count, however many stances were found.
        residual : array_like, shape (m,)
            Speed that the filter has left at the first zero velocity of each stance: the error of a swing. [m/s]
        """
        w = self.walking
        sentences = []
        if expected is not None and expected >= _FEW and w.sum() < _LEAST_SHARE * expected:
            sentences.append(
                f"{int(w.sum())} strides were found where the motion repeats about {expected:.0f} times: stances are "
                "missed, and the errors are larger than claimed; try another detector.kind, a larger detector.ratio or "
                "detector.stillest"
            )
        sentences += residual_doubts(np.asarray(residual, dtype=np.float64), self.speed[w])
        for name, values, limit, unit in (
            ("length", self.length, _LONGEST_M, "m"),
            ("clearance", self.clearance, _HIGHEST_M, "m"),
        ):
            if w.any() and float(np.median(values[w])) > limit:
                sentences.append(
                    f"the strides have a median {name} of {np.median(values[w]):.2f} {unit}, more than a foot's "
                    f"{limit:g} {unit}: stances are missed, or units or axes are wrong"
                )
        return sentences

    def summary(self) -> str:
        """The strides in one line."""
        w = self.walking
        if not w.any():
            return f"no stride ({len(self)} shorter motions of the foot)"
        # medians, because stops in between have long durations
        return (
            f"{int(w.sum())} strides ({int((~w).sum())} shorter motions), {self.distance:.2f} m in all; median length "
            f"{np.median(self.length[w]):.2f} m, duration {np.median(self.duration[w]):.2f} s, speed "
            f"{np.median(self.speed[w]):.2f} m/s, cadence {120.0 * np.median(self.frequency[w]):.0f} steps/min, "
            f"clearance {np.median(self.clearance[w]):.3f} m"
        )


def residual_doubts(residual: FloatArray, speed: FloatArray) -> list[str]:
    """Sentences on swings that end with a velocity which no error of a sensor makes in a stride.

    Parameters
    ----------
    residual : ndarray, shape (m,)
        Speed left at the first zero velocity of each stance, those after the start first. [m/s]
    speed : ndarray, shape (k,)
        Of the strides. [m/s]
    """
    if len(residual) < _FEW or not len(speed):
        return []
    rms, usual = float(np.sqrt(np.mean(residual**2))), float(np.median(residual[_FIRST:]))
    sentences = []
    if rms > max(_LEAST_RESIDUAL_M_S, _MOST_OF_SPEED * float(np.median(speed))):
        sentences.append(
            f"the foot comes to rest with {rms:.1f} m/s left where it strides at {np.median(speed):.1f} m/s: stances "
            "are missed, or sensors were clipped, and the errors are larger than claimed; compare the largest readings "
            "with the ranges of the sensors"
        )
    elif (first := float(residual[:_FIRST].max())) > max(_LEAST_RESIDUAL_M_S, _MOST_OF_USUAL * usual):
        sentences.append(
            f"the first strides end with {first:.1f} m/s left and the later ones with {usual:.2g} m/s: the foot moved "
            "where the attitude was taken, and the errors are larger than claimed; begin where it stands still"
        )
    return sentences


def segment(
    rests: Rests,
    position_n: ArrayLike,
    heading: ArrayLike,
    *,
    min_rest_s: float = 0.05,
    min_motion_s: float = 0.1,
    min_length_m: float = 0.1,
) -> Strides:
    """Cut a walk into strides.

    Parameters
    ----------
    rests : Rests
        Rests of the foot.
    position_n : array_like, shape (n, 3)
        North, east, down at the samples of the rests. [m]
    heading : array_like, shape (n,)
        Heading of the IMU at the same samples. [rad]
    min_rest_s : float
        Shorter rests do not end a stride. [s]
    min_motion_s : float
        Motions not longer than this do not divide a rest. [s]
    min_length_m : float
        Shorter strides are marked as not walking. [m]

    Returns
    -------
    Strides

    Raises
    ------
    InputError
        If the arrays do not fit the rests.
    """
    n = len(rests.t)
    position, heading = as_floats(position_n, "position_n", (n, 3)), as_floats(heading, "heading", (n,))
    if not (min_rest_s >= 0.0 and min_motion_s >= 0.0 and min_length_m >= 0.0):
        raise InputError(f"expected limits of at least 0, got {min_rest_s}, {min_motion_s}, {min_length_m}")
    kept = rests_from_mask(rests.t, rests.mask, min_rest_s=min_rest_s, bridge_s=min_motion_s)
    middle, t = kept.middle, kept.t
    index = np.stack((middle[:-1], middle[1:]), axis=1) if len(kept) else np.empty((0, 2), dtype=np.int64)
    displacement = position[index[:, 1]] - position[index[:, 0]]
    length = np.hypot(displacement[:, 0], displacement[:, 1])
    clearance = np.array([_clearance(position[a : b + 1]) for a, b in index]).reshape(-1)
    turned = heading[index[:, 1]] - heading[index[:, 0]]
    return Strides(
        start=t[index[:, 0]], stop=t[index[:, 1]], index=index, lift=kept.stop[:-1], contact=kept.start[1:],
        displacement_n=displacement, length=length, clearance=clearance,
        turn=np.arctan2(np.sin(turned), np.cos(turned)), walking=length >= min_length_m,
    )  # fmt: skip


def _clearance(r: FloatArray) -> float:
    """Greatest height above the straight line from the first to the last position. Shape (n, 3). [m]"""
    along = r[-1] - r[0]
    length_squared = float(along[:2] @ along[:2])
    share = np.clip((r - r[0])[:, :2] @ along[:2] / length_squared, 0.0, 1.0) if length_squared > 1e-6 else 0.0
    return float((r[0, 2] + share * along[2] - r[:, 2]).max())
