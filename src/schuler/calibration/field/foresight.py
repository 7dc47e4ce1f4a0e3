"""How certain the parameters are after turns and rests, made or only planned: the filter's covariance without a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.heading import FREE
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.schedule import FREE_ACCEL, BlockNoise, rest_schedule
from schuler.calibration.field.setup import field_layout
from schuler.calibration.field.standstill import as_much_wander, at_standstill
from schuler.calibration.field.steps import Rest, Step, Turn
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, InitialState, run, unpack_symmetric
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import Increments

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

#: Part of a rest that the search for rests does not use, both ends together. [s]
LOST_S = 0.2
#: Longest step, longest block of readings, and spacing of the filter's propagations. [s]
_STEP_S, _BLOCK_S, _PROPAGATE_S = 0.25, 2.5, 1.0
_TILT = 0.1  # 1-sigma of the first levelling, as in the calibration [rad]


@dataclass(frozen=True)
class Standing:
    """What is known at some time of a calibration.

    Attributes
    ----------
    C_nb : ndarray, shape (3, 3)
        Attitude.
    P : ndarray, shape (n, n)
        Covariance of all states of the layout, navigation errors north, east, down.
    prior_sigma : ndarray, shape (p,)
        1-sigma of the parameters before the log.
    layout : StateLayout
    llh : ndarray, shape (3,)
        [rad, rad, m]
    noise : BlockNoise
    gyro_psd : ndarray, shape (3,)
        [rad^2/s]
    options : FieldOptions
    gravity : float
        0 for that of the ellipsoid. [m/s^2]
    secondary_from : float
        From when on the gravity vector is used, counted from now. [s]
    """

    C_nb: FloatArray
    P: FloatArray
    prior_sigma: FloatArray
    layout: StateLayout
    llh: FloatArray
    noise: BlockNoise
    gyro_psd: FloatArray
    options: FieldOptions
    gravity: float = 0.0
    secondary_from: float = 0.0

    @property
    def share(self) -> FloatArray:
        """1-sigma of each parameter over that before the log. Shape (p,)."""
        return _share(self.P, self.prior_sigma)


@dataclass(frozen=True)
class Ahead:
    """What a sequence of steps leads to.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Counted from now; the end comes last. [s]
    share : ndarray, shape (k, p)
        1-sigma of each parameter over that before the log, then.
    standing : Standing
        At the end.
    """

    t: FloatArray
    share: FloatArray
    standing: Standing


def standing_before(
    spec: ImuSpec,
    *,
    latitude: float,
    height: float = 0.0,
    gravity: float | None = None,
    heading_sigma: float = FREE,
    options: FieldOptions | None = None,
    layout: StateLayout | None = None,
) -> Standing:
    """What is known before there is a log: the specification, and that the sensor lies level to 0.1 rad.

    Parameters
    ----------
    spec : ImuSpec
    latitude, height : float
        [rad], [m]
    gravity : float, optional
        As of :func:`schuler.calibration.field.calibration.calibrate_field`. [m/s^2]
    heading_sigma : float
        [rad]
    options : FieldOptions, optional
    layout : StateLayout, optional
        In place of the specification's.

    Raises
    ------
    InputError
        If the specification has no noise or nothing to calibrate.
    """
    options = options or FieldOptions()
    layout = layout or field_layout(spec, options)
    if not (spec.accel.random_walk > 0.0 and spec.gyro.random_walk > 0.0):
        raise InputError(f"the specification {spec.name} has no noise: give the random walks of both triads")
    prior = np.sqrt(layout.initial_variances())
    P = np.diag(np.concatenate(([_TILT, _TILT, heading_sigma], np.full(3, 0.1), np.ones(3), prior)) ** 2)
    noise = BlockNoise(np.full(3, spec.accel.random_walk), np.full(3, spec.gyro.random_walk))
    return Standing(
        np.eye(3), P, prior, layout, np.array([latitude, 0.0, height]), noise, np.full(3, spec.gyro.random_walk**2),
        options, 0.0 if gravity is None else gravity, options.secondary_from_s,
    )  # fmt: skip


def foresee(now: Standing, steps: Sequence[Step], every_s: float | None = None) -> Ahead:
    """Run the filter over turns and rests.

    Parameters
    ----------
    now : Standing
    steps : sequence of Turn and Rest
        At least one rest; turns about axes of the body as it stands then, uniform, in place.
    every_s : float, optional
        Spacing of what is returned, to half a second; None: the end only. [s]

    Returns
    -------
    Ahead

    Notes
    -----
    The readings are those of perfect sensors, so that no innovation moves an estimate and everything is linearised at
    one point. The filter of a real log is not: its estimates wander while little is known, columns of H with them, and
    it believes to tell apart what it cannot (at automotive grade 54 % of an accelerometer bias are left after one rest
    on a level that is known to 0.1 rad, where 90 % are). When everything has been seen both agree.
    """
    options = now.options
    nav = NavState.from_geodetic(0.0, now.llh, np.zeros(3), rotation.rpy_from_dcm(now.C_nb))
    increments, blocks, C = _readings(now, nav, steps)
    total, layout = float(increments.t[-1]), now.layout
    form = "vector" if options.earth_rate == "auto" else options.earth_rate
    if form == "vector":
        whole, begin, end = increments, blocks.t - 0.5 * blocks.length, blocks.t + 0.5 * blocks.length
        rests = [blocks.rest == k for k in range(blocks.rest[-1] + 1)]
        spans = np.array([(begin[r].min(), end[r].max()) for r in rests])
        increments, blocks = at_standstill(whole, blocks, spans)
        layout = as_much_wander(layout, increments, whole)
    schedule = rest_schedule(
        blocks, now.noise, now.llh, gravity=now.gravity, primary=options.primary, earth_rate=form,
        secondary=options.secondary, secondary_from=now.secondary_from,
    )  # fmt: skip
    n = now.layout.size
    ran = run(
        increments, schedule, InitialState(nav, now.P, np.zeros(n - 9)), layout, now.gyro_psd,
        np.full(3, FREE_ACCEL**2),
        FilterOptions(
            covariance_rate_hz=1.0 / _PROPAGATE_S, record_s=2.0 * total if every_s is None else every_s,
            output_rate_hz=1.0 / total, lockout=0,
        ),
    )  # fmt: skip
    P = unpack_symmetric(ran.rec_P, n)
    T = ecef_from_ned_states(now.llh, n)
    last = T.T @ P[-1] @ T
    standing = replace(now, C_nb=C, P=0.5 * (last + last.T), secondary_from=now.secondary_from - total)
    return Ahead(ran.rec_t.copy(), _share(P, now.prior_sigma), standing)


def _readings(now: Standing, nav: NavState, steps: Sequence[Step]) -> tuple[Increments, Blocks, FloatArray]:
    """Increments, blocks of the rests, and the attitude at the end."""
    g, omega_ie = earth.gravity_ned(now.llh[0], now.llh[2]), earth.earth_rate_ned(now.llh[0])
    t = 0.0
    parts, turned, spans = [], [], []
    for step in steps:
        m = max(1, int(np.ceil(step.duration_s / _STEP_S - 1e-9)))
        parts.append((m, step.duration_s / m))
        turned.append(step.angle / m * step.unit if isinstance(step, Turn) else np.zeros(3))
        t += step.duration_s
        if isinstance(step, Rest):
            used = max(step.duration_s - LOST_S, 0.1 * step.duration_s)
            spans.append((t - 0.5 * (step.duration_s + used), used))
    count = np.array([m for m, _ in parts])
    d, r = np.repeat([h for _, h in parts], count), np.repeat(np.array(turned), count, axis=0)
    Q, half = rotation.dcm_from_rotvec(r), rotation.dcm_from_rotvec(0.5 * r)
    C = np.empty((len(d), 3, 3))  # at the beginning of each
    C[0] = now.C_nb
    for k in range(len(d) - 1):
        C[k + 1] = C[k] @ Q[k]
    middle = C @ half
    increments = Increments(np.cumsum(d), d, r + d[:, None] * (omega_ie @ middle), d[:, None] * (-g @ middle))
    # attitudes as the filter will carry them on, coning of its polynomials included
    C_nb = frames.C_en(now.llh).T @ rotation.dcm_from_quat(mechanize(increments, nav).q_eb)
    blocks = [int(np.ceil(used / _BLOCK_S - 1e-9)) for _, used in spans]
    edges = [start + np.linspace(0.0, used, k + 1) for (start, used), k in zip(spans, blocks, strict=True)]
    when = np.concatenate([0.5 * (e[1:] + e[:-1]) for e in edges])
    at = C_nb[np.searchsorted(increments.t, when)]
    number = np.repeat(np.arange(len(blocks)), blocks)
    length = np.concatenate([np.diff(e) for e in edges])
    return increments, Blocks(when, length, -g @ at, omega_ie @ at, number), C_nb[-1]


def _share(P: FloatArray, prior_sigma: FloatArray) -> FloatArray:
    """1-sigma over prior; what was known exactly before counts as found."""
    sigma = np.sqrt(np.maximum(np.einsum("...ii->...i", P)[..., 9:], 0.0))
    return np.asarray(np.where(prior_sigma > 0.0, sigma / np.where(prior_sigma > 0.0, prior_sigma, 1.0), 0.0))
