"""Linear covariance analysis: how uncertain a mission is, without data and without Monte Carlo."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.budget.replay import FilterReplay, System, records_at, replay_constants, replay_filter, replay_noise
from schuler.budget.scenario import BudgetMission
from schuler.budget.sources import Angles, Constant, Noise, constants, filter_layout, noises
from schuler.exceptions import InputError
from schuler.filtering.measurements import KINDS
from schuler.filtering.states import BLOCKS, StateLayout, StateModel
from schuler.plotting.notebook import Displayed
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.sensors.spec import ImuSpec

_RUN_BLOCK = {"gyro": "b_g_run", "accel": "b_a_run"}
#: How often the filter's own variance is exceeded before it is said to be over-confident.
BELIEVED = 1.1


@dataclass(frozen=True, repr=False)
class LinearCovariance(Displayed):
    """What a filter is really uncertain by, and what it believes.

    Attributes
    ----------
    t : ndarray, shape (r,)
        [s]
    P : ndarray, shape (r, 9, 9)
        True covariance of attitude, velocity, position errors, north, east, down.
    believed : ndarray, shape (r, 9, 9)
        The filter's own.
    names, groups : tuple of str
        Names of the sources, and the groups they are counted with.
    parts : ndarray, shape (sources, r, 9)
        1-sigma that each source contributes; squares add up to the diagonal of ``P``.
    imu, mission : str
    states : int
        Number of the filter's states.
    """

    t: FloatArray
    P: FloatArray
    believed: FloatArray
    names: tuple[str, ...]
    groups: tuple[str, ...]
    parts: FloatArray
    imu: str
    mission: str
    states: int

    @property
    def sigma(self) -> FloatArray:
        """True 1-sigma of the nine errors. Shape (r, 9)."""
        return np.asarray(np.sqrt(np.maximum(np.einsum("rii->ri", self.P), 0.0)))

    def quantity(self, name: str) -> FloatArray:
        """1-sigma over time of one of :data:`QUANTITIES`, in SI. Shape (r,)."""
        return quantity_sigma(self.P, name)

    def summary(self) -> str:
        """End of the mission, largest values, and whether the filter knows."""
        lines = [f"{self.mission}, {self.imu}, filter of {self.states} states: true 1-sigma"]
        for name, (_, unit, scale) in QUANTITIES.items():
            s = self.quantity(name) / scale
            b = quantity_sigma(self.believed, name) / scale
            note = "" if s[-1] < BELIEVED * b[-1] else f"; the filter believes {b[-1]:.3g} {unit}"
            lines.append(f"  {name:<11} {s[-1]:.4g} {unit} at the end, largest {s.max():.4g} {unit}{note}")
        return "\n".join(lines)

    def plot(self, mission: BudgetMission | None = None) -> Figure:
        """1-sigma of every quantity over time, true and believed (matplotlib); the mission shades its outages."""
        from schuler.budget.report import covariance_figure

        return covariance_figure(self, mission)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "mission": self.mission, "imu": self.imu, "states": self.states, "t_s": self.t.tolist(),
            **{name: self.quantity(name).tolist() for name in QUANTITIES},
        }  # fmt: skip


#: Name to (places among the nine errors, unit shown, SI in that unit). Two places: root of the sum of variances.
QUANTITIES: dict[str, tuple[tuple[int, ...], str, float]] = {
    "horizontal": ((6, 7), "m", 1.0), "vertical": ((8,), "m", 1.0), "position": ((6, 7, 8), "m", 1.0),
    "velocity": ((3, 4, 5), "m/s", 1.0), "heading": ((2,), "deg", DEG), "tilt": ((0, 1), "deg", DEG),
}  # fmt: skip


def quantity_sigma(P: FloatArray, name: str) -> FloatArray:
    """1-sigma of a quantity from covariances. Shapes (..., 9, 9) to (...)."""
    if name not in QUANTITIES:
        raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {name!r}")
    return np.asarray(np.sqrt(np.maximum(sum(P[..., i, i] for i in QUANTITIES[name][0]), 0.0)))


@explains_arguments
def linear_covariance(
    mission: BudgetMission,
    spec: ImuSpec,
    *,
    states: int | tuple[str, ...] | None = None,
    truth: ImuSpec | None = None,
    by_axis: bool = False,
    angles: Angles = "elements",
) -> LinearCovariance:
    """True and believed covariance of a filter through a mission, source by source.

    Parameters
    ----------
    mission : BudgetMission
    spec : ImuSpec
        Specification that the filter believes.
    states : int or tuple of str, optional
        States that the filter estimates; as the mission says by default.
    truth : ImuSpec, optional
        Specification of the real IMU; what the filter believes by default.
    by_axis : bool
        Noise of each axis by itself, in half as much time again; False: of each triad, the same total.
    angles : {"elements", "triad"}
        How misalignments are counted, see :func:`.sources.constants`.

    Returns
    -------
    LinearCovariance
        Its sources are every error of the truth, also those the filter has no states for.

    Notes
    -----
    The filter's gains are those of its own model. With them every source is carried through the mission by itself:
    constants as sensitivities, noise as covariances. In-run biases enter as what they are, Gauss-Markov, while the
    filter may model them as walks. White noise of an axis enters where the axis points, integrated over each interval;
    asymmetry and nonlinearity of accelerometers as constants that act by ``|f|`` and ``f^2`` of the true specific
    force. What is left out: linearisation errors, and gates.

    References
    ----------
    Gelb (1974), chapter 7 (suboptimal filters); Maybeck (1979), volume 1, chapter 6 (error budgets).

    Examples
    --------
    >>> from schuler.sensors import catalogue
    >>> mission = schuler.prepare_budget("examples/budget_town.toml")
    >>> print(schuler.linear_covariance(mission, catalogue.spec("MTi-G-710"), states=15).summary())
    town, GNSS lost for a minute, MTi-G-710, filter of 15 states: true 1-sigma
      horizontal  0.352 m at the end, largest 11.48 m
    ...
    """
    truth = truth or spec
    layout = filter_layout(spec, mission.states if states is None else states)
    node = records_at(mission.run, mission.times)
    P0 = np.diag(np.concatenate((mission.start_sigma**2, layout.initial_variances())))
    filtered = replay_filter(mission.run, layout, P0, spec.gyro.random_walk**2, spec.accel.random_walk**2, node)
    still, moving = _constants(mission, truth, angles), noises(truth, by_axis=by_axis)
    columns = _columns(mission, layout, filtered, still)
    total = columns @ np.swapaxes(columns, 1, 2)
    parts = [np.abs(columns[:, :, i]) for i in range(len(still))]
    names, groups = [c.name for c in still], [c.group for c in still]
    bare = _quiet(layout, [])
    for noise in moving:
        C = _noise_part(mission, filtered, bare, noise)
        total, parts = total + C, [*parts, _diagonal(C)]
        names, groups = [*names, noise.name], [*groups, noise.group]
    for kind in np.unique(mission.run.kind):
        measured = mission.run.kind == kind
        C = replay_noise(mission.run, System(bare, np.arange(layout.size)), filtered, measured=measured)
        total, parts = total + C, [*parts, _diagonal(C)]
        names, groups = [*names, f"{KINDS[int(kind)]}_noise"], [*groups, f"{KINDS[int(kind)]} measurements"]
    return LinearCovariance(
        filtered.t, total, filtered.P[:, :9, :9], tuple(names), tuple(groups), np.array(parts), truth.name,
        mission.name, layout.size,
    )  # fmt: skip


def true_covariance(mission: BudgetMission, spec: ImuSpec) -> FloatArray:
    """True covariance alone, all sources together: what a comparison of many IMUs needs. Shape (r, 9, 9)."""
    layout = filter_layout(spec, mission.states)
    node = records_at(mission.run, mission.times)
    P0 = np.diag(np.concatenate((mission.start_sigma**2, layout.initial_variances())))
    filtered = replay_filter(mission.run, layout, P0, spec.gyro.random_walk**2, spec.accel.random_walk**2, node)
    columns = _columns(mission, layout, filtered, _constants(mission, spec))
    total = columns @ np.swapaxes(columns, 1, 2)
    bare = _quiet(layout, [])
    # one process of each triad, white noise and measurements in one pass; further processes in passes of their own
    together: dict[str, StateModel] = {}
    alone: list[Noise] = []
    psd = {"gyro": 0.0, "accel": 0.0}
    for noise in noises(spec):
        if noise.model is None:
            psd[noise.triad] = noise.density**2
        elif _RUN_BLOCK[noise.triad] in together:
            alone.append(noise)
        else:
            together[_RUN_BLOCK[noise.triad]] = noise.model
    both = StateLayout(bare.models | together)
    C0 = np.zeros((both.size, both.size))
    for block, model in together.items():
        place = range(both[block].start, both[block].stop)
        C0[place, place] = model.sigma**2
    every = np.ones(len(mission.run.H), dtype=bool)
    total += replay_noise(
        mission.run, System(both, _rows(bare, both)), filtered, gyro_psd=psd["gyro"], accel_psd=psd["accel"], C0=C0,
        measured=every,
    )  # fmt: skip
    for noise in alone:
        total += _noise_part(mission, filtered, bare, noise)
    return np.asarray(total)


def _noise_part(mission: BudgetMission, filtered: FilterReplay, bare: StateLayout, noise: Noise) -> FloatArray:
    rows = np.arange(bare.size)
    if noise.kind == "white":
        gyro, accel = (noise.density**2 if noise.triad == triad else 0.0 for triad in ("gyro", "accel"))
        return replay_noise(
            mission.run, System(bare, rows), filtered, gyro_psd=gyro, accel_psd=accel, axis=noise.axis
        )  # fmt: skip
    assert noise.model is not None
    block = _RUN_BLOCK[noise.triad]
    layout = StateLayout(bare.models | {block: noise.model})
    C0 = np.zeros((layout.size, layout.size))
    part = layout[block]
    driven = None if noise.axis is None else part.start + noise.axis
    place = range(part.start, part.stop) if driven is None else [driven]
    C0[place, place] = noise.model.sigma**2
    return replay_noise(mission.run, System(layout, _rows(bare, layout)), filtered, C0=C0, driven=driven)


def _constants(mission: BudgetMission, spec: ImuSpec, angles: Angles = "elements") -> list[Constant]:
    return constants(
        spec, mission.start_sigma, asymmetry=mission.asymmetry, quadratic=mission.quadratic, angles=angles
    )  # fmt: skip


def _columns(mission: BudgetMission, layout: StateLayout, filtered: FilterReplay, still: list[Constant]) -> FloatArray:
    """Errors that the constants make, one column each; those that are no states come last. Shape (r, 9, c)."""
    quiet = _quiet(layout, still)
    X = np.zeros((quiet.size, len(still)))
    uneven = np.zeros((6, sum(c.block == "uneven" for c in still)))
    first = len(still) - uneven.shape[1]
    for i, c in enumerate(still):
        for place, weight in c.terms:
            if c.block == "uneven":
                uneven[place, i - first] = weight * c.sigma
            else:
                X[(quiet[c.block].start if c.block else 0) + place, i] = weight * c.sigma
    return replay_constants(mission.run, System(quiet, _rows(layout, quiet)), filtered, X, uneven)


def _quiet(layout: StateLayout, still: list[Constant]) -> StateLayout:
    """The filter's states and those of the constants it does not estimate, nothing moving by itself."""
    models = {name: replace(model, noise=0.0) for name, model in layout.models.items()}
    models |= {c.block: StateModel.constant(0.0) for c in still if c.block in BLOCKS and c.block not in models}
    return StateLayout(models)


def _rows(layout: StateLayout, system: StateLayout) -> np.ndarray:
    parts = [np.arange(system[name].start, system[name].stop) for name in layout.blocks]
    return np.concatenate(parts).astype(np.int64)


def _diagonal(C: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(np.einsum("rii->ri", C), 0.0)))
