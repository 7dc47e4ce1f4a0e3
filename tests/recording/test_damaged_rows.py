"""Rows that a logger damaged: sorted, or left out and counted, up to a stated share; rows of fixes without a place."""

import numpy as np
import pytest

import schuler
from schuler.exceptions import FileFormatError
from schuler.proposal.damage import leave_out_garbled
from schuler.proposal.files import files_of
from schuler.recording.io import packed
from schuler.units import DEG

N = 400
HEAD = "time [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
RNG = np.random.default_rng(8)
ROWS = [
    f"{0.01 * k:.2f}," + ",".join(f"{x:.4f}" for x in RNG.normal([0.1, -0.2, -9.8, 0.01, 0.02, 0.03], 0.01))
    for k in range(N)
]


def written(path, rows, head=HEAD):
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def swapped(rows):
    return [*rows[:50], rows[51], rows[50], *rows[52:90], *rows[91:95], rows[90], *rows[95:]]


def repeated(rows):
    return [*rows[:50], rows[49], *rows[50:]]


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [(swapped, "2 times a row came after a later one: 7 rows were sorted"), (repeated, "1 rows repeat the time")],
)
def test_late_and_repeated_rows_are_mended_where_a_share_is_stated(tmp_path, damage, sentence):
    clean = schuler.read(written(tmp_path / "clean.csv", ROWS)).need_imu()
    path = written(tmp_path / "imu.csv", damage(ROWS))
    with pytest.raises(FileFormatError, match="expected increasing times"):
        schuler.read(path)
    log = schuler.read(path, bad_lines=0.01)
    np.testing.assert_array_equal(log.need_imu().t, clean.t)
    np.testing.assert_array_equal(log.need_imu().gyro, clean.gyro)
    assert any(sentence in note for note in log.metadata.notes)


def test_rows_without_a_number_are_left_out_and_the_gap_is_said(tmp_path):
    rows = [*ROWS[:50], "0.50" + ",nan" * 6, *ROWS[51:]]
    log = schuler.read(written(tmp_path / "imu.csv", rows), bad_lines=0.01)
    assert len(log.need_imu().t) == N - 1
    assert any("1 of 400 rows hold no number" in note for note in log.metadata.notes)
    assert any("1 gap" in note for note in log.metadata.notes)


def test_a_second_run_in_the_file_is_not_sorted_in(tmp_path):
    later = [f"{0.005 + float(row[:4]):.3f}{row[4:]}" for row in ROWS]
    with pytest.raises(FileFormatError, match="earlier than the row before"):
        schuler.read(written(tmp_path / "imu.csv", [*ROWS, *later]), bad_lines=0.01)
    many = [row for k, row in enumerate(ROWS) for _ in range(1 + (k % 50 == 7))]  # 2 %
    far = [
        "1e400" + row[4:] if k % 9 == 7 else row for k, row in enumerate(ROWS)
    ]  # more than the share, and no warning
    with pytest.raises(FileFormatError, match="t is inf"):
        schuler.read(written(tmp_path / "imu.csv", far), bad_lines=0.01)
    with pytest.raises(FileFormatError, match="repeats the time"):
        schuler.read(written(tmp_path / "imu.csv", many), bad_lines=0.01)


def test_lines_are_named_as_in_the_file_after_rows_were_sorted_and_left_out(tmp_path):
    rows = repeated(swapped(ROWS))
    rows[200] = rows[200][:4] + ",0,0,-9.8,0,0,101"
    with pytest.raises(FileFormatError, match="gyro reaches 101") as error:
        schuler.read(written(tmp_path / "imu.csv", rows), bad_lines=0.02)
    assert error.value.line == 202


PLACE = [f"{k},{48.7 + 1e-5 * k:.6f},9.1,300.0,2.0,{0 if k else ''}" for k in range(60)]


