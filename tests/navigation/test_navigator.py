"""Live navigator: lost samples, readings that are none, bounded memory, copies and files that go on bit for bit.

Its numbers against the batch run's stand in ``tests/filtering/test_engine.py``.
"""

from __future__ import annotations

import copy
import hashlib
import json
import pickle
from dataclasses import replace
from pathlib import Path

import filter_cases as cases
import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import DivergenceError, FileFormatError, InputError
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import ACCEPTED, gnss_measurements, position, velocity
from schuler.mechanization.strapdown import NavState
from schuler.navigation.inputs.preparation import PAUSE, bridged, bridging_noise, refilled
from schuler.navigation.navigator import Navigator
from schuler.recording.series import ImuSeries
from schuler.simulation.motion import ideal_increments

NOISE = (np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2))
LAYOUT = cases.layout(15)


@pytest.fixture(scope="module")
def town():
    """Sixty seconds in town: log, measurements, start, truth at every sample."""
    case = cases.Case.of(cases.drive(2.0), 60.0)
    rng = np.random.default_rng(5)
    sigma = np.sqrt(LAYOUT.initial_variances())
    log, _ = cases.corrupted(case, LAYOUT, sigma * rng.standard_normal(LAYOUT.size - 9), rng)
    schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER)
    return log, schedule, cases.start(case, LAYOUT, rng), cases.drive(2.0).state(log.t).r_eb_e


def fed(live, imu, schedule, part=slice(None)):
    """Positions after every sample."""
    live.aid(schedule)
    r = np.empty((len(imu.t), 3))
    for k in range(len(imu.t))[part]:
        live.imu(imu.t[k], imu.gyro[k], imu.accel[k])
        r[k] = live.state.r_eb_e
    return r


def live_run(initial, **keywords):
    return Navigator(initial, LAYOUT, *NOISE, interval_s=0.01, **keywords)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("lost", [1, 10, 50, 100])
def test_lost_samples_are_bridged_as_in_a_batch_run(town, lost):
    """Largest error against truth after a loss in a turn: within 1.5 of the batch run's, which saw all of the log."""
    log, schedule, initial, truth = town
    keep = np.ones(len(log), dtype=bool)
    keep[3040 : 3040 + lost] = False
    imu = ImuSeries(log.t[keep], log.dtheta_ib_b[keep], log.dv_ib_b[keep], "increment")
    filled = refilled(imu, [])
    pause = bridged(filled)
    gyro, accel = bridging_noise(filled, pause) if pause else (0.0, 0.0)
    options = FilterOptions(gap_s=PAUSE * imu.interval if pause else None, gap_gyro=gyro, gap_accel=accel)
    batch = run(filled.increments(), schedule, initial, LAYOUT, *NOISE, options)
    live = live_run(initial)
    r = fed(live, imu, schedule)
    after = imu.t > 30.4 + 0.01 * lost
    errors = [np.linalg.norm((x - truth[keep])[after], axis=1).max() for x in (r, batch.r)]
    assert errors[0] < 1.5 * errors[1] < 2.5
    assert len(live.notes) == 1
    assert f"{lost} IMU samples lost" in live.notes[0]


def test_an_increment_of_all_the_pause_is_taken_as_it_is(town):
    """A sensor that goes on integrating: the increment is as large as its step, nothing is filled in."""
    log, schedule, initial, truth = town
    keep = np.ones(len(log), dtype=bool)
    keep[3040:3050] = False
    dtheta, dv = log.dtheta_ib_b.copy(), log.dv_ib_b.copy()
    dtheta[3050], dv[3050] = dtheta[3040:3051].sum(axis=0), dv[3040:3051].sum(axis=0)
    live = live_run(initial)
    r = fed(live, ImuSeries(log.t[keep], dtheta[keep], dv[keep], "increment"), schedule)
    assert not live.notes
    assert np.linalg.norm(r - truth[keep], axis=1)[3040:].max() < 1.5


