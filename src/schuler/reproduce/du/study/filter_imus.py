"""The two IMUs of Du's filters, as far as they can be made up: what the thesis leaves open is assumed here, once.

The thesis states neither initial uncertainties nor noise of its filters, nor anything of the accelerometers. The
values are those under which the anchors of the digest were computed. Data sheets alone would not do: an MTi-G with a
flicker of 3600 deg/h, as printed, would drift by degrees in a minute, which it did not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.states import StateLayout, StateModel
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import DEG, MG

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