@pytest.mark.parametrize("none", ["0,0,0,0,0", "nan,nan,nan,nan,nan", ",,,,", "48.7,9.1,nan,1,1"])
def test_fixes_without_a_place_are_none(tmp_path, none):
    rows = [f"{k},{none}" if k < 7 or k == 30 else row for k, row in enumerate(PLACE)]
    head = "time [s],lat [deg],lon [deg],alt [m],speed [m/s],course [deg]"
    log = schuler.read(written(tmp_path / "gps.csv", rows, head), sigma="3,3,5")
    assert log.need_gnss().t.tolist() == [k for k in range(60) if k >= 7 and k != 30]
    assert any("8 of 60 rows of fixes have no place" in note for note in log.metadata.notes)
    rows[40] = "40,95,9.1,300,2,0"
    with pytest.raises(FileFormatError, match="latitude 95") as error:
        schuler.read(written(tmp_path / "gps.csv", rows, head), sigma="3,3,5")
    assert error.value.line == 42
    with pytest.raises(FileFormatError, match="no row has a number"):
        schuler.read(written(tmp_path / "gps.csv", [f"{k},nan,nan,nan,nan,nan" for k in range(9)], head))


def test_a_folder_with_damaged_rows_is_proposed_with_a_share_and_a_clean_one_without(tmp_path):
    gps = written(tmp_path / "gps.csv", PLACE, "time [s],lat [deg],lon [deg],alt [m],speed [m/s],course [deg]")
    written(tmp_path / "imu.csv", ROWS)
    assert not leave_out_garbled(files_of([tmp_path], {}), {})
    written(tmp_path / "imu.csv", [*swapped(ROWS)[:-1], ROWS[-1][:20]])
    files = files_of([tmp_path], {})
    assert leave_out_garbled(files, {})
    assert files.entries["imu"]["bad_lines"] == 0.01
    assert "bad_lines" not in files.entries["gnss"]
    evidence = next(d.evidence for d in files.decisions if d.entry == "recording.imu.bad_lines")
    assert "7 rows were sorted" in evidence
    assert "1 garbled line of 400" in evidence
    assert not leave_out_garbled(files_of([tmp_path], {}), {"imu": {"bad_lines": 0.0}})
    gps.write_text(gps.read_text())
    written(tmp_path / "imu.csv", [*ROWS, *ROWS])  # two runs: nothing to be left out
    assert not leave_out_garbled(files_of([tmp_path], {}), {})


def test_radians_of_a_place_are_told_from_degrees_in_the_sea(tmp_path):
    written(tmp_path / "imu.csv", ROWS)
    rows = [f"{k},{(48.7 + 1e-5 * k) * DEG:.9f},{9.1 * DEG:.9f},300.0" for k in range(60)]
    written(tmp_path / "gps.csv", rows, "time [s],lat,lon,alt [m]")
    files = files_of([tmp_path], {})
    assert files.entries["gnss"]["units"] == "angle=rad"
    np.testing.assert_allclose(schuler.read(tmp_path, **files.entries).need_gnss().llh[0, 0], 48.7 * DEG, atol=1e-9)
    written(tmp_path / "gps.csv", [f"{k},{1e-5 * k:.9f},0.001,300.0" for k in range(60)], "time [s],lat,lon,alt [m]")
    assert "angle" not in files_of([tmp_path], {}).entries["gnss"].get("units", "")  # made up at zero: asked


