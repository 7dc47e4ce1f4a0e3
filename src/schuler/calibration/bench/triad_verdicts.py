"""What to say of an adjustment of one triad: sentences on residuals, outliers, weak and useless parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.bench.adjustment import Adjustment
from schuler.calibration.bench.model_order import OrderTest, p_of
from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.calibration.design.pose_advice import reasons

#: Probability below which a test speaks.
REJECT = 0.01
#: Redundancy below which a variance of unit weight says next to nothing: the 90 % range at 5 is 0.23 to 2.2.
ENOUGH_FREEDOM = 5
#: Poses that are named as advice.
ADVISED = 4
#: An uncertainty this many times the best of its kind is weak.
WEAK = 5.0


def refusal(who: str, fit: Adjustment, useless: Sequence[str], sheet: Mapping[str, float]) -> str:
    """That the data sheet knows some parameters better, with the worst of them."""
    worst = max(useless, key=lambda name: fit.sigma[PARAMETERS.index(name)] / sheet[name])
    size = fit.sigma[PARAMETERS.index(worst)] if fit.converged else np.inf
    return (
        f"{who}: {', '.join(useless)} refused: the data sheet knows them better ({worst}: 1 sigma {size:.2g} from "
        f"these poses, {sheet[worst]:.2g} from the sheet) and is kept; a stronger reference or longer poses would tell"
    )


def why_not_more(who: str, tests: Sequence[OrderTest], order: int) -> str:
    """Why no more than so many parameters were estimated."""
    next_one = next((t for t in tests if t.order > order), None)
    if next_one is None:
        return f"{who}: {order} parameters; the poses do not determine more"
    return (
        f"{who}: {order} parameters are enough: {next_one.order} fit no better than chance has it "
        f"(probability {next_one.p_previous:.2f}); scale factors and angles beyond stay at their nominal values"
    )


def suspicions(
    who: str, fit: Adjustment, undetermined: BoolArray, labels: Sequence[str], unit: str, u: FloatArray
) -> list[str]:
    """What makes a result that could be computed doubtful: redundancy, size of residuals, outliers, weak parameters.

    Parameters
    ----------
    who : str
        The sensors, for the sentences.
    fit : Adjustment
    undetermined : ndarray of bool, shape (9,)
    labels : sequence of str
        Of the poses.
    unit : str
    u : ndarray, shape (n, 3)
        Directions of the reference in body axes.
    """
    from scipy.stats import chi2, norm

    sentences: list[str] = []
    if fit.freedom < ENOUGH_FREEDOM and not undetermined.any():
        more = ENOUGH_FREEDOM - fit.freedom
        sentences.append(
            f"{who}: redundancy {fit.freedom}, so the residuals hardly test anything; collect {more} more "
            f"pose{'s' if more > 1 else ''}"
        )
    # how many poses could be called wrong by chance is held at REJECT for all of them together
    testable = fit.redundancy > 0.05
    limit = float(norm.isf(0.5 * REJECT / max(int(testable.sum()), 1)))
    w = np.where(testable, np.abs(fit.misclosure) / np.where(testable, fit.misclosure_sigma, 1.0), 0.0)
    if fit.freedom > 1:  # against the scatter of the others, where that is larger than stated
        w /= np.sqrt(np.maximum((fit.chi_square - w * w) / (fit.freedom - 1), 1.0))
    if fit.freedom > 0 and (p := p_of(fit)) < REJECT:
        sentences.append(
            f"{who}: residuals are {np.sqrt(fit.variance_of_unit_weight):.2g} times as large as the noise explains "
            f"(probability {p:.1g}); movement, drift, temperature, a wrong reference or too few parameters; "
            "uncertainties are enlarged accordingly"
        )
    elif fit.freedom > 0 and float(chi2.cdf(fit.chi_square, fit.freedom)) < 0.1 * REJECT:
        sentences.append(
            f"{who}: residuals are {np.sqrt(fit.variance_of_unit_weight):.2g} times what the stated noise explains; it "
            "is less than stated, and so are the uncertainties"
        )
    if w.max(initial=0.0) > limit:
        k = int(np.argmax(w))
        sentences.append(
            f"{who}: {labels[k]} is off by {w[k]:.1f} sigma ({fit.misclosure[k]:.3g} {unit}); repeat it or leave it out"
        )
    for block in (slice(3, 6), slice(6, 9)):
        names = PARAMETERS[block]
        sigma = np.where((fit.free & ~undetermined)[block], fit.sigma[block], np.nan)
        if np.isfinite(sigma).sum() < 2:
            continue
        best = float(np.nanmin(sigma))
        for name, size in zip(names, sigma, strict=True):
            if size > WEAK * best:
                reason = reasons([name], u)[0].partition(": ")[2]
                sentences.append(
                    f"{who}: {name} is weak, 1 sigma {size:.2g} against {best:.2g} for the best of its kind: {reason}"
                )
    return sentences
