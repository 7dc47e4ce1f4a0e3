"""Unit of the angular rate: from turns of gravity between rests, and from turns of the course."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.diagnosis.axes import changes, signed_permutations
from schuler.diagnosis.result import Finding
from schuler.recording.io.checks import largest, norms
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import UnscaledRests, unscaled_rests

UNITS = {
    "rad/s": 1.0,
    "deg/s": units.DEG,
    "mrad/s": 1e-3,
    "mdeg/s": 1e-3 * units.DEG,
    "deg/h": units.DEG_PER_HR,
    "rev/min": 2.0 * np.pi / units.MIN,
    "rev/s": 2.0 * np.pi,
}
_NEAR = 0.12
_MOST_TURNS = 40
_LONGEST_S = 40.0
_STEP_S = 0.02
_LEAST_TURN = 10.0 * units.DEG
#: Counts in a deg/s of gyroscopes with 16 bits over 250, 500, 1000 and 2000 deg/s.
COUNTS_PER_DEG_S = (131.0, 65.5, 32.8, 16.4)
_WIDEST = 4500.0 * units.DEG  # range that MEMS gyroscopes have, and a little
_LARGEST_BIAS = 40.0 * units.DEG  # at rest
_VERTICAL = np.cos(25.0 * units.DEG)  # a rate this near to the vertical may be a turn about it
_FASTEST_HZ = 4000.0
_LARGEST_COUNT = 2.0**15
_LEAST_LARGE = 30  # counts: smaller whole numbers may be any unit, rounded
_BLOCK_S = 0.1
_LEAST_BLOCKS, _LEAST_CORRELATION, _FACTOR = 60, 0.3, 4.0
_FOR_AXES = 3  # turns that tell axes: one or two are explained by several


@dataclass(frozen=True)
class Turns:
    """Turns between neighbouring rests, as gyro increments of equal length and gravity before and after.

    Attributes
    ----------
    dtheta : ndarray, shape (steps, m, 3)
        Bias removed, zeros after the end. [gyro unit * s]
    before, after : ndarray, shape (m, 3)
        Unit specific force.
    """

    dtheta: FloatArray
    before: FloatArray
    after: FloatArray

    def __len__(self) -> int:
        return len(self.before)

    @property
    def angle(self) -> FloatArray:
        """Angle by which gravity turned. [rad]"""
        return np.asarray(np.arccos(np.clip(np.sum(self.before * self.after, axis=1), -1.0, 1.0)))


def turns_between(imu: ImuSeries, rests: UnscaledRests) -> Turns | None:
    """Turns of more than 10 degrees of gravity between rests; None if there is none. ``imu`` holds rates."""
    if len(rests) < 2:
        return None
    unit = rests.accel / np.linalg.norm(rests.accel, axis=1, keepdims=True)
    chosen = []
    for k in range(len(rests) - 1):
        length = rests.t[k + 1, 0] - rests.t[k, 1]
        turned = np.arccos(np.clip(unit[k] @ unit[k + 1], -1.0, 1.0))
        if length <= _LONGEST_S and turned >= _LEAST_TURN:
            chosen.append(k)
    if not chosen:
        return None
    chosen = chosen[:: max(1, -(-len(chosen) // _MOST_TURNS))]
    dt = np.diff(imu.t)
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * (imu.gyro[1:] + imu.gyro[:-1]) * dt[:, None], axis=0)))
    steps = 0
    pieces = []
    step = max(_STEP_S, imu.interval)
    for k in chosen:
        # from within one rest to within the next, so that the edges do not matter
        a, b = imu.t[max(rests.last[k] - 2, 0)] - 0.3, imu.t[rests.first[k + 1]] + 0.3
        edges = np.arange(a, b + step, step)
        s = np.stack([np.interp(edges, imu.t, sums[:, i]) for i in range(3)], axis=1)
        bias = 0.5 * (rests.gyro[k] + rests.gyro[k + 1])
        pieces.append(np.diff(s, axis=0) - bias * step)
        steps = max(steps, len(edges) - 1)
    dtheta = np.zeros((steps, len(chosen), 3))
    for j, piece in enumerate(pieces):
        dtheta[: len(piece), j] = piece
    return Turns(dtheta, unit[chosen], unit[np.array(chosen) + 1])


def misfit(turns: Turns, maps: FloatArray) -> FloatArray:
    """Median angle between gravity after a turn as seen and as the gyro says, for each map of the gyro.

    Parameters
    ----------
    turns : Turns
    maps : ndarray, shape (h, 3, 3)
        Gyro in the accelerometer's axes, rad/s: ``w = maps @ gyro``.

    Returns
    -------
    ndarray, shape (h,)
        [rad]
    """
    h, m = len(maps), len(turns)
    q = np.zeros((h, m, 4))
    q[..., 0] = 1.0
    for d in turns.dtheta:
        turn = np.einsum("hij,mj->hmi", maps, d)
        q = rotation.quat_multiply(q, rotation.quat_from_rotvec(turn))
    # v_after = C_ab^T v_before
    predicted = rotation.rotate(rotation.quat_conjugate(q), np.broadcast_to(turns.before, (h, m, 3)))
    cosine = np.clip(np.sum(predicted * turns.after, axis=2), -1.0, 1.0)
    return np.asarray(np.median(np.arccos(cosine), axis=1))


def are_counts(gyro: FloatArray, *, beside_counts: bool = False) -> bool:
    """Whether readings are whole numbers of 16 bits and not all of them small.

    Parameters
    ----------
    gyro : ndarray, shape (n, 3)
        As written.
    beside_counts : bool
        The accelerometer's readings are counts: small ones are then, too, as of a gyroscope at rest.
    """
    if not (1 if beside_counts else _LEAST_LARGE) <= largest(gyro) <= _LARGEST_COUNT:
        return False
    whole = np.round(gyro)
    return bool(np.all(np.abs(gyro - whole) <= 1e-9 * np.abs(whole)))


def possible_units(imu: ImuSeries) -> tuple[list[str], str]:
    """Units that angular rates of a log can have by their size alone, where no turn between rests tells one.

    Parameters
    ----------
    imu : ImuSeries
        Rates; the gyroscopes' as they are written, specific force in any unit.

    Returns
    -------
    left : list of str
        ``"deg/s"`` and ``"rad/s"`` as far as they are possible; ``"mdeg/s"`` where they are not.
    why : str
        What excludes the others, or, of several, what each would mean; empty where nothing is to be said.

    Notes
    -----
    A unit is out of the question where the largest rates are beyond the range of any MEMS gyroscope, or the mean at
    rest beyond any bias (but for one about the vertical, which may be a table that turns). Of what is left, motion in
    which gravity turns in the sensor's axes (on a shoe, in a hand) changes the specific force by ``f x omega`` times a
    factor near one of either sign, for the sensor swings too: on shoes 0.4 to 1.5 in magnitude, where the next unit is
    57 times away. On vehicles the two are hardly correlated.
    """
    top = float(np.quantile(norms(imu.gyro), 0.999, overwrite_input=True))
    rests = unscaled_rests(imu)
    still = _bias_at_rest(rests)
    left = [u for u in ("deg/s", "rad/s", "mdeg/s") if top * UNITS[u] < _WIDEST and still * UNITS[u] < _LARGEST_BIAS]
    usual = [u for u in left if u != "mdeg/s"]
    if len(usual) < 2:
        at = (still, "at rest") if still * _WIDEST > top * _LARGEST_BIAS else (top, "at most")
        words = [f"as {u} they are {at[0] * UNITS[u] / units.DEG:.3g} deg/s {at[1]}" for u in ("rad/s", "deg/s")]
        excluded = ", ".join(words[: 2 - len(usual)])
        return usual or left[:1], f"{excluded}, more than gyroscopes have"
    ratio = _swing(imu)
    fits = [u for u in usual if ratio is not None and 1.0 / _FACTOR < ratio / UNITS[u] < _FACTOR]
    if len(fits) == 1:
        return fits, "specific force changes as it does where gravity turns with the sensor"
    if still == 0.0:
        return usual, ""
    words = [f"as {u} they are {still * UNITS[u] / units.DEG:.2g} deg/s at rest" for u in usual]
    return usual, ", ".join(words)


def _bias_at_rest(rests: UnscaledRests) -> float:
    """Norm of the mean rate at rest; zero where there is none, or it may be that of a table that turns all the time.

    Specific force stays constant in a turn only about the vertical, so a rate across it is a bias.
    """
    if not len(rests):
        return 0.0
    along = np.abs(np.sum(rests.gyro * rests.accel, axis=1))
    sizes = np.linalg.norm(rests.gyro, axis=1) * np.linalg.norm(rests.accel, axis=1)
    if np.all(along > _VERTICAL * sizes):
        return 0.0
    return float(np.linalg.norm(np.median(rests.gyro, axis=0)))


def _swing(imu: ImuSeries) -> float | None:
    """Factor between changes of specific force and ``f x omega``, by magnitude; None where they are not correlated."""
    per = max(1, round(_BLOCK_S / imu.interval))
    m = len(imu.t) // per
    if m < _LEAST_BLOCKS:
        return None
    t, f, w = (x[: m * per].reshape(m, per, -1).mean(axis=1) for x in (imu.t, imu.accel, imu.gyro))
    w = w - np.median(w, axis=0)
    rate = (f[2:] - f[:-2]) / (t[2:] - t[:-2])
    turn = np.cross(f[1:-1], 0.25 * (w[:-2] + 2.0 * w[1:-1] + w[2:]))
    product, squares = float(np.sum(rate * turn)), float(np.sum(turn**2))
    if abs(product) < _LEAST_CORRELATION * np.sqrt(squares * float(np.sum(rate**2))) or squares == 0.0:
        return None
    return abs(product) / squares


def halves_agree(turns: Turns, map_: FloatArray) -> bool:
    """Whether of six turns or more every second one, and the others, are each explained far better than as read.

    Parameters
    ----------
    turns : Turns
    map_ : ndarray, shape (3, 3)
        Gyro in the accelerometer's axes, rad/s.
    """
    if len(turns) < 6:
        return False
    for k in (slice(0, None, 2), slice(1, None, 2)):
        part = Turns(turns.dtheta[:, k], turns.before[k], turns.after[k])
        as_read, mended = misfit(part, np.stack((np.eye(3), map_)))
        if not mended < 0.3 * as_read:
            return False
    return True


def _candidates(interval: float, counts: bool) -> list[tuple[str, str, float, float]]:
    """Unit, kind ("rate" or "increment"), factor to rad/s, cost of the guess; of whole numbers also counts."""
    out = [(f"counts, {lsb:g} in a deg/s", "rate", units.DEG / lsb, 0.0) for lsb in COUNTS_PER_DEG_S if counts]
    for name, value in UNITS.items():
        usual = 0.0 if name in ("rad/s", "deg/s") else 0.4
        out.append((name, "rate", value, usual))
    out += [("rad", "increment", 1.0 / interval, 0.3), ("deg", "increment", units.DEG / interval, 0.5)]
    return out


def by_turns(
    turns: Turns, interval: float, stated: tuple[str, float], counts: bool = False
) -> tuple[float | None, FloatArray, dict[str, Any]]:
    """Factor that makes the gyro SI and the signed permutation that fits the accelerometer, from turns of gravity.

    Parameters
    ----------
    turns : Turns
    interval : float
        [s]
    stated : (str, float)
    counts : bool
        Whether the log holds whole numbers, which may be counts.

    Returns
    -------
    factor : float or None
        None if nothing fits.
    P : ndarray, shape (3, 3)
        Gyro as read to the accelerometer's axes; the unit matrix unless another one is far better.
    evidence : dict
    """
    factors = [1.0] + [value / stated[1] for _, _, value, _ in _candidates(interval, counts)]
    factors = list(dict.fromkeys(round(f, 12) for f in factors))
    perms = signed_permutations()
    typical = float(np.median(turns.angle))
    evidence: dict[str, Any] = {
        "turns": len(turns),
        "turn_deg": typical / units.DEG,
    }
    good = max(0.12 * typical, 4.0 * units.DEG)
    # rates so large that they turn many times fit anything by chance
    total_angle = float(np.median(np.linalg.norm(turns.dtheta, axis=2).sum(axis=0)))
    factors = [f for f in factors if f == 1.0 or 0.7 * typical < f * total_angle < 3.0 * typical + np.pi]
    one = np.array([f * np.eye(3) for f in factors])
    angle = misfit(turns, one)
    best = int(np.argmin(angle))
    evidence |= {"misfit_deg": float(angle[best]) / units.DEG, "misfit_as_read_deg": float(angle[0]) / units.DEG}
    if angle[0] < good and angle[0] < 2.0 * angle[best] + 1.0 * units.DEG:
        return 1.0, np.eye(3), evidence
    if angle[best] < good:
        return factors[best], np.eye(3), evidence
    # no unit alone: other axes, in the units that are not out of the question
    for f in factors[:3] if len(turns) >= _FOR_AXES else ():
        many = misfit(turns, f * perms)
        k = int(np.argmin(many))
        if many[k] < good and many[k] < 0.5 * angle[best]:
            evidence["misfit_deg"] = float(many[k]) / units.DEG
            return f, perms[k], evidence
    # a scale of its own: the angles themselves
    fine = np.geomspace(1e-6, 1e3, 181)
    fine = fine[(fine * total_angle > 0.7 * typical) & (fine * total_angle < 3.0 * typical + np.pi)]
    if not len(fine):
        return None, np.eye(3), evidence
    wide = misfit(turns, fine[:, None, None] * np.eye(3))
    k = int(np.argmin(wide))
    near = fine[k] * np.geomspace(0.9, 1.12, 23)
    close = misfit(turns, near[:, None, None] * np.eye(3))
    j = int(np.argmin(close))
    if close[j] < good:
        evidence["misfit_deg"] = float(close[j]) / units.DEG
        return float(near[j]), np.eye(3), evidence
    return None, np.eye(3), evidence


def gyro_unit(
    need: float,
    interval: float,
    stated: tuple[str, float],
    kind: str,
    evidence: dict[str, Any],
    how: str,
    exact: float | None = None,
    counts: bool = False,
) -> list[Finding]:
    """Finding ``gyro_unit`` for a factor that the physics asks for.

    Parameters
    ----------
    need : float
        Makes the numbers as read rad/s, after what was found about rates and increments.
    interval : float
        [s]
    stated : (str, float)
        Unit stated and its factor.
    kind : {"rate", "increment"}
        What the log holds.
    evidence : dict
    how : str
        For the sentence: what it was compared with.
    exact : float, optional
        The factor where it is no unit's but has to be a number.
    counts : bool
        Whether the log holds whole numbers, which may be counts.
    """
    if abs(np.log(need)) < 0.22:
        return []
    name, factor = stated
    raw = need * factor
    if kind == "increment" and abs(np.log(need / interval)) < _NEAR:
        text = f"{how} the angular rates are 1/interval times too large: the log holds rates, not increments"
        return [Finding("kind", "error", text, 0.99, "kind='rate'", {**evidence, "factor": need})]
    fits = sorted(
        (cost + abs(np.log(raw / value)) / _NEAR, unit, what)
        for unit, what, value, cost in _candidates(interval, counts)
        if abs(np.log(raw / value)) < _NEAR and not (what == "rate" and unit == name)
    )
    evidence = {**evidence, "factor": need, "fits": [f"{u} {w}" for _, u, w in fits]}
    if not fits and abs(np.log(need)) < 0.45:
        return []  # clipped turns, noise, a poor course: no unit
    far = abs(np.log(need)) > 1.5
    if not fits:
        text = (
            f"{how} the angular rates are {1.0 / need:.4g} times what they should be in {name}: the numbers "
            f"are counts or "
            "have a scale of their own"
        )
        return [
            Finding("gyro_unit", "error", text, 0.98 if far else 0.8, f"scale='gyro={exact or need:.5g}'", evidence)
        ]
    _, unit, what = fits[0]
    if what == "increment" and kind == "rate":
        text = (
            f"{how} the gyro's numbers are {1.0 / need:.4g} times too small: they are angle increments in "
            f"{unit}, not rates"
        )
        return [Finding("kind", "error", text, 0.99 if far else 0.8, f"kind='increment', units='...,{unit}'", evidence)]
    text = f"{how} the angular rates are {1.0 / need:.4g} times what they should be: the numbers are {unit}, not {name}"
    confidence = 0.99 if far else 0.8
    if unit not in UNITS:
        number = next(value for u, _, value, _ in _candidates(interval, counts) if u == unit)
        return [Finding("gyro_unit", "error", text, confidence, f"scale='gyro={number / factor:.6g}'", evidence)]
    return [Finding("gyro_unit", "error", text, confidence, f"units='...,{unit}' (or units='gyro={unit}')", evidence)]


def or_of_the_rate(finding: Finding, rate_hz: float, factor: float) -> Finding:
    """The finding of a scale of its own, unsure where samples are counted at a stated rate, which may be what is wrong.

    Parameters
    ----------
    finding : Finding
    rate_hz : float
        At which samples are counted.
    factor : float
        Makes the numbers as written rad/s.

    Returns
    -------
    Finding
        As it was if the numbers are in a unit, or no usual rate explains them.
    """
    if not finding.fix.startswith("scale="):
        return finding
    rates = {name: rate_hz * UNITS[name] / factor for name in ("deg/s", "rad/s")}
    usual = " or ".join(f"{hz:.3g} Hz if they are {name}" for name, hz in rates.items() if 1.0 < hz < _FASTEST_HZ)
    if not usual:
        return finding
    text = f"{finding.text}; or the log, which has no stamps, has another rate than {rate_hz:.4g} Hz: {usual}"
    return replace(finding, text=text, confidence=min(finding.confidence, 0.6))


def gyro_axes(P: FloatArray, evidence: dict[str, Any], *, agreed: bool) -> list[Finding]:
    """Finding on gyro axes that turns of gravity ask for; sure if both halves of the turns ``agreed``."""
    if np.array_equal(P, np.eye(3)):
        return []
    if np.array_equal(P, -np.eye(3)):
        text = (
            "between rests gravity turns the other way than the gyro says: its sign is reversed, or all "
            "axes are left-handed"
        )
        return [Finding("gyro_sign", "error", text, 0.99 if agreed else 0.85, "scale='gyro=-1'", evidence)]
    words = changes(P.T)
    code = "handedness" if np.linalg.det(P) < 0.0 else "gyro_axes"
    text = f"between rests gravity turns as if the gyro's axes were others than the accelerometer's: gyro {words}"
    return [
        Finding(code, "error", text, 0.98 if agreed else 0.8, f"exchange or reverse columns: gyro {words}", evidence)
    ]
