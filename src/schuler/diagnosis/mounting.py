"""Rough mount angles beside the axes found, and the lever arm to the antenna."""

from __future__ import annotations

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.diagnosis.axes_evidence import AxesEvidence
from schuler.diagnosis.findings import Finding, Severity
from schuler.diagnosis.work import Work


def find_mounting(work: Work, ev: AxesEvidence, A: FloatArray) -> None:
    """Mount angles left over from the nearest permutation, and the lever arm.

    Parameters
    ----------
    work : Work
        Is added to.
    ev : AxesEvidence
    A : ndarray, shape (3, 3)
        The permutation found.
    """
    B = ev.B / np.maximum(np.linalg.norm(ev.B, axis=0), 1e-12)
    weight = 1.0 / np.maximum(ev.sigma, 0.02)
    # nearest rotation R of sensor axes put right: B = A^T-permuted
    U, _, Vt = np.linalg.svd((A.T @ B) * weight)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    angles = np.array(rotation.rpy_from_dcm(R.T)) / units.DEG
    sigma = np.array([ev.sigma[2], ev.sigma[0] + 0.02, ev.sigma[1]]) / units.DEG
    work.estimates["mount_deg"] = angles.tolist()
    work.estimates["mount_sigma_deg"] = sigma.tolist()
    if np.abs(angles).max() > 3.0:
        text = (
            f"beside its axes the sensor is mounted turned by roll {angles[0]:.1f}, pitch {angles[1]:.1f}, yaw "
            f"{angles[2]:.1f} deg (1-sigma about {sigma.max():.1f} deg; a level road is assumed)"
        )
        severity: Severity = "warning" if np.abs(angles).max() > 20.0 else "note"
        found = Finding(
            "mount", severity, text, 0.8, "mount angles in the configuration", {"angles_deg": angles.tolist()}
        )
        work.findings.append(found)
    if np.all(np.isfinite(ev.arm)) and np.all(np.abs(ev.arm) < 20.0):
        work.estimates["lever_arm_m"] = ev.arm.tolist()
        work.estimates["lever_arm_sigma_m"] = ev.arm_sigma.tolist()
        if np.any(np.abs(ev.arm) > 3.0 * ev.arm_sigma) and np.abs(ev.arm).max() > 0.5:
            text = (
                f"the antenna is roughly {ev.arm[0]:+.1f} m forward and {ev.arm[1]:+.1f} m right of the IMU (1-sigma "
                f"{ev.arm_sigma[0]:.1f}, {ev.arm_sigma[1]:.1f} m), by what turning adds to specific force"
            )
            evidence = {"arm_m": ev.arm.tolist(), "sigma_m": ev.arm_sigma.tolist()}
            work.findings.append(Finding("lever_arm", "note", text, 0.6, "lever arm in the configuration", evidence))
