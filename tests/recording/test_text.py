"""Plain text logs: what is read, what is noted, and what is refused with file and line."""

import re
from pathlib import Path

import numpy as np
import pytest

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import ReadHints, lines, read

SI = {"columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s"}
HEADER = "t,ax,ay,az,gx,gy,gz"


def at(path: Path, line: int) -> str:
    """Start of a message that names a line, for ``match``."""
    return f"^{re.escape(str(path))}:{line}: "


def test_columns_in_order_are_read_in_si(table, still):
    r = read(table(still), **SI)
    np.testing.assert_array_equal(r.imu.t, still[:, 0])
    np.testing.assert_array_equal(r.imu.accel, still[:, 1:4])
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])
    assert r.imu.kind == "rate"
    assert r.metadata.time.scale == "local"
    assert list(r.metadata.sources) == ["log.csv"]
    assert r.metadata.options == SI


@pytest.mark.parametrize(
    ("delimiter", "name"), [(",", "comma"), (";", "semicolon"), ("\t", "tab"), (" ", "blanks"), ("|", "|")]
)
def test_delimiters_are_guessed_or_given(table, still, delimiter, name):
    path = table(still, delimiter=delimiter)
    if delimiter != "|":
        np.testing.assert_array_equal(read(path, **SI).imu.accel, still[:, 1:4])
    np.testing.assert_array_equal(read(path, **SI, delimiter=name).imu.accel, still[:, 1:4])


def test_other_orders_and_skipped_columns(table, still):
    shuffled = np.column_stack((still[:, 4:7], np.full(300, 7.0), still[:, 1:4], still[:, 0]))
    path = table(shuffled)
    r = read(path, columns="gx,gy,gz,-,ax,ay,az,t", units="m/s^2,rad/s")
    np.testing.assert_array_equal(r.imu.accel, still[:, 1:4])
    r = read(table(np.column_stack((still, still))), columns="t,ax,ay,az,gx,gy,gz,*", units="m/s^2,rad/s")
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])


def test_words_in_skipped_columns_do_no_harm(table, still):
    rows = [["rest", *row] for row in still]
    r = read(table(rows, header="part," + HEADER), units="m/s^2,rad/s")
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])
    assert any("Columns not used: part" in note for note in r.metadata.notes)


@pytest.mark.parametrize(
    "header",
    [
        "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]",
        "time_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,gyr_x_rad_s,gyr_y_rad_s,gyr_z_rad_s",
        '"Time (s)","accel.x (m/s^2)","accel.y (m/s^2)","accel.z (m/s^2)","w_x (rad/s)","w_y (rad/s)","w_z (rad/s)"',
        "# t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]",
    ],
)
def test_headers_with_units_need_no_hints(table, still, header):
    r = read(table(still, header=header))
    np.testing.assert_array_equal(r.imu.accel, still[:, 1:4])
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])


def test_columns_may_be_mapped_by_header(table, still):
    header = "Stamp [s],X,Y,Z,rotation A [deg/s],rotation B [deg/s],rotation C [deg/s]"
    path = table(still, header=header)
    r = read(
        path,
        columns="gx=rotation A [deg/s],gy=rotation B [deg/s],gz=Rotation c [deg/s],az=Z,ay=Y,ax=X,t=Stamp [s]",
        units="accel=m/s^2",
    )
    np.testing.assert_allclose(r.imu.gyro, np.deg2rad(still[:, 4:7]), rtol=1e-15)  # rounding
    with pytest.raises(FileFormatError, match=at(path, 1) + "there is no header 'W'; there are: Stamp"):
        read(path, columns="t=Stamp [s],ax=W")
    with pytest.raises(FileFormatError, match="all names are mapped to headers or none"):
        read(path, columns="t,ax=X")
    with pytest.raises(FileFormatError, match="the file has no header"):
        read(table(still, name="b.csv"), columns="t=T")


def test_a_header_shorter_or_longer_than_the_rows_serves_no_mapping(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s],ax [m/s^2],ay\n0,1\n")
    with pytest.raises(FileFormatError, match=at(path, 1) + "the header names 3 columns, the first row .* has 2"):
        read(path, columns="t=t [s],ax=ax [m/s^2]")


