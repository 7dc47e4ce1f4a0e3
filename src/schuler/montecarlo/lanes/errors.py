"""What is wrong with the IMUs of a Monte Carlo campaign in lanes: constants of a run, processes, white noise."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import exp, expm1, sqrt
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.error_model import sensor_matrices
from schuler.filtering.states import BLOCKS, StateLayout
from schuler.sensors.errors import Gauge, ImuErrors
from schuler.sensors.noise import (
    Flicker,
    GaussMarkov,
    NoiseModel,
    Process,
    Ramp,
    RandomConstant,
    RandomWalk,
    Start,
    noise_model,
)
from schuler.sensors.spec import ImuSpec, TriadSpec

_SENSORS = ("gyro", "accel")
_BIASES = ("b_g", "b_a")


class InRun(NamedTuple):
    """A bias that wanders by ``x <- e x + drive n + slope`` from sample to sample, each axis for itself.

    Attributes
    ----------
    sensor : {0, 1}
        0 gyroscopes, 1 accelerometers.
    e, drive : float
    start, slope : float
        Standard deviations of the first value, and of a slope drawn once a run and axis [per sample].
    fixed_slope : bool
        True: the slope is that value, with its sign.
    block : str, optional
        State block it counts to; None leaves it to the layout: ``b_g_run`` where there is one, else ``b_g``.
    """

    sensor: int
    e: float
    drive: float
    start: float
    slope: float = 0.0
    fixed_slope: bool = False
    block: str | None = None


class DrawnErrors(NamedTuple):
    """One run's constants: b_g, b_a, M_g, M_a, G_g (33) and its processes' first values and slopes, shape (k, 3)."""

    constants: FloatArray
    starts: FloatArray
    slopes: FloatArray


@dataclass(frozen=True)
class LaneErrors:
    """Errors of the IMUs of a campaign; use one of the constructors.

    Attributes
    ----------
    source : ImuSpec, ImuErrors or StateLayout
        Where the constants come from: drawn from an error budget, the same in every run, or drawn from the filter's own
        initial uncertainties.
    dt : float
        Sampling interval. [s]
    white : ndarray, shape (6,)
        Root densities N of gyroscopes and accelerometers by axis. [rad/sqrt(s)], [m/s/sqrt(s)]
    processes : tuple of InRun
    gauge : {"full", "lower", "upper"}
        See :meth:`schuler.sensors.errors.ImuErrors.draw`.
    """

    source: ImuSpec | ImuErrors | StateLayout
    dt: float
    white: FloatArray
    processes: tuple[InRun, ...] = ()
    gauge: Gauge = "full"

    @classmethod
    def of_spec(
        cls,
        spec: ImuSpec,
        rate_hz: float,
        samples: int,
        *,
        gauge: Gauge = "full",
        start: Start = "stationary",
        left_out: Collection[str] = (),
    ) -> LaneErrors:
        """IMUs of the kind that a specification describes, a new one in every run.

        Parameters
        ----------
        spec : ImuSpec
        rate_hz : float
            Sampling rate. [Hz]
        samples : int
            Length of a run: the band of a bias instability follows it, as in :class:`schuler.sensors.noise.Flicker`,
            which takes about a dozen processes and half as much time again as all the rest.
        gauge, start
            See :meth:`schuler.sensors.errors.ImuErrors.draw`.
        left_out : collection of str
            Terms of the specification to do without, by the names of :class:`schuler.sensors.spec.TriadSpec`. Lanes
            neither clip nor round: a specification with "range", "resolution" or "quantisation" is refused unless they
            are named here.

        Raises
        ------
        InputError
            If the specification has a term that lanes do not have and that is not left out.
        """
        clean = {}
        for sensor in _SENSORS:
            triad: TriadSpec = getattr(spec, sensor)
            missing = [n for n in ("range", "resolution", "quantisation") if getattr(triad, n) and n not in left_out]
            if missing:
                raise InputError(
                    f"{spec.name}, {sensor}: runs in lanes neither clip nor round, but it has a "
                    f"{' and a '.join(missing)}; leave it out knowingly (left_out={tuple(missing)!r}) or use the engine"
                )
            kept = {k: v for k, v in triad.to_dict().items() if k not in left_out}
            if "in_run_bias" in left_out or "in_run_time" in left_out:
                kept = {k: v for k, v in kept.items() if not k.startswith("in_run")}
            clean[sensor] = TriadSpec.from_dict({"random_walk": 0.0} | kept)
        spec = ImuSpec(spec.name, clean["gyro"], clean["accel"], spec.rate_hz, spec.source)
        noise = (noise_model(spec.gyro, start), noise_model(spec.accel, start))
        return cls(spec, 1.0 / rate_hz, _white(noise), _in_run(noise, 1.0 / rate_hz, samples), gauge)

    @classmethod
    def of_imu(cls, errors: ImuErrors, rate_hz: float, samples: int) -> LaneErrors:
        """The same IMU in every run; only noise and in-run biases are drawn. Parameters as for :meth:`of_spec`.

        Raises
        ------
        InputError
            If it clips, rounds, or has a noise term without a first-order recursion.
        """
        for name in ("range", "resolution", "quantum"):
            for sensor in _SENSORS:
                if getattr(errors, f"{sensor}_{name}") is not None:
                    raise InputError(f"{sensor}_{name}: runs in lanes neither clip nor round; set it to None")
        noise = (errors.gyro_noise, errors.accel_noise)
        return cls(errors, 1.0 / rate_hz, _white(noise), _in_run(noise, 1.0 / rate_hz, samples))

    @classmethod
    def of_layout(cls, layout: StateLayout, gyro_n: ArrayLike, accel_n: ArrayLike, rate_hz: float) -> LaneErrors:
        """What the filter believes of the IMU: every parameter drawn from its own model, for consistency checks.

        Parameters
        ----------
        layout : StateLayout
        gyro_n, accel_n : array_like, shape (3,)
            Root densities N of the white noise. [rad/sqrt(s)], [m/s/sqrt(s)]
        rate_hz : float

        Raises
        ------
        InputError
            If a block other than a bias is modelled as anything but a constant.
        """
        dt = 1.0 / rate_hz
        layout = StateLayout({name: model for name, model in layout.models.items() if BLOCKS[name][0][0] >= 0})
        processes = []
        for name, model in layout.models.items():
            if not (model.noise or model.tau):
                continue
            if name.removesuffix("_run") not in _BIASES:
                raise InputError(f"{name}: in lanes only biases wander; give this block a constant model")
            e, variance = 1.0, model.noise**2 * dt
            if model.tau is not None:
                e, variance = exp(-dt / model.tau), -(model.noise**2) * 0.5 * model.tau * expm1(-2.0 * dt / model.tau)
            sensor = _BIASES.index(name.removesuffix("_run"))
            processes.append(InRun(sensor, e, sqrt(variance), model.sigma, block=name))
        white = np.concatenate((as_vector3(gyro_n, "gyro_n"), as_vector3(accel_n, "accel_n")))
        return cls(layout, dt, white, tuple(processes))

    def draw(self, rng: np.random.Generator) -> DrawnErrors:
        """The constants of one run."""
        if isinstance(self.source, StateLayout):
            wandering = [p.block for p in self.processes]
            z = rng.standard_normal(self.source.size - 9) * np.sqrt(self.source.initial_variances())
            for name in wandering:
                assert name is not None
                part = self.source[name]
                z[part.start - 9 : part.stop - 9] = 0.0  # all of it is in the process's first value
            constants = np.concatenate([x.ravel() for x in sensor_matrices(self.source, z)])
        else:
            errors = self.source
            if isinstance(errors, ImuSpec):
                errors = ImuErrors.draw(errors, rng, gauge=self.gauge)
            constants = np.concatenate([getattr(errors, n).ravel() for n in ("b_g", "b_a", "M_g", "M_a", "G_g")])
        z = rng.standard_normal((2, len(self.processes), 3))
        starts = np.array([p.start for p in self.processes])[:, None] * z[0]
        fixed = np.array([p.fixed_slope for p in self.processes], dtype=bool)[:, None]
        slopes = np.array([p.slope for p in self.processes])[:, None] * np.where(fixed, 1.0, z[1])
        return DrawnErrors(constants, starts, slopes)

    def places(self, layout: StateLayout) -> list[int]:
        """First parameter of the layout each process counts to, -1 for none."""
        states = []
        for p in self.processes:
            name = _BIASES[p.sensor]
            for block in (p.block,) if p.block is not None else (f"{name}_run", name):
                if block is not None and block in layout:
                    states.append(layout[block].start - 9)
                    break
            else:
                states.append(-1)
        return states

    def table(self, layout: StateLayout) -> FloatArray:
        """(k, 5): sensor, e, drive, place among the parameters and whether there is a slope, as the kernel takes it."""
        rows = [
            (p.sensor, p.e, p.drive, place, float(p.slope != 0.0))
            for p, place in zip(self.processes, self.places(layout), strict=True)
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 5)

    def to_dict(self) -> dict[str, Any]:
        """For provenance."""
        source: dict[str, Any]
        if isinstance(self.source, ImuErrors):
            source = {n: getattr(self.source, n).tolist() for n in ("b_g", "b_a", "M_g", "M_a", "G_g")}
        else:
            source = self.source.to_dict()
        processes = [p._asdict() for p in self.processes]
        return {"source": source, "dt": self.dt, "white": self.white.tolist(), "processes": processes}


def true_parameters(layout: StateLayout, constants: FloatArray) -> FloatArray:
    """Values of the layout's parameters, in-run processes left out; zero where they are no IMU's. Shape (m,)."""
    b_g, b_a, M_g, M_a, G_g = np.split(constants, [3, 6, 15, 24])
    matrices = {"M_g": M_g.reshape(3, 3), "M_a": M_a.reshape(3, 3), "G_g": G_g.reshape(3, 3)}
    values = np.zeros(layout.size - 9)
    for name in layout.models:
        if BLOCKS[name][0][0] < 0:
            continue
        k = layout[name].start - 9
        for sensor, axis, source in layout.table()[k : layout[name].stop - 9]:
            if source == 0:
                counted = not name.endswith("_run") or name.removesuffix("_run") not in layout
                values[k] = (b_g, b_a)[sensor][axis] if counted else 0.0
            else:
                of = "M_a" if sensor == 1 else "M_g" if source >= 4 else "G_g"
                values[k] = matrices[of][axis, (source - 1) % 3]
            k += 1
    return values


def _white(noise: tuple[NoiseModel, NoiseModel]) -> FloatArray:
    return np.repeat([model.white.N for model in noise], 3)


def _in_run(noise: tuple[NoiseModel, NoiseModel], dt: float, samples: int) -> tuple[InRun, ...]:
    return tuple(
        process
        for sensor, model in enumerate(noise)
        for term in model.in_run.terms
        for process in _recursions(term, sensor, dt, samples)
    )


def _recursions(term: Process, sensor: int, dt: float, samples: int) -> list[InRun]:
    if isinstance(term, Flicker):
        parts = term.approximation(samples, dt).terms
        return [process for part in parts for process in _recursions(part, sensor, dt, samples)]
    if isinstance(term, GaussMarkov):
        drive = term.sigma * sqrt(-expm1(-2.0 * dt / term.tau))
        return [InRun(sensor, exp(-dt / term.tau), drive, term.sigma if term.start == "stationary" else 0.0)]
    if isinstance(term, RandomWalk):
        return [InRun(sensor, 1.0, term.K * sqrt(dt), 0.0)]
    if isinstance(term, RandomConstant):
        return [InRun(sensor, 1.0, 0.0, term.sigma)]
    if isinstance(term, Ramp):
        return [InRun(sensor, 1.0, 0.0, 0.0, term.R * dt, term.fixed)]
    raise InputError(
        f"{_SENSORS[sensor]}: runs in lanes have white noise, Gauss-Markov processes of first order, random walks, "
        f"constants, ramps and bias instability, not {type(term).__name__}; run it in the engine"
    )
