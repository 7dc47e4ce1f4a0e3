"""Error budgets as files: they come back unchanged, mistakes are named, simulator and navigation use them."""

import re
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT

from schuler.characterisation.exports import EXPORTS, export_text
from schuler.exceptions import ConfigError, FileFormatError, InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.states import imu_spec
from schuler.sensors import ImuSpec, TriadSpec, catalogue
from schuler.sensors.spec_file import read_spec, read_spec_file, spec_text, write_spec
from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

GYRO = TriadSpec.gyro(arw_deg_rthr=0.3, bias_instability_deg_hr=5.0, in_run_deg_hr=10.0, in_run_time_s=300.0)
ACCEL = TriadSpec.accelerometer(vrw_m_s_rthr=0.06, rrw_ug_rthr=40.0, range_g=8.0, resolution_ug=122.0)
SPEC = ImuSpec("my IMU", GYRO, ACCEL, 100.0, "two logs of 3 h")
SIGMA = {"gyro": {"random_walk": 0.01, "bias_instability": 0.1}, "accel": {"random_walk": 1.0 / 3.0}}
AXES = {
    "gyro_x": {"random_walk": 8.1e-5, "gauss_markov": [[4.8e-5, 300.0], [1e-5, 20.0]]},
    "accel_z": {"random_walk": 1e-3},
}


FULL = [n for n in catalogue.names() if catalogue.entry(n).gyro and catalogue.entry(n).accel]


@pytest.mark.parametrize("name", FULL)
def test_every_entry_of_the_catalogue_comes_back_unchanged(tmp_path, name):
    spec = catalogue.spec(name)
    assert read_spec(write_spec(tmp_path / "imu.toml", spec)) == spec


magnitudes = st.floats(min_value=0.0, max_value=1e300, allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-300, max_value=1e300)


@settings(max_examples=5, deadline=None)
@given(
    st.text(), st.text(), magnitudes, magnitudes, positive, positive, st.none() | positive, st.none() | positive
)  # fmt: skip
def test_any_number_and_any_text_come_back_unchanged(tmp_path_factory, name, source, N, K, sigma, tau, span, rate):
    """Equality, not closeness: numbers are written with all the digits they need."""
    triad = TriadSpec(random_walk=N, rate_random_walk=K, in_run_bias=sigma, in_run_time=tau, range=span)
    spec = ImuSpec(name, triad, triad, rate, source)
    path = tmp_path_factory.getbasetemp() / "any.toml"
    try:
        write_spec(path, spec)
    except UnicodeEncodeError:  # half of a surrogate pair is no text
        return
    assert read_spec(path) == spec


def test_uncertainty_axes_and_provenance_come_back(tmp_path):
    provenance = {"schuler": "0.2", "sources": [{"path": 'a "b"\\c', "sha256": "00"}], "robust": True, "n": 3}
    path = write_spec(tmp_path / "imu.toml", SPEC, SIGMA, AXES, provenance)
    read_back = read_spec_file(path)
    assert read_back.spec == SPEC
    assert read_back.sigma == SIGMA
    assert read_back.axes == AXES
    assert read_back.provenance == provenance


def test_every_number_has_its_unit_beside_it():
    lines = [line for line in spec_text(SPEC, SIGMA, AXES).splitlines() if " = " in line]
    numbers = [line for line in lines if not line.startswith(("format", "version", "name", "source"))]
    assert all("#" in line for line in numbers)
    assert any(line.endswith("# angle random walk N [(rad/s)/sqrt(Hz)] = 0.3 deg/sqrt(h)") for line in lines)
    assert any(line.endswith("# velocity random walk N [(m/s^2)/sqrt(Hz)] = 0.06 m/s/sqrt(h)") for line in lines)


def test_the_text_depends_on_nothing_but_the_input():
    assert spec_text(SPEC, SIGMA, AXES) == spec_text(SPEC, SIGMA, AXES)
    tomllib.loads(spec_text(SPEC, SIGMA, AXES, {"none": None, "a b": {"c-d": [1, 2.5]}}))


