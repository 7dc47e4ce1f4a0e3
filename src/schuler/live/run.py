"""A live run once it is aligned: filter, prepared samples, aids and health, and their document for files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.live.aids import LiveAids
from schuler.live.health import HealthMonitor
from schuler.live.messages import Health, Solution
from schuler.live.preparation import SamplePreparation
from schuler.live.replay import ReplayFilter
from schuler.live.warm import Kept, stood
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.antenna import antenna_note, is_of_antenna
from schuler.navigation.inputs.imu_axes import axes_covariance, axes_note, claimed_attitude
from schuler.navigation.start.calibration import configured_start
from schuler.navigation.states import imu_spec
from schuler.recording.series import ImuSeries, Kind
from schuler.rotation import dcm_from_quat

_NO_SAMPLES = ImuSeries(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))


@dataclass
class LiveRun:
    """Everything of a live run that begins with its alignment.

    Attributes
    ----------
    initial : InitialState
    provenance : dict, optional
        Of the calibration.
    temperature : float
        Mean of the samples that the start was made from, NaN if they have none. [degC]
    filter : ReplayFilter
    preparation : SamplePreparation
    aids : LiveAids
    monitor : HealthMonitor
    axes_covariance_b : ndarray, shape (3, 3)
        What is not known of the sensors' axes, see :func:`schuler.navigation.inputs.imu_axes.axes_covariance`. [rad^2]
    judged_at : float
        Time of the newest look at the health. [s]
    """

    initial: InitialState
    provenance: dict[str, Any] | None
    temperature: float
    filter: ReplayFilter
    preparation: SamplePreparation
    aids: LiveAids
    monitor: HealthMonitor
    axes_covariance_b: FloatArray
    judged_at: float = -math.inf

    @property
    def covariance_n(self) -> FloatArray:
        """The filter's covariance at its last propagation, navigation errors north-east-down. Shape (n, n)."""
        return self._in_ned(self.filter.state.covariance_e)

    @property
    def claimed_covariance_n(self) -> FloatArray:
        """The same, with the attitude claimed as its axes are known. Shape (n, n)."""
        state = self.filter.state
        return self._in_ned(self._claimed(state.navigation.q_eb, state.covariance_e))

    def _in_ned(self, P_e: FloatArray) -> FloatArray:
        T = ecef_from_ned_states(self.filter.state.navigation.llh, len(P_e))
        rotated: FloatArray = T.T @ P_e @ T
        return 0.5 * (rotated + rotated.T)

    def _claimed(self, q_eb: FloatArray, covariance_e: FloatArray) -> FloatArray:
        """A covariance whose first errors are those of an attitude, with this claimed as its axes are known."""
        if not self.axes_covariance_b.any():
            return covariance_e
        P = covariance_e.copy()
        P[:3, :3] = claimed_attitude(P[:3, :3], dcm_from_quat(q_eb), self.axes_covariance_b)
        return P

    def solution(
        self, t: float, nav: FloatArray, covariance_e: FloatArray, health: Health, smoother_lag_s: float = 0.0
    ) -> Solution:
        """:func:`solution` of a state of this run, with the attitude claimed as its axes are known."""
        return solution(t, nav, self._claimed(nav[:4], covariance_e), health, smoother_lag_s)

    def axes_note(self) -> list[str]:
        """A sentence if attitudes are claimed as the sensors' axes are known, far worse than the filter knows these."""
        if not self.axes_covariance_b.any():
            return []
        P = self.filter.state.covariance_e[:3, :3]
        return axes_note(self.axes_covariance_b, P, calibrated=self.provenance is not None)

    def antenna_note(self, config: NavigationConfig) -> list[str]:
        """A sentence if positions are the antenna's, and claimed better than the IMU may be apart from it."""
        kinds = np.concatenate((self.monitor.settled["kind"], self.filter.judged().kind))
        if not is_of_antenna(config, kinds, self.filter.layout):
            return []
        return antenna_note(np.sqrt(self.claimed_covariance_n.diagonal()[6:8])[None])

    @property
    def is_broken(self) -> bool:
        """Whether the numbers of the filter are none."""
        return self.filter.state.is_broken

    @property
    def kept(self) -> Kept:
        """What outlasts a pause: parameters, but for the clock of a receiver and those behind it."""
        run = self.filter
        m = (run.layout["clock"].start if "clock" in run.layout else run.layout.size) - 9
        P = self.covariance_n[9 : 9 + m, 9 : 9 + m]
        return Kept(run.state.navigation.t, run.state.arrays.est[:m].copy(), P)

    def judge(self) -> Health:
        """Let go of what is too old; health now."""
        run = self.filter
        self.judged_at = run.time
        self.monitor.settle(run.forget())
        return self.monitor.health(run.time, run.judged())

    def after_rest(self, config: NavigationConfig, kind: Kind, t: float) -> LiveRun:
        """The run of a vehicle that has stood since, from a later time on; parameters and covariance grown. [s]"""
        run = self.filter
        begin = t - (run.interval_s if kind == "increment" else 0.0)
        initial = stood(run.state.navigation, self.covariance_n, run.state.arrays.est.copy(), run.layout, begin)
        self.aids.resume(begin)
        return replace(
            self,
            initial=initial,
            filter=ReplayFilter(initial, run.layout, run.psd, run.options, run.interval_s, run.lag_s),
            preparation=SamplePreparation(config, kind, run.interval_s, self.preparation.calibrated),
            monitor=HealthMonitor(placed=begin, by_ranges=self.monitor.by_ranges),
            judged_at=-math.inf,
        )

    def document(self) -> dict[str, Any]:
        """What goes on, for files; the calibration's provenance and temperature aside."""
        nav = self.initial.nav
        return {
            "filter": self.filter.document(),
            "preparation": self.preparation.document(),
            "aids": self.aids.document(),
            "monitor": self.monitor.document(),
            "initial": {
                "t": nav.t, "r_eb_e": nav.r_eb_e, "v_eb_e": nav.v_eb_e, "q_eb": nav.q_eb, "P": self.initial.P,
                "parameters": self.initial.parameters,
            },
            "judged_at": self.judged_at,
        }  # fmt: skip

    @classmethod
    def restored(
        cls,
        document: dict[str, Any],
        provenance: dict[str, Any] | None,
        temperature: float,
        config: NavigationConfig,
        calibration: CalibrationResult | Path | str | None,
        kind: Kind,
    ) -> LiveRun:
        """The run of a :meth:`document`.

        Parameters
        ----------
        document : dict
        provenance : dict, optional
            Of the calibration that it was started with.
        temperature : float
            [degC]
        config : NavigationConfig
        calibration : CalibrationResult or path, optional
            Given beside the configuration.
        kind : {"rate", "increment"}

        Raises
        ------
        InputError
            If the calibration is another one.
        """
        T = None if math.isnan(temperature) else np.array([temperature])
        calibrated = configured_start(config, replace(_NO_SAMPLES, temperature=T), calibration)
        given = None if calibrated is None else calibrated.provenance
        if given != provenance:
            raise InputError(
                f"calibration: the saved run was started with {provenance}, now it is {given}; give the same, or start "
                "anew"
            )
        run, i, spec = ReplayFilter.restored(document["filter"]), document["initial"], imu_spec(config)
        preparation = SamplePreparation(config, kind, run.interval_s, calibrated)
        preparation.restore(document["preparation"])
        return cls(
            InitialState(NavState(i["t"], i["r_eb_e"], i["v_eb_e"], i["q_eb"]), i["P"], i["parameters"]),
            provenance, temperature, run, preparation, LiveAids.restored(config, spec, document["aids"]),
            HealthMonitor.restored(document["monitor"]),
            axes_covariance(spec, run.layout, config.aiding, calibrated), document["judged_at"],
        )  # fmt: skip


def solution(
    t: float, nav: FloatArray, covariance_e: FloatArray, health: Health, smoother_lag_s: float = 0.0
) -> Solution:
    """Solution of a navigation state and its covariance in Earth-fixed axes.

    Parameters
    ----------
    t : float
        [s]
    nav : ndarray, shape (10,)
        Attitude, velocity, position, Earth-fixed.
    covariance_e : ndarray, shape (n, >= n)
        Attitude, velocity, position first.
    health : str
    smoother_lag_s : float
        [s]
    """
    from schuler.live import _kernels

    out = np.empty((6, 3))
    _kernels.geodetic_solution(nav, covariance_e, out)
    llh, v_n, rpy, *sigma = out
    return Solution(t, llh, v_n, rpy, sigma[0], sigma[1], sigma[2], health, smoother_lag_s)
