"""Rotation routines for calibration by hand, and a routine as a motion in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.simulation.motion import MotionState, check_span
from schuler.simulation.profiles import blend
from schuler.simulation.steps import ZERO, Rest, Routine, Step, Turn, Vector, check_duration
from schuler.units import DEG

# --------------------------------------------------------------------------------------------------- routines


def thesis_routine(
    *, dwell_s: float = 10.0, turn_s: float = 1.25, step: float = 45.0 * DEG, repeats: int = 2
) -> Routine:
    """The routine of Yaman's calibration: each axis turned once through a circle while it is horizontal, and again.

    Parameters
    ----------
    dwell_s : float
        Rest before each turn. [s]
    turn_s : float
        Time for a turn by ``step``. [s]
    step : float
        A whole number of them makes a circle. [rad]
    repeats : int
        Sets of three axes.

    Returns
    -------
    Routine
        With the defaults 8 turns of 45 deg at 36 deg/s an axis, 90 s an axis, 270 s a set, 540 s in all; x, y, z in
        this order, level and at rest at both ends.

    Raises
    ------
    InputError
        If the steps make no circle, or the rests are too short to take the nose up and down again in between.

    Notes
    -----
    z is turned with the nose up. The two turns that takes come out of the rests of this axis, so that it lasts as long
    as the others: n turns have n + 1 rests of ``d`` between them and one of ``d / 2`` at each end, level, with
    ``(n + 2) d = n dwell_s - 2 (time for 90 deg)``; 7.5 s and 3.75 s with the defaults.

    References
    ----------
    Yaman (2017), chapter 5 and Figs. 5.2, 6.6: axes, 45 deg poses and 270 s a set. The times of rests and turns are not
    given there; these reproduce its convergence.
    """
    return _by_axes(dwell_s, turn_s, step, repeats)


def six_face_routine(*, dwell_s: float = 10.0, turn_s: float = 2.5, repeats: int = 1) -> Routine:
    """Quarter turns about each horizontal axis in turn: every face down at least twice, two and a half minutes.

    Poses with a face down tell bias and scale of the accelerometers by the magnitude of gravity, but not their
    misalignment, which then comes from the turns between them alone, together with that of the gyroscopes. Better than
    nothing for people in a hurry; :func:`thesis_routine` with ``repeats=1`` is the next better.

    Parameters
    ----------
    dwell_s, turn_s : float
        Rest before each turn, and time for a quarter turn. [s]
    repeats : int

    Returns
    -------
    Routine
    """
    return _by_axes(dwell_s, turn_s, 90.0 * DEG, repeats)


def _by_axes(dwell_s: float, turn_s: float, step: float, repeats: int) -> Routine:
    check_duration(dwell_s, "dwell_s: a rest")
    check_duration(turn_s, "turn_s: a turn")
    n = round(2.0 * np.pi / step) if step > 0.0 else 0
    if n < 3 or abs(n * step - 2.0 * np.pi) > 1e-6:
        raise InputError(f"step: expected a circle divided by 3 or more, got {step / DEG:.6g} deg")
    if repeats < 1:
        raise InputError(f"repeats: expected 1 or more, got {repeats}")
    up_s = turn_s * 90.0 * DEG / step
    d = (n * dwell_s - 2.0 * up_s) / (n + 2)
    if not d > 0.0:
        raise InputError(
            f"dwell_s: {n} rests of {dwell_s:g} s leave no time to take the nose up and down in {2.0 * up_s:g} s; "
            "choose longer rests or faster turns"
        )
    steps: list[Step] = []
    for axis in ("x", "y"):
        for _ in range(n):
            steps += [Rest(dwell_s), Turn(axis, step, turn_s)]
    steps += [Rest(0.5 * d), Turn("y", 90.0 * DEG, up_s)]
    for _ in range(n):
        steps += [Rest(d), Turn("z", step, turn_s)]
    steps += [Rest(d), Turn("y", -90.0 * DEG, up_s), Rest(0.5 * d)]
    return Routine(tuple(steps) * repeats)


def free_routine(
    rng: np.random.Generator,
    *,
    poses: int = 24,
    dwell_s: tuple[float, float] = (4.0, 8.0),
    first_s: float = 15.0,
    rate: tuple[float, float] = (0.5, 2.0),
    uneven: float = 0.6,
    wobble: float = 0.1,
    hand_m: float = 0.0,
) -> Routine:
    """Any poses in any order, as a hand would find them.

    Parameters
    ----------
    rng : numpy.random.Generator
    poses : int
        Rests, the first one level included; their attitudes are uniformly random.
    dwell_s : (float, float)
        Shortest and longest rest after the first. [s]
    first_s : float
        The first rest. [s]
    rate : (float, float)
        Slowest and fastest mean rate of a turn. [rad/s]
    uneven : float
        Largest skew of the turns, in [0, 1).
    wobble : float
        Largest wobble of the turns. [rad]
    hand_m : float
        The hand moves between places within this distance of the first; zero turns in place. [m]

    Returns
    -------
    Routine
        From one rest to the next there are one or two turns, about any axes.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    if poses < 2:
        raise InputError(f"poses: expected 2 or more, got {poses}")
    for name, (low, high) in (("dwell_s", dwell_s), ("rate", rate)):
        if not 0.0 < low <= high:
            raise InputError(f"{name}: expected two positive numbers, the smaller one first, got {low}, {high}")
    if not (0.0 <= uneven < 1.0 and wobble >= 0.0 and hand_m >= 0.0):
        raise InputError(f"expected 0 <= uneven < 1, wobble >= 0, hand_m >= 0, got {uneven}, {wobble}, {hand_m}")
    steps: list[Step] = [Rest(first_s)]
    C, place = np.eye(3), np.zeros(3)
    for _ in range(poses - 1):
        for _ in range(int(rng.integers(1, 3))):
            q = rng.standard_normal(4)
            to = rotation.dcm_from_quat(q / np.linalg.norm(q))
            turn = rotation.rotvec_from_dcm(C.T @ to)
            angle = float(np.linalg.norm(turn))
            next_place = rng.standard_normal(3)
            next_place *= hand_m * rng.random() ** (1.0 / 3.0) / np.linalg.norm(next_place)
            steps.append(
                Turn(
                    tuple((turn / angle).tolist()), angle, max(0.3, angle / rng.uniform(*rate)),
                    float(rng.uniform(0.2, 0.5)), float(rng.uniform(-uneven, uneven)),
                    float(rng.uniform(-wobble, wobble)), tuple((next_place - place).tolist()),
                )
            )  # fmt: skip
            C, place = to, next_place
        steps.append(Rest(float(rng.uniform(*dwell_s))))
    return Routine(tuple(steps))


