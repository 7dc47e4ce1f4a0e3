"""What a solution of single points draws: positions about their mean, sigmas, satellites."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.point import solve_points
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.units import DEG

NOISY = RangeErrors(noise=2.0, rate_noise=0.05, multipath=0.0, atmosphere=0.0, offsets=(50.0,))
LLH = np.array([48.7 * DEG, 9.1 * DEG, 300.0])


@pytest.fixture(scope="module")
def points():
    """A receiver at rest for five minutes; in three epochs there are too few satellites."""
    t = np.arange(300.0)
    r = np.tile(frames.ecef_from_llh(LLH), (300, 1))
    most = np.full(300, 12)
    most[5:8] = 3
    rng = np.random.default_rng(5)
    s = synthetic_ranges(t, r, np.zeros_like(r), nominal_orbits("GE"), rng, NOISY, max_satellites=most)
    return solve_points(s.ranges)


def test_the_scatter_is_drawn_in_metres_with_what_the_ranges_claim(points):
    plan, sigma, used = points.figure().panels
    east, north = (np.concatenate([getattr(item, c) for item in plan.items]) for c in "xy")
    assert plan.equal
    assert len(east) == 297
    np.testing.assert_allclose((east.mean(), north.mean()), 0.0, rtol=0, atol=1e-4)  # the plane is not the Earth
    error = frames.ned_from_ecef(points.r_e[points.ok], LLH)
    np.testing.assert_allclose((north.std(), east.std()), error[:, :2].std(axis=0), rtol=1e-6)
    horizontal, vertical = (item.y[np.isfinite(item.y)] for item in sigma.items)
    claimed, scatter = np.sqrt(np.mean(horizontal**2)), np.sqrt(np.mean(east**2 + north**2))
    assert claimed == pytest.approx(scatter, rel=4.0 / np.sqrt(2.0 * 297))  # four standard errors of the scatter
    assert np.sqrt(np.mean(vertical**2)) == pytest.approx(error[:, 2].std(), rel=4.0 / np.sqrt(2.0 * 297))
    np.testing.assert_array_equal(used.items[0].y[[4, 5, 8]], points.n_used[[4, 5, 8]])


def test_a_solution_shows_itself_where_there_is_a_position(points):
    assert points._repr_html_().count('src="data:image/png') == 1
    none = replace(points, status=np.full(300, 2))
    with pytest.raises(InputError, match=r"expected an epoch with a position to draw: 0 of 300 epochs"):
        none.plot()
    assert "<img" not in none._repr_html_()
