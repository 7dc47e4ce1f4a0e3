"""Displacements by velocities against those by positions."""

import numpy as np

from schuler.diagnosis.positions import Displacements


def test_a_matrix_without_gain_leads_nothing():
    """On a straight way the fitted matrix may have no gain across it, whichever of the two is taken to be noisy."""
    rng = np.random.default_rng(3)
    r = np.zeros((40, 3))
    r[:, 0] = rng.uniform(5.0, 15.0, 40)
    pairs = Displacements(r + 0.01 * rng.standard_normal(r.shape), r)
    assert pairs.lead(np.diag((1.0, 0.0)), np.eye(2)) == -np.inf
