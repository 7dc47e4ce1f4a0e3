"""Every aid beside GNSS solutions is as good as the filter says: NEES and NIS with parameters drawn from their models.

Tolerances of campaigns are chi-square bands of 99.99 percent and 4.5 standard errors, see ``aided_cases.Campaign``.
"""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest
from filter_cases import stream

from schuler import earth
from schuler.filtering import engine
from schuler.filtering import measurements as ms
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.measurements import merged
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.navigator import Navigator

ORDER = 0.02  # of a sigma: what relinearisation moves; 0.003 was seen
RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]

#: Blocks estimated beside the biases, and what is measured.
CONFIGURATIONS = {
    "gnss": ((), [ac.gnss]),
    "zero velocity": ((), [ac.gnss, ac.zero_velocity]),
    "lateral and vertical": (("mount", "lever_v"), [ac.gnss, ac.wheels]),
    "odometer": (("mount", "lever_v", "odometer"), [ac.gnss, ac.wheels, ac.odometer]),
    "heading": (("b_heading",), [ac.gnss, ac.heading]),
    "barometer": (("baro",), [ac.gnss, ac.height]),
    "known places": ((), [ac.gnss, ac.known_places]),
    "antenna lever arm": (("lever",), [ac.gnss]),
    "27 states": (("S_a", "S_g", "b_a_run", "b_g_run"), [ac.gnss]),
    "all": (
        ("lever", "lever_v", "mount", "odometer", "b_heading", "baro"),
        [ac.gnss, ac.zero_velocity, ac.wheels, ac.odometer, ac.heading, ac.height, ac.known_places],
    ),
}


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_nees_of_each_aid(drive, name, runs):
    blocks, aids = CONFIGURATIONS[name]
    ac.Campaign.of(drive, ac.layout(*blocks), aids, range(runs)).check()


@pytest.mark.parametrize("runs", RUNS)
def test_nees_with_aids_through_outages(drive, runs):
    """No GNSS from 30 to 60 and from 75 to 105 s: wheels, heading and height carry the solution and stay honest."""

    def with_outages(truth):
        return ac.gnss(truth, keep=lambda t: ~(((t > 30) & (t < 60)) | ((t > 75) & (t < 105))))

    lay = ac.layout("mount", "lever_v", "odometer", "baro")
    aids = [with_outages, ac.zero_velocity, ac.wheels, ac.odometer, ac.height]
    campaign = ac.Campaign.of(drive, lay, aids, range(runs))
    campaign.check(looks=(30, 45, 58, 62, 90, 103, 115))


@pytest.mark.parametrize("runs", RUNS)
def test_nees_of_zero_rotation(drive, runs):
    """The means of the log at rest share their noise with the attitude, which the filter does not know.

    Seen over 400 runs: NEES 1.030 (1.000 without these updates), so nothing to worry about, but no exact 1 either.
    """
    campaign = ac.Campaign.of(drive, ac.layout(), [ac.gnss, ac.zero_velocity, ac.zero_rate], range(runs))
    low, high = chi_square_band(15, runs, 0.9999)
    at = campaign.nees[:, [10, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high + 0.03)), (low, at, high)
    low, high = chi_square_band(campaign.freedom, runs, 0.9999)
    assert low < campaign.nis.mean() < high


