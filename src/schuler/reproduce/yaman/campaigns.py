"""Campaigns that several items of the thesis need, each run once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.exceptions import InputError
from schuler.reproduce.items import Effort

if TYPE_CHECKING:
    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.calibration.field.options import FieldOptions
    from schuler.navigation.result import NavigationResult
    from schuler.recording.series import ImuSeries
    from schuler.recording.trajectory import Trajectory
    from schuler.reproduce.yaman.study.drive import Drive
    from schuler.reproduce.yaman.study.static import StaticDrift
    from schuler.reproduce.yaman.study.statistics import FieldCampaign
    from schuler.reproduce.yaman.study.unit import TurnOn
    from schuler.reproduce.yaman.study.unit_drives import FieldDrives
    from schuler.sensors.errors import ImuErrors

#: Options of the package, or the source's own: one pass, P1 and P2 as printed, gravity vector from the second half on,
#: readings averaged over 1 s, or over a whole rest: the window is not stated, and these are its ends.
Form: TypeAlias = Literal["ours", "thesis", "thesis, whole rests"]
#: Length of a rest of the routine. [s]
_REST_S = 10.0

AUTOMOTIVE, TACTICAL = "yaman-automotive", "yaman-tactical"
GRADES = (AUTOMOTIVE, TACTICAL)
#: Runs of a quick campaign by grade.
_QUICK = {AUTOMOTIVE: 32, TACTICAL: 24}
#: Units of the static test and of the drives.
_STATIC, _DRIVEN = (4, 200), (4, 20)


@dataclass(frozen=True, eq=False)
class SingleRun:
    """One automotive-grade unit, turned by the routine and calibrated.

    Attributes
    ----------
    imu : ImuSeries
        Its log.
    truth : ImuErrors
    true : ndarray, shape (p,)
        The same in the order of the calibration. SI.
    fit : FieldCalibration
    """

    imu: ImuSeries
    truth: ImuErrors
    true: np.ndarray
    fit: FieldCalibration

    def worst(self, names: tuple[str, ...]) -> float:
        """Largest error of some parameters over their claimed sigma."""
        c = self.fit.calibration
        z = np.abs(c.values - self.true) / np.sqrt(np.diag(c.covariance))
        return float(max(z[c.names.index(name)] for name in names))

    def left(self, names: tuple[str, ...]) -> float:
        """Largest error of some parameters over what was known before."""
        c = self.fit.calibration
        return float(max(abs(c[n][0] - self.true[c.names.index(n)]) / c.prior_sigma[n] for n in names))

    def reached(self, names: tuple[str, ...]) -> float:
        """Time from which all of them are known to a tenth of what was known before. [s]"""
        reached = self.fit.history.reached(0.1)
        return max(reached[name] for name in names)

    def share(self, names: tuple[str, ...], t: float) -> float:
        """Largest square root of the variance of some parameters over that at the start, at a time."""
        h = self.fit.history
        k = min(int(np.searchsorted(h.t, t)), len(h.t) - 1)
        return float(max(h.normalised[k, h.names.index(name)] for name in names))


def options_of(form: Form) -> FieldOptions:
    """Options of the calibration in one of the forms."""
    from schuler.calibration.field.options import FieldOptions

    if form == "ours":
        return FieldOptions()
    own = FieldOptions.thesis()
    return own if form == "thesis" else replace(own, block_s=_REST_S)


@cache
def single_run(effort: Effort, form: Form) -> SingleRun:
    """The unit of section 5.1: the same log for both forms."""
    from schuler.calibration.result.parameters import vector
    from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, simulated_unit
    from schuler.sensors import catalogue

    job = FieldJob(catalogue.spec(AUTOMOTIVE), options=options_of(form), rests="given" if effort.quick else "found")
    (imu, _), truth, heading = simulated_unit(job, np.random.SeedSequence(effort.seed))
    fit = calibrated(job, imu, heading)
    return SingleRun(imu, truth, vector(truth, fit.calibration.names), fit)


@cache
def campaign(effort: Effort, grade: str, form: Form) -> FieldCampaign:
    """Monte Carlo of section 5.2: both forms and grades share their draws."""
    from schuler.reproduce.yaman.study.campaign import field_campaign

    result = field_campaign(
        grade, effort.runs(_QUICK[grade], 1000), seed=effort.seed,
        options=options_of(form), rests="given" if effort.quick else "found",
        workers=1 if effort.quick else None,
    )  # fmt: skip
    if not result.complete:
        raise KeyboardInterrupt
    return result


@cache
def static_test(effort: Effort, imu: str) -> StaticDrift:
    """Units of a data sheet, calibrated and left at rest for a minute, section 6.2.1."""
    from schuler.reproduce.yaman.study.static import static_drift

    result = static_drift(
        imu, effort.runs(*_STATIC), seed=effort.seed, rests="given" if effort.quick else "found",
        rate_hz=50.0 if effort.quick else 100.0, workers=1 if effort.quick else None,
    )  # fmt: skip
    if not result.complete:
        raise KeyboardInterrupt
    return result


#: Between routine and drive, and how bad the units are beside their sheet, whose limits may be one sigma or three.
#: Neither is stated: the first is taken, the others are the ends of the set over which ranges are given.
SETTINGS: tuple[tuple[TurnOn, float], ...] = (("repeatability", 1.0), ("none", 1.0), ("repeatability", 1.0 / 3.0))


@cache
def unit_drives(effort: Effort, number: int) -> tuple[FieldDrives, ...]:
    """Units of the MPU-6000's sheet: calibrated, driven in the nine modes; for each of :data:`SETTINGS`."""
    from schuler.reproduce.yaman.study.unit import DriveScene
    from schuler.reproduce.yaman.study.unit_drives import field_drives

    scene = DriveScene.of(number, 50.0 if effort.quick else 100.0)
    done = []
    for turn_on, share in SETTINGS:
        drives = field_drives(scene, effort.runs(*_DRIVEN), seed=effort.seed, turn_on=turn_on, share=share)
        if not drives.complete:
            raise KeyboardInterrupt
        done.append(drives)
    return tuple(done)


