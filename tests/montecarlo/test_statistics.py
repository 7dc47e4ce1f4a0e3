"""One pass, any order, the same numbers to the last bit; and right ones."""

import numpy as np
import pytest
from scipy import stats

from schuler.exceptions import InputError
from schuler.montecarlo import Accumulator, Rows, Statistics
from schuler.montecarlo.moments import merged, merged_products, moments, products
from schuler.montecarlo.sketch import QuantileSketch


def rows(x, first=0, failures=None):
    return Rows(np.arange(first, first + len(x)), {"x": x}, failures or {})


def reduced(pieces, keep=None):
    taken = Accumulator(keep)
    for piece in pieces:
        taken.add(piece)
    return taken


def test_moments_of_parts_are_those_of_the_whole(rng):
    x = 3.0 + rng.gamma(2.0, size=(500, 4))
    whole = moments(x)
    parts = moments(x[:77])
    for a, b in ((77, 78), (78, 300), (300, 500)):
        parts = merged(parts, moments(x[a:b]))
    d = x - x.mean(axis=0)
    for k, m in enumerate((parts.m2, parts.m3, parts.m4), 2):
        np.testing.assert_allclose(m, (d**k).sum(axis=0), rtol=1e-11)  # rounding
    assert parts.n == 500
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=1e-14)
    np.testing.assert_array_equal((parts.low, parts.high), (x.min(axis=0), x.max(axis=0)))


def test_a_large_mean_does_not_eat_the_spread(rng):
    """Sums of squares would: Earth-fixed positions of 6e6 m with errors of millimetres."""
    x = 6.4e6 + 1e-3 * rng.standard_normal((1000, 1))
    got = reduced([rows(x[:, 0])]).statistics()["x"]
    assert float(got.sigma) == pytest.approx(float(np.std(x - 6.4e6, ddof=1)), rel=1e-6)  # 6.4e6 has digits of 1e-9


def test_products_are_covariances(rng):
    x = rng.standard_normal((300, 2, 3)) @ rng.standard_normal((3, 3))
    p = merged_products(products(x[:11]), products(x[11:]))
    for k in range(2):
        np.testing.assert_allclose(p.C[k] / 299, np.cov(x[:, k], rowvar=False), rtol=1e-12)