@pytest.mark.campaign
def test_zero_rotation_with_noise_of_its_own_is_exact(drive):
    """Earth rate, bias and independent noise: no excess is left."""

    def apart(truth):
        s = ac.zero_rate(truth)
        C = truth.body(truth.drive.motion.state(s.t)).C
        z = s.z.copy()
        z[:, :3] = C[:, 2, :] * earth.WGS84.omega_ie + truth.at("b_g", s.t - 0.5)
        z[:, :3] += np.sqrt(s.R[:, :1, 0]) * truth.draws(len(s), 3)
        return replace(s, z=z)

    ac.Campaign.of(drive, ac.layout(), [ac.gnss, ac.zero_velocity, apart], range(40)).check()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_wrong_stamps_are_estimated(drive, sign):
    """GNSS stamps wrong by +-0.1 s: the delay is found, and the solution is as good as it says.

    The model is of first order in the delay: jerk, and the antenna's turning about the IMU, are left out. Seen over
    400 runs of delays drawn with 0.1 s: NIS 1.032, NEES 1.039; NIS 1.019, NEES 1.017 without a lever arm.
    """
    runs = 40
    campaign = ac.Campaign.of(drive, ac.layout("delay"), [ac.gnss], range(runs), given={"delay": sign * 0.1})
    low, high = chi_square_band(16, runs, 0.9999)
    at = campaign.nees[:, [30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high + 0.05)), at
    low, high = chi_square_band(campaign.freedom, runs, 0.9999)
    assert low < campaign.nis.mean() < high + 0.03
    one = ac.filtered(drive, ac.layout("delay"), [ac.gnss], 0, given={"delay": sign * 0.1})
    sigma = one.result.sigma("delay")[-1, 0]
    assert sigma < 0.003
    assert abs(one.result.parameter("delay")[-1, 0] - sign * 0.1) < 5.0 * sigma  # statistical, and what is left out


@pytest.mark.thinned(2)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_positions_alone_find_wrong_stamps(drive, sign):
    """Without velocities, which tell the delay sooner and would hide a fault of the positions' part."""

    def positions(truth):
        return ac.gnss(truth, velocity=False)

    runs = 40
    campaign = ac.Campaign.of(drive, ac.layout("delay"), [positions], range(runs), given={"delay": sign * 0.1})
    campaign.check(looks=(60, 90, 115))
    one = ac.filtered(drive, ac.layout("delay"), [positions], 0, given={"delay": sign * 0.1})
    sigma = one.result.sigma("delay")[-1, 0]
    assert sigma < 0.05
    assert abs(one.result.parameter("delay")[-1, 0] - sign * 0.1) < 4.5 * sigma  # statistical


def test_wrong_stamps_that_are_believed_spoil_the_solution(drive):
    """The same 0.1 s without the state: NEES far above its band."""
    lay = ac.layout("delay")
    wrong = ac.Campaign.of(drive, lay, [ac.gnss], range(5), given={"delay": 0.1}, filter_layout=ac.layout())
    assert wrong.nees[:, [30, 60, 90]].mean() > 2.0


ALL = (
    "lever", "lever_v", "mount", "odometer", "clock", "clock_drift", "clock_2", "clock_3", "clock_4", "b_heading",
    "baro", "b_r", "b_v", "delay",
)  # fmt: skip
EITHER = {
    "lever": [ac.gnss],
    "lever_v": [ac.gnss, ac.wheels, ac.odometer],
    "mount": [ac.gnss, ac.wheels],
    "odometer": [ac.gnss, ac.odometer],
    "b_heading": [ac.gnss, ac.heading],
    "baro": [ac.gnss, ac.height],
    "b_r": [ac.gnss, ac.known_places],
    "b_v": [ac.gnss, ac.zero_velocity],
    "delay": [ac.gnss],
}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("block", EITHER)
def test_each_block_is_estimated_with_either_sign(drive, block, sign):
    """One block off by its sigma, nothing else wrong and hardly any noise: its estimate goes there, not away."""
    lay = ac.layout(block)
    size = lay[block].stop - lay[block].start
    zero = {name: np.zeros(3) for name in ("b_a", "b_g")}
    value = sign * lay.models[block].sigma * np.ones(size)
    one = ac.filtered(drive, lay, EITHER[block], 5, given=zero | {block: value}, noise=0.02)
    _, dx, P = state_errors(one.result, one.truth.reference, one.parameters)
    part = lay[block]
    sigma = np.sqrt(np.diag(P[-1]))[part]
    # statistical: noise is 2 percent of what the filter takes it for, so errors are far below a sigma
    assert np.all(np.abs(dx[-1, part]) < 1.0 * sigma + 0.02 * np.abs(value)), dx[-1, part] / sigma
    observable = sigma < 0.5 * lay.models[block].sigma
    assert observable.sum() >= {"b_r": 0, "b_v": 0, "lever": 2, "lever_v": 1}.get(block, size)
    last = one.parameters[-1, part.start - 9 : part.stop - 9]
    estimate = one.result.parameters[-1, part.start - 9 : part.stop - 9]
    assert np.all(np.sign(last[observable]) * estimate[observable] > 0.0)


