"""The tuning guide: does it find factors that were put in, is an honest filter left alone, does it hold elsewhere?"""

import json

import numpy as np
import pytest
from places import EXAMPLES

from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, POSITION, REJECTED, SPEED, UNUSED
from schuler.navigation.config import NavigationConfig
from schuler.navigation.result import Innovations
from schuler.navigation.states import imu_spec, state_layout
from schuler.reproduce.stefanisko.study.experiment import FigureEight
from schuler.reproduce.stefanisko.study.tuning import Factors, Score, likelihood, tune
from schuler.reproduce.stefanisko.study.tuning_runners import figure_eight_runner, recording_runners, with_factors
from schuler.simulation.scenario import Scenario, simulate

SHORT = {"duration_s": 80.0, "outage_s": (30.0, 60.0)}
GRID = (0.01, 0.1, 10.0, 100.0)


@pytest.fixture(scope="module")
def tuned():
    """A filter with P0 and R ten times too small and Q a hundred times too large."""
    wrong = FigureEight(p0_factor=0.1, q_factor=100.0, r_factor=0.1, **SHORT)
    return tune(figure_eight_runner(wrong, 3, 1), figure_eight_runner(wrong, 3, 2), grid=GRID)


def test_factors_put_in_are_found(tuned):
    """On a grid of tenths and tens the right ones are 10, 0.01, 10."""
    assert tuned.chosen == Factors(10.0, 0.01, 10.0)
    assert tuned.after.nis == pytest.approx(1.0, abs=0.1)
    assert 0.7 < tuned.after.nees < 1.4  # three runs of 15 states, correlated in time
    assert tuned.before.nis > 3.0


def test_the_choice_holds_out_of_sample(tuned):
    assert tuned.holds
    assert tuned.after_out.nis == pytest.approx(1.0, abs=0.1)
    assert 0.6 < tuned.after_out.nees < 1.5
    rows = tuned.table()
    assert rows.column("what")[-4:] == [
        "in-sample, configured", "in-sample, tuned", "out-of-sample, configured", "out-of-sample, tuned",
    ]  # fmt: skip
    assert "tuned: P0 x 10, Q x 0.01, R x 10" in rows.summary()
    json.dumps(tuned.to_dict())


def test_an_honest_filter_is_left_alone():
    outcome = tune(figure_eight_runner(FigureEight(**SHORT), 3, 5), grid=GRID, passes=1)
    assert outcome.chosen == Factors()
    assert outcome.holds is None


def test_one_pass_finds_the_wrong_q_where_r_is_wrong():
    """The source's order, once through, judges Q with the R that is still wrong: why two passes are the default."""
    wrong = FigureEight(p0_factor=1.0, q_factor=100.0, r_factor=0.1, **SHORT)
    runner = figure_eight_runner(wrong, 3, 1)
    assert tune(runner, grid=GRID, passes=1).chosen.q > 0.05
    assert tune(runner, grid=GRID, passes=2).chosen == Factors(1.0, 0.01, 10.0)


def test_too_small_and_too_large(tuned):
    """The guide's own claims (4.6): too small a P0 or Q, and errors exceed the claim; too large: they fall short."""
    step = next(s for s in tuned.steps if s.parameter == "p0")
    nees = [s.nees for s in step.scores]
    assert nees == sorted(nees, reverse=True)
    r = next(s for s in tuned.steps if s.parameter == "r")
    nis = [s.nis for s in r.scores]
    assert nis == sorted(nis, reverse=True)
    assert nis[0] > 50.0
    assert nis[-1] < 0.2


def innovations(nis, sigma, status=ACCEPTED, kind=POSITION):
    n = len(nis)
    return Innovations(
        np.arange(float(n)), np.full(n, kind), np.full(n, status), np.array(nis, dtype=float), np.zeros((n, 3)),
        np.array(sigma, dtype=float),
    )  # fmt: skip


def test_likelihood_has_its_largest_value_at_the_true_sigma():
    """Drawn innovations: the best scale is 1 within 7 % (Student's tail) and two standard errors of 1/sqrt(6 n)."""
    rng = np.random.default_rng(1)
    squared = np.sum(rng.standard_normal((4000, 3)) ** 2, axis=1)
    scales = np.geomspace(0.5, 2.0, 81)
    values = [likelihood(innovations(squared / s**2, np.full((4000, 3), s))).likelihood for s in scales]
    assert scales[int(np.argmax(values))] == pytest.approx(1.0, abs=0.06)


