"""Displacements by velocities against those by positions."""

import tracemalloc

import numpy as np

from schuler.diagnosis.positions import Displacements, displacements


def test_a_matrix_without_gain_leads_nothing():
    """On a straight way the fitted matrix may have no gain across it, whichever of the two is taken to be noisy."""
    rng = np.random.default_rng(3)
    r = np.zeros((40, 3))
    r[:, 0] = rng.uniform(5.0, 15.0, 40)
    pairs = Displacements(r + 0.01 * rng.standard_normal(r.shape), r)
    assert pairs.lead(np.diag((1.0, 0.0)), np.eye(2)) == -np.inf


def test_a_pause_of_years_costs_no_memory_and_no_displacement():
    """The same log with a pause of 20 s and of two years, both whole stretches of 4 s."""
    rng = np.random.default_rng(5)
    t = 0.5 * np.arange(400)
    v = 10.0 + np.cumsum(rng.normal(0.0, 0.1, (400, 3)), axis=0)
    pairs = []
    for pause in (20.0, 6.4e7):
        late = np.where(t < 100.0, t, t + pause)
        tracemalloc.start()
        pairs.append(displacements(late, v, late, v + 0.01))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 1e7  # of 16 million stretches: 128 MB a column
    assert len(pairs[0].d) > 40
    np.testing.assert_allclose(pairs[1].d, pairs[0].d, atol=1e-5)  # rounding: 1e9 m are summed up in the pause