def test_units_of_a_header_are_kept_when_columns_are_given(table, still):
    header = "a [s],b [m/s^2],c [m/s^2],d [m/s^2],e [deg/s],f [deg/s],g [deg/s]"
    path = table(still, header=header)
    r = read(path, columns=SI["columns"])
    np.testing.assert_allclose(r.imu.gyro, np.deg2rad(still[:, 4:7]), rtol=1e-15)  # rounding
    assert any("header in line 1 was passed over but for the units" in note for note in r.metadata.notes)
    with pytest.raises(FileFormatError, match="the file says gx is in deg/s, the hint units says rad/s"):
        read(path, **SI)


def test_a_unit_nobody_knows_is_passed_over_for_a_stated_one(table, still):
    header = "t,ax [LSB],ay [LSB],az [LSB],gx [mps],gy,gz"
    r = read(table(still, header=header), units="m/s^2,rad/s")
    np.testing.assert_array_equal(r.imu.accel, still[:, 1:4])
    assert any("The unit 'LSB' in the header of ax was passed over" in note for note in r.metadata.notes)


def test_units_are_converted(table, still):
    stated = still / ([1e-3, *3 * [units.G0], *3 * [np.pi / 180.0]])
    r = read(table(stated), columns=SI["columns"], units="g,deg/s,ms")
    np.testing.assert_allclose(r.imu.t, still[:, 0], rtol=1e-14)  # rounding, here and below
    np.testing.assert_allclose(r.imu.accel, still[:, 1:4], rtol=1e-14)
    np.testing.assert_allclose(r.imu.gyro, still[:, 4:7], rtol=1e-14)
    assert any("accel from g, gyro from deg/s" in note for note in r.metadata.notes)


def test_counts_are_scaled_before_their_unit(table, still):
    lsb_f, lsb_w = 0.25e-3 * units.G0, 0.01 * np.pi / 180.0
    counts = np.column_stack((still[:, 0], np.round(still[:, 1:4] / lsb_f), np.round(still[:, 4:7] / lsb_w)))
    r = read(table(counts), columns=SI["columns"], units="mg,deg/s", scale="accel=0.25,gyro=0.01")
    assert np.abs(r.imu.accel - still[:, 1:4]).max() <= 0.5001 * lsb_f  # half a count
    assert np.abs(r.imu.gyro - still[:, 4:7]).max() <= 0.5001 * lsb_w
    assert any("multiplied before their units: accel by 0.25, gyro by 0.01" in note for note in r.metadata.notes)


def test_uncalibrated_counts_are_kept_and_noted(table, still):
    counts = np.column_stack((still[:, 0], 32_000 + still[:, 1:4] * 300.0, 31_000 + still[:, 4:7]))
    r = read(table(counts), columns=SI["columns"], units="counts,counts")
    np.testing.assert_array_equal(r.imu.accel, counts[:, 1:4])
    assert any("raw counts, not SI" in note for note in r.metadata.notes)


def test_a_rate_replaces_a_time_column(table, still):
    r = read(table(still[:, 1:]), columns="ax,ay,az,gx,gy,gz", units="m/s^2,rad/s", rate=100)
    np.testing.assert_allclose(r.imu.t, still[:, 0], atol=1e-12)  # rounding
    increments = still[:, 1:] * 0.01
    r = read(table(increments), columns="ax,ay,az,gx,gy,gz", units="m/s,rad", rate=100, kind="increment")
    assert r.imu.t[0] == 0.01  # an increment is stamped at the end of its interval
    assert r.imu.kind == "increment"
    np.testing.assert_array_equal(r.imu.accel, increments[:, :3])


def test_axes_are_turned_and_noted(table, still):
    f, w = still[:, 1:4], still[:, 4:7]
    # right, forward, up of a forward, right, down vector
    rfu = np.column_stack((still[:, 0], f[:, 1], f[:, 0], -f[:, 2], w[:, 1], w[:, 0], -w[:, 2]))
    r = read(table(rfu), **SI, axes="rfu")
    np.testing.assert_array_equal(r.imu.accel, f)
    np.testing.assert_array_equal(r.imu.gyro, w)
    assert r.metadata.axes == "RFU"
    assert "Axes were turned from RFU to forward, right, down." in r.metadata.notes


def test_axes_that_are_exchanged_in_a_cycle_are_turned_the_right_way(table, still):
    """x points left, y forward, z down: the matrix is not its own inverse."""
    f, w = still[:, 1:4], still[:, 4:7]
    lfd = np.column_stack((still[:, 0], -f[:, 1], f[:, 0], f[:, 2], -w[:, 1], w[:, 0], w[:, 2]))
    r = read(table(lfd), **SI, axes="LFD")
    np.testing.assert_array_equal(r.imu.accel, f)
    np.testing.assert_array_equal(r.imu.gyro, w)