def test_pauses_bridged_by_the_caller_are_left_alone(town):
    """With ``gap_s`` increments are of all their interval: the batch engine's rule, to the last bit."""
    log, schedule, initial, _ = town
    keep = np.ones(len(log), dtype=bool)
    keep[3040:3050] = False
    imu = refilled(ImuSeries(log.t[keep], log.dtheta_ib_b[keep], log.dv_ib_b[keep], "increment"), [])
    options = FilterOptions(covariance_rate_hz=None, gap_s=0.025, gap_gyro=0.02, gap_accel=0.3)
    batch = run(imu.increments(), schedule, initial, LAYOUT, *NOISE, options)
    live = live_run(initial, options=options)
    inc = imu.increments()
    live.aid(schedule)
    for k in range(len(inc)):
        live.imu(inc.t[k], inc.dtheta_ib_b[k], inc.dv_ib_b[k])
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("axis", "spikes"), [(0, 1), (0, 2), (2, 3)])
def test_a_spike_of_10_m_s_is_no_motion(town, axis, spikes):
    """Taken as read one moves the solution by 26 m for ten seconds; without them the log is as good as before."""
    log, schedule, initial, truth = town
    dv = log.dv_ib_b.copy()
    dv[3040 : 3040 + spikes, axis] += 10.0
    live = live_run(initial)
    r = fed(live, ImuSeries(log.t, log.dtheta_ib_b, dv, "increment"), schedule)
    clean = fed(live_run(initial), ImuSeries(log.t, log.dtheta_ib_b, log.dv_ib_b, "increment"), schedule)
    worst, usual = (np.linalg.norm(x - truth, axis=1)[3040:].max() for x in (r, clean))
    assert worst < 1.5 * usual
    assert len(live.notes) == spikes
    assert "is no motion" in live.notes[0]
    assert all(o.status == "accepted" for o in live.outcomes)


@pytest.mark.parametrize("at", [0, 1, 5])
def test_a_spike_before_there_is_anything_to_compare_it_with(town, at):
    """Taken as read it moved the solution by 19 m; left out of the first sample its dv of gravity is lost, 0.1 m/s."""
    log, schedule, initial, _ = town
    dv = log.dv_ib_b.copy()
    dv[at, 0] += 10.0
    live, clean = live_run(initial), live_run(initial)
    part = slice(0, 1500)
    r = fed(live, ImuSeries(log.t, log.dtheta_ib_b, dv, "increment"), schedule, part)[part]
    usual = fed(clean, ImuSeries(log.t, log.dtheta_ib_b, log.dv_ib_b, "increment"), schedule, part)[part]
    assert np.linalg.norm(r - usual, axis=1).max() < 2.5  # until the first fixes, less than their sigma
    assert "is no motion" in live.notes[0]
    assert all(o.status == "accepted" for o in live.outcomes)


def test_a_shock_that_lasts_is_motion():
    """Ten readings in a row beyond what was before are a launch: the first three are doubted, and sigmas say so."""
    case = cases.Case.of(cases.drive(1.0), 2.0)
    live = live_run(cases.start(case, LAYOUT, np.random.default_rng(0)))
    log = case.increments
    for k in range(100):
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k])
    v = live.state.v_eb_e
    for k in range(100, 110):
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k] + [4.0, 0.0, 0.0])
    gained = np.linalg.norm(live.state.v_eb_e - v)
    assert gained == pytest.approx(28.0, abs=0.5)  # seven of ten
    assert np.sqrt(np.trace(live.covariance[3:6, 3:6])) > 4.0 * np.sqrt(3.0)
    assert len(live.notes) == 3


