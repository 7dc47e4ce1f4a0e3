"""Tables of campaigns: what is shown, what is written, what is refused."""

import csv
import json

import pytest

from schuler.exceptions import InputError
from schuler.plotting.table import ResultTable, joined, shown

TABLE = ResultTable("t", ("mode", "rms_m", "n"), (("a", 1.23456, 3), ("b", None, 4)), ("a note",))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.23456, "1.23"), (0.0, "0.00"), (123.456, "123"), (12345.6, "12346"), (-0.5, "-0.500"), (1e-5, "1.00e-05"),
        (None, "-"), (7, "7"), ("x", "x"), (float("nan"), "nan"), (2.5e7, "2.50e+07"), (True, "True"), (9.999, "10.00"),
    ],
)  # fmt: skip
def test_numbers_for_people(value, text):
    assert shown(value) == text


def test_columns_line_up_and_notes_follow():
    lines = TABLE.summary().splitlines()
    assert lines[0] == "t"
    assert lines[1:4] == ["mode  rms_m  n", "a      1.23  3", "b         -  4"]
    assert lines[4] == "- a note"
    assert "INTERRUPTED" in ResultTable("t", ("a",), (), complete=False).summary()


def test_csv_and_json_keep_all_digits(tmp_path):
    path = TABLE.to_csv(tmp_path / "t.csv")
    assert list(csv.reader(path.read_text().splitlines())) == [
        ["mode", "rms_m", "n"],
        ["a", "1.23456", "3"],
        ["b", "", "4"],
    ]
    assert json.loads(json.dumps(TABLE.to_dict()))["rows"][0] == {"mode": "a", "rms_m": 1.23456, "n": 3}


def test_rows_and_columns_by_name():
    assert TABLE.column("n") == [3, 4]
    assert TABLE.row(mode="b")["n"] == 4
    with pytest.raises(InputError, match="no column 'x'; there are mode"):
        TABLE.column("x")
    with pytest.raises(InputError, match="no row"):
        TABLE.row(mode="c")


def test_tables_join_only_with_equal_columns():
    both = joined([TABLE, TABLE], "two")
    assert len(both) == 4
    assert both.notes == ("a note",)
    with pytest.raises(InputError, match="same columns"):
        joined([TABLE, ResultTable("u", ("a",), ())], "two")
    with pytest.raises(InputError, match="expected 1 entries"):
        ResultTable("u", ("a",), ((1, 2),))
