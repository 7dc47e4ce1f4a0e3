"""``schuler allan`` as scripts use it: keys of the JSON, files, exit codes, one-line errors.

What is identified comes from a stand-in here, so that a wrong fit does not look like a wrong command; the last test
runs the real thing.
"""

import importlib.util
import json
import math
import sys
import types
from dataclasses import replace

import noise_cases as cases
import numpy as np
import pytest
from command import answer, refusal, run

import schuler.characterisation.curves  # noqa: F401  # before identification is replaced
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.recording.trajectory import Trajectory

KEYS = {"tau_s", "adev", "adev_low", "adev_high", "terms", "warnings"}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("rest") / "rest.parquet"
    io.write(Recording(imu=cases.recording(120.0), metadata=Metadata(name="rest")), path)
    return path


@pytest.fixture
def identified(monkeypatch):
    """Stands in for the fit; holds what it was called with and what it returns."""
    state = types.SimpleNamespace(noise=cases.identification(name="rest"), asked=None, options=None)

    def identify_noise(recording, **options):
        state.asked, state.options = recording, options
        return state.noise

    module = types.ModuleType("schuler.characterisation.identification")
    module.identify_noise = identify_noise
    monkeypatch.setitem(sys.modules, "schuler.characterisation.identification", module)
    return state


def test_json_has_the_keys_scripts_rely_on(log, identified, tmp_path, capsys):
    code, out, err = run(capsys, "allan", log, "--out", tmp_path, "--no-report", "--json")
    data = json.loads(out)
    assert (code, err) == (0, "")
    assert data["rate_hz"] == 100.0
    assert set(data["axes"]) == {"gyro_x", "gyro_y", "accel_x", "gyro_z"}
    for axis in data["axes"].values():
        assert set(axis) >= KEYS
        assert set(axis["terms"]) == {"N", "B", "K", "R", "Q", "GM"}
        assert len(axis["tau_s"]) == len(axis["adev"]) == len(axis["adev_low"]) == len(axis["adev_high"])
    x = data["axes"]["gyro_x"]
    assert x["terms"]["N"] == {
        "value": pytest.approx(cases.GYRO["N"]), "sigma": pytest.approx(0.02 * cases.GYRO["N"]),
        "low": pytest.approx(cases.GYRO["N"] * math.exp(-0.0392)),
        "high": pytest.approx(cases.GYRO["N"] * math.exp(0.0392)), "unit": "(rad/s)/sqrt(Hz)",
    }  # fmt: skip
    assert x["terms"]["R"] is None
    assert x["terms"]["GM"] == []
    assert [set(pair) for pair in data["axes"]["accel_x"]["terms"]["GM"]] == [{"sigma", "tau"}] * 2
    assert data["axes"]["accel_x"]["terms"]["GM"][1]["tau"]["value"] == 600.0
    assert np.all(np.array(x["adev_low"]) <= np.array(x["adev"]))


def test_findings_and_refused_axes_are_warnings_of_a_success(log, identified, tmp_path, capsys):
    data = answer(capsys, "allan", log, "--out", tmp_path, "--no-report", "--json")
    assert data["axes"]["gyro_z"]["tau_s"] == []
    assert data["axes"]["gyro_z"]["refused"]
    assert "repeats one value" in data["axes"]["gyro_z"]["warnings"][0]
    assert data["refused"]["gyro_z"][0]["code"] == "stuck"
    assert data["findings"][0] == {
        "code": "temperature", "text": cases.WARM.text, "start_s": 0.0, "stop_s": 1800.0, "severity": "warning",
    }  # fmt: skip
    assert data["warnings"] == [cases.STUCK.text, f"recording: {cases.WARM.text}"]
    assert data["axes"]["gyro_x"]["warnings"] == []  # a note is none
    assert data["axes"]["gyro_x"]["findings"][0]["severity"] == "note"


def test_no_axis_left_is_exit_code_2_with_the_reason(log, identified, tmp_path, capsys):
    refused = dict.fromkeys(("gyro_x", "gyro_y", "accel_x"), (cases.STUCK,))
    identified.noise = replace(identified.noise, axes={}, refused=refused, spec=None)
    code, out, err = run(capsys, "allan", log, "--out", tmp_path, "--no-report", "--json")
    assert (code, out) == (2, "")
    assert err.startswith("schuler: rest: no axis could be identified; gyro_x: gyro_z repeats")
    assert err.count("\n") == 1