@pytest.mark.parametrize(
    ("t", "dtheta", "dv", "words"),
    [
        (np.inf, 0.0, 0.0, "within max_gap_s"),
        (np.nan, 0.0, 0.0, "expected a sample after"),
        (0.5, 0.0, 0.0, "expected a sample after"),
        (1e7, 0.0, 0.0, "within max_gap_s = 2 s after 1.000000 s"),
        (1.01, 1e300, 0.0, "beyond any sensor"),
        (1.01, 0.0, -1e300, "beyond any sensor"),
        (1.01, 0.0, np.nan, "finite"),
        (1.01, np.inf, 0.0, "finite"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(town, t, dtheta, dv, words):
    log, _, initial, _ = town
    live = live_run(initial)
    for k in range(100):
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k])
    untouched = copy.deepcopy(live)
    with pytest.raises(InputError, match=words):
        live.imu(t, np.array([dtheta, 0.0, 0.0]), np.array([0.0, dv, -0.0981]))
    for one in (live, untouched):
        one.imu(log.t[100], log.dtheta_ib_b[100], log.dv_ib_b[100])
    np.testing.assert_array_equal(live.state.r_eb_e, untouched.state.r_eb_e)
    np.testing.assert_array_equal(live.covariance, untouched.covariance)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": np.array([np.nan])}, "finite"),
        ({"t": np.array([1e9])}, "on the IMU's clock"),
        ({"z": np.full((1, 8), np.inf)}, "finite"),
        ({"R": -np.eye(3)[None]}, "negative variance"),
        ({"R": np.array([[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])}, "negative variance"),
        ({"R": np.array([[[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])}, "not symmetric"),
        ({"gate": np.array([np.nan])}, "NaN"),
    ],
)
def test_measurements_that_are_none_are_refused(town, change, words):
    """A fix with no number, no covariance or no time of this clock never reaches the filter."""
    live = live_run(town[2])
    fix = position(0.5, cases.ORIGIN, np.ones(3))
    with pytest.raises(InputError, match=words):
        live.aid(replace(fix, **change))
    live.aid(fix)


def test_a_filter_whose_covariance_is_none_stops(town):
    """An innovation without a positive variance is the end of a run, not one more rejection."""
    initial = town[2]
    P = initial.P.copy()
    P[6, 7] = P[7, 6] = 3.0 * P[6, 6]
    live = live_run(InitialState(initial.nav, P, initial.parameters))
    live.aid(position(0.005, cases.ORIGIN, np.full(3, 1e-3), gate=None))
    with pytest.raises(DivergenceError, match=r"the filter failed at 0\.005 s: the innovation of a position"):
        live.imu(0.01, np.zeros(3), np.array([0.0, 0.0, -0.098]))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("delay", [0.0, 0.255])
@pytest.mark.parametrize("off", [-1.0, -0.01, 0.0, 0.01, 1.0])
@pytest.mark.parametrize("kind", ["position", "velocity"])
def test_a_measurement_is_compared_with_the_state_of_its_stamp(delay, off, kind):
    """Place or velocity of a time, stamped otherwise: the innovation is what changed in between."""
    motion = cases.drive(1.0)
    log = cases.Case.of(motion, 14.0).increments
    begin = motion.state(np.array([0.0]))
    nav = NavState(0.0, begin.r_eb_e[0], begin.v_eb_e[0], begin.q_eb[0])
    sigmas = {name: np.full(3, sigma) for name, sigma in (("attitude", 0.01), ("velocity", 0.1), ("position", 1.0))}
    live, t = live_run(InitialState.from_sigmas(nav, LAYOUT, **sigmas), delay_s=delay), 12.0037  # between two samples
    true, stamped = (motion.state(np.array([x])) for x in (t, t + off))
    for k, end in enumerate(log.t):
        if k == 1050:
            made = position(t + off, true.llh[0], [1.0] * 3, gate=None)
            live.aid(made if kind == "position" else velocity(t + off, true.v_eb_n[0], [0.1] * 3, gate=None))
        live.imu(end, log.dtheta_ib_b[k], log.dv_ib_b[k])
    live.finish()
    (outcome,) = live.outcomes
    assert outcome.t == t + off
    name = "r_eb_e" if kind == "position" else "v_eb_n"
    changed = np.linalg.norm(getattr(stamped, name) - getattr(true, name))
    assert np.linalg.norm(outcome.innovation) == pytest.approx(changed, abs=2e-3)  # discretisation of twelve seconds
    assert changed >= 50.0 * 2e-3 * abs(off)


def test_outcomes_are_bounded_and_handed_on(town):
    """Memory is flat: the newest are kept, a function sees all."""
    log, schedule, initial, _ = town
    seen = []
    live = live_run(initial, keep=7, on_outcome=seen.append)
    schedule = schedule.where(schedule.t < 15.0)
    fed(live, ImuSeries(log.t, log.dtheta_ib_b, log.dv_ib_b, "increment"), schedule, slice(0, 1500))
    assert len(seen) == len(schedule) > 14
    assert len(live.outcomes) == 7
    assert [o.t for o in live.outcomes] == [o.t for o in seen[-7:]]


def by_file(live, folder):
    return Navigator.load(live.save(folder / "live.json"))


COPIES = {
    "copy": lambda live, folder: copy.copy(live),
    "deepcopy": lambda live, folder: copy.deepcopy(live),
    "pickle": lambda live, folder: pickle.loads(pickle.dumps(live)),
    "file": by_file,
}


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("delay", [0.0, 0.255])
def test_copies_go_on_bit_for_bit(town, how, delay, tmp_path):
    """Taken between two propagations, with samples and fixes that wait; a pause is bridged from what came before."""
    log, schedule, initial, _ = town
    keep = np.ones(len(log), dtype=bool)
    keep[1000:1040] = False
    imu = ImuSeries(log.t[keep], log.dtheta_ib_b[keep], log.dv_ib_b[keep], "increment")
    live = live_run(initial, delay_s=delay)
    fed(live, imu, schedule, slice(0, 807))
    other = COPIES[how](live, tmp_path)
    assert [(o.t, o.status, o.nis) for o in other.outcomes] == [(o.t, o.status, o.nis) for o in live.outcomes]
    before = live.state.r_eb_e
    for one in (live, other):
        for k in range(807, 1200):
            one.imu(imu.t[k], imu.gyro[k], imu.accel[k])
    assert np.linalg.norm(live.state.r_eb_e - before) > 10.0
    for name in ("r_eb_e", "v_eb_e", "q_eb", "t"):
        np.testing.assert_array_equal(getattr(live.state, name), getattr(other.state, name))
        np.testing.assert_array_equal(getattr(live.predicted, name), getattr(other.predicted, name))
    np.testing.assert_array_equal(live.covariance, other.covariance)
    np.testing.assert_array_equal(live.parameters, other.parameters)
    assert live.notes == other.notes
    assert len(live.notes) == 1


def test_damaged_files_are_refused(town, tmp_path):
    """Cut, changed in one byte, of another version, of another kind, not there."""
    path = live_run(town[2]).save(tmp_path / "live.json")
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    bad = [b"", good[:50], good[:-20], b"\xff\xfe\x00", b"[]\n[]", good.replace(b"navigator/2", b"navigator/3")]
    bad += [good[:i] + bytes([good[i] ^ 1]) + good[i + 1 :] for i in rng.integers(0, len(good) - 1, 40)]
    for content in bad:
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"live navigator|damaged|checksum"):
            Navigator.load(path)
    with pytest.raises(FileFormatError, match="No such file"):
        Navigator.load(tmp_path / "none.json")
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_with_other_content_is_refused(town, tmp_path):
    """A right checksum over arrays that do not fit each other."""
    path = live_run(town[2]).save(tmp_path / "live.json")
    content = json.loads(path.read_text().splitlines()[1])
    content["arrays"]["est"]["shape"] = [2, 3]
    text = json.dumps(content)
    head = json.dumps({"format": "schuler/navigator/2", "sha256": hashlib.sha256(text.encode()).hexdigest()})
    path.write_text(f"{head}\n{text}\n")
    with pytest.raises(FileFormatError, match=r"holds no navigator: est: expected shape \(6,\)"):
        Navigator.load(path)


def test_covariance_stays_positive_definite_over_outages():
    """Ten minutes without fixes, then fixes: correlations keep a smallest eigenvalue far above rounding (1e-15)."""
    case = cases.Case.of(cases.drive(12.0), 720.0)
    rng = np.random.default_rng(2)
    layout = cases.layout(21)
    log, _ = cases.corrupted(case, layout, np.zeros(12), rng)
    schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER, gate=None)
    schedule = schedule.where((schedule.t < 30.0) | (schedule.t > 630.0))
    forward = run(log, schedule, cases.start(case, layout, rng), layout, *NOISE)
    assert np.all(forward.status == ACCEPTED)
    P = unpack_symmetric(forward.rec_P, layout.size)
    sigma = np.sqrt(np.einsum("kii->ki", P))
    smallest = np.linalg.eigvalsh(P / (sigma[:, :, None] * sigma[:, None, :]))[:, 0]
    assert smallest.min() > 1e-9
    assert sigma[:, 6].max() > 200.0  # there was something to lose


