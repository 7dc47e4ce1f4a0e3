"""One cheap unit, calibrated by hand and then driven: its errors, its routine, its logs of a drive raw and calibrated.

The unit is drawn from the MPU-6000's data sheet, as on the ArduPilot board of the source. Its autopilot takes the mean
of the gyroscopes off at every switch-on, Earth rate and all; without that the 20 deg/s of the sheet would make every
raw solution meaningless, and the source's raw solutions have at most a hundredth of a degree per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.calibration import FieldCalibration, calibrate_field
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.reproduce.yaman.study.drive import DRIVES, ELMADAG, GNSS_RATE_HZ, Drive, first_part, route, vibration
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import IdealImu, ideal_imu, simulate_imu
from schuler.simulation.profiles import ManoeuvreMotion
from schuler.simulation.routine import RoutineMotion
from schuler.simulation.steps import Routine
from schuler.units import DEG, G0

TurnOn: TypeAlias = Literal["repeatability", "none"]

SHEET = "MPU-6000"
#: Its sheet has no repeatability; that of the other unit in the source's appendix with one: 0.2 deg/s, 0.03 m/s^2.
REPEATABILITY = "MTi-G-710"
#: The autopilot averages the gyroscopes over this after switch-on; at rest before a drive over that. [s]
BOOT_S, START_S = 5.0, 30.0
_HEADING_SIGMA = 1.0 * DEG


@dataclass(frozen=True)
class FieldUnit:
    """A unit on two occasions.

    Attributes
    ----------
    field, drive : ImuErrors
        Its errors during the routine, and during the drive: biases differ by the repeatability, or not at all.
    turn_on : {"repeatability", "none"}
        What happened between the two: it was switched off and on, or stayed on.
    """

    field: ImuErrors
    drive: ImuErrors
    turn_on: TurnOn

    @classmethod
    def draw(cls, rng: np.random.Generator, turn_on: TurnOn = "repeatability", *, share: float = 1.0) -> FieldUnit:
        """Draw a unit.

        Parameters
        ----------
        rng : numpy.random.Generator
            The number of draws does not depend on ``turn_on``: both have the same unit.
        turn_on : {"repeatability", "none"}
        share : float
            1 sigma of the unit over the limits of the sheet: 1 as everywhere in the catalogue; a third is what a
            maker's limit often is. Repeatability and noise are typical values and stay.
        """
        if not share >= 0.0:
            raise InputError(f"share: expected a number that is not negative, got {share!r}")
        if turn_on not in ("repeatability", "none"):
            raise InputError(f"turn_on: expected 'repeatability' or 'none', got {turn_on!r}")
        entry, again = catalogue.entry(SHEET), catalogue.spec(REPEATABILITY)
        e = ImuErrors.draw(catalogue.spec(SHEET), rng, gauge="upper")
        # the sheet has 50 mg for x and y, 80 for z; a specification has one figure for three axes
        limits = np.array(entry.printed["accel_bias_mg"])
        errors = replace(
            e, b_a=share * e.b_a * limits / limits.max(), b_g=share * e.b_g, M_a=share * e.M_a, M_g=share * e.M_g,
            G_g=share * e.G_g,
        )  # fmt: skip
        z = rng.standard_normal((2, 3))
        if turn_on == "none":
            return cls(errors, errors, turn_on)
        moved = replace(
            errors, b_a=errors.b_a + again.accel.turn_on_bias * z[0], b_g=errors.b_g + again.gyro.turn_on_bias * z[1]
        )
        return cls(errors, moved, turn_on)


@dataclass(frozen=True)
class CalibratedUnit:
    """A unit with what its routine told.

    Attributes
    ----------
    unit : FieldUnit
    fit : FieldCalibration
        Calibration from readings without the offset.
    offset : ndarray, shape (3,)
        That the autopilot took off the gyroscopes when the routine began. [rad/s]
    """

    unit: FieldUnit
    fit: FieldCalibration
    offset: FloatArray

    @property
    def calibration(self) -> CalibrationResult:
        """Calibration that is applied to the log of a drive."""
        return self.fit.calibration

    @property
    def truth(self) -> ImuErrors:
        """Errors that a calibration without noise would give."""
        return replace(self.unit.field, b_g=self.unit.field.b_g - self.offset)


@dataclass(frozen=True)
class DriveScene:
    """A drive, once for any number of units.

    Attributes
    ----------
    number : {1, 2}
    motion : ManoeuvreMotion
    ideal : IdealImu
        Perfect readings of complete laps, longer than the drive: logs are cut to its length.
    outage : (float, float)
        [s]
    """

    number: int
    motion: ManoeuvreMotion
    ideal: IdealImu
    outage: tuple[float, float]

    @classmethod
    def of(cls, number: int, rate_hz: float = 100.0) -> DriveScene:
        """One of :data:`schuler.reproduce.yaman.study.drive.DRIVES`: a town drive of the source's length and
        outage.
        """
        if number not in DRIVES:
            raise InputError(f"drive: expected {' or '.join(map(str, DRIVES))}, got {number!r}")
        length, lost = DRIVES[number]
        motion = route(length + 1.0)
        begin = float(round(0.5 * length))
        return cls(number, motion, ideal_imu(motion, rate_hz), (begin, begin + lost))


def stated_spec() -> ImuSpec:
    """Specification of the unit before the routine: its sheet, gyro biases as far as the autopilot leaves any.

    What it took off held for one pose only: g-sensitivity brings it back in the others.
    """
    spec = catalogue.spec(SHEET)
    return replace(spec, gyro=replace(spec.gyro, turn_on_bias=spec.gyro.g_sensitivity * G0))


def routine_scene(routine: Routine, rate_hz: float = 100.0) -> IdealImu:
    """Readings of a perfect IMU in a routine at the place of the drives."""
    return ideal_imu(RoutineMotion(routine, ELMADAG), rate_hz)


def calibrate_unit(unit: FieldUnit, scene: IdealImu, rng: np.random.Generator) -> CalibratedUnit:
    """Turn the unit by hand and calibrate it; heading known to one degree.

    Parameters
    ----------
    unit : FieldUnit
    scene : IdealImu
        Of :func:`routine_scene`.
    rng : numpy.random.Generator
    """
    imu = simulate_imu(scene, unit.field, rng).imu
    offset = imu.rates().between(0.0, BOOT_S).gyro.mean(axis=0)
    heading = float(scene.truth.rpy_nb[0, 2] + _HEADING_SIGMA * rng.standard_normal())
    fit = calibrate_field(
        without_offset(imu, offset), stated_spec(), latitude=float(ELMADAG[0]), height=float(ELMADAG[2]),
        heading=(heading, _HEADING_SIGMA), halves=False,
    )  # fmt: skip
    return CalibratedUnit(unit, fit, offset)


def drive_logs(scene: DriveScene, calibrated: CalibratedUnit, rng: np.random.Generator) -> Drive:
    """The unit's drive, raw and calibrated.

    Parameters
    ----------
    scene : DriveScene
    calibrated : CalibratedUnit
    rng : numpy.random.Generator

    Returns
    -------
    Drive
        Raw: less the autopilot's offset. Calibrated: :meth:`CalibrationResult.apply` of that. After a new switch-on
        the offset is the mean at rest before the drive, taken again of the calibrated readings; that of a unit that
        stayed on is the one of the routine, and the calibration's gyro bias counts.
    """
    noise = rng.spawn(3)
    shaken = vibration(scene.ideal.truth, noise[0]) / scene.ideal.rate_hz
    ideal = scene.ideal._replace(gyro=scene.ideal.gyro + shaken[:, :3], accel=scene.ideal.accel + shaken[:, 3:])
    length = DRIVES[scene.number][0]
    imu = simulate_imu(ideal, calibrated.unit.drive, noise[1]).imu.between(-np.inf, length)
    if calibrated.unit.turn_on == "none":
        raw = without_offset(imu, calibrated.offset)
        corrected = calibrated.calibration.apply(raw)
    else:
        raw = without_offset(imu, mean_at_rest(imu))
        corrected = calibrated.calibration.apply(raw)
        corrected = without_offset(corrected, mean_at_rest(corrected))
    gnss = simulate_gnss(
        scene.motion,
        GnssModel(
            rate_hz=GNSS_RATE_HZ, sigma_position=(0.5, 0.5, 1.0), sigma_velocity=(0.05, 0.05, 0.05),
            drift_position=(1.8, 1.8, 5.0), drift_time=60.0,
        ),
        noise[2],
    )  # fmt: skip
    wholes = (
        Recording(x, gnss, reference=scene.ideal.truth, metadata=Metadata(name=f"drive {scene.number}, {name} IMU"))
        for name, x in (("raw", raw), ("calibrated", corrected))
    )
    logs = [first_part(whole, length) for whole in wholes]
    return Drive(scene.number, logs[0], logs[1], scene.outage)


def without_offset(imu: ImuSeries, offset: FloatArray) -> ImuSeries:
    """Gyroscopes less a constant rate (3,) [rad/s]."""
    return replace(imu, gyro=imu.gyro - offset * (imu.interval if imu.kind == "increment" else 1.0))


def mean_at_rest(imu: ImuSeries) -> FloatArray:
    """Mean rate of the log's beginning, shape (3,). [rad/s]"""
    return np.asarray(imu.rates().between(0.0, START_S).gyro.mean(axis=0))


