"""Calibration files: exact round trip, text a person can read, refusals that say what to do."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
import result_cases as cases
import yaml

from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult, Residuals, result_from
from schuler.calibration.result.result_file import read_result, result_text, write_result
from schuler.exceptions import FileFormatError, InputError


def same(a, b):
    """Equal to the last bit, NaN equal to NaN."""
    if isinstance(a, Residuals):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(Residuals))
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.shape == b.shape and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, float) and math.isnan(a):
        return isinstance(b, float) and math.isnan(b)
    return type(a) is type(b) and a == b


def undetermined():
    result = cases.full()
    C = result.covariance.copy()
    C[3, :] = C[:, 3] = 0.0
    C[3, 3] = np.inf
    return replace(result, covariance=C, status="refused", temperature=None, residuals={}, history=None)


NOTHING = CalibrationResult("data sheet", (), np.empty(0), np.empty((0, 0)), "upper", fixed={"b_a_x": 1e-5})
BARE = result_from("sixposition", {"b_a_x": (1e-5, 1e-17), "Q_a_x": (-3e-7, 2e-8), "r_a_xy": (0.01, 1e-3)}, "lower")
EMPTY_RESIDUALS = replace(BARE, residuals={"accel": Residuals((), np.empty(0), np.empty(0), "m/s^2")})


@pytest.mark.parametrize(
    "result",
    [cases.full(), cases.full().in_gauge("symmetric"), undetermined(), NOTHING, BARE, EMPTY_RESIDUALS],
    ids=["full", "symmetric", "undetermined", "nothing estimated", "bare", "empty residuals"],
)
def test_round_trip_is_exact(result, tmp_path):
    path = write_result(result, tmp_path / "deep" / "unit.yaml")
    back = read_result(path)
    for entry in fields(CalibrationResult):
        assert same(getattr(result, entry.name), getattr(back, entry.name)), entry.name
    assert result_text(back) == path.read_text(encoding="utf-8")


def test_methods_of_the_result_do_the_same(tmp_path):
    path = cases.full().to_yaml(tmp_path / "a.yaml")
    assert same(CalibrationResult.from_yaml(path).values, cases.full().values)


def test_any_yaml_reader_gets_the_numbers():
    """No reader of ours needed: numbers are numbers, not words such as 1e-05 in YAML 1.1."""
    data = yaml.safe_load(result_text(BARE))
    assert data["parameters"] == {"b_a_x": 1e-5, "Q_a_x": -3e-7, "r_a_xy": 0.01}
    assert all(isinstance(v, float) for row in data["covariance"] for v in row)
    assert data["gauge_in_words"].startswith("M_a is lower triangular")


def test_comments_have_meaning_unit_and_data_sheet_value():
    result = result_from("m", {"b_a_x": (0.0980665, 0.000980665), "M_g_zx": (0.002, 1e-4)}, "full",
                         fixed={"delay": 0.002})  # fmt: skip
    text = result_text(result)
    assert "  b_a_x: 0.0980665  # bias of the x accelerometer [m/s^2], +10.00 +- 0.10 mg\n" in text
    assert "  M_g_zx: 0.002  # what the z gyroscope feels of x [-], +2.00 +- 0.10 mrad\n" in text
    assert "  delay: 0.002  # delay of the gyroscopes behind the accelerometers [s], +2 ms\n" in text
    assert "\n- [0.0, 1.0e-08]  # M_g_zx\n" in text
    assert "not determined" in result_text(undetermined())


def test_arrays_and_tuples_become_lists(tmp_path):
    result = cases.full(extra={"a": np.arange(3), "b": (1, 2), "c": np.float64(2.5), "p": tmp_path, 3: [np.int64(4)]})
    back = read_result(write_result(result, tmp_path / "a.yaml"))
    assert back.extra == {"a": [0, 1, 2], "b": [1, 2], "c": 2.5, "p": str(tmp_path), "3": [4]}


def test_what_yaml_cannot_hold_is_refused_and_no_file_is_left(tmp_path):
    with pytest.raises(InputError, match=r"extra\.fit: expected numbers, text, lists or tables, got set"):
        write_result(cases.full(extra={"fit": {1, 2}}), tmp_path / "a.yaml")
    assert list(tmp_path.iterdir()) == []


TEXT = result_text(result_from("m", {"b_a_x": (0.1, 0.01), "b_a_y": (0.2, 0.01)}, "full", temperature=20.0,
                               residuals={"accel": cases.residuals(2)}))  # fmt: skip


def refused(text, tmp_path):
    path = tmp_path / "edited.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError) as caught:
        read_result(path)
    assert str(caught.value).startswith(str(path))
    return str(caught.value)


def test_small_numbers_without_a_point_are_numbers(tmp_path):
    """YAML 1.1 reads 1e-3 as a word; a person means a number."""
    path = tmp_path / "a.yaml"
    path.write_text(TEXT.replace("b_a_x: 0.1 ", "b_a_x: 1e-3 ").replace("- [0.0001]", "- [1e-4]"))
    assert read_result(path)["b_a_x"] == (0.001, pytest.approx(0.01))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format: schuler-calibration", "format: schuler-imu-spec", "expected format: schuler-calibration at the top"),
        ("format: schuler-calibration\n", "", "at the top of a calibration, got None"),
        ("version: 1", "version: 2", "expected version: 1, got 2; a later version needs a later schuler"),
        ("version: 1", "version: true", "expected version: 1, got True"),
        ("method: m\n", "", "expected the entry 'method'"),
        ("gauge: full", "gauge: diagonal", "gauge: expected one of full, lower, upper, symmetric, got 'diagonal'"),
        ("status: ok", "status: fine", "status: expected one of ok, warning, refused, got 'fine'"),
        ("temperature: 20.0", "temprature: 20.0", "unknown entry 'temprature'; did you mean temperature?"),
        ("temperature: 20.0", "temperature: warm", "temperature: expected a number, got 'warm'"),
        ("  b_a_x: 0.1 ", "  b_a_w: 0.1 ", "parameters: parameter: expected a name such as b_a_x"),
        ("  b_a_x: 0.1 ", "  b_a_x: .nan ", "parameters b_a_x: expected a finite number"),
        ("  b_a_x: 0.1 ", "  b_a_x: [1] ", "parameters b_a_x: expected a number, got [1]"),
        ("  b_a_x: 0.1 ", "  b_a_z: 0.3\n  b_a_x: 0.1 ", "a row and a column go with each parameter"),
        ("- [0.0001]", "- [-0.0001]", "no negative variance"),
        ("- [0.0001]", "- [.nan]", "covariance: expected numbers"),
        ("- [0.0, 0.0001]", "- [0.001, 0.0001]", "correlations beyond 1; a number was changed by hand"),
        ("- [0.0, 0.0001]", "- [0.0001]", "expected the lower triangle, rows of 1 to 2 numbers"),
        ("nominal: {accel: 1.0", "nominal: {acceleration: 1.0", "nominal: unknown entry 'acceleration'; did you"),
        ("nominal: {accel: 1.0", "nominal: {accel: 0.0", "nominal: expected positive factors"),
        ("freedom: 0", "freedom: few", "freedom: expected a number of degrees of freedom"),
        ("verdicts: []", "verdicts: none", "verdicts: expected a list, got 'none'"),
        ("    unit: m/s^2\n", "", "residuals accel: expected the entry 'unit'"),
        ("    unit: m/s^2", "    units: m/s^2", "residuals accel: unknown entry 'units'; did you mean unit?"),
        ("    sigma: [0.002, 0.002]", "    sigma: [0.002]", "residuals accel sigma: expected 2 numbers, got 1"),
        ("    sigma: [0.002, 0.002]", "    sigma: [0.002, a]", "residuals accel sigma: expected lists of numbers"),
    ],
)  # fmt: skip
def test_edits_that_go_wrong_are_named(old, new, message, tmp_path):
    assert TEXT.count(old) == 1, old
    assert message in refused(TEXT.replace(old, new), tmp_path)


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("? [a, b]\n: 1\n", "edited.yaml:1: expected a name before the colon"),
        ("a: 1\n? {b: 1}\n: 2\n", "edited.yaml:2: expected a name before the colon"),
        ("a: " + "[" * 5_000, "nested too deeply"),
        ("a: " + "9" * 5000, "not a YAML file: Exceeds the limit"),
        ("2026-99-99: 1\n", "not a YAML file: month must be in 1..12"),
        ("a: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
    ],
)
def test_yaml_that_no_calibration_has_is_refused(text, message, tmp_path):
    assert message in refused(text, tmp_path)


def test_a_name_twice_is_refused_with_its_line(tmp_path):
    """Plain YAML would take the last without a word."""
    text = TEXT.replace("  b_a_x: 0.1 ", "  b_a_y: 0.1 ")
    line = next(i for i, t in enumerate(text.splitlines(), 1) if t.startswith("  b_a_y: 0.2"))
    assert f"edited.yaml:{line}: the entry 'b_a_y' is there twice" in refused(text, tmp_path)


def test_broken_yaml_is_refused_with_its_line(tmp_path):
    line = next(i for i, t in enumerate(TEXT.splitlines(), 1) if t.startswith("nominal"))
    message = refused(TEXT.replace("gyro: 1.0}", "gyro: 1.0"), tmp_path)
    assert "not a YAML file" in message
    assert f"edited.yaml:{line + 1}:" in message


@pytest.mark.parametrize("text", ["", "just words", "- a\n- b\n", "!!python/object/apply:os.system ['true']"])
def test_files_of_other_kinds(text, tmp_path):
    message = refused(text, tmp_path)
    assert "expected format" in message or "not a YAML file" in message


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(FileFormatError, match=r"no such file; expected a calibration \(docs/calibration.md\)"):
        read_result(tmp_path / "none.yaml")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="expected UTF-8 text"):
        read_result(tmp_path / "b.yaml")
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_result(tmp_path)


def test_every_parameter_has_a_place_in_the_file():
    names = (*LINEAR, "Q_a_x", "r_a_yz", "delay")
    text = result_text(CalibrationResult("m", names, np.zeros(len(names)), np.eye(len(names)), "full"))
    assert list(yaml.safe_load(text)["parameters"]) == list(names)
