"""Stanford diagram: classes by hand, errors in local axes, figure, refusals, and levels of a simulation."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss import Integrity, RangeErrors, nominal_orbits, solve_points, stanford, synthetic_ranges
from schuler.gnss.protection_errors import Stanford

HAND = Stanford(
    np.arange(6.0),
    np.array([1.0, 1.0, 12.0, 60.0, 70.0, 5.0]),
    np.array([5.0, 50.0, 10.0, 30.0, 55.0, np.inf]),
    40.0,
    "horizontal",
)


@pytest.fixture(scope="module")
def drive():
    """An hour at rest, GPS alone, every 5 s, one satellite in five epochs wrong by 10 to 100 m."""
    t = 5.0 * np.arange(720)
    r = np.broadcast_to(frames.ecef_from_llh(np.array([0.8, 0.2, 100.0])), (len(t), 3))
    errors = RangeErrors(noise=2.0, rate_noise=0.1, multipath=0.0, atmosphere=0.0)
    rng = np.random.default_rng(8)
    s = synthetic_ranges(t, r, np.zeros_like(r), nominal_orbits("G"), rng, errors)
    rows = np.array([rng.choice(np.flatnonzero(s.epoch == k)) for k in range(0, len(t), 5)])
    rho = s.ranges.pseudorange.copy()
    rho[rows] += rng.uniform(10.0, 100.0, len(rows))
    return replace(s.ranges, pseudorange=rho), r


def test_classes_by_hand():
    assert HAND.available.tolist() == [True, False, True, True, False, False]
    assert HAND.misleading.tolist() == [False, False, True, True, True, False]
    assert HAND.hazardous.tolist() == [False, False, False, True, False, False]
    assert "50.00 % of 6 epochs (3 beyond)" in HAND.summary()
    assert "hazardous 1" in HAND.summary()


def test_errors_are_those_of_local_axes(drive):
    ranges, r = drive
    points = solve_points(ranges)
    C = frames.C_en(frames.llh_from_ecef(r[0]))
    true = points.r_e - np.array([3.0, -4.0, 12.0]) @ C.T
    across, up = (stanford(points, true, alert_limit=40.0, direction=d) for d in ("horizontal", "vertical"))
    assert across.error == pytest.approx(5.0, abs=1e-3)  # axes of the truth, 13 m away: 1e-6 rad
    assert up.error == pytest.approx(12.0, abs=1e-3)
    assert np.array_equal(across.level, points.hpl[points.ok])
    assert np.array_equal(up.level, points.vpl[points.ok])


@pytest.mark.parametrize("risk", [1e-2, 1e-4])
def test_simulated_errors_stay_within_their_levels(drive, risk):
    """At most the stated share and four standard errors of it: faults of all sizes, one satellite at a time."""
    ranges, r = drive
    points = solve_points(ranges, integrity=Integrity(missed_detection=risk))
    assert points.ok.mean() > 0.97
    for direction in ("horizontal", "vertical"):
        diagram = stanford(points, r, alert_limit=40.0, direction=direction)
        n = len(diagram.t)
        assert diagram.misleading.mean() <= risk + 4.0 * np.sqrt(risk * (1.0 - risk) / n)
        assert np.median(diagram.level) < 100.0  # they say something: seen 67 m for the smaller risk


def test_a_truth_that_is_missing_is_passed_over(drive):
    ranges, r = drive
    points = solve_points(ranges)
    some = r.copy()
    some[::2] = np.nan
    assert len(stanford(points, some, alert_limit=40.0).t) == int(points.ok[1::2].sum())


def test_the_figure_shows_every_epoch():
    figure = HAND.figure()
    drawn = [item for item in figure.panels[0].items if type(item).__name__ == "Markers"]
    assert sum(len(item.x) for item in drawn) == 6
    assert all(np.isfinite(item.y).all() for item in drawn)
    assert figure.panels[0].equal
    HAND.plot().draw_without_rendering()


def test_inputs_are_checked(drive):
    ranges, r = drive
    points = solve_points(ranges)
    with pytest.raises(InputError, match="shape \\(720, 3\\)"):
        stanford(points, r[:5], alert_limit=40.0)
    with pytest.raises(InputError, match="positive number of metres"):
        stanford(points, r, alert_limit=0.0)
    with pytest.raises(InputError, match="horizontal or vertical"):
        stanford(points, r, alert_limit=40.0, direction="north")
    with pytest.raises(InputError, match="times of both"):
        stanford(points, np.full_like(r, np.nan), alert_limit=40.0)
