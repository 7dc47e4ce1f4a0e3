"""Calibrations for the tests of results, files, comparison and reports: made up, with full covariance."""

import numpy as np

from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult, Residuals

#: A size for each family that a cheap IMU may have. SI
SIZE = {"b_a": 0.1, "M_a": 0.01, "b_g": 0.01, "M_g": 0.01, "G_g": 1e-4}


def calibration(seed=1, gauge="full", names=LINEAR, sigma=0.01, **rest):
    """Errors of usual size; uncertainty ``sigma`` times the size, correlated."""
    rng = np.random.default_rng(seed)
    size = np.array([SIZE[n[:3]] for n in names])
    A = rng.standard_normal((len(names), 3 * len(names)))
    C = np.cov(A)
    C /= np.sqrt(np.outer(np.diag(C), np.diag(C)))
    values = size * rng.standard_normal(len(names))
    return CalibrationResult("multiposition", tuple(names), values, C * np.outer(size, size) * sigma**2, gauge, **rest)


def directions(n, seed=2, reach=1.0):
    """Unit vectors; ``reach`` 1 all over the sphere, less flattens them towards the x-y plane."""
    v = np.random.default_rng(seed).standard_normal((n, 3)) * [1.0, 1.0, reach]
    return v / np.linalg.norm(v, axis=1)[:, None]


def residuals(n=24, seed=3, sigma=2e-3, reach=1.0):
    rng = np.random.default_rng(seed)
    return Residuals(
        tuple(f"pose {i + 1} ({10.0 * i:.1f}..{10.0 * i + 5.0:.1f} s)" for i in range(n)),
        sigma * rng.standard_normal(n), np.full(n, sigma), "m/s^2", 0.1 * rng.standard_normal(n),
        directions(n, seed, reach),
    )  # fmt: skip


def full(seed=1, **rest):
    """Everything a result can have."""
    rng = np.random.default_rng(seed + 100)
    gyro = Residuals(("turn 1", "turn 2"), np.array([1e-3, -2e-3]), np.array([1.5e-3, 1.5e-3]), "rad")
    options = {
        "residuals": {"accel": residuals(), "gyro": gyro}, "status": "warning", "condition": 12.25,
        "verdicts": ('M_g_zz: "turn" about z <1 rev>, 100 % of it: go on',), "variance_of_unit_weight": 1.05,
        "freedom": 50,
        "prior_sigma": dict.fromkeys(LINEAR[:5], 0.05), "temperature": 24.1,
        "next_pose": "Put x down, tilted by 30 degrees.",
        "history": rng.standard_normal((3, len(LINEAR))), "fixed": {"delay": 1.25e-3},
        "extra": {"table": [[1.0, 2.5], [3.0, 4.0]], "name": "a: b", "nothing": None, "yes": True},
        "provenance": {"schuler": "0.1", "method": "multiposition", "options": {"g": 9.81, "loss": "huber"},
                       "files": ["a.csv"]},
    }  # fmt: skip
    return calibration(seed, **(options | rest))