HEAD = 'format = "schuler-imu-spec"\nversion = 1\nname = "x"\n'
TRIADS = "[gyro]\nrandom_walk = 1e-4\n[accel]\nrandom_walk = 1e-3\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = [", "not a TOML file"),
        (TRIADS, "expected format = 'schuler-imu-spec' at the top of an IMU specification, got None"),
        (HEAD.replace("1", "2") + TRIADS, "expected version = 1, got 2; a later version needs a later schuler"),
        (HEAD + "[gyro]\nrandom_walk = 1e-4\n", "expected the entry 'accel', got format, version, name, gyro"),
        (HEAD + "rate = 3.0\n" + TRIADS, "unknown entry 'rate'; did you mean rate_hz"),
        (HEAD + TRIADS.replace("random", "randm"), r"\[gyro\]: triad: unknown entry 'randm_walk'; did you mean random"),
        (HEAD + TRIADS.replace("1e-4", "-1e-4"), r"\[gyro\]: random_walk: expected a finite 1-sigma value, not neg"),
        (HEAD + TRIADS.replace("1e-4", "nan"), r"\[gyro\]: random_walk: expected a finite"),
        (HEAD + TRIADS.replace("1e-4", '"a"'), r"\[gyro\]: random_walk: expected one number, got 'a'"),
        (HEAD + "gyro = 3\n[accel]\nrandom_walk = 1e-3\n", r"\[gyro\]: expected a table, got 3"),
        (HEAD + TRIADS + "in_run_bias = 1.0\n", r"\[accel\]: expected both in_run_bias and in_run_time"),
        (HEAD.replace('"x"', "3") + TRIADS, "name: expected text in quotes, got 3"),
        (HEAD + "rate_hz = true\n" + TRIADS, "rate_hz: expected a finite number, not negative, got True"),
        (HEAD + TRIADS + "[uncertainty.gyros]\nrandom_walk = 0.1\n", "unknown entry 'gyros'; did you mean gyro"),
        (HEAD + TRIADS + "[uncertainty.gyro]\nrandom_wak = 0.1\n", "unknown entry 'random_wak'; did you mean random_w"),
        (HEAD + TRIADS + "[uncertainty.gyro]\nrandom_walk = -1.0\n", r"\[uncertainty.gyro\] random_walk: expected"),
        (HEAD + TRIADS + "[axes.gyro_w]\nrandom_walk = 0.1\n", "unknown entry 'gyro_w'; did you mean gyro_"),
        (HEAD + TRIADS + "[axes.gyro_x]\ngauss_markov = [1.0]\n", r"expected a list of \[sigma, tau in s\]"),
        (HEAD + TRIADS + "[axes.gyro_x]\ngauss_markov = 1.0\n", r"expected a list of \[sigma, tau in s\]"),
        (HEAD + TRIADS + "[axes.gyro_x]\ngauss_markov = [[1.0, -2.0]]\n", "gauss_markov: expected a finite number"),
        (HEAD + TRIADS + "[axes]\ngyro_x = 1.0\n", r"\[axes.gyro_x\]: expected a table"),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path, text, message):
    path = tmp_path / "imu.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_spec(path)
    assert str(caught.value).startswith(str(path))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(FileFormatError, match="no such file; expected an IMU specification"):
        read_spec(tmp_path / "no.toml")
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_spec(tmp_path)


def test_numbers_of_numpy_and_infinite_uncertainty(tmp_path):
    sigma = {"gyro": {"random_walk": float("inf"), "bias_instability": np.float64(0.1)}}
    axes = {"gyro_x": {"random_walk": np.float64(1e-5), "gauss_markov": [[np.float64(1e-5), 20.0]]}}
    path = write_spec(tmp_path / "imu.toml", SPEC, sigma, axes, {"rate": np.float64(3.5), "n": np.int64(3)})
    read_back = read_spec_file(path)
    assert read_back.sigma == sigma
    assert read_back.axes == axes
    assert read_back.provenance == {"rate": 3.5, "n": "3"}


