"""Jobs: state is what lies on disk, so that a killed worker is said and a new server finds what runs."""

import json
import os
import signal
import time

import numpy as np
import pytest

from schuler import cli
from schuler.exceptions import InputError
from schuler.studio import jobs
from schuler.studio.workspace import Workspace


@pytest.fixture
def folder(tmp_path):
    made = Workspace(tmp_path.resolve())
    yield made
    if (kept := jobs._workers.pop(made.root, None)) is not None:
        kept[0].close()
        kept[0].process.wait(60.0)


def ended(folder, key, seconds=60.0):
    until = time.monotonic() + seconds
    while (outcome := jobs.job(folder, key)).state == "running":
        assert time.monotonic() < until
        time.sleep(0.05)
    return outcome


@pytest.mark.campaign
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
    killed = jobs.start(folder, ["catalogue", "--json"], "run")
    os.kill(killed.pid, signal.SIGKILL)
    assert ended(folder, killed.key).state == "killed"
    assert [job.state for job in jobs.jobs(folder)] == ["killed", "refused", "done"]  # the latest first
    assert jobs.latest(folder, "navigate", "none.csv").key == bad.key
    assert jobs.latest(folder, "navigate", "other.csv") is None


@pytest.mark.campaign
def test_what_is_waited_for_goes_to_one_process_and_answers_as_the_command_does(folder, capsys):
    """A log at rest, whose calibration is refused: twice by the worker and once by the command, with the same words."""
    rng = np.random.default_rng(6)
    readings = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -9.8]) + rng.standard_normal((600, 6)) * np.repeat((1e-4, 1e-2), 3)
    table = np.column_stack((np.arange(600) / 50.0, readings))
    head = "t [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]"
    np.savetxt(folder.root / "rest.csv", table, delimiter=",", header=head, comments="")
    answers, pids = [], set()
    for out in ("first", "second"):
        job = jobs.start(folder, ["calibrate", "freepose", "rest.csv", "--out", out, "--json"], out)
        pids.add(job.pid)
        if out == "first":  # while it has something to do, others get processes of their own
            other = jobs.start(folder, ["navigate", "none.csv", "--config", "none.toml"], "other")
            assert other.pid != job.pid
            assert ended(folder, other.key).state == "refused"
        assert ended(folder, job.key).state == "done"  # refused, and it wrote why
        assert (folder.root / out / "calibration.html").is_file()
        answers.append(jobs.answer(folder, job.key))
    assert len(pids) == 1
    assert cli.main(["calibrate", "freepose", str(folder.root / "rest.csv"), "--out", str(folder.root / "c"), "--json"])
    answers.append(json.loads(capsys.readouterr().out))
    assert answers[0]["status"] == "refused"
    first, *others = ({k: v for k, v in answer.items() if k not in ("elapsed_s", "files")} for answer in answers)
    assert all(other == first for other in others)


@pytest.mark.campaign
def test_a_worker_that_was_killed_is_followed_by_another_and_ends_with_its_server(folder):
    jobs.prepare(folder)
    kept, _ = jobs._workers[folder.root]
    kept.process.kill()
    kept.process.wait(60.0)
    job = jobs.start(folder, ["navigate", "none.csv", "--config", "none.toml"], "run")
    assert job.pid != kept.process.pid
    assert ended(folder, job.key).state == "refused"
    again = jobs.start(folder, ["navigate", "none.csv", "--config", "none.toml"], "run")
    assert again.pid == job.pid
    jobs._workers.pop(folder.root)[0].close()  # the server ends: what was begun goes on
    assert ended(folder, again.key).state == "refused"
    assert jobs._children[job.key].wait(60.0) == 0


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
