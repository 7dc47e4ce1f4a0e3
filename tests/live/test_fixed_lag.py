"""The live smoother has the numbers of the batch smoother over the data up to the newest sample."""

import live_cases as cases
import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.live import LiveNavigator
from schuler.navigation.run import navigate

SMOOTHED = {**cases.CONFIG, "filter": {**cases.CONFIG["filter"], "smooth": True}}
ROUNDING = 1e-8  # geodetic coordinates and back [m], and other sums [rad], [m/s]


@pytest.fixture(scope="module")
def recording():
    return cases.drive()


def fed_until(live, recording, stop, late=0.0, start=0.0):
    """Feed what arrives until a time."""
    imu, fixes = recording.imu.between(start + 1e-6, stop), cases.fixes(recording)
    waiting = [fix for fix in fixes if start < fix.t + late <= stop]
    for first in range(0, len(imu), 50):
        part = slice(first, first + 50)
        live.imu_many(imu.t[part], imu.gyro[part], imu.accel[part])
        while waiting and waiting[0].t + late <= imu.t[part][-1]:
            live.take(waiting.pop(0))


def same_as_batch(live, recording, fixes_until):
    """Compare with the batch run of what came, smoothed."""
    newest, got = live.solution().t, live.smoothed()
    part = recording.between(0.0, newest)
    part = type(part)(imu=part.imu, gnss=part.gnss.between(0.0, fixes_until))
    batch = navigate(part, SMOOTHED, initial=live.initial).smooth()
    k = int(np.searchsorted(batch.trajectory.t, got.t - 1e-6))
    assert batch.trajectory.t[k] == pytest.approx(got.t, abs=1e-9)
    assert abs(newest - live.smoother_lag_s - got.t) < 0.0101
    assert np.linalg.norm(cases.position(got) - batch.trajectory.r_eb_e[k]) < ROUNDING
    np.testing.assert_allclose(got.v_eb_n, batch.trajectory.v_eb_n[k], rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(got.rpy_nb, batch.trajectory.rpy_nb[k], rtol=0.0, atol=ROUNDING)
    return got, batch


def test_it_is_the_batch_smoother_of_the_data_so_far(recording):
    live = LiveNavigator.from_config(SMOOTHED, kind=recording.imu.kind, smoother_lag_s=5.0)
    assert live.smoothed() is None
    fed_until(live, recording, 30.0)
    fed_until(live, recording, 41.0, start=30.0)
    same_as_batch(live, recording, 41.0)
    fed_until(live, recording, 43.337, start=41.0)
    filtered = live.solution()
    got, batch = same_as_batch(live, recording, 43.337)
    assert got.smoother_lag_s == 5.0
    # sigmas are of the propagation before, as records are
    records = np.searchsorted(batch.t, got.t)
    sigma = np.sqrt(np.diagonal(batch.covariance[records - 1 : records + 1], axis1=1, axis2=2)[:, 6:9])
    assert np.all(got.sigma_r_n < sigma.max(axis=0) * 1.05)
    assert np.all(got.sigma_r_n > sigma.min(axis=0) * 0.95)
    assert np.all(got.sigma_r_n < filtered.sigma_r_n)  # what came later tells more


def test_attitudes_are_claimed_as_by_a_batch_run(recording):
    """No better than the budget's misalignment, filtered and smoothed, as long as the filter knows them better."""
    imu = {triad: {**terms, "misalignment_mrad": 30.0} for triad, terms in cases.CONFIG["imu"].items()}
    config = {**SMOOTHED, "imu": imu}
    live = LiveNavigator.from_config(config, kind=recording.imu.kind, smoother_lag_s=5.0)
    fed_until(live, recording, 60.005)
    batch = navigate(recording.between(0.0, live.solution().t), config, initial=live.initial)
    for got in (live.solution(), live.smoothed()):
        np.testing.assert_allclose(got.sigma_psi_n, 0.03, rtol=1e-9)  # rounding
    np.testing.assert_allclose(np.diag(live.covariance)[:3], 9e-4, rtol=1e-9)
    np.testing.assert_allclose(np.diag(batch.covariance[-1])[:3], 9e-4, rtol=1e-9)
    own = batch.state_at(-1).P
    assert own[0, 0] < 1e-4
    # the newest propagation is up to a tenth of a second from the last record; discretisation
    kept = live._running().covariance_n
    np.testing.assert_allclose(np.sqrt(np.diag(kept)), np.sqrt(np.diag(own)), rtol=0.02)
    np.testing.assert_array_equal(live.covariance[3:], kept[3:])


def test_late_fixes_are_in_it(recording):
    """Fixes a second late: those that came are in the solution, those under way are not."""
    live = LiveNavigator.from_config(SMOOTHED, kind=recording.imu.kind, smoother_lag_s=8.0, lag_s=3.0)
    fed_until(live, recording, 60.0, late=1.0)
    same_as_batch(live, recording, live.solution().t - 1.0)


@pytest.mark.campaign
@pytest.mark.parametrize("lag_s", [1.0, 60.0])
def test_any_lag(recording, lag_s, tmp_path):
    """Also across a restart from a file."""
    live = LiveNavigator.from_config(SMOOTHED, kind=recording.imu.kind, smoother_lag_s=lag_s)
    fed_until(live, recording, 100.0)
    live = LiveNavigator.load(live.save(tmp_path / "state"))
    fed_until(live, recording, 120.0, start=100.0)
    same_as_batch(live, recording, 120.0)


def test_a_run_without_smoother_says_so(recording):
    with pytest.raises(InputError, match="smoother_lag_s"):
        LiveNavigator.from_config(SMOOTHED).smoothed()
    with pytest.raises(InputError, match="up to 60"):
        LiveNavigator.from_config(SMOOTHED, smoother_lag_s=100.0)
