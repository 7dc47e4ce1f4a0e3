"""Ideal rates of a long motion: made in parts, the same numbers."""

import tracemalloc

import numpy as np

from schuler.simulation import motion
from schuler.simulation.scenario import Scenario


def test_rates_in_parts_are_those_at_once(monkeypatch):
    """But for the rounding of a yaw that begins anew with each part; their memory is that of a part."""
    route = Scenario.load("examples/town.toml").motion.build()
    t = np.arange(0.0, 200.0, 0.01)
    once = motion.ideal_rates(route, t)
    peaks = []
    for rows in (len(t), 1000):
        monkeypatch.setattr(motion, "_RATES", rows)
        tracemalloc.start()
        parts = motion.ideal_rates(route, t)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    np.testing.assert_allclose(parts[0], once[0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(parts[1], once[1], rtol=0.0, atol=1e-11)
    assert peaks[1] < 0.4 * peaks[0]
