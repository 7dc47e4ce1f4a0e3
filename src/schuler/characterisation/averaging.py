"""Uncertainty of noise terms over all the models that the data do not tell apart, instead of under the one kept.

Models are weighted by ``exp(-criterion / 2)`` with ``criterion = misfit + 2 p + 2 c``, p parameters and c averaging
times left out: a time left out is a moment with a parameter of its own. The logarithm of a parameter is then a mixture
of normal distributions, one for each model that has it, and its interval goes from the 2.5 % to the 97.5 % quantile of
the mixture. Models without the term have it at zero: if they weigh more than 2.5 %, the interval begins there.

No model allows for noise that changes in the log. So the model kept is fitted to both halves, and where a term differs
by more than two of its sigmas, half of the difference is its uncertainty besides: the standard error of a mean of two.

References
----------
Jay and Neil (2021), Phys. Rev. D 103, 114502, equation 30 (average over models and over cuts of the data); Burnham and
Anderson (2002), Model Selection and Multimodel Inference, chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.fitting import Fit

_PRICE = 2.0  # of a parameter and of an averaging time left out
_SURE = 1.0  # models with a parameter not known to a factor of e say nothing of their terms
_TAIL = 0.025
_CHANGED = 2.0  # sigmas between halves from which on a term is said to have changed: chance in one of twenty


@dataclass(frozen=True, slots=True)
class Spread:
    """What all models together say of one parameter.

    Attributes
    ----------
    sigma : float
        1-sigma uncertainty of its logarithm, of models that have it, about the value kept.
    low, high : float
        95 % interval; ``low`` is zero where models without it weigh more than 2.5 %.
    share : float
        Weight of the models that have it.
    """

    sigma: float
    low: float
    high: float
    share: float


def spreads(kept: Fit, others: list[tuple[Fit, int]], left_out: int) -> dict[str, Spread]:
    """Uncertainty of every parameter, averaged over models.

    Parameters
    ----------
    kept : Fit
        The model whose values are reported.
    others : list of (Fit, int)
        All models tried and how many averaging times each left out; the one kept is among them or not.
    left_out : int
        Averaging times that the model kept left out.

    Returns
    -------
    dict of str to Spread
        By parameter: those of ``kept``, and B, K and R of other models that weigh more than 2.5 %.
        Standard deviations and times of Gauss-Markov terms are averaged over models of the same terms only, since
        others mean another process by the same name.
    """
    several = [(kept, left_out), *((f, c) for f, c in others if f is not kept and f.sigma.max() < _SURE)]
    criterion = np.array([f.misfit + _PRICE * (len(f.names) + c) for f, c in several])
    weight = np.exp(-0.5 * (criterion - criterion.min()))
    weight /= weight.sum()
    result = {}
    for name in dict.fromkeys((*kept.names, "B", "K", "R")):
        same = name.startswith(("sigma", "tau"))
        among = [
            (f.names.index(name), f, w)
            for (f, _), w in zip(several, weight, strict=True)
            if name in f.names and (not same or _gauss_markov(f) == _gauss_markov(kept))
        ]
        share = sum(w for _, _, w in among)
        if not among or (name not in kept.names and share < _TAIL):
            continue
        mean = np.array([np.log(f.values[i]) for i, f, _ in among])
        sigma = np.array([f.sigma[i] for i, f, _ in among])
        w = np.array([w for _, _, w in among]) / share
        zero = 0.0 if same else 1.0 - share
        low = 0.0 if zero > _TAIL else float(np.exp(_quantile(mean, sigma, w, (_TAIL - zero) / share)))
        high = float(np.exp(min(_quantile(mean, sigma, w, 1.0 - _TAIL / share), 700.0)))
        centre = float(mean @ w)
        if name in kept.names:
            centre = float(np.log(kept.values[kept.names.index(name)]))
            low, high = min(low, float(np.exp(centre))), max(high, float(np.exp(centre)))
        result[name] = Spread(float(np.sqrt(w @ (sigma**2 + (mean - centre) ** 2))), low, high, share)
    return result


def changes(kept: Fit, halves: tuple[Fit, Fit]) -> dict[str, float]:
    """Logarithm of second half over first, of the terms Q, N, B, K, R that differ by more than chance.

    Parameters
    ----------
    kept : Fit
    halves : (Fit, Fit)
        The same model fitted to each half of the log.
    """
    first, second = halves
    change = np.log(second.values / first.values)
    surely = np.abs(change) > _CHANGED * np.hypot(first.sigma, second.sigma)
    return {n: float(c) for n, c, yes in zip(kept.names, change, surely, strict=True) if yes and n in "QNBKR"}


def widened(kept: Fit, spread: dict[str, Spread], change: dict[str, float]) -> dict[str, Spread]:
    """Spreads with half of what the terms change between the halves of the log as uncertainty besides."""
    result = dict(spread)
    for name, by in change.items():
        s, value = spread[name], float(kept.values[kept.names.index(name)])
        more = 0.5 * abs(by)
        low = 0.0 if s.low <= 0.0 else value * np.exp(-np.hypot(np.log(value / s.low), 1.96 * more))
        high = value * np.exp(np.hypot(np.log(s.high / value), 1.96 * more))
        result[name] = Spread(float(np.hypot(s.sigma, more)), float(low), float(high), s.share)
    return result


def _gauss_markov(f: Fit) -> int:
    return sum(name.startswith("sigma") for name in f.names)


def _quantile(mean: FloatArray, sigma: FloatArray, weight: FloatArray, p: float) -> float:
    """Quantile of a mixture of normal distributions, by bisection."""
    from scipy.special import ndtr

    low, high = float((mean - 9.0 * sigma).min()), float((mean + 9.0 * sigma).max())
    if p <= 0.0:
        return low
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float(weight @ ndtr((middle - mean) / sigma)) < p:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