def everything(drive, seed=2, gate=0.9999):
    """A log with a measurement of every kind but resets, all blocks in the layout, some conditions not met."""
    truth = ac.Truth(drive, ac.layout(*ALL), np.random.default_rng(seed))
    over = ac.sky(drive, "GREC", 8)
    aids = [
        ac.gnss, ac.zero_velocity, ac.zero_rate, ac.wheels, ac.odometer, ac.heading, ac.height, ac.known_places,
        ac.gravity, ac.gravity_vector, ac.earth_rate, ac.earth_rate_magnitude, ac.satellites(over, gate=gate),
    ]  # fmt: skip
    schedule = merged(*(aid(truth) for aid in aids))
    late = schedule.where((schedule.kind == ms.HEADING) & (schedule.t > 20.0))
    return truth, merged(schedule, replace(late, kind=np.full(len(late), ms.GNSS_HEADING)))


@pytest.mark.parametrize("reset", [False, True])
def test_live_navigator_gives_the_batch_numbers_for_every_kind(drive, reset):
    """Bit for bit, with the covariance carried at every sample: a batch run also stops for its records."""
    truth, schedule = everything(drive)
    if reset:
        s = schedule.where((schedule.t > 20.0) & (schedule.kind == ms.POSITION))
        schedule = merged(schedule, replace(s, kind=np.full(len(s), ms.RESET_POSITION)))
    log = truth.log.between(0.0, 40.0)
    schedule = schedule.where(schedule.t < log.t[-1])
    start, options = ac.initial(truth), FilterOptions(covariance_rate_hz=None)
    batch = run(log, schedule, start, truth.layout, *ac.NOISE, options)
    live = Navigator(start, truth.layout, *ac.NOISE, interval_s=0.01, options=options)
    stream(live, log, schedule)
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_array_equal(live.parameters, batch.rec_est[-1])
    np.testing.assert_array_equal([o.nis for o in live.outcomes], batch.nis)
    assert [o.kind for o in live.outcomes] == [ms.KINDS[k] for k in schedule.kind]
    assert [o.status for o in live.outcomes] == [ms.STATUS[s] for s in batch.status]
    kinds = set(schedule.kind.tolist())
    assert kinds >= set(ms.KINDS) - {*ms.RESET_KINDS, ms.ARC_START, ms.CARRIER_PHASE}  # these: test_carrier_phases
    for kind in kinds:
        assert np.any(batch.status[schedule.kind == kind] == ms.ACCEPTED), ms.KINDS[kind]
    assert np.any(batch.status == ms.GATED)


def test_order_of_measurements_of_one_time_hardly_matters(drive):
    """All kinds at common times, shuffled within each: only linearisation moves, by parts of a sigma.

    Without the magnitude of Earth rate, the direction of which is mostly noise: with it 0.09 sigma were seen.
    """
    truth, schedule = everything(drive, gate=None)
    schedule = schedule.where(schedule.kind != ms.EARTH_RATE_MAGNITUDE)
    schedule = replace(schedule, gate=np.where(schedule.gate < 0.0, -1.0, np.inf))
    shuffled = schedule.where(np.lexsort((np.random.default_rng(0).random(len(schedule)), schedule.t)))
    assert np.mean(np.diff(schedule.t) == 0.0) > 0.8
    start = ac.initial(truth)
    a, b = (run(truth.log, s, start, truth.layout, *ac.NOISE) for s in (schedule, shuffled))
    P, Q = (engine.unpack_symmetric(x.rec_P, truth.layout.size) for x in (a, b))
    d = np.sqrt(np.einsum("kii->ki", P))
    moved = np.concatenate((a.rec_nav[:, 4:] - b.rec_nav[:, 4:], a.rec_est - b.rec_est), axis=1) / d[:, 3:]
    settled = a.rec_t > 40.0
    assert np.abs(moved[settled]).max() < ORDER
    assert np.abs(((P - Q) / (d[:, :, None] * d[:, None, :]))[settled]).max() < ORDER
