"""Section 3.4 and table 4.5: calibration by rotation and its accuracy."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, digits, shown
from schuler.reproduce.du.bands import ERRORS, interruptible
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR, PPM

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure
    from schuler.reproduce.du.study.accuracy import CalibrationAccuracy, CalibrationTrials

IMUS = ("NAV440", "MTi-G")
_MISPRINT = {("NAV440", 60.0): "14.2"}


def _predicted(imu: str) -> list[CalibrationAccuracy]:
    from schuler.reproduce.du.study.accuracy import predicted_accuracy
    from schuler.reproduce.du.study.imus import emulation
    from schuler.reproduce.du.study.tables import RATES_DEG_S

    walk = emulation(imu).gyro_random_walk
    return [predicted_accuracy(walk, rate * DEG) for rate in RATES_DEG_S]


@cache
def _trials(imu: str, effort: Effort) -> CalibrationTrials:
    from schuler.reproduce.du.study.accuracy import calibration_trials
    from schuler.reproduce.du.study.imus import emulation
    from schuler.reproduce.du.study.tables import RECOMMENDED_DEG_S

    unit = emulation(imu, rate_hz=5.0 if effort.quick else None)
    with interruptible():
        return calibration_trials(
            unit,
            rate_deg_s=RECOMMENDED_DEG_S[imu],
            runs=effort.runs(100, 500),
            seed=effort.seed,
            workers=1 if effort.quick else None,
        )


def _figure(effort: Effort) -> Figure:
    from schuler.reproduce.du.study.figures import accuracy_figure

    return accuracy_figure({i: _predicted(i) for i in IMUS}, {i: _trials(i, effort) for i in IMUS})


def _table_4_5(effort: Effort) -> Outcome:
    from schuler.reproduce.du.study.tables import BIAS_DEG_HR, CALIBRATION_PPM

    cells: list[Cell] = []
    for imu in IMUS[::-1]:
        row = _predicted(imu)
        cells.append(digits(f"{imu}: bias", f"{BIAS_DEG_HR[imu]:.1f}", row[0].bias / DEG_PER_HR, unit="deg/h"))
        for one, printed in zip(row, CALIBRATION_PPM[imu], strict=True):
            rate, ours = round(one.rate / DEG, 6), one.response_source / PPM
            name, wrong = f"{imu}, {rate:g} deg/s", _MISPRINT.get((imu, rate))
            if wrong is None:
                cells.append(digits(name, f"{printed:.1f}", ours, unit="ppm"))
            else:
                cells.append(
                    against(name, printed, ours, absolute=0.05, unit="ppm", tolerance="printed digits",
                            reference="corrected", source=wrong)
                )  # fmt: skip
    return Outcome(
        tuple(cells),
        "The thesis prints 14.2 ppm for NAV440 at 60 deg/s; its formula gives 14.3.",
        (lambda: _figure(effort),),
    )


def _largest_of(n: int) -> float:
    """Bound that the largest of n means exceeds by chance as often as one of them three standard errors."""
    from scipy.special import ndtr, ndtri

    return float(ndtri(1.0 - ndtr(-ERRORS) / n))


def _achieved(effort: Effort) -> Outcome:
    from schuler.reproduce.du.study.tables import BIAS_DEG_HR, CALIBRATION_PPM, RATES_DEG_S

    cells: list[Cell] = []
    for imu in IMUS:
        trials = _trials(imu, effort)
        rate = abs(trials.predicted.rate) / DEG
        rms = {name: float(np.sqrt(np.mean(x**2))) for name, x in trials.errors.items()}
        # of three gyroscopes in every trial
        half = ERRORS / float(np.sqrt(2.0 * trials.errors["bias"].size))
        printed = CALIBRATION_PPM[imu][RATES_DEG_S.index(round(rate, 6))]
        title = f"{imu}, {rate:g} deg/s"
        worst = max(
            float(np.abs(np.mean(x, axis=0)).max()) / (float(np.std(x)) / float(np.sqrt(len(x))))
            for x in trials.errors.values()
        )
        cells += [
            against(f"{title}: bias", BIAS_DEG_HR[imu], rms["bias"] / DEG_PER_HR, relative=half, unit="deg/h"),
            against(f"{title}: responses", printed, rms["response"] / PPM, relative=half, unit="ppm"),
            against(f"{title}: responses, corrected", float(np.sqrt(2.0)) * printed,
                    rms["response"] / PPM, relative=half, unit="ppm", reference="corrected", source="sqrt 2 of (3.49)"),
            against(f"{title}: left at the rate, over the bias", 1.0, rms["at_rate"] / rms["bias"], relative=2.0 * half,
                    reference="corrected", source="not in the thesis"),
            against(f"{title}: largest mean error, in its 1-sigma", 0.0, worst, absolute=_largest_of(9),
                    source="estimates are unbiased"),
        ]  # fmt: skip
        cells.append(shown(f"{title}: trials", float(len(trials.errors["bias"]))))
    return Outcome(
        tuple(cells),
        "(3.49) leaves out the noise of the bias that is subtracted before the responses are found: with a minute of "
        "each they scatter by sqrt 2 more. At the rate of the calibration that does not matter, since bias and "
        "response together are the mean while turning.",
        (lambda: _figure(effort),),
    )


def _earth_rate(effort: Effort) -> Outcome:
    from schuler import earth

    left = float(earth.WGS84.omega_ie * np.sin(45.0 * DEG))
    return Outcome(
        (
            against("azimuth after 300 s by the Earth's rate left in the bias, 45 deg", 0.9, left * 300.0 / DEG,
                    absolute=0.05, unit="deg", tolerance="printed digits", reference="corrected",
                    source="left out of (3.45)"),
        ),
        "(3.45) drops the Earth's rate: 15 deg/h is not small beside the 3 deg/h to which a minute finds the bias of "
        "NAV440. Ours takes it out with the vehicle's attitude.",
    )  # fmt: skip


ITEMS = (
    Item("text-3.4.1", "Earth rate in a calibration by rotation", "exact", _earth_rate),
    Item("text-3.4.2", "Accuracy that trials of the calibration reach", "statistical", _achieved),
    Item("table-4.5", "Accuracy of the calibration by the noise of the gyroscopes", "exact", _table_4_5),
)