def test_a_sensor_that_looks_upside_down_is_noted(table, still):
    still[:, 3] *= -1.0
    notes = read(table(still), **SI).metadata.notes
    assert any("points along the down axis" in note and "upside down" in note for note in notes)


def test_gaps_and_jitter_are_noted(table, still, rng):
    gappy = np.delete(still, np.arange(120, 170), axis=0)
    notes = read(table(gappy), **SI).metadata.notes
    assert any("1 gap of more" in n and "longest is 0.51 s at 1.190 s" in n for n in notes)
    still[:, 0] += rng.uniform(-0.004, 0.004, 300)
    assert any("jitter" in n for n in read(table(still), **SI).metadata.notes)
    assert not any("jitter" in n or "gap" in n for n in read(table(gappy[:100]), **SI).metadata.notes)


def test_comments_blank_lines_and_line_ends(tmp_path, still):
    rows = [",".join(map(repr, row)) for row in still.tolist()]
    rows[100:100] = ["# a pause", "", "   "]
    for end, name in (("\n", "unix"), ("\r\n", "dos"), ("\r", "mac")):
        path = tmp_path / f"{name}.csv"
        path.write_bytes(end.join(["# made by hand", "#", *rows]).encode())
        np.testing.assert_array_equal(read(path, **SI).imu.accel, still[:, 1:4])
    path.write_bytes(b"\xef\xbb\xbf" + (HEADER + "\n" + "\n".join(rows)).encode())
    np.testing.assert_array_equal(read(path, units="m/s^2,rad/s").imu.accel, still[:, 1:4])
    path.write_bytes(b"// notes\n" + "\n".join(rows).replace("# a", "// a").encode())
    np.testing.assert_array_equal(read(path, **SI).imu.accel, still[:, 1:4])


def test_comments_in_latin_1_do_no_harm(tmp_path, still):
    path = tmp_path / "log.txt"
    rows = "\n".join(",".join(map(repr, row)) for row in still.tolist())
    path.write_bytes("# Drehrate in °/s, Größe\n".encode("latin-1") + rows.encode())
    np.testing.assert_array_equal(read(path, **SI).imu.accel, still[:, 1:4])
    header = "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [°/s],gy [°/s],gz [°/s]\n"
    for encoding in ("utf-8", "latin-1"):
        path.write_bytes(header.encode(encoding) + rows.encode())
        np.testing.assert_allclose(read(path).imu.gyro, np.deg2rad(still[:, 4:7]), rtol=1e-15)  # rounding


def test_lines_skipped_at_the_top_are_not_looked_at(table, still):
    path = table(still, header="1 2 3\nnonsense, more\n\x01")
    np.testing.assert_array_equal(read(path, **SI, skip=3).imu.accel, still[:, 1:4])
    path = table(still, header="0,1,2,3,4,5,6\n0,1,2,3,4,5,6", name="numbers.csv")
    np.testing.assert_array_equal(read(path, **SI, skip=2).imu.accel, still[:, 1:4])


# --- time ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time", "first", "tow", "week"),
    [
        ("gps-tow:2374", 243_261.854, 243_261.854, 2374),
        ("gps", 2374 * 604_800.0 + 243_261.5, 243_261.5, 2374),
        # 2025-07-08 19:34:03.5 UTC is 19:34:21.5 GPS: 18 leap seconds since 2017
        ("unix", 1_752_003_243.5, 243_261.5, 2374),
        ("utc-unix", 1_752_003_243.5, 243_261.5, 2374),
        # the same without leap seconds, as RTKLIB counts inside
        ("gps-unix", 1_752_003_261.5, 243_261.5, 2374),
        # 2008-12-31 23:59:59.5 UTC: 14 leap seconds
        ("unix", 1_230_767_999.5, 345_613.5, 1512),
    ],
)
def test_time_scales_become_gps_time_of_week(table, still, time, first, tow, week):
    still[:, 0] += first
    r = read(table(still[:40]), **SI, time=time)
    assert r.metadata.time.scale == "gps"
    assert r.metadata.time.epoch_gps_s == week * 604_800.0
    assert r.imu.t[0] == pytest.approx(tow, abs=3e-7)  # rounding of a float64 number of seconds since 1970