def test_of_two_clocks_the_one_that_all_sensors_rows_have_is_taken(tmp_path):
    axes = [f"{axis} {name}" for name in ("Accel [x8004]", "Gyro [x8005]") for axis in "XYZ"]
    head = ",".join(["GPS TOW", "IMU Timestamp [x800E]", *axes, "Lat [x8103]", "Long [x8103]", "Height [x8103]"])
    imu = [f"{float(row[:4]) + 1e5:.2f},{77 + 625 * k}{row[4:]},,," for k, row in enumerate(ROWS)]
    fixes = [f"{1e5 + k + 0.005:.3f},,,,,,,,{48.7 + 1e-5 * k:.6f},9.1,300.0" for k in range(4)]
    rows = [row for k, row in enumerate(imu) for row in ([row] if k % 100 else [row, fixes[k // 100]])]
    path = written(tmp_path / "log.csv", rows, head)
    tables = {name: packed.resolved(path / name).read_text().splitlines() for name in packed.tables(path)}
    assert all(rows[0].startswith("GPS TOW") and "Timestamp" not in rows[0] for rows in tables.values())
    assert sorted(map(len, tables.values())) == [5, 401]


def test_rows_shorter_than_their_header_are_refused_by_what_is_proposed_too(tmp_path):
    path = written(tmp_path / "imu.csv", [row.rpartition(",")[0] for row in ROWS], "t,gx,gy,gz,ax,ay,az")
    with pytest.raises(FileFormatError, match="the header names 7 columns"):
        schuler.read(path, **files_of([path], {}).entries)


def test_of_two_files_of_one_receiver_that_with_velocities_is_taken(tmp_path):
    written(tmp_path / "imu.csv", ROWS)
    head = "time [s],lat [deg],lon [deg],alt [m]"
    places = [row.rsplit(",", 2)[0] for row in PLACE]
    written(tmp_path / "gps.csv", places, head)
    written(tmp_path / "locations.csv", PLACE, f"{head},speed [m/s],course [deg]")
    assert files_of([tmp_path], {}).entries["gnss"]["file"] == "locations.csv"
    # ten times as many are a filter's, beside which the receiver's by its name is taken
    often = [f"{0.1 * k:.1f},{48.7 + 1e-6 * k:.7f},9.1,300.0,2.0,0" for k in range(600)]
    written(tmp_path / "locations.csv", often, f"{head},speed [m/s],course [deg]")
    assert files_of([tmp_path], {}).entries["gnss"]["file"] == "gps.csv"


@pytest.mark.parametrize("at", [1, 3, 700, -1])
@pytest.mark.parametrize(
    "line", [b"\0" * 600, b"0.03\0,0,0.01,-9.81,0,0.001,0", b"\0\0\xff\0,1", b"\0" * 512 + b"7.0,0"]
)
def test_lines_with_zero_bytes_are_garbled_as_others_are(tmp_path, at, line):
    rows = [b"%.2f,0.0,0.01,-9.81,0.0,0.001,0.0" % (0.01 * k) for k in range(1000)]
    rows[at] = line
    path = tmp_path / "imu.csv"
    path.write_bytes(b"\n".join([b"t_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", *rows]) + b"\n")
    with pytest.raises(FileFormatError, match=rf"imu.csv:{at % 1000 + 2}: "):
        schuler.read(path)
    log = schuler.read(path, bad_lines=0.01)
    assert len(log.imu) == 999
    assert "1 garbled line of 1000 was left out." in log.metadata.notes


@pytest.mark.parametrize("line", ["Serial port opened", "x", "ab\0c", "connected, 3 sensors"])
def test_words_below_a_header_that_names_the_numbers_are_a_garbled_line(tmp_path, line):
    path = written(tmp_path / "imu.csv", [line, *ROWS])
    with pytest.raises(FileFormatError, match=r"bad_lines=0\.01") as error:
        schuler.read(path)
    assert error.value.line == 2
    log = schuler.read(path, bad_lines=0.01)
    assert len(log.imu) == N
    assert "1 garbled line of 401 was left out." in log.metadata.notes
    files = files_of([path], {})
    assert leave_out_garbled(files, {})
    assert files.entries["bad_lines"] == 0.01


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        ("a,b,c,d,e,f,g", ROWS),  # as wide as the header: which of the two names the numbers?
        ("Serial port opened", [row.rpartition(",")[0] for row in ROWS]),  # the numbers are not the header's
        ("Serial port opened", []),
    ],
)
def test_words_below_a_header_are_refused_where_numbers_do_not_fit_it(tmp_path, words, rows):
    path = written(tmp_path / "imu.csv", [words, *rows])
    with pytest.raises(FileFormatError, match=r"expected numbers below the header in line 1.*skip=") as error:
        schuler.read(path)
    assert error.value.line == 2


@pytest.mark.parametrize("blob", [b"\0\1\2\3" * 99, np.arange(400.0).tobytes(), b"\0" * 99 + b"text without end" * 9])
def test_binary_data_below_a_header_of_text_are_no_table(tmp_path, blob):
    path = tmp_path / "log.dat"
    path.write_bytes(b"t,ax,ay,az,gx,gy,gz\n" + blob)
    with pytest.raises(FileFormatError, match="a binary file"):
        schuler.read(path, bad_lines=0.4)
