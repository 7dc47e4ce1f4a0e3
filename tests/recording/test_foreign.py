"""Damaged input ends in an error of ours that names the file, never in one of Python, numpy or another library."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from schuler.calibration.bench.turns_in_log import rate_plateaus
from schuler.cli import main
from schuler.exceptions import FileFormatError, InputError, ReaderError, TomlError
from schuler.files import read_toml
from schuler.navigation.run import _check_earth_rotation
from schuler.recording import ImuSeries
from schuler.recording.formats import instinct_csv, nmea, text
from schuler.recording.formats.rinex_columns import satellites
from schuler.recording.io import dispatch, read, receiver_tables


@pytest.mark.parametrize(
    "error",
    [IndexError("list index out of range"), ValueError("x"), OverflowError("y"), KeyError("z"), OSError("no errno"),
     RecursionError("deep"), AssertionError(), ZeroDivisionError(), np.linalg.LinAlgError("singular")],
    ids=lambda e: type(e).__name__,
)  # fmt: skip
def test_what_a_reader_does_not_expect_is_one_sentence_with_the_file(tmp_path, monkeypatch, capsys, error):
    path = tmp_path / "log.txt"
    path.write_text("1 2 3\n")
    monkeypatch.setattr(text, "read_text", lambda *_: (_ for _ in ()).throw(error))
    with pytest.raises(ReaderError, match=r"log\.txt: it cannot be read .*: it is damaged, or the reader has a defect"):
        read(path)
    assert main(["info", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_errors_of_ours_and_of_the_system_pass_the_guard(tmp_path):
    def failing(error):
        with dispatch.guarded(tmp_path):
            raise error

    for error in (FileFormatError("x"), FileNotFoundError(2, "No such file", "a"), KeyboardInterrupt()):
        with pytest.raises(type(error)):
            failing(error)
    with pytest.raises(ReaderError, match="not enough memory"):
        failing(MemoryError())


def test_overflow_in_a_reader_warns_nobody(tmp_path):
    with dispatch.guarded(tmp_path):
        assert np.isinf(np.float64(1e300) * np.float64(1e300))


@pytest.mark.parametrize(
    "content",
    [b"\xef\xbb\xbf[a]\nb = 1\n", b"a = " + b"[" * 5000, b"a = " + b"9" * 5000, b"a = '\xff'", b"a = 1" + b"0" * 400],
    ids=["byte order mark", "deep", "5000 digits", "encoding", "long"],
)
def test_toml_is_read_or_refused_as_toml(tmp_path, content):
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    good = content.startswith(b"\xef")
    if good:
        assert read_toml(path)
    else:
        with pytest.raises(TomlError, match=r"a\.toml: not a TOML file"):
            read_toml(path)


def test_stamps_of_two_clocks_give_no_clock():
    """The median of two leads far apart is near neither (it ended in IndexError)."""
    t, whole = np.array([0.0, 1.0]), np.array([1000.0, 2001.0])
    assert receiver_tables.clock_line(t, whole, np.zeros(2)) is None


def test_one_sample_holds_no_turns():
    one = ImuSeries(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="several samples"):
        rate_plateaus(one, np.array([0.5]))


@pytest.mark.parametrize("value", [10**400, -(10**400), float("inf"), float("nan"), "", None])
def test_fields_of_nmea_that_are_no_numbers(value):
    assert not nmea._is_number(value)


@pytest.mark.parametrize("value", ["0.0037_1", "1_0"])
def test_underscores_are_no_numbers_of_other_programs(value):
    with pytest.raises(ValueError, match="_"):
        instinct_csv._number(value)


def test_satellites_of_an_unknown_system_are_wrong():
    _, wrong = satellites(np.frombuffer(b" 05G05", dtype=np.uint8).reshape(2, 3), "X", "GRE")
    np.testing.assert_array_equal(wrong, [True, False])


def test_a_log_without_one_good_row_is_refused_by_check(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay,az,gx,gy,gz\n" + "nan,nan,nan,nan,nan,nan,nan\n" * 4)
    code = main(["check", str(path), "--units", "g,deg/s"])
    out, err = capsys.readouterr()
    assert code == 2
    assert "Traceback" not in out + err


@pytest.mark.parametrize("scenario", ["a", 3, ["a"], {"motion": "b"}])
def test_a_scenario_that_is_no_table_stops_no_navigation(run, scenario):
    recording = replace(run, metadata=replace(run.metadata, options={"scenario": scenario}))
    _check_earth_rotation(recording, SimpleNamespace(filter=SimpleNamespace(earth_rotation=True)))
