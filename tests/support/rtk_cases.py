"""A car and a base station half a kilometre away: codes and carriers of both, integers that are known, the filter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import aided_cases as ac
import numpy as np

from schuler import frames
from schuler.filtering.engine import FilterOptions
from schuler.filtering.measurements import POSITION, merged
from schuler.filtering.states import AMBIGUITIES, StateLayout, StateModel
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.ranges import Ranges, predicted_ranges
from schuler.gnss.relative import relative_ranges
from schuler.gnss.synthetic import EXACT, L1_CYCLE, synthetic_ranges, with_arcs
from schuler.gnss.weighting import noise_scale
from schuler.navigation.aids.satellite import carrier_measurements, range_measurements
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import nees
from schuler.navigation.inputs.rtk import BaseCarriers, with_integers
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.result import NavigationResult

CODE, PHASE = 0.5, 0.003  # 1-sigma overhead [m]
LAYOUT = ac.layout("clock", "clock_drift", "clock_2")
STATES = StateLayout({**LAYOUT.models, **dict.fromkeys(AMBIGUITIES[:16], StateModel.constant(0.0))})
CONFIG = NavigationConfig.parse(
    {
        "imu": {"catalogue": "HG1700-flenniken"},
        "gnss": {
            "coupling": "tight", "lever_arm_m": tuple(ac.LEVER), "tight": {"carrier": "rtk", "systems": "GE"},
        },
    }
)  # fmt: skip


def phased(r: Ranges, phase: np.ndarray, rng: np.random.Generator) -> Ranges:
    """Ranges with carriers of these phases and noise, and whole cycles that are new where a satellite was missing."""
    _, epoch = np.unique(r.t, return_inverse=True)
    scale = noise_scale(r.elevation, r.cn0, "elevation+cn0")
    carrier = phase + PHASE * scale * rng.standard_normal(len(r))
    return with_arcs(replace(r, carrier_range=carrier, wavelength=np.full(len(r), L1_CYCLE)), epoch, rng)


def base_station(t: np.ndarray, base_e: np.ndarray, rng: np.random.Generator, noise: float = 1.0) -> Ranges:
    """Codes and carriers of a receiver at rest, whose clock runs on."""
    n = len(t)
    sky = synthetic_ranges(
        t, np.tile(base_e, (n, 1)), np.zeros((n, 3)), nominal_orbits("GE"), rng, EXACT, elevation_mask=0.14
    ).ranges
    scale = noise_scale(sky.elevation, sky.cn0, "elevation+cn0")
    exact = predicted_ranges(sky.r_sat_e, base_e)[0] + 50.0 + 0.1 * sky.t + 7.0 * (sky.group == 1)
    made = replace(sky, pseudorange=exact + noise * CODE * scale * rng.standard_normal(len(sky)))
    return phased(made, exact, rng)


@dataclass(frozen=True)
class Rtk:
    """One run: its schedule with integers, base, result, truth and NEES, carrier fixes against the true antenna."""

    prepared: PreparedRun
    base: BaseCarriers
    result: NavigationResult
    truth: ac.Truth
    nees: np.ndarray
    t_fix: np.ndarray
    fix_error: np.ndarray  # length [m]
    fix_nis: np.ndarray  # of three degrees

    @property
    def error(self) -> np.ndarray:
        """Length of the position error at the records. [m]"""
        at = self.truth.reference.at(self.result.t)
        return np.linalg.norm(self.result.states.r_eb_e - at.r_eb_e, axis=1)


def drive(duration: float) -> ac.Drive:
    return ac.Drive.of(ac.town(2.0), duration)


def run(over_drive: ac.Drive, over: Ranges, seed: int, *, integers: bool = True, slips=None, smoother=False) -> Rtk:
    """The filter on a drive of its own truth; ``slips`` [m] are added to the rover's carriers, unsaid."""
    truth = ac.Truth(over_drive, LAYOUT, np.random.default_rng([11, seed]))
    start = ac.initial(truth, STATES)
    rng = np.random.default_rng([5, seed])
    scale = noise_scale(over.elevation, over.cn0, "elevation+cn0")
    rover = ac.measured(truth, replace(over, sigma_range=CODE * scale))
    epoch = np.searchsorted(over_drive.fixes_t, over.t)
    antenna = truth.body(over_drive.at_fixes).point(truth.lever)[0]
    phase = predicted_ranges(over.r_sat_e, antenna[epoch])[0] + truth.at("clock", over.t)[:, 0]
    rover = phased(rover, phase + (0.0 if slips is None else slips), rng)
    base_e = over_drive.at_fixes.r_eb_e[0] + np.array([300.0, -500.0, 200.0])
    base = base_station(over_drive.fixes_t, base_e, rng)
    if slips is not None:
        from schuler.gnss.cycle_slips import without_slips

        rover = without_slips(rover, antenna[epoch], PHASE, [])
    ranges, carriers = relative_ranges(rover, base, base_e, sigma_code=CODE, sigma_carrier=PHASE)
    schedule = merged(
        range_measurements(ranges, ac.LEVER, gate=None), carrier_measurements(ranges, ac.LEVER, sigma=PHASE, gate=None)
    )
    options = FilterOptions(smoother=smoother)
    prepared = PreparedRun(
        None, truth.log, schedule.where(schedule.t > 1e-6), start, STATES, None, ac.NOISE, options
    )  # fmt: skip
    relative = BaseCarriers(ranges, carriers)
    if integers:
        prepared = with_integers(prepared, relative, CONFIG)
    s = prepared.schedule
    result = NavigationResult.from_run(prepared.run(), s.t, s.kind, STATES, lever_arm_b=ac.LEVER)
    at = np.searchsorted(truth.log.t, result.t - 1e-9) + 1
    fixes = s.where(s.kind == POSITION)
    d = fixes.z[:, :3] - antenna[np.searchsorted(over_drive.fixes_t, fixes.t - 1e-6)]
    d_n = np.einsum("nji,nj->ni", frames.C_en(frames.llh_from_ecef(fixes.z[:, :3])), d) if len(d) else d
    nis = np.einsum("ni,ni->n", d_n, np.linalg.solve(fixes.R, d_n[:, :, None])[:, :, 0]) if len(d) else np.zeros(0)
    return Rtk(
        prepared, relative, result, truth, nees(result, truth.reference, truth.history[at]), fixes.t,
        np.linalg.norm(d, axis=1), nis,
    )  # fmt: skip
