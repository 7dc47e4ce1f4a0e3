"""Carrier phases with ambiguities as states: rows against a numerical twin, honest forward and backward, slips."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.filtering import engine
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.filter_arrays import nothing_after
from schuler.filtering.limits import MAX_STATES
from schuler.filtering.measurements import ACCEPTED, ARC_START, CARRIER_PHASE, GATED, REJECTED, STATUS, merged
from schuler.filtering.states import AMBIGUITIES, CHANNELS, StateLayout, StateModel
from schuler.gnss.ranges import predicted_ranges
from schuler.navigation.aids.satellite import carrier_measurements, range_measurements
from schuler.navigation.evaluation.consistency import chi_square_band, nees
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult

RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]
CLOCK = ("clock", "clock_drift")
SIGMA, WALK = 0.003, 0.005  # of phases: white [m], random walk [m/sqrt(s)]
CYCLE = 0.1903


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


def with_ambiguities(lay: StateLayout, count: int = 10, walk: float = WALK) -> StateLayout:
    """The layout with states for the ambiguities of some satellites."""
    return StateLayout({**lay.models, **dict.fromkeys(AMBIGUITIES[:count], StateModel.random_walk(0.0, walk))})


def with_phases(truth, over, *, white=SIGMA, walk=WALK):
    """Ranges with carriers: clock, an ambiguity, white noise and a random walk."""
    ranges = ac.measured(truth, over)
    epoch = np.searchsorted(truth.drive.fixes_t, over.t)
    r, _ = (x[epoch] for x in truth.body(truth.drive.at_fixes).point(truth.lever))
    phase = predicted_ranges(over.r_sat_e, r)[0] + truth.at("clock", over.t)[:, 0] + 1000.0 * CYCLE * over.sat
    order = np.lexsort((over.t, over.sat))
    walked = np.empty(len(over))
    walked[order] = np.cumsum(truth.draws(len(over)))  # an epoch a second
    return replace(ranges, carrier_range=phase + walk * walked + white * truth.draws(len(over)))


def carriers(over, *, white=SIGMA, walk=WALK, gate=None, slips=None):
    """Aid: ranges, and carriers whose noise is the same at all elevations."""

    def aid(truth):
        ranges = with_phases(truth, over, white=white, walk=walk)
        if slips is not None:
            ranges = replace(ranges, carrier_range=ranges.carrier_range + slips)
        phases = carrier_measurements(ranges, ac.LEVER, sigma=SIGMA, gate=gate)
        phases = replace(phases, R=np.full((len(phases), 1, 1), white**2) * np.eye(3))
        return merged(range_measurements(ranges, ac.LEVER, gate=None), phases)

    return aid


def rows(nav, est, lay, z, lever):
    """H and predicted minus measured of one phase, by the kernel."""
    from schuler.filtering.kernels import update as k

    model = engine.filter_model(lay, np.zeros(3), np.zeros(3))
    H, y, U, sens = np.zeros((3, MAX_STATES)), np.zeros(3), np.zeros((3, 3)), np.zeros(33)
    k.measurement_rows(
        CARRIER_PHASE, z, lever, nav, est, np.zeros(7), sens, model.table, model.n_sensor, model.places, model.omega,
        H, y, U,
    )  # fmt: skip
    return H[0, : lay.size].copy(), float(y[0])


def test_rows_agree_with_differences_of_the_prediction(drive):
    """Central differences of 1 m and 1 mrad: rounding of ranges of 2e7 m (4e-9 m) over a milliradian."""
    from schuler.rotation import quat_from_rotvec, quat_multiply

    lay = with_ambiguities(ac.layout(*CLOCK, "clock_2", "lever"), 3)
    over = ac.sky(drive, "GE", 8)
    s = drive.at_fixes
    nav = np.concatenate((quat_from_rotvec(np.array([0.3, -0.8, 1.1])), s.v_eb_e[4], s.r_eb_e[4]))
    est = np.zeros(lay.size - 9)
    est[lay["clock"].start - 9], est[lay["ambiguity_2"].start - 9] = 40.0, -700.0
    est[lay["lever"].start - 9 : lay["lever"].stop - 9] = 0.1, -0.2, 0.3
    z = np.array([*over.r_sat_e[over.t == drive.fixes_t[4]][0], 2.1e7, 2.0, 3.0, 0.0, 0.0])
    lever = np.array([0.8, -0.4, -1.2])
    H, _ = rows(nav, est, lay, z, lever)
    twin = np.zeros(lay.size)
    for i in range(lay.size):
        values = []
        for sign in (1.0, -1.0):
            q, x, p = nav[:4], nav.copy(), est.copy()
            step = sign * (1e-3 if i < 3 else 1.0)
            if i < 3:
                x[:4] = quat_multiply(quat_from_rotvec(step * np.eye(3)[i]), q)
            elif i < 9:
                x[1 + i] += step
            else:
                p[i - 9] += step
            values.append(rows(x, p, lay, z, lever)[1])
        twin[i] = (values[0] - values[1]) / (2e-3 if i < 3 else 2.0)
    np.testing.assert_allclose(H, twin, atol=1e-5)
    assert np.count_nonzero(H) == 3 + 3 + 3 + 1 + 1  # attitude, position, lever, clock, ambiguity


@pytest.mark.thinned(2)
@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize(("white", "walk"), [(0.02, 0.0), (SIGMA, WALK)], ids=["white", "white and a walk"])
@pytest.mark.parametrize("most", [8, 2])
def test_nees_with_carriers(drive, most, white, walk, runs):
    """All satellites, or two for a minute; noise that neighbouring changes share, and a walk that they do not."""
    t = drive.fixes_t
    over = ac.sky(drive, "G", np.where((t > 45.0) & (t < 105.0), most, 8))
    lay, aid = ac.layout(*CLOCK), carriers(over, white=white, walk=walk)
    c = ac.Campaign.of(drive, lay, [aid], range(runs), filter_layout=with_ambiguities(lay, walk=walk))
    c.check(looks=(10, 30, 70, 100))


@pytest.mark.parametrize("runs", RUNS)
def test_nees_with_an_unknown_lever_arm(drive, runs):
    lay = ac.layout(*CLOCK, "lever")
    over = ac.sky(drive, "G", 8)
    c = ac.Campaign.of(drive, lay, [carriers(over)], range(runs), filter_layout=with_ambiguities(lay))
    c.check(looks=(10, 30, 70, 100))


def test_smoothed_solution_is_honest(drive):
    lay, over = ac.layout(*CLOCK, "lever"), ac.sky(drive, "G", 8)
    values = []
    for seed in range(12):
        one = ac.filtered(drive, lay, [carriers(over)], seed, filter_layout=with_ambiguities(lay), smoother=True)
        smoothed = one.result.smooth()
        values.append(nees(smoothed, one.truth.reference, one.parameters))
        assert np.all(smoothed.sigma("dv")[5:-5] < one.result.sigma("dv")[5:-5] * (1.0 + 1e-9))
    low, high = chi_square_band(lay.size, 12, 0.9999)
    at = np.array(values)[:, [5, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)


def test_live_navigator_gives_the_batch_numbers(drive):
    """Bit for bit, starts of arcs among the measurements that it is given."""
    lay, options = ac.layout(*CLOCK, "lever"), FilterOptions(covariance_rate_hz=None)
    truth = ac.Truth(drive, lay, np.random.default_rng(4))
    log = truth.log.between(0.0, 10.0)
    schedule = carriers(ac.sky(drive, "G", 6))(truth)
    schedule = schedule.where(schedule.t < log.t[-1])
    start = ac.initial(truth)
    batch = run(log, schedule, start, with_ambiguities(lay), *ac.NOISE, options)
    live = Navigator(start, with_ambiguities(lay), *ac.NOISE, interval_s=0.01, options=options)
    j = 0
    for k in range(len(log)):
        due = int(np.searchsorted(schedule.t, log.t[k] + 1e-9, side="right"))
        if due > j:
            live.aid(schedule.where(np.arange(j, due)))
            j = due
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k])
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_array_equal(live.parameters, batch.rec_est[-1])
    assert [o.status for o in live.outcomes] == [STATUS[s] for s in batch.status]
    assert np.sum(batch.status[schedule.kind == CARRIER_PHASE] == ACCEPTED) > 40


def test_a_long_run_is_smoothed_in_parts_to_the_last_bit(drive, monkeypatch):
    """Parts of 1.3 s, whose filter knows which phases came before."""
    lay, over = ac.layout(*CLOCK), ac.sky(drive, "G", 6)
    over = over.where((over.t < 15.0) & ((over.sat != over.sat[0]) | (over.t != drive.fixes_t[6])))

    def smoothed():
        one = ac.filtered(drive, lay, [carriers(over)], 2, filter_layout=with_ambiguities(lay), smoother=True)
        return one.result.smooth()

    once = smoothed()
    monkeypatch.setattr(engine, "_CHUNK", 130)
    monkeypatch.setattr(engine, "_NODE_BYTES", 1)
    parts = smoothed()
    np.testing.assert_array_equal(parts.trajectory.r_eb_e, once.trajectory.r_eb_e)
    np.testing.assert_array_equal(parts.covariance_e, once.covariance_e)


def test_smoother_equals_dense_rauch_tung_striebel(drive):
    """Corrections and covariances at all nodes, starts of arcs too, by the recursion with inverses (rounding)."""
    from schuler.filtering.kernels import smoother as k
    from schuler.filtering.kernels import update as u

    lay = ac.layout(*CLOCK, "lever")
    used, over = with_ambiguities(lay, 6), ac.sky(drive, "G", 5)
    t, sats = drive.fixes_t, np.unique(over.sat)
    over = over.where(((over.sat != sats[0]) | (over.t != t[4])) & ((over.sat != sats[1]) | (over.t != t[7])))
    truth = ac.Truth(drive, lay, np.random.default_rng(3))
    schedule = carriers(over)(truth)
    schedule = schedule.where(schedule.t < 12.5)
    log = truth.log.between(0.0, 12.0)
    forward = run(log, schedule, ac.initial(truth, used), used, *ac.NOISE, FilterOptions(smoother=True))
    nodes, n = forward.nodes, used.size
    (minus, plus), corrections = np.zeros((2, len(nodes.t), 9)), np.zeros((len(nodes.t), n))
    packed = np.zeros((len(nodes.t), n * (n + 1) // 2))
    k.smooth(nodes, np.arange(len(nodes.t)), minus, plus, corrections, packed, nothing_after(n), True)
    np.testing.assert_array_equal(plus, corrections[:, :9])
    P = engine.unpack_symmetric(nodes.P, n)
    begun = nodes.phi[:, 0] == u.BEGUN
    assert begun.sum() == 5 + 2  # five arcs, and two that a missing phase ends
    dx, S = np.zeros(n), None
    for j in range(len(nodes.t) - 1, -1, -1):
        Pf, gained = P[j].copy(), np.zeros(n)
        for i in range(nodes.upd[j - 1] + begun[j] if j else 0, nodes.upd[j]):
            Pf -= nodes.W[i].T @ nodes.W[i]
            gained += nodes.W[i].T @ nodes.e[i]
        if S is None:
            dx, S = np.zeros(n), Pf
        else:
            Phi = dense_transition(nodes, j + 1, used, u)
            gain = Pf @ Phi.T @ np.linalg.pinv(P[j + 1], rcond=1e-13, hermitian=True)
            dx = gain @ dx
            S = Pf + gain @ (S - P[j + 1]) @ gain.T
        scale = np.sqrt(np.maximum(np.diag(Pf), 1e-12))
        assert np.abs((corrections[j] - dx) / scale).max() < 2e-3, j
        dx = dx - gained
        smooth = engine.unpack_symmetric(packed[j : j + 1], n)[0]
        assert np.abs((smooth - S) / np.outer(scale, scale)).max() < 2e-3, j


def dense_transition(nodes, j, lay, u):
    """Phi of node j from what the filter kept of it, of the start of an arc too."""
    from schuler.filtering.kernels import covariance as k

    n, Phi = lay.size, np.eye(lay.size)
    if nodes.phi[j, 0] == u.BEGUN:
        Phi[int(nodes.phi[j, 1])] = nodes.G[nodes.upd[j - 1], 0]
        return Phi
    A, nav = np.zeros((9, 9)), np.zeros(10)
    A[2, 2] = 1.0
    nav[7:10] = nodes.phi[j, 8:11]
    k.transition(A, nodes.phi[j, :8].copy(), nav, nodes.omega)
    Phi[:9, :9] = A
    Phi[:9, 9 : 9 + nodes.n_sensor] = nodes.B[j]
    Phi[range(9, n), range(9, n)] = np.exp(-nodes.pmod[:, 0] * nodes.phi[j, 0])
    Phi[nodes.i_clock, nodes.i_clock + 1] = nodes.phi[j, 0]
    return Phi


@pytest.mark.parametrize("runs", RUNS)
def test_slips_of_either_sign_are_rejected_by_the_inertial_prediction(drive, runs):
    """Half a cycle and more on one of eight carriers, every seventh second: NEES stays in its band."""
    over = ac.sky(drive, "G", 8)
    bad = np.unique(over.sat)[3]
    mine = np.flatnonzero(over.sat == bad)
    jump = np.zeros(len(over))
    size = CYCLE * np.array([0.5, -0.5, 1.0, -1.0, 3.0, -7.0])
    at = mine[10::7]
    jump[at] = np.resize(size, len(at))
    slips = np.zeros(len(over))
    slips[mine] = np.cumsum(jump[mine])
    lay = ac.layout(*CLOCK)
    aid = carriers(over, gate=0.9999, slips=slips)
    c = ac.Campaign.of(drive, lay, [aid], range(runs), filter_layout=with_ambiguities(lay), lockout=0)
    low, high = chi_square_band(lay.size, runs, 0.9999)
    seen = c.nees[:, [30, 45, 60, 90, 115]].mean(axis=0)
    assert np.all((seen > low) & (seen < high)), (low, seen, high)
    one = ac.filtered(drive, lay, [aid], 0, filter_layout=with_ambiguities(lay), lockout=0)
    changes = one.result.innovations.of("carrier_phase")
    slipped = np.isin(np.round(changes.t, 6), np.round(over.t[at], 6)) & (
        np.abs(changes.innovation[:, 0]) > 0.25 * CYCLE
    )
    assert np.sum(changes.status[slipped] == REJECTED) >= 0.99 * len(at)
    assert np.mean(changes.status[~slipped] == REJECTED) < 1e-3 * 3


def test_an_arc_without_its_last_phase_begins_anew(drive):
    """An outage takes phases away: the first one behind it must not meet an ambiguity of before."""
    lay = ac.layout(*CLOCK)
    truth = ac.Truth(drive, lay, np.random.default_rng(5))
    schedule = carriers(ac.sky(drive, "G", 8))(truth)
    left = schedule.outside(((40.0, 50.5),))
    used = with_ambiguities(lay)
    forward = run(truth.log, left, ac.initial(truth, used), used, *ac.NOISE)
    phases = left.kind == CARRIER_PHASE
    first = left.t[phases & (left.t > 50.5)].min()
    np.testing.assert_array_equal(phases & (forward.status == GATED), phases & (left.t == first))
    assert np.all(forward.status[left.kind == ARC_START] == ACCEPTED)
    result = NavigationResult.from_run(forward, left.t, left.kind, used)
    assert result.layout.blocks == lay.blocks
    assert "arc_start" not in result.innovations.counts()


def test_velocity_is_better_with_carriers(drive):
    """RMS between epochs a third at most of that of codes and range rates (seen 0.13), phases of 3 mm."""
    lay, over = ac.layout(*CLOCK), ac.sky(drive, "G", 8)
    rms = {}
    for name, aid, used in (
        ("codes", ac.satellites(over), lay),
        ("carriers", carriers(over, walk=0.0), with_ambiguities(lay, walk=0.0)),
    ):
        one = ac.filtered(drive, lay, [aid], 0, filter_layout=used)
        v = one.result.errors(one.truth.reference).velocity_n
        rms[name] = float(np.sqrt(np.mean(v[len(v) // 4 :] ** 2)))
    assert rms["carriers"] < rms["codes"] / 3.0, rms


def test_layout_of_ambiguities():
    with pytest.raises(InputError, match="numbered from 1 without a gap"):
        StateLayout({AMBIGUITIES[1]: StateModel.constant(0.0)})
    model = StateModel.gauss_markov(0.5, 30.0)
    lay = with_ambiguities(StateLayout({**ac.layout(*CLOCK, "clock_2").models, CHANNELS[0]: model}), 2)
    assert lay.blocks[-3:] == [CHANNELS[0], *AMBIGUITIES[:2]]
    assert lay.visible.blocks == ac.layout(*CLOCK, "clock_2").blocks
