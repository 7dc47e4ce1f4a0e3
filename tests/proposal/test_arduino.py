"""An Arduino's log and a phone's NMEA in a folder, navigated without a configuration."""

import numpy as np
import pytest
from command import answer, refusal, run
from messy_folders import arduino

import schuler
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.recording.trajectory import Trajectory


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return arduino(tmp_path_factory.mktemp("arduino"))


@pytest.fixture(scope="module")
def proposal(folder):
    return schuler.propose(folder.path, given={"filter.tune": False})  # tuning is tested where it is made


def rms(folder, recording, config):
    """Horizontal error beside the truth. [m]"""
    result = schuler.navigate(recording, config)
    later = recording.metadata.time.epoch_gps_s - folder.truth.metadata.time.epoch_gps_s
    fixes = folder.truth.gnss
    errors = trajectory_errors(result.trajectory, Trajectory.from_geodetic(fixes.t - later, fixes.llh, fixes.v_n))
    return float(np.sqrt(np.mean(errors.horizontal**2)))


def test_units_clock_and_axes_are_those_the_folder_was_made_with(folder, proposal):
    values = {d.entry: d.value for d in proposal.decisions if d.value is not None}
    assert values["recording.imu.axes"] == "RUB"
    assert values["recording.imu.units"] == "accel=g,gyro=deg/s"
    later = proposal.recording.metadata.time.epoch_gps_s - folder.truth.metadata.time.epoch_gps_s
    first = proposal.recording.imu.t[0] + later + proposal.config.imu.clock_shift_s
    assert first == pytest.approx(folder.truth.imu.t[0], abs=0.1)  # statistical: 0.01 s, 1-sigma, as claimed


def test_it_is_as_good_as_the_configuration_of_one_who_knows(folder, proposal):
    hand = schuler.read(
        folder.path,
        imu={
            "file": "LOG0042.TXT", "columns": "t,ax,ay,az,-,gx,gy,gz", "units": "g,deg/s,ms", "axes": "RUB",
            "time": "gps-tow:2314", "offset": 492800.0 + folder.clock_s,
        },
        gnss={"file": "phone.nmea"},
    )  # fmt: skip
    config = {"imu": {"catalogue": "consumer"}, "aiding": {"non_holonomic": {}}, "filter": {"tune": False}}
    ours, theirs = (rms(folder, *pair) for pair in ((proposal.recording, proposal.config), (hand, config)))
    assert ours < 1.3 * theirs  # the bound


def test_the_configuration_written_gives_the_same_numbers(folder, proposal, tmp_path):
    path = tmp_path / "drive.toml"
    path.write_text(proposal.toml(), encoding="utf-8")
    config = schuler.NavigationConfig.load(path)
    again = schuler.navigate(schuler.read(proposal.log, **config.recording), config)
    once = schuler.navigate(proposal.recording, proposal.config)
    assert np.array_equal(again.trajectory.r_eb_e, once.trajectory.r_eb_e)


@pytest.mark.campaign
def test_the_command_writes_it_beside_the_result(folder, capsys, tmp_path):
    numbers = answer(
        capsys, "init", folder.path, "--out", tmp_path / "a.toml", "--no-trials", "--set", "imu.catalogue=MPU-6000",
        "--json",
    )  # fmt: skip
    assert {"entry": "imu.catalogue", "value": "MPU-6000", "evidence": "as said"} in numbers["decisions"]
    assert 'catalogue = "MPU-6000"' in (tmp_path / "a.toml").read_text(encoding="utf-8")
    (tmp_path / "b.toml").write_text("# by hand\n")
    code, _, err = run(capsys, "init", folder.path, "--out", tmp_path / "b.toml", "--no-trials")
    assert code == 2
    assert "--force" in err


@pytest.mark.campaign
def test_a_part_of_a_log_has_a_proposal_of_its_own(folder, capsys, tmp_path):
    options = ("--no-trials", "--set", "imu.catalogue=MPU-6000", "--from", "10", "--to", "100")
    answer(capsys, "init", folder.path, "--out", tmp_path / "part.toml", *options, "--json")
    text = (tmp_path / "part.toml").read_text(encoding="utf-8")
    assert "--config drive.toml --from 10 --to 100\n" in text
    assert 'axes = "RUB"' in text
    part = schuler.propose(folder.path, given={"imu.catalogue": "MPU-6000"}, trials=False, part=(10.0, 100.0))
    assert part.toml() == text
    t = part.recording.imu.t
    assert t[-1] - t[0] == pytest.approx(90.0, abs=0.05)  # discretisation: samples at 50 Hz or more, with jitter
    assert "expected 0 <= FROM < TO" in refusal(capsys, "init", folder.path, "--from", "100", "--to", "10")


@pytest.mark.campaign
@pytest.mark.campaign
def test_noise_is_tuned_without_a_configuration_and_written_with_all_that_was_decided(folder, capsys, tmp_path):
    out = tmp_path / "drive.toml"
    assert "no --imu with it" in refusal(capsys, "tune", folder.path, "--config", "drive.toml", "--imu", "a")
    data = answer(capsys, "tune", folder.path, "--out", out, "--json")
    assert data["better"]
    text = out.read_text(encoding="utf-8")
    assert "schuler tune: " in text
    config = schuler.NavigationConfig.load(out)
    assert config.filter.tune is False
    assert config.recording["imu"]["axes"] == "RUB"


def test_what_two_files_could_be_is_one_question(folder, capsys, tmp_path):
    for name in ("left.csv", "right.csv"):
        (tmp_path / name).write_bytes((folder.path / "LOG0042.TXT").read_bytes())
    message = refusal(capsys, "navigate", tmp_path)
    assert "which is meant" in message
    assert "--set recording.imu.file=" in message
