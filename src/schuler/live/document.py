"""Documents of live runs: everything that goes on, as plain data and arrays for files."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.live.aids import LiveAids
from schuler.live.health import HealthMonitor
from schuler.live.preparation import SamplePreparation
from schuler.live.replay import ReplayFilter
from schuler.live.warm import Kept
from schuler.mechanization.strapdown import NavState
from schuler.navigation.start.calibration import configured_start
from schuler.navigation.states import imu_spec
from schuler.recording.io.own import time_document, time_from
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from schuler.live.navigator import LiveNavigator

_NO_SAMPLES = ImuSeries(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))


def live_document(live: LiveNavigator) -> dict[str, Any]:
    """Everything of a run that goes on, as plain data and arrays."""
    stamps, run = live._stamps, None
    if live._filter is not None:
        assert live._preparation is not None
        assert live._aids is not None
        assert live._initial is not None
        nav = live._initial.nav
        run = {
            "filter": live._filter.document(),
            "preparation": live._preparation.document(),
            "aids": live._aids.document(),
            "monitor": live._monitor.document(),
            "initial": {
                "t": nav.t, "r_eb_e": nav.r_eb_e, "v_eb_e": nav.v_eb_e, "q_eb": nav.q_eb, "P": live._initial.P,
                "parameters": live._initial.parameters,
            },
            "judged_at": live._judged_at,
        }  # fmt: skip
    return {
        "config": live.config.model_dump(mode="json", exclude_unset=True),
        "lag_s": live.lag_s,
        "smoother_lag_s": live.smoother_lag_s,
        "kind": live.kind,
        "time": None if live.time is None else time_document(live.time),
        "calibration": live._provenance,
        "temperature": live._temperature,
        "stamps": [stamps.last, stamps.other, stamps.count],
        "newest": live._newest,
        "health": live._health,
        "collection": None if live._collection is None else live._collection.document(),
        "kept": None if live._kept is None else live._kept._asdict(),
        "run": run,
    }


def restore_live(live: LiveNavigator, document: dict[str, Any]) -> None:
    """Go on from a document of the run's configuration.

    Raises
    ------
    InputError
        If it was saved with another calibration.
    """
    live._stamps.last, live._stamps.other, live._stamps.count = document["stamps"]
    live._newest, live._health = document["newest"], document["health"]
    live._provenance, live._temperature = document["calibration"], document["temperature"]
    live.time = None if document["time"] is None else time_from(document["time"])
    if document["collection"] is None:
        live._collection = None
    elif live._collection is not None:
        live._collection.restore(document["collection"])
    live._kept = None if document["kept"] is None else Kept(**document["kept"])
    run = document["run"]
    if run is None:
        return
    T = None if math.isnan(live._temperature) else np.array([live._temperature])
    calibrated = configured_start(live.config, replace(_NO_SAMPLES, temperature=T), live._calibration)
    if (None if calibrated is None else calibrated.provenance) != live._provenance:
        raise InputError(
            f"calibration: the saved run was started with {live._provenance}, now it is "
            f"{None if calibrated is None else calibrated.provenance}; give the same, or start anew"
        )
    live._filter = ReplayFilter.restored(run["filter"])
    interval = live._filter.interval_s
    live._preparation = SamplePreparation(live.config, live._readings.kind, interval, calibrated)
    live._preparation.restore(run["preparation"])
    live._aids = LiveAids.restored(live.config, imu_spec(live.config), run["aids"])
    i = run["initial"]
    live._monitor = HealthMonitor.restored(run["monitor"])
    live._initial = InitialState(NavState(i["t"], i["r_eb_e"], i["v_eb_e"], i["q_eb"]), i["P"], i["parameters"])
    live._judged_at = run["judged_at"]
