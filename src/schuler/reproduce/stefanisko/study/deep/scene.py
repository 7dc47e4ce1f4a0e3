"""SIMULATION ONLY: the world of the deep-coupling study. A drive, satellites over it, an IMU and a clock drawn anew.

Everything that is drawn follows the filter's own models, so that errors can be held against the sigmas claimed for
them. Ranges contain geometry and the receiver's clock and nothing else: no atmosphere, no multipath, no orbit errors.
The study is about tracking, and these would hide it at high C/N0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.synthetic import EXACT, synthetic_ranges
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory
from schuler.reproduce.stefanisko.study.deep.correlator import Correlator, ratio_from_dbhz
from schuler.simulation.motion import Motion, ideal_increments
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG

_PLACE = np.array([47.0 * DEG, 8.0 * DEG, 1500.0])  # latitude, longitude, height

#: The filter's model of the IMU (a good MEMS, biases known to a first calibration) and of an oven-controlled clock.
MODELS = {
    "b_a": StateModel.random_walk(0.02, 2e-5),
    "b_g": StateModel.random_walk(2e-4, 1e-6),
    "clock": StateModel.random_walk(5.0, 3e-3),
    "clock_drift": StateModel.random_walk(0.2, 3e-3),
}


def calm(seconds: float) -> Motion:
    """Straight ahead at 100 m/s."""
    return ManoeuvreMotion.of([Manoeuvre(duration=seconds)], _PLACE, heading=0.4, speed=100.0)


def agile(seconds: float) -> Motion:
    """Turns of 90 degrees within 4 s at 100 m/s, one way and the other: 74 m/s^2 and 58 m/s^3 at most."""
    turn = 0.5 * np.pi
    lap = [
        Manoeuvre(duration=4.0, turn=turn),
        Manoeuvre(duration=3.0),
        Manoeuvre(duration=4.0, turn=-turn),
        Manoeuvre(duration=3.0),
    ]
    commands = [Manoeuvre(duration=3.0), *lap * (int(seconds / 14.0) + 1)]
    return ManoeuvreMotion.of(commands, _PLACE, heading=0.4, speed=100.0)


@dataclass(frozen=True)
class DeepScene:
    """Scene that all runs share.

    Attributes
    ----------
    correlator : Correlator
    t : ndarray, shape (n + 1,)
        Limits of IMU intervals, which are the halves of data bits. [s]
    ideal : Increments
        Increments of a perfect IMU, n intervals.
    truth : FullTrajectory
        True motion of IMU and antenna, which are one point here, at ``t``.
    sat : ndarray of int, shape (s,)
    r_sat_e, v_sat_e : ndarray, shape (n + 1, s, 3)
        As in :class:`schuler.gnss.ranges.Ranges`. [m], [m/s]
    range, rate : ndarray, shape (n + 1, s)
        True, without the receiver clock. [m], [m/s]
    layout : StateLayout
    gyro_psd, accel_psd : ndarray, shape (3,)
        White noise of the IMU, ``N**2``. [rad^2/s], [m^2/s^3]
    attitude, velocity, position : float
        1-sigma at the start, of each axis. [rad], [m/s], [m]
    """

    correlator: Correlator
    t: FloatArray
    ideal: Increments
    truth: FullTrajectory
    sat: np.ndarray
    r_sat_e: FloatArray
    v_sat_e: FloatArray
    range: FloatArray
    rate: FloatArray
    layout: StateLayout = field(default_factory=lambda: StateLayout(MODELS))
    gyro_psd: FloatArray = field(default_factory=lambda: np.full(3, 1e-4**2))
    accel_psd: FloatArray = field(default_factory=lambda: np.full(3, 1e-3**2))
    attitude: float = 5e-3
    velocity: float = 0.1
    position: float = 3.0

    @property
    def bits(self) -> int:
        """Number of data bits."""
        return (len(self.t) - 1) // 2

    @property
    def jerk(self) -> float:
        """Root mean square of the jerk along the lines of sight. [m/s^3]"""
        step = round(0.1 / self.correlator.half)  # differences over 0.1 s, well above rounding
        second = np.diff(self.rate[::step], n=2, axis=0) / (step * self.correlator.half) ** 2
        return float(np.sqrt(np.mean(second**2)))


def deep_scene(
    motion: Callable[[float], Motion] = calm,
    seconds: float = 40.0,
    *,
    satellites: int = 8,
    correlator: Correlator | None = None,
    models: dict[str, StateModel] | None = None,
) -> DeepScene:
    """Set up a scene.

    Parameters
    ----------
    motion : callable
        :func:`calm`, :func:`agile`, or another function of the duration.
    seconds : float
        [s]
    satellites : int
        The highest so many of GPS and Galileo, all taken for the signal of ``correlator``.
    correlator : Correlator, optional
    models : dict, optional
        State models instead of :data:`MODELS`, by block: an IMU and a clock of another grade.

    Returns
    -------
    DeepScene
    """
    cor = correlator or Correlator()
    bits = round(seconds / cor.signal.bit)
    if bits < 2:
        raise InputError(f"seconds: expected at least two data bits of {cor.signal.bit} s, got {seconds!r}")
    t = as_floats(cor.half * np.arange(2 * bits + 1), "t")
    path = motion(float(t[-1]))
    s = path.state(t)
    orbits = nominal_orbits("GE")
    seen = synthetic_ranges(t[:1], s.r_eb_e[:1], s.v_eb_e[:1], orbits, np.random.default_rng(0), EXACT).ranges
    if not 4 <= satellites <= len(seen):
        raise InputError(f"satellites: expected 4 to {len(seen)}, as many as are in view, got {satellites!r}")
    highest = seen.sat[np.argsort(-seen.elevation)[:satellites]]
    chosen = orbits.where(np.isin(orbits.sat, highest))
    r = synthetic_ranges(
        t, s.r_eb_e, s.v_eb_e, chosen, np.random.default_rng(0), EXACT, elevation_mask=-0.5 * np.pi
    ).ranges
    shape = (len(t), satellites)
    return DeepScene(
        cor, t, Increments(t[1:], np.diff(t), *ideal_increments(path, t)),
        FullTrajectory(t, s.r_eb_e, s.v_eb_e, s.q_eb),
        r.sat[:satellites], r.r_sat_e.reshape(*shape, 3), r.v_sat_e.reshape(*shape, 3), r.pseudorange.reshape(shape),
        r.range_rate.reshape(shape), StateLayout({**MODELS, **(models or {})}),
    )  # fmt: skip


@dataclass(frozen=True)
class Draw:
    """One realisation: what the IMU wrote, what clock and biases did, where the filter starts.

    Attributes
    ----------
    scene : DeepScene
    increments : Increments
    parameters : ndarray, shape (n + 1, m)
        True parameters at ``scene.t``, order of the layout.
    initial : InitialState
    """

    scene: DeepScene
    increments: Increments
    parameters: FloatArray
    initial: InitialState

    def _block(self, name: str) -> FloatArray:
        part = self.scene.layout[name]
        return self.parameters[:, part.start - 9 : part.stop - 9]

    @property
    def pseudorange(self) -> FloatArray:
        """True range with the receiver clock. Shape (n + 1, s). [m]"""
        return np.asarray(self.scene.range + self._block("clock"))

    @property
    def range_rate(self) -> FloatArray:
        """True range rate with the clock's drift. Shape (n + 1, s). [m/s]"""
        return np.asarray(self.scene.rate + self._block("clock_drift"))


