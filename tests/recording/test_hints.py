"""What users say about a log: every textual form, and the answer to every mistake in one."""

import numpy as np
import pytest

from schuler.exceptions import InputError, UnitError
from schuler.recording.io import ReadHints
from schuler.recording.io.hint_texts import (
    TimeSpec,
    axes_matrix,
    factor,
    parse_columns,
    parse_scale,
    parse_time,
    parse_units,
)

F, R, D = np.eye(3)
# columns: the direction of x, y, z in forward, right, down; written out by hand
HAND_WRITTEN = {
    "FRD": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "FLU": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "RFU": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "BRU": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "BLD": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "LFD": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    "DRB": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "ULB": [[0, 0, -1], [0, -1, 0], [-1, 0, 0]],
}


@pytest.mark.parametrize("axes", HAND_WRITTEN)
def test_axes_give_the_matrix_written_by_hand(axes):
    np.testing.assert_array_equal(axes_matrix(axes), HAND_WRITTEN[axes])
    np.testing.assert_array_equal(axes_matrix(axes.lower()), HAND_WRITTEN[axes])


@pytest.mark.parametrize("axes", ["FRU", "FLD", "RFD", "LFU", "BRD"])
def test_left_handed_axes_are_refused(axes):
    with pytest.raises(InputError, match=r"left-handed \(determinant -1\)"):
        ReadHints(axes=axes)


@pytest.mark.parametrize("axes", ["FR", "FFD", "XYZ", "FBD", "NED", ""])
def test_axes_that_are_no_directions_are_refused(axes):
    with pytest.raises(InputError, match="expected three letters"):
        ReadHints(axes=axes)


def test_exactly_24_axes_are_right_handed():
    """Of 48 signed permutations half are rotations; each must keep the down axis of gravity where it is."""
    good = 0
    for x in "FBRLUD":
        for y in "FBRLUD":
            for z in "FBRLUD":
                try:
                    C_bs = axes_matrix(x + y + z)
                except InputError:
                    continue
                good += 1
                assert np.linalg.det(C_bs) == pytest.approx(1.0)  # rounding
    assert good == 24


def test_unknown_hint_lists_the_known_and_proposes_the_nearest():
    with pytest.raises(
        InputError, match=r"hint: 'unit' is not known; did you mean 'units'\? Known are: columns, units"
    ):
        ReadHints.of(unit="g,deg/s")


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        ("mg", {"accel": "mg"}),
        ("deg/s", {"gyro": "deg/s"}),
        ("ms", {"t": "ms"}),
        ("counts", dict.fromkeys(("accel", "gyro"), "counts")),
    ],
)
def test_one_unit_is_of_what_it_can_be_of(text, stated):
    assert parse_units(text) == stated


@pytest.mark.parametrize(
    ("hints", "message"),
    [
        ({"columns": "t,ax,ay,az,gx,gy,gzz"}, r"columns: 'gzz' is not known; did you mean 'gz'"),
        ({"columns": "t,ax,ax"}, "ax named more than once"),
        ({"columns": "t,=5"}, "cannot read"),
        ({"columns": "-,-"}, "names no column"),
        ({"columns": 5}, "columns: expected text, got 5"),
        ({"units": "furlong"}, "expected two .* or three"),
        ({"units": "acel=g"}, "did you mean 'accel'"),
        ({"units": "accel=g,deg/s"}, "either all are named or none"),
        ({"units": "deg/s,g"}, "'deg/s' is no unit of specific force"),
        ({"units": "g,furlong"}, "unknown unit 'furlong'"),
        ({"units": "m/s,rad"}, "'m/s' is no unit of specific force"),
        ({"units": "temp=K"}, "kelvin"),
        ({"rate": 0}, "rate: expected a positive number, got 0"),
        ({"rate": 1e-9}, "between 1e-4 and 1e7"),
        ({"rate": "fast"}, "rate: expected a positive number, got 'fast'"),
        ({"offset": 1e11}, "offset: expected seconds within"),
        ({"kind": "delta"}, "kind: 'delta' is not known"),
        ({"time": "gps-tow"}, "expected gps-tow:WEEK"),
        ({"time": "gps-tow:12345"}, "expected gps-tow:WEEK"),
        ({"time": "unix:5"}, "only gps-tow takes a week"),
        ({"time": "tai"}, "time: 'tai' is not known"),
        ({"delimiter": "ab"}, "delimiter: expected one character"),
        ({"delimiter": "5"}, "delimiter: expected one character"),
        ({"skip": -1}, "skip: expected a number of lines"),
        ({"skip": 1.5}, "skip: expected a number of lines"),
        ({"comment": " "}, "comment: expected the text"),
        ({"scale": "0.1,0.2,0.3"}, "scale: expected accel="),
        ({"scale": "accel=0"}, "between 1e-15 and 1e15"),
        ({"scale": {"accl": 1.0}}, "did you mean 'accel'"),
        ({"height": "geoid"}, "height: 'geoid' is not known"),
        ({"height": "msl"}, "height='msl' needs geoid_separation"),
        ({"geoid_separation": 40.0}, "used with height='msl' only"),
        ({"height": "msl", "geoid_separation": 1600.0}, "is it in feet, or the height itself"),
        ({"sigma": "1,2"}, "sigma: expected 1-sigma north, east, down"),
        ({"sigma": (1.0, 0.0, 2.0)}, "sigma: expected a positive number"),
        ({"series": "baro"}, "series: 'baro' is not known"),
        ({"allow": "nrom"}, "did you mean 'norm'"),
    ],
)
def test_mistakes_in_hints_are_explained(hints, message):
    with pytest.raises(InputError, match=message):
        ReadHints.of(**hints)


def test_units_of_increments_are_those_of_integrals():
    assert parse_units("m/s,rad", "increment") == {"accel": "m/s", "gyro": "rad"}
    with pytest.raises(UnitError, match="'g' is no unit of velocity"):
        parse_units("g,rad", "increment")


def test_positional_and_named_units_say_the_same():
    assert parse_units("g, deg/s, ms") == parse_units("accel=g,gyro=deg/s,t=ms")
    assert factor("deg/s", "gyro") == pytest.approx(np.pi / 180.0, rel=1e-15)  # rounding
    assert factor("counts", "accel") == 1.0


def test_columns_are_read_with_skips_rest_and_headers():
    specs, rest = parse_columns("t, -, ax=Acc X, _, *")
    assert [None if s is None else (s.name, s.source) for s in specs] == [("t", None), None, ("ax", "Acc X"), None]
    assert rest


def test_scale_is_factors_or_the_name_of_an_array():
    assert parse_scale("accel=0.5,gx=2") == {"accel": 0.5, "gx": 2.0}
    assert parse_scale("0.5, 2") == {"accel": 0.5, "gyro": 2.0}
    assert parse_scale("lsb") == "lsb"


def test_times_are_read():
    assert parse_time("gps-tow:2374") == TimeSpec("gps-tow", 2374)
    assert parse_time("utc-unix") == parse_time("unix") == TimeSpec("unix")
    assert parse_time(None) == TimeSpec("local")


def test_given_hints_come_back_as_plain_values():
    hints = ReadHints(units="g,deg/s", sigma="1,1,2", allow="norm,magnitude")
    assert hints.given() == {"units": "g,deg/s", "sigma": (1.0, 1.0, 2.0), "allow": ["magnitude", "norm"]}
    assert ReadHints.of(**hints.given()) == hints
