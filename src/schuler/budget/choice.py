"""Which IMU is good enough: the catalogue ranked against a requirement, what limits each, and what would pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from os import cpu_count
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.budget.covariance import QUANTITIES, LinearCovariance, linear_covariance, true_covariance
from schuler.budget.requirements import Requirement
from schuler.budget.scenario import BudgetMission
from schuler.budget.sources import UNEVEN, constants, noises
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import ResultTable
from schuler.sensors.spec import ImuSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ORDER = {True: 0, None: 1, False: 2}
_PASSES = {True: "yes", False: "no", None: "unknown"}
Progress = Callable[[float], None]

_WORDS = {
    "random_walk": "noise", "bias_instability": "bias instability", "rate_random_walk": "rate random walk",
    "turn_on_bias": "turn-on bias", "in_run_bias": "in-run bias", "scale_factor": "scale factor",
    "misalignment": "misalignment", "g_sensitivity": "g-sensitivity", "asymmetry": "asymmetry",
    "quadratic": "nonlinearity",
}  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """One IMU against one requirement.

    Attributes
    ----------
    imu : str
    value : float
        Largest of ``factor`` sigma where the requirement counts. SI
    time : float
        When. [s]
    passes : bool
        With what is stated.
    unstated : tuple of str
        Specifications that the source leaves out and that count as zero here: the value is a lower bound.
    limited_by : str
        The specification that contributes most there, in words; empty if none contributes.
    share : float
        Its share of the variance there.
    """

    imu: str
    value: float
    time: float
    passes: bool
    unstated: tuple[str, ...] = ()
    limited_by: str = ""
    share: float = 0.0

    @property
    def certain(self) -> bool | None:
        """Whether it passes; None where only what is not stated could say that it does not."""
        return None if self.passes and self.unstated else self.passes


@dataclass(frozen=True)
class Bottleneck:
    """What limits an IMU.

    Attributes
    ----------
    imu : str
    field : str
        Triad and specification, such as ``gyro random_walk``.
    words : str
    present : float
        1-sigma or density, SI.
    share : float
        Share of the variance where the requirement is hardest.
    needed : float or None
        Value with which the requirement is met, all else as it is; None if no value of it alone is enough.
    reached : float
        The requirement's quantity with ``needed`` (or with zero), re-run. SI
    sensitivity : dict of str to float
        d ln(sigma) / d ln(specification) for every one.
    """

    imu: str
    field: str
    words: str
    present: float
    share: float
    needed: float | None
    reached: float
    sensitivity: dict[str, float]


@dataclass(frozen=True, repr=False)
class ImuChoice(Displayed):
    """The catalogue against a requirement.

    Attributes
    ----------
    mission : str
    requirement : Requirement
    verdicts : tuple of Verdict
        Those that pass, those of which that is unknown, those that do not; the best of each first.
    bottlenecks : dict of str to Bottleneck
        Limits of the IMUs asked about, by name.
    left_out : dict of str to str
        Entries that say too little, and why.
    """

    mission: str
    requirement: Requirement
    verdicts: tuple[Verdict, ...]
    bottlenecks: dict[str, Bottleneck]
    left_out: dict[str, str]

    def table(self) -> ResultTable:
        """All IMUs, best first."""
        _, unit, scale = QUANTITIES[self.requirement.quantity]
        rows = tuple(
            (
                v.imu, v.value / scale, v.time, _PASSES[v.certain], self.requirement.limit / v.value,
                f"{v.limited_by} ({100.0 * v.share:.0f} %)" if v.limited_by else "",
            )
            for v in self.verdicts
        )  # fmt: skip
        return ResultTable(
            f"{self.mission}: {self.requirement.text}",
            ("imu", f"value_{unit.replace('/', '_')}", "at_s", "passes", "margin", "limited_by"),
            rows,
            ("linear covariance, errors beyond the filter's states included; margin: bound over value",),
        )

    def summary(self) -> str:
        """The table, what limits those asked about, and what is not in it."""
        lines = [self.table().summary()]
        lines += [_bottleneck_sentence(b, self.requirement) for b in self.bottlenecks.values()]
        if bounds := [v.imu for v in self.verdicts if v.unstated]:
            lines.append(
                "lower bounds, turn-on bias or scale factor not being stated (give them in a file): "
                + ", ".join(bounds)
            )
        if self.left_out:
            lines.append(f"left out, too little is known: {', '.join(self.left_out)}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON. SI"""
        return {
            "mission": self.mission, "requirement": self.requirement.text,
            "ranking": [
                {
                    "imu": v.imu, "value": v.value, "time_s": v.time, "passes": v.certain,
                    "unstated": list(v.unstated), "limited_by": v.limited_by, "share": v.share,
                }
                for v in self.verdicts
            ],
            "bottlenecks": {
                name: {
                    "field": b.field, "present": b.present, "share": b.share, "needed": b.needed,
                    "reached": b.reached, "sensitivity": b.sensitivity,
                }
                for name, b in self.bottlenecks.items()
            },
            "left_out": self.left_out,
        }  # fmt: skip

    def plot(self) -> Figure:
        """Values of all IMUs beside the bound (matplotlib)."""
        from schuler.budget.report import choice_figure

        return choice_figure(self)


