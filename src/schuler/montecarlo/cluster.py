"""Batches of runs on a Dask cluster: one that is there, or one of this machine's processes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib import import_module, metadata
from typing import Any

from schuler.exceptions import InputError, MissingExtraError, SchulerError
from schuler.montecarlo.store import Span
from schuler.montecarlo.workers import Batches, Finished, Timed, Work, timed

#: ``scheduler="local"``: a cluster of processes on this machine, ended with the campaign.
LOCAL = "local"
_AHEAD = 3  # batches handed out for each thread of the cluster: one under way, two that wait at the worker
_PATIENCE_S = 60.0  # for a first worker
_CONNECT_S = 10.0
# Dask has its workers give freed memory back at once: every array of a run is then new pages from the kernel, which
# was half of the processor time of a single run. [bytes]
_KEEP_MEMORY = {"MALLOC_TRIM_THRESHOLD_": 1 << 30, "MALLOC_MMAP_THRESHOLD_": 1 << 25}


def on_cluster(work: Work, batches: Batches, client: Any) -> Finished:
    """Batches as they finish on the workers of a cluster.

    A batch whose worker dies is done by another one; workers may come and go.

    Raises
    ------
    SchulerError
        If the scheduler is lost, a batch ends one worker after the other, or a worker has another version of schuler.
    """
    from concurrent.futures import CancelledError

    import cloudpickle

    distributed = _distributed()
    packed = cloudpickle.dumps(work)
    digest = hashlib.sha256(packed).hexdigest()
    given: dict[Any, Span] = {}
    finished = distributed.as_completed([])

    def hand_out() -> None:
        batches.workers = max(sum(client.nthreads().values()), 1)  # they come and go
        while len(given) < _AHEAD * batches.workers and (span := batches.take()) is not None:
            # pure=False, a name of its own: the cluster may know the same runs of another campaign
            future = client.submit(_do, digest, packed, span, pure=False, retries=0)
            given[future.key] = span
            finished.add(future)

    hand_out()
    try:
        for future in finished:
            span = given.pop(future.key)
            try:
                version, (rows, seconds) = future.result()
            except distributed.KilledWorker as error:
                raise SchulerError(
                    f"runs {span.first} to {span.last} ended {error.last_worker} and others before it: out of memory? "
                    "Use a smaller batch or workers with more memory"
                ) from None
            except (CancelledError, distributed.client.FutureCancelledError):
                raise SchulerError(
                    "the scheduler of the cluster is gone; what was stored is kept: start it and run the campaign again"
                ) from None
            ours = metadata.version("schuler")
            if version != ours:
                raise SchulerError(f"a worker has schuler {version}, this is {ours}; install the same on all of them")
            batches.took(span, seconds)
            future.release()
            hand_out()
            yield span, rows
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(list(finished.futures), force=True)


@contextmanager
def connected(scheduler: Any, workers: int | None = None) -> Iterator[Any]:
    """Client of a cluster.

    Parameters
    ----------
    scheduler : str or distributed.Client
        Address such as ``tcp://host:8786``, ``"local"`` for a cluster of this machine, or a client that stays open.
    workers : int, optional
        Number of processes of a local cluster.

    Raises
    ------
    InputError
        If there is no scheduler, or no worker within a minute.
    MissingExtraError
        Without Dask (extra ``cluster``).
    """
    distributed = _distributed()
    Client = distributed.Client
    if isinstance(scheduler, Client):
        _wait_for_workers(scheduler)
        yield scheduler
        return
    if scheduler == LOCAL:
        from schuler.montecarlo.cluster_nodes import local_cluster

        kept = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in _KEEP_MEMORY.items()}
        with (
            import_module("dask.config").set(kept),
            local_cluster(workers) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler: nothing answers at {scheduler!r} ({' '.join(str(error).split()) or type(error).__name__}); "
            "start one with 'dask scheduler' and give the address it prints, such as tcp://192.168.1.5:8786"
        ) from None
    with client:
        _wait_for_workers(client)
        yield client


def _wait_for_workers(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError:
        raise InputError(
            f"the scheduler at {client.scheduler.address} has no workers; start some: dask worker "
            f"{client.scheduler.address} --nworkers -1 --nthreads 1"
        ) from None


def _distributed() -> Any:
    """The library, whose own annotations are in part."""
    try:
        return import_module("distributed")
    except ImportError:
        raise MissingExtraError("distributed", "cluster", "running on a Dask cluster") from None


def _do(digest: str, packed: bytes, span: Span) -> tuple[str, Timed]:
    return metadata.version("schuler"), timed(_unpacked(digest, packed), span)


@lru_cache(maxsize=4)
def _unpacked(digest: str, packed: bytes) -> Work:
    """The work, unpacked once a process: scenarios keep what they have prepared."""
    import cloudpickle

    work: Work = cloudpickle.loads(packed)
    return work