def test_nothing_wrong_is_written(tmp_path):
    with pytest.raises(InputError, match="unknown entry 'N'"):
        write_spec(tmp_path / "imu.toml", SPEC, {"gyro": {"N": 0.1}})
    with pytest.raises(InputError, match="finite number"):
        write_spec(tmp_path / "imu.toml", SPEC, axes={"gyro_x": {"random_walk": float("nan")}})
    assert not list(tmp_path.iterdir())


SCENARIO = """\
seed = 3
[motion]
type = "static"
lat_deg = 47.0
lon_deg = 8.0
duration_s = 20.0
[imu]
spec = "imus/mine.toml"
"""


@pytest.fixture
def folder(tmp_path):
    write_spec(tmp_path / "imus" / "mine.toml", SPEC)
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    (tmp_path / "drive.toml").write_text('[imu]\nspec = "imus/mine.toml"\n')
    return tmp_path


def test_a_scenario_reads_its_imu_from_a_file_beside_it(folder, monkeypatch):
    monkeypatch.chdir("/")
    mission = prepare_mission(folder / "scenario.toml")
    assert mission.spec == SPEC
    again = simulate_mission(mission).recording.metadata.options["scenario"]
    assert prepare_mission(again).spec == SPEC  # the scenario in the recording still finds the file


def test_navigation_reads_its_imu_from_a_file_beside_the_configuration(folder, monkeypatch):
    monkeypatch.chdir("/")
    assert imu_spec(NavigationConfig.load(folder / "drive.toml")) == SPEC


def test_without_a_file_the_path_is_relative_to_the_working_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert imu_spec(NavigationConfig.parse({"imu": {"spec": "imus/mine.toml"}})) == SPEC


def test_what_is_wrong_with_the_file_is_a_fault_of_the_configuration(folder):
    (folder / "imus" / "mine.toml").write_text(HEAD + TRIADS.replace("random", "randm"))
    for run in (lambda: prepare_mission(folder / "scenario.toml"),
                lambda: imu_spec(NavigationConfig.load(folder / "drive.toml"))):  # fmt: skip
        with pytest.raises(ConfigError, match=r"imu.spec: .*mine.toml: \[gyro\]: triad: unknown entry 'randm_walk'"):
            run()


@pytest.mark.parametrize("other", ['catalogue = "VN-200"', "gyro = {arw_deg_rthr = 0.1}\naccel = {vrw_m_s_rthr = 0.1}"])
def test_one_source_only(folder, other):
    for name, load, message in (
        ("scenario.toml", Scenario.load, "give one of catalogue"),
        ("drive.toml", NavigationConfig.load, "give either catalogue"),
    ):
        path = folder / name
        path.write_text(path.read_text() + other + "\n")
        with pytest.raises(ConfigError, match=message):
            load(path)


def test_the_file_in_the_documentation_is_one(tmp_path):
    page = (ROOT / "docs" / "noise-exports.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    (tmp_path / "imu.toml").write_text(block)
    read_back = read_spec_file(tmp_path / "imu.toml")
    assert block in spec_text(read_back.spec, read_back.sigma, read_back.axes, read_back.provenance)


def test_every_export_and_key_is_in_the_documentation():
    page = (ROOT / "docs" / "noise-exports.md").read_text(encoding="utf-8")
    for name in EXPORTS:
        assert f"`{name}`" in page or f'"{name}"' in page, name
    for name in ("kalibr", "vins", "kf-gins", "px4", "ardupilot"):
        text = export_text(SPEC, name)
        keys = re.findall(r"^(?:1\t1\t)?\s*(\w+)(?:: [-\d\[]|,|\t)", text, flags=re.MULTILINE)
        assert len(keys) >= 4
        assert all(f"`{key}`" in page for key in keys), keys