def test_a_leap_second_within_a_unix_log_is_followed(table, still):
    """Unix time repeats no second here: the stamps jump over it, and GPS time runs on."""
    still = still[:100]
    still[:, 0] = 1_483_228_799.5 + np.arange(100) / 100.0  # 2016-12-31 23:59:59.5 UTC on
    r = read(table(still), **SI, time="unix")
    step = np.diff(r.imu.t)
    assert step[49] == pytest.approx(1.01, abs=1e-6)  # rounding of seconds since 1970, here and below
    np.testing.assert_allclose(np.delete(step, 49), 0.01, atol=1e-6)


def test_time_of_week_runs_on_over_the_end_of_the_week(table, still):
    still[:, 0] = (604_799.0 + np.arange(300) / 100.0) % 604_800.0
    r = read(table(still), **SI, time="gps-tow:2374")
    np.testing.assert_allclose(np.diff(r.imu.t), 0.01, atol=1e-9)  # rounding of seconds of the week
    assert any("starts again 1 times" in note for note in r.metadata.notes)


@pytest.mark.parametrize(
    ("time", "first", "message"),
    [
        ("gps-tow:2374", 700_000.0, "time of week 700000 s is not within 0..604800"),
        ("gps-tow:2374", -1.0, "time of week -1 s is not within"),
        ("unix", 1.7e12, r"time 1\.7e\+12 s is impossible for time='unix': is its unit right"),
        ("unix", 1.0, "is before GPS time began"),
        ("gps-unix", 1.0, "is before GPS time began"),
        ("gps", -5.0, "is impossible for time='gps'"),
        (None, 1e13, "time 1e.13 s is impossible"),
    ],
)
def test_impossible_times_are_refused(table, still, time, first, message):
    still[:, 0] += first
    path = table(still[:1])
    with pytest.raises(FileFormatError, match=at(path, 1) + ".*" + message):
        read(path, **SI, time=time)


def test_a_wrong_unit_of_time_shows_in_the_interval(table, still):
    with pytest.raises(FileFormatError, match=r"sample interval is 1e-11 s: is the unit of time right"):
        read(table(still), columns=SI["columns"], units="m/s^2,rad/s,ns")


@pytest.mark.parametrize("first", [-0.03, 1.2e6])
def test_a_counter_from_anywhere_is_a_time_of_week_by_its_offset(table, still, first):
    """Of a device that is on for weeks, or that began a moment before the others; still refused where it stays one."""
    still[:, 0] += first - still[0, 0]
    r = read(table(still), **SI, time="gps-tow:2374", offset=1000.0 - first)
    assert r.imu.t[0] == pytest.approx(1000.0, abs=1e-6)  # rounding of seconds of the counter
    assert not any("starts again" in note for note in r.metadata.notes)
    with pytest.raises(FileFormatError, match="is not within 0"):
        read(table(still), **SI, time="gps-tow:2374", offset=-2e6)


def test_an_offset_is_added_and_noted(table, still):
    r = read(table(still), **SI, offset=-0.125)
    np.testing.assert_allclose(r.imu.t, still[:, 0] - 0.125, atol=1e-15)  # rounding
    assert "-0.125 s was added to every time stamp." in r.metadata.notes
    still[:, 0] *= 1e-4
    path = table(still)
    with pytest.raises(FileFormatError, match=r"expected increasing times, but 10000000000\.0"):
        read(path, **SI, offset=1e10, allow="norm")  # steps of 1 us are lost among 2e-6 s of rounding


# --- refusals with line --------------------------------------------------------------------------------------------


