"""Hayal's walk with a cart, simulated: log, GPS, and a filter seeded with a calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import ModelSection, NavigationConfig
from schuler.navigation.states import imu_spec, state_layout
from schuler.recording.recording import Metadata, Recording
from schuler.reproduce.hayal.study.attitudes import scenario
from schuler.reproduce.hayal.study.multiposition import NOISE, StudyCase, run_case
from schuler.sensors.errors import ImuErrors
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import IdealImu, ideal_imu, simulate_imu
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG

#: A car park in Columbus, Ohio. [rad], [m]
PLACE = np.array([40.0 * DEG, -83.0 * DEG, 230.0])
_GYRO_ANGLES = (0, 1, 3)  # xy, xz, yz of the six of M_g; the other three are zero in a triad's own axes
_SIGMA_TILT, _SIGMA_HEADING, _SIGMA_FIX, _SIGMA_V = 0.1 * DEG, 1.0 * DEG, 0.02, 0.02


@dataclass(frozen=True)
class CartWalk:
    """The walk, once for any number of draws.

    Attributes
    ----------
    motion : ManoeuvreMotion
    ideal : IdealImu
    """

    motion: ManoeuvreMotion
    ideal: IdealImu

    @classmethod
    def of(cls, minutes: float = 25.0, rate_hz: float = 100.0) -> CartWalk:
        """Straight sections of a minute with short sharp curves, alternately right and left, at 1.2 m/s."""
        commands = [Manoeuvre(duration=10.0), Manoeuvre(duration=3.0, speed=1.2)]
        side = 1.0
        while sum(c.duration for c in commands) < 60.0 * minutes:
            commands += [Manoeuvre(duration=55.0), Manoeuvre(duration=5.0, turn=side * np.pi)]
            side = -side
        motion = ManoeuvreMotion.of(commands, PLACE, heading=0.2, bank=0.0)
        return cls(motion, ideal_imu(motion, rate_hz))


@dataclass(frozen=True)
class CalibrationSigma:
    """1-sigma of a calibration: bias, scale factor, non-orthogonality of a triad, three each, unit of the sensor."""

    accel: FloatArray
    gyro: FloatArray
    gyro_bias: FloatArray

    @classmethod
    def of(cls, imu: str, *, subset: int = 3, minutes: float = 3.0, runs: int = 60, seed: int = 1) -> CalibrationSigma:
        """Uncertainty that Hayal's method claims for an attitude subset, from
        :mod:`schuler.reproduce.hayal.study.multiposition`.

        The median of its predicted sigmas over the runs that converged (few, for nine parameters of a gyroscope from
        Earth rate). Not scaled with the variance of unit weight as in the source: ten attitudes for nine parameters
        leave it one degree of freedom, chance. Correlations between parameters are left out.
        """
        spec = imu_spec(cart_config(imu))
        sigmas = {}
        for sensor, order, triad in (("accel", 9, spec.accel), ("gyro", 9, spec.gyro), ("gyro", 3, spec.gyro)):
            case = StudyCase(
                sensor=sensor, order=order, noise_factor=triad.random_walk / NOISE[sensor],  # type: ignore[arg-type]
                directions=scenario(subset), duration_s=60.0 * minutes,
            )  # fmt: skip
            study = run_case(case, runs, np.random.default_rng(seed))
            if not study.converged.any():
                raise InputError(f"{imu}, {sensor}, {order} parameters: the calibration did not converge in any run")
            sigmas[sensor, order] = np.median(study.sigma[study.converged], axis=0)
        return cls(sigmas["accel", 9], sigmas["gyro", 9], sigmas["gyro", 3][:3])


def cart_config(imu: str, gnss_every_s: float = 0.0, wander: bool = True) -> NavigationConfig:
    """Configuration of the filter; for ``gnss_every_s`` and ``wander`` see ``calibration_outages.outage_grid``."""
    config = NavigationConfig.parse(
        {
            "imu": {"catalogue": imu},
            "gnss": {"velocity": False, "every_s": gnss_every_s, "gate": "off"},
            "filter": {"states": ["b_a", "b_g", "S_a", "S_g", "M_a", "M_g"], "smooth": False},
        }
    )
    if wander:
        return config
    spec = imu_spec(config)
    constant = {
        "b_a": ModelSection(sigma=spec.accel.bias_instability), "b_g": ModelSection(sigma=spec.gyro.bias_instability),
    }  # fmt: skip
    return config.model_copy(update={"filter": config.filter.model_copy(update={"models": constant})})


def cart_recording(
    walk: CartWalk, imu: str, seed: int, draw: int, wander: bool
) -> tuple[Recording, ImuErrors, np.random.Generator]:
    """One draw: the same normalised errors for both IMUs; GPS and the start share theirs too."""
    spec = imu_spec(cart_config(imu))
    if not wander:
        gyro, accel = (
            replace(triad, turn_on_bias=triad.bias_instability, bias_instability=0.0)
            for triad in (spec.gyro, spec.accel)
        )
        spec = replace(spec, gyro=gyro, accel=accel)
    kinds = np.random.SeedSequence(seed).spawn(draw + 1)[draw].spawn(4)
    drawn = ImuErrors.draw(spec, np.random.default_rng(kinds[0]), gauge="upper")
    errors = replace(drawn, M_g=np.triu(drawn.M_g), G_g=np.zeros((3, 3)))
    simulated = simulate_imu(walk.ideal, errors, np.random.default_rng(kinds[1])).imu
    gnss = simulate_gnss(
        walk.motion,
        GnssModel(rate_hz=10.0, sigma_position=np.full(3, _SIGMA_FIX), sigma_velocity=np.full(3, 0.02), first_s=0.05),
        np.random.default_rng(kinds[2]),
    )
    gnss = replace(gnss.where(gnss.t <= walk.ideal.t[-1]), v_n=None, cov_v_n=None)
    recording = Recording(
        simulated, gnss, reference=walk.ideal.truth, metadata=Metadata(name=f"cart walk, {imu}, draw {draw + 1}")
    )
    return recording, errors, np.random.default_rng(kinds[3])


def seeded_start(
    recording: Recording, config: NavigationConfig, errors: ImuErrors, seeding: str, sigma: CalibrationSigma,
    rng: np.random.Generator,
) -> InitialState:  # fmt: skip
    """Initial state with a calibration's estimates and covariance.

    Parameters
    ----------
    recording : Recording
        With its truth.
    config : NavigationConfig
    errors : ImuErrors
        True errors; a calibrated parameter is estimated as truth plus its drawn error.
    seeding : str
        One of :data:`SEEDINGS`.
    sigma : CalibrationSigma
    rng : numpy.random.Generator
        The same number of draws for every seeding.
    """
    layout: StateLayout = state_layout(config, imu_spec(config))
    z = rng.standard_normal(9)
    z_accel, z_gyro = rng.standard_normal((2, 9))
    truth = recording.need_reference()
    first = truth.at([0.0])
    attitude = np.array([_SIGMA_TILT, _SIGMA_TILT, _SIGMA_HEADING])
    rpy = first.rpy_nb[0] + attitude * z[:3]  # level: about north and east as good as roll and pitch
    llh = first.llh[0] + _SIGMA_FIX * z[6:] / np.array([6.37e6, 6.37e6 * np.cos(first.llh[0, 0]), -1.0])
    nav = NavState.from_geodetic(0.0, llh, first.v_eb_n[0] + _SIGMA_V * z[3:6], rpy)
    start = InitialState.from_sigmas(
        nav, layout, attitude=attitude, velocity=np.full(3, _SIGMA_V), position=np.full(3, _SIGMA_FIX)
    )
    P, estimates = start.P.copy(), start.parameters.copy()
    off = np.array([k for k in range(6) if k not in _GYRO_ANGLES])
    P[layout["M_g"].start + off, layout["M_g"].start + off] = 0.0
    upper = np.triu_indices(3, 1)
    given = []
    if seeding != "Original":
        values = (errors.b_a, np.diag(errors.M_a), errors.M_a[upper])
        given += [(b, np.arange(3), v) for b, v in zip(("b_a", "S_a", "M_a"), values, strict=True)]
        s, error = [sigma.accel], [sigma.accel * z_accel]
    if seeding in ("3.3", "3.9"):
        given.append(("b_g", np.arange(3), errors.b_g))
        bias = sigma.gyro_bias if seeding == "3.3" else sigma.gyro[:3]
        s, error = [*s, bias], [*error, bias * z_gyro[:3]]
    if seeding == "3.9":
        given += [("S_g", np.arange(3), np.diag(errors.M_g)), ("M_g", np.array(_GYRO_ANGLES), errors.M_g[upper])]
        s, error = [*s, sigma.gyro[3:]], [*error, sigma.gyro[3:] * z_gyro[3:]]
    if given:
        each, wrong = np.concatenate(s).reshape(-1, 3), np.concatenate(error).reshape(-1, 3)
        for (block, places, value), sigma_k, error_k in zip(given, each, wrong, strict=True):
            at = layout[block].start + places
            P[at, at] = sigma_k**2
            estimates[at - 9] = value + error_k
    return InitialState(nav, P, estimates)