def test_files(log, identified, tmp_path, capsys, drawn):
    code, out, err = run(
        capsys, "allan", log, "--out", tmp_path / "deep" / "out", "--export", "kalibr", "--export", "px4", "--inflate",
        5,
    )  # fmt: skip
    assert code == 0, err
    folder = tmp_path / "deep" / "out"
    assert {p.name for p in folder.iterdir()} == {
        "imu.toml",
        "imu_kalibr.yaml",
        "imu_px4.params",
        "noise.html",
        "figures",
    }
    assert {p.name for p in (folder / "figures").glob("*.png")} == {
        "allan.png", "allan_axes.png", "allan_ratio.png", "spectrum.png", "signals.png",
    }  # fmt: skip
    from schuler.sensors.spec_file import read_spec

    assert read_spec(folder / "imu.toml") == identified.noise.spec
    assert "noise of 3 axes" in out
    assert "report: " in out
    assert "12000 samples" in err  # what was read
    assert "<!DOCTYPE html>" in (folder / "noise.html").read_text(encoding="utf-8")[:30]


def test_inflation_is_for_exports_only(log, identified, tmp_path, capsys):
    run(capsys, "allan", log, "--out", tmp_path / "a", "--export", "kalibr", "--no-report")
    run(capsys, "allan", log, "--out", tmp_path / "b", "--export", "kalibr", "--no-report", "--inflate", 10)
    assert (tmp_path / "a/imu.toml").read_text() == (tmp_path / "b/imu.toml").read_text()

    def density(folder):
        lines = (tmp_path / folder / "imu_kalibr.yaml").read_text().splitlines()
        text = next(line for line in lines if line.startswith("gyroscope_noise_density"))
        return float(text.partition(":")[2].partition("#")[0])

    assert density("b") == pytest.approx(10.0 * density("a"), rel=1e-3)  # printed digits


def test_without_a_budget_an_export_fails_after_everything_else(log, identified, tmp_path, capsys):
    gyro = {name: axis for name, axis in identified.noise.axes.items() if name.startswith("gyro")}
    identified.noise = replace(identified.noise, axes=gyro, spec=None, spec_sigma={})
    code, out, err = run(capsys, "allan", log, "--out", tmp_path, "--no-report", "--json")
    assert code == 0
    assert "imu.toml was not written" in json.loads(out)["warnings"][-1]
    code, out, err = run(capsys, "allan", log, "--out", tmp_path, "--no-report", "--json", "--export", "kalibr")
    assert code == 2
    assert "imu_kalibr.yaml was not written" in err
    assert "kalibr" not in json.loads(out)["files"]


def test_options_reach_the_library(log, identified, tmp_path, capsys):
    code, _, err = run(
        capsys, "allan", log, "--from", 10, "--to", 70, "--method", "allan", "--robust", "--out", tmp_path,
        "--no-report",
    )  # fmt: skip
    assert code == 0, err
    imu = identified.asked.imu
    assert imu.t[-1] - imu.t[0] == pytest.approx(60.0, abs=0.02)
    assert identified.options["method"] == "allan"
    assert identified.options["robust"] is True
    assert identified.options["name"] == "rest"
    assert identified.options["progress"] is None  # nobody looks
    assert any("Only 10 to 70 s of rest were used" in note for note in identified.asked.metadata.notes)


@pytest.mark.campaign
def test_several_logs_are_pooled(log, identified, tmp_path, capsys):
    code, _, err = run(capsys, "allan", log, log, log, "--out", tmp_path)
    assert code == 0, err
    assert [r.metadata.name for r in identified.asked] == ["rest"] * 3
    assert identified.options["name"] == "rest and 2 more"
    assert not (tmp_path / "figures" / "signals.png").exists()


def test_a_plain_log_with_hints(identified, tmp_path, capsys):
    rows = [f"{10 * k} 0.01 -0.02 {1.0 + 1e-4 * (k % 7):.4f} 0.5 -0.25 0.125" for k in range(400)]
    (tmp_path / "rest.txt").write_text("\n".join(rows), encoding="utf-8")
    hints = ("--columns", "t,ax,ay,az,gx,gy,gz", "--units", "g,deg/s,ms", "--axes", "FLU")
    code, _, err = run(capsys, "allan", tmp_path / "rest.txt", *hints, "--out", tmp_path, "--no-report")
    assert code == 0, err
    np.testing.assert_allclose(identified.asked.imu.gyro[0], np.radians([0.5, 0.25, -0.125]))


