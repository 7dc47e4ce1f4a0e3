"""Campaigns in lanes for the tests: the drive of `cases` with errors that the filter expects."""

from dataclasses import dataclass

import filter_cases as cases
import numpy as np

from schuler import frames
from schuler.filtering.engine import FilterOptions, ForwardRun, run
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, merged
from schuler.filtering.states import AMBIGUITIES, StateLayout, StateModel
from schuler.gnss.carrier import carrier_phases
from schuler.gnss.ranges import Ranges
from schuler.gnss.synthetic import RangeErrors
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.lanes.aiding import LaneAiding, true_gnss, true_satellites
from schuler.montecarlo.lanes.errors import LaneErrors
from schuler.montecarlo.lanes.run import LaneScenario, replay
from schuler.navigation.aids.satellite import carrier_measurements, range_measurements
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.result import NavigationResult
from schuler.navigation.states import clock_models
from schuler.simulation.gnss import GnssModel
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import Motion, MotionState
from schuler.simulation.satellites import SatelliteModel, SkyWindow, draw_satellites, prepare_sky

GNSS = GnssModel(
    sigma_position=cases.SIGMA_R, sigma_velocity=cases.SIGMA_V, lever_arm_b=cases.LEVER, first_s=1.0037
)  # fixes between samples
#: White errors and a clock as the filter takes them; three satellites in between, and none.
SKY = SatelliteModel(
    errors=RangeErrors(multipath=0.0, atmosphere=0.0, offsets=(12.0,)),
    first_s=1.0037,
    lever_arm_b=cases.LEVER,
    windows=(SkyWindow(20.0, 30.0, 3),),
    outages=((35.0, 42.0),),
)
CARRIER_SIGMA = 0.002


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
        lay.visible,
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


def sky_scenario(
    states: int = 15,
    seconds: float = 60.0,
    *,
    model: SatelliteModel = SKY,
    carrier: bool = False,
    gate: float | None = None,
    sigma_scale: float = 1.0,
    lost: tuple[tuple[float, float], ...] = (),
    **given: object,
) -> LaneScenario:
    """The same drive with single satellites."""
    body = Cut(cases.drive(seconds / 60.0), seconds)
    sky = prepare_sky(body, model)
    e, ranges = model.errors, draw_satellites(sky, model, np.random.default_rng(0)).ranges

    def measurements(r: Ranges) -> MeasurementSchedule:
        codes = range_measurements(r, model.lever_arm_b, gate=gate, sigma_scale=sigma_scale)
        if not carrier:
            return codes
        return merged(codes, carrier_measurements(r, model.lever_arm_b, sigma=CARRIER_SIGMA, gate=gate))

    models = layout(states).models | clock_models(
        ranges, offset_sigma=100.0, drift_sigma=10.0, offset_noise=np.sqrt(e.clock_psd),
        drift_noise=np.sqrt(e.drift_psd), between_sigma=20.0,
    )  # fmt: skip
    if carrier:
        channels = int(carrier_phases(ranges, CARRIER_SIGMA, len(AMBIGUITIES)).channel.max())
        models |= dict.fromkeys(AMBIGUITIES[:channels], StateModel.random_walk(0.0, e.carrier_walk))
    aiding = true_satellites(sky, model, measurements).without(lost)
    return scenario(StateLayout(models), seconds, aiding=aiding, **given)


def engine_run(scene: LaneScenario, number: int, seed: int) -> tuple[ForwardRun, np.ndarray, np.ndarray]:
    """The engine on the data of one run: errors (r, n) and sigmas (r, n) at its records, north, east, down."""
    data = replay(scene, number, seed=seed)
    forward = run(*data[:3], scene.layout, scene.gyro_psd, scene.accel_psd, scene.options)
    result = NavigationResult.from_run(forward, data.schedule.t, data.schedule.kind, scene.layout)
    at = np.searchsorted(data.increments.t, result.t - 1e-6)
    truth = scene.ideal.truth
    _, dx, P = state_errors(result, truth, data.parameters[at])
    T = ecef_from_ned_states(frames.llh_from_ecef(truth.r_eb_e[at + 1]), dx.shape[1])
    sigma = np.sqrt(np.einsum("kji,kjl,kli->ki", T, P, T))
    return forward, np.einsum("kji,kj->ki", T, dx), sigma
