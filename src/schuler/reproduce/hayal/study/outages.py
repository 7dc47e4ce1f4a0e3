"""Hayal's outage study, emulated: what a multi-position calibration is worth when GPS is lost for 2 to 60 s.

A cart is pulled for 25 minutes over a car park with an HG1700 or HG1900 and 2 cm GPS at 10 Hz. The filter is seeded
with a calibration: its estimates as initial states, its covariance as initial covariance. *Original* starts from zeros
with the data sheet's 1 sigma; *3.0* has the nine accelerometer parameters calibrated; *3.3* also three biases of the
gyroscopes; *3.9* also their scale factors and non-orthogonality (attitude subset 3, three minutes each).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schuler.exceptions import DivergenceError, InputError
from schuler.navigation.evaluation.outages import OutageStatistics, outage_statistics
from schuler.plotting.table import ResultTable, TabularResult
from schuler.reproduce.hayal.study.tables import IMUS, LENGTHS, PROTOTYPE, PUBLISHED, SEEDINGS
from schuler.reproduce.hayal.study.walk import (
    CalibrationSigma,
    CartWalk,
    cart_config,
    cart_recording,
    seeded_start,
)

Progress = Callable[[float], None]


@dataclass(frozen=True)
class OutageGrid(TabularResult):
    """Outage statistics by IMU and seeding.

    Attributes
    ----------
    statistics : dict of (imu, seeding) to OutageStatistics
        All draws together, of which the filter did not diverge.
    sigma : dict of str to CalibrationSigma
    diverged : dict of (imu, seeding) to int
        Draws of which it did.
    complete : bool
    """

    statistics: dict[tuple[str, str], OutageStatistics]
    sigma: dict[str, CalibrationSigma]
    diverged: dict[tuple[str, str], int]
    complete: bool = True

    def total(self, imu: str, seeding: str, length: float) -> float:
        """Hayal's total sigma at the end of outages; infinite if a filter diverged. [m]"""
        if self.diverged.get((imu, seeding)):
            return np.inf
        return float(np.linalg.norm(self.statistics[imu, seeding].sigma(length)))

    def table(self) -> ResultTable:
        """Mean and sigma beside the prototype and the source, with the gain over Original."""
        rows = []
        for (imu, seeding), s in self.statistics.items():
            for k, length in enumerate(LENGTHS):
                mean, total = float(np.linalg.norm(s.mean(length))), self.total(imu, seeding, length)
                first = self.total(imu, "Original", length) if (imu, "Original") in self.statistics else None
                published = PUBLISHED[imu, length][SEEDINGS.index(seeding)]
                rows.append(
                    (
                        imu, seeding, length, len(s), mean, *map(float, s.sigma(length)), total,
                        float(np.linalg.norm(s.sigma(length, every_epoch=True))), s.nees(length),
                        None if first is None else 100.0 * (1.0 - total / first), PROTOTYPE[imu, seeding][k],
                        *published,
                        100.0 * (1.0 - published[1] / PUBLISHED[imu, length][0][1]),
                    )
                )  # fmt: skip
        return ResultTable(
            "Hayal, position error after outages",
            (
                "imu", "seeding", "outage_s", "outages", "mean_m", "sigma_north_m", "sigma_east_m", "sigma_down_m",
                "sigma_total_m", "sigma_every_epoch_m", "nees", "gain_percent", "prototype_m", "source_mean_m",
                "source_sigma_m", "source_gain_percent",
            ),
            tuple(rows),
            (
                "the source's errors are 4 to 40 times what the data sheets can explain; nothing is tuned to them",
                "27 of 30 states live: the lower three cross-couplings of the gyroscopes are zero in truth and filter",
            ),
            self.complete,
        )  # fmt: skip


def outage_grid(
    walk: CartWalk | None = None,
    *,
    imus: Sequence[str] = IMUS,
    seedings: Sequence[str] = SEEDINGS,
    draws: int = 2,
    outages: int = 66,
    seed: int = 1,
    gnss_every_s: float = 0.0,
    wander: bool = False,
    sigma: Mapping[str, CalibrationSigma] | None = None,
    progress: Progress | None = None,
) -> OutageGrid:
    """Run the grid.

    Parameters
    ----------
    walk : CartWalk, optional
    imus, seedings : sequence of str
    draws : int
        Sensor and calibration errors are drawn so often; the seedings and IMUs share their normalised draws.
    outages : int
        In each run, evenly spread after two minutes.
    seed : int
    gnss_every_s : float
        Use GPS only so often; 0 takes all ten a second. [s]
    wander : bool
        Biases of the data sheets' stability: False draws them as constants, as the prototype did (HG1900 7 deg/h); True
        draws the turn-on part and a flicker of the same size beside it, for which a filter has no model of finite
        order.
    sigma : mapping of str to CalibrationSigma, optional
        Uncertainty of the calibrations by IMU; left out: attitude subset 3, three minutes.
    progress : callable, optional

    Returns
    -------
    OutageGrid
        On Ctrl-C what was finished.

    References
    ----------
    Hayal (2010), sections 5.3 and 5.4, tables 5.5 to 5.7.
    """
    wrong = [x for x in (*imus, *seedings) if x not in (*IMUS, *SEEDINGS)]
    if wrong or draws < 1 or outages < 1:
        raise InputError(f"expected IMUs of {IMUS}, seedings of {SEEDINGS}, at least one draw and outage, got {wrong}")
    walk = walk or CartWalk.of()
    seeds = {imu: CalibrationSigma.of(imu) for imu in imus} if sigma is None else dict(sigma)
    last = walk.ideal.t[-1] - max(LENGTHS) - 2.0
    starts = np.linspace(min(120.0, 0.5 * last), last, outages)
    parts: dict[tuple[str, str], list[OutageStatistics]] = {}
    diverged: dict[tuple[str, str], int] = {}
    complete = True
    cases = [(imu, seeding, child) for imu in imus for seeding in seedings
             for child in range(draws)]  # fmt: skip
    try:
        for n, (imu, seeding, draw) in enumerate(cases):
            config = cart_config(imu, gnss_every_s, wander)
            recording, errors, rng = cart_recording(walk, imu, seed, draw, wander)
            initial = seeded_start(recording, config, errors, seeding, seeds[imu], rng)
            try:
                statistics = outage_statistics(recording, config, lengths=LENGTHS, starts=starts, initial=initial)
            except DivergenceError:
                diverged[imu, seeding] = diverged.get((imu, seeding), 0) + 1
            else:
                if not statistics.complete:
                    raise KeyboardInterrupt
                parts.setdefault((imu, seeding), []).append(statistics)
            if progress is not None:
                progress((n + 1) / len(cases))
    except KeyboardInterrupt:
        complete = False
    together = {
        key: replace(
            several[0],
            starts=np.concatenate([s.starts for s in several]),
            error_n=np.concatenate([s.error_n for s in several]),
            cov_n=np.concatenate([s.cov_n for s in several]),
            name=f"{key[0]}, {key[1]}",
        )
        for key, several in parts.items()
    }
    return OutageGrid(together, seeds, diverged, complete)