@explains_arguments
def choose_imu(
    mission: BudgetMission,
    requirement: Requirement,
    specs: Sequence[ImuSpec],
    *,
    explain: Sequence[str] = (),
    left_out: dict[str, str] | None = None,
    progress: Progress | None = None,
) -> ImuChoice:
    """Rank IMUs by a requirement, and say what limits each of them.

    Parameters
    ----------
    mission : BudgetMission
    requirement : Requirement
    specs : sequence of ImuSpec
    explain : sequence of str
        Names of which it is worked out what value of what limits them would pass; each takes a few re-runs.
    left_out : dict of str to str, optional
        Passed on.
    progress : callable, optional

    Returns
    -------
    ImuChoice

    Examples
    --------
    >>> from schuler.budget import requirement
    >>> from schuler.sensors import catalogue
    >>> mission = schuler.prepare_budget("examples/budget_town.toml")
    >>> bound = requirement("horizontal < 10 m @ 60 s outage")
    >>> print(schuler.choose_imu(mission, bound, [catalogue.spec(name) for name in ("MTi-G-710", "HG1900")]).summary())
    town, GNSS lost for a minute: horizontal < 10 m @ 60 s outage
    imu        value_m  at_s  passes  margin  limited_by
    HG1900        8.34   129  yes       1.20...
    MTi-G-710     11.5   129  no       0.871...
    ...
    """
    if not specs:
        raise InputError("specs: expected at least one IMU")
    from schuler.budget._replay_kernels import prepare_replay

    prepare_replay()

    def judged(spec: ImuSpec) -> Verdict:
        covariance = linear_covariance(mission, spec)
        value, time = requirement.worst(mission, covariance.P)
        shares = _shares(mission, requirement, spec, covariance, time)
        field = max(shares, key=lambda f: shares[f], default=None)
        limit = ("", 0.0) if field is None else (_in_words(field), shares[field])
        return Verdict(spec.name, value, time, value <= requirement.limit, unstated_values(spec), *limit)

    verdicts = []
    with ThreadPoolExecutor(cpu_count()) as pool:
        for k, verdict in enumerate(pool.map(judged, specs)):
            verdicts.append(verdict)
            if progress is not None:
                progress((k + 1) / len(specs))
    by_name = {spec.name: spec for spec in specs}
    unknown = [name for name in explain if name not in by_name]
    if unknown:
        raise InputError(f"explain: expected some of {', '.join(by_name)}, got {unknown[0]!r}")
    return ImuChoice(
        mission.name, requirement, tuple(sorted(verdicts, key=lambda v: (_ORDER[v.certain], v.value))),
        {name: bottleneck(mission, requirement, by_name[name]) for name in explain}, left_out or {},
    )  # fmt: skip


def unstated_values(spec: ImuSpec) -> tuple[str, ...]:
    """Specifications of an IMU of the catalogue that its source leaves out, and that are zero: unknown, not perfect."""
    from schuler.sensors import catalogue

    if spec.name not in catalogue.names():
        return ()
    fields = (text.partition(".") for text in catalogue.entry(spec.name).unstated)
    return tuple(f"{triad} {name}" for triad, _, name in fields if not getattr(getattr(spec, triad), name, 1.0))


def catalogue_specs() -> tuple[list[ImuSpec], dict[str, str]]:
    """Specifications of the catalogue that say enough for a budget, and why the others do not."""
    from schuler.sensors import catalogue

    specs, left_out = [], {}
    for name in catalogue.names():
        try:
            spec = catalogue.spec(name)
        except InputError as error:
            left_out[name] = str(error)
            continue
        if spec.gyro.random_walk > 0.0 and spec.accel.random_walk > 0.0:
            specs.append(spec)
        else:
            left_out[name] = "no random walk of both triads"
    return specs, left_out


