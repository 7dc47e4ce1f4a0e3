"""Number of parameters that the readings of a triad justify: 3, 6 and 9 side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from schuler.arrays import ArrayLike
from schuler.calibration.bench.adjustment import Adjustment
from schuler.calibration.bench.gauss_helmert import Order, adjust
from schuler.calibration.bench.sensor_geometry import PARAMETERS

_ORDERS: tuple[Order, ...] = (3, 6, 9)
_REJECT = 0.01  # probability below which an order is said not to fit, or to be beaten


@dataclass(frozen=True)
class OrderTest:
    """One model order.

    Attributes
    ----------
    order : {3, 6, 9}
    adjustment : Adjustment
    p_global : float
        Probability of residuals as large as these if noise and model are right (chi-square); NaN without redundancy.
    p_previous : float
        Probability that the next smaller order would do as well as it did (difference of chi-squares; F test if even
        the largest order does not fit, because then the noise is not as stated). NaN for the smallest.
    aic, bic : float
        ``chi2 + 2 m``, ``chi2 + m ln n``.
    """

    order: Order
    adjustment: Adjustment
    p_global: float
    p_previous: float
    aic: float
    bic: float


def p_of(adjustment: Adjustment) -> float:
    """Probability of a variance of unit weight as large as this; NaN without redundancy."""
    from scipy.stats import chi2

    return float(chi2.sf(adjustment.chi_square, adjustment.freedom)) if adjustment.freedom > 0 else float("nan")


def order_tests(
    Y: ArrayLike,
    sigma: ArrayLike,
    rho: ArrayLike,
    *,
    fixed: Mapping[str, float] | None = None,
) -> tuple[OrderTest, ...]:
    """Adjust with 3, 6 and 9 parameters and compare.

    Parameters
    ----------
    Y, sigma, rho, fixed
        See :func:`schuler.calibration.bench.gauss_helmert.adjust`.

    Returns
    -------
    tuple of OrderTest
        Orders that did not converge, leave parameters undetermined, or estimate nothing more than the one before, are
        missing.
    """
    import numpy as np
    from scipy.stats import chi2, f

    tests: list[OrderTest] = []
    fits: list[tuple[Order, Adjustment]] = []
    for order in _ORDERS:
        if any(name not in (fixed or {}) for name in PARAMETERS[:order]):
            fit = adjust(Y, sigma, rho, order, fixed=fixed)
            more_than_before = not fits or fit.free.sum() > fits[-1][1].free.sum()
            if fit.converged and not fit.undetermined.any() and more_than_before:
                fits.append((order, fit))
    if not fits:
        return ()
    last = fits[-1][1]
    noise_unknown = last.freedom > 0 and p_of(last) < _REJECT
    for i, (order, fit) in enumerate(fits):
        p = float("nan")
        if i:
            before = fits[i - 1][1]
            gain, more = max(before.chi_square - fit.chi_square, 0.0), before.freedom - fit.freedom
            if noise_unknown:
                p = float(f.sf(gain / more / last.variance_of_unit_weight, more, last.freedom))
            else:
                p = float(chi2.sf(gain, more))
        m, n = int(fit.free.sum()), len(fit.misclosure)
        tests.append(
            OrderTest(order, fit, p_of(fit), p, fit.chi_square + 2.0 * m, fit.chi_square + m * float(np.log(n)))
        )
    return tuple(tests)


def recommended(tests: Sequence[OrderTest]) -> OrderTest:
    """The smallest order that no larger one beats significantly."""
    best = tests[0]
    for test in tests[1:]:
        if test.p_previous < _REJECT:
            best = test
    return best
