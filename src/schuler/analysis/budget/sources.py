"""Error sources of a mission: what is constant, what is noise, and the states they need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

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
START = tuple(f"{what}_{axis}" for what in ("attitude", "velocity", "position") for axis in ("north", "east", "down"))


@dataclass(frozen=True)
class Constant:
    """An error that does not change: its name, group, 1-sigma, and place.

    Attributes
    ----------
    name : str
        Such as ``b_a_x``, ``M_g_xy``, ``attitude_north``.
    group : str
        What it is counted with in short tables, such as ``accelerometer bias``.
    sigma : float
        SI
    block : str
        State block, empty for errors at the start.
    index : int
        Within the block, or among the nine navigation errors.
    field : (str, str) or None
        Triad and field of the specification it scales with.
    """

    name: str
    group: str
    sigma: float
    block: str
    index: int
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
        Of a process that adds to the bias.
    field : (str, str)
    """

    name: str
    group: str
    kind: Literal["white", "process"]
    triad: Literal["gyro", "accel"]
    density: float = 0.0
    model: StateModel | None = None
    field: tuple[str, str] = ("", "")


_GROUPS = {
    "b_a": "accelerometer bias", "b_g": "gyroscope bias", "S_a": "accelerometer scale factor",
    "S_g": "gyroscope scale factor", "M_a6": "accelerometer misalignment", "M_g": "gyroscope misalignment",
    "G_g": "gyroscope g-sensitivity",
}  # fmt: skip


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


def constants(spec: ImuSpec, start_sigma: np.ndarray) -> list[Constant]:
    """Constant errors: of the start, and of the IMU, one for each axis or pair of axes that has one."""
    found = [
        Constant(name, f"initial {name.split('_')[0]}", float(sigma), "", i)
        for i, (name, sigma) in enumerate(zip(START, start_sigma, strict=True))
        if sigma > 0.0
    ]
    for block, field in FIELDS.items():
        sigma = float(getattr(getattr(spec, field[0]), field[1]))
        if sigma > 0.0:
            for i, row in enumerate(BLOCKS[block]):
                found.append(Constant(constant_name(block, row), _GROUPS[block], sigma, block, i, field))
    return found


def noises(spec: ImuSpec) -> list[Noise]:
    """Noise sources of an IMU, all three axes together: white noise, in-run bias, bias instability, random walk."""
    found: list[Noise] = []
    for triad in ("gyro", "accel"):
        found += _noises(getattr(spec, triad), triad)
    return found


def _noises(t: TriadSpec, triad: Literal["gyro", "accel"]) -> list[Noise]:
    word = "gyroscope" if triad == "gyro" else "accelerometer"
    found = []
    if t.random_walk > 0.0:
        found.append(
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
        found.append(Noise(name, f"{word} {what}", "process", triad, 0.0, model, (triad, field)))
    return found


def constant_name(block: str, row: tuple[int, int, int]) -> str:
    """Name of a parameter as calibrations have it: ``b_a_x``, ``M_a_xx`` for a scale factor, ``M_g_xy``, ``G_g_xz``."""
    sensor, axis, source = row
    letter = "g" if sensor == 0 else "a"
    if source == 0:
        return f"b_{letter}_{AXES[axis]}"
    if sensor == 0 and source < 4:
        return f"G_g_{AXES[axis]}{AXES[source - 1]}"
    return f"M_{letter}_{AXES[axis]}{AXES[(source - 1) % 3]}"
