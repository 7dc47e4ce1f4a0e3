"""Which runs are handed out together: no result depends on it, only how often something is stored."""

from __future__ import annotations

from collections.abc import Sequence

from schuler.montecarlo.store import Span

_LARGEST = 256  # runs of a batch, if nothing else is said
_BATCH_S = 4.0  # what a batch should take: all that an interruption costs each worker


class Batches:
    """Runs that are to be done, cut into batches as they are asked for.

    Parameters
    ----------
    spans : sequence of Span
        Runs to do, ascending.
    workers : int
        The last batches are made small enough for all of them to have work.
    size : int, optional
        Runs of a batch. Default: one at first, then as many as take some seconds.
    preferred : int
        Without ``size``: number of runs that a function does best together.
    """

    def __init__(self, spans: Sequence[Span], workers: int, size: int | None = None, preferred: int = 1) -> None:
        self._spans = list(spans)
        self._fixed, self._preferred, self.workers = size, max(preferred, 1), max(workers, 1)
        self._size = self._preferred
        self._left = sum(s.runs for s in self._spans)

    def take(self) -> Span | None:
        """The next batch; None if there is nothing left to hand out."""
        if not self._spans:
            return None
        span = self._spans[0]
        size = self._fixed
        if size is None:
            share = self._left // (2 * self.workers)
            size = max(min(self._size, share - share % self._preferred), self._preferred)
        taken = Span(span.first, min(span.first + size - 1, span.last))
        self._left -= taken.runs
        if taken.last == span.last:
            self._spans.pop(0)
        else:
            self._spans[0] = Span(taken.last + 1, span.last)
        return taken

    def give_back(self, spans: Sequence[Span]) -> None:
        """Batches that were taken and not done."""
        self._spans = sorted([*self._spans, *spans])
        self._left += sum(s.runs for s in spans)

    def took(self, span: Span, seconds: float) -> None:
        """Say how long a batch took, so that the next ones are of good length."""
        wished = int(span.runs * _BATCH_S / max(seconds, 1e-6))
        whole = wished - wished % self._preferred if wished > self._preferred else max(wished, 1)
        # not more than four times as large: the first run of a process takes longer than those that follow
        self._size = min(whole, 4 * max(span.runs, self._preferred), max(_LARGEST, self._preferred))
