"""Which noise terms a curve shows: several models are fitted, and the one that explains it with fewest parameters kept.

The criterion is ``misfit + 4 p``: another parameter must lower the weighted sum of squares by four, which chance does
about once in twenty cases. Models with a parameter that is not even known to a factor of e come last.

A sensor follows no sum of terms exactly. Where the best of the models fails its chi-square test, the shortest averaging
times, which are a matter of the sensor's filter and of vibration, are left out, as few as possible; where that does not
help, a relative departure is added to every averaging time, the smallest one with which a model passes. Both are
reported, and the uncertainty of the parameters includes them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from schuler.characterisation.averaging import Spread, changes, spreads, widened
from schuler.characterisation.fitting import Fit, NoFitError, Weights, fit, parse_terms
from schuler.characterisation.moments import Moments
from schuler.characterisation.result import Candidate

#: Tried in turn, each also with the sensor's filter (F) or quantisation (Q) if the shortest averaging times ask for it.
MODELS = (
    "N", "N+B", "N+K", "N+GM", "N+R", "N+B+K", "N+B+R", "N+K+R", "N+K+GM", "N+B+GM", "N+2GM", "N+K+2GM",
)  # fmt: skip
_PROBES = (
    "N",
    "N+B",
    "N+K",
    "N+GM",
    "N+B+K",
    "N+K+GM",
    "N+2GM",
)  # enough to tell what the shortest times and the departure ask for
_WITHOUT_N = ("Q", "B+Q", "K+Q")
_SIMPLE = 4  # so many of the first are tried without filter or quantisation even if richer ones ask for them
_PRICE = 4.0
_DEPARTURES = (0.0, 0.01, 0.03, 0.1, 0.3)
# samples of the shortest averaging time, and what is added to every model for the rest of a vibration seen from there
_STAGES = ((1, ""), (4, ""), (16, ""), (64, ""), (256, ""), (16, "+Q"), (64, "+Q"), (256, "+Q"))
_FEWEST = 9  # averaging times that must be left


@dataclass(frozen=True)
class Selection:
    """The model kept, and what else was tried.

    Attributes
    ----------
    fit : Fit
    candidates : tuple of Candidate
        Best first.
    shortest : int
        Samples of the shortest averaging time that was used.
    departure : float
        Relative 1-sigma by which the Allan variance departs from every model tried.
    fits : bool
        Whether the model passes its chi-square test with that departure.
    spreads : dict of str to Spread
        Uncertainty of the parameters over all models that the data do not tell apart, :mod:`.averaging`.
    changes : dict of str to float
        Logarithm of second half over first, of terms that differ between the halves of the log.
    """

    fit: Fit
    candidates: tuple[Candidate, ...]
    shortest: int
    departure: float
    fits: bool
    spreads: dict[str, Spread] = field(default_factory=dict)
    changes: dict[str, float] = field(default_factory=dict)


def select(
    data: Moments,
    models: tuple[str, ...] | None = None,
    weights: Weights = "full",
    *,
    default: tuple[str, ...] = MODELS,
    probes: tuple[str, ...] = _PROBES,
    halves: tuple[Moments, Moments] | None = None,
    white_sigma: float = 0.0,
) -> Selection:
    """Fit models to moments and keep the best.

    Parameters
    ----------
    data : Moments
    models : tuple of str, optional
        Exactly these, such as ``("N+K", "N+GM")``.
    weights : {"full", "diagonal"}
    default, probes : tuple of str
        Tried where no models are given, with what the shortest averaging times ask for; and those of them that tell.
    halves : (Moments, Moments), optional
        Of the halves of the log, to see what changes in it.
    white_sigma : float
        Relative 1-sigma uncertainty of white noise besides, by outliers that were replaced.

    Returns
    -------
    Selection

    Raises
    ------
    NoFitError
        If none of the models can be fitted.
    """
    listed = models is not None
    tried = tuple(models) if models is not None else default
    part, fits, departure = _first_that_pass(data, tried if listed else probes, listed, weights)
    if not listed:
        extra = _best_extra(fits)
        more = _with(extra, tried) + (tried[:_SIMPLE] if extra else ())
        fits |= _fitted(part, tuple(m for m in more if m not in fits), weights, departure)
    if not fits:
        raise NoFitError(f"none of the models {', '.join(tried)} can be fitted to this curve")
    order = sorted(fits, key=lambda name: (not _all_determined(fits[name]), _criterion(fits[name])))
    candidates = tuple(
        Candidate(" + ".join(parse_terms(n)), fits[n].misfit, fits[n].freedom, _criterion(fits[n])) for n in order
    )
    kept, left_out = fits[order[0]], len(data.m) - len(part.m)
    others = [(result, left_out) for result in fits.values()]
    others += _other_cuts(data, part, tried if listed else probes, weights, departure, listed)
    shortest = int(part.m[0])
    change: dict[str, float] = {}
    spread = spreads(kept, others, left_out)
    if halves is not None and (fitted := _refitted(kept, halves, shortest, weights, departure)) is not None:
        change = changes(kept, fitted)
        spread = widened(kept, spread, change)
    if white_sigma > 0.0 and "N" in kept.names:
        spread = widened(kept, spread, {"N": 2.0 * white_sigma})
    return Selection(kept, candidates, int(part.m[0]), departure, _passes(kept), spread, change)


def _refitted(
    kept: Fit, pair: tuple[Moments, Moments], shortest: int, weights: Weights, departure: float
) -> tuple[Fit, Fit] | None:
    """The model kept, fitted to both of a pair; None where one of them does not show all of its terms."""
    fits = []
    for data in pair:
        keep = data.m >= shortest
        part = Moments(data.m[keep], data.variance[keep], data.dt, data.lengths)
        try:
            fits.append(fit(part, kept.terms, weights, departure, kept))
        except NoFitError:
            return None
    return fits[0], fits[1]


def _other_cuts(
    data: Moments, part: Moments, models: tuple[str, ...], weights: Weights, departure: float, listed: bool
) -> list[tuple[Fit, int]]:
    """Fits with fewer of the shortest averaging times, or with a vibration there, and how many were left out."""
    result = []
    for cut, extra in _STAGES:
        keep = data.m >= cut
        if cut < max(part.m[0], 2) or (cut == part.m[0] and not extra) or (listed and extra) or keep.sum() < _FEWEST:
            continue
        fewer = Moments(data.m[keep], data.variance[keep], data.dt, data.lengths)
        left_out = len(data.m) - len(fewer.m)
        result += [(f, left_out) for f in _fitted(fewer, _with(extra, models), weights, departure).values()]
    return result


def _first_that_pass(
    data: Moments, models: tuple[str, ...], listed: bool, weights: Weights
) -> tuple[Moments, dict[str, Fit], float]:
    """Least departure, then fewest averaging times left out, with which one of the models passes."""
    fits: dict[str, Fit] = {}
    part = data
    for departure in _DEPARTURES:
        for cut, extra in _STAGES:
            keep = data.m >= cut
            if cut > 1 and ((listed and extra) or keep.sum() < _FEWEST):
                continue
            part = Moments(data.m[keep], data.variance[keep], data.dt, data.lengths)
            these = _with(extra, models)
            if cut == 1 and not listed:
                # the filter of a sensor shows at the first few samples only, rounding may hide white noise
                these += _with("+F", models) + _with("+Q", models) + _WITHOUT_N
            fits = _fitted(part, these, weights, departure)
            # what has been doctored must agree better than a log taken as it is
            level = 0.999 if cut == 1 and departure == 0.0 else 0.99
            if any(_passes(result, level) for result in fits.values()):
                return part, fits, departure
    return part, fits, departure


def _with(extra: str, models: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(model + extra for model in models)


def _best_extra(fits: dict[str, Fit]) -> str:
    """Term of the best model for the shortest averaging times: ``+F``, ``+Q`` or nothing."""
    best = min(fits, key=lambda name: _criterion(fits[name]), default="")
    return best[-2:] if best[-2:] in ("+F", "+Q") else ""


def _fitted(data: Moments, models: tuple[str, ...], weights: Weights, departure: float) -> dict[str, Fit]:
    result = {}
    for name in models:
        try:
            result[name] = fit(data, parse_terms(name), weights, departure)
        except NoFitError:
            continue
    return result


def _all_determined(result: Fit) -> bool:
    """Whether every parameter is known to a factor of e (1 sigma)."""
    return bool(result.sigma.max() < 1.0)


def _criterion(result: Fit) -> float:
    return result.misfit + _PRICE * len(result.names)


def _passes(result: Fit, level: float = 0.999) -> bool:
    from scipy.stats import chi2

    return bool(result.freedom > 0 and result.misfit < chi2.ppf(level, result.freedom))
