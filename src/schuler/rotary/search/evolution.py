"""Search for the schedule of rotation that is best for an IMU, a mission and a platform."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.rotary.platform_usage import usage, within
from schuler.rotary.search.families import Entries, Family, SchemeSpace, families, place_of, schedule_of
from schuler.rotary.search.named_schemes import named_schemes
from schuler.rotary.search.objective import SchemeObjective
from schuler.rotary.search.search_result import Candidate, SchemeSearch

#: Shares of the best scheme's travel at which the front is filled.
SHARES = (0.5, 0.2, 0.08, 0.03)
_FRONT = 0.3  # of all evaluations
_POLISH = 0.1
_WORST = 1e30  # stands for what a platform cannot do


@dataclass(frozen=True)
class SearchSettings:
    """How hard to look.

    Attributes
    ----------
    axes : int
        Number of the platform's axes: 1 or 2. With two, everything one can do is looked at too.
    families : tuple of str
        All if empty.
    evaluations : int
        Evaluations of the objective, besides the named schemes; roughly kept.
    seed : int
    threads : int
        Results are the same for any number.
    """

    axes: int = 1
    families: tuple[str, ...] = ()
    evaluations: int = 1500
    seed: int = 0
    threads: int = 2

    def __post_init__(self) -> None:
        if self.axes not in (1, 2) or self.evaluations < 50 or self.threads < 1:
            raise InputError("a search has 1 or 2 axes, 50 evaluations or more, and a thread")


@explains_arguments
def search_schemes(
    objective: SchemeObjective,
    space: SchemeSpace,
    settings: SearchSettings | None = None,
    *,
    extra: Sequence[tuple[str, Entries]] = (),
    progress: Callable[[float], None] | None = None,
) -> SchemeSearch:
    """Best schemes of rotation by one and by two axes, and the front of error against the platform's motion.

    Parameters
    ----------
    objective : SchemeObjective
    space : SchemeSpace
    settings : SearchSettings, optional
    extra : sequence of (name, entries)
        Schemes of one's own to be looked at with the named ones, such as that of a scenario.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    SchemeSearch
        Interrupted (Ctrl-C) it keeps what was found so far and says so.

    Raises
    ------
    InputError
        If no family is left, or the platform can follow none of all schemes.

    Notes
    -----
    First every named scheme is evaluated, so that what is found is never worse than one of them. Then each family is
    searched by differential evolution (Storn and Price 1997; SciPy's, seeded, choices by integrality): its first
    members are the named schemes of the family and a Latin hypercube. The continuous variables of the best are polished
    by the simplex of Nelder and Mead. For the front, the travel is limited to parts of the best scheme's, and the
    family that is best so far within the limit is searched again. All schedules looked at, within limits, make the
    front.

    A scheme that breaks a limit of the platform is not evaluated.

    Examples
    --------
    >>> from schuler.rotary import load_rotary
    >>> scenario = load_rotary("examples/rotary_static.toml")
    >>> search = schuler.search_schemes(
    ...     scenario.scheme_objective(), scenario.space(), scenario.settings(evaluations=50)
    ... )
    >>> len(search.best(1).toml()) > 0  # for [rotary.schedule] of a scenario
    True
    """
    settings = settings or SearchSettings()
    axes = min(settings.axes, space.limits.axes)
    archive = _Archive(objective, space, axes, settings.evaluations, progress)
    complete = True
    pool = ThreadPoolExecutor(settings.threads)
    try:
        named = [(n.name, n.entries, n.source) for n in named_schemes(space, axes)]
        named += [(name, entries, "own") for name, entries in extra]
        list(pool.map(lambda n: archive.named(*n), named))
        _search_families(archive, settings, axes, pool)
    except KeyboardInterrupt:
        complete = False
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    candidates = archive.ordered()
    if not any(np.isfinite(c.error) for c in candidates):
        raise InputError(
            "no scheme was evaluated that the platform can follow"
            + ("" if complete else " before the interruption")
            + (f"; {candidates[0].name}: {candidates[0].refused[0]}" if candidates and candidates[0].refused else "")
        )
    return SchemeSearch(
        objective.name, objective.unit, objective.scale, objective.spec.name, objective.turning.fixed.name,
        space.duration, axes, tuple(candidates), archive.count, complete, settings.seed,
    )  # fmt: skip


def _search_families(archive: _Archive, settings: SearchSettings, axes: int, pool: ThreadPoolExecutor) -> None:
    seeds = np.random.SeedSequence(settings.seed)
    todo = families(archive.space, axes, settings.families)
    if not todo:
        raise InputError("no family of schemes is left to search: choose others, or another platform")
    share = int(settings.evaluations * (1.0 - _FRONT - _POLISH))
    # families with more variables need more looks
    weight = np.sqrt([len(f.whole) for f in todo])
    for family, w in zip(todo, weight, strict=True):
        _evolve(archive, family, int(share * w / weight.sum()), seeds.spawn(1)[0], pool)
    for number in sorted({f.axes for f in todo}):
        _polish(archive, number, int(_POLISH * settings.evaluations))
    for number in sorted({f.axes for f in todo}):
        mine = [f for f in todo if f.axes == number]
        best = archive.best(number)
        if best is None or best.travel == 0.0:
            continue
        each = int(_FRONT * settings.evaluations / len(SHARES) / len({f.axes for f in todo}))
        for part in SHARES:
            capped = archive.best(number, part * best.travel)
            family = next((f for f in mine if capped is not None and f.name == capped.family), mine[-1])
            _evolve(archive, family, each, seeds.spawn(1)[0], pool, part * best.travel)


def _evolve(
    archive: _Archive,
    family: Family,
    evaluations: int,
    seed: np.random.SeedSequence,
    pool: ThreadPoolExecutor,
    travel: float = np.inf,
) -> None:
    """Differential evolution in one family, with a limit of the platform's travel. [rad]"""
    from scipy.optimize import differential_evolution

    n = len(family.whole)
    members = int(np.clip(2 * n, 8, max(evaluations // 4, 8)))
    rng = np.random.default_rng(seed)
    # a Latin hypercube, the best of the family so far first
    first = np.stack([(rng.permutation(members) + rng.random(members)) / members for _ in range(n)], axis=1)
    span = np.array([w - 1 if w else 1 for w in family.whole], dtype=np.float64)
    choice = np.array([w > 0 for w in family.whole])
    first = np.where(choice, np.minimum(np.floor(first * (span + 1.0)), span), first)
    seeded = [c.place for c in archive.front(family.name, travel) if c.place is not None][: members // 2]
    first[: len(seeded)] = np.array(seeded).reshape(-1, n)

    def cost(x: FloatArray) -> float:
        return archive.cost(family, np.where(choice, np.rint(x), x), travel)

    differential_evolution(
        cost, list(zip(np.zeros(n), np.maximum(span, 1e-9), strict=True)), init=first, integrality=choice,
        maxiter=max(evaluations // members - 1, 0), tol=1e-4, mutation=(0.4, 0.9), recombination=0.8, polish=False,
        updating="deferred", workers=pool.map, rng=rng,
    )  # fmt: skip


def _polish(archive: _Archive, axes: int, evaluations: int) -> None:
    """Move the continuous variables of the best scheme downhill."""
    from scipy.optimize import minimize

    best = archive.best(axes)
    if best is None or best.place is None:
        return
    family = next(f for f in families(archive.space, axes) if f.name == best.family)
    free = np.array([w == 0 for w in family.whole])
    start = np.array(best.place)
    if not free.any():
        return

    def cost(x: FloatArray) -> float:
        place = start.copy()
        place[free] = np.clip(x, 0.0, 1.0)
        return archive.cost(family, place, np.inf)

    simplex = np.tile(start[free], (int(free.sum()) + 1, 1))
    simplex[1:] += np.diag(np.where(start[free] < 0.5, 0.03, -0.03))
    minimize(cost, start[free], method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": simplex})


class _Archive:
    """Everything that was looked at; threads add to it."""

    def __init__(
        self,
        objective: SchemeObjective,
        space: SchemeSpace,
        axes: int,
        total: int,
        progress: Callable[[float], None] | None,
    ) -> None:
        self.objective, self.space, self.total, self.progress = objective, space, total, progress
        self.limits = replace(space.limits, axes=axes)
        self.candidates: dict[str, Candidate] = {}
        self.count = 0
        self.lock = threading.Lock()

    def cost(self, family: Family, place: FloatArray, travel: float) -> float:
        """Error of a member of a family; larger than any where it goes beyond a limit."""
        entries = family.entries(self.space, place)
        candidate = self._look(entries, family.name, family.name, "", tuple(float(v) for v in place))
        if candidate.refused:
            return _WORST
        if candidate.travel > travel:
            # downhill towards what is allowed
            return _WORST * 1e-3 * min(candidate.travel / travel, 1e3)
        return candidate.error

    def named(self, name: str, entries: Entries, source: str) -> Candidate:
        """A scheme with a name."""
        family, place = place_of(self.space, entries) or (str(entries["type"]), None)
        return self._look(entries, name, family, source, place)

    def best(self, axes: int, travel: float = np.inf) -> Candidate | None:
        """The best that needs so many axes, and travels no further."""
        allowed = [c for c in self.ordered() if c.axes == axes and c.travel <= travel and np.isfinite(c.error)]
        return min(allowed, key=lambda c: c.error, default=None)

    def front(self, family: str, travel: float) -> list[Candidate]:
        """Members of a family that go no further, the best first."""
        mine = [c for c in self.ordered() if c.family == family and c.travel <= travel and np.isfinite(c.error)]
        return sorted(mine, key=lambda c: c.error)

    def ordered(self) -> list[Candidate]:
        """In an order that does not depend on threads."""
        with self.lock:
            return [self.candidates[key] for key in sorted(self.candidates)]

    def _look(
        self, entries: Entries, name: str, family: str, source: str, place: tuple[float, ...] | None
    ) -> Candidate:
        key = json.dumps([source != "", name if source else "", entries], sort_keys=True)
        with self.lock:
            if key in self.candidates:
                return self.candidates[key]
        schedule = schedule_of(entries)
        used = usage(schedule, self.space.duration)
        limits = self.limits
        if np.isinf(limits.acceleration) or "acceleration_deg_s2" not in entries:
            limits = replace(limits, acceleration=np.inf)
        refused = tuple(within(schedule, limits, self.space.duration))
        error = np.inf if refused else self.objective.of(schedule)
        made = Candidate(
            name, family, source, len(schedule.axes), dict(entries), float(error), float(used.travel.sum()),
            int(used.reversals.sum()), refused, place,
        )  # fmt: skip
        with self.lock:
            if key not in self.candidates:  # two threads may have met at one scheme, and it counts once
                self.candidates[key] = made
                self.count += not refused
            done = min(self.count / self.total, 1.0)
        if self.progress is not None:
            self.progress(done)
        return made
