"""A short drive with all that exchange formats hold: motion, attitude, IMU and fixes that agree with each other."""

import numpy as np

from schuler import frames, rotation
from schuler.recording import GnssSeries, ImuSeries, Metadata, Recording, Trajectory
from schuler.timebase import TimeBase

ORIGIN = np.array([0.84, 0.147, 300.0])
WEEK = 2300
G = 9.81


def drive(seconds: float = 20.0, rate: float = 50.0, scale: str = "gps", kind: str = "rate") -> Recording:
    """A car that rests for 4 s and then drives a widening curve uphill; pitch and roll are not zero.

    Positions are those of a plane tangent at :data:`ORIGIN`, exact in Earth-fixed axes; rates and forces neglect the
    Earth's rotation and curvature.
    """
    t0 = 345_600.0 + 0.125 if scale == "gps" else 12.5
    t = np.arange(int(seconds * rate)) / rate
    s = np.clip(t - 4.0, 0.0, None)
    speed, along = 0.4 * s, 0.4
    yaw = 0.5 + 0.02 * s**2
    moving = t > 4.0
    climb = 0.03
    r = np.zeros((len(t), 3))
    v = np.stack((speed * np.cos(yaw), speed * np.sin(yaw), -climb * speed), axis=1)
    fine = np.linspace(0.0, 1.0, 41)
    for k in range(1, len(t)):  # Simpson's rule over fine steps: the path of these velocities to rounding
        u = s[k - 1] + (s[k] - s[k - 1]) * fine
        w, psi = 0.4 * u, 0.5 + 0.02 * u**2
        f = np.stack((w * np.cos(psi), w * np.sin(psi), -climb * w), axis=1)
        weights = np.ones(41)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        r[k] = r[k - 1] + (u[1] - u[0]) / 3.0 * weights @ f
    turn = np.where(moving, 0.04 * s, 0.0)
    acc = np.stack(
        (along * np.cos(yaw) - speed * turn * np.sin(yaw), along * np.sin(yaw) + speed * turn * np.cos(yaw),
         np.full(len(t), -climb * along)), axis=1
    ) * moving[:, None]  # fmt: skip
    rpy = np.stack((np.full(len(t), 0.02), np.full(len(t), 0.03), yaw), axis=1)
    C_nb = rotation.dcm_from_rpy(rpy)
    f_b = np.einsum("nji,nj->ni", C_nb, acc - (0.0, 0.0, G))
    w_b = np.einsum("nji,nj->ni", C_nb, np.stack((0.0 * turn, 0.0 * turn, turn), axis=1))
    rng = np.random.default_rng(5)
    f_b += 1e-4 * rng.standard_normal(f_b.shape)
    w_b += 1e-5 * rng.standard_normal(w_b.shape)
    C_en = frames.C_en(ORIGIN)
    reference = Trajectory(t0 + t, frames.ecef_from_ned(r, ORIGIN), v @ C_en.T, rotation.quat_from_dcm(C_en @ C_nb))
    each = int(rate)
    fixes = reference.llh[::each]
    n = len(fixes)
    A = 0.1 * rng.standard_normal((n, 3, 3))
    gnss = GnssSeries(
        t0 + t[::each], fixes, A @ np.swapaxes(A, 1, 2) + 0.01 * np.eye(3), reference.v_eb_n[::each],
        np.tile(0.0025 * np.eye(3), (n, 1, 1)), np.full(n, 1), np.full(n, 14),
    )  # fmt: skip
    base = TimeBase("gps", WEEK * 604_800.0) if scale == "gps" else TimeBase("local")
    if kind == "increment":
        w_b, f_b = w_b / rate, f_b / rate
    imu = ImuSeries(t0 + t, w_b, f_b, kind)  # type: ignore[arg-type]
    return Recording(imu, gnss, None, reference, Metadata(name="a drive", time=base))


def same_trajectory(a: Trajectory, b: Trajectory, *, t: float, r: float, v: float, q: float) -> None:
    """Assert that two trajectories agree within tolerances: time [s], position [m], velocity [m/s], attitude [rad]."""
    np.testing.assert_allclose(a.t, b.t, rtol=0.0, atol=t)
    np.testing.assert_allclose(a.r_eb_e, b.r_eb_e, rtol=0.0, atol=r)
    if b.v_eb_e is not None:
        assert a.v_eb_e is not None
        np.testing.assert_allclose(a.v_eb_e, b.v_eb_e, rtol=0.0, atol=v)
    if b.q_eb is not None:
        assert a.q_eb is not None
        angle = 2.0 * np.arccos(np.clip(np.abs(np.einsum("ni,ni->n", a.q_eb, b.q_eb)), 0.0, 1.0))
        turn = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(a.q_eb), b.q_eb))
        assert np.linalg.norm(turn, axis=1).max() <= q, (angle.max(), q)
