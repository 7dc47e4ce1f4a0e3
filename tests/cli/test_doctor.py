"""``schuler doctor``: a working installation is well, and each thing that can break is said with exit code 1."""

import json
import tomllib

import pytest
from command import run
from places import ROOT

from schuler.cli import doctor


@pytest.fixture
def quick(monkeypatch):
    """The self-test replaced by its answer."""
    good = {"duration_s": 1.0, "drift_m": 0.0, "rms_horizontal_m": 1.0, "sigma_gnss_m": 2.0, "nis_mean": 1.0}
    monkeypatch.setattr(doctor, "_drive", lambda: dict(good))
    return good


def test_a_working_installation_is_well(capsys):
    code, out, err = run(capsys, "doctor", "--json")
    data = json.loads(out)
    assert (code, data["faults"]) == (0, []), err
    test = data["self_test"]
    assert test["drift_m"] < 1e-3  # discretisation at 100 Hz
    assert test["rms_horizontal_m"] < test["sigma_gnss_m"]
    assert (
        0.7 < test["nis_mean"] < 1.3
    )  # statistical, with a fixed seed: some 800 degrees of freedom, 5 standard errors
    assert {"numpy", "numba", "scipy"} <= set(data["required"])
    assert data["cache"]["folder"]
    assert data["warm_s"] is None


def test_extras_are_those_of_the_project():
    with open(ROOT / "pyproject.toml", "rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    assert set(doctor.EXTRAS) == set(extras) - {"all", "test", "bench", "docs", "dev"}


def test_a_missing_extra_breaks_nothing(capsys, quick, monkeypatch):
    installed = doctor._version
    monkeypatch.setattr(doctor, "_version", lambda name: None if name == "rosbags" else installed(name))
    code, out, _ = run(capsys, "doctor")
    assert code == 0
    assert "extra ros       missing (rosbags>=0.11)" in out
    assert "pip install 'schuler[ros]'" in out
    assert out.endswith("all is well\n")


@pytest.mark.parametrize("given", [None, "1.9.9"])
def test_a_required_library_that_is_missing_or_old_is_a_fault(given, capsys, quick, monkeypatch):
    installed = doctor._version
    monkeypatch.setattr(doctor, "_version", lambda name: given if name == "numpy" else installed(name))
    code, out, _ = run(capsys, "doctor")
    assert code == 1
    assert "BROKEN: numpy: expected numpy>=2.0, got" in out


@pytest.mark.parametrize(("given", "enough"), [("2", True), ("2.0.1", True), ("10.0rc1", True), ("1.26", False)])
def test_versions_are_compared_as_numbers(given, enough):
    assert doctor._enough(given, "numpy>=2.0") is enough


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("drift_m", 3.0, "a perfect IMU is 3 m off"),
        ("drift_m", float("nan"), "a perfect IMU is nan m off"),
        ("rms_horizontal_m", 2.5, "2.5 m RMS with GNSS"),
        ("nis_mean", 3.0, "mean NIS 3, expected 1"),
        ("nis_mean", 0.2, "mean NIS 0.2, expected 1"),
    ],
)
def test_a_wrong_answer_of_the_self_test_is_a_fault(key, value, message, capsys, quick, monkeypatch):
    monkeypatch.setattr(doctor, "_drive", lambda: {**quick, key: value})
    code, out, _ = run(capsys, "doctor")
    assert code == 1
    assert f"BROKEN: self-test: {message}" in out


def test_a_self_test_that_ends_in_an_error_is_a_fault(capsys, quick, monkeypatch):
    monkeypatch.setattr(doctor, "_drive", lambda: 1 / 0)
    code, out, _ = run(capsys, "doctor", "--json")
    assert code == 1
    assert "ZeroDivisionError" in json.loads(out)["self_test"]["fault"]


def test_a_folder_of_kernels_that_cannot_be_written_is_a_fault(capsys, quick, monkeypatch):
    def refused(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(doctor, "check_writable", refused)
    code, out, _ = run(capsys, "doctor")
    assert code == 1
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in out


def test_warm_says_how_long_it_took(capsys, quick, monkeypatch):
    monkeypatch.setattr(doctor, "warm_up", lambda: 12.3)
    assert "kernels compiled or loaded in 12.3 s" in run(capsys, "doctor", "--warm")[1]


def test_every_kernel_with_a_preparation_is_warmed():
    names = {f.__name__ for f in doctor.preparations()}
    written = {
        line.split("def ")[1].partition("(")[0]
        for path in (ROOT / "src" / "schuler").rglob("*.py")
        if "kernels" in path.as_posix()
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.startswith("def prepare_")
    }
    assert {"prepare_filter", "prepare_smoother", "prepare_strapdown", "prepare_lanes", "prepare_allan"} <= names
    assert names == written
