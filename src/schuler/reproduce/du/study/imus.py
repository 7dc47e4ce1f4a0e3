"""The two IMUs of Du (2015), MTi-G and NAV440: what the thesis leaves open is assumed here, once.

The thesis states neither initial uncertainties nor noise of its filters, nor anything of the accelerometers. The
values are those under which the anchors of the independent check were computed. Data sheets alone would not do: an
MTi-G with a flicker of 3600 deg/h, as printed, would drift by degrees in a minute, which it did not.

For free-inertial tests both units are emulated so that runs land where the measured ones did.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.states import StateLayout, StateModel
from schuler.reproduce.du.study.tables import GYRO_BIAS_DEG_HR, check_imu
from schuler.rotary.du_axes import swap_matrix, swap_vector
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import Flicker, NoiseModel, White
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import DEG, DEG_PER_HR, MG

#: Correlation time of the wandering biases. [s]
TAU_S = 300.0
_ACCEL_WANDER = 5e-4  # 1-sigma [m/s^2]


@dataclass(frozen=True, eq=False)
class FilterImu:
    """An IMU, what is wrong with it, and how it is turned.

    Attributes
    ----------
    name : str
    spec : ImuSpec
        Noise, turn-on and wandering biases; scale factor and misalignment are those of the gyroscopes on the table and
        in the car, and not known to a filter of 15 states.
    rate : float
        Recommended rate of rotation (Du 4.1.2). [rad/s]
    sigma_gnss : float
        1-sigma of a GNSS position and velocity by axis, from the accuracy printed. [m], [m/s]
    """

    name: str
    spec: ImuSpec
    rate: float
    sigma_gnss: float

    @property
    def layout(self) -> StateLayout:
        """Biases as the anchors have them: random walks from the turn-on uncertainty.

        ``q = 2 sigma^2 / tau``: a Gauss-Markov process of that sigma, while it is young.
        """
        return StateLayout(
            {
                name: StateModel.random_walk(triad.turn_on_bias, triad.in_run_bias * float(np.sqrt(2.0 / TAU_S)))
                for name, triad in (("b_a", self.spec.accel), ("b_g", self.spec.gyro))
            }
        )

    @property
    def psd(self) -> tuple[FloatArray, FloatArray]:
        """Densities ``N**2`` of gyroscopes and accelerometers. [rad^2/s], [m^2/s^3]"""
        return np.full(3, self.spec.gyro.random_walk**2), np.full(3, self.spec.accel.random_walk**2)


def _imu(
    name: str, arw: float, bias: float, wander: float, vrw: float, accel_bias: float, scale_ppm: float, coupling: float
) -> ImuSpec:
    gyro = TriadSpec.gyro(
        arw_deg_rthr=arw, bias_deg_hr=bias, in_run_deg_hr=wander, in_run_time_s=TAU_S, scale_ppm=scale_ppm,
        misalignment_mrad=coupling,
    )  # fmt: skip
    accel = TriadSpec.accelerometer(
        vrw_m_s_rthr=vrw, bias_m_s2=accel_bias, in_run_mg=_ACCEL_WANDER / MG, in_run_time_s=TAU_S
    )
    return ImuSpec(name=name, gyro=gyro, accel=accel, rate_hz=100.0, source="Du (2015), Table 4.2; assumptions")


#: ARW 3 deg/sqrt(h), VRW 0.002 m/s/sqrt(s), biases 1 deg/s and 0.1 m/s^2, wandering 20 deg/h.
MTI_G = FilterImu("MTi-G", _imu("MTi-G of the filters", 3.0, 3600.0, 20.0, 0.12, 0.1, 1000.0, 3.96), 10.0 * DEG, 0.028)
#: ARW 0.4 deg/sqrt(h), VRW 0.5 m/s/sqrt(h), biases 400 deg/h and 0.2 m/s^2, wandering 10 deg/h.
NAV440 = FilterImu("NAV440", _imu("NAV440 of the filters", 0.4, 400.0, 10.0, 0.5, 0.2, 1000.0, 1.77), 20.0 * DEG, 0.019)
FILTER_IMUS = {imu.name: imu for imu in (NAV440, MTI_G)}

#: Drift in the run that free-inertial tests are emulated with, B of 1/f noise: the wandering of the filters above, and
#: then the others of the set over which ranges are given. NAV440: none to the sheet's 20. MTi-G: none; its sheet's 3600
#: would let no test go as it did. Not chosen by any printed result. [deg/h]
DRIFT_DEG_HR = {"NAV440": (10.0, 0.0, 20.0), "MTi-G": (20.0, 0.0)}


Triple = tuple[float, float, float]
_RATE_HZ = 100.0


@dataclass(frozen=True, kw_only=True)
class Emulation:
    """Fixed errors and noise of one IMU, axes of the IMU as ours (forward, right, down at angle zero).

    Attributes
    ----------
    name : str
    gyro_random_walk, accel_random_walk : float
        [rad/sqrt(s)], [m/s/sqrt(s)]
    gyro_bias, accel_bias : tuple of float
        [rad/s], [m/s^2]
    response : tuple of float
        Column of M_g for a rate about the rotation axis, z: cross-coupling into x and y, and scale factor. [-]
    gyro_instability : float
        B of 1/f noise of the gyroscopes; zero by default. [rad/s]
    rate_hz : float
    """

    name: str
    gyro_random_walk: float
    accel_random_walk: float
    gyro_bias: Triple
    accel_bias: Triple
    response: Triple
    gyro_instability: float = 0.0
    rate_hz: float = 100.0

    def fixed_errors(self) -> ImuErrors:
        """Errors that are the same in every run."""
        M = np.zeros((3, 3))
        M[:, 2] = self.response
        return ImuErrors(b_g=np.array(self.gyro_bias), b_a=np.array(self.accel_bias), M_g=M)

    def errors(self) -> ImuErrors:
        """Errors that the simulator adds, noise included."""
        gyro = NoiseModel((White(self.gyro_random_walk),))
        if self.gyro_instability:
            gyro = NoiseModel((White(self.gyro_random_walk), Flicker(self.gyro_instability)))
        return replace(
            self.fixed_errors(), gyro_noise=gyro, accel_noise=NoiseModel((White(self.accel_random_walk),))
        )  # fmt: skip


def emulation(name: str, *, instability_deg_hr: float = 0.0, rate_hz: float | None = None) -> Emulation:
    """NAV440 or MTi-G, emulated so that free-inertial runs land where the thesis's did.

    Parameters
    ----------
    name : {"NAV440", "MTi-G"}
    instability_deg_hr : float
        1/f noise of the gyroscopes besides. The sheets promise 20 and 3600 deg/h, upper limits: with the latter no
        test of the thesis could have gone as it did.
    rate_hz : float, optional
        Default that of the thesis, 100.

    Returns
    -------
    Emulation
        Random walks as in table 4.2 and the catalogue's ``...-emulated``. Accelerometer biases are those the filters of
        chapter 5 found; gyroscope biases likewise (calibrated out, they show that it works). Cross-coupling of z into x
        and y is equal and as large as the difference of strategies I and II demands, so agreement of strategy I is no
        finding; the scale factor, 1000 ppm, is assumed.

    Raises
    ------
    InputError
        If there is no such emulation.
    """
    check_imu(name)
    entry = catalogue.entry(f"{name}-emulated")
    spec = catalogue.spec(entry.name)
    # Du's K_gxz = K_gyz and K_gz, as a matrix, in our axes
    K = np.zeros((3, 3))
    K[:, 2] = (spec.gyro.misalignment, spec.gyro.misalignment, spec.gyro.scale_factor)
    return Emulation(
        name=name,
        gyro_random_walk=spec.gyro.random_walk,
        accel_random_walk=spec.accel.random_walk,
        gyro_bias=_triple(swap_vector(GYRO_BIAS_DEG_HR[name]) * DEG_PER_HR),
        accel_bias=_triple(swap_vector(entry.printed["accel_bias_m_s2"])),
        response=_triple(swap_matrix(K)[:, 2]),
        gyro_instability=instability_deg_hr * DEG_PER_HR,
        rate_hz=rate_hz or spec.rate_hz or _RATE_HZ,
    )


def drawn_emulation(spec: ImuSpec, *, seed: int = 0) -> Emulation:
    """One unit of any IMU, its fixed errors drawn from the specification.

    Parameters
    ----------
    spec : ImuSpec
        For example ``catalogue.spec("MTi-G-710")``.
    seed : int
        Seed of the unit, not of its runs.

    Returns
    -------
    Emulation
        Biases, and the errors of the gyroscopes that a rotation about the vertical excites; 1/f noise as specified.
        What else the specification has (scale factors of the accelerometers, g-sensitivity, Gauss-Markov biases) is
        left out.
    """
    drawn = ImuErrors.draw(spec, np.random.default_rng(seed))
    return Emulation(
        name=spec.name,
        gyro_random_walk=spec.gyro.random_walk,
        accel_random_walk=spec.accel.random_walk,
        gyro_bias=_triple(drawn.b_g),
        accel_bias=_triple(drawn.b_a),
        response=_triple(drawn.M_g[:, 2]),
        gyro_instability=spec.gyro.bias_instability,
        rate_hz=spec.rate_hz or _RATE_HZ,
    )


def _triple(v: FloatArray) -> Triple:
    x, y, z = (float(c) for c in v)
    return x, y, z