def test_blunders_do_not_set_the_noise():
    rng = np.random.default_rng(1)
    squared = np.sum(rng.standard_normal((2000, 3)) ** 2, axis=1)
    squared[::100] = 1e4
    scales = np.geomspace(0.3, 10.0, 81)
    values = [likelihood(innovations(squared / s**2, np.full((2000, 3), s))).likelihood for s in scales]
    assert scales[int(np.argmax(values))] < 1.25  # normal likelihood: sqrt(1 + 1e4 / 300) = 6


def test_what_was_not_tested_does_not_count():
    some = innovations([3.0, np.nan, 3.0], np.ones((3, 3)))
    assert likelihood(some).freedom == 6
    assert likelihood(innovations([3.0], np.ones((1, 3)), REJECTED)).freedom == 3
    scalar = innovations([1.0], [[2.0, np.nan, np.nan]], kind=SPEED)
    assert likelihood(scalar).freedom == 1
    assert likelihood(scalar).likelihood == pytest.approx(-0.5 * (31.0 * np.log1p(1.0 / 30.0) + 2.0 * np.log(2.0)))
    with pytest.raises(InputError, match="no innovation"):
        likelihood(innovations([3.0], np.ones((1, 3)), UNUSED))


def test_factors_multiply_variances_of_a_configuration(tmp_path):
    config = NavigationConfig.load(EXAMPLES / "rtkexp_drive.toml")
    changed = with_factors(config, Factors(4.0, 9.0, 16.0), tmp_path / "imu.toml")
    assert imu_spec(changed).gyro.random_walk == pytest.approx(3.0 * imu_spec(config).gyro.random_walk)
    before, after = (state_layout(c, imu_spec(c)) for c in (config, changed))
    for name, model in before.models.items():
        assert after.models[name].sigma == pytest.approx(2.0 * model.sigma)
        assert after.models[name].noise == pytest.approx(3.0 * model.noise)
    assert changed.gnss.sigma_scale == pytest.approx(4.0)
    assert changed.gnss.position_sigma_floor_m == pytest.approx((0.08, 0.08, 0.08))
    assert changed.alignment.sideslip_deg == pytest.approx(4.0)
    assert state_layout(with_factors(config, Factors(), tmp_path / "i.toml"), imu_spec(config)).models == before.models


def test_a_recording_in_two_parts():
    """R is found on the first half of a drive whose receiver claims a third of its errors, and holds on the second."""
    scenario = Scenario.load(EXAMPLES / "town.toml")
    gnss = scenario.gnss.model_copy(update={"drift_position_m": (0.0, 0.0, 0.0), "outages_s": ()})
    recording = simulate(scenario.model_copy(update={"gnss": gnss}), np.random.default_rng(2))
    config = NavigationConfig.load(
        EXAMPLES / "town_navigation.toml",
        [("gnss.sigma_scale", 0.33), ("gnss.gate", "off"), ("outages.every_s", 25.0), ("outages.length_s", 10.0)],
    )
    outcome = tune(*recording_runners(recording, config), grid=(0.1, 10.0), order=("p0", "q", "r"), passes=1)
    assert outcome.chosen.r == 10.0
    assert outcome.holds
    assert outcome.after.nis == pytest.approx(1.0, abs=0.25)
    assert outcome.after_out.nees < outcome.before_out.nees


def test_interruption_keeps_the_steps_that_were_finished():
    seen = []

    def stop(fraction):
        seen.append(fraction)
        if fraction > 0.4:
            raise KeyboardInterrupt

    outcome = tune(lambda f: Score(-f.p0, 3, 1.0), grid=(0.5, 2.0), passes=1, progress=stop)
    assert [s.parameter for s in outcome.steps] == ["p0"]
    assert not outcome.complete


def test_what_cannot_be_done_is_said():
    def runner(factors):
        return Score(0.0, 3, 1.0)

    with pytest.raises(InputError, match="expected p0, q, r"):
        tune(runner, order=("s",))
    with pytest.raises(InputError, match="positive factors"):
        tune(runner, grid=())
    with pytest.raises(InputError, match="positive numbers"):
        Factors(q=-1.0)
