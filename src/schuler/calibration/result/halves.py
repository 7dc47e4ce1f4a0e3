"""Law of halves: two parts of a log give the same parameters within their claims, or the claims are widened."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.comparison import compare
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.verdict import Status, Verdict

#: Probability of larger differences by chance below which the claims of a block are widened.
WIDEN = 0.01
#: The same below which the result is doubtful.
DOUBTFUL = 1e-3
#: Root mean square difference of halves, in claimed sigmas, beyond which nothing of the model holds.
FAILED = 10.0


@dataclass(frozen=True)
class Split:
    """Parameters of two parts of a log against each other.

    Attributes
    ----------
    name : str
        ``"odd and even rests"``, ``"first and second half"``, ...
    rms : dict of str to float
        Root mean square difference over its claimed sigma, by block of parameters: ``b_a``, ``M_a``, ``b_g``, ...
    probability : dict of str to float
        Of larger differences by chance, correlations counted.
    expected : dict of str to (float, float)
        Interval that holds 95 % of the root mean squares, were the claims exact: a block of three has 0.27 to 1.77.
    """

    name: str
    rms: dict[str, float]
    probability: dict[str, float]
    expected: dict[str, tuple[float, float]] = field(default_factory=dict)


def split(
    name: str,
    a: CalibrationResult,
    b: CalibrationResult,
    skip: Sequence[str] = (),
    stated: Mapping[str, float] | None = None,
) -> Split | None:
    """Compare two parts of a log that share no reading; None if one is refused or nothing is determined in both.

    ``stated`` has variances of differences, by parameter, where both parts share an error: what drifts alike in odd and
    even rests is in both claims and not in the difference. Larger ones than both claims together do not count.
    """
    from scipy.special import chdtrc

    if "refused" in (a.status, b.status):
        return None
    difference = compare(a, b)
    sigma = difference.sigma
    own = np.sqrt([min((stated or {}).get(n, np.inf), s**2) for n, s in zip(difference.names, sigma, strict=True)])
    good = np.isfinite(sigma) & (sigma > 0.0)
    rms: dict[str, float] = {}
    p: dict[str, float] = {}
    expected: dict[str, tuple[float, float]] = {}
    for block in dict.fromkeys(block_of(n) for n in difference.names):
        if block in skip:
            continue
        at = np.array([i for i, n in enumerate(difference.names) if block_of(n) == block and good[i]], dtype=int)
        if not len(at):
            continue
        z = difference.difference[at] / own[at]
        R = difference.covariance[np.ix_(at, at)] / np.outer(sigma[at], sigma[at])
        values, Q = np.linalg.eigh(R)
        keep = values > 1e-6
        squared = float((((Q.T @ z)[keep]) ** 2 / values[keep]).sum())
        rms[block] = float(np.sqrt(np.mean(z * z)))
        p[block] = float(chdtrc(int(keep.sum()), squared))
        expected[block] = rms_interval(values)
    return Split(name, rms, p, expected) if rms else None


def rms_interval(eigenvalues: FloatArray) -> tuple[float, float]:
    """Interval of 95 % of the root mean square of correlated standard normal numbers.

    Parameters
    ----------
    eigenvalues : ndarray, shape (n,)
        Of their correlation matrix.

    Returns
    -------
    (float, float)
        The mean square is a sum of chi-squares of one degree of freedom with the eigenvalues as weights; it is taken
        for a multiple of one chi-square with its mean and variance.

    References
    ----------
    Satterthwaite (1946), Biometrics Bulletin 2, 110-114.
    """
    from scipy.special import gammaincinv

    weights = np.maximum(eigenvalues, 0.0)
    freedom = float(weights.sum() ** 2 / np.square(weights).sum())
    low, high = 2.0 * gammaincinv(0.5 * freedom, [0.025, 0.975]) / freedom
    return float(np.sqrt(low)), float(np.sqrt(high))


def block_of(name: str) -> str:
    """Block a parameter belongs to: ``M_a_xy`` to ``M_a``, ``r_a_yx`` to ``r_a``."""
    return name[:3] if name[1:2] == "_" else name


def checked(
    result: CalibrationResult,
    parts: Mapping[str, tuple[CalibrationResult, ...] | None],
    *,
    causes: Sequence[str] = (),
    needs: str = "",
    skip: Sequence[str] = (),
    stated: Mapping[str, Mapping[str, float]] | None = None,
) -> CalibrationResult:
    """A result with its claims held against halves of its log, and widened where they do not hold.

    Parameters
    ----------
    result : CalibrationResult
        Of the complete log.
    parts : mapping of str to (CalibrationResult, CalibrationResult) or None
        The same of two parts, by the name of the split; None: a part could not be calibrated.
    causes : sequence of str
        What would explain a difference, the likeliest first.
    needs : str
        What a log would need for halves, where no part could be calibrated.
    skip : sequence of str
        Blocks that are not compared, because the parts share readings.
    stated : mapping of str to (mapping of str to float), optional
        Variances of differences by split and parameter, see :func:`split`.

    Returns
    -------
    CalibrationResult
        ``extra["halves"]``: ``splits`` (root mean square difference in claimed sigmas by block), ``expected`` (where
        95 % of these lie, were the claims exact), ``widened`` (factor on the sigma of a block) and ``verdict``. A block
        is widened by the largest of its root mean squares that chance gives less often than :data:`WIDEN`. Doubtful is
        a ``warning``.

    Notes
    -----
    Where one part is 1.4 claimed sigmas of the difference off the other, both claims are too small by 1.4; so is, as
    far as the log can tell, that of the complete log.
    """
    if result.status == "refused":
        return result
    splits = [
        s
        for name, pair in parts.items()
        if pair is not None and (s := split(name, pair[0], pair[1], skip, (stated or {}).get(name))) is not None
    ]
    if not splits:
        note = {"splits": {}, "widened": {}, "note": needs} if needs else None
        return result if note is None else replace(result, extra=result.extra | {"halves": note})
    widened: dict[str, float] = {}
    worst = 1.0
    off: list[tuple[float, str, str]] = []
    for s in splits:
        for block, z in s.rms.items():
            if s.probability[block] < WIDEN and z > 1.0:
                widened[block] = max(widened.get(block, 1.0), z)
            if s.probability[block] < DOUBTFUL and z > 1.0:
                off.append((z, block, s.name))
                worst = max(worst, z)
    status: Status = "ok" if not off else "failed" if worst > FAILED else "doubtful"
    reasons = tuple(f"{block} of {name} differs by {z:.2g} claimed sigmas" for z, block, name in sorted(off)[::-1])
    likely = tuple(causes) if off else ()
    if off and not likely:
        likely = ("the unit changed during the log: temperature, drift, or a knock",)
    verdict = Verdict(status, reasons, likely)
    factor = np.array([widened.get(block_of(n), 1.0) for n in result.names])
    halves: dict[str, Any] = {
        "splits": {s.name: {b: float(f"{z:.3g}") for b, z in s.rms.items()} for s in splits},
        "expected": {s.name: {b: [float(f"{x:.3g}") for x in ab] for b, ab in s.expected.items()} for s in splits},
        "widened": {b: float(f"{k:.3g}") for b, k in widened.items()}, "verdict": verdict.to_dict(),
    }  # fmt: skip
    sentences = list(result.verdicts)
    if off:
        sentences.append(
            f"Halves of the log: {status}. {'; '.join(reasons[:3])}; likely: {likely[0].rstrip('.')}. Their "
            "uncertainties were widened by as much."
        )
    return replace(
        result, covariance=widen(result.covariance, factor), extra=result.extra | {"halves": halves},
        verdicts=tuple(sentences), status="warning" if off else result.status,
    )  # fmt: skip


def widen(covariance: FloatArray, factor: FloatArray) -> FloatArray:
    """Covariance with each sigma times its factor, correlations unchanged."""
    lost = ~np.isfinite(np.diag(covariance))
    out = np.where(np.isfinite(covariance), covariance, 0.0) * np.outer(factor, factor)
    out[lost, lost] = np.inf
    return np.asarray(out)


def halves_of(n: int) -> dict[str, tuple[slice, slice]]:
    """Splits of n things in the order of time: odd against even, first half against second."""
    return {
        "odd and even rests": (slice(0, None, 2), slice(1, None, 2)),
        "first and second half": (slice(0, n // 2), slice(n // 2, None)),
    }


def tried(calibrate: Callable[[Any], CalibrationResult], parts: Sequence[Any]) -> tuple[CalibrationResult, ...] | None:
    """Each part of a split calibrated; None where one of them cannot be."""
    try:
        results = tuple(calibrate(part) for part in parts)
    except (InputError, np.linalg.LinAlgError):
        return None
    return None if any(r.status == "refused" for r in results) else results


def without_thirds(
    result: CalibrationResult, parts: Sequence[CalibrationResult]
) -> dict[str, tuple[CalibrationResult, ...] | None]:
    """Splits of a log too short for halves: all of it against all but every third rest, three times.

    Parameters
    ----------
    result : CalibrationResult
    parts : sequence of CalibrationResult
        Without rests 1, 4, 7 ..., without 2, 5, 8 ..., without 3, 6, 9 ...

    Returns
    -------
    dict
        For :func:`checked`. A part and the complete log share two thirds of the readings, so their difference has a
        third of the covariance of the part.

    References
    ----------
    Efron, Tibshirani (1993), An Introduction to the Bootstrap, chapter 11, for the delete-d jackknife.
    """
    nothing = replace(result, covariance=np.zeros_like(result.covariance))
    out: dict[str, tuple[CalibrationResult, ...] | None] = {}
    for k, part in enumerate(parts):
        third = np.where(np.isfinite(part.covariance), part.covariance / 3.0, part.covariance)
        out[f"without every third rest from {k + 1}"] = (nothing, replace(part, covariance=third))
    return out


def halves_words(result: CalibrationResult) -> str:
    """Agreement of halves in a line: root mean square differences in claimed sigmas, and what was widened."""
    halves = result.extra.get("halves")
    if not isinstance(halves, dict):
        return ""
    if not halves.get("splits"):
        return str(halves.get("note", ""))
    expected = halves.get("expected", {})

    def block_words(split: str, block: str, z: float) -> str:
        low, high = expected.get(split, {}).get(block, (None, None))
        return f"{block} {z:.2g}" + ("" if low is None else f" ({low:.2g} to {high:.2g})")

    text = "; ".join(
        f"{name}: {', '.join(block_words(name, block, z) for block, z in blocks.items())}"
        for name, blocks in halves["splits"].items()
    )
    wide = ", ".join(f"{block} by {k:.2g}" for block, k in halves.get("widened", {}).items())
    status = halves.get("verdict", {}).get("status", "ok")
    return f"{status}; rms difference in claimed sigmas (95 % by chance), {text}{f'; widened {wide}' if wide else ''}"
