"""Campaigns in lanes for the tests: the drive of `cases` with errors that the filter expects."""

from dataclasses import dataclass

import filter_cases as cases
import numpy as np

from schuler import frames
from schuler.filtering.engine import FilterOptions, ForwardRun, run
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.lanes.aiding import LaneAiding, true_gnss
from schuler.montecarlo.lanes.errors import LaneErrors
from schuler.montecarlo.lanes.run import LaneScenario, replay
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.result import NavigationResult
from schuler.simulation.gnss import GnssModel
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import Motion, MotionState

GNSS = GnssModel(
    sigma_position=cases.SIGMA_R, sigma_velocity=cases.SIGMA_V, lever_arm_b=cases.LEVER, first_s=1.0037
)  # fixes between samples


@dataclass(frozen=True)
class Cut:
    """The first seconds of a motion."""

    motion: Motion
    duration: float

    def state(self, t: np.ndarray) -> MotionState:
        return self.motion.state(t)


def layout(states: int) -> StateLayout:
    return cases.layout(states) if states > 9 else StateLayout({})


def scenario(
    states: int | StateLayout = 15,
    seconds: float = 60.0,
    *,
    motion: Motion | None = None,
    rate_hz: float = 100.0,
    gnss: GnssModel | None = GNSS,
    gate: float | None = None,
    aiding: LaneAiding | None = None,
    errors: LaneErrors | None = None,
    nees: tuple[str, ...] = ("all",),
    attitude: np.ndarray = cases.START_ATT,
    **options,
) -> LaneScenario:
    body = Cut(cases.drive(seconds / 60.0) if motion is None else motion, seconds)
    ideal = ideal_imu(body, rate_hz)
    lay = layout(states) if isinstance(states, int) else states
    if aiding is None:
        aiding = LaneAiding.none() if gnss is None else true_gnss(body, gnss, gate=gate)
    T = ideal.truth
    start = InitialState.from_sigmas(
        NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0]),
        lay,
        attitude=attitude,
        velocity=cases.START_V,
        position=cases.START_R,
    )
    if errors is None:
        errors = LaneErrors.of_layout(lay, np.full(3, cases.GYRO_N), np.full(3, cases.ACCEL_N), rate_hz)
    noise = (np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2))
    return LaneScenario(
        ideal, errors, aiding, lay, start, *noise, FilterOptions(**({"record_s": 10.0} | options)), nees
    )


def engine_run(scene: LaneScenario, number: int, seed: int) -> tuple[ForwardRun, np.ndarray, np.ndarray]:
    """The engine on the data of one run: errors (r, n) and sigmas (r, n) at its records, north, east, down."""
    data = replay(scene, number, seed=seed)
    forward = run(*data[:3], scene.layout, scene.gyro_psd, scene.accel_psd, scene.options)
    result = NavigationResult.from_run(forward, data.schedule.t, data.schedule.kind, scene.layout)
    at = np.searchsorted(data.increments.t, result.t - 1e-6)
    truth = scene.ideal.truth
    _, dx, P = state_errors(result, truth, data.parameters[at])
    T = ecef_from_ned_states(frames.llh_from_ecef(truth.r_eb_e[at + 1]), scene.layout.size)
    sigma = np.sqrt(np.einsum("kji,kjl,kli->ki", T, P, T))
    return forward, np.einsum("kji,kj->ki", T, dx), sigma
