"""Health of a live solution by its newest innovations: what the verdict on a run is, for the last minute."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.measurements import ACCEPTED, DIMENSIONS, FIX, FORCED, GNSS_KINDS, POSITION, REJECTED
from schuler.live.columns import Columns
from schuler.live.messages import Health
from schuler.live.replay import Judged

_SPAN_S = 60.0  # of innovations that count [s]
_FEWEST = 10  # innovations that say something
_REJECTED = (0.2, 0.8)  # share of rejected ones: doubtful, failed
_NIS = (3.0, 10.0)  # mean normalised square of those that were used
_COASTING_S = 3.0  # without a position, and three times as long as they usually take [s]
_PLACING = (POSITION, FIX)
# by kind: number of components, whether it places the vehicle, whether its innovations are judged
_DIMENSION = np.ones(max(DIMENSIONS) + 1)
_DIMENSION[list(DIMENSIONS)] = list(DIMENSIONS.values())
_PLACES, _JUDGED = (np.isin(np.arange(len(_DIMENSION)), kinds) for kinds in (_PLACING, (*GNSS_KINDS, FIX)))


class HealthMonitor:
    """Memory of the last minute's innovations.

    Parameters
    ----------
    placed : float
        Time of the newest position that was used. [s]
    usual_s : float
        Usual time from one position to the next. [s]
    """

    def __init__(self, placed: float = -np.inf, usual_s: float = 1.0) -> None:
        self.placed, self.usual_s = placed, usual_s
        # measurements that cannot change any more, with the normalised innovation squared per component
        self.settled = Columns(t=0, kind=0, status=0, nis=0)

    def settle(self, judged: Judged) -> None:
        """Remember measurements that left the replay window."""
        if len(judged.t):
            self.settled.append(**_rows(judged))

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
        self.settled.drop_before(t - _SPAN_S)
        rows = {name: np.concatenate((self.settled[name], column)) for name, column in _rows(recent).items()}
        newest = int(np.searchsorted(rows["t"], t - _SPAN_S))
        at, kind, status, nis = (column[newest:] for column in rows.values())
        accepted, forced, rejected = (status == s for s in (ACCEPTED, FORCED, REJECTED))
        placing = (accepted | forced) & _PLACES[kind.astype(np.int64)]
        used = at[placing]
        if len(used) > 2:
            self.usual_s = float(np.median(np.diff(used)))
        self.placed = max(self.placed, float(used.max(initial=-np.inf)))
        tested = _JUDGED[kind.astype(np.int64)]
        count = int(np.sum(tested & (accepted | forced | rejected)))
        share = float(np.sum(tested & rejected)) / max(count, 1)
        passed = nis[tested & accepted]
        square = float(passed.mean()) if len(passed) else 0.0
        enough = count >= _FEWEST
        if enough and (share > _REJECTED[1] or square > _NIS[1]):
            return "failed"
        if (enough and (share > _REJECTED[0] or square > _NIS[0])) or bool(np.any(tested & forced)):
            return "doubtful"
        if t - self.placed > max(_COASTING_S, 3.0 * self.usual_s):
            return "coasting"
        return "ok"

    def document(self) -> dict[str, Any]:
        """What goes on, for files."""
        return {"placed": self.placed, "usual_s": self.usual_s, "settled": self.settled.document()}

    @classmethod
    def restored(cls, document: dict[str, Any]) -> HealthMonitor:
        """The monitor of a :meth:`document`."""
        monitor = cls(document["placed"], document["usual_s"])
        monitor.settled.restore(document["settled"])
        return monitor


def _rows(judged: Judged) -> dict[str, FloatArray]:
    kind = judged.kind.astype(np.float64)
    nis = judged.nis / _DIMENSION[judged.kind]
    return {"t": judged.t, "kind": kind, "status": judged.status.astype(np.float64), "nis": nis}
