"""State layouts: named blocks, each with its stochastic model.

Nine navigation errors come first, always in this order: attitude ``dpsi``, velocity ``dv``, position ``dr``
(Earth-fixed axes inside, north-east-down wherever a person reads them). Behind them stand parameters, in any
selection and order: the sensor errors that act through the attitude, then everything else. Errors are
estimate minus truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.limits import MOST_CHANNELS
from schuler.sensors.spec import allan_minimum

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec, TriadSpec

NAVIGATION = ("dpsi", "dv", "dr")

_GYRO, _ACCEL, _OTHER = 0, 1, -1
_OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
_UPPER = ((0, 1), (0, 2), (1, 2))
_FAR_OFF = 10.0  # times its initial 1-sigma: what an IMU error can be found to be off by
_WALK_S, _FASTER_S = 100.0, 10.0  # of a bias instability: where its walk reaches it, and the decade below [s]

#: Rows (sensor, axis, regressor) of each kind of block: regressor 0 is time, 1-3 specific force, 4-6 angular rate.
BLOCKS: MappingProxyType[str, tuple[tuple[int, int, int], ...]] = MappingProxyType(
    {
        "b_a": tuple((_ACCEL, i, 0) for i in range(3)),
        "b_g": tuple((_GYRO, i, 0) for i in range(3)),
        "b_a_run": tuple((_ACCEL, i, 0) for i in range(3)),
        "b_g_run": tuple((_GYRO, i, 0) for i in range(3)),
        "S_a": tuple((_ACCEL, i, 1 + i) for i in range(3)),
        "S_g": tuple((_GYRO, i, 4 + i) for i in range(3)),
        "M_a": tuple((_ACCEL, i, 1 + j) for i, j in _UPPER),
        "M_a6": tuple((_ACCEL, i, 1 + j) for i, j in _OFF_DIAGONAL),
        "M_g": tuple((_GYRO, i, 4 + j) for i, j in _OFF_DIAGONAL),
        "G_g": tuple((_GYRO, i, 1 + j) for i in range(3) for j in range(3)),
        **{
            name: tuple((_OTHER, i, 0) for i in range(size))
            for name, size in (
                ("lever", 3),
                ("lever_v", 3),
                ("mount", 2),
                ("odometer", 1),
                ("clock", 1),
                ("clock_drift", 1),
                ("clock_2", 1),
                ("clock_3", 1),
                ("clock_4", 1),
                ("b_heading", 1),
                ("baro", 1),
                ("b_r", 3),
                ("b_v", 3),
                ("delay", 1),
                *((f"multipath_{i}", 1) for i in range(1, MOST_CHANNELS + 1)),
                *((f"ambiguity_{i}", 1) for i in range(1, MOST_CHANNELS + 1)),
            )
        },
    }
)
#: Slow errors of single satellites' ranges, channel by channel.
CHANNELS = tuple(f"multipath_{i}" for i in range(1, MOST_CHANNELS + 1))

#: Ambiguities of single satellites' carrier phases, likewise. No result shows either.
AMBIGUITIES = tuple(f"ambiguity_{i}" for i in range(1, MOST_CHANNELS + 1))

#: One line on each block, with its unit.
BLOCK_TEXT: MappingProxyType[str, tuple[str, str]] = MappingProxyType(
    {
        "dpsi": ("attitude error", "rad"),
        "dv": ("velocity error", "m/s"),
        "dr": ("position error", "m"),
        "b_a": ("accelerometer bias", "m/s^2"),
        "b_g": ("gyroscope bias", "rad/s"),
        "b_a_run": ("accelerometer in-run bias beside a constant one", "m/s^2"),
        "b_g_run": ("gyroscope in-run bias beside a constant one", "rad/s"),
        "S_a": ("accelerometer scale factor", "1"),
        "S_g": ("gyroscope scale factor", "1"),
        "M_a": ("accelerometer misalignment xy, xz, yz", "rad"),
        "M_a6": ("accelerometer cross-coupling xy, xz, yx, yz, zx, zy", "rad"),
        "M_g": ("gyroscope cross-coupling xy, xz, yx, yz, zx, zy", "rad"),
        "G_g": ("gyroscope g-sensitivity, row by row", "(rad/s)/(m/s^2)"),
        "lever": ("lever arm IMU to antenna, body axes", "m"),
        "lever_v": ("lever arm IMU to the point that does not slip or rests (axle, sole), body axes", "m"),
        "mount": ("pitch and yaw of the IMU axes in the vehicle", "rad"),
        "odometer": ("odometer scale factor", "1"),
        "clock": ("receiver clock offset, of the first satellite system", "m"),
        "clock_drift": ("receiver clock drift", "m/s"),
        "clock_2": ("clock of the second satellite system against the first", "m"),
        "clock_3": ("clock of the third satellite system against the first", "m"),
        "clock_4": ("clock of the fourth satellite system against the first", "m"),
        "b_heading": ("bias of the heading sensor", "rad"),
        "baro": ("bias of the barometric height", "m"),
        "b_r": ("correlated error of GNSS positions, north east down", "m"),
        "b_v": ("correlated error of GNSS velocities, north east down", "m/s"),
        "delay": ("time by which GNSS fixes belong to a later moment than their stamp", "s"),
        **dict.fromkeys(CHANNELS, ("slow error of one satellite's ranges, overhead", "m")),
        **dict.fromkeys(AMBIGUITIES, ("ambiguity of one satellite's carrier phase", "m")),
    }
)


@dataclass(frozen=True, slots=True)
class StateModel:
    """Stochastic model of the elements of one block: how uncertain at first, and how they move.

    Attributes
    ----------
    sigma : float
        Initial 1-sigma uncertainty. [unit]
    noise : float
        Root power spectral density of the driving white noise, zero for a constant. [unit/sqrt(s)]
    tau : float, optional
        Correlation time of a first-order Gauss-Markov process; None does not decay. [s]
    """

    sigma: float
    noise: float = 0.0
    tau: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma) and self.sigma >= 0.0 and np.isfinite(self.noise) and self.noise >= 0.0):
            raise InputError(
                f"StateModel: expected non-negative finite sigma and noise, got {self.sigma}, {self.noise}"
            )
        if self.tau is not None and not self.tau > 0.0:
            raise InputError(f"StateModel: expected a positive correlation time [s], got {self.tau}")

    @classmethod
    def constant(cls, sigma: float) -> StateModel:
        """A random constant."""
        return cls(sigma)

    @classmethod
    def random_walk(cls, sigma: float, noise: float) -> StateModel:
        """A random walk: variance grows by ``noise**2`` a second."""
        return cls(sigma, noise)

    @classmethod
    def gauss_markov(cls, sigma: float, tau: float, initial_sigma: float | None = None) -> StateModel:
        """First-order Gauss-Markov process of stationary ``sigma`` and correlation time ``tau`` [s]."""
        return cls(sigma if initial_sigma is None else initial_sigma, sigma * float(np.sqrt(2.0 / tau)), tau)

    def describe(self) -> str:
        """Phrase for summaries, numbers in the unit of the block."""
        if self.tau is not None:
            return f"Gauss-Markov, tau {self.tau:g} s, driving noise {self.noise:.3g}, initial 1-sigma {self.sigma:.3g}"
        if self.noise > 0.0:
            return f"random walk {self.noise:.3g}/sqrt(s), initial 1-sigma {self.sigma:.3g}"
        return f"random constant, 1-sigma {self.sigma:.3g}"


@dataclass(frozen=True)
class StateLayout:
    """Names, order and models of the states behind the nine navigation errors.

    Attributes
    ----------
    models : dict of str to StateModel
        Blocks in use, in any order; keys of :data:`BLOCKS`. Sensor blocks are moved before the others.

    Examples
    --------
    >>> layout = StateLayout({"b_a": StateModel.constant(0.01), "b_g": StateModel.constant(1e-4)})
    >>> layout.size, layout["b_g"]
    (15, slice(12, 15, None))
    """

    models: dict[str, StateModel]
    _slices: dict[str, slice] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        from schuler.filtering.limits import MAX_STATES

        unknown = [name for name in self.models if name not in BLOCKS]
        if unknown:
            raise InputError(f"unknown state block {unknown[0]!r}; known are {', '.join(BLOCKS)}")
        for numbered in (CHANNELS, AMBIGUITIES):
            channels = [name for name in self.models if name in numbered]
            if channels != list(numbered[: len(channels)]):
                raise InputError(f"channels of satellites are numbered from 1 without a gap, got {', '.join(channels)}")
        if "M_a" in self.models and "M_a6" in self.models:
            raise InputError("M_a and M_a6 are two gauges of the same accelerometer cross-coupling: use one of them")
        if ("clock" in self.models) != ("clock_drift" in self.models):
            raise InputError("clock and clock_drift go together: give both or none")
        # sensor blocks first, then as given, but the drift behind its clock, and channels of satellites last
        places = {name: i for i, name in enumerate(self.models)}
        places["clock_drift"] = places.get("clock", 0)
        ordered = sorted(
            self.models,
            key=lambda name: (
                BLOCKS[name][0][0] == _OTHER,
                name in AMBIGUITIES,
                name in CHANNELS,
                places[name],
                name == "clock_drift",
            ),
        )
        object.__setattr__(self, "models", {name: self.models[name] for name in ordered})
        slices = {name: slice(3 * i, 3 * i + 3) for i, name in enumerate(NAVIGATION)}
        position = 9
        for name in ordered:
            slices[name] = slice(position, position + len(BLOCKS[name]))
            position += len(BLOCKS[name])
        if position > MAX_STATES:
            raise InputError(f"a filter holds at most {MAX_STATES} states, this layout has {position}")
        object.__setattr__(self, "_slices", slices)

    def __getitem__(self, name: str) -> slice:
        if name not in self._slices:
            raise InputError(f"no state block {name!r} in this layout; it has {', '.join(self._slices)}")
        return self._slices[name]

    def __contains__(self, name: str) -> bool:
        return name in self._slices

    @property
    def size(self) -> int:
        """Number of states, navigation included."""
        return 9 + sum(len(BLOCKS[name]) for name in self.models)

    @property
    def n_sensor(self) -> int:
        """Number of sensor parameters, which come first among the parameters."""
        return sum(len(BLOCKS[name]) for name in self.models if BLOCKS[name][0][0] != _OTHER)

    @property
    def names(self) -> list[str]:
        """A name for every state, such as ``b_g[0]``."""
        return [f"{block}[{i}]" for block, part in self._slices.items() for i in range(part.stop - part.start)]

    @property
    def blocks(self) -> list[str]:
        """Names of the blocks in order, navigation included."""
        return list(self._slices)

    @property
    def visible(self) -> StateLayout:
        """The same layout less channels of satellites, which stand last: what a result shows."""
        hidden = {*CHANNELS, *AMBIGUITIES}
        if hidden.isdisjoint(self.models):
            return self
        return StateLayout({name: model for name, model in self.models.items() if name not in hidden})

    def table(self) -> IntArray:
        """(m, 3): sensor, axis and regressor of every parameter, as the kernels take it."""
        rows = [row for name in self.models for row in BLOCKS[name]]
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    def dynamics(self) -> FloatArray:
        """(m, 2): inverse correlation time [1/s] and noise density [unit^2/s] of every parameter."""
        rows = [
            (0.0 if model.tau is None else 1.0 / model.tau, model.noise**2)
            for name, model in self.models.items()
            for _ in BLOCKS[name]
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 2)

    def initial_variances(self) -> FloatArray:
        """(m,) initial variance of every parameter."""
        rows = [model.sigma**2 for name, model in self.models.items() for _ in BLOCKS[name]]
        return np.array(rows, dtype=np.float64)

    def largest_variances(self) -> FloatArray:
        """(n,) variances to which those of a filter that is found wrong may be enlarged at most.

        An attitude's is a radian's, an IMU error's ten times its initial 1-sigma; position, velocity and the clocks of
        a receiver have no bound. States of others are not enlarged: zero.
        """
        most = np.zeros(self.size)
        most[:3], most[3:9] = 1.0, np.inf
        most[9 : 9 + self.n_sensor] = _FAR_OFF**2 * self.initial_variances()[: self.n_sensor]
        for name in self.models:
            if name.startswith("clock"):
                most[self[name]] = np.inf
        return most

    def values(self, **blocks: ArrayLike) -> FloatArray:
        """Parameter vector (m,) from values by block; blocks left out are zero."""
        vector = np.zeros(self.size - 9)
        for name, value in blocks.items():
            part = self[name]
            if part.stop <= 9:
                raise InputError(f"{name} is a navigation block; parameters are {', '.join(self.models)}")
            vector[part.start - 9 : part.stop - 9] = as_floats(value, name, (part.stop - part.start,))
        return vector

    def to_dict(self) -> dict[str, Any]:
        """For provenance."""
        return {name: {"sigma": m.sigma, "noise": m.noise, "tau": m.tau} for name, m in self.models.items()}


#: Blocks of the layouts that are named by their number of states.
_NAMED: dict[int, tuple[str, ...]] = {
    9: (),
    15: ("b_a", "b_g"),
    21: ("b_a", "b_g", "S_a", "S_g"),
    27: ("b_a", "b_g", "S_a", "S_g", "b_a_run", "b_g_run"),
    33: ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g"),
    39: ("b_a", "b_g", "S_a", "S_g", "M_a", "M_g", "G_g"),
    42: ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g"),
}


def block_names(states: int | Sequence[str]) -> tuple[str, ...]:
    """Blocks of a layout by its number of states, or as they are named.

    Parameters
    ----------
    states : {9, 15, 21, 27, 33, 39, 42} or sequence of str

    Raises
    ------
    InputError
        If no layout has that many states.
    """
    if not isinstance(states, int):
        return tuple(states)
    if states not in _NAMED:
        raise InputError(f"states: expected one of {', '.join(map(str, _NAMED))} or block names, got {states}")
    return _NAMED[states]


@explains_arguments
def layout_for(spec: ImuSpec, states: int | tuple[str, ...] = 15) -> StateLayout:
    """State layout that fits an IMU's error budget.

    Parameters
    ----------
    spec : ImuSpec
        1-sigma error budget, SI.
    states : {9, 15, 21, 27, 33, 39, 42} or tuple of str
        15: both biases; 21: and scale factors; 27: and in-run biases beside the constant ones; 33: 21 and
        cross-coupling (6 + 6); 42: and g-sensitivity; 39: the same with M_a upper triangular (3 + 6), Yaman's states.
        Or the block names themselves.

    Returns
    -------
    StateLayout

    Notes
    -----
    A bias that has a turn-on part and wanders is modelled as a random walk from the turn-on uncertainty, with the
    short-term growth of the wander (``sigma sqrt(2 / tau)``, or K). A Gauss-Markov model would pull the estimate of the
    turn-on part to zero with its correlation time; with 27 states both parts are modelled as what they are. A bias
    instability B has no model of finite order: its walk is chosen to reach the flat 0.664 B of the Allan deviation at
    100 s, and the wander over a run, 1.9 B, goes into the initial uncertainty. At shorter times the walk is too little
    of it: where no in-run bias is stated, ``b_a_run`` and ``b_g_run`` are the process of 10 s of the sum that makes
    such noise (:func:`schuler.sensors.noise.flicker`).

    References
    ----------
    39 states: Yaman (2017), section 4.3, eq. (4-6).
    """
    blocks = block_names(states)
    models = {}
    for name in blocks:
        if name not in BLOCKS:
            raise InputError(f"unknown state block {name!r}; known are {', '.join(BLOCKS)}")
        triad = spec.gyro if BLOCKS[name][0][0] == _GYRO else spec.accel
        model = _model(name, triad, separate=f"{name}_run" in blocks or name.endswith("_run"))
        if model.sigma == model.noise == 0.0:
            raise InputError(
                f"the state block {name} ({BLOCK_TEXT[name][0]}) has nothing to estimate: the error budget of "
                f"{spec.name} has zero for it; complete the budget, give the block a model, or use fewer states"
            )
        models[name] = model
    return StateLayout(models)


def _model(name: str, triad: TriadSpec, *, separate: bool) -> StateModel:
    if name.endswith("_run"):
        if triad.in_run_time:
            return StateModel.gauss_markov(triad.in_run_bias, triad.in_run_time)
        if not triad.bias_instability:
            raise InputError(
                f"{name} needs an in-run bias with its correlation time, or a bias instability, in the specification"
            )
        return StateModel.gauss_markov(triad.bias_instability * float(np.sqrt(np.log(10.0) / np.pi)), _FASTER_S)
    if name in ("b_a", "b_g"):
        wander = 0.0 if separate or not triad.in_run_time else triad.in_run_bias
        walks = [triad.rate_random_walk, allan_minimum(triad.bias_instability) * np.sqrt(3.0 / _WALK_S)]
        if wander:
            walks.append(wander * np.sqrt(2.0 / triad.in_run_time))
        sigmas = [triad.turn_on_bias, wander, 1.9 * triad.bias_instability]
        return StateModel(float(np.linalg.norm(sigmas)), float(np.linalg.norm(walks)))
    if name in ("S_a", "S_g"):
        return StateModel.constant(triad.scale_factor)
    if name in ("M_a", "M_a6", "M_g"):
        return StateModel.constant(triad.misalignment)
    if name == "G_g":
        return StateModel.constant(triad.g_sensitivity)
    raise InputError(
        f"an IMU's error budget says nothing about {name}: give it a StateModel "
        f"(in a configuration, filter.models.{name})"
    )