# ----------------------------------------------------------------------------------------------------- motion


@dataclass(frozen=True, repr=False)
class RoutineMotion(Abridged):
    """A routine carried out at a place, in closed form; see :class:`schuler.simulation.motion.Motion`.

    Angular rate and acceleration are continuous and are the exact derivatives of attitude and rate; position, velocity
    and acceleration likewise.

    Attributes
    ----------
    routine : Routine
    llh : ndarray, shape (3,)
        Where the hand is at the start: latitude, longitude [rad], ellipsoidal height [m].
    lever_m : (float, float, float)
        From the point about which the hand turns to the IMU, body axes: the IMU then feels centripetal and tangential
        acceleration. [m]
    """

    routine: Routine
    llh: FloatArray
    lever_m: Vector = ZERO

    def __post_init__(self) -> None:
        object.__setattr__(self, "llh", as_vector3(self.llh, "RoutineMotion.llh"))
        object.__setattr__(self, "lever_m", tuple(as_vector3(self.lever_m, "RoutineMotion.lever_m").tolist()))

    @property
    def duration(self) -> float:
        """[s]"""
        return self.routine.duration

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        steps = self.routine.steps
        k = np.clip(np.searchsorted(self.routine.limits, t, side="right") - 1, 0, len(steps) - 1)
        # a rest is a turn by nothing
        turns = [step if isinstance(step, Turn) else Turn("x", 0.0, step.duration_s) for step in steps]
        T = np.array([turn.duration_s for turn in turns])[k]
        angle, wobble = (np.array([getattr(turn, name) for turn in turns])[k] for name in ("angle", "wobble"))
        u, shift = np.array([turn.unit for turn in turns]), np.array([turn.shift_m for turn in turns])
        p = _square_to(u)[k]
        place = np.concatenate((np.zeros((1, 3)), np.cumsum(shift, axis=0)))[k]
        u, shift = u[k], shift[k]
        x = np.clip((t - self.routine.limits[k]) / T, 0.0, 1.0)
        s, s1, s2 = _share(x, *(np.array([getattr(turn, name) for turn in turns])[k] for name in ("ramp", "skew")))
        s1, s2 = s1 / T, s2 / T**2
        b = 64.0 * (x * (1.0 - x)) ** 3
        b1 = 192.0 * (x * (1.0 - x)) ** 2 * (1.0 - 2.0 * x) / T
        b2 = 384.0 * x * (1.0 - x) * (1.0 - 5.0 * x + 5.0 * x**2) / T**2

        def scaled(a: FloatArray, v: FloatArray) -> FloatArray:
            return np.asarray(a[:, None] * v)

        # C = C_0 exp(s angle u) exp(b wobble p)
        Q = rotation.dcm_from_rotvec(scaled(b * wobble, p))
        C = self.routine.attitudes[k] @ rotation.dcm_from_rotvec(scaled(s * angle, u)) @ Q
        u_b = np.einsum("nji,nj->ni", Q, u)
        omega = scaled(s1 * angle, u_b) + scaled(b1 * wobble, p)
        alpha = (
            scaled(s2 * angle, u_b) + scaled(b2 * wobble, p) - scaled(s1 * angle * b1 * wobble, np.cross(p, u_b))
        )  # p does not turn with Q, u does
        lever = np.array(self.lever_m)
        arm = np.cross(omega, lever)
        r = place + scaled(s, shift) + C @ lever
        v = scaled(s1, shift) + np.einsum("nij,nj->ni", C, arm)
        a = scaled(s2, shift) + np.einsum("nij,nj->ni", C, np.cross(alpha, lever) + np.cross(omega, arm))
        C_en = frames.C_en(self.llh)
        return MotionState(t, frames.ecef_from_ned(r, self.llh), v @ C_en.T, a @ C_en.T, C_en @ C, omega)


