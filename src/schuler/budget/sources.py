"""Error sources of a mission: what is constant, what is noise, and the states they need."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.states import BLOCKS, StateLayout, StateModel, layout_for
from schuler.sensors.spec import allan_minimum

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec, TriadSpec

AXES = "xyz"
#: Blocks a filter may estimate, by number of states; those an IMU has no uncertainty for are left out.
FILTERS: dict[int, tuple[str, ...]] = {
    9: (),
    15: ("b_a", "b_g"),
    21: ("b_a", "b_g", "S_a", "S_g"),
    33: ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g"),
    42: ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g"),
}
#: Field of the specification behind each block of constants.
FIELDS = {
    "b_a": ("accel", "turn_on_bias"), "b_g": ("gyro", "turn_on_bias"), "S_a": ("accel", "scale_factor"),
    "S_g": ("gyro", "scale_factor"), "M_a6": ("accel", "misalignment"), "M_g": ("gyro", "misalignment"),
    "G_g": ("gyro", "g_sensitivity"),
}  # fmt: skip
#: Constants of accelerometers that no filter estimates, in the order of ``Linearised.uneven``. [-], [1/(m/s^2)]
UNEVEN = ("asymmetry", "quadratic")
START = tuple(f"{what}_{axis}" for what in ("attitude", "velocity", "position") for axis in ("north", "east", "down"))


@dataclass(frozen=True)
class Constant:
    """An error that does not change: its name, group, 1-sigma, and place.

    Attributes
    ----------
    name : str
        Such as ``b_a_x``, ``M_g_xy``, ``attitude_north``, ``accel_quadratic_x``.
    group : str
        Group in short tables, such as ``accelerometer bias``.
    sigma : float
        SI
    block : str
        State block, empty for errors at the start, ``uneven`` for those of :data:`UNEVEN`.
    terms : tuple of (int, float)
        Places within the block, or among the nine navigation errors, or among six uneven ones, and weights there.
    field : (str, str) or None
        Triad and field of the specification it scales with; those of :data:`UNEVEN` are fields of the mission.
    """

    name: str
    group: str
    sigma: float
    block: str
    terms: tuple[tuple[int, float], ...]
    field: tuple[str, str] | None = None


@dataclass(frozen=True)
class Noise:
    """An error that is driven by noise.

    Attributes
    ----------
    name : str
    group : str
    kind : {"white", "process"}
    triad : {"gyro", "accel"}
    density : float
        Root density of white noise. SI
    model : StateModel or None
        Model of a process that adds to the bias.
    field : (str, str)
    axis : int or None
        Axis of the body; None is all three.
    """

    name: str
    group: str
    kind: Literal["white", "process"]
    triad: Literal["gyro", "accel"]
    density: float = 0.0
    model: StateModel | None = None
    field: tuple[str, str] = ("", "")
    axis: int | None = None


Angles: TypeAlias = Literal["elements", "triad"]

_GROUPS = {
    "b_a": "accelerometer bias", "b_g": "gyroscope bias", "S_a": "accelerometer scale factor",
    "S_g": "gyroscope scale factor", "M_a6": "accelerometer misalignment", "M_g": "gyroscope misalignment",
    "G_g": "gyroscope g-sensitivity",
}  # fmt: skip
# pairs among the elements xy, xz, yx, yz, zx, zy: their difference is the triad turned, their sum axes that lean
_TURNED = (("x", 3, 5), ("y", 4, 1), ("z", 0, 2))


def filter_layout(spec: ImuSpec, states: int | tuple[str, ...]) -> StateLayout:
    """What a filter of so many states estimates of an IMU: blocks without any uncertainty are left out."""
    if isinstance(states, int):
        if states not in FILTERS:
            raise InputError(f"states: expected one of {', '.join(map(str, FILTERS))} or block names, got {states}")
        states = FILTERS[states]
    models: dict[str, StateModel] = {}
    for name in states:
        try:
            models |= layout_for(spec, (name,)).models
        except InputError:
            if name not in FIELDS:
                raise
    return StateLayout(models)


def constants(
    spec: ImuSpec,
    start_sigma: np.ndarray,
    *,
    asymmetry: float = 0.0,
    quadratic: float = 0.0,
    angles: Angles = "elements",
) -> list[Constant]:
    """Constant errors: of the start, and of the IMU, one for each axis or pair of axes that has one.

    Parameters
    ----------
    spec : ImuSpec
    start_sigma : ndarray, shape (9,)
    asymmetry, quadratic : float
        1-sigma of SFA [-] and SFN [1/(m/s^2)] of accelerometers, which a specification has no field for.
    angles : {"elements", "triad"}
        Misalignment as elements xy ... of M, or for each axis as a triad that is turned about it and two sensing axes
        that lean to each other, each ``1 / sqrt(2)`` of an element: the same covariance, other names.

    Raises
    ------
    InputError
        If a value is negative or not finite, or ``angles`` is another word.

    References
    ----------
    Flenniken (2005), eqs. (6.1)-(6.15), Table 6.1.
    """
    for what, size in zip(UNEVEN, (asymmetry, quadratic), strict=True):
        if not (np.isfinite(size) and size >= 0.0):
            raise InputError(f"{what}: expected a 1-sigma value, zero or more, got {size!r}")
    sources = [
        Constant(name, f"initial {name.split('_')[0]}", float(sigma), "", ((i, 1.0),))
        for i, (name, sigma) in enumerate(zip(START, start_sigma, strict=True))
        if sigma > 0.0
    ]
    if angles not in ("elements", "triad"):
        raise InputError(f"angles: expected 'elements' or 'triad', got {angles!r}")
    for block, field in FIELDS.items():
        sigma = float(getattr(getattr(spec, field[0]), field[1]))
        if sigma > 0.0:
            for name, terms in _parameters(block, angles):
                sources.append(Constant(name, _GROUPS[block], sigma, block, terms, field))
    for k, (what, sigma) in enumerate(zip(UNEVEN, (asymmetry, quadratic), strict=True)):
        if sigma > 0.0:
            for i, axis in enumerate(AXES):
                group = f"accelerometer {'asymmetry' if k == 0 else 'nonlinearity'}"
                terms = ((3 * k + i, 1.0),)
                sources.append(Constant(f"accel_{what}_{axis}", group, sigma, "uneven", terms, ("accel", what)))
    return sources


def noises(spec: ImuSpec, *, by_axis: bool = False) -> list[Noise]:
    """Noise sources of an IMU: white noise, in-run bias, bias instability, random walk; of each triad or each axis."""
    sources: list[Noise] = []
    for triad in ("gyro", "accel"):
        sources += _noises(getattr(spec, triad), triad)
    if not by_axis:
        return sources
    return [replace(one, name=f"{one.name}_{letter}", axis=i) for one in sources for i, letter in enumerate(AXES)]


def _parameters(block: str, angles: Angles) -> list[tuple[str, tuple[tuple[int, float], ...]]]:
    """Names of a block's constants, and what each is made of."""
    if angles == "elements" or block not in ("M_a6", "M_g"):
        return [(constant_name(block, row), ((i, 1.0),)) for i, row in enumerate(BLOCKS[block])]
    triad, half = ("gyro" if block == "M_g" else "accel"), float(np.sqrt(0.5))
    parameters: list[tuple[str, tuple[tuple[int, float], ...]]] = []
    for what, sign in (("misalignment", -1.0), ("non_orthogonality", 1.0)):
        parameters += [(f"{triad}_{what}_{axis}", ((i, half), (j, sign * half))) for axis, i, j in _TURNED]
    return parameters