@dataclass(frozen=True, eq=False)
class DriveRuns:
    """Solutions of one drive with the sensor errors that follow from the source's tables.

    Attributes
    ----------
    drive : Drive
    reference : Trajectory
        Calibrated IMU with full GPS, as in the source.
    solutions : dict of str to NavigationResult
        By the name of the mode.
    """

    drive: Drive
    reference: Trajectory
    solutions: dict[str, NavigationResult]

    def some(self, *names: str) -> dict[str, NavigationResult]:
        """Some of the modes."""
        return {name: self.solutions[name] for name in names}

    def rms(self, name: str, quantity: str) -> float:
        """A number of tables 6.2 and 6.3: over the run, of partial GPS over the outage."""
        from schuler.reproduce.yaman.study.modes import rms_errors
        from schuler.reproduce.yaman.study.tables import QUANTITIES

        if quantity not in QUANTITIES:
            raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
        window = self.drive.outage if name.startswith("Partial") else None
        errors = rms_errors(self.solutions[name].trajectory, self.reference, window)
        return float(errors[QUANTITIES.index(quantity)])


@cache
def drive_runs(effort: Effort, number: int) -> DriveRuns:
    """Trajectories of the nine modes."""
    from schuler.reproduce.yaman.study.drive import Drive
    from schuler.reproduce.yaman.study.modes import mode_solution
    from schuler.reproduce.yaman.study.tables import MODES, mode_name

    drive = Drive.of(number, effort.seed, 50.0 if effort.quick else 100.0)
    reference = mode_solution(drive, "Full", True, False).trajectory
    return DriveRuns(drive, reference, {mode_name(*mode): mode_solution(drive, *mode) for mode in MODES})
