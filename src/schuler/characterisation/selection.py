"""Which noise terms a curve shows: several models are fitted, and the one that explains it with fewest parameters kept.

The criterion is ``misfit + 4 p``: another parameter must lower the weighted sum of squares by four, which chance does
about once in twenty cases. A sensor follows no sum of terms exactly; where the best of the models fails its chi-square
test, a relative departure is added to every averaging time, the smallest one with which it passes, and all models are
compared with that. It is reported, and the uncertainty of the parameters includes it.
"""

from __future__ import annotations

from dataclasses import dataclass

from schuler.characterisation.fitting import Fit, Moments, NoFitError, Weights, fit, parse_terms
from schuler.characterisation.result import Candidate

#: Tried in turn, each also with the sensor's filter (F) or quantisation (Q) if the shortest averaging times ask for it.
MODELS = (
    "N", "N+B", "N+K", "N+GM", "N+R", "N+B+K", "N+B+R", "N+K+R", "N+K+GM", "N+B+GM", "N+2GM", "N+K+2GM",
)  # fmt: skip
_PROBES = ("N", "N+B+K", "N+K+GM", "N+2GM")  # enough to tell what the shortest times and the departure ask for
_SIMPLE = 4  # so many of the first are tried without filter or quantisation even if richer ones ask for them
_PRICE = 4.0
_TYPICAL = 0.05  # departure with which models are compared before the real one is known
_DEPARTURES = (0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)


@dataclass(frozen=True)
class Selection:
    """The model kept, and what else was tried.

    Attributes
    ----------
    fit : Fit
    candidates : tuple of Candidate
        Best first.
    departure : float
        Relative 1-sigma by which the Allan variance departs from every model tried.
    fits : bool
        Whether the model passes its chi-square test with that departure.
    """

    fit: Fit
    candidates: tuple[Candidate, ...]
    departure: float
    fits: bool


def select(
    data: Moments,
    models: tuple[str, ...] | None = None,
    weights: Weights = "full",
    *,
    default: tuple[str, ...] = MODELS,
    probes: tuple[str, ...] = _PROBES,
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

    Returns
    -------
    Selection

    Raises
    ------
    NoFitError
        If none of the models can be fitted.
    """
    given = models is not None
    tried = tuple(models) if models is not None else default
    first = tried if given else tuple(p for extra in ("", "+F", "+Q") for p in _with(extra, probes))
    departure = 0.0
    fits = _fitted(data, first, weights, departure)
    if not any(_passes(found) for found in fits.values()):
        fits = _fitted(data, first, weights, _TYPICAL)
        extra = _best_extra(fits)
        kept = tuple(p for p in first if given or p in _with(extra, probes))
        for departure in _DEPARTURES:
            fits = _fitted(data, kept, weights, departure)
            if any(_passes(found) for found in fits.values()):
                break
    if not given:
        extra = _best_extra(fits)
        more = _with(extra, tried) + (tried[:_SIMPLE] if extra else ())
        fits |= _fitted(data, tuple(m for m in more if m not in fits), weights, departure)
    if not fits:
        raise NoFitError(f"none of the models {', '.join(tried)} can be fitted to this curve")
    order = sorted(fits, key=lambda name: _criterion(fits[name]))
    candidates = tuple(
        Candidate(" + ".join(parse_terms(n)), fits[n].misfit, fits[n].freedom, _criterion(fits[n])) for n in order
    )
    return Selection(fits[order[0]], candidates, departure, _passes(fits[order[0]]))


def _with(extra: str, models: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(model + extra for model in models)


def _best_extra(fits: dict[str, Fit]) -> str:
    """What the best of the models has for the shortest averaging times: ``+F``, ``+Q`` or nothing."""
    best = min(fits, key=lambda name: _criterion(fits[name]), default="")
    return best[-2:] if best[-2:] in ("+F", "+Q") else ""


def _fitted(data: Moments, models: tuple[str, ...], weights: Weights, departure: float) -> dict[str, Fit]:
    found = {}
    for name in models:
        try:
            found[name] = fit(data, parse_terms(name), weights, departure)
        except NoFitError:
            continue
    return found


def _criterion(found: Fit) -> float:
    return found.misfit + _PRICE * len(found.names)


def _passes(found: Fit) -> bool:
    from scipy.stats import chi2

    return bool(found.freedom > 0 and found.misfit < chi2.ppf(0.999, found.freedom))
