"""What a live run collects before it starts: raw samples, fixes and readings, and when a start is worth a trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.gnss.ranges import Ranges
from schuler.live.aids import series_of
from schuler.live.columns import Columns
from schuler.live.messages import Fix, Heading, Height, Speed
from schuler.navigation.config import NavigationConfig
from schuler.navigation.start.alignment import MIN_SPEED, PATIENCE_S, first_moving
from schuler.navigation.start.velocity_fit import with_velocities
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries, Kind, OdometerSeries, ScalarSeries

COLLECTED_S = 600.0  # samples and fixes older than this are dropped before the start [s]
JUDGED_S = 60.0  # of the fixes after a start that judge its heading, as of a log [s]
_FIRST_S = 3.0  # shortest log that is aligned [s]
_AGAIN_S = 0.5  # between two trials [s]


class Collection:
    """Messages so far, as a recording.

    Parameters
    ----------
    config : NavigationConfig
    kind : {"rate", "increment"}
        Of the samples, which are in SI and forward-right-down axes.
    """

    def __init__(self, config: NavigationConfig, kind: Kind) -> None:
        self._config, self._kind = config, kind
        self.imu = Columns(t=0, gyro=3, accel=3, temperature=0)
        self.messages: list[Fix | Speed | Heading | Height] = []
        self.next_trial = -np.inf  # [s]
        self._patience = JUDGED_S  # time after the first fix when the next start without motion is tried [s]
        self.origin = np.nan  # time of the first message [s]

    def add(self, message: Fix | Speed | Heading | Height) -> None:
        """Keep a fix or reading."""
        self.origin = message.t if np.isnan(self.origin) else self.origin
        self.messages.append(message)

    def extend(self, **rows: object) -> None:
        """Keep samples."""
        self.imu.append(**rows)
        self.origin = float(self.imu["t"][0]) if np.isnan(self.origin) else self.origin

    def forget(self) -> None:
        """Drop what is too old for a start."""
        if len(self.imu):
            oldest = float(self.imu["t"][-1]) - COLLECTED_S
            if self.imu["t"][0] < oldest - 10.0:
                self.imu.drop_before(oldest)
                self.messages = [m for m in self.messages if m.t >= oldest]

    def is_due(self) -> bool:
        """Whether a start is worth a trial.

        It needs a fix, and one that moves where the heading is to come from the course. Without motion the
        accelerations of the first one, two and four minutes may tell it, as in a log. A gyrocompass takes all the time
        at rest that it is given.
        """
        t, section = self.imu["t"], self._config.alignment
        if len(t) < 100 or t[-1] < self.next_trial or t[-1] - t[0] < _FIRST_S:
            return False
        self.next_trial = float(t[-1]) + _AGAIN_S
        first, last = (float(t[k]) + self._config.imu.clock_shift_s for k in (0, -1))
        fixes = _ordered(m for m in self.messages if isinstance(m, Fix) and first <= m.t <= last)
        if not fixes or section.method == "given":
            return bool(fixes)
        try:
            gnss = with_velocities(series_of(fixes))
        except InputError:  # too few fixes for a velocity, or one that is none
            return False
        k, obstacle = first_moving(gnss, section)
        waited = last - fixes[0].t
        if not obstacle:
            # a slow course is taken where no better one follows soon
            fast = section if section.min_speed_m_s else section.model_copy(update={"min_speed_m_s": MIN_SPEED})
            return not first_moving(gnss, fast)[1] or bool(last - float(gnss.t[k]) > PATIENCE_S)
        if section.method == "gyrocompass":
            return bool(waited >= section.rest_s)
        if waited < self._patience:
            return False
        self._patience = 2.0 * self._patience
        return True

    def document(self) -> dict[str, Any]:
        """The messages so far, for files."""
        messages = [
            {"type": type(m).__name__, **{f.name: getattr(m, f.name) for f in fields(m)}} for m in self.messages
        ]
        return {
            "imu": self.imu.document(), "messages": messages, "next_trial": self.next_trial, "origin": self.origin,
            "patience": self._patience,
        }  # fmt: skip

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from a :meth:`document`."""
        self.imu.restore(document["imu"])
        kinds: dict[str, Any] = {kind.__name__: kind for kind in (Fix, Speed, Heading, Height)}
        self.messages = [
            kinds[m["type"]](**{name: value for name, value in m.items() if name != "type"})
            for m in document["messages"]
        ]
        self.next_trial, self.origin, self._patience = (document[n] for n in ("next_trial", "origin", "patience"))

    def recording(self, ranges: Ranges | None = None) -> Recording:
        """The messages so far.

        Parameters
        ----------
        ranges : Ranges, optional
            Those of tight coupling, in place of the fixes.

        Raises
        ------
        InputError
            If there is no fix.
        """
        t = self.imu["t"]
        temperature = self.imu["temperature"]
        imu = ImuSeries(
            t.copy(), self.imu["gyro"].copy(), self.imu["accel"].copy(), self._kind,
            None if np.isnan(temperature).any() else temperature.copy(),
        )  # fmt: skip
        fixes = _ordered(m for m in self.messages if isinstance(m, Fix))
        if not fixes:
            raise InputError("alignment needs GNSS positions, and there is none yet")
        gnss = series_of(fixes)
        speeds, headings, heights = (
            _ordered(m for m in self.messages if isinstance(m, kind)) for kind in (Speed, Heading, Height)
        )
        return Recording(
            imu, gnss if ranges is None else None,
            OdometerSeries(*_columns(speeds, "speed")) if speeds else None,
            heading=ScalarSeries(*_columns(headings, "value")) if headings else None,
            height=ScalarSeries(*_columns(heights, "value")) if heights else None,
            ranges=ranges,
            # a stream does not say on what Earth it was simulated: on that of the configuration
            metadata=Metadata(options={"scenario": {"motion": {"earth_rotation": self._config.filter.earth_rotation}}}),
        )  # fmt: skip


def _ordered(messages: object) -> list:  # type: ignore[type-arg]
    """Messages in order of time, the first of those with one stamp."""
    ordered = sorted(messages, key=lambda m: m.t)  # type: ignore[call-overload]
    return [m for k, m in enumerate(ordered) if k == 0 or m.t > ordered[k - 1].t]


def _columns(messages: Sequence[Speed | Heading | Height], name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    sigma = [1.0 if m.sigma is None else m.sigma for m in messages]  # one that is stated is put in its place
    return np.array([m.t for m in messages]), np.array([getattr(m, name) for m in messages]), np.array(sigma)
