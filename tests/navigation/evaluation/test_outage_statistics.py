"""Many outages of one run: continued from the filter's records, exactly as if each had a run of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import EXAMPLES

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig, OutageSection
from schuler.navigation.evaluation import outages as module
from schuler.navigation.evaluation.consistency import separation
from schuler.navigation.evaluation.outages import OutageStatistics, outage_statistics
from schuler.navigation.run import navigate
from schuler.simulation.scenario import Scenario, simulate


@pytest.fixture(scope="module")
def town():
    scenario = Scenario.load(EXAMPLES / "town.toml")
    gnss = scenario.gnss.model_copy(
        update={"drift_position_m": (0.0, 0.0, 0.0), "outages_s": (), "first_s": 0.4937}
    )  # fixes between IMU samples and between records
    return simulate(scenario.model_copy(update={"gnss": gnss}), np.random.default_rng(3))


@pytest.fixture(scope="module")
def config():
    return NavigationConfig.load(EXAMPLES / "town_navigation.toml")


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "entries",
    [[], [("aiding.odometer", {"scale_sigma": 0.01})], [("filter.noise", {"gyro": 5.0, "accel": [2.0, 5.0, 3.0]})]],
    ids=["free", "aided", "noisy"],
)
def test_a_continued_run_is_the_run_of_its_own(town, entries):
    """Fork and direct run with the window differ by the phase of covariance steps only: 2 % of a sigma, discretisation.

    Aids without GNSS go on in both; they are offered at other instants (the rate counts from the start).
    """
    config = NavigationConfig.load(EXAMPLES / "town_navigation.toml", [*entries, ("filter.tune", False)])
    outages = outage_statistics(town, config, lengths=(5.0, 40.0), starts=[62.0, 90.0])
    assert outages.starts[0] <= 62.0 < outages.starts[0] + 1.0
    for i, start in enumerate(outages.starts):
        window = ((start + 1e-3, start + 40.5),)
        direct = navigate(
            town,
            config.model_copy(
                update={
                    "outages": OutageSection(windows_s=window),
                    "filter": config.filter.model_copy(update={"smooth": False}),
                }
            ),
        )
        for length in (5.0, 40.0):
            t = town.start + start + length
            k = int(np.argmin(np.abs(direct.t - t)))
            error = direct.states.at([direct.t[k]]).r_eb_e - town.reference.at([direct.t[k]]).r_eb_e
            P = direct.covariance[k][6:9, 6:9]
            j = outages._at(length)
            sigma = np.sqrt(np.diag(P))
            assert np.linalg.norm(error) == pytest.approx(
                np.linalg.norm(outages.error_n[i, j]), abs=0.02 * float(np.linalg.norm(sigma))
            )
            np.testing.assert_allclose(np.sqrt(np.diag(outages.cov_n[i, j])), sigma, rtol=5e-3)


def test_statistics_are_hayals():
    """Mean and sigma with divisor n, closed form on numbers made by hand; rounding."""
    error = np.zeros((2, 3, 3))
    error[0, 1:], error[1, 1:] = [[3.0, 0.0, 0.0], [4.0, 0.0, 1.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    cov = np.broadcast_to(np.diag([4.0, 4.0, 1.0]), (2, 3, 3, 3)).copy()
    s = OutageStatistics(np.array([1.0, 2.0]), np.array([10.0, 20.0]), np.array([0.0, 1.0, 2.0]), error, cov)
    np.testing.assert_allclose(s.mean(1.0), [2.0, 0.0, 0.0])
    np.testing.assert_allclose(s.sigma(1.0), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(s.mean(2.0), [2.0, 0.0, 1.0])
    np.testing.assert_allclose(s.sigma(2.0, every_epoch=True), [np.sqrt(2.5), 0.0, 0.5])
    assert s.rms_horizontal(2.0) == pytest.approx(np.sqrt(8.0))
    assert s.claimed_horizontal(2.0) == pytest.approx(np.sqrt(8.0))
    assert s.nees(2.0) == pytest.approx((16.0 / 4.0 + 1.0 + 1.0) / 2.0 / 3.0)
    row = s.table().row(outage_s=2.0)
    assert row["mean_m"] == pytest.approx(np.sqrt(5.0))
    assert row["sigma_total_m"] == pytest.approx(2.0)
    with pytest.raises(InputError, match="no errors 3 s after"):
        s.sigma(3.0)


def test_errors_and_claimed_sigmas_grow_with_the_outage(town, config):
    """Neighbouring outages share their biases, so the NEES of one drive is loose: 0.2 to 3, statistical."""
    outages = outage_statistics(town, config, lengths=(2.0, 10.0, 30.0), every_s=5.0)
    claims = [outages.claimed_horizontal(x) for x in (2.0, 10.0, 30.0)]
    assert claims == sorted(claims)
    assert len(outages) > 10
    assert 0.2 < outages.nees(30.0) < 3.0
    assert outages.table().column("outages") == [len(outages)] * 3


def test_an_aid_that_is_no_gnss_goes_on(town, config):
    aided = NavigationConfig.load(EXAMPLES / "town_navigation.toml", [("aiding.odometer", {})])
    free = outage_statistics(town, config, lengths=(30.0,), every_s=20.0)
    held = outage_statistics(town, aided, lengths=(30.0,), every_s=20.0)
    assert held.claimed_horizontal(30.0) < 0.6 * free.claimed_horizontal(30.0)


def test_against_fixes_at_the_antenna(town, config):
    """Without a reference the fixes are it: errors at the antenna, larger by the fixes' noise of 2.1 m; statistical."""
    bare = replace(town, reference=None)
    outages = outage_statistics(bare, config, lengths=(10.0,), every_s=5.0)
    truth = outage_statistics(town, config, lengths=(10.0,), every_s=5.0)
    n = min(len(outages), len(truth))
    added = np.mean(outages.end_errors(10.0)[:n, :2] ** 2) - np.mean(truth.end_errors(10.0)[:n, :2] ** 2)
    assert 0.3 < added / (1.5**2 * 0.75) < 2.0  # interpolated between two fixes: about three quarters of the variance


