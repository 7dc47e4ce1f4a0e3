"""The folder: nothing outside of it, its logs and runs, removal of what commands wrote and of nothing else."""

import json
import os

import pytest
from places import EXAMPLES

from schuler.exceptions import InputError
from schuler.files import LISTED
from schuler.studio.uploads import LARGEST, receive, target_of
from schuler.studio.workspace import (
    Workspace,
    configurations,
    delete_run,
    identified_imus,
    logs,
    missions,
    new_run_name,
    runs,
    studies,
    workspace_of,
    write_mission,
)


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "drives"
    run = root / "drive-run-1"
    run.mkdir(parents=True)
    (root / "drive.csv").write_text("1,2")
    (root / "drive.toml").write_text("")
    (root / ".hidden").write_text("")
    (tmp_path / "secret.csv").write_text("not yours")
    (run / "metrics.json").write_text(json.dumps({"verdict": {"status": "ok"}, "rms_horizontal_m": 0.1}))
    (run / "run.json").write_text(json.dumps({"log": "drive.csv", "config": {}}))
    (run / LISTED).write_text(json.dumps({"files": {"metrics.json": [], "run.json": []}}))
    return Workspace(root.resolve())


@pytest.mark.parametrize(
    "name", ["../secret.csv", "/etc/passwd", "a/../../secret.csv", ".hidden", "x/.git/config", "\0"]
)
def test_paths_outside_and_hidden_ones_are_refused(folder, name):
    with pytest.raises(InputError, match="expected a file of the folder"):
        folder.inside(name)


def test_a_link_that_leads_out_is_refused(folder):
    os.symlink(folder.root.parent / "secret.csv", folder.root / "link.csv")
    with pytest.raises(InputError, match="outside"):
        folder.inside("link.csv")


def test_what_is_in_it(folder):
    assert logs(folder) == ["drive.csv"]
    assert configurations(folder) == ["drive.toml"]
    assert [(run.name, run.status) for run in runs(folder)] == [("drive-run-1", "ok")]
    assert new_run_name(folder, "drive.csv") == "drive-run-2"


def test_damaged_runs_are_left_out(folder):
    (folder.root / "drive-run-1" / "metrics.json").write_text("{")
    assert runs(folder) == []


def test_a_run_is_removed_only_if_commands_wrote_all_of_it(folder):
    note = folder.root / "drive-run-1" / "notes.txt"
    note.write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt, which no command wrote"):
        delete_run(folder, "drive-run-1")
    assert note.exists()
    note.unlink()
    delete_run(folder, "drive-run-1")
    assert not (folder.root / "drive-run-1").exists()
    for name in (".", "", "drive.csv", "../drives"):
        with pytest.raises(InputError):
            delete_run(folder, name)


def test_folder_or_files_of_one(folder, tmp_path):
    assert workspace_of((folder.root,)) == (folder, None)
    assert workspace_of((folder.root / "drive.csv", folder.root / "drive.toml")) == (folder, "drive.csv")
    with pytest.raises(InputError, match="files of one"):
        workspace_of((folder.root / "drive.csv", tmp_path / "secret.csv"))
    with pytest.raises(InputError, match="no such file"):
        workspace_of((tmp_path / "none",))


def stream(*blocks):
    async def run():
        for block in blocks:
            yield block

    return run()


def arrive(target, blocks, size):
    import asyncio

    return asyncio.run(receive(target, blocks, size))


def test_uploads_are_complete_or_not_there(folder):
    target = target_of(folder, "new.bin", 6)
    assert arrive(target, stream(b"abc", b"def"), 6) == 6
    assert target.read_bytes() == b"abcdef"
    with pytest.raises(InputError, match="expected 6 bytes, got 3"):
        arrive(target_of(folder, "cut.bin", 6), stream(b"abc"), 6)
    assert not (folder.root / "cut.bin").exists()


@pytest.mark.parametrize("name", ["", "..", ".x", "a/b", "a\\b", "../secret.csv", "drive.csv", "x" * 300, "a\nb"])
def test_uploads_have_a_new_plain_name(folder, name):
    with pytest.raises(InputError):
        target_of(folder, name, 3)


def test_uploads_are_bounded(folder, monkeypatch):
    with pytest.raises(InputError, match="at most 4 GiB"):
        target_of(folder, "big.bin", LARGEST + 1)
    monkeypatch.setattr("schuler.studio.uploads.LARGEST", 5)
    with pytest.raises(InputError, match="at most"):  # a size that was not stated, or not the true one
        arrive(target_of(folder, "big.bin", None), stream(b"abc", b"def"), None)
    assert not (folder.root / "big.bin").exists()


def test_missions_are_what_a_budget_can_be_made_of(folder):
    (folder.root / "town.toml").write_text((EXAMPLES / "town.toml").read_text())  # a simulation: it has an IMU
    (folder.root / "broken.toml").write_text("[motion")
    assert missions(folder) == []
    assert [write_mission(folder), write_mission(folder)] == ["mission.toml", "mission-2.toml"]
    assert missions(folder) == ["mission-2.toml", "mission.toml"]
    assert (folder.root / "mission.toml").read_text() == (EXAMPLES / "budget_town.toml").read_text()
    noise = folder.root / "rest-noise-1"
    noise.mkdir()
    (noise / "imu.toml").write_text("")
    assert identified_imus(folder) == ["rest-noise-1/imu.toml"]


def test_studies_are_what_monte_carlo_and_platforms_can_be_made_of(folder):
    before = studies(folder)
    assert set(before.values()) <= {"montecarlo"}
    names = [write_mission(folder, kind) for kind in ("campaign", "rotary", "mission")]
    assert names == ["campaign.toml", "rotary.toml", "mission.toml"]
    assert studies(folder) == {**before, "campaign.toml": "montecarlo", "rotary.toml": "rotary"}
    for name, example in (("campaign", "montecarlo_hour"), ("rotary", "rotary_static")):
        assert (folder.root / f"{name}.toml").read_text() == (EXAMPLES / f"{example}.toml").read_text()
    (folder.root / "town.toml").write_text((EXAMPLES / "town.toml").read_text())
    assert studies(folder)["town.toml"] == "montecarlo"