def _noises(t: TriadSpec, triad: Literal["gyro", "accel"]) -> list[Noise]:
    word = "gyroscope" if triad == "gyro" else "accelerometer"
    sources = []
    if t.random_walk > 0.0:
        sources.append(
            Noise(f"{triad}_noise", f"{word} noise", "white", triad, t.random_walk, None, (triad, "random_walk"))
        )
    processes = []
    if t.in_run_bias > 0.0:
        processes.append(("in-run bias", "in_run_bias", StateModel.gauss_markov(t.in_run_bias, t.in_run_time)))
    if t.bias_instability > 0.0:
        # no model of finite order: as in a filter's layout, a walk that reaches the flat part at 100 s
        walk = allan_minimum(t.bias_instability) * float(np.sqrt(3.0 / 100.0))
        model = StateModel.random_walk(1.9 * t.bias_instability, walk)
        processes.append(("bias instability", "bias_instability", model))
    if t.rate_random_walk > 0.0:
        processes.append(("rate random walk", "rate_random_walk", StateModel.random_walk(0.0, t.rate_random_walk)))
    for what, field, model in processes:
        name = f"{triad}_{what.replace(' ', '_').replace('-', '_')}"
        sources.append(Noise(name, f"{word} {what}", "process", triad, 0.0, model, (triad, field)))
    return sources


def constant_name(block: str, row: tuple[int, int, int]) -> str:
    """Name of a parameter as calibrations have it: ``b_a_x``, ``M_a_xx`` for a scale factor, ``M_g_xy``, ``G_g_xz``."""
    sensor, axis, source = row
    letter = "g" if sensor == 0 else "a"
    if source == 0:
        return f"b_{letter}_{AXES[axis]}"
    if sensor == 0 and source < 4:
        return f"G_g_{AXES[axis]}{AXES[source - 1]}"
    return f"M_{letter}_{AXES[axis]}{AXES[(source - 1) % 3]}"
