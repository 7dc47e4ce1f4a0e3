"""Mechanization of a rotating IMU, by two routes that give the same answers.

*Sensor*: the IMU's own axes are navigated as any strapdown's, ``C_es``, and the body's attitude is ``C_es C_sb``. The
platform's angle is needed only where an attitude of the body is wanted, its rate never. *Body*: the increments are
first turned into body axes with the encoder's angle and relieved of the platform's own rate, Du's way::

    f_ib_b = C_bs f_is_s,    omega_ib_b = C_bs omega_is_s - omega_bs_b

Both navigate the point where the accelerometers are; the lever arm to the point where the platform's axes meet is taken
off at the end, so that an IMU off the axis costs nothing if its offset is known.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler import earth, rotation
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import Frame, NavState, mechanize
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory
from schuler.rotary import gimbals
from schuler.rotary.encoder import Platform

Route = Literal["sensor", "body"]
_NO_OFFSET = (0.0, 0.0, 0.0)
_NODES = 3  # of Gauss's quadrature within an interval


def mechanize_rotating(
    increments: Increments,
    initial: NavState,
    platform: Platform,
    *,
    route: Route = "sensor",
    offset_m: ArrayLike = _NO_OFFSET,
    rate_platform: Platform | None = None,
    frame: Frame = "ecef",
    earth_rotation: bool = True,
) -> FullTrajectory:
    """Position, velocity and attitude of the body from the increments of an IMU that turns in it.

    Parameters
    ----------
    increments : Increments
        In the axes of the IMU.
    initial : NavState
        State of the body (the point where the platform's axes meet), at the start of the first interval.
    platform : Platform
        A :class:`~schuler.rotary.schedule.Schedule` or :class:`~schuler.rotary.encoder.EncoderReadings`.
    route : {"sensor", "body"}
        See the module.
    offset_m : array_like, shape (3,)
        From that point to the accelerometers, IMU axes. [m]
    rate_platform : Platform, optional
        For the body route: whose rates are taken off instead of the differences of ``platform``'s angles, e.g. the
        commanded schedule beside measured angles.
    frame, earth_rotation
        See :func:`schuler.mechanization.strapdown.mechanize`.

    Returns
    -------
    FullTrajectory
        Trajectory of the body, one state for each interval's end.

    Raises
    ------
    InputError
        If the route is unknown, the log holds fewer than three intervals, or the platform's readings do not cover it.

    Notes
    -----
    The routes differ by their discretisation only. That of the sensor route is the strapdown's in turning axes, third
    order in the interval where two axes turn at once; the body route, whose axes follow the vehicle, adds the
    quadrature of turned increments over a parabola through three of them, fourth order.

    References
    ----------
    Du (2015), eqs. (2.3)-(2.5) and figure 2.2; the sensor route is not in it.
    """
    if route not in ("sensor", "body"):
        raise InputError(f"route: expected 'sensor' or 'body', got {route!r}")
    lever = as_vector3(offset_m, "offset_m")
    omega_is_s = rates_at_limits(increments)
    start_s = sensor_start(initial, platform, lever, omega_is_s[0], earth_rotation=earth_rotation)
    if route == "sensor":
        solved = mechanize(increments, start_s, frame=frame, earth_rotation=earth_rotation)
    else:
        in_body = body_increments(increments, platform, rate_platform=rate_platform)
        start = NavState(initial.t, start_s.r_eb_e, start_s.v_eb_e, initial.q_eb)
        carried = mechanize(in_body, start, frame=frame, earth_rotation=earth_rotation)
        q_bs = rotation.quat_from_dcm(_attitude(platform, carried.t))
        solved = FullTrajectory(carried.t, carried.r_eb_e, carried.v_eb_e, rotation.quat_multiply(carried.q_eb, q_bs))
    return body_trajectory(solved, platform, lever, omega_is_s[1:], earth_rotation=earth_rotation)


def sensor_start(
    body: NavState,
    platform: Platform,
    offset_m: ArrayLike = _NO_OFFSET,
    omega_is_s: ArrayLike | None = None,
    *,
    earth_rotation: bool = True,
) -> NavState:
    """State of the IMU in its own axes from that of the body: the start of a filter or of the sensor route.

    Parameters
    ----------
    body : NavState
    platform : Platform
    offset_m : array_like, shape (3,)
        From the point where the axes meet to the IMU, IMU axes. [m]
    omega_is_s : array_like, shape (3,), optional
        Gyroscope reading at that time; without it, the platform's rate, for a body at rest. [rad/s]
    earth_rotation : bool
        As in the mechanization.
    """
    lever, t = as_vector3(offset_m, "offset_m"), np.array([body.t])
    C_bs = _attitude(platform, t)[0]
    C_es = rotation.dcm_from_quat(body.q_eb) @ C_bs
    if omega_is_s is None:
        omega_es_s = gimbals.omega_bs_s(platform.axes, platform.angles(t), platform.rates(t), platform.C_mount)[0]
    else:
        omega_es_s = as_vector3(omega_is_s, "omega_is_s") - C_es.T @ _earth(earth_rotation)
    return NavState(
        body.t,
        body.r_eb_e + C_es @ lever,
        body.v_eb_e + C_es @ np.cross(omega_es_s, lever),
        rotation.quat_multiply(body.q_eb, rotation.quat_from_dcm(C_bs)),
    )


def body_trajectory(
    sensor: FullTrajectory,
    platform: Platform,
    offset_m: ArrayLike = _NO_OFFSET,
    omega_is_s: ArrayLike | None = None,
    *,
    earth_rotation: bool = True,
) -> FullTrajectory:
    """FullTrajectory of the body from that of the IMU in its own axes, e.g. the output of a filter.

    Parameters
    ----------
    sensor : FullTrajectory
        With attitude ``q_es``.
    platform : Platform
    offset_m : array_like, shape (3,)
        From the point where the axes meet to the IMU, IMU axes. [m]
    omega_is_s : array_like, shape (n, 3), optional
        Gyroscope readings at the trajectory's times; needed for the velocity where there is an offset. [rad/s]
    earth_rotation : bool
        As in the mechanization.

    Returns
    -------
    FullTrajectory
        ``C_eb = C_es C_sb``, ``r_b = r - C_es l``, ``v_b = v - C_es (omega_es x l)``.

    Raises
    ------
    InputError
        If there is an offset, and no rates.
    """
    q_bs = rotation.quat_from_dcm(_attitude(platform, sensor.t))
    q_eb = rotation.quat_multiply(sensor.q_eb, rotation.quat_conjugate(q_bs))
    lever = as_vector3(offset_m, "offset_m")
    if not lever.any():
        return FullTrajectory(sensor.t, sensor.r_eb_e, sensor.v_eb_e, q_eb)
    if omega_is_s is None:
        raise InputError("an offset moves the velocity with the rate: pass omega_is_s, e.g. of rates_at_limits")
    r = sensor.r_eb_e - rotation.rotate(sensor.q_eb, lever)
    q_se = rotation.quat_conjugate(sensor.q_eb)
    omega_es_s = np.asarray(omega_is_s, dtype=np.float64) - rotation.rotate(q_se, _earth(earth_rotation))
    v = sensor.v_eb_e - rotation.rotate(sensor.q_eb, np.cross(omega_es_s, lever))
    return FullTrajectory(sensor.t, r, v, q_eb)


def body_increments(increments: Increments, platform: Platform, *, rate_platform: Platform | None = None) -> Increments:
    """Increments of a rotating IMU in body axes, without the platform's rotation.

    Parameters
    ----------
    increments : Increments
        IMU axes.
    platform : Platform
        Angles; also rates, as the differences of angles.
    rate_platform : Platform, optional
        Rates instead.

    Returns
    -------
    Increments
        Integrals of ``C_bs omega_is_s - omega_bs_b`` and of ``C_bs f_is_s``. [rad], [m/s]

    Raises
    ------
    InputError
        If there are fewer than three intervals.

    Notes
    -----
    Within an interval the output is taken as the parabola whose integrals over it and its two neighbours are the
    increments; it is turned at three Gauss nodes. What is left out is of fifth order in the interval.

    References
    ----------
    Du (2015), eq. (2.4), whose ``omega_sb_b = -rate u`` this is; there sample by sample.
    """
    x, w = np.polynomial.legendre.leggauss(_NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    t0, h = increments.t - increments.dt, increments.dt
    both = np.concatenate((increments.dtheta_ib_b, increments.dv_ib_b), axis=1)
    turned = np.zeros((len(h), 6))
    swept, taken = np.zeros((len(h), 3)), np.zeros((len(h), len(platform.axes)))
    source = rate_platform or platform
    for node, weight in zip(x, w, strict=True):
        t = t0 + node * h
        inside = _density(increments, both, node)
        angles, rates = platform.angles(t), source.rates(t)
        C_bs = gimbals.C_bs(platform.axes, angles, platform.C_mount)
        for k in (0, 3):
            turned[:, k : k + 3] += weight * np.einsum("nij,nj->ni", C_bs, inside[:, k : k + 3])
        swept += (weight * h)[:, None] * np.einsum("nij,nj->ni", C_bs, _rate(platform, angles, rates))
        taken += (weight * h)[:, None] * rates
    if rate_platform is None:
        # rates of readings jump from one to the next: what the nodes missed of the angle, about each axis
        missed = platform.angles(increments.t) - platform.angles(t0) - taken
        middle = platform.angles(t0 + 0.5 * h)
        C_bs = gimbals.C_bs(platform.axes, middle, platform.C_mount)
        swept += np.einsum("nij,nj->ni", C_bs, _rate(platform, middle, missed))
    return Increments(increments.t, h, turned[:, :3] - swept, turned[:, 3:])


def rates_at_limits(increments: Increments) -> FloatArray:
    """Angular rate at the start of the log and at each interval's end, of parabolas of the summed increments.

    Returns
    -------
    ndarray, shape (n + 1, 3)
        [rad/s]
    """
    if len(increments) < 3:
        raise InputError(f"expected at least three intervals of the IMU, got {len(increments)}")
    mean = increments.dtheta_ib_b / increments.dt[:, None]
    before, after, h0, h1 = mean[:-1], mean[1:], increments.dt[:-1, None], increments.dt[1:, None]
    inner = (h1 * before + h0 * after) / (h0 + h1)
    first, last = 2.0 * mean[0] - inner[0], 2.0 * mean[-1] - inner[-1]
    return np.concatenate((first[None], inner, last[None]))


def _density(increments: Increments, both: FloatArray, node: float) -> FloatArray:
    """Output at a place within each interval, times the interval: a parabola with the right three integrals."""
    n, h = len(increments), increments.dt
    if n < 3:
        raise InputError(f"expected at least three intervals of the IMU, got {n}")
    # three neighbours: the one before, itself, the one after; at the ends the first and the last three
    k = np.clip(np.arange(n), 1, n - 2)
    h0, h1, h2 = h[k - 1, None], h[k, None], h[k + 1, None]
    m0, m1, m2 = both[k - 1] / h0, both[k] / h1, both[k + 1] / h2
    d01, d12 = (m1 - m0) / (h0 + h1), (m2 - m1) / (h1 + h2)
    second = (d12 - d01) / (h0 + h1 + h2)
    # derivative of Newton's cubic through the summed integrals, at x from the start of the first of the three
    at = np.arange(n) - k
    origin = np.where(at < 0, 0.0, np.where(at == 0, h[k - 1], h[k - 1] + h[k]))
    s = (origin + node * h)[:, None]
    density = m0 + d01 * (2.0 * s - h0) + second * ((s - h0) * (s - h0 - h1) + s * (s - h0 - h1) + s * (s - h0))
    return density * h[:, None]


def _attitude(platform: Platform, t: FloatArray) -> FloatArray:
    return gimbals.C_bs(platform.axes, platform.angles(t), platform.C_mount)


def _rate(platform: Platform, angles: FloatArray, rates: FloatArray) -> FloatArray:
    return gimbals.omega_bs_s(platform.axes, angles, rates, platform.C_mount)


def _earth(earth_rotation: bool) -> FloatArray:
    return np.array([0.0, 0.0, earth.WGS84.omega_ie if earth_rotation else 0.0])
