"""Single points judged: counts that add up, residuals in their sigmas, verdicts, errors against a reference."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.frames import C_en, ecef_from_llh
from schuler.gnss import PointEvaluation, RangeErrors, nominal_orbits, solve_points, synthetic_ranges

LLH = np.array([0.84, 0.2, 400.0])
N = 200


@pytest.fixture(scope="module")
def drive():
    """Ranges with white noise of 0.7 m that is stated rightly, and the true way."""
    t, v_e = np.arange(float(N)), np.tile(C_en(LLH) @ (8.0, 3.0, 0.0), (N, 1))
    r_e = ecef_from_llh(LLH) + v_e * t[:, None]
    errors = RangeErrors(noise=0.7, multipath=0.0, atmosphere=0.0)
    return synthetic_ranges(t, r_e, v_e, nominal_orbits("GE"), np.random.default_rng(3), errors).ranges, r_e


def judged(ranges, r_e=None, **over):
    return PointEvaluation(solve_points(ranges, **over), ranges, r_e)


def test_every_range_of_a_satellite_is_used_or_has_a_reason(drive):
    ranges, _ = drive
    late = (ranges.sat == ranges.sat[0]) & (ranges.t > 20.0) & (ranges.t < 40.0)
    reason = np.where(ranges.elevation < 0.3, 3, np.where(ranges.sat == ranges.sat[1], 1, 0))
    e = judged(replace(ranges, pseudorange=ranges.pseudorange + 90.0 * late, reason=reason))
    assert e.points.ok.all()
    for row in e.satellites().to_dict()["rows"]:
        reasons = sum(row[name] for name in ("no_message", "unhealthy", "low", "weak", "implausible", "at_fault"))
        assert row["ranges"] == row["used"] + reasons, row
    data = e.to_dict()
    assert sum(data["status"].values()) == data["epochs"] == N
    assert sum(row["used"] for row in data["satellites"]) == int(e.points.n_used.sum())
    assert data["ranges_left_out"] == int(late.sum())


@pytest.mark.parametrize("scale", [1.0, 0.4, 3.0])
def test_residuals_in_their_sigmas_are_what_the_sigmas_are_off_by(drive, scale):
    """Statistical: the root of chi-square over 2400 degrees is 1 to 1.4 %, three times that allowed."""
    ranges, _ = drive
    e = judged(replace(ranges, sigma_range=ranges.sigma_range / scale), integrity=None)
    assert e.points.redundancy.sum() == 2400
    assert e.residual_size == pytest.approx(scale, rel=0.043)
    doubt = "times what their standard deviations say"
    assert (e.verdict.status, any(doubt in r for r in e.verdict.reasons)) == (
        ("doubtful", True) if scale > 2 else ("ok", False)
    )


def test_errors_turn_with_the_place_and_three_sigmas_hold(drive):
    """Statistical: of 600 components 99.73 % lie inside three sigmas, so 97 % at least."""
    ranges, r_e = drive
    e = judged(ranges, r_e)
    np.testing.assert_allclose(
        np.linalg.norm(e.errors_n, axis=1), np.linalg.norm(e.points.r_e - r_e, axis=1), rtol=1e-9
    )  # rounding: a turn keeps lengths
    numbers = e.error_numbers()
    assert np.all(np.asarray(numbers["inside_three_sigma_ned"]) > 0.97)
    assert numbers["beyond_hpl"] == 0
    up = judged(ranges, r_e - C_en(LLH) @ (0.0, 0.0, 50.0))
    assert up.error_numbers()["mean_ned_m"][2] - numbers["mean_ned_m"][2] == pytest.approx(50.0, abs=1e-2)  # curvature
    assert up.stanford("vertical").misleading.sum() == up.error_numbers()["beyond_vpl"] > 0
    assert judged(ranges).error_numbers() is None
    assert judged(ranges, np.full_like(r_e, np.nan)).stanford("horizontal") is None


def test_the_verdict_says_what_is_missing(drive):
    ranges, _ = drive
    rows = np.arange(len(ranges))
    first = rows - np.searchsorted(ranges.t, ranges.t)  # place of each range in its epoch

    def left(keep):
        return judged(replace(ranges, reason=np.where(keep, 0, 3)))

    assert judged(ranges).verdict.status == "ok"
    none = left(first < 3)
    assert none.verdict.status == "failed"
    assert none.verdict.causes[0] == "satellites below the mask: lower --elevation-mask"
    half = left((first < 3) | (ranges.t < 0.3 * N))
    assert half.verdict.status == "doubtful"
    assert "140 of 200 epochs have no position" in half.verdict.reasons[0]
    some = left((first < 3) | (ranges.t >= 20.0))
    assert some.verdict.status == "ok"
    assert "20 of 200 epochs have no position" in some.verdict.remarks[0]
    # as many satellites as unknowns: four of one system, five of two
    groups = np.array([len(np.unique(ranges.group[(ranges.t == t) & (first < 5)])) for t in np.unique(ranges.t)])
    bare = left(first < 3 + groups[np.searchsorted(np.unique(ranges.t), ranges.t)])
    assert bare.verdict.status == "doubtful"
    assert "could not be checked" in bare.verdict.reasons[0]
    assert bare.to_dict()["median_hpl_m"] is None
    alone = replace(
        ranges, reason=np.where(first < 3, 0, 1), pseudorange=np.where(first < 3, ranges.pseudorange, np.nan)
    )
    assert judged(alone).verdict.causes == ("satellites without a message: give more navigation files with --nav",)
    lost = replace(ranges, reason=np.where(ranges.sat >= 200, 1, 0))
    assert any("no messages of Galileo" in remark for remark in judged(lost).verdict.remarks)


def test_other_ranges_and_other_epochs_are_refused(drive):
    ranges, r_e = drive
    points = solve_points(ranges)
    with pytest.raises(InputError, match="expected the ranges that were solved"):
        PointEvaluation(points, ranges.where(ranges.t > 3.0))
    with pytest.raises(InputError, match=r"true_r_e: expected shape \(200, 3\)"):
        PointEvaluation(points, ranges, r_e[1:])