def test_against_numpy_and_scipy(rng):
    x = rng.gamma(3.0, size=(777, 2, 3))
    got = reduced([rows(x)], Statistics(covariance=("x",))).statistics()["x"]
    assert (got.n, got.shape) == (777, (2, 3))
    np.testing.assert_allclose(got.mean, x.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(got.sigma, x.std(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(got.rms, np.sqrt((x**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(got.kurtosis, stats.kurtosis(x, axis=0, fisher=False), rtol=1e-11)
    np.testing.assert_allclose(got.covariance[1], np.cov(x[:, 1], rowvar=False), rtol=1e-12)
    np.testing.assert_array_equal(got.minimum, x.min(axis=0))
    np.testing.assert_array_equal(got.maximum, x.max(axis=0))


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_quantiles_are_as_close_as_they_say(rng, scale):
    """The bound is a law, not a statistic: it holds for every quantile of every sample."""
    x = scale * np.column_stack(
        (rng.standard_normal(5001), rng.gamma(0.3, size=5001), -rng.pareto(1.5, 5001), rng.integers(-2, 3, 5001))
    )
    for accuracy in (0.001, 0.005, 0.05):
        sketch = QuantileSketch(4, accuracy)
        for part in np.array_split(x, 13):
            sketch.add(part)
        for q in (0.0, 0.01, 0.05, 0.3, 0.5, 0.7, 0.95, 0.999, 1.0):
            exact = np.quantile(x, q, axis=0, method="lower")
            assert np.all(np.abs(sketch.quantile(q) - exact) <= accuracy * np.abs(exact) * (1.0 + 1e-9)), q


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_a_large_mean_does_not_spoil_quantiles(rng, offset):
    """They are kept of deviations from the first run: errors are shares of the spread, not of the mean."""
    x = offset + rng.standard_normal((2000, 3))
    got = reduced([rows(x)]).statistics()["x"]
    for q in (0.001, 0.05, 0.5, 0.95):
        exact = np.quantile(x, q, axis=0, method="lower")
        assert np.all(np.abs(got.quantile(q) - exact) <= got.accuracy * np.abs(exact - x[0]) + 1e-9), q


def test_quantiles_when_the_first_runs_fail_or_are_missing(rng):
    x = rng.standard_normal(300)
    good = np.arange(2, 300)
    bad = {0: "why", 1: "why"}
    whole = reduced([Rows(good, {"x": x[2:]}, bad)]).statistics()["x"]
    late = reduced([rows(x[100:], 100), rows(x[2:100], 2), Rows(np.zeros(0, dtype=np.int64), {}, bad)])
    assert late.statistics()["x"].quantile(0.8) == whole.quantile(0.8)
    assert not late._early
    # interrupted before the first run was there: still good to the bound
    without = reduced([rows(x[100:], 100)])
    exact = np.quantile(x[100:], 0.8, method="lower")
    assert abs(without.statistics()["x"].quantile(0.8) - exact) <= 0.005 * abs(exact - x[100])
    # and no harm is done to those that come later
    without.add(rows(x[:100]))
    assert without.statistics()["x"].quantile(0.8) == reduced([rows(x)]).statistics()["x"].quantile(0.8)


def test_quantiles_do_not_depend_on_the_order_of_the_parts(rng, monkeypatch):
    monkeypatch.setattr("schuler.montecarlo.sketch._WAIT", 100)  # settle often
    x = rng.standard_normal((1000, 3))
    a, b = QuantileSketch(3), QuantileSketch(3)
    for part in np.array_split(x, 7):
        a.add(part)
    for part in np.array_split(x, 31)[::-1]:
        b.add(part)
    for q in (0.05, 0.5, 0.95):
        np.testing.assert_array_equal(a.quantile(q), b.quantile(q))


def test_memory_of_quantiles_does_not_grow_with_the_runs(rng):
    sketch = QuantileSketch(1)
    sizes = []
    for _ in range(3):
        for _ in range(20):
            sketch.add(rng.standard_normal((50_000, 1)))
        sketch.quantile(0.5)
        sizes.append(len(sketch._keys))
    # three times the values come three times as near to zero: ln(3) / ln(1.01) more buckets a side, and some far out
    assert sizes[-1] - sizes[0] < 2.0 * 1.5 * np.log(3.0) / 0.01
    assert sizes[0] < 4000


@pytest.mark.parametrize("n", [1, 63, 64, 65, 300, pytest.param(1000, marks=pytest.mark.campaign)])
def test_any_order_and_any_pieces_give_the_same_bits(rng, n):
    """With failures among them, so that parts of different size are put together, where sums do not commute."""
    x = rng.gamma(2.0, size=(n, 40))
    failed = {k: "why" for k in range(n) if k % 11 == 5 or 100 < k < 140}

    def piece(first, last):
        good = np.array([k for k in range(first, last) if k not in failed], dtype=np.int64)
        return Rows(
            good, {"x": x[good]} if len(good) else {}, {k: failed[k] for k in range(first, last) if k in failed}
        )

    keep = Statistics(covariance=("x",))
    reference = reduced([piece(0, n)], keep).statistics()["x"]
    for size in (1, 7, 64, 200):
        pieces = [piece(k, min(k + size, n)) for k in range(0, n, size)]
        for order in (range(len(pieces)), rng.permutation(len(pieces)), range(len(pieces))[::-1]):
            got = reduced([pieces[k] for k in order], keep).statistics()["x"]
            for name in ("mean", "m2", "m3", "m4"):
                np.testing.assert_array_equal(getattr(got.moments, name), getattr(reference.moments, name))
            if n > 1:
                np.testing.assert_array_equal(got.covariance, reference.covariance)
            np.testing.assert_array_equal(got.quantile(0.3), reference.quantile(0.3))


def test_what_is_held_does_not_grow_with_the_runs(rng):
    taken = Accumulator()
    for k in range(0, 64 * 100, 10):
        taken.add(rows(rng.standard_normal(10), k))
        assert len(taken._open) <= 2
        assert len(taken._tree) <= 7  # one for each binary digit of the number of blocks
    assert taken.statistics()["x"].n == 6400


def test_failed_runs_are_counted_and_in_no_statistic(rng):
    x = rng.standard_normal(200)
    bad = dict.fromkeys(range(3, 200, 7), "why")
    good = np.array([k for k in range(200) if k not in bad])
    got = reduced([Rows(good, {"x": x[good]}, bad)])
    assert got.done == 200
    assert got.failures == bad
    assert float(got.statistics()["x"].mean) == pytest.approx(x[good].mean(), rel=1e-13)
    # a block in which nothing could be done
    empty = dict.fromkeys(range(64), "why")
    got = reduced([Rows(np.zeros(0, dtype=np.int64), {}, empty), rows(x, 64)])
    assert got.statistics()["x"].n == 200


def test_confidence_of_the_sigma_covers_as_often_as_it_says(rng):
    """2000 campaigns of 40 runs: share of intervals that hold the true sigma, 4 standard errors."""
    for draw, sigma, normal, probability, slack in (
        (lambda: rng.standard_normal((40, 2000)), 1.0, True, 0.95, 0.0),
        # the kurtosis of 400 runs is itself uncertain; an exponential's intervals are a little short
        (lambda: rng.exponential(size=(400, 2000)), 1.0, False, 0.9, 0.03),
        (lambda: rng.uniform(-1.0, 1.0, (400, 2000)), 3.0**-0.5, False, 0.9, 0.0),
    ):
        low, high = reduced([rows(draw())], Statistics(quantiles=False)).statistics()["x"].sigma_interval(
            probability, normal=normal
        )  # fmt: skip
        share = np.mean((low < sigma) & (sigma < high))
        assert abs(share - probability) < 4.0 * np.sqrt(probability * (1.0 - probability) / 2000) + slack


def test_band_of_a_nees(rng):
    honest = reduced([rows(rng.chisquare(9, (200, 1000)) / 9)]).statistics()["x"].consistency(9)
    assert honest.low < 1.0 < honest.high
    assert abs(honest.share - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 1000)
    assert reduced([rows(rng.chisquare(9, (200, 50)) / 6)]).statistics()["x"].consistency(9).share == 0.0


def test_words_for_what_is_not_there(rng):
    x = rng.standard_normal(100)
    got = reduced([rows(x)], Statistics(quantiles=False)).statistics()["x"]
    with pytest.raises(InputError, match=r"quantiles were not kept.*Statistics\(quantiles"):
        got.quantile(0.5)
    with pytest.raises(InputError, match=r"covariance was not kept"):
        _ = got.covariance
    with pytest.raises(InputError, match="two runs"):
        _ = reduced([rows(x[:1])]).statistics()["x"].sigma
    with pytest.raises(InputError, match=r"no column 'y'; the runs give x"):
        reduced([rows(x)], Statistics(quantiles=("y",)))
    with pytest.raises(InputError, match="x is one number"):
        reduced([rows(x)], Statistics(covariance=("x",)))
    with pytest.raises(InputError, match="share from 0 to 1"):
        reduced([rows(x)]).statistics()["x"].quantile(1.5)
    with pytest.raises(InputError, match=r"relative error from 0.0001 to 0.1, got 0.5"):
        reduced([rows(x)], Statistics(accuracy=0.5))