def with_line(still: np.ndarray, line: int, text: str) -> list[list[str]]:
    rows = [[repr(v) for v in row] for row in still.tolist()]
    rows[line - 1] = text.split(",")
    return rows


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.98,0,0,-9.8,0,0,0", "expected increasing times, but 1.98.* repeats the time of the row before"),
        ("0.5,0,0,-9.8,0,0,0", "expected increasing times, but 0.5.* is earlier than the row before"),
        ("1.99,nan,0,-9.8,0,0,0", "ax is nan, no number"),
        ("1.99,0,0,-9.8,0,-inf,0", "gy is -inf, no number"),
        ("1.99,0,0,-9.8,0,1e400,0", "gy is inf, no number"),
        ("1.99,0,0,-9.8,0,1e31,0", r"gy is 1e\+31, an impossibly large number"),
        ("1.99,0,,-9.8,0,0,0", "column 3: the field is empty"),
        ("1.99,0,0,-9.8,0,0,none", "column 7: expected a number, got 'none'"),
        ("2025-07-08T12:00:00Z,0,0,-9.8,0,0,0", "column 1: expected a number, got '2025-07-08T12"),
        ("12:00:01.5,0,0,-9.8,0,0,0", "column 1: expected a number, got '12:00:01.5'; write seconds"),
        ("1.99,0,0,-9.8,0,0,0x10", "column 7: expected a number, got '0x10'"),
        ("1.99,0,0,-9.8,0,0,1_0", "column 7: expected a number, got '1_0'"),
        ("1.99,0,0,-9.8,0,0", "expected 7 columns, got 6"),
        ("1.99,0,0,-9.8,0,0,0,0", "expected 7 columns, got 8"),
        ("1.99,0,0,-9.8,0,0,0,", "expected 7 columns, got 8; the last one is empty.* end columns with ',-'"),
        (
            "1.99,0,0,-9.8,0,0,101",
            r"gyro reaches 101 rad/s .limit 100.: is its unit really rad/s\? did you mean deg/s\?",
        ),
        ("1.99,0,0,-2000,0,0,0", r"accel reaches 2000 m/s\^2 .limit 1961.: is its unit really m/s\^2\?"),
    ],
)
def test_faulty_rows_are_named_by_their_line(table, still, text, message):
    path = table(with_line(still, 200, text))
    with pytest.raises(FileFormatError, match=at(path, 200) + message):
        read(path, **SI)
    # comments and blank lines before it count as lines of the file, not as rows
    path = table(with_line(still, 200, text), header="# one\n\n# two\n" + HEADER, name="commented.csv")
    with pytest.raises(FileFormatError, match=at(path, 204) + message):
        read(path, units="m/s^2,rad/s")


@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("large", [False, True])
def test_decimal_commas_are_points(table, still, monkeypatch, delimiter, large):
    """The same numbers, to the last bit, whichever code reads them; the first rows need not have one."""
    if large:
        monkeypatch.setattr(lines, "MANY", 0)
    points = table(still, header=HEADER, name="points.csv")
    header, *rows = points.read_text().splitlines()
    commas = points.with_name("commas.csv")
    rows[0] = delimiter.join(f"{float(x):.0f}" for x in rows[0].split(","))
    text = [
        header.replace(",", delimiter),
        rows[0],
        *(row.replace(",", delimiter).replace(".", ",") for row in rows[1:]),
    ]
    commas.write_bytes("\r\n".join(text).encode("utf-8-sig"))
    one, other = read(points, **SI).imu, read(commas, **SI).imu
    np.testing.assert_array_equal(one.t[1:] - one.t[1], other.t[1:] - other.t[1])
    np.testing.assert_array_equal(one.accel[1:], other.accel[1:])
    np.testing.assert_array_equal(one.gyro[1:], other.gyro[1:])


