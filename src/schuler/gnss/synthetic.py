"""Synthetic ranges of a receiver on a known path: satellites, receiver clock, noise, multipath, atmosphere, masks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.gnss.constellation import CircularOrbits
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges, predicted_ranges, predicted_rates
from schuler.gnss.satellites import satellite_states
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS, wavelengths
from schuler.plotting.notebook import Abridged
from schuler.units import DEG

L1_CYCLE = SPEED_OF_LIGHT / 1.57542e9  # of L1 [m]
_LIGHT_TIME_STEPS = 4  # each gains a factor 1e5

#: Positions and velocities (k, s, 3) of s satellites at times of transmission (k, s).
States = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, repr=False)
class SyntheticRanges(Abridged):
    """Ranges and the truth behind them.

    Attributes
    ----------
    ranges : Ranges
    clock : ndarray, shape (k, g)
        Receiver clock of each group at each time. [m]
    drift : ndarray, shape (k,)
        [m/s]
    epoch : ndarray of int, shape (n,)
        Place in the given times of each row.
    error, rate_error : ndarray, shape (n,)
        Measured minus true, the clock left out. [m], [m/s]
    r_e : ndarray, shape (k, 3)
        True positions. [m]
    epoch_gps_s : float
        GPS time of zero seconds. [s]
    """

    ranges: Ranges
    clock: FloatArray
    drift: FloatArray
    epoch: IntArray
    error: FloatArray
    rate_error: FloatArray
    r_e: FloatArray
    epoch_gps_s: float = 0.0

    def observations(self) -> Observations:
        """Observations of the receiver: the same ranges, stamped by its own clock.

        Returns
        -------
        Observations
            One signal for each system (L1 C/A, E1, B1I), of satellites whose clocks and group delays are zero, as in
            :meth:`schuler.gnss.constellation.CircularOrbits.ephemerides`. Range rates are as
            measured, per second of reception (:mod:`schuler.gnss.ranges`). Carriers say where lock was lost; GLONASS,
            whose channels nobody states here, has none.
        """
        r = self.ranges
        stamp = r.t + self.clock[:, 0][self.epoch] / SPEED_OF_LIGHT
        toward, _ = predicted_rates(r.r_sat_e, r.v_sat_e, self.r_e[self.epoch], np.zeros(3))
        beidou = r.sat // 100 == SYSTEMS.index("C")
        cycle = np.empty(len(r))
        cycle[beidou], cycle[~beidou] = wavelengths(r.sat[beidou], "2I"), wavelengths(r.sat[~beidou], "1C")
        lost = np.zeros(len(r), dtype=np.int64)
        order = np.argsort(r.sat, kind="stable")
        lost[order[1:]] = (np.diff(r.sat[order]) == 0) & (np.diff(r.arc[order]) != 0)
        return Observations(
            stamp, r.sat, beidou.astype(np.int64), ("1C", "2I"), r.pseudorange,
            r.range_rate / (1.0 + toward / SPEED_OF_LIGHT), r.carrier_range / cycle, r.cn0, self.epoch_gps_s,
            notes=("simulated",), lock=lost,
        )  # fmt: skip


@dataclass(frozen=True)
class TrueSky:
    """What a receiver on a known path would measure without errors; shared by all draws of :func:`draw_ranges`.

    Attributes
    ----------
    t : ndarray, shape (k,)
        True times of reception. [s]
    r_e : ndarray, shape (k, 3)
        True positions of the antenna. [m]
    sat : ndarray of int, shape (s,)
    r_sat_e, v_sat_e : ndarray, shape (k, s, 3)
        Satellites at transmission. [m], [m/s]
    range, rate : ndarray, shape (k, s)
        [m], [m/s]
    elevation, azimuth : ndarray, shape (k, s)
        [rad]
    visible : ndarray of bool, shape (k, s)
    epoch_gps_s : float
        GPS time of ``t = 0``. [s]
    """

    t: FloatArray
    r_e: FloatArray
    sat: IntArray
    r_sat_e: FloatArray
    v_sat_e: FloatArray
    range: FloatArray
    rate: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    visible: BoolArray
    epoch_gps_s: float


def broadcast_satellites(ephemerides: Ephemerides, *, epoch_gps_s: float = 0.0) -> tuple[IntArray, States]:
    """Satellites of broadcast messages, for :func:`synthetic_ranges`: real geometry, GLONASS as its users compute it.

    Parameters
    ----------
    ephemerides : Ephemerides
    epoch_gps_s : float
        GPS time of zero seconds. [s]

    Returns
    -------
    sat : ndarray of int, shape (s,)
    states : callable
        NaN outside the validity of the messages: such satellites are not visible.
    """
    sat = np.unique(np.concatenate((ephemerides.kepler.sat, ephemerides.glonass.sat)))

    def states(sent: FloatArray) -> tuple[FloatArray, FloatArray]:
        state = satellite_states(
            ephemerides,
            np.tile(sat, len(sent)),
            np.where(np.isfinite(sent), sent, 0.0).ravel(),
            epoch_gps_s=epoch_gps_s,
        )
        return state.r_e.reshape(*sent.shape, 3), state.v_e.reshape(*sent.shape, 3)

    return sat, states


def synthetic_ranges(
    t: ArrayLike,
    r_e: ArrayLike,
    v_e: ArrayLike,
    satellites: CircularOrbits | tuple[ArrayLike, States],
    rng: np.random.Generator,
    errors: RangeErrors | None = None,
    *,
    epoch_gps_s: float = 0.0,
    elevation_mask: float = 5.0 * DEG,
    blocked: Sequence[Sector] = (),
    max_satellites: int | ArrayLike | None = None,
) -> SyntheticRanges:
    """Ranges and range rates of an antenna on a known path.

    Parameters
    ----------
    t : array_like, shape (k,)
        True times of reception, increasing. [s]
    r_e, v_e : array_like, shape (k, 3)
        Antenna, Earth-fixed. [m], [m/s]
    satellites : CircularOrbits, or satellites' numbers and a function
        The function takes times of transmission (k, s) and returns Earth-fixed positions and velocities (k, s, 3); see
        :func:`broadcast_satellites`.
    rng : numpy.random.Generator
    errors : RangeErrors, optional
        The default budget, or :data:`EXACT`.
    epoch_gps_s : float
        GPS time of ``t = 0``. [s]
    elevation_mask : float
        [rad]
    blocked : sequence of Sector
    max_satellites : int or array_like of int, shape (k,), optional
        Most satellites at an epoch; the highest stay.

    Returns
    -------
    SyntheticRanges
        One clock group for each system, in the order of the satellites. ``sigma_range`` is the root of the summed
        variances of noise, multipath and atmosphere, ``sigma_rate`` that of the noise.

    Raises
    ------
    InputError
        If shapes do not agree or no satellite is ever visible.

    Notes
    -----
    Ranges and rates follow :mod:`schuler.gnss.ranges` exactly, travel time solved to rounding. The clock is the
    two-state model of Groves (2013), section 9.4.2, its noise drawn with the exact covariance of a step; the
    Gauss-Markov processes start in their steady state. A satellite's processes run on while it is not seen. Carriers
    have the clock, noise and walk of their own, drawn from a generator of theirs, and an ambiguity for each arc.
    """
    sky = true_sky(
        t, r_e, v_e, satellites, epoch_gps_s=epoch_gps_s, elevation_mask=elevation_mask, blocked=blocked,
        max_satellites=max_satellites,
    )  # fmt: skip
    return draw_ranges(sky, rng, errors)


def true_sky(
    t: ArrayLike,
    r_e: ArrayLike,
    v_e: ArrayLike,
    satellites: CircularOrbits | tuple[ArrayLike, States],
    *,
    epoch_gps_s: float = 0.0,
    elevation_mask: float = 5.0 * DEG,
    blocked: Sequence[Sector] = (),
    max_satellites: int | ArrayLike | None = None,
) -> TrueSky:
    """Satellites, ranges and range rates of an antenna on a known path, free of errors; see :func:`synthetic_ranges`.

    Raises
    ------
    InputError
        If shapes do not agree or no satellite is ever visible.
    """
    t = as_floats(t, "t", (None,))
    r_e, v_e = as_floats(r_e, "r_e", (len(t), 3)), as_floats(v_e, "v_e", (len(t), 3))
    if len(t) == 0 or np.any(np.diff(t) <= 0.0):
        raise InputError("t: expected at least one time, increasing")
    sat, states = _satellites(satellites, epoch_gps_s)
    r_s, v_s, rho, rate = _true_ranges(t, r_e, v_e, states, len(sat))
    elevation, azimuth = _directions(r_s, r_e)
    visible = _visible(elevation, azimuth, elevation_mask, blocked, max_satellites)
    if not visible.any():
        raise InputError("no satellite is ever visible; check position, mask and blocked sectors")
    return TrueSky(t, r_e, sat, r_s, v_s, rho, rate, elevation, azimuth, visible, epoch_gps_s)


def draw_ranges(sky: TrueSky, rng: np.random.Generator, errors: RangeErrors | None = None) -> SyntheticRanges:
    """Ranges under a sky with errors drawn; see :func:`synthetic_ranges`."""
    budget = RangeErrors() if errors is None else errors
    t, sat, elevation = sky.t, sky.sat, sky.elevation
    error, rate_error, sigma, sigma_rate = range_errors(t, elevation, budget, rng)
    order, group = clock_groups(sat)
    clock, drift = receiver_clock(t, budget, len(order), rng)
    k, s = np.nonzero(sky.visible)
    ranges = Ranges(
        t[k], sat[s], group[s], tuple(SYSTEMS[i] for i in order), sky.r_sat_e[k, s], sky.v_sat_e[k, s],
        sky.range[k, s] + error[k, s] + clock[k, group[s]], sky.rate[k, s] + rate_error[k, s] + drift[k],
        np.maximum(sigma[k, s], 1e-6), np.maximum(sigma_rate[k, s], 1e-6), elevation[k, s], sky.azimuth[k, s],
        _cn0(elevation[k, s]), np.zeros(len(k), dtype=np.int64), ("simulated",),
    )  # fmt: skip
    own = rng.spawn(1)[0]
    phase = (sky.range + carrier_errors(t, elevation, budget, own))[k, s] + clock[k, group[s]]
    ranges = with_arcs(replace(ranges, carrier_range=phase, wavelength=np.full(len(k), L1_CYCLE)), k, own)
    return SyntheticRanges(ranges, clock, drift, k, error[k, s], rate_error[k, s], sky.r_e, sky.epoch_gps_s)


def with_arcs(ranges: Ranges, epoch: IntArray, rng: np.random.Generator) -> Ranges:
    """Ranges whose carriers have a new arc, with another ambiguity, wherever a satellite was not seen before.

    Parameters
    ----------
    ranges : Ranges
    epoch : ndarray of int, shape (n,)
        Place of each row's epoch among all.
    rng : numpy.random.Generator
        Draws whole cycles of L1 up to a million; the first arc of a satellite has some too.
    """
    if not len(ranges):
        return ranges
    order = np.argsort(ranges.sat, kind="stable")
    new = np.ones(len(ranges), dtype=bool)
    new[1:] = (np.diff(ranges.sat[order]) != 0) | (np.diff(epoch[order]) != 1)
    number = np.cumsum(new) - 1
    cycles = rng.integers(-1_000_000, 1_000_000, number[-1] + 1)
    arc, ambiguity = np.empty(len(ranges), dtype=np.int64), np.empty(len(ranges))
    arc[order], ambiguity[order] = number, L1_CYCLE * cycles[number]
    return replace(ranges, arc=arc, carrier_range=ranges.carrier_range + ambiguity)


def _satellites(satellites: CircularOrbits | tuple[ArrayLike, States], epoch_gps_s: float) -> tuple[IntArray, States]:
    if isinstance(satellites, CircularOrbits):
        orbits = satellites
        return orbits.sat, lambda sent: orbits.states(sent, epoch_gps_s=epoch_gps_s)
    return np.asarray(satellites[0], dtype=np.int64), satellites[1]


def _true_ranges(
    t: FloatArray, r_e: FloatArray, v_e: FloatArray, states: States, n: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Satellites at transmission, range and range rate. (k, s, ...)."""
    here, moving = r_e[:, None, :], v_e[:, None, :]
    rho = np.full((len(t), n), 0.07 * SPEED_OF_LIGHT)
    for _ in range(_LIGHT_TIME_STEPS):
        r_s, v_s = states(t[:, None] - rho / SPEED_OF_LIGHT)
        rho, _ = predicted_ranges(r_s, here)
    rate, _ = predicted_rates(r_s, v_s, here, moving)
    return r_s, v_s, rho, rate