def _share(x: FloatArray, ramp: FloatArray, skew: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Share of a turn that is done at the share x of its time, and two derivatives with x.

    The rate rises along the smooth step of :func:`schuler.simulation.profiles.blend`, stays, and falls; skew lets
    the time w = x + c x (1 - x) pass in its place.
    """
    w, w1, w2 = x + skew * x * (1.0 - x), 1.0 + skew * (1.0 - 2.0 * x), -2.0 * skew
    second = w > 0.5
    y = np.where(second, 1.0 - w, w)  # the second half is the first one backwards
    i, h, h1, _ = blend(np.minimum(y / ramp, 1.0))
    s = np.where(y < ramp, ramp * i, y - 0.5 * ramp) / (1.0 - ramp)
    s1, s2 = h / (1.0 - ramp), np.where(second, -h1, h1) / (ramp * (1.0 - ramp))
    return np.where(second, 1.0 - s, s), s1 * w1, s2 * w1**2 + s1 * w2


def _square_to(u: FloatArray) -> FloatArray:
    """A unit vector square to each of the given ones. Shapes (n, 3)."""
    other = np.cross(u, np.eye(3)[np.argmin(np.abs(u), axis=1)])
    return np.asarray(other / np.linalg.norm(other, axis=1, keepdims=True))
