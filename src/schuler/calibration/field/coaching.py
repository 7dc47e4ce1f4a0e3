"""A coach for a person who calibrates by hand: the next move, what is still uncertain, when to stop.

The covariance of the calibration filter after the log so far is predicted over possible moves; the one that reduces
most uncertainty for its time is advised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from schuler.arrays import ArrayLike
from schuler.calibration.field.advice import Advice, waiting_sentence
from schuler.calibration.field.blocks import rest_blocks
from schuler.calibration.field.calibration import FieldCalibration, calibrate_field
from schuler.calibration.field.covariance_prediction import CovarianceState, covariance_after_log, initial_covariance
from schuler.calibration.field.held_rests import resolve_earth_rate
from schuler.calibration.field.options import CoachOptions, FieldOptions
from schuler.calibration.field.planning import TARGET_MARGIN, advise, log_excess
from schuler.calibration.field.problem import (
    FREE_HEADING,
    block_noise,
    field_layout,
    parameter_names,
    prior_from_calibration,
)
from schuler.recording.series import ImuSeries, Kind
from schuler.standstill.live import LiveRests
from schuler.standstill.rests import field_rests
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.calibration.result.result import CalibrationResult
    from schuler.sensors.spec import ImuSpec

_EDGE_S = 1.0  # largest time from the end of the last rest to that of a log that ends at rest


class Site(NamedTuple):
    """Place, heading and prior, see :func:`schuler.calibration.field.calibration.calibrate_field`."""

    latitude: float
    height: float = 0.0
    gravity: float | None = None
    heading: tuple[float, float] | None = None
    prior: CalibrationResult | None = None


def coach(
    imu: ImuSeries,
    spec: ImuSpec,
    *,
    latitude: float,
    height: float = 0.0,
    gravity: float | None = None,
    heading: tuple[float, float] | None = None,
    options: FieldOptions | None = None,
    coaching: CoachOptions | None = None,
    prior: CalibrationResult | None = None,
    rests: StaticIntervals | None = None,
) -> Advice:
    """Advise the next move, given the log so far.

    Parameters
    ----------
    imu : ImuSeries
        Raw readings so far, SI.
    spec, latitude, height, gravity, heading, options, prior, rests
        As in :func:`schuler.calibration.field.calibration.calibrate_field`. A heading that is not given is left open
        here, it is not searched for: uncertainties hardly depend on it.
    coaching : CoachOptions, optional

    Returns
    -------
    Advice

    Raises
    ------
    InputError
        As in :func:`schuler.calibration.field.calibration.calibrate_field`, but for a log without rests the advice is
        to rest.

    Notes
    -----
    See :func:`schuler.calibration.field.planning.advise` for the choice of the move.
    """
    options, coaching = options or FieldOptions(), coaching or CoachOptions()
    names = parameter_names(field_layout(spec, options))
    if rests is None:
        rests = field_rests(imu) if imu.t[-1] - imu.t[0] > coaching.first_rest_s else None
    if rests is None or not len(rests):
        return _waiting(names, float(imu.t[-1]), float(imu.t[-1] - imu.t[0]), 0, coaching, moving=False)
    site = Site(latitude, height, gravity, heading, prior)
    return _advice(imu, rests, spec, site, options, coaching)


class Coach:
    """A coach that is fed with samples as they come.

    Parameters
    ----------
    spec, latitude, height, gravity, heading, options, coaching, prior
        As in :func:`coach`.
    kind : {"rate", "increment"}
        Kind of the samples.

    Attributes
    ----------
    advice : Advice
        The latest advice.

    Raises
    ------
    InputError
        If the specification has nothing to calibrate.

    Notes
    -----
    A rest is detected in windows of half a second. When it has lasted long enough, the covariance is run over all turns
    and rests so far and over some forty possible moves: 0.1 to 0.2 s for a log of ten minutes at 100 Hz.
    """

    def __init__(
        self,
        spec: ImuSpec,
        *,
        latitude: float,
        height: float = 0.0,
        gravity: float | None = None,
        heading: tuple[float, float] | None = None,
        options: FieldOptions | None = None,
        coaching: CoachOptions | None = None,
        prior: CalibrationResult | None = None,
        kind: Kind = "rate",
    ) -> None:
        self.spec, self.options, self.coaching = spec, options or FieldOptions(), coaching or CoachOptions()
        self.site = Site(latitude, height, gravity, heading, prior)
        self._names = parameter_names(field_layout(spec, self.options))
        self._log = LiveRests(kind)
        self._advise_after_s, self._tested_t = self.coaching.first_rest_s, -np.inf
        self.advice = _waiting(self._names, 0.0, 0.0, 0, self.coaching, moving=False)

    @property
    def moving(self) -> bool:
        """Whether the sensor is being turned, after the first rest."""
        return bool(len(self._log)) and self._log.first_rest() and self._log.still_s() == 0.0

    @property
    def still_s(self) -> float:
        """Time for which it has been resting. [s]"""
        return self._log.still_s()

    def imu(self, t: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> Advice | None:
        """Take in one sample, or a block of them.

        Parameters
        ----------
        t : array_like, shape () or (n,)
            [s]
        gyro, accel : array_like, shape (3,) or (n, 3)
            [rad/s], [m/s^2], or increments.

        Returns
        -------
        Advice or None
            New advice when a rest is long enough. Give blocks of half a second or less; after a long one call
            :meth:`update`.
        """
        self._log.add(t, gyro, accel)
        if self._log.time - self._tested_t < 0.5 or not self._log.first_rest():
            return None
        self._tested_t = self._log.time
        if self._log.still_s() < self._advise_after_s:
            if self._log.still_s() == 0.0:
                self._advise_after_s = self.coaching.rest_s
            return None
        advice = self.update()
        # without a turn the next advice comes after the time of a rest
        self._advise_after_s = self._log.still_s() + max(advice.rest_s, self.coaching.rest_s)
        return advice

    def update(self) -> Advice:
        """Advice on the log so far, computed now."""
        rests = self._log.rests() if self._log.first_rest() else None
        t, elapsed = self._log.time, self._log.time - self._log.begin
        if rests is None or not len(rests):
            self.advice = _waiting(self._names, t, elapsed, 0, self.coaching, moving=self.moving)
        else:
            self.advice = _advice(self._log.series(), rests, self.spec, self.site, self.options, self.coaching)
        return self.advice

    def series(self) -> ImuSeries:
        """The log so far."""
        return self._log.series()

    def calibration(self) -> FieldCalibration:
        """Calibration of the log so far, its rests detected again."""
        site = self.site
        return calibrate_field(
            self.series(), self.spec, latitude=site.latitude, height=site.height, gravity=site.gravity,
            heading=site.heading, options=self.options, prior=site.prior,
        )  # fmt: skip


def _advice(
    imu: ImuSeries,
    rests: StaticIntervals,
    spec: ImuSpec,
    site: Site,
    options: FieldOptions,
    coaching: CoachOptions,
) -> Advice:
    """Advice on a log with rests."""
    layout = field_layout(spec, options)
    values = np.zeros(layout.size - 9)
    if site.prior is not None:
        layout, values = prior_from_calibration(layout, site.prior)
    heading, sigma = (0.0, FREE_HEADING) if site.heading is None else site.heading
    blocks = rest_blocks(imu, rests, options.block_s)
    options = resolve_earth_rate(options, spec, blocks, rests)
    before = initial_covariance(
        spec, latitude=site.latitude, height=site.height, gravity=site.gravity, heading_sigma=sigma, options=options,
        layout=layout,
    )  # fmt: skip
    before = replace(before, noise=block_noise(blocks, spec))
    names = parameter_names(layout)

    t, moving = float(imu.t[-1]), bool(imu.t[-1] - rests.stop[-1] > _EDGE_S)

    def advice_at(state: CovarianceState) -> Advice:
        return advise(state, names, coaching, t=t, elapsed=t - float(imu.t[0]), rests=len(rests), moving=moving)

    advice = advice_at(covariance_after_log(before, imu, rests, blocks, values, heading))
    if not advice.done or site.heading is not None:
        return advice
    # the heading is open: the log suffices only if it does so for each of four headings
    within_reach = np.array([name not in advice.out_of_reach for name in names])
    quarters = [covariance_after_log(before, imu, rests, blocks, values, 0.5 * np.pi * k) for k in (1, 2, 3)]
    lacking = [float(log_excess(state.share[within_reach], TARGET_MARGIN * coaching.target)) for state in quarters]
    return advice_at(quarters[int(np.argmax(lacking))]) if max(lacking) > 0.0 else advice


def _waiting(
    names: Sequence[str], t: float, elapsed: float, rests: int, coaching: CoachOptions, *, moving: bool
) -> Advice:
    """Advice before the first rest."""
    share = dict.fromkeys(names, 1.0)
    return Advice(
        t=t, elapsed=elapsed, rests=rests, moving=moving, progress=0.0, share=share, remaining=dict(share),
        out_of_reach={}, turn=None, rest_s=coaching.first_rest_s, gain=0.0, done=False,
        next=waiting_sentence("first", coaching),
    )  # fmt: skip
