"""What decoders of streams have in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Protocol

from schuler.live.messages import Fix, Message
from schuler.recording.io.over_ground import NO_VELOCITY
from schuler.recording.series import GnssSeries


class Decoder(Protocol):
    """A parser that is fed piece by piece."""

    @property
    def left_out(self) -> Counter[str]:
        """Pieces of no use, counted by a phrase that says which and why."""
        ...

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """Messages that some more bytes complete.

        Parameters
        ----------
        data : bytes
        arrival : float
            When they came, GPS time since 1980 by the clock of this machine. [s]
        """
        ...

    def pause(self) -> list[Message]:
        """Messages that are complete because nothing more has come for a while."""
        ...

    def finish(self) -> list[Message]:
        """Messages that the end of the stream completes."""
        ...


def fixes(series: GnssSeries, shift: float = 0.0) -> Iterator[Fix]:
    """Fixes of a series, one by one; a velocity that is missing at a single epoch is none.

    Parameters
    ----------
    series : GnssSeries
    shift : float
        Added to the times. [s]
    """
    for k, t in enumerate((series.t + shift).tolist()):
        v_n, cov_v_n = None, None
        if series.v_n is not None and series.cov_v_n is not None and series.cov_v_n[k, 0, 0] < NO_VELOCITY**2:
            v_n, cov_v_n = series.v_n[k], series.cov_v_n[k]
        yield Fix(
            t, series.llh[k], series.cov_r_n[k], v_n, cov_v_n,
            None if series.quality is None else int(series.quality[k]),
            None if series.n_satellites is None else int(series.n_satellites[k]),
        )  # fmt: skip