def bottleneck(mission: BudgetMission, requirement: Requirement, spec: ImuSpec) -> Bottleneck:
    """The specification that contributes most where the requirement is hardest, and what value of it would pass.

    Notes
    -----
    The value is found by re-running the mission with the specification changed (a secant in its logarithm), since the
    filter's gains change with it. The sensitivity is that of the variance shares, gains unchanged: exact to first
    order for an optimal filter, whose variance does not change with its gains.
    """
    covariance = linear_covariance(mission, spec)
    value, time = requirement.worst(mission, covariance.P)
    shares = _shares(mission, requirement, spec, covariance, time)
    if not shares:
        raise InputError(f"{spec.name}: nothing in the specification contributes")
    field = max(shares, key=lambda f: shares[f])
    uneven = field[1] in UNEVEN
    present = float(getattr(mission if uneven else getattr(spec, field[0]), field[1]))

    def at(factor: float) -> float:
        given: dict[str, Any] = {field[1]: factor * present} if uneven else {}
        changed = replace(mission, **given)
        return requirement.worst(changed, true_covariance(changed, spec if uneven else scaled(spec, field, factor)))[0]

    needed, reached = None, value
    if value > requirement.limit:
        reached = at(1e-6)
        if reached <= requirement.limit:
            factor = _solve(at, requirement.limit, value, reached)
            needed, reached = factor * present, at(factor)
    else:
        needed = present
    words = _in_words(field)
    sensitivity = {f"{t} {f}": share for (t, f), share in sorted(shares.items(), key=lambda item: -item[1])}
    return Bottleneck(spec.name, f"{field[0]} {field[1]}", words, present, shares[field], needed, reached, sensitivity)


def scaled(spec: ImuSpec, field: tuple[str, str], factor: float) -> ImuSpec:
    """A specification with one number changed."""
    triad, name = field
    changed = replace(getattr(spec, triad), **{name: factor * getattr(getattr(spec, triad), name)})
    return replace(spec, **{triad: changed})


def _in_words(field: tuple[str, str]) -> str:
    """Triad and specification in words."""
    return f"{'gyroscope' if field[0] == 'gyro' else 'accelerometer'} {_WORDS[field[1]]}"


def _shares(
    mission: BudgetMission, requirement: Requirement, spec: ImuSpec, covariance: LinearCovariance, time: float
) -> dict[tuple[str, str], float]:
    """Shares of the specifications in the variance of a requirement's quantity at a time."""
    r = int(np.argmin(np.abs(covariance.t - time)))
    places = list(QUANTITIES[requirement.quantity][0])
    squares = np.sum(np.square(covariance.parts[:, r, places]), axis=1)
    share = squares / squares.sum()
    still = constants(spec, mission.start_sigma, asymmetry=mission.asymmetry, quadratic=mission.quadratic)
    fields = {c.name: c.field for c in still} | {n.name: n.field for n in noises(spec)}
    shares: dict[tuple[str, str], float] = {}
    for name, value in zip(covariance.names, share, strict=True):
        field = fields.get(name)
        if field is not None:
            shares[field] = shares.get(field, 0.0) + float(value)
    return shares


def _solve(at: Callable[[float], float], limit: float, value: float, floor: float) -> float:
    """Factor below one at which ``at`` meets the limit: bisection of its logarithm between bounds that bracket it."""
    low, high = 1e-6, 1.0
    # first guess as if the variance were a part that scales and one that does not
    guess = np.sqrt(max(limit**2 - floor**2, 1e-30) / max(value**2 - floor**2, 1e-30))
    x = float(np.clip(guess, 1e-5, 0.999))
    for _ in range(14):
        if at(x) <= limit:
            low = x
        else:
            high = x
        if high / low < 1.01:
            break
        x = float(np.sqrt(low * high))
    return low


def _bottleneck_sentence(b: Bottleneck, requirement: Requirement) -> str:
    _, unit, scale = QUANTITIES[requirement.quantity]
    head = f"{b.imu}: limited by {b.words} ({b.present:.3g} SI, {100.0 * b.share:.0f} % of the variance)"
    if b.needed is None:
        return f"{head}; no value of it alone is enough: without it {b.reached / scale:.3g} {unit}"
    if b.needed == b.present:
        return f"{head}; passes"
    return (
        f"{head}; {b.needed:.3g} SI ({b.needed / b.present:.2g} of it) would pass with {b.reached / scale:.3g} {unit}"
    )