def test_the_default_folder_is_named_after_the_log(log, identified, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "allan", log, "--no-report")[0] == 0
    assert [p.name for p in tmp_path.iterdir()] == ["rest-noise"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("missing.csv",), "missing.csv: no such file or folder"),
        ((), "requires an argument"),
        (("{log}", "--from", "80", "--to", "20"), "expected 0 <= FROM < TO in seconds"),
        (("{log}", "--from", "500"), "expected 0 <= FROM < TO in seconds"),
        (("{log}", "--from", "500", "--to", "600"), "no IMU sample lies within"),
        (("{log}", "--export", "kalibre"), "--export: expected one of ardupilot"),
        (("{log}", "--nonsense"), "--nonsense"),
        (("{log}", "--method", "eye"), "eye"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_2(arguments, message, log, identified, capsys):
    assert message in refusal(capsys, "allan", *(a.format(log=log) for a in arguments))


def test_a_log_without_imu_is_refused(identified, tmp_path, capsys):
    track = Trajectory(np.arange(5.0), np.array([6378137.0, 0.0, 0.0]) + np.arange(15.0).reshape(5, 3))
    io.write(Recording(reference=track, metadata=Metadata(name="track")), tmp_path / "track.parquet")
    code, _, err = run(capsys, "allan", tmp_path / "track.parquet")
    assert code == 2
    assert "has no IMU series" in err


needs_identify = pytest.mark.skipif(
    importlib.util.find_spec("schuler.characterisation.identification") is None,
    reason="identification is not there yet",
)


@pytest.mark.campaign
@needs_identify
def test_white_noise_is_found_again(tmp_path, capsys):
    """Half an hour of white noise at 50 Hz through the real command: statistical, N to 2 %, its own intervals."""
    imu = cases.recording(1800.0)
    half = replace(imu, t=imu.t[::2], gyro=imu.gyro[::2], accel=imu.accel[::2])
    io.write(Recording(imu=half, metadata=Metadata(name="white")), tmp_path / "white.parquet")
    data = answer(capsys, "allan", tmp_path / "white.parquet", "--out", tmp_path / "o", "--json", "--no-report")
    true = {"gyro": cases.GYRO["N"] * math.sqrt(2.0), "accel": cases.ACCEL["N"] * math.sqrt(2.0)}
    assert data["rate_hz"] == pytest.approx(50.0)
    for name, axis in data["axes"].items():
        assert axis["terms"]["N"]["value"] == pytest.approx(true[name.partition("_")[0]], rel=0.02), name
    assert (tmp_path / "o" / "imu.toml").exists()


def real_log(path, seconds=900.0, seed=1, spoil=None):
    """Gyroscopes with white noise and flicker, accelerometers with white noise and random walk, at 50 Hz."""
    from schuler.sensors.noise import Flicker, RandomWalk, White

    rng, n = np.random.default_rng(seed), int(50.0 * seconds)
    gyro = (White(2e-4) + Flicker(1e-4)).sample((n, 3), 0.02, rng)
    accel = (White(1e-3) + RandomWalk(2e-4)).sample((n, 3), 0.02, rng) + np.array([0.0, 0.0, -9.80665])
    if spoil is not None:
        spoil(gyro, accel)
    imu = replace(cases.recording(1.0), t=100.0 + np.arange(n) / 50.0, gyro=gyro, accel=accel, temperature=None)
    io.write(Recording(imu=imu, metadata=Metadata(name=path.stem)), path)
    return path


@needs_identify
@pytest.mark.campaign
def test_budget_of_the_real_command(tmp_path, capsys):
    """The file that is written holds the numbers of the JSON, and they are those put in."""
    from schuler.sensors.spec_file import read_spec

    path = real_log(tmp_path / "rest.parquet")
    data = answer(capsys, "allan", path, "--out", tmp_path / "o", "--json", "--no-report")
    assert data["warnings"] == []
    assert data["refused"] == {}
    spec = read_spec(tmp_path / "o" / "imu.toml")
    written, sigma = spec.to_dict(), data["spec_sigma"]
    for triad in ("gyro", "accel"):
        for key, value in data["spec"][triad].items():
            assert written[triad][key] == pytest.approx(value, rel=1e-6), key  # printed digits
    # statistical: three axes; the numbers are what the log's own uncertainty allows
    true = {"gyro": {"random_walk": 2e-4, "bias_instability": 1e-4}, "accel": {"random_walk": 1e-3}}
    for triad, terms in true.items():
        for key, value in terms.items():
            assert abs(math.log(getattr(getattr(spec, triad), key) / value)) < 4.0 * sigma[triad][key], key
    assert spec.accel.rate_random_walk == pytest.approx(2e-4, rel=4.0 * sigma["accel"]["rate_random_walk"])


@pytest.mark.campaign
@needs_identify
def test_warnings_of_a_bad_log_reach_the_script(tmp_path, capsys):
    """A step, a stuck axis and outliers: exit code 0, each in the warnings; --robust and --from take them away."""

    def spoil(gyro, accel):
        gyro[:10_000, 0] += 0.02
        accel[:, 1] = 0.1
        where = np.random.default_rng(8).choice(len(gyro), len(gyro) // 20, replace=False)
        gyro[where, 2] += 0.1

    path = real_log(tmp_path / "bad.parquet", spoil=spoil)
    code, out, err = run(capsys, "allan", path, "--out", tmp_path / "a", "--json", "--no-report")
    assert (code, err) == (0, "")
    data = json.loads(out)
    for part in ("gyro_x: the level shifts by", "accel_y: every sample reads 0.1", "gyro_z: 2250 outliers"):
        assert any(part in text for text in data["warnings"]), part
    step = next(f for f in data["axes"]["gyro_x"]["findings"] if f["code"] == "step")
    assert step["start_s"] == pytest.approx(200.0, abs=2.5)  # blocks of a second
    assert data["axes"]["accel_y"]["refused"]
    assert data["axes"]["gyro_z"]["terms"]["N"]["value"] > 3e-4
    options = ("--out", tmp_path / "b", "--json", "--no-report", "--robust", "--from", 201, "--to", 890)
    code, out, err = run(capsys, "allan", path, *options)
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data["duration_s"] == pytest.approx(689.0, abs=0.1)
    (replaced,) = [text for text in data["warnings"] if "accel_y" not in text]  # one in twenty is more than 3 %
    assert replaced.startswith("gyro_z: ")
    assert "were replaced" in replaced
    assert data["axes"]["gyro_z"]["terms"]["N"]["value"] == pytest.approx(2e-4, rel=0.05)  # as asked for
    assert data["provenance"]["robust"] is True


@pytest.mark.campaign
@needs_identify
def test_two_real_logs_are_pooled(tmp_path, capsys):
    paths = [real_log(tmp_path / f"{name}.parquet", 300.0 + 60.0 * k, k) for k, name in enumerate("ab")]
    _, out, _ = run(capsys, "allan", *paths, "--out", tmp_path / "o", "--json", "--no-report")
    both = json.loads(out)
    assert both["duration_s"] == pytest.approx(660.0, abs=0.1)
    assert both["provenance"]["recordings"] == ["a", "b"]
    for name, axis in both["axes"].items():
        N = axis["terms"]["N"]
        assert N["value"] == pytest.approx(2e-4 if name.startswith("gyro") else 1e-3, rel=0.05)  # statistical
        assert N["low"] <= (2e-4 if name.startswith("gyro") else 1e-3) <= N["high"]


@pytest.mark.campaign
@pytest.mark.realdata
def test_adis16405_through_the_command(shared_data, tmp_path, capsys):
    """N of the gyroscopes against the curve that R's package avar publishes of this recording, at 1 s."""
    from schuler.recording.series import ImuSeries
    from schuler.units import DEG, G0

    folder = shared_data / "adis16405_static"
    archive = np.load(folder / "adis16405_imu1.npz")
    x = (archive["counts"] * archive["lsb"])[:400_000]
    imu = ImuSeries(np.arange(len(x)) / 100.0, x[:, :3] * DEG, x[:, 3:] * G0)
    io.write(Recording(imu=imu, metadata=Metadata(name="adis")), tmp_path / "adis.parquet")
    code, out, err = run(capsys, "allan", tmp_path / "adis.parquet", "--out", tmp_path / "o", "--json", "--no-report")
    assert (code, err) == (0, "")
    data = json.loads(out)
    rows = np.loadtxt(folder / "imu1_oadev_reference_avar_pkg.csv", delimiter=",", comments="#")
    for name, column in (("gyro_x", 1), ("gyro_y", 4), ("gyro_z", 7)):
        curve = np.interp(np.log([0.64, 1.28, 2.56]), np.log(rows[:, 0]), np.log(rows[:, column]))
        published = np.exp(curve) * DEG  # of the whole recording, 2.8 h; here is the first 1.1 h
        here = data["axes"][name]
        adev = np.exp(np.interp(np.log([0.64, 1.28, 2.56]), np.log(here["tau_s"]), np.log(here["adev"])))
        np.testing.assert_allclose(adev, published, rtol=0.05)  # statistical, another part of the recording
        at_1s = math.exp(np.interp(0.0, np.log(rows[:, 0]), np.log(rows[:, column]))) * DEG
        assert here["terms"]["N"]["value"] == pytest.approx(at_1s, rel=0.06), name  # drift adds a few percent at 1 s
    assert data["spec"] is not None
