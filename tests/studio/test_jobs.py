"""Jobs: state is what lies on disk, so that a killed worker is said and a new server finds what runs."""

import os
import signal
import time

import pytest

from schuler.exceptions import InputError
from schuler.studio import jobs
from schuler.studio.workspace import Workspace


@pytest.fixture
def folder(tmp_path):
    return Workspace(tmp_path.resolve())


def ended(folder, key, seconds=60.0):
    until = time.monotonic() + seconds
    while (found := jobs.job(folder, key)).state == "running":
        assert time.monotonic() < until
        time.sleep(0.05)
    return found


def test_an_answer_a_refusal_and_a_kill_are_told_apart(folder):
    good = jobs.start(folder, ["catalogue", "MPU-6000", "--json"], ".")
    assert good.state == "running"
    with pytest.raises(InputError, match="has not ended writes there"):
        jobs.start(folder, ["catalogue", "MPU-6000", "--json"], ".")
    assert ended(folder, good.key).state == "done"
    assert jobs.answer(folder, good.key)["command"] == "catalogue"
    bad = ended(folder, jobs.start(folder, ["navigate", "none.csv", "--config", "none.toml"], "run").key)
    assert bad.state == "refused"
    assert "none.toml" in bad.message
    killed = jobs.start(folder, ["navigate", "none.csv", "--config", "none.toml"], "run")
    os.kill(killed.pid, signal.SIGKILL)
    assert ended(folder, killed.key).state == "killed"
    assert [job.state for job in jobs.jobs(folder)] == ["killed", "refused", "done"]  # the latest first
    assert jobs.latest(folder, "navigate", "none.csv").key == killed.key
    assert jobs.latest(folder, "navigate", "other.csv") is None


def test_a_job_that_is_cancelled_leaves_nothing(folder):
    job = jobs.start(folder, ["catalogue", "--json"], "run")
    jobs.cancel(folder, job.key)
    assert ended(folder, job.key).state == "cancelled"
    assert not (folder.root / "run").exists()


def test_another_server_finds_a_job_that_runs_and_its_end(folder, monkeypatch):
    job = jobs.start(folder, ["catalogue", "MPU-6000", "--json"], ".")
    own = dict(jobs._children)
    monkeypatch.setattr(jobs, "_children", {})  # as of a process that did not start it
    assert jobs.job(folder, job.key).state == "running"
    own[job.key].wait(60.0)
    assert jobs.job(folder, job.key).state == "done"


def test_keys_that_lead_out_of_the_folder_are_no_jobs(folder):
    assert jobs.job(folder, "../../etc") is None
    assert jobs.job(folder, "") is None