def draw(scene: DeepScene, rng: np.random.Generator, *, scale: float = 1.0, start: float = 1.0) -> Draw:
    """Draw IMU errors, clock and initial errors from the filter's models.

    Parameters
    ----------
    scene : DeepScene
    rng : numpy.random.Generator
    scale : float
        Factor on noise and biases of the IMU and on the clock; 0 for perfect ones.
    start : float
        Factor on the initial errors of the navigation state.
    """
    lay, n, h = scene.layout, len(scene.ideal), scene.correlator.half
    _, q = lay.dynamics().T
    p = scale * np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9)
    walk = scale * np.sqrt(q * h) * rng.standard_normal((n, lay.size - 9))
    history = p + np.concatenate((np.zeros((1, lay.size - 9)), np.cumsum(walk, axis=0)))
    c = lay["clock"].start - 9
    drift = history[:, c + 1]
    # the exact step of the two-state clock up to 1e-4 of a half bit's: the drift's walk enters by its mean
    history[1:, c] += np.cumsum(0.5 * h * (drift[1:] + drift[:-1]))
    b_a, b_g = (
        0.5 * (x[1:] + x[:-1])
        for x in (history[:, lay[name].start - 9 : lay[name].stop - 9] for name in ("b_a", "b_g"))
    )
    root = scale * np.sqrt(h)
    i = scene.ideal
    log = Increments(
        i.t,
        i.dt,
        i.dtheta_ib_b + h * b_g + root * np.sqrt(scene.gyro_psd) * rng.standard_normal((n, 3)),
        i.dv_ib_b + h * b_a + root * np.sqrt(scene.accel_psd) * rng.standard_normal((n, 3)),
    )
    sigma = np.repeat([scene.attitude, scene.velocity, scene.position], 3)
    error = (start * sigma * rng.standard_normal(9)).reshape(3, 3)
    at = scene.truth
    C = frames.C_en(at.llh[0])
    turned = rotation.quat_multiply(rotation.quat_from_rotvec(C @ error[0]), at.q_eb[0])
    nav = NavState(float(scene.t[0]), at.r_eb_e[0] + C @ error[2], at.v_eb_e[0] + C @ error[1], turned)
    ones = np.ones(3)
    initial = InitialState.from_sigmas(
        nav, lay, attitude=scene.attitude * ones, velocity=scene.velocity * ones, position=scene.position * ones
    )
    return Draw(scene, log, history, initial)


def signal_strength(
    scene: DeepScene,
    level_dbhz: float,
    window: tuple[float, float],
    *,
    strong_dbhz: float = 45.0,
    satellites: int | None = None,
) -> FloatArray:
    """C/N0 of every satellite in every data bit: strong, and weaker for a while.

    Parameters
    ----------
    scene : DeepScene
    level_dbhz : float
        In the window. [dB-Hz]
    window : (start, stop)
        [s]
    strong_dbhz : float
        Outside of it. [dB-Hz]
    satellites : int, optional
        How many fade, the first ones of ``scene.sat``; all if left out.

    Returns
    -------
    ndarray, shape (bits, s)
        Ratios. [Hz]
    """
    start, stop = window
    if not start < stop:
        raise InputError(f"window: expected a start before the stop, got {start} to {stop} s")
    S = len(scene.sat)
    which = S if satellites is None else satellites
    if not 0 <= which <= S:
        raise InputError(f"satellites: expected 0 to {S}, got {which}")
    middle = scene.t[1::2]
    cn0 = np.full((scene.bits, S), float(ratio_from_dbhz(strong_dbhz)))
    cn0[np.ix_((middle >= start) & (middle < stop), np.arange(which))] = float(ratio_from_dbhz(level_dbhz))
    return as_floats(cn0, "cn0")
