"""Health of a live solution by its newest innovations: what the verdict on a run is, for the last minute."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.filtering.measurements import (
    ACCEPTED,
    DIMENSIONS,
    FIX,
    FORCED,
    GNSS_KINDS,
    POSITION,
    PSEUDORANGE,
    REJECTED,
)
from schuler.live.columns import Columns
from schuler.live.messages import Health
from schuler.live.replay import Judged

_SPAN_S = 60.0  # of innovations that count [s]
_FEWEST = 10  # innovations that say something
_REJECTED = (0.2, 0.8)  # share of rejected ones: doubtful, failed
_NIS = (3.0, 10.0)  # mean normalised square of those that were used
_COASTING_S = 3.0  # without a position, and three times as long as they usually take [s]
_PLACING = (POSITION, FIX, PSEUDORANGE)
_RANGES = 4  # of one time that place the vehicle
# by kind: whether its innovations are judged, whether it places the vehicle, number of components
_SORTS = np.ones((max(DIMENSIONS) + 1, 3))
_SORTS[:, 0], _SORTS[:, 1] = (np.isin(np.arange(len(_SORTS)), kinds) for kinds in ((*GNSS_KINDS, FIX), _PLACING))
_SETTLED = _SORTS.copy()  # these have their squares by component
_SORTS[list(DIMENSIONS), 2] = list(DIMENSIONS.values())


class HealthMonitor:
    """Memory of the last minute's innovations.

    Parameters
    ----------
    placed : float
        Time of the newest position that was used. [s]
    usual_s : float
        Usual time from one position to the next. [s]
    by_ranges : bool
        Positions come as ranges, four of one time.
    """

    def __init__(self, placed: float = -np.inf, usual_s: float = 1.0, by_ranges: bool = False) -> None:
        self.placed, self.usual_s, self.by_ranges = placed, usual_s, by_ranges
        # measurements that cannot change any more, with the normalised innovation squared per component
        self.settled = Columns(("kind", "status"), t=0, kind=0, status=0, nis=0)
        self._used = np.empty(256)  # times of positions
        self._sums = np.empty(6)
        from schuler.jit import direct
        from schuler.live import _kernels

        _kernels.prepare_live()
        self._count, self._usual_step = direct(_kernels.count_innovations), direct(_kernels.usual_step)

    def settle(self, judged: Judged) -> None:
        """Remember measurements that left the replay window."""
        if len(judged.t):
            nis = judged.nis / _SORTS[judged.kind, 2]
            self.settled.append(t=judged.t, kind=judged.kind, status=judged.status, nis=nis)

    def health(self, t: float, recent: Judged) -> Health:
        """Health at a time.

        Parameters
        ----------
        t : float
            [s]
        recent : Judged
            Measurements that may still be run again.

        Notes
        -----
        Shares and mean squares are taken of GNSS and known places, over a minute: ``failed`` if most are rejected or
        those used are more than threefold off, ``doubtful`` above a fifth or where one was taken against the gate;
        ``coasting`` while none places the vehicle.
        """
        since, old, sums = t - _SPAN_S, self.settled, self._sums
        old.drop_before(since)
        if len(old) + len(recent.t) > len(self._used):
            self._used = np.empty(2 * (len(old) + len(recent.t)))
        sums[:] = 0.0
        statuses = ACCEPTED, FORCED, REJECTED
        for rows, sorts in ((Judged(*(old[name] for name in Judged._fields)), _SETTLED), (recent, _SORTS)):
            self._count(*rows, since, sorts, *statuses, sums, self._used)
        count, rejected, squares, passed, forced, n = sums.tolist()
        used = self._used[: int(n)]
        if self.by_ranges:
            times, count_of = np.unique(used, return_counts=True)
            used = times[count_of >= _RANGES]
            n = len(used)
        if n > 2:
            self.usual_s = float(self._usual_step(used))
        if n:
            self.placed = max(self.placed, float(used[-1]))
        share, square = rejected / max(count, 1.0), squares / max(passed, 1.0)
        enough = count >= _FEWEST
        if enough and (share > _REJECTED[1] or square > _NIS[1]):
            return "failed"
        if (enough and (share > _REJECTED[0] or square > _NIS[0])) or forced > 0.0:
            return "doubtful"
        if t - self.placed > max(_COASTING_S, 3.0 * self.usual_s):
            return "coasting"
        return "ok"

    def document(self) -> dict[str, Any]:
        """What goes on, for files."""
        return {
            "placed": self.placed, "usual_s": self.usual_s, "by_ranges": self.by_ranges,
            "settled": self.settled.document(),
        }  # fmt: skip

    @classmethod
    def restored(cls, document: dict[str, Any]) -> HealthMonitor:
        """The monitor of a :meth:`document`."""
        monitor = cls(document["placed"], document["usual_s"], document["by_ranges"])
        monitor.settled.restore(document["settled"])
        return monitor
