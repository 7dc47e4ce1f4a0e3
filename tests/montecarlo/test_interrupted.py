"""kill -9 of a whole campaign at half: nothing that was stored is lost or done again, and the end is the same."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from schuler.montecarlo.engine import campaign
from schuler.montecarlo.rows import joined
from schuler.montecarlo.store import read_rows

SCRIPT = """
import json
import sys
import montecarlo_runs
from schuler.montecarlo import campaign

if __name__ == "__main__":
    campaign(montecarlo_runs.counted, json.loads(sys.argv[1]), 160, seed=2, store=sys.argv[2],
             workers=int(sys.argv[3]), batch=4)
"""


def stored(folder):
    return {k for part in folder.glob("part-*") for k in range(int(part.name[5:15]), int(part.name[16:26]) + 1)}


def alive(number):
    """Whether a process runs; one that has ended may wait to be buried by whoever adopted it."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.campaign
@pytest.mark.parametrize("workers", [2, 1])
def test_kill_9_at_half(tmp_path, executions, workers):
    import montecarlo_runs

    path, count = executions
    (tmp_path / "script.py").write_text(SCRIPT)
    folder = tmp_path / "s"
    scenario = {"log": str(path), "sleep": 0.02, "processes": str(tmp_path / "processes.txt")}
    command = [sys.executable, tmp_path / "script.py", json.dumps(scenario), folder, str(workers)]
    process = subprocess.Popen(command)
    deadline = time.monotonic() + 120.0
    while len(stored(folder)) < 80 and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    kept = stored(folder)
    assert 80 <= len(kept) < 160
    # workers end with the process that collected
    begun = {int(line) for line in (tmp_path / "processes.txt").read_text().split()}
    assert len(begun - {process.pid}) == (0 if workers == 1 else 2)
    while any(alive(number) for number in begun):
        assert time.monotonic() < deadline
        time.sleep(0.05)

    job = (montecarlo_runs.counted, scenario, 160)
    again = campaign(*job, seed=2, store=folder, workers=1)
    assert again.complete
    assert again.executed == 160 - len(kept)
    times = count()
    assert set(times) == set(range(160))
    assert all(times[k] == 1 for k in kept)

    undisturbed = campaign(*job, seed=2, store=tmp_path / "undisturbed", workers=1)
    assert (folder / "runs.parquet").read_bytes() == (tmp_path / "undisturbed" / "runs.parquet").read_bytes()
    np.testing.assert_array_equal(again["track"].moments.m2, undisturbed["track"].moments.m2)
    assert len(joined(read_rows(folder)).runs) == 160


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_no_worker_outlives_a_killed_campaign(tmp_path):
    """Not even one that is in the middle of a run of an hour."""
    (tmp_path / "script.py").write_text(SCRIPT)
    pids = tmp_path / "processes.txt"
    pids.touch()
    scenario = {"sleep": 3600.0, "processes": str(pids)}
    process = subprocess.Popen([sys.executable, tmp_path / "script.py", json.dumps(scenario), tmp_path / "s", "2"])
    deadline = time.monotonic() + 120.0
    while len(pids.read_text().split()) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()
    process.wait()
    while any(alive(int(line)) for line in pids.read_text().split()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