def remaining(calibrated: CalibratedUnit, imu: ImuSeries, *, raw: bool) -> tuple[float, float]:
    """1-sigma of the sensors' remaining errors, RMS over axes and over a drive.

    Parameters
    ----------
    calibrated : CalibratedUnit
    imu : ImuSeries
        Log of the drive, for the size of specific forces and rates.
    raw : bool
        As the sheet says, or as the covariance of the calibration says; repeatability is added to the latter after a
        new switch-on.

    Returns
    -------
    accel, gyro : float
        [m/s^2], [rad/s]

    Notes
    -----
    Where the mean at rest was taken off, what is left of the gyroscopes' biases is the noise of that mean and the Earth
    rate in it, and g-sensitivity acts on what differs from the specific force at rest. See :func:`reading_sigma`.
    """
    result, spec = calibrated.calibration, stated_spec()
    names = result.names
    P = np.diag([result.prior_sigma[n] ** 2 for n in names]) if raw else np.array(result.covariance)
    again = calibrated.unit.turn_on != "none"
    at_rest = np.zeros(3)
    if raw or again:
        at_rest = imu.rates().between(0.0, START_S).accel.mean(axis=0)
        b_g = np.array([n.startswith("b_g") for n in names])
        P[b_g, :] = P[:, b_g] = 0.0
        averaged = START_S if again else BOOT_S
        P[b_g, b_g] = spec.gyro.random_walk**2 / averaged + earth.WGS84.omega_ie**2 / 3.0
    if again and not raw:
        b_a = np.array([n.startswith("b_a") for n in names])
        P[b_a, b_a] += catalogue.spec(REPEATABILITY).accel.turn_on_bias ** 2
    return reading_sigma(names, P, imu, at_rest)


