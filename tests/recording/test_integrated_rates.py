"""Increments of a long log of rates, made anew when asked for: the same numbers as kept ones, in less memory."""

import tracemalloc

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation import navigate
from schuler.recording import integrated_rates
from schuler.recording.integrated_rates import IntegratedRates
from schuler.recording.series import ImuSeries
from schuler.simulation import simulate


def log(n=1000):
    rng = np.random.default_rng(4)
    return ImuSeries(np.cumsum(rng.uniform(0.004, 0.006, n)), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize(
    "part",
    [
        lambda inc: inc,
        lambda inc: inc.between(1.0, 4.0),
        lambda inc: inc.between(1.0, 4.0).between(2.0, 3.0),
        lambda inc: inc.shifted(0.1),
        lambda inc: inc.between(1.0, 4.0).shifted(0.5).between(2.0, 4.0),
    ],
    ids=["whole", "part", "part of a part", "shifted", "part shifted"],
)
def test_numbers_are_those_of_kept_increments(monkeypatch, order, part):
    """Bit for bit, of any rows: a block has the samples before it that its rule needs."""
    kept = part(log().increments(order=order))
    monkeypatch.setattr(integrated_rates, "KEPT", 10)
    monkeypatch.setattr(integrated_rates, "_BLOCK", 77)
    derived = part(log().increments(order=order))
    assert isinstance(derived, IntegratedRates)
    assert (len(derived), derived.start) == (len(kept), kept.start)
    for name in ("t", "dt", "dtheta_ib_b", "dv_ib_b"):
        np.testing.assert_array_equal(getattr(derived, name), getattr(kept, name), name)
    for rows in (slice(0, 5), slice(13, 57), slice(len(kept) - 3, len(kept) + 9)):
        for mine, theirs in zip(derived.arrays(rows), kept.arrays(rows), strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_a_short_part_is_kept(monkeypatch):
    monkeypatch.setattr(integrated_rates, "KEPT", 500)
    assert not isinstance(log().increments().between(1.0, 2.0), IntegratedRates)


def test_an_unknown_rule_is_refused_at_once(monkeypatch):
    monkeypatch.setattr(integrated_rates, "KEPT", 10)
    with pytest.raises(InputError, match="order: expected 1, 2 or 3, got 7"):
        log().increments(order=7)


def test_nothing_is_kept_of_a_long_log():
    imu = log(integrated_rates.KEPT + 100)
    tracemalloc.start()
    try:
        increments = imu.increments().between(float(imu.t[5]), float(imu.t[-1]))
        assert tracemalloc.get_traced_memory()[0] < len(imu)  # 56 bytes a row when kept
        assert len(increments.arrays(slice(0, 1000))[0]) == 1000
    finally:
        tracemalloc.stop()


@pytest.mark.campaign
def test_a_run_is_the_same(monkeypatch):
    """Filter, noise tuned and smoother, of which each takes parts."""
    recording = simulate("examples/town.toml").between(0.0, 80.0)
    config = {"imu": {"catalogue": "MTi-G-710", "rate_order": 3}, "filter": {"smooth": True}}
    kept = navigate(recording, config)
    monkeypatch.setattr(integrated_rates, "KEPT", 1000)
    derived = navigate(recording, config)
    assert derived.notes == kept.notes
    for mine, theirs in ((derived, kept), (derived.smooth(), kept.smooth())):
        np.testing.assert_array_equal(mine.trajectory.r_eb_e, theirs.trajectory.r_eb_e)
        np.testing.assert_array_equal(mine.parameters, theirs.parameters)
        np.testing.assert_array_equal(mine.covariance_e, theirs.covariance_e)
