"""The one time axis of all sources of a live run."""

from __future__ import annotations

from dataclasses import dataclass

from schuler.exceptions import InputError
from schuler.timebase import WEEK_S, TimeBase


@dataclass
class SourceClock:
    """Meaning of zero seconds, which the first message with a time settles for all that come after it.

    Attributes
    ----------
    base : TimeBase, optional
        GPS time from the start of the first message's week, as in a recording, or the sources' own clock; ``None``
        before the first message.
    """

    base: TimeBase | None = None

    def seconds(self, gps_s: float, rest: float = 0.0) -> float:
        """A GPS time on this axis.

        Parameters
        ----------
        gps_s : float
            Whole seconds since 1980 ... [s]
        rest : float
            ... and the rest, which together have more digits than one number. [s]

        Raises
        ------
        InputError
            If another source counts on a clock of its own.
        """
        return (gps_s - self.epoch_of(gps_s + rest)) + rest

    def epoch_of(self, gps_s: float) -> float:
        """GPS time of zero seconds since 1980; of this time's week if it is the first. [s]"""
        if self.base is None:
            self.base = TimeBase("gps", float(gps_s // WEEK_S * WEEK_S))
        if self.base.scale != "gps":
            raise InputError(
                "this source gives GPS time, an earlier one counts on a clock of its own: say what its stamps mean "
                "(time = 'gps-tow:WEEK', 'gps', 'unix'), or stamp=arrival"
            )
        return self.base.epoch_gps_s

    def local(self, t: float) -> float:
        """A time of the sources' own clock, which all of them share. [s]

        Raises
        ------
        InputError
            If another source gives GPS time.
        """
        if self.base is None:
            self.base = TimeBase("local")
        if self.base.scale != "local":
            raise InputError(
                "this source counts on a clock of its own, an earlier one gives GPS time: say what its stamps mean "
                "(time = 'gps-tow:WEEK', 'gps', 'unix'), or stamp=arrival"
            )
        return t
