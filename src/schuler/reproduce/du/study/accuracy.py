"""Accuracy of a calibration by rotation: Table 4.5, its prediction corrected, and what trials achieve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.montecarlo.engine import campaign
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.plotting.table import ResultTable
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.imus import Emulation, emulation
from schuler.reproduce.du.study.trial import Trial, calibration_run, whole_turns
from schuler.units import DEG, DEG_PER_HR, MIN, PPM


@dataclass(frozen=True)
class CalibrationAccuracy:
    """1-sigma of what a rest and a rotation about one axis tell, from white noise alone; each axis of the gyroscopes.

    Attributes
    ----------
    rate : float
        Rate of the rotation. [rad/s]
    rest_s, turning_s : float
        [s]
    bias : float
        ``ARW / sqrt(T_rest)``, (3.48). [rad/s]
    response : float
        Scale factor and installation errors: ``ARW / rate * sqrt(1 / T_turning + 1 / T_rest)``. [-]
    response_source : float
        (3.49) as the thesis has it, without the noise of the bias that is subtracted: ``sqrt(2)`` too small for equal
        times. [-]
    at_rate : float
        Bias left at this rate once both are compensated: that of the mean while turning, because what is applied,
        bias plus response times rate, is that mean. [rad/s]
    """

    rate: float
    rest_s: float
    turning_s: float
    bias: float
    response: float
    response_source: float
    at_rate: float


def predicted_accuracy(
    random_walk: float, rate: float, *, rest_s: float = 60.0, turning_s: float = 60.0
) -> CalibrationAccuracy:
    """Predict the accuracy of a calibration by rotation.

    Parameters
    ----------
    random_walk : float
        Angle random walk of the gyroscopes. [rad/sqrt(s)]
    rate : float
        Rate of the rotation; the sign does not matter. [rad/s]
    rest_s, turning_s : float
        Times at rest and turning. [s]

    Returns
    -------
    CalibrationAccuracy

    Raises
    ------
    InputError
        If the noise is negative, or a time or the rate is not positive.

    References
    ----------
    Du (2015), eqs. (3.48), (3.49); the latter corrected.
    """
    if not (random_walk >= 0.0 and np.isfinite(random_walk)):
        raise InputError(f"random_walk: expected a number of zero or more, got {random_walk!r}")
    for name, value in (("rate", abs(rate)), ("rest_s", rest_s), ("turning_s", turning_s)):
        if not (value > 0.0 and np.isfinite(value)):
            raise InputError(f"{name}: expected a finite number other than zero, times positive, got {value!r}")
    w = abs(rate)
    return CalibrationAccuracy(
        rate,
        rest_s,
        turning_s,
        bias=random_walk / float(np.sqrt(rest_s)),
        response=random_walk / w * float(np.sqrt(1.0 / turning_s + 1.0 / rest_s)),
        response_source=random_walk / w / float(np.sqrt(turning_s)),
        at_rate=random_walk / float(np.sqrt(turning_s)),
    )


def table_4_5() -> ResultTable:
    """Predicted accuracy for a minute at rest and a minute turning, by IMU and rate: as printed, ours, corrected.

    References
    ----------
    Du (2015), eqs. (3.48), (3.49) and table 4.5.
    """
    rows: list[tuple[Any, ...]] = []
    for name in thesis.IMUS:
        walk = emulation(name).gyro_random_walk
        for rate, printed in zip(thesis.RATES_DEG_S, thesis.CALIBRATION_PPM[name], strict=True):
            one = predicted_accuracy(walk, rate * DEG)
            rows.append(
                (name, rate, printed, round(one.response_source / PPM, 1), round(one.response / PPM, 1),
                 thesis.BIAS_DEG_HR[name], round(one.bias / DEG_PER_HR, 1), round(one.at_rate / DEG_PER_HR, 1))
            )  # fmt: skip
    return ResultTable(
        "Table 4.5: 1-sigma of scale factor and installation errors found by rotation, 60 s at rest and 60 s turning",
        (
            "imu", "rate_deg_s", "thesis_ppm", "formula_ppm", "corrected_ppm", "thesis_bias_deg_hr", "bias_deg_hr",
            "left_at_rate_deg_hr",
        ),
        tuple(rows),
        (
            "the thesis prints 14.2 ppm for NAV440 at 60 deg/s; its formula gives 14.3",
            "corrected: with the noise of the bias that is subtracted, sqrt(2) more for equal times",
            "left at the rate: bias and response together are the mean while turning, so this is its noise alone",
        ),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class CalibrationTrials:
    """Errors of many calibrations, estimate minus truth, of the three gyroscopes.

    Attributes
    ----------
    imu : Emulation
    predicted : CalibrationAccuracy
    errors : dict of str to ndarray, shape (runs, 3)
        ``bias`` [rad/s], ``response`` [-], ``at_rate`` [rad/s].
    """

    imu: Emulation
    predicted: CalibrationAccuracy
    errors: dict[str, FloatArray]

    def table(self) -> ResultTable:
        """Standard deviation about the truth beside the prediction, with 95 % interval; mean over its own 1-sigma."""
        rows: list[tuple[Any, ...]] = []
        for name, unit, scale in (
            ("bias", "deg_hr", DEG_PER_HR), ("response", "ppm", PPM), ("at_rate", "deg_hr", DEG_PER_HR),
        ):  # fmt: skip
            x = self.errors[name]
            n = x.size
            rms = float(np.sqrt(np.mean(x**2)))
            low, high = chi_square_band(n, 1, 0.95)
            expected = float(getattr(self.predicted, name))
            worst = float(np.abs(x.mean(axis=0)).max() / (expected / np.sqrt(len(x))))
            rows.append(
                (f"{name}_{unit}", expected / scale, rms / scale, rms / np.sqrt(high) / scale,
                 rms / np.sqrt(low) / scale, rms / expected, worst)
            )  # fmt: skip
        return ResultTable(
            f"{self.imu.name} at {self.predicted.rate / DEG:g} deg/s: {len(self.errors['bias'])} calibrations of "
            f"{self.predicted.rest_s:g} s at rest and {self.predicted.turning_s:g} s turning",
            ("quantity", "predicted", "achieved", "low_95", "high_95", "ratio", "largest_mean_sigmas"),
            tuple(rows),
            ("largest mean: of the three gyroscopes, in 1-sigma of such a mean; above 3 is a bias",),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()


def calibration_trials(
    imu: str | Emulation,
    *,
    rate_deg_s: float = 20.0,
    runs: int = 500,
    seed: int = 0,
    workers: int | None = None,
) -> CalibrationTrials:
    """Calibrate an emulated IMU many times, and compare with the prediction.

    Parameters
    ----------
    imu : {"NAV440", "MTi-G"} or Emulation
    rate_deg_s : float
        [deg/s]
    runs, seed, workers
        See :func:`schuler.reproduce.du.study.static.static_test`.

    Returns
    -------
    CalibrationTrials
        Of a minute at rest, and whole revolutions of a minute or more.

    Raises
    ------
    InputError
        If the rate is zero, there are fewer than two runs, or they were interrupted.
    """
    unit = emulation(imu) if isinstance(imu, str) else imu
    if not rate_deg_s or runs < 2:
        raise InputError(f"expected a rate other than zero and two runs or more, got {rate_deg_s} deg/s, {runs}")
    turning = whole_turns(rate_deg_s * DEG, MIN)
    trial = Trial(
        imu=unit, rate=rate_deg_s * DEG, rest_s=MIN, turning_s=MIN, start_s=float(np.ceil(MIN + turning)),
        duration_s=1.0,
    )  # fmt: skip
    trials = campaign(calibration_run, trial, runs, seed=seed, workers=workers, keep=True)
    if not trials.complete:
        raise InputError("interrupted before all runs were done")
    predicted = predicted_accuracy(unit.gyro_random_walk, rate_deg_s * DEG, rest_s=MIN, turning_s=turning)
    return CalibrationTrials(unit, predicted, {k: trials.column(k) for k in ("bias", "response", "at_rate")})


def achieved(trials: Sequence[CalibrationTrials]) -> ResultTable:
    """Several trials below each other, one row a quantity."""
    rows = tuple(
        (t.imu.name, t.predicted.rate / DEG, *row) for t in trials for row in t.table().rows
    )  # fmt: skip
    columns = ("imu", "rate_deg_s", *trials[0].table().columns) if trials else ()
    if not trials:
        raise InputError("expected at least one set of trials")
    return ResultTable("Calibration by rotation: predicted and achieved", columns, rows, trials[0].table().notes)
