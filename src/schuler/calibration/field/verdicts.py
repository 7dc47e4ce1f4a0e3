"""What a field calibration could not find out, in words, and what to do next."""

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
    from schuler.calibration.field.filter_pass import Problem

#: Share of what was known before, above which a parameter counts as not found out; and as found out half-way.
UNKNOWN, POOR = 0.7, 0.1
#: Beyond so many of its 1-sigma a value contradicts what was known before.
CONTRADICTS = 5.0
#: A parameter that still moves by more of its sigma in the last pass has not been found.
LOST = 1.0


class Verdict(NamedTuple):
    """Status, sentences, and what to do next."""

    status: Status
    sentences: tuple[str, ...]
    advice: str


def verdicts_of(
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
    """Judge what came out beside what was known before.

    Parameters
    ----------
    names, covariance, prior_sigma
        Parameters, their covariance, 1-sigma before.
    rests, blocks
        Of the log.
    scales : dict of str to float
        Factors by which variances were enlarged, by kind of measurement.
    heading : (float, float), optional
        If it was estimated. [rad]
    off : ndarray, shape (p,), optional
        Values less what was believed before. SI.
    moved : ndarray, shape (p,), optional
        Change in the last pass over the sigma.
    settled : float
        Changes up to this are none.
    left_out : tuple of str
        Blocks of parameters that were asked for and that nothing was known of before.
    swaying : bool
        Rests were found to sway.
    """
    share = {n: s / prior_sigma[n] for n, s in zip(names, np.sqrt(np.diag(covariance)), strict=True)}
    unknown = [n for n in names if share[n] > UNKNOWN]
    poor = [n for n in names if POOR < share[n] <= UNKNOWN]
    few = len(rests) < 4
    largest = 0.0 if moved is None else float(np.max(moved))
    sentences = []
    if few:
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
                if largest > LOST
                else "More rests in other attitudes, or more passes, help"
            )
        )
    far = _contradictions(names, off, prior_sigma)
    if far:
        sentences.append(
            f"not what was known before: {far}; the result leans towards what was known, so state more generous "
            "uncertainties of the IMU, or another IMU"
        )
    if unknown:
        sentences.append(f"not determined (hardly better than the data sheet): {', '.join(unknown)}")
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
    if few or largest > LOST:
        status = "refused"
    elif unknown or far or largest > settled:
        status = "warning"
    return Verdict(status, tuple(sentences), _advice(unknown + poor, rests, blocks))


def _contradictions(names: tuple[str, ...], off: FloatArray | None, prior_sigma: dict[str, float]) -> str:
    """The worst of those that are far from what was known before, in words."""
    if off is None:
        return ""
    ratio = sorted(((abs(d) / prior_sigma[n], n) for n, d in zip(names, off, strict=True)), reverse=True)
    far = [f"{name} is off by {r:.2g} of its 1-sigma" for r, name in ratio if r > CONTRADICTS]
    return ", ".join(far[:3]) + (f", and {len(far) - 3} more" if len(far) > 3 else "")


def _advice(missing: list[str], rests: StaticIntervals, blocks: Blocks) -> str:
    """One sentence on what helps most."""
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


def residuals_of(
    blocks: Blocks, rests: StaticIntervals, parameters: dict[str, float], problem: Problem
) -> dict[str, Residuals]:
    """Per rest: magnitude of specific force less gravity, and rate along the vertical less the Earth's."""
    errors = imu_errors(parameters)
    latitude, height = float(problem.llh[0]), float(problem.llh[2])
    used = problem.schedule.z[:, 6]
    g = float(used[used > 0.0][0]) if (used > 0.0).any() else float(np.linalg.norm(earth.gravity_ned(latitude, height)))
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
