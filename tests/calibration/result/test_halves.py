"""Law of halves: claims that hold stay, claims that do not are widened, and a verdict says why."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.calibration.result.halves import block_of, checked, halves_of, halves_words, rms_interval, without_thirds
from schuler.calibration.result.result import result_from

NAMES = [f"b_g_{a}" for a in "xyz"] + [f"M_g_{a}{b}" for a in "xyz" for b in "xyz"]


def result(z, sigma=1e-3, status="ok"):
    return result_from(
        "freepose", {n: (sigma * v, sigma) for n, v in zip(NAMES, z, strict=True)}, "full", status=status
    )


def test_claims_that_hold_are_left_alone(rng):
    """Draws of the claims themselves: what is widened is what chance puts beyond 1 %. Statistical."""
    widened = 0
    for _ in range(200):
        a, b, c = (result(rng.standard_normal(12)) for _ in range(3))
        out = checked(c, {"odd and even rests": (a, b)})
        widened += len(out.extra["halves"]["widened"])
        assert out.status == "ok"
    assert widened < 400 * (0.01 + 3.0 * np.sqrt(0.01 / 400.0))


def test_a_block_that_does_not_hold_is_widened_by_what_it_is_off():
    """Closed form: halves off by 4 sigma of the difference widen the block by 4, its correlations unchanged."""
    z = np.zeros(12)
    z[:3] = 4.0 * np.sqrt(2.0)
    out = checked(result(np.zeros(12)), {"odd and even rests": (result(z), result(np.zeros(12)))}, causes=["drift"])
    np.testing.assert_allclose(out.sigma[:3], 4e-3, rtol=1e-3)  # the factor is kept to three digits in text only
    np.testing.assert_allclose(out.sigma[3:], 1e-3)
    assert out.status == "warning"
    halves = out.extra["halves"]
    assert halves["verdict"]["status"] == "doubtful"
    assert halves["verdict"]["causes"] == ["drift"]
    assert halves["widened"] == {"b_g": 4.0}
    assert "likely: drift" in out.verdicts[-1]
    assert "b_g 4" in halves_words(out)
    assert any(line.startswith("halves: doubtful") for line in out.summary().splitlines())


def test_an_error_that_both_halves_share_is_not_in_their_difference():
    """Closed form: of two claims of sigma^2 = 4, three shared, the difference has 2, not 8; never more than both."""
    z = np.zeros(12)
    z[:3] = 2.0 * np.sqrt(2.0)
    pair = {"odd and even rests": (result(z / 2.0, 2e-3), result(np.zeros(12), 2e-3))}
    shared = {"odd and even rests": dict.fromkeys(NAMES[:3], 2e-6)}
    whole = result(np.zeros(12))
    rms = [checked(whole, pair, stated=by).extra["halves"]["splits"]["odd and even rests"] for by in (None, shared)]
    assert rms[0]["b_g"] == pytest.approx(1.0, abs=0.01)
    assert rms[1]["b_g"] == pytest.approx(2.0, abs=0.01)
    assert rms[0]["M_g"] == rms[1]["M_g"] == 0.0
    large = {"odd and even rests": dict.fromkeys(NAMES[:3], 1.0)}
    assert checked(whole, pair, stated=large).extra["halves"]["splits"]["odd and even rests"] == rms[0]


def test_halves_without_anything_in_common_fail():
    out = checked(result(np.zeros(12)), {"halves": (result(np.full(12, 50.0)), result(np.zeros(12)))})
    assert out.extra["halves"]["verdict"]["status"] == "failed"


@pytest.mark.parametrize("pair", [None, (result(np.zeros(12), status="refused"), result(np.zeros(12)))])
def test_without_halves_nothing_is_claimed_about_them(pair):
    whole = result(np.zeros(12))
    out = checked(whole, {"odd and even rests": pair}, needs="twelve rests are needed")
    np.testing.assert_array_equal(out.covariance, whole.covariance)
    assert halves_words(out) == "twelve rests are needed"


def test_without_every_third_rest(rng):
    """A part that shares two thirds: the difference has a third of its variance. Statistical, 300 draws."""
    z = []
    for _ in range(300):
        e = rng.standard_normal((12, 3))  # means of three thirds, sigma sqrt(3) each for a mean of sigma 1
        complete, part = e.sum(axis=1) / np.sqrt(3.0), e[:, 1:].sum(axis=1) * np.sqrt(3.0) / 2.0
        other = result(part)
        other = replace(other, covariance=1.5 * other.covariance)
        pairs = without_thirds(result(complete), [other])
        out = checked(result(complete), pairs)
        z += list(next(iter(out.extra["halves"]["splits"].values())).values())
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_the_interval_by_chance_holds_95_percent(rng, correlation):
    """Of draws with these correlations; 4 standard errors, and 1 % for the one chi-square instead of several."""
    R = np.full((9, 9), correlation) + (1.0 - correlation) * np.eye(9)
    z = rng.standard_normal((4000, 9)) @ np.linalg.cholesky(R).T
    low, high = rms_interval(np.linalg.eigvalsh(R))
    rms = np.sqrt((z * z).mean(axis=1))
    assert abs(((rms > low) & (rms < high)).mean() - 0.95) < 4.0 * np.sqrt(0.05 / 4000.0) + 0.01


def test_three_numbers_cannot_be_asked_for_more():
    """Closed form: root mean square of three, and the share of it that a band of 0.7 to 1.4 holds."""
    assert rms_interval(np.ones(3)) == pytest.approx((0.268, 1.765), abs=1e-3)
    assert np.diff(chi2.cdf(3.0 * np.square([0.7, 1.4]), 3))[0] == pytest.approx(0.57, abs=0.01)


def test_names_of_blocks_and_splits():
    assert [block_of(n) for n in ("b_a_x", "M_g_xy", "r_a_yx", "delay")] == ["b_a", "M_g", "r_a", "delay"]
    for a, b in halves_of(9).values():
        assert sorted([*range(9)[a], *range(9)[b]]) == list(range(9))