def test_the_live_covariance_is_symmetric(town):
    log, schedule, initial, _ = town
    live = live_run(initial)
    fed(live, ImuSeries(log.t, log.dtheta_ib_b, log.dv_ib_b, "increment"), schedule, slice(0, 500))
    P = live.covariance
    np.testing.assert_array_equal(P, P.T)
    np.linalg.cholesky(P)


@pytest.mark.parametrize(
    "samples", [20_000, pytest.param(10_000_000, marks=pytest.mark.slow)], ids=["20 thousand", "10 million"]
)
@pytest.mark.timeout(7200)
def test_the_live_covariance_stays_positive_definite_and_memory_flat(samples):
    """A car with a fix a second and ten minutes of every hour without: looked at every 2000 samples, law.

    The correlations' smallest eigenvalue stays far above rounding, the claimed error holds, nothing accumulates.
    """
    block = min(samples, 100_000)
    motion = cases.drive(samples / 6000.0 + 1.0)
    rng = np.random.default_rng(3)
    first = motion.state(np.zeros(1))
    nav = NavState(0.0, first.r_eb_e[0], first.v_eb_e[0], first.q_eb[0])
    live = live_run(
        InitialState.from_sigmas(nav, LAYOUT, attitude=cases.START_ATT, velocity=cases.START_V, position=cases.START_R),
        keep=1000,
    )
    sigma = np.concatenate((np.full(3, cases.SIGMA_R[0]), np.full(3, cases.SIGMA_V[0])))
    smallest, memory, nees = [], [], []
    for begin in range(0, samples, block):
        t = np.arange(begin, begin + block + 1) / 100.0
        dtheta, dv = ideal_increments(motion, t)
        dtheta += cases.GYRO_N * 0.1 * rng.standard_normal(dtheta.shape)
        dv += cases.ACCEL_N * 0.1 * rng.standard_normal(dv.shape)
        fixes = t[50::100] + 0.0037
        true = motion.state(fixes)
        noise = sigma * rng.standard_normal((len(fixes), 6))
        llh, v = frames.llh_from_ecef(true.r_eb_e + noise[:, :3]), true.v_eb_n + noise[:, 3:]
        for k in range(block):
            if k % 100 == 50 and not 600.0 <= fixes[k // 100] % 3600.0 < 1200.0:
                at = fixes[k // 100]
                live.aid(position(at, llh[k // 100], sigma[:3], gate=None))
                live.aid(velocity(at, v[k // 100], sigma[3:], gate=None))
            live.imu(t[k + 1], dtheta[k], dv[k])
            if k % 2000 == 1999:
                P = live.covariance
                scale = np.sqrt(np.diag(P))
                smallest.append(np.linalg.eigvalsh(P / np.outer(scale, scale))[0])
        dx = live.state.r_eb_e - motion.state(t[-1:]).r_eb_e[0]
        dx = frames.C_en(live.state.llh).T @ dx
        nees.append(dx @ np.linalg.solve(P[6:9, 6:9], dx) / 3.0)
        memory.append(resident())
    print(f"{len(smallest)} checks, smallest {min(smallest):.2g}, mean NEES {np.mean(nees):.2f}, {memory[-1]:.0f} MB")
    assert len(smallest) == samples // 2000
    assert min(smallest) > 1e-9
    assert np.mean(nees) < 3.0
    assert memory[-1] - memory[len(memory) // 10] < 30.0


def resident():
    """Memory of this process. [MB]"""
    path = Path("/proc/self/statm")
    return int(path.read_text().split()[1]) * 4096e-6 if path.exists() else 0.0
