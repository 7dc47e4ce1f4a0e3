"""Start of a live run: the batch run's own alignment over what was collected, and the filter that goes on from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schuler.calibration.result.result import CalibrationResult
from schuler.filtering.initial_state import InitialState
from schuler.gnss.ranges import Ranges
from schuler.live.aids import LiveAids
from schuler.live.collection import Collection
from schuler.live.health import HealthMonitor
from schuler.live.preparation import PreparedSamples, SamplePreparation
from schuler.live.replay import ReplayFilter
from schuler.live.run import LiveRun
from schuler.live.warm import LONGEST_S, Kept, grown, informed
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.satellite_noise import WINDOW_S
from schuler.navigation.run import prepared_run
from schuler.recording.series import ImuSeries, Kind

_INTERVAL_S = 2.0  # until the epoch that shows that ten seconds of ranges are complete [s]


@dataclass(frozen=True)
class Start:
    """A live run at its beginning.

    Attributes
    ----------
    run : LiveRun
    samples : PreparedSamples
        Those collected; the filter has not run over them.
    sentences : tuple of str
        On what of them was bridged.
    """

    run: LiveRun
    samples: PreparedSamples
    sentences: tuple[str, ...]


def start(
    collection: Collection,
    config: NavigationConfig,
    calibration: CalibrationResult | Path | str | None,
    kind: Kind,
    lag_s: float,
    smoother_lag_s: float | None,
    before: InitialState | None = None,
    kept: Kept | None = None,
    ranges: Ranges | None = None,
) -> Start | None:
    """Start a run by the alignment of a batch run over what came so far; None if it is the start of before.

    Parameters
    ----------
    collection : Collection
    config : NavigationConfig
    calibration : CalibrationResult or path, optional
    kind : {"rate", "increment"}
    lag_s : float
        How late a measurement may come. [s]
    smoother_lag_s : float, optional
        How far the smoother goes back. [s]
    before : InitialState, optional
        Start of the run so far.
    kept : Kept, optional
        Parameters of a run before a pause.
    ranges : Ranges, optional
        Those of tight coupling, corrected.

    Raises
    ------
    InputError
        If what came does not align.
    """
    forward = config.model_copy(update={"filter": config.filter.model_copy(update={"smooth": False, "tune": False})})
    prepared = prepared_run(collection.recording(ranges), forward, calibration=calibration)
    initial, calibrated, raw = prepared.initial, prepared.calibrated, collection.imu
    if kept is not None and 0.0 < initial.nav.t - kept.t <= LONGEST_S:
        blank = InitialState(
            initial.nav,
            np.diag(np.r_[np.zeros(9), prepared.layout.initial_variances()]),
            np.zeros_like(initial.parameters),
        )
        blank = blank if calibrated is None else calibrated.put_into(blank)
        m = len(kept.parameters)
        prior = Kept(initial.nav.t, blank.parameters[:m], blank.P[9 : 9 + m, 9 : 9 + m])
        initial = informed(initial, grown(kept, prepared.layout, initial.nav.t), prior)
    if before is not None and _same(initial, before):
        return None
    interval = float(np.median(prepared.increments.dt))
    preparation = SamplePreparation(config, kind, interval, calibrated)
    samples, sentences = preparation.take(raw["t"], raw["gyro"], raw["accel"], raw["temperature"])
    options = replace(prepared.options, smoother=False, gap_s=None, gap_gyro=0.0, gap_accel=0.0)
    replay = ReplayFilter(initial, prepared.layout, prepared.psd, options, interval, lag_s)
    if prepared.ranges is not None:
        replay.lag_s = lag_s + WINDOW_S + _INTERVAL_S
    if smoother_lag_s is not None:
        replay.lag_s = max(replay.lag_s, smoother_lag_s + 2.0 * replay.propagation_s)
    replay.extend(samples)
    clocks = () if prepared.ranges is None else prepared.ranges.groups
    imu = ImuSeries(samples.t, samples.rate, samples.force)
    aids = LiveAids(config, prepared.spec, initial.nav.t, collection.origin, imu, interval, clocks)
    run = LiveRun(
        initial, None if calibrated is None else calibrated.provenance, float(np.mean(raw["temperature"])), replay,
        preparation, aids, HealthMonitor(placed=initial.nav.t, by_ranges=bool(clocks)), prepared.axes_covariance_b,
    )  # fmt: skip
    return Start(run, samples, tuple(sentences))


def _same(a: InitialState, b: InitialState) -> bool:
    """Whether two starts are one: time, navigation state, parameters and covariance."""
    if a.nav.t != b.nav.t:
        return False
    pairs = ((a.nav.q_eb, b.nav.q_eb), (a.nav.v_eb_e, b.nav.v_eb_e), (a.nav.r_eb_e, b.nav.r_eb_e), (a.P, b.P))
    return all(np.array_equal(x, y) for x, y in (*pairs, (a.parameters, b.parameters)))