def _directions(r_s: FloatArray, r_e: FloatArray) -> tuple[FloatArray, FloatArray]:
    u = np.matmul(r_s - r_e[:, None, :], frames.C_en(frames.llh_from_ecef(r_e)))
    elevation = np.arctan2(-u[..., 2], np.hypot(u[..., 0], u[..., 1]))
    return elevation, np.mod(np.arctan2(u[..., 1], u[..., 0]), 2.0 * np.pi)


def _visible(
    elevation: FloatArray,
    azimuth: FloatArray,
    mask: float,
    blocked: Sequence[Sector],
    most: int | ArrayLike | None,
) -> BoolArray:
    visible = elevation >= mask
    for sector in blocked:
        visible &= ~sector.blocks(azimuth, elevation)
    if most is not None:
        limit = np.asarray(most, dtype=np.int64)
        if limit.shape not in ((), (len(elevation),)):
            raise InputError(f"max_satellites: expected one number or shape ({len(elevation)},), got {limit.shape}")
        height = np.where(visible, elevation, -np.inf)
        rank = np.argsort(np.argsort(-height, axis=1, kind="stable"), axis=1)
        visible &= rank < np.broadcast_to(limit, (len(elevation),))[:, None]
    return visible


def clock_groups(sat: IntArray) -> tuple[IntArray, IntArray]:
    """Systems in the order of their first satellites, one clock each, and the place among them of each satellite."""
    system = sat // 100
    order = system[np.sort(np.unique(system, return_index=True)[1])]
    return order, np.argmax(system[:, None] == order, axis=1)