def reading_sigma(
    names: Sequence[str], covariance: FloatArray, imu: ImuSeries, at_rest: FloatArray | None = None
) -> tuple[float, float]:
    """1-sigma of readings whose parameters are uncertain, RMS over axes and over a log.

    Parameters
    ----------
    names : sequence of str
        See :mod:`schuler.calibration.result.parameters`.
    covariance : ndarray, shape (p, p)
        SI.
    imu : ImuSeries
        How large specific forces and rates are; means over a second, to leave vibration out.
    at_rest : ndarray, shape (3,), optional
        Specific force at which g-sensitivity has no effect since its offset was taken off. [m/s^2]

    Returns
    -------
    accel, gyro : float
        [m/s^2], [rad/s]

    Notes
    -----
    The error of a reading is linear in the parameters, ``J p``; its mean square over the log is ``sum_kl P_kl
    mean(J_k J_l)``.
    """
    f, w = _means(imu)
    sources = {"M_a": f, "M_g": w, "G_g": f if at_rest is None else f - at_rest}
    sums = {"a": 0.0, "g": 0.0}
    for triad in sums:
        for axis in "xyz":
            own = [k for k, n in enumerate(names) if n[2] == triad and n[4] == axis]
            J = np.ones((len(f), len(own)))
            for i, k in enumerate(own):
                if names[k][0] != "b":
                    J[:, i] = sources[names[k][:3]][:, "xyz".index(names[k][5])]
            sums[triad] += float(np.sum(covariance[np.ix_(own, own)] * (J.T @ J))) / len(f)
    return float(np.sqrt(sums["a"] / 3.0)), float(np.sqrt(sums["g"] / 3.0))


def _means(imu: ImuSeries) -> tuple[FloatArray, FloatArray]:
    """Means over whole seconds. Shapes (n, 3). [m/s^2], [rad/s]"""
    rates = imu.rates()
    m = round(rates.rate_hz)
    n = len(rates) // m * m
    f, w = (x[:n].reshape(-1, m, 3).mean(axis=1) for x in (rates.accel, rates.gyro))
    return f, w
