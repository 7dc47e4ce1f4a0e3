"""Verdicts of a field calibration: undetermined and contradictory parameters in words, and advice."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.result.parameters import imu_errors
from schuler.calibration.result.result import Residuals, Status
from schuler.standstill.stationarity import StaticIntervals
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.calibration.field.problem import Problem

#: Share of its 1-sigma before the log above which a parameter counts as undetermined, and as poorly determined.
UNDETERMINED, POOR = 0.7, 0.1
#: Deviation from the prior over its 1-sigma beyond which a value contradicts it.
CONTRADICTS = 5.0
#: Change in the last pass over the sigma beyond which the passes diverge.
DIVERGES = 1.0


class Verdict(NamedTuple):
    """Status, sentences, and advice on further turns and rests."""

    status: Status
    sentences: tuple[str, ...]
    advice: str


def field_verdicts(
    names: tuple[str, ...],
    covariance: FloatArray,
    prior_sigma: dict[str, float],
    rests: StaticIntervals,
    blocks: Blocks,
    scales: dict[str, float],
    heading: tuple[float, float] | None,
    *,
    off: FloatArray | None = None,
    moved: FloatArray | None = None,
    settled: float = 1.0,
    left_out: tuple[str, ...] = (),
    swaying: bool = False,
) -> Verdict:
    """Judge parameters against those before the log.

    Parameters
    ----------
    names, covariance, prior_sigma
        Parameters, their covariance, 1-sigma before the log.
    rests, blocks
        Rests of the log and means over their blocks.
    scales : dict of str to float
        Factors by which variances were enlarged, by kind of measurement.
    heading : (float, float), optional
        Estimated heading and its 1-sigma. [rad]
    off : ndarray, shape (p,), optional
        Values less the prior. SI.
    moved : ndarray, shape (p,), optional
        Change in the last pass over the sigma.
    settled : float
        Largest change of a converged parameter.
    left_out : tuple of str
        Blocks of the options without uncertainty in the specification.
    swaying : bool
        The rests sway.
    """
    share = {n: s / prior_sigma[n] for n, s in zip(names, np.sqrt(np.diag(covariance)), strict=True)}
    undetermined = [n for n in names if share[n] > UNDETERMINED]
    poor = [n for n in names if POOR < share[n] <= UNDETERMINED]
    too_few = len(rests) < 4
    largest = 0.0 if moved is None else float(np.max(moved))
    sentences = []
    if too_few:
        sentences.append(
            f"only {len(rests)} rests were found, at least four in different attitudes are needed: rest ten seconds, "
            "turn by 45 deg or more, rest again, about all three axes"
        )
    if moved is not None and largest > settled:
        sentences.append(
            f"the passes do not settle: {names[int(np.argmax(moved))]} still moved by {largest:.2g} sigma in the last "
            "one. "
            + (
                "The log does not fit what is estimated: look at the IMU's uncertainties, units and axes of the log, "
                "and whether something is left out that is not small"
                if largest > DIVERGES
                else "More rests in other attitudes, or more passes, help"
            )
        )
    far = _contradictions(names, off, prior_sigma)
    if far:
        sentences.append(
            f"not what was known before: {far}; the result leans towards what was known, so state more generous "
            "uncertainties of the IMU, or another IMU"
        )
    if undetermined:
        sentences.append(f"not determined (hardly better than the data sheet): {', '.join(undetermined)}")
    if poor:
        sentences.append(f"not below a tenth of what was known before: {', '.join(poor)}")
    if left_out:
        sentences.append(
            f"taken for zero, since the specification of the IMU has no uncertainty for it: {', '.join(left_out)}"
        )
    for kind, factor in scales.items():
        sentences.append(
            f"{kind}: innovations are {np.sqrt(factor):.2g} times as large as the noise at rest explains (a hand that "
            "is not steady, a surface that gives way); uncertainties are enlarged accordingly"
        )
    if swaying:
        sentences.append(
            "the unit sways at rest, both triads see it: the gyroscopes carry the attitude through the rests, and are "
            "themselves found less well; put it down instead of holding it"
        )
    if heading is not None and heading[1] < 0.7:
        angle, sigma = (v / DEG for v in heading)
        sentences.append(f"heading of the first rest {angle:.0f} deg, 1-sigma {sigma:.0f} deg")
    status: Status = "ok"
    if too_few or largest > DIVERGES:
        status = "refused"
    elif undetermined or far or largest > settled:
        status = "warning"
    return Verdict(status, tuple(sentences), _advice(undetermined + poor, rests, blocks))


def _contradictions(names: tuple[str, ...], off: FloatArray | None, prior_sigma: dict[str, float]) -> str:
    """The values farthest from the prior, as text."""
    if off is None:
        return ""
    ratio = sorted(((abs(d) / prior_sigma[n], n) for n, d in zip(names, off, strict=True)), reverse=True)
    far = [f"{name} is off by {r:.2g} of its 1-sigma" for r, name in ratio if r > CONTRADICTS]
    return ", ".join(far[:3]) + (f", and {len(far) - 3} more" if len(far) > 3 else "")


def _advice(missing: list[str], rests: StaticIntervals, blocks: Blocks) -> str:
    """One sentence on the most useful turns and rests."""
    if not missing:
        return ""
    accel = [n for n in missing if n[:3] in ("b_a", "M_a")]
    if accel:
        letter = accel[0][4]
        return f"rest with the {letter} axis up, then down, then between (45 deg), for {', '.join(accel)}"
    turning = [n for n in missing if n.startswith("M_g")]
    if turning:
        letter = turning[0][5]
        what = ", ".join(turning)
        return f"turn about the {letter} axis while it is horizontal, a full turn in steps with rests, for {what}"
    return f"rest longer, with each axis up and down, for {', '.join(missing)}"


def rest_residuals(
    blocks: Blocks, rests: StaticIntervals, parameters: dict[str, float], problem: Problem
) -> dict[str, Residuals]:
    """Residuals per rest: magnitude of specific force less gravity, and rate along the vertical less the Earth's."""
    errors = imu_errors(parameters)
    latitude, height = float(problem.llh[0]), float(problem.llh[2])
    stated = problem.schedule.z[:, 6]
    stated = stated[stated > 0.0]
    g = float(stated[0]) if len(stated) else float(np.linalg.norm(earth.gravity_ned(latitude, height)))
    ks = np.unique(blocks.rest)
    raw_f = np.array([blocks.f[blocks.rest == k].mean(axis=0) for k in ks])
    raw_w = np.array([blocks.omega[blocks.rest == k].mean(axis=0) for k in ks])
    length = np.array([blocks.length[blocks.rest == k].sum() for k in ks])
    w, f = errors.compensate_rates(raw_w, raw_f)
    up, raw_up = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (f, raw_f))
    sinking = earth.WGS84.omega_ie * np.sin(latitude)
    label = tuple(
        f"rest {k + 1} ({a:.1f}..{b:.1f} s)" for k, (a, b) in enumerate(zip(rests.start, rests.stop, strict=True))
    )
    sigma_f, sigma_w = (np.sqrt(np.sum((up * s) ** 2, axis=1)) for s in (problem.noise.f, problem.noise.omega))
    return {
        "accel": Residuals(
            label, np.linalg.norm(f, axis=1) - g, sigma_f / np.sqrt(length), "m/s^2",
            before=np.linalg.norm(raw_f, axis=1) - g, direction=up,
        ),
        "gyro": Residuals(
            label, np.sum(up * w, axis=1) - sinking, sigma_w / np.sqrt(length), "rad/s",
            before=np.sum(raw_up * raw_w, axis=1) - sinking, direction=up,
        ),
    }  # fmt: skip
