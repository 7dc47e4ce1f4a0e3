"""Health of a live solution by its newest innovations: what the verdict on a run is, for the last minute."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from schuler.filtering.measurements import ACCEPTED, DIMENSIONS, FIX, FORCED, GNSS_KINDS, POSITION, REJECTED
from schuler.live.messages import Health
from schuler.live.replay import Judged

_SPAN_S = 60.0  # of innovations that count [s]
_FEWEST = 10  # innovations that say something
_REJECTED = (0.2, 0.8)  # share of rejected ones: doubtful, failed
_NIS = (3.0, 10.0)  # mean normalised square of those that were used
_COASTING_S = 3.0  # without a position, and three times as long as they usually take [s]
_PLACING = (POSITION, FIX)
_ROWS = 2000


@dataclass
class HealthMonitor:
    """Memory of the last minute's innovations.

    Attributes
    ----------
    settled : deque of (time, kind, status, normalised innovation squared per component)
        Of measurements that cannot change any more.
    placed : float
        Time of the newest position that was used. [s]
    usual_s : float
        Usual time from one position to the next. [s]
    """

    settled: deque[tuple[float, int, int, float]] = field(default_factory=lambda: deque(maxlen=_ROWS))
    placed: float = -np.inf
    usual_s: float = 1.0

    def settle(self, judged: Judged) -> None:
        """Remember measurements that left the replay window."""
        self.settled.extend(_rows(judged))

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
        while self.settled and self.settled[0][0] < t - _SPAN_S:
            self.settled.popleft()
        rows = [r for r in (*self.settled, *_rows(recent)) if r[0] >= t - _SPAN_S]
        used = [r[0] for r in rows if r[1] in _PLACING and r[2] in (ACCEPTED, FORCED)]
        if len(used) > 2:
            self.usual_s = float(np.median(np.diff(used)))
        self.placed = max([self.placed, *used])
        tested = [r for r in rows if r[2] in (ACCEPTED, FORCED, REJECTED) and (r[1] in GNSS_KINDS or r[1] == FIX)]
        rejected = sum(r[2] == REJECTED for r in tested) / max(len(tested), 1)
        accepted = [r[3] for r in tested if r[2] == ACCEPTED]
        square = float(np.mean(accepted)) if accepted else 0.0
        enough = len(tested) >= _FEWEST
        if enough and (rejected > _REJECTED[1] or square > _NIS[1]):
            return "failed"
        if (enough and (rejected > _REJECTED[0] or square > _NIS[0])) or any(r[2] == FORCED for r in tested):
            return "doubtful"
        if t - self.placed > max(_COASTING_S, 3.0 * self.usual_s):
            return "coasting"
        return "ok"


def _rows(judged: Judged) -> list[tuple[float, int, int, float]]:
    return [
        (t, kind, status, nis / DIMENSIONS[kind])
        for t, kind, status, nis in zip(
            judged.t.tolist(), judged.kind.tolist(), judged.status.tolist(), judged.nis.tolist(), strict=True
        )
    ]
