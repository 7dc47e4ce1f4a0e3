"""The same calibration without a filter: Gauss-Newton over all attitudes and parameters at once, in plain numpy.

Unknowns are the parameters and the attitude in the middle of every block at rest. Residuals, each over its sigma: what
was known before; the first heading; from block to block the rotation of the compensated readings, good to the noise of
the gyroscopes over that time; gravity in the axes of each attitude; Earth rate along the measured vertical.
"""

from dataclasses import dataclass

import numpy as np

from schuler import earth, frames, rotation
from schuler.calibration.field.blocks import rest_blocks
from schuler.calibration.result.parameters import imu_errors
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec

OMEGA = np.array([0.0, 0.0, earth.WGS84.omega_ie])


@dataclass(frozen=True)
class Batch:
    """One log, prepared: readings of each stretch between two blocks, padded to the longest."""

    names: tuple[str, ...]
    prior_sigma: np.ndarray
    f: np.ndarray
    omega: np.ndarray
    length: np.ndarray
    gap: np.ndarray
    dtheta: np.ndarray
    dv: np.ndarray
    dt: np.ndarray
    llh: np.ndarray
    heading: tuple[float, float]
    tilt_sigma: float
    spec: ImuSpec

    @classmethod
    def of(cls, imu: ImuSeries, rests, spec: ImuSpec, names, prior_sigma, llh, heading, tilt_sigma=0.1, block_s=1.0):
        blocks = rest_blocks(imu, rests, block_s)
        inc = imu.increments()
        n, limits = len(blocks), []
        for a, b in zip(blocks.t[:-1], blocks.t[1:], strict=True):
            # share of each increment that lies between the middles of two blocks
            begin, end = inc.t - inc.dt, inc.t
            share = np.clip((np.minimum(end, b) - np.maximum(begin, a)) / inc.dt, 0.0, 1.0)
            k = np.flatnonzero(share > 1e-6)
            limits.append((k, share[k]))
        most = max(len(k) for k, _ in limits)
        dtheta, dv, dt = np.zeros((n - 1, most, 3)), np.zeros((n - 1, most, 3)), np.zeros((n - 1, most))
        for i, (k, share) in enumerate(limits):
            dtheta[i, : len(k)] = share[:, None] * inc.dtheta_ib_b[k]
            dv[i, : len(k)] = share[:, None] * inc.dv_ib_b[k]
            dt[i, : len(k)] = share * inc.dt[k]
        return cls(
            names, np.asarray(prior_sigma), blocks.f, blocks.omega, blocks.length, np.diff(blocks.t), dtheta, dv, dt,
            np.asarray(llh), heading, tilt_sigma, spec,
        )  # fmt: skip

    def compensated(self, p, gyro, accel, dt=1.0):
        e = imu_errors(dict(zip(self.names, p, strict=True)))
        f = (accel - e.b_a * dt) @ np.linalg.inv(np.eye(3) + e.M_a).T
        return (gyro - e.b_g * dt - f @ e.G_g.T) @ np.linalg.inv(np.eye(3) + e.M_g).T, f

    def residuals(self, p, C):
        """Residuals by group; C are attitudes (n, 3, 3), body to Earth-fixed axes."""
        a, g = self.spec.accel.random_walk, self.spec.gyro.random_walk
        C_en = frames.C_en(self.llh)
        w, f = self.compensated(p, self.omega, self.f)
        # specific force against gravity
        force = (np.einsum("nij,nj->ni", C, f) + C_en @ earth.gravity_ned(self.llh[0], self.llh[2])) @ C_en
        gravity = force / (a / np.sqrt(self.length))[:, None]
        up = f / np.linalg.norm(f, axis=1, keepdims=True)
        rate = np.sum(up * w, axis=1) - OMEGA[2] * np.sin(self.llh[0])
        vertical = rate / (g / np.sqrt(self.length))
        # rotation from block to block
        theta, _ = self.compensated(p, self.dtheta, self.dv, self.dt[:, :, None])
        turn = np.tile(np.eye(3), (len(theta), 1, 1))
        steps = rotation.dcm_from_rotvec(theta.reshape(-1, 3)).reshape(*theta.shape, 3)
        for k in range(theta.shape[1]):
            turn = turn @ steps[:, k]
        earth_turn = rotation.dcm_from_rotvec(-OMEGA * self.gap[:, None])
        predicted = earth_turn @ C[:-1] @ turn
        slip = rotation.rotvec_from_dcm(np.swapaxes(predicted, 1, 2) @ C[1:]) / (g * np.sqrt(self.gap))[:, None]
        start = rotation.dcm_from_rpy(self.rpy_0(np.zeros(len(p))))
        off = rotation.rotvec_from_dcm(C_en.T @ C[0] @ start.T) / [self.tilt_sigma, self.tilt_sigma, self.heading[1]]
        return [p / self.prior_sigma, off, gravity, vertical, slip]

    def rpy_0(self, p):
        f = self.compensated(p, self.omega[0], self.f[0])[1]
        return np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), self.heading[0]])

    def first_attitudes(self, p):
        C = [frames.C_en(self.llh) @ rotation.dcm_from_rpy(self.rpy_0(p))]
        theta, _ = self.compensated(p, self.dtheta, self.dv, self.dt[:, :, None])
        for k, gap in enumerate(self.gap):
            turn = np.eye(3)
            for step in rotation.dcm_from_rotvec(theta[k]):
                turn = turn @ step
            C.append(rotation.dcm_from_rotvec(-OMEGA * gap) @ C[-1] @ turn)
        return np.array(C)

    def solve(self, start=None, iterations=12):
        """Parameters, their covariance, and the sum of squared residuals."""
        m, n = len(self.names), len(self.length)
        p = np.zeros(m) if start is None else start.copy()
        C = self.first_attitudes(p)
        # parameters are stepped by a thousandth of what is known of them, attitudes by a microradian
        for _ in range(iterations):
            r = np.concatenate([x.ravel() for x in self.residuals(p, C)])
            J = np.zeros((len(r), m + 3 * n))
            for k in range(m):
                d = np.zeros(m)
                d[k] = 1e-3 * self.prior_sigma[k]
                J[:, k] = (self._flat(p + d, C) - self._flat(p - d, C)) / (2.0 * d[k])
            places = self._places(r)
            for axis in range(3):
                for colour in range(3):  # a residual sees at most two neighbouring attitudes
                    d = np.zeros((n, 3))
                    d[colour::3, axis] = 1e-6
                    change = (
                        self._flat(p, rotation.dcm_from_rotvec(d) @ C) - self._flat(p, rotation.dcm_from_rotvec(-d) @ C)
                    ) / 2e-6
                    for k in range(colour, n, 3):
                        J[places[k], m + 3 * k + axis] = change[places[k]]
            scale = 1.0 / np.linalg.norm(J, axis=0)
            N = (J * scale).T @ (J * scale)
            x = -scale * np.linalg.solve(N, (J * scale).T @ r)
            p, C = p + x[:m], rotation.dcm_from_rotvec(x[m:].reshape(n, 3)) @ C
            if np.max(np.abs(x[:m]) / self.prior_sigma) < 1e-7:
                break
        cov = (np.linalg.inv(N) * np.outer(scale, scale))[:m, :m]
        return p, cov, float(np.sum(self._flat(p, C) ** 2))

    def _flat(self, p, C):
        return np.concatenate([x.ravel() for x in self.residuals(p, C)])

    def _places(self, r):
        """Residuals that see each attitude."""
        n, m = len(self.length), len(self.names)
        gravity, slip = m + 3, m + 3 + 3 * n + n
        places = []
        for k in range(n):
            own = [*range(gravity + 3 * k, gravity + 3 * k + 3)]
            for j in (k - 1, k):
                if 0 <= j < n - 1:
                    own += range(slip + 3 * j, slip + 3 * j + 3)
            places.append(np.array(own + (list(range(m, m + 3)) if k == 0 else [])))
        return places
