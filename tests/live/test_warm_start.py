"""A run that goes on after a pause of minutes knows its biases, and its place if it stood; its sigmas are honest."""

import copy
from dataclasses import replace

import live_cases as cases
import numpy as np
import pytest

from schuler import frames, rotation, units
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.live import LiveNavigator
from schuler.live.navigator import STATE_FORMAT
from schuler.live.warm import Kept, grown, informed
from schuler.mechanization.strapdown import NavState
from schuler.navigation.navigator_file import read_document, write_document
from schuler.recording import Recording
from schuler.simulation import simulate

GYRO, ACCEL = (cases.SCENARIO["imu"][name] for name in ("gyro", "accel"))


@pytest.fixture(scope="module")
def ideal():
    scenario = copy.deepcopy(cases.SCENARIO)
    scenario["imu"] = {"rate_hz": 100.0, "gyro": {"arw_deg_rthr": 0.0}, "accel": {"vrw_m_s_rthr": 0.0}}
    return simulate(scenario)


class Unit:
    """IMU and receiver with errors that go on through a pause: turn-on biases, Gauss-Markov ones, white noise."""

    def __init__(self, ideal, seed):
        self.ideal, self.rng = ideal, np.random.default_rng(seed)
        self.sigma = np.repeat((GYRO["in_run_deg_hr"] * units.DEG / 3600.0, ACCEL["in_run_mg"] * 1e-3 * units.G0), 3)
        bias = np.repeat((GYRO["bias_deg_hr"] * units.DEG / 3600.0, ACCEL["bias_mg"] * 1e-3 * units.G0), 3)
        white = np.repeat((GYRO["arw_deg_rthr"] * units.DEG / 60.0, ACCEL["vrw_m_s_rthr"] / 60.0), 3)
        self.constant, self.white = bias * self.rng.standard_normal(6), white
        self.run, self.t = self.sigma * self.rng.standard_normal(6), 0.0

    @property
    def bias(self):
        return self.constant + self.run

    def samples(self, dtheta, dv, shift):
        """Increments with errors, at times of the drive and a shift."""
        imu = self.ideal.imu
        t, h = imu.t + shift, imu.interval
        a = np.exp(-(t[0] - self.t) / 600.0)
        self.run = a * self.run + self.sigma * np.sqrt(1.0 - a * a) * self.rng.standard_normal(6)
        a = np.exp(-h / 600.0)
        drive = self.sigma * np.sqrt(1.0 - a * a) * self.rng.standard_normal((len(t), 6))
        runs = np.empty((len(t), 6))
        for k in range(len(t)):
            self.run = a * self.run + drive[k]
            runs[k] = self.run
        self.t = float(t[-1])
        errors = (self.constant + runs) * h + self.white * np.sqrt(h) * self.rng.standard_normal((len(t), 6))
        return replace(imu, t=t, gyro=dtheta + errors[:, :3], accel=dv + errors[:, 3:])

    def drive(self, shift=0.0):
        """The drive once more."""
        g = self.ideal.gnss
        imu = self.samples(self.ideal.imu.gyro, self.ideal.imu.accel, shift)
        return Recording(imu, replace(g, t=g.t + shift))

    def rest(self, shift):
        """Samples at the end of the drive, where it stands."""
        imu = self.ideal.imu
        return self.samples(np.tile(imu.gyro[-100:].mean(axis=0), (len(imu), 1)),
                            np.tile(imu.accel[-100:].mean(axis=0), (len(imu), 1)), shift)  # fmt: skip