def test_impossible_outages_are_refused(town, config):
    with pytest.raises(InputError, match="multiples of step_s"):
        outage_statistics(town, config, lengths=(2.5,))
    with pytest.raises(InputError, match="at least step_s"):
        outage_statistics(town, config, lengths=())
    with pytest.raises(InputError, match="too short for"):
        outage_statistics(town, config, lengths=(1000.0,))
    with pytest.raises(InputError, match="starts: expected times"):
        outage_statistics(town, config, lengths=(10.0,), starts=[1e6])


def test_interruption_keeps_the_outages_that_were_finished(town, config, monkeypatch):
    genuine, calls = module._fork, []

    def interrupted(*args):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(1)
        return genuine(*args)

    monkeypatch.setattr(module, "_fork", interrupted)
    outages = outage_statistics(town, config, lengths=(5.0,), every_s=10.0)
    assert len(outages) == 2
    assert not outages.complete


def test_separation_is_what_the_smoother_added(town, config):
    """``cov(x_f - x_s) = P_f - P_s`` (Rauch, Tung, Striebel): normalised square 1 on average, one run: 0.4..2."""
    result = navigate(
        town, config.model_copy(update={"outages": OutageSection(windows_s=((70.0, 95.0), (120.0, 140.0)))})
    )
    apart = separation(result)
    assert np.abs(apart.difference[-1]).max() < 1e-9  # at the end both know the same
    assert 0.4 < apart.normalised().mean() < 2.0
    inside = np.abs(apart.difference[:, 6:]) <= 3.0 * apart.sigma[:, 6:] + 1e-9
    assert inside.mean() > 0.97
    with pytest.raises(InputError, match="in this order"):
        separation(result.smooth(), result.smooth())