def test_decimal_commas_among_points_are_named(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("0;0;0;-9.8;0;0;0\n1;0;0;-9,8;0;0;0\n")
    with pytest.raises(FileFormatError, match=at(path, 2) + "column 4: expected a decimal point .*, got '-9,8'"):
        read(path, **SI)


def test_a_log_cut_off_in_its_last_line(table, still):
    path = table(still)
    path.write_bytes(path.read_bytes().rstrip()[:-30])
    with pytest.raises(FileFormatError, match=at(path, 300) + "the last line is incomplete.* allow='truncated'"):
        read(path, **SI)
    r = read(path, **SI, allow="truncated")
    assert len(r.imu) == 299
    assert "The last line was cut off and left out." in r.metadata.notes


@pytest.mark.parametrize("banner", ["MPU6050 found\nDone, logging.", "Acme Logger v1.2\nFirmware 3.4 serial 0042\n"])
def test_words_above_the_header_are_a_banner(tmp_path, banner):
    path = tmp_path / "log.csv"
    rows = "".join(f"{10 * k},0,0,-9.8,0,0,0,25.0\n" for k in range(200))
    path.write_text(f"{banner}\nmillis,AcX(m/s^2),AcY,AcZ,GyX(mdps),GyY,GyZ,Temp(C)\n" + rows)
    recording = read(path, units="accel=m/s^2,gyro=mdps,t=ms,temp=C")
    assert recording.imu.interval == pytest.approx(0.01, rel=1e-12)  # rounding
    assert recording.imu.temperature[0] == 25.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"log.csv: the file is empty"),
        (b"\x00\x01\x02\x03" * 50, "expected text, got a binary file"),
        ("t,ax\n0,1\n".encode("utf-16"), "expected one file per series"),
        (b"# only\n# comments\n", "there are no rows of numbers"),
        (b"t,ax,ay,az,gx,gy,gz\n", r"log.csv:1: there is a header \('t,ax,ay,az,gx,gy,gz'\) but no row of numbers"),
        (b"t,ax\nbegin,end\n0,1\n", "log.csv:2: expected numbers below the header in line 1"),
        (b"t,ax,ay\n0,1\n", "log.csv:1: the header names 3 columns, the first row of numbers .line 2. has 2"),
        (b"0,1,2\n", "log.csv:1: there is no header, so the 3 columns are not known"),
        (b"a,b,c\n0,1,2\n", r"log.csv:1: no sensor is recognised in the header \(a, b, c\)"),
        (b"time,tow,ax,ay,az,gx,gy,gz\n0,1,2,3,4,5,6,7\n", "log.csv:1: t may be any of time, tow: say which"),
        (b"t,ax [g],ay [g],az [g]\n0,0,0,-1\n", "but gx, gy, gz are missing.* allow='no-gyro'"),
        (b"t,ax,ay,az,gx,gy,gz\n0,0,0,-9.8,0,0,0\n", "the unit of ax is not known: say units='g,deg/s'"),
        (b"ax [g],ay [g],az [g],gx [rad/s],gy [rad/s],gz [rad/s]\n0,0,-1,0,0,0\n", "there is no time column"),
        (b"t,ax [LSB],ay,az,gx,gy,gz\n0,0,0,-9.8,0,0,0\n", r"log.csv:1: column 'ax \[LSB\]': unknown unit 'LSB'"),
        (b"t,ax [g],ay,az,gx,gy,gz,x,y,z\n" + b"0," * 7 + b"4e6,1e6,5e6\n", "got columns of imu and reference"),
    ],
)  # fmt: skip
def test_files_that_are_no_log_are_explained(tmp_path, content, message):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_a_missing_file_is_an_error_of_ours(tmp_path):
    with pytest.raises(FileFormatError, match=r"absent.csv: there is no such file \(working folder"):
        read(tmp_path / "absent.csv")


def test_contradictions_are_refused(table, still):
    path = table(still, header="t,ax [g],ay [g],az [g],gx,gy,gz")
    with pytest.raises(FileFormatError, match=r"the file says ax is in g, the hint units says m/s\^2"):
        read(path, units="m/s^2,rad/s")
    with pytest.raises(FileFormatError, match="there is a time column and rate is given"):
        read(table(still, name="other.csv"), **SI, rate=100)
    with pytest.raises(FileFormatError, match=at(path, 2) + r"expected 6 columns .*, got 7 fields"):
        read(path, columns="ax,ay,az,gx,gy,gz", units="g,deg/s")
    with pytest.raises(FileFormatError, match="names an array, which only"):
        read(table(still), **SI, scale="lsb")
    with pytest.raises(FileFormatError, match="series='gnss', but the columns are t, ax"):
        read(table(still), **SI, series="gnss")


def test_hints_may_be_given_as_an_object_and_by_name(table, still):
    hints = ReadHints.of(**SI)
    assert read(table(still), hints, axes="FLU").metadata.axes == "FLU"
    with pytest.raises(InputError, match="did you mean 'axes'"):
        read(table(still), hints, axis="FLU")


# --- half an IMU ---------------------------------------------------------------------------------------------------


def test_half_an_imu_is_read_only_when_allowed(table, still):
    r = read(table(still[:, :4]), columns="t,ax,ay,az", units="accel=m/s^2", allow="no-gyro")
    assert not r.imu.gyro.any()
    assert "The log has no gyro: its values are zero and mean nothing." in r.metadata.notes
    r = read(table(still[:, [0, 4, 5, 6]]), columns="t,gx,gy,gz", units="gyro=rad/s", allow="no-accel")
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])


# --- GNSS, odometer, reference -------------------------------------------------------------------------------------

GNSS = "t,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd,q,ns"


@pytest.fixture
def fixes() -> np.ndarray:
    k = np.arange(5.0)
    rest = np.tile((1.0, 2.0, -1.0, 0.5, 0.6, 0.9, 0.1, 0.2, 0.3, 1.0, 12.0), (5, 1))
    return np.column_stack((k, 48.5 + 1e-5 * k, 9.25 + 1e-5 * k, 300 + k, rest))


