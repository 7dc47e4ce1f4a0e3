"""Scheduler and workers of a cluster on this machine that open no port but those they talk to each other through.

Dask's own always serve pages, also without a dashboard. Imported only where there is Dask: a worker's process finds its
class here by name.
"""

from __future__ import annotations

from typing import Any

from dask.system import CPU_COUNT
from distributed import Nanny, Scheduler, SpecCluster, Worker


class QuietScheduler(Scheduler):
    """A scheduler without a web server."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Start none."""


class QuietWorker(Worker):
    """A worker without a web server."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Start none."""


def local_cluster(workers: int | None) -> SpecCluster:
    """A cluster of so many processes of one thread each, as many as processors by default; loopback interface alone."""
    count = workers or CPU_COUNT
    here = {"host": "127.0.0.1", "dashboard": False}
    options = {**here, "worker_class": QuietWorker, "nthreads": 1, "silence_logs": 40, "memory_limit": 1.0 / count}
    return SpecCluster(  # type: ignore[no-untyped-call]
        workers={k: {"cls": Nanny, "options": options} for k in range(count)},
        scheduler={"cls": QuietScheduler, "options": {**here, "port": 0}},
        silence_logs=40,
    )
