"""Axes, handedness and the sign of gravity: the 48 signed permutations scored against the motion GNSS tells."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.diagnosis.axes_evidence import AxesEvidence
from schuler.diagnosis.result import Finding

_LETTERS = {(0, 1): "F", (0, -1): "B", (1, 1): "R", (1, -1): "L", (2, 1): "D", (2, -1): "U"}
_NAMES = ("x", "y", "z")
_STRENGTH = 8.0  # misfit of an axis pointing at right angles to where it should, for good evidence
SIGNIFICANT = 9.0  # squared ratio of a direction to its 1-sigma, to be worth judging


def signed_permutations() -> FloatArray:
    """All 48: 24 rotations and 24 that also mirror. Shape (48, 3, 3)."""
    out = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            P = np.zeros((3, 3))
            P[np.arange(3), order] = signs
            out.append(P)
    return np.array(out)


@dataclass(frozen=True)
class Guess:
    """One explanation of the axes: accelerometer and gyro as signed permutations of forward, right, down."""

    A: FloatArray
    G: FloatArray
    codes: tuple[str, ...]
    cost: float
    misfit: float = 0.0

    @property
    def total(self) -> float:
        """Misfit and how far-fetched it is."""
        return self.misfit + self.cost


def guesses() -> list[Guess]:
    """Explanations worth trying, the simple ones cheap."""
    one, out = np.eye(3), []
    all48 = signed_permutations()
    proper = [P for P in all48 if np.linalg.det(P) > 0.0]
    mirrored = [P for P in all48 if np.linalg.det(P) < 0.0]
    out.append(Guess(one, one, (), 0.0))
    for P in proper:
        turned = () if np.array_equal(P, one) else ("axes",)
        if turned:
            out.append(Guess(P, P, turned, 1.0))
        extra = 1.0 if turned else 0.0
        out.append(Guess(-P, P, ("gravity_sign", *turned), 1.0 + extra))
        out.append(Guess(P, -P, ("gyro_sign", *turned), 1.0 + extra))
        if turned:
            out.append(Guess(P, one, ("accel_axes",), 1.15))
            out.append(Guess(one, P, ("gyro_axes",), 1.15))
    for P in mirrored:
        simple = np.count_nonzero(one != P) in (1, 4)  # one reversed, or two exchanged
        extra = 0.0 if simple else 0.2
        out.append(Guess(P, P, ("handedness",), 1.05 + extra))
        if not np.array_equal(P, -one):
            out.append(Guess(P, one, ("accel_axes",), 1.1 + extra))
            out.append(Guess(one, P, ("gyro_axes",), 1.1 + extra))
    return out


def judge(ev: AxesEvidence, gyro_factor: float, *, vehicle: bool) -> tuple[Guess, list[Guess]]:
    """The best explanation and its rivals within one unit of cost.

    Parameters
    ----------
    ev : AxesEvidence
    gyro_factor : float
        Makes the gyro's numbers SI.
    forward_known : bool
        Whether the way the body moves is its forward axis (a vehicle); if not, only down is judged.
    """
    best: list[Guess] = []
    e = ev.e / max(float(np.linalg.norm(ev.e)), 1e-12)
    weight_e = _STRENGTH * _trust(float(np.linalg.norm(ev.e)), ev.e_sigma)
    weights = [
        _STRENGTH * _trust(float(np.linalg.norm(ev.B[:, k])), ev.sigma[k]) * (vehicle or k == 2) for k in range(3)
    ]
    tilt = ev.tilt / max(gyro_factor, 1e-12)
    tilt_sigma = ev.tilt_sigma / max(gyro_factor, 1e-12)
    for guess in guesses():
        misfit = 0.0
        for k in range(3):
            b = ev.B[:, k] / max(float(np.linalg.norm(ev.B[:, k])), 1e-12)
            misfit += weights[k] * (1.0 - float(b @ guess.A[:, k]))
        misfit += weight_e * (1.0 - float(e @ guess.G[:, 2]))
        misfit += _tilt_misfit(tilt, tilt_sigma, guess)
        if vehicle:
            misfit += _fit(ev.climb, ev.climb_sigma, guess.G[:, 0])
        best.append(Guess(guess.A, guess.G, guess.codes, guess.cost, misfit))
    best.sort(key=lambda g: g.total)
    rivals = [g for g in best[1:] if g.total < best[0].total + 1.0 and g.codes != best[0].codes]
    return best[0], rivals


def scores(ev: AxesEvidence) -> tuple[list[str], FloatArray]:
    """Mean cosine between the axes measured and those of each of the 48 signed permutations, best first.

    Returns
    -------
    names : list of str
        Directions of x, y, z; mirrored ones end in ``*``.
    cosine : ndarray, shape (48,)
    """
    B = ev.B / np.maximum(np.linalg.norm(ev.B, axis=0), 1e-12)
    perms = signed_permutations()
    cosine = np.einsum("ij,nij->n", B, perms) / 3.0
    order = np.argsort(-cosine)
    names = [letters(perms[k]) + ("*" if np.linalg.det(perms[k]) < 0.0 else "") for k in order]
    return names, cosine[order]


def _tilt_misfit(tilt: FloatArray, sigma: FloatArray, guess: Guess) -> float:
    """Whether rates of tilt fit the level gyro axes of a guess, up to their common unknown attenuation."""
    # l = -f/g, level components in the vehicle's axes: of df/dt = f x w remains dl_F/dt = -w_R, dl_R/dt = w_F, and the
    # gyro reads G w
    return _fit(tilt, sigma, np.stack((-guess.G[:, 1], guess.G[:, 0]), axis=0))


def _fit(measured: FloatArray, sigma: FloatArray, expected: FloatArray) -> float:
    """Misfit of directions seen with some noise beside those expected; none for what is lost in noise."""
    if not np.all(np.isfinite(sigma) & (sigma > 0.0)):
        return 0.0
    z = measured / sigma
    zz = float(np.sum(z**2))
    if zz < SIGNIFICANT:
        return 0.0
    cosine = float(np.sum(z * expected / sigma) / np.sqrt(zz * np.sum((expected / sigma) ** 2)))
    return 6.0 * min(1.0, (zz - SIGNIFICANT) / 60.0) * (1.0 - cosine)


def _trust(size: float, sigma: float) -> float:
    """0 for a column lost in noise, 1 for one ten times above it."""
    ratio = size / max(float(sigma), 1e-12)
    return float(np.clip((ratio - 3.0) / 7.0, 0.0, 1.0))


def letters(A: FloatArray) -> str:
    """Directions of x, y, z of a sensor whose axes are the rows of a signed permutation."""
    out = ""
    for row in A:
        k = int(np.argmax(np.abs(row)))
        out += _LETTERS[(k, 1 if row[k] > 0.0 else -1)]
    return out


def changes(P: FloatArray) -> str:
    """A signed permutation in words."""
    parts = []
    for i, row in enumerate(P):
        k = int(np.argmax(np.abs(row)))
        if k != i or row[k] < 0.0:
            parts.append(f"{_NAMES[i]} shows {'-' if row[k] < 0.0 else ''}{_NAMES[k]}")
    return ", ".join(parts) or "as they should be"


def axes_findings(
    best: Guess, rivals: list[Guess], ev: AxesEvidence, as_read: FloatArray, *, vehicle: bool, agreed: bool
) -> list[Finding]:
    """Sentences on the best explanation.

    Parameters
    ----------
    best : Guess
    rivals : list of Guess
    ev : AxesEvidence
    as_read : ndarray, shape (3, 3)
        What the reader already turned the log's own axes by (hint ``axes``).
    vehicle : bool
        Whether the way the body moves is its forward axis.
    agreed : bool
        Whether either half of the log by itself says the same.
    """
    evidence: dict[str, Any] = {
        "forward_in_sensor": ev.B[:, 0].tolist(),
        "right_in_sensor": ev.B[:, 1].tolist(),
        "down_in_accel": ev.B[:, 2].tolist(),
        "down_in_gyro": ev.e.tolist(),
        "misfit": best.misfit,
    }
    if not best.codes:
        return []
    # both triads turned together: whether the gyro's level axes are, too, may not show; as read they are wrong anyhow
    others = [g for g in rivals if not _half_of(g, best)]
    lead = min((g.total for g in others), default=best.total + 2.0) - best.total
    confidence = float(np.clip(0.6 + 0.35 * lead - 0.03 * best.misfit, 0.4, 0.99 if agreed else 0.6))
    also = ""
    if rivals:
        names = dict.fromkeys(" and ".join(g.codes) or "nothing wrong" for g in rivals)
        also = f"; the evidence allows also: {', '.join(list(names)[:3])}"
        evidence["rivals"] = [list(g.codes) for g in rivals[:5]]
    findings = []
    for code in best.codes:
        text, fix, severity = _sentence(code, best, as_read)
        if code == "axes" and not vehicle:
            also += "; which way is forward is not known, the body does not go where it points"
        findings.append(Finding(code, severity, text + also, confidence, fix, evidence))
    return findings


def _half_of(guess: Guess, best: Guess) -> bool:
    """Whether a guess turns only the accelerometers, as the best one turns all of the sensor."""
    return best.codes == ("axes",) and guess.codes == ("accel_axes",) and np.array_equal(guess.A, best.A)


def _sentence(code: str, best: Guess, as_read: FloatArray) -> tuple[str, str, Any]:
    if code == "gravity_sign":
        text = (
            "at rest the accelerometer shows gravity itself (positive down), and its response to acceleration is "
            "reversed too: the log holds the negative of specific force"
        )
        return text, "scale='accel=-1'", "error"
    if code == "gyro_sign":
        return "the gyroscope turns against the course of the vehicle: its sign is reversed", "scale='gyro=-1'", "error"
    if code == "axes":
        directions = letters(as_read.T @ best.G)
        x, y, z = tuple(directions)
        return (
            f"the sensor's axes point {x}, {y}, {z} (x, y, z), as read they were taken otherwise",
            f"axes='{directions}'",
            "warning",
        )
    if code == "handedness":
        text = f"the axes are left-handed, which no rotation mends: {changes(best.A)}"
        return text, _mend(best.A, both=True), "error"
    if code == "accel_axes":
        text = f"the accelerometer has other axes than the gyroscope: {changes(best.A)}"
        return text, _mend(best.A, both=False, sensor="a"), "error"
    text = f"the gyroscope has other axes than the accelerometer: {changes(best.G)}"
    return text, _mend(best.G, both=False, sensor="g"), "error"


def _mend(P: FloatArray, *, both: bool, sensor: str = "a") -> str:
    """Option that undoes a signed permutation of columns."""
    sensors = ("a", "g") if both else (sensor,)
    flips, exchanged = [], []
    for i, row in enumerate(P):
        k = int(np.argmax(np.abs(row)))
        if row[k] < 0.0:
            flips += [f"{s}{_NAMES[k]}=-1" for s in sensors]
        if k != i:
            exchanged += [f"{s}{_NAMES[i]} is {s}{_NAMES[k]}" for s in sensors]
    parts = []
    if exchanged:
        parts.append(f"name the columns right, columns='...' ({', '.join(exchanged)})")
    if flips:
        parts.append(f"scale='{','.join(flips)}'")
    return " and ".join(parts)