def test_gnss_tables_are_read(table, fixes):
    gnss = read(table(fixes, header=GNSS)).gnss
    np.testing.assert_allclose(gnss.llh[:, :2], np.deg2rad(fixes[:, 1:3]), rtol=1e-15)  # rounding, here and below
    np.testing.assert_allclose(gnss.cov_r_n[2], np.diag([0.25, 0.36, 0.81]), rtol=1e-14)
    np.testing.assert_allclose(gnss.cov_v_n[2], np.diag([0.01, 0.04, 0.09]), rtol=1e-14)
    np.testing.assert_array_equal(gnss.v_n[0], [1, 2, -1])
    np.testing.assert_array_equal(gnss.quality, 1)
    np.testing.assert_array_equal(gnss.n_satellites, 12)


def test_dilutions_of_a_table_may_be_missing(table, fixes):
    """Zero, 99.99 and NaN are none; a stream of the columns of others that has none at all has no dilutions."""
    rows = np.column_stack((fixes, (0.8, 0.0, 99.99, np.nan, 1.2), (1.5, 1.6, 1.7, 1.8, 0.0)))
    nan = np.nan
    expected = [[0.8, 1.5], [nan, 1.6], [nan, 1.7], [nan, 1.8], [1.2, nan]]
    np.testing.assert_array_equal(read(table(rows, header=f"{GNSS},HDOP,VDOP")).gnss.dop, expected)
    one = read(table(np.column_stack((fixes, np.full(5, 0.9))), header=f"{GNSS},hdop")).gnss
    np.testing.assert_array_equal(one.dop, [[0.9, nan]] * 5)
    assert read(table(np.column_stack((fixes, np.full(5, 99.9))), header=f"{GNSS},hdop")).gnss.dop is None


def test_times_of_delivery_are_on_the_time_base_of_the_fixes(table, fixes):
    rows = np.column_stack((fixes[:, :4], fixes[:, 0] + 0.08))
    rows[:, [0, 4]] += 604_798.5
    rows[:, [0, 4]] %= 604_800.0
    rows[:, 4] += 604_800.0 * (rows[:, 4] < rows[:, 0])
    r = read(table(rows, header="t,lat,lon,h,received"), sigma="1,1,2", time="gps-tow:2374", offset=0.5)
    np.testing.assert_allclose(r.gnss.t, 604_799.0 + np.arange(5), atol=1e-9)  # rounding, here and below
    np.testing.assert_allclose(r.gnss.received, r.gnss.t + 0.08, atol=1e-9)


def test_other_units_of_gnss_tables(table, fixes):
    fixes[:, 1:3] = np.deg2rad(fixes[:, 1:3])
    fixes[:, 4:7] *= 3.6
    r = read(table(fixes[:, :13]), columns=GNSS[:-5], units="angle=rad,velocity=km/h")
    np.testing.assert_allclose(r.gnss.llh[:, 0], fixes[:, 1], rtol=1e-15)  # rounding, here and below
    np.testing.assert_allclose(r.gnss.v_n[0], [1, 2, -1], rtol=1e-14)


def test_missing_accuracies_have_to_be_given(table, fixes):
    path = table(fixes[:, :7], header="t,lat,lon,h,vn,ve,vd")
    with pytest.raises(FileFormatError, match=r"there is no accuracy of position .* say sigma='N,E,D'"):
        read(path)
    with pytest.raises(
        FileFormatError, match=r"there is no accuracy of velocity .* six numbers .*, or pass allow='no-velocity'"
    ):
        read(path, sigma="1,1,2")
    r = read(path, sigma="1,1,2,0.1,0.1,0.2")
    np.testing.assert_allclose(r.gnss.cov_v_n[1], np.diag([0.01, 0.01, 0.04]), rtol=1e-14)  # rounding
    r = read(path, sigma="1,1,2", allow="no-velocity")
    assert r.gnss.v_n is None
    assert "Velocities come without an accuracy and were left out." in r.metadata.notes


def test_accuracies_of_zero_have_to_be_replaced(table, fixes):
    fixes[3, 8] = 0.0
    path = table(fixes, header=GNSS)
    with pytest.raises(FileFormatError, match=at(path, 5) + "expected a positive 1-sigma of position, got 0"):
        read(path)
    r = read(path, sigma="2,3,4")
    np.testing.assert_array_equal(np.diag(r.gnss.cov_r_n[3]), [4, 9, 16])
    np.testing.assert_allclose(r.gnss.cov_r_n[2], np.diag([0.25, 0.36, 0.81]), rtol=1e-14)  # rounding
    assert any("1 epochs had no accuracy of position" in note for note in r.metadata.notes)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        (1, 91.0, r"latitude 91 deg is beyond \+-90: are latitude and longitude exchanged"),
        (2, 361.0, r"longitude 361 deg is beyond"),
        (13, 0.0, "expected a quality q of 1 fixed, 2 float.*, got 0"),
        (13, 1.5, "q: expected a whole number, got 1.5"),
        (14, -1.0, "ns: expected a whole number, got -1"),
    ],
)
def test_impossible_fixes_are_named_by_their_line(table, fixes, column, value, message):
    fixes[2, column] = value
    path = table(fixes, header=GNSS)
    with pytest.raises(FileFormatError, match=at(path, 4) + message):
        read(path)


