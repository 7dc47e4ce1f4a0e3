"""Campaigns on a Dask cluster that is there: the same runs, and what happens when a worker is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest

from schuler.exceptions import InputError, SchulerError
from schuler.montecarlo import Statistics
from schuler.montecarlo.cluster import connected
from schuler.montecarlo.engine import campaign

if find_spec("distributed") is None:
    pytest.skip("a cluster needs the extra cluster", allow_module_level=True)

KEEP = Statistics(covariance=("track",))


@pytest.fixture
def runs():
    import montecarlo_runs

    return montecarlo_runs


class Cluster:
    """``dask scheduler`` and some ``dask worker``, as a user would start them."""

    def __init__(self, folder):
        self.folder, self.address = folder, None
        self.environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        path = folder / "scheduler.json"
        self.scheduler = self.start("scheduler", "--port", "0", "--host", "127.0.0.1", "--scheduler-file", str(path),
                                    "--no-dashboard")  # fmt: skip
        until(lambda: path.exists() and path.read_text().endswith("}"))
        self.address = json.loads(path.read_text())["address"]
        self.workers = []

    def start(self, *arguments):
        with (self.folder / f"{arguments[0]}-{time.monotonic_ns()}.log").open("w") as log:
            command = [sys.executable, "-m", "dask", *arguments]
            return subprocess.Popen(command, env=self.environment, stdout=log, stderr=log)

    def add(self):
        self.workers.append(
            self.start("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory",
                       str(self.folder))
        )  # fmt: skip

    def close(self):
        for process in (*self.workers, self.scheduler):
            if process.poll() is None:
                process.kill()
            process.wait()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def cluster(tmp_path, importable):
    (tmp_path / "dask").mkdir()
    made = Cluster(tmp_path / "dask")
    yield made
    made.close()


def same(a, b):
    for name, s in a.statistics.items():
        np.testing.assert_array_equal(s.moments.m2, b[name].moments.m2)
        np.testing.assert_array_equal(s.quantile(0.5), b[name].quantile(0.5))
    np.testing.assert_array_equal(a["track"].covariance, b["track"].covariance)


@pytest.mark.campaign
def test_kill_9_of_one_of_two_workers(cluster, runs, tmp_path, executions):
    """The other one does what was left; nothing that was stored is done again; the table is the same to the byte."""
    path, count = executions
    scenario = {"log": str(path), "sleep": 0.02}
    cluster.add()
    cluster.add()
    stored_at_the_kill = set()
    folder = tmp_path / "s"

    def kill(fraction):
        if fraction > 0.3 and not stored_at_the_kill:
            cluster.workers[0].send_signal(signal.SIGKILL)
            cluster.workers[0].wait()
            for part in folder.glob("part-*"):
                stored_at_the_kill.update(range(int(part.name[5:15]), int(part.name[16:26]) + 1))

    options = {"seed": 2, "statistics": KEEP, "batch": 4}
    got = campaign(runs.counted, scenario, 160, store=folder, scheduler=cluster.address, progress=kill, **options)
    assert cluster.workers[0].returncode == -signal.SIGKILL
    assert got.complete
    assert got.where == f"the Dask cluster {cluster.address}"
    assert 48 <= len(stored_at_the_kill) < 160
    times = count()
    assert set(times) == set(range(160))
    assert all(times[k] == 1 for k in stored_at_the_kill)
    assert sum(times.values()) <= 160 + 3 * 4 + 4  # what the one that was killed had under way, and waiting results

    undisturbed = campaign(runs.counted, scenario, 160, store=tmp_path / "undisturbed", workers=1, **options)
    same(got, undisturbed)
    assert (folder / "runs.parquet").read_bytes() == (tmp_path / "undisturbed" / "runs.parquet").read_bytes()


@pytest.mark.campaign
def test_workers_may_come_later_and_functions_may_fail(cluster, runs):
    cluster.add()

    def one_more(fraction):
        if fraction > 0.2 and len(cluster.workers) == 1:
            cluster.add()

    got = campaign(runs.fails, {}, 200, scheduler=cluster.address, progress=one_more, batch=5, statistics=KEEP)
    here = campaign(runs.fails, {}, 200, workers=1, statistics=KEEP)
    same(got, here)
    assert got.failures == here.failures
    with pytest.raises(RuntimeError, match="a defect"):
        campaign(runs.defect, {}, 60, scheduler=cluster.address)


@pytest.mark.campaign
def test_when_the_scheduler_is_killed_what_was_stored_is_kept(cluster, runs, tmp_path, executions):
    path, count = executions
    cluster.add()

    def kill(fraction):
        if fraction > 0.3 and cluster.scheduler.poll() is None:
            cluster.scheduler.kill()
            cluster.scheduler.wait()

    options = {"seed": 2, "store": tmp_path / "s", "batch": 4}
    scenario = {"log": str(path), "sleep": 0.02}
    with pytest.raises(SchulerError, match=r"scheduler of the cluster is gone; what was stored is kept"):
        campaign(runs.counted, scenario, 100, scheduler=cluster.address, progress=kill, **options)
    cluster.close()
    got = campaign(runs.counted, scenario, 100, workers=1, **options)
    assert got.executed < 70
    assert set(count()) == set(range(100))


def test_nobody_there(runs, monkeypatch):
    monkeypatch.setattr("schuler.montecarlo.cluster._CONNECT_S", 0.5)
    with pytest.raises(InputError, match=r"nothing answers at 'tcp://127.0.0.1:9'.*dask scheduler"):
        campaign(runs.values, {}, 5, scheduler="tcp://127.0.0.1:9")


def test_workers_of_this_machine_keep_the_memory_of_their_arrays(monkeypatch):
    """Freed arrays are used again, and are no new pages for every run."""
    import dask.config

    class Started(Exception):
        pass

    def start(_workers):
        raise Started(dict(dask.config.get("distributed.nanny.pre-spawn-environ")))

    monkeypatch.setattr("schuler.montecarlo.cluster_nodes.local_cluster", start)
    with pytest.raises(Started) as raised, connected("local"):
        pass
    given = raised.value.args[0]
    array = 8 * 360_000  # a channel of an hour at 100 Hz
    assert given["MALLOC_TRIM_THRESHOLD_"] > 100 * array
    assert array < given["MALLOC_MMAP_THRESHOLD_"] <= 32 << 20  # glibc takes no more
    assert given["OMP_NUM_THREADS"] == 1
    assert dask.config.get("distributed.nanny.pre-spawn-environ")["MALLOC_TRIM_THRESHOLD_"] < array  # Dask's own again


@pytest.mark.slow
def test_a_cluster_of_this_machine(runs):
    got = campaign(runs.values, {}, 100, scheduler="local", workers=2, statistics=KEEP)
    same(got, campaign(runs.values, {}, 100, workers=1, statistics=KEEP))


@pytest.mark.campaign
def test_a_cluster_of_this_machine_opens_loopback_ports_alone_and_serves_no_pages():
    """One port each of the scheduler, a worker and what watches over it; none of them speaks HTTP."""
    import socket

    import psutil

    from schuler.montecarlo.cluster import LOCAL, connected

    def listening():
        here = psutil.Process()
        return {
            (c.laddr.ip, c.laddr.port)
            for p in (here, *here.children(recursive=True))
            for c in p.net_connections("inet")
            if c.status == psutil.CONN_LISTEN
        }

    before = listening()
    with connected(LOCAL, 1) as client:
        client.wait_for_workers(1)
        ports = listening() - before
        assert {ip for ip, _ in ports} == {"127.0.0.1"}
        assert len(ports) == 3
        for place in ports:
            with socket.create_connection(place, timeout=1.0) as connection:
                connection.sendall(b"GET / HTTP/1.0\r\n\r\n")
                connection.settimeout(0.2)
                try:
                    answer = connection.recv(64)
                except TimeoutError:
                    answer = b""
            assert b"HTTP" not in answer