def states_error(live, reference, k, bias):
    """Errors of attitude, velocity, position (north-east-down) and biases, and their covariance."""
    solution, layout = live.solution(), live.layout
    llh = frames.llh_from_ecef(reference.r_eb_e[k])
    C_en = frames.C_en(llh)
    q = rotation.quat_from_dcm(C_en @ rotation.dcm_from_rpy(solution.rpy_nb))
    off = rotation.rotvec_from_quat(rotation.quat_multiply(q, rotation.quat_conjugate(reference.q_eb[k])))
    e = np.zeros(15)
    e[0:3] = C_en.T @ off
    e[3:6] = solution.v_eb_n - C_en.T @ reference.v_eb_e[k]
    e[6:9] = C_en.T @ (cases.position(solution) - reference.r_eb_e[k])
    order = np.r_[layout["b_g"], layout["b_a"]] - 9
    e[9:] = live.parameters[order] - bias
    at = np.r_[0:9, order + 9]
    return e, live.covariance[np.ix_(at, at)]


def nees(e, P, part):
    return float(e[part] @ np.linalg.solve(P[np.ix_(part, part)], e[part]))


def paused(ideal, seed, pause_s, tmp_path):
    """A run saved at the end of a drive, the unit, and when it goes on."""
    unit = Unit(ideal, seed)
    live = LiveNavigator.from_config(cases.CONFIG, kind="increment")
    first = unit.drive()
    cases.fed(live, first)
    return live.save(tmp_path / f"{seed}"), unit, first.imu.t[-1] + pause_s - ideal.imu.t[0]


CASES = [
    pytest.param(stood, pause_s, seeds, marks=() if seeds == 2 else pytest.mark.campaign)
    for stood, pause_s, seeds in ((True, 1800.0, 2), (True, 60.0, 6), (False, 60.0, 6), (False, 1800.0, 3))
]


@pytest.mark.parametrize(("stood", "pause_s", "seeds"), CASES)
def test_sigmas_after_a_pause_are_honest(ideal, tmp_path, stood, pause_s, seeds):
    """Biases over pauses, with place and attitude where the vehicle stood, after a few seconds without a fix; moved
    to the start of the drive meanwhile, once it is aligned anew."""
    squares, parts = [], np.arange(15) if stood else np.arange(9, 15)
    for seed in range(seeds):
        path, unit, shift = paused(ideal, seed, pause_s, tmp_path)
        live = LiveNavigator.load(path, stood_still=stood)
        if stood:
            imu = unit.rest(shift)
            live.imu_many(imu.t[:500], imu.gyro[:500], imu.accel[:500])
            k = -1
            assert live.solution() is not None, live.events[-1]
            # twenty samples tell that the log goes on; the increment of the twentieth counts from where it begins
            assert live.initial.nav.t == pytest.approx(imu.t[18], abs=1e-6)
        else:
            part = unit.drive(shift)
            stop = shift + 30.0
            cases.fed(live, part.between(part.imu.t[0], stop))
            k = int(np.searchsorted(ideal.reference.t, live.solution().t - shift - 1e-6))
            assert "with the biases of before" in " ".join(e.text for e in live.events)
        e, P = states_error(live, ideal.reference, k, unit.bias)
        squares.append(nees(e, P, parts))
        sigma = np.sqrt(np.diag(P))
        assert np.degrees(sigma[9:12]).max() * 3600.0 < 60.0  # of 200 deg/h at an alignment
    n = len(squares) * len(parts)
    # statistical: five standard errors of a chi-square over its degrees of freedom; walks of the filter are wider
    # than the in-run biases, so that it may be far below one
    assert np.sum(squares) / n < 1.0 + 5.0 * np.sqrt(2.0 / n), squares
    assert np.sum(squares) / n > 0.02


def test_a_state_that_moves_is_not_gone_on_with(ideal, tmp_path):
    """Saved while it drives, the vehicle cannot have stood since: it aligns anew."""
    unit = Unit(ideal, 0)
    live = LiveNavigator.from_config(cases.CONFIG, kind="increment")
    cases.fed(live, unit.drive().between(0.0, 25.0))
    assert np.linalg.norm(live.solution().v_eb_n) > 5.0
    other = LiveNavigator.load(live.save(tmp_path / "state"), stood_still=True)
    later = unit.rest(200.0)
    other.imu_many(later.t[:100], later.gyro[:100], later.accel[:100])
    assert other.solution() is None
    assert "the biases of before" in other.events[-1].text