def range_errors(
    t: FloatArray, elevation: FloatArray, e: RangeErrors, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Errors of range and rate, and their standard deviations. Shapes (k, s). [m], [m/s]"""
    sine = np.sin(np.maximum(elevation, 1.0 * DEG))
    growth = np.sqrt(0.5 * (1.0 + 1.0 / sine**2))
    slant = 1.0 / np.sin(np.maximum(elevation, 5.0 * DEG))
    error = e.noise * growth * rng.standard_normal(elevation.shape)
    rate_error = e.rate_noise * growth * rng.standard_normal(elevation.shape)
    for scale, tau in ((e.multipath * growth, e.multipath_tau), (e.atmosphere * slant, e.atmosphere_tau)):
        white = rng.standard_normal(elevation.shape)  # drawn in any case: what comes after stays as it is
        if scale.any():
            error += scale * _gauss_markov(t, white, tau)
    sigma = np.sqrt((e.noise**2 + e.multipath**2) * growth**2 + (e.atmosphere * slant) ** 2)
    return error, rate_error, sigma, e.rate_noise * growth


def carrier_errors(t: FloatArray, elevation: FloatArray, e: RangeErrors, rng: np.random.Generator) -> FloatArray:
    """Noise and random walk of carrier phases. Shape (k, s). [m]"""
    growth = np.sqrt(0.5 * (1.0 + 1.0 / np.sin(np.maximum(elevation, 1.0 * DEG)) ** 2))
    steps = rng.standard_normal(elevation.shape) * np.sqrt(np.diff(t, prepend=t[0]))[:, None]
    return e.carrier * growth * rng.standard_normal(elevation.shape) + e.carrier_walk * np.cumsum(steps, axis=0)


def _gauss_markov(t: FloatArray, white: FloatArray, tau: float) -> FloatArray:
    """Unit variance, correlation ``exp(-|dt| / tau)``, driven by white noise, which it overwrites. Shape (k, n)."""
    keep = np.exp(-np.diff(t) / tau)
    white[1:] *= np.sqrt(-np.expm1(-2.0 * np.diff(t) / tau))[:, None]
    for k in range(1, len(t)):
        white[k] += keep[k - 1] * white[k - 1]
    return white


def receiver_clock(
    t: FloatArray, e: RangeErrors, groups: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Receiver clock of each group (k, g) and its drift (k,)."""
    if len(e.offsets) not in (0, groups - 1):
        raise InputError(
            f"offsets: expected one for each of the {groups - 1} groups after the first, got {len(e.offsets)}"
        )
    dt = np.diff(t)
    draws = rng.standard_normal((len(dt), 2))
    # covariance of a step: [[S_f dt + S_d dt^3 / 3, S_d dt^2 / 2], [., S_d dt]]
    walk = np.sqrt(e.drift_psd * dt) * draws[:, 0]
    phase = 0.5 * dt * walk + np.sqrt(e.clock_psd * dt + e.drift_psd * dt**3 / 12.0) * draws[:, 1]
    drift = e.drift + np.concatenate(([0.0], np.cumsum(walk)))
    clock = e.clock + np.concatenate(([0.0], np.cumsum(drift[:-1] * dt + phase)))
    return clock[:, None] + np.array((0.0, *(e.offsets or (0.0,) * (groups - 1)))), drift


def _cn0(elevation: FloatArray) -> FloatArray:
    """Plausible signal strengths: 50 dB-Hz at the zenith, 35 at the horizon. [dB-Hz]"""
    return 35.0 + 15.0 * np.sin(np.maximum(elevation, 0.0))


@dataclass(frozen=True)
class RangeErrors:
    """Error budget of synthetic ranges; every part is 1-sigma at the zenith.

    Attributes
    ----------
    noise, rate_noise : float
        White, of ranges [m] and range rates [m/s]. Grows as ``sqrt((1 + 1 / sin^2 el) / 2)`` towards the horizon.
    multipath, multipath_tau : float
        First-order Gauss-Markov process of each satellite, growing likewise [m], and its correlation time [s].
    atmosphere, atmosphere_tau : float
        Remainder of the correction models: Gauss-Markov, growing as ``1 / sin el`` with at least 5 degrees [m], [s].
    clock, drift : float
        Receiver clock at the start, of the first group [m], [m/s].
    clock_psd, drift_psd : float
        Power spectral densities of the clock's frequency noise [m^2/s] and of the random walk of its drift [m^2/s^3].
        0.04 and 0.04 are a temperature-compensated crystal oscillator's (Groves (2013), section 9.4.2).
    offsets : tuple of float
        Clock of each further group less that of the first. [m]
    carrier, carrier_walk : float
        Noise of carrier phases, growing as that of ranges [m], and their random walk: satellites' clocks and the
        atmosphere's change [m/sqrt(s)].
    """

    noise: float = 0.5
    rate_noise: float = 0.05
    multipath: float = 0.5
    multipath_tau: float = 30.0
    atmosphere: float = 0.5
    atmosphere_tau: float = 1800.0
    clock: float = 3e4
    drift: float = 30.0
    clock_psd: float = 0.04
    drift_psd: float = 0.04
    offsets: tuple[float, ...] = ()
    carrier: float = 0.002
    carrier_walk: float = 0.001

    def __post_init__(self) -> None:
        for name in (
            "noise",
            "rate_noise",
            "multipath",
            "atmosphere",
            "clock_psd",
            "drift_psd",
            "carrier",
            "carrier_walk",
        ):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"{name}: expected 0 or more, got {getattr(self, name)}")
        for name in ("multipath_tau", "atmosphere_tau"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name}: expected a positive time, got {getattr(self, name)}")


#: Ranges without any error and a clock that stands at zero.
EXACT = RangeErrors(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, (), 0.0, 0.0)


@dataclass(frozen=True)
class Sector:
    """A part of the sky that is blocked.

    Attributes
    ----------
    azimuth_from, azimuth_to : float
        From north over east; from 5.5 to 0.5 goes through north. [rad]
    below : float
        Blocked up to this elevation. [rad]
    """

    azimuth_from: float
    azimuth_to: float
    below: float = 0.5 * np.pi

    def blocks(self, azimuth: FloatArray, elevation: FloatArray) -> BoolArray:
        """Whether directions are within it. Shape as given."""
        width = np.mod(self.azimuth_to - self.azimuth_from, 2.0 * np.pi)
        inside = np.mod(azimuth - self.azimuth_from, 2.0 * np.pi) <= width
        return np.asarray(inside & (elevation <= self.below))