def test_gnss_tables_with_too_little_are_explained(table, fixes):
    with pytest.raises(FileFormatError, match="a position needs lat, lon and h, but lon is missing"):
        read(table(fixes[:, [0, 1, 3]], header="t,lat,h"), sigma="1,1,1")
    with pytest.raises(FileFormatError, match="a velocity needs vn and ve"):
        read(table(fixes[:, :5], header="t,lat,lon,h,vn"), sigma="1,1,1,1,1,1")
    radians = np.column_stack((fixes[:, 0], np.deg2rad(fixes[:, 1:3]), fixes[:, 3]))
    with pytest.raises(FileFormatError, match="latitude and longitude may be degrees or radians"):
        read(table(radians, header="t,lat,lon,h"), sigma="1,1,1")


def test_heights_above_sea_level_become_ellipsoidal(table, fixes):
    path = table(fixes, header=GNSS)
    r = read(path, height="msl", geoid_separation=47.5)
    np.testing.assert_array_equal(r.gnss.llh[:, 2], fixes[:, 3] + 47.5)
    assert any("geoid separation 47.5 m" in note for note in r.metadata.notes)
    assert any("Heights are taken as ellipsoidal" in note for note in read(path).metadata.notes)
    r = read(path, height="ellipsoidal")
    np.testing.assert_array_equal(r.gnss.llh[:, 2], fixes[:, 3])
    assert not any("Heights" in note for note in r.metadata.notes)


def test_longitudes_beyond_half_a_turn_are_wrapped(table, fixes):
    fixes[:, 2] = 350.0
    lon = read(table(fixes, header=GNSS)).gnss.llh[:, 1]
    np.testing.assert_allclose(lon, np.deg2rad(-10.0), rtol=1e-14)  # rounding


def test_odometers_are_read_with_an_accuracy(table):
    rows = [(k * 0.1, 10.8 * k) for k in range(5)]
    path = table(rows, header="t,speed [km/h]")
    with pytest.raises(FileFormatError, match="say sigma_speed"):
        read(path)
    odometer = read(path, sigma_speed=0.05).odometer
    np.testing.assert_allclose(odometer.speed, 3.0 * np.arange(5), rtol=1e-14)  # rounding
    np.testing.assert_array_equal(odometer.sigma, 0.05)
    path = table([(*row, 0.2) for row in rows], header="t,speed,sspeed")
    np.testing.assert_array_equal(read(path).odometer.sigma, 0.2)


def test_a_reference_is_a_trajectory(table, fixes):
    rows = np.column_stack((fixes[:, :7], np.tile((1.0, -2.0, 30.0), (5, 1))))
    r = read(table(rows, header="t,lat,lon,h,vn,ve,vd,roll,pitch,yaw"), series="reference")
    np.testing.assert_allclose(np.rad2deg(r.reference.rpy_nb), rows[:, 7:], atol=1e-9)  # rounding, here and below
    np.testing.assert_allclose(r.reference.v_eb_n, rows[:, 4:7], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(r.reference.llh[:, :2]), rows[:, 1:3], atol=1e-12)
    assert r.gnss is None
    bad = table([(0, 6.4e6, 0, 0, 1, 1, 0, 0)], header="t,x,y,z,qw,qx,qy,qz")
    with pytest.raises(FileFormatError, match=at(bad, 2) + "qw, qx, qy, qz: expected a unit quaternion, got norm"):
        read(bad)


def test_one_table_with_two_series_is_read_by_name(table, still):
    rows = np.column_stack((still, np.linspace(0, 3, 300)))
    path = table(rows, header=HEADER + ",speed")
    r = read(path, units="m/s^2,rad/s", sigma_speed=0.1)
    assert (len(r.imu.t), len(r.odometer.t)) == (300, 300)
    assert read(path, units="m/s^2,rad/s", series="imu").odometer is None
    assert read(path, series="odometer", sigma_speed=0.1).imu is None
