"""Intake of a live run's measurements: what is of no use is left out and said, the rest goes to the filter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from schuler.exceptions import InputError
from schuler.filtering.measurements import MeasurementSchedule
from schuler.gnss.ranges import Ranges
from schuler.live.aids import LiveAids, series_of
from schuler.live.checks import checked, checked_together, name_of
from schuler.live.collection import Collection
from schuler.live.messages import Broadcast, EventKind, Fix, Heading, Height, Measurement, SatelliteEpoch, Speed
from schuler.live.run import LiveRun
from schuler.live.satellites import LiveSatellites
from schuler.recording.series import GnssSeries

_AHEAD_S = 60.0  # a measurement stamped later than the newest sample by more is of another clock [s]
_AHEAD_STEPPED_S = 1.0  # the same after a step back, when those of the clock before are still under way [s]


class Intake:
    """Intake of measurements: checks, collects for the alignment, and puts into the filter.

    Parameters
    ----------
    satellites : LiveSatellites, optional
        Ranges of tight coupling.
    say : callable
        Called with kind, text and sort of an event for what is left out.

    Attributes
    ----------
    stepped_until : float
        End of the time in which measurements of the clock before its step back may come. [s]
    """

    def __init__(self, satellites: LiveSatellites | None, say: Callable[[EventKind, str, str], None]) -> None:
        self.stepped_until = -math.inf
        self._satellites, self._say = satellites, say

    def take(
        self, messages: Sequence[Measurement], newest: float, run: LiveRun | None, collection: Collection | None
    ) -> None:
        """Take fixes, ranges and readings that came before a sample of a time, or soon after.

        Parameters
        ----------
        messages : sequence of Measurement
            In the order of their arrival.
        newest : float
            Time of the newest sample. [s]
        run : LiveRun, optional
            The run that measures by them; None before the alignment.
        collection : Collection, optional
            Gets them for the alignment; None when that is done.
        """
        together = checked_together(messages)
        if run is not None and together is not None and together.t[-1] <= newest + _AHEAD_S:
            fixes = [m for m in messages if isinstance(m, Fix)]
            if run.aids.takes_together(fixes):
                if collection is not None:
                    collection.messages += fixes
                self.apply(run, self.measurements(run.aids, fixes, together))
                return
        for message in messages:
            if isinstance(message, Broadcast):
                if self._satellites is not None:
                    self._satellites.learn(message.ephemerides)
            elif self._is_ahead(message, newest):
                continue
            elif isinstance(message, SatelliteEpoch):
                self._take_ranges(message, run, collection)
            else:
                self._take_one(message, run, collection)

    def apply(self, run: LiveRun, measurements: MeasurementSchedule) -> None:
        """Put measurements into the filter of a run; those that came too late, or again, are said."""
        if not len(measurements):
            return
        late, repeated = run.filter.aid(measurements)
        if len(repeated):
            self._say("measurement", f"a measurement of {repeated[0]:.3f} s came again", "repeated")
        if len(late):
            lag_s = run.filter.lag_s
            self._say("late", f"measurements of {late[0]:.3f} s left out, more than lag_s = {lag_s:g} s late", "late")

    def measurements(
        self, aids: LiveAids, messages: Sequence[Fix | Speed | Heading | Height], series: GnssSeries | None
    ) -> MeasurementSchedule:
        """Measurements of a message, or of fixes taken together; what is none is said.

        Parameters
        ----------
        aids : LiveAids
        messages : sequence of Fix, or of one reading
        series : GnssSeries, optional
            The fixes as a series.
        """
        notes: list[str] = []
        message = messages[0]
        try:
            if isinstance(message, Fix):
                fixes = [m for m in messages if isinstance(m, Fix)]
                made = MeasurementSchedule.empty() if series is None else aids.fix(fixes, series, notes)
            else:
                made = aids.reading(message)
        except InputError as error:
            self._say("measurement", f"a {name_of(message)} is left out: {error}", name_of(message))
            return MeasurementSchedule.empty()
        for note in notes:
            self._say("measurement", note, note[:20])
        return made

    def range_measurements(self, aids: LiveAids, ranges: Ranges | None) -> MeasurementSchedule:
        """Measurements of prepared ranges; what is none is said."""
        notes: list[str] = []
        made = MeasurementSchedule.empty() if ranges is None or not len(ranges) else aids.ranges(ranges, notes)
        for note in notes:
            self._say("measurement", note, note[:20])
        return made

    def _is_ahead(self, message: Fix | Speed | Heading | Height | SatelliteEpoch, newest: float) -> bool:
        """Whether a measurement is of another clock than the samples, which is said."""
        if newest < self.stepped_until and message.t > newest + _AHEAD_STEPPED_S:
            text = f"a {name_of(message)} of {message.t:.3f} s is left out: it is of the clock before its step back"
            self._say("clock", text, "stepped")
            return True
        if not message.t > newest + _AHEAD_S:
            return False
        self._say(
            "clock",
            f"a {name_of(message)} of {message.t:.3f} s is left out: it is ahead of the IMU by more than "
            f"{_AHEAD_S:g} s, so one of the clocks has another zero",
            "ahead",
        )
        return True

    def _take_one(
        self, message: Fix | Speed | Heading | Height, run: LiveRun | None, collection: Collection | None
    ) -> None:
        """Take a fix or reading."""
        try:
            series = checked(message)
        except (InputError, ValueError) as error:
            text = f"a {name_of(message)} is left out: {error}"
            self._say("measurement", text, f"{name_of(message)} {str(error)[:40]}")
            return
        if collection is not None:
            collection.add(message)
        if run is not None:
            self.apply(run, self.measurements(run.aids, [message], series))

    def _take_ranges(self, message: SatelliteEpoch, run: LiveRun | None, collection: Collection | None) -> None:
        """Take the ranges of an epoch."""
        satellites = self._satellites
        assert satellites is not None
        try:
            epoch, sentences = satellites.take(message)
        except InputError as error:
            self._say("measurement", f"a {name_of(message)} of {message.t:.3f} s is left out: {error}", str(error)[:40])
            return
        for sentence in sentences:
            self._say("measurement", sentence, "ranges")
        if epoch.fix is not None and collection is not None:
            collection.add(epoch.fix)
        satellites.forget(-math.inf if run is None or collection is not None else epoch.t - run.filter.lag_s)
        if run is not None:
            if epoch.fix is not None:  # it tells rests
                self.measurements(run.aids, [epoch.fix], series_of([epoch.fix]))
            self.apply(run, self.range_measurements(run.aids, epoch.usable))
        times, again = satellites.complete(epoch)
        if run is not None and len(times):
            run.filter.exchange(times, self.range_measurements(run.aids, again))