def test_a_doubtful_run_is_not_gone_on_with(ideal, tmp_path):
    """Doubtful after a first pause, standing at a second: it aligns anew, with the biases of before the first."""
    unit = Unit(ideal, 0)
    live = LiveNavigator.from_config(cases.CONFIG, kind="increment")
    cases.fed(live, unit.drive().between(0.0, 25.0))
    document = read_document(live.save(tmp_path / "state"), STATE_FORMAT)
    kept = {"t": 20.0, "parameters": live.parameters, "P": live.covariance[9:, 9:]}
    path = write_document(tmp_path / "doubtful", {**document, "health": "doubtful", "kept": kept}, STATE_FORMAT)
    other = LiveNavigator.load(path, stood_still=True)
    later = unit.rest(200.0)
    other.imu_many(later.t[:100], later.gyro[:100], later.accel[:100])
    assert other.solution() is None
    assert "the biases of before" in other.events[-1].text


LAYOUT = StateLayout({"b_g": StateModel(1e-3, 2e-6), "b_a": StateModel.gauss_markov(0.05, 300.0)})


def test_growth_is_that_of_the_models():
    """Random walks gain their noise times the time; Gauss-Markov states forget; in two steps as in one."""
    P = np.diag(np.r_[np.full(3, 1e-10), np.full(3, 1e-6)])
    kept = Kept(0.0, np.ones(6), P)
    once, twice = grown(kept, LAYOUT, 600.0), grown(grown(kept, LAYOUT, 200.0), LAYOUT, 600.0)
    np.testing.assert_allclose(once.P, twice.P, rtol=1e-12)  # rounding
    np.testing.assert_allclose(np.diag(once.P)[:3], 1e-10 + 600.0 * 4e-12, rtol=1e-12)
    np.testing.assert_allclose(once.parameters, np.r_[np.ones(3), np.full(3, np.exp(-2.0))], rtol=1e-12)
    np.testing.assert_allclose(np.diag(grown(kept, LAYOUT, 1e5).P)[3:], 0.05**2, rtol=1e-9)


def test_what_is_kept_is_counted_once():
    """Two independent measurements of the parameters, one in each run: together they are both with one prior."""
    rng = np.random.default_rng(1)
    variances = LAYOUT.initial_variances()

    def posterior(z, R):
        P = np.linalg.inv(np.diag(1.0 / variances) + np.linalg.inv(R))
        return P @ np.linalg.solve(R, z), P

    z = [np.sqrt(variances) * rng.standard_normal(6) for _ in range(2)]
    R = []
    for size in (0.3, 0.5):
        A = rng.standard_normal((6, 6)) + 2.0 * np.eye(6)
        D = size * np.sqrt(variances)
        R.append(D[:, None] * (A @ A.T) * D)
    values, P = zip(*(posterior(a, b) for a, b in zip(z, R, strict=True)), strict=True)
    nav = NavState(0.0, np.array([4.2e6, 0.9e6, 4.7e6]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    full = np.zeros((15, 15))
    full[:9, :9], full[9:, 9:] = np.eye(9), P[1]
    prior = Kept(0.0, np.zeros(6), np.diag(variances))
    both = informed(InitialState(nav, full, values[1]), Kept(0.0, values[0], P[0]), prior)
    information = np.diag(1.0 / variances) + np.linalg.inv(R[0]) + np.linalg.inv(R[1])
    np.testing.assert_allclose(both.P[9:, 9:] @ information, np.eye(6), atol=1e-6)  # rounding, states of unlike size
    expected = np.linalg.solve(information, np.linalg.solve(R[0], z[0]) + np.linalg.solve(R[1], z[1]))
    np.testing.assert_allclose(both.parameters / np.sqrt(variances), expected / np.sqrt(variances), atol=1e-9)
    np.testing.assert_array_equal(both.nav.r_eb_e, nav.r_eb_e)  # not correlated
