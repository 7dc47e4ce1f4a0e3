"""Layouts of logs that people publish: labels in groups, stamps of two kinds, positions without GGA, half an IMU."""

import numpy as np
import pytest

from schuler import read, units
from schuler.exceptions import FileFormatError, InputError
from schuler.proposal import tables
from schuler.proposal.files import files_of
from schuler.recording.formats.nmea import read_nmea
from schuler.recording.io import columns, dates, line_forms, text_head
from schuler.recording.io.folder import names_in
from schuler.recording.io.hints import ReadHints

SAME_INSTANT_NS = 1_640_207_386_000_000_000


def names_of(path):
    return [column and column[0] for column in text_head.columns_of(text_head.open_text(path, ReadHints()))]


def test_an_accelerometer_named_with_its_chip_comes_before_acceleration_without_gravity():
    head = [f"{s}.{x}" for s in ("linear_Acceleration", "accelerometer_lsm6ds3_c", "gravity") for x in "xyz"]
    named = [column and column[0] for column in columns.recognise_all(head)]
    assert named == [None, None, None, "ax", "ay", "az", None, None, None]
    alone = [column and column[0] for column in columns.recognise_all(head[:3])]  # of ROS it is the specific force
    assert alone == ["ax", "ay", "az"]


def test_axes_behind_the_name_of_a_chip_are_those_of_its_sensors():
    head = [f"{s}_{t}{x}" for s in ("mpu", "est") for t in "ag" for x in "xyz"]  # est: of a filter
    named = [column and column[0] for column in columns.recognise_all(head)]
    assert named == ["ax", "ay", "az", "gx", "gy", "gz", *[None] * 6]
    two = [f"{s}_a{x}" for s in ("mpu", "adxl") for x in "xyz"]
    assert columns.recognise_all(two) == [None] * 6  # either may be meant


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("Wed Dec 22 21:09:46 2021", 0),
        ("Dec 22 21:09:46.5 2021", 500_000_000),
        ("Wed Dec 22 21:09:46 UTC 2021", 0),
    ],
)
def test_dates_as_c_and_unix_write_them(text, ns):
    stamps, zoned, bad = dates.unix_ns([text])
    assert (stamps.tolist(), zoned, bad) == ([SAME_INSTANT_NS + ns], "UTC" in text, None)


def test_a_month_that_there_is_none_is_named():
    assert dates.unix_ns(["Wed Dec 22 21:09:46 2021", "Wed Dez 22 21:09:46 2021"])[2] == 1


@pytest.mark.parametrize(
    ("date", "meant"), [("2021-12-22T21:09:46.000Z", "Timestamp"), ("2021-12-22T21:09:46Z", "Epoch_MS")]
)
def test_a_date_and_the_same_as_unix_time_are_one_clock_the_finer_of_both(date, meant, tmp_path):
    head = ["id", "Timestamp", "Epoch_MS", "ax", "ay", "az", "gx", "gy", "gz"]
    path = tmp_path / "log.csv"
    path.write_text(",".join(head) + f"\n1,{date},{SAME_INSTANT_NS // 10**6},0,0,1,0,0,0\n")
    assert head[names_of(path).index("t")] == meant
    assert names_of(path).count("t") == 1


def table(path, clocks):
    """Samples at rest at 100 Hz with clocks before them."""
    n = len(next(iter(clocks.values())))
    rows = (",".join((*row, "0", "0", "9.8", "0", "0", "0")) for row in zip(*clocks.values(), strict=True))
    path.write_text("\n".join([",".join((*clocks, "ax", "ay", "az", "gx", "gy", "gz")), *rows, ""]))
    return ["-"] * len(clocks) + ["ax", "ay", "az", "gx", "gy", "gz"], n


def test_of_clocks_in_different_units_unix_time_is_taken(tmp_path):
    k = np.arange(400)
    clocks = {
        "log_mono_ns": [str(1543247128889 + 10_000_000 * i) for i in k],
        "t_wall_unix": [f"{1788460722.719 + 0.01 * i:.3f}" for i in k],
    }
    names, _ = table(tmp_path / "imu.csv", clocks)
    assert tables.clock_column(tmp_path / "imu.csv", names) == 1


@pytest.mark.parametrize(("pace", "column"), [(1.0, 1), (1.05, None)])
def test_of_clocks_that_run_together_the_evener_is_the_sensor_s(pace, column, tmp_path):
    k = np.arange(400)
    late = np.abs(np.random.default_rng(1).normal(0.0, 4.0, 400))
    clocks = {
        "rx": [f"{pace * 10.0 * i + x:.0f}" for i, x in zip(k + 50, late, strict=True)],
        "tx": [str(10 * i) for i in k],
    }
    names, _ = table(tmp_path / "log.csv", clocks)
    assert tables.clock_column(tmp_path / "log.csv", names) == column


def test_fixes_without_a_named_time_have_the_column_that_is_unix_time(tmp_path):
    rows = [f"{k},{1715966000123 + 1000 * k},{50.1 + 1e-4 * k:.6f},8.6{k:04d}" for k in range(40)]
    path = tmp_path / "location.csv"
    path.write_text("\n".join(["no,dt,lat,lon", *rows, ""]))
    names = ["-", "-", "lat", "lon"]
    assert tables.clock_column(path, names) == 1
    path.write_text("\n".join(["no,dt,lat,lon", *[row.replace("1715966", "15966") for row in rows], ""]))
    assert tables.clock_column(path, names) is None  # a counter may be anything


def test_a_rate_stated_as_an_angle_is_by_the_second_beside_a_specific_force(tmp_path):
    head = "time [ms]," + ",".join([*(f"a {x} [mg]" for x in "xyz"), *(f"g {x} [mDeg]" for x in "xyz")])
    path = tmp_path / "log.csv"
    path.write_text(head + "\n" + "".join(f"{10 * k},0,0,-1000,3000,0,0\n" for k in range(50)))
    names = "t,ax,ay,az,gx,gy,gz"
    recording = read(path, columns=names)
    np.testing.assert_allclose(recording.imu.gyro[:, 0], 3.0 * units.DEG, rtol=1e-12)  # rounding
    assert sum("taken as mDeg/s" in note for note in recording.metadata.notes) == 1
    path.write_text(path.read_text().replace("[mg]", "[m/s]"))
    with pytest.raises(FileFormatError, match="no unit of specific force"):  # increments are not rates
        read(path, columns=names)


LINE = (
    "2025-10-04 16:21:42.{ms:03d},EULER(deg): R=1.20,P=0.36,Y=-167.64,GYRO(rad/s): X=-0.10,Y=0.20,Z=0.30,"
    "ACCEL(m/s²): X=0.06,Y=-0.20,Z=-9.79,MAG(Gauss): X=-38.7,Y=11.9,Z=42.0,TIME_MS: {t},GPS: {fix},SAT=3,"
    "POS: LAT=11.378805,LON=20.000000,ALT=-2.57m\n"
)


def test_labels_in_groups_are_axes_of_their_sensors_whatever_the_words_between(tmp_path):
    path = tmp_path / "imu_data.log"
    lines = [LINE.format(ms=k // 2, t=3010650 + 10 * k, fix="3D_FIX" if k > 30 else "NO_FIX") for k in range(60)]
    path.write_text("".join(lines), encoding="utf-8")
    rows = list(line_forms.free_rows(path))
    assert len({kind for kind, _ in rows}) == 1
    row = rows[-1][1]
    assert [row[f"ACCEL_{x} [m/s²]"] for x in "XYZ"] == ["0.06", "-0.20", "-9.79"]
    assert [row[f"GYRO_{x} [rad/s]"] for x in "XYZ"] == ["-0.10", "0.20", "0.30"]
    assert (row["POS_LAT"], row["POS_ALT [m]"], row["TIME_MS"], "time" in row) == (
        "11.378805",
        "-2.57",
        "3011240",
        False,
    )


def sentence(body):
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n"


def rmc(k, status="A"):
    return sentence(f"GPRMC,0144{k:02d}.000,{status},3520.{2000 + k},N,13937.9867,E,1.94,90.00,250916,,,A")


def test_positions_of_rmc_are_fixes_without_heights_where_there_is_no_gga(tmp_path):
    path = tmp_path / "GPS.TXT"
    path.write_text(rmc(0, "V") + "".join(map(rmc, range(1, 31))), newline="")
    recording = read_nmea(path)
    gnss = recording.gnss
    assert len(gnss) == 30
    np.testing.assert_allclose(gnss.llh[0], [units.DEG * (35 + 20.2001 / 60), units.DEG * (139 + 37.9867 / 60), 0.0])
    np.testing.assert_allclose(np.sqrt(gnss.cov_r_n[0].diagonal()), [5.0 / np.sqrt(2.0)] * 2 + [1000.0])
    np.testing.assert_allclose(gnss.v_n[0], [0.0, 1.94 * units.KNOT, 0.0], atol=1e-12)  # rounding
    assert gnss.n_satellites is None
    assert gnss.dop is None
    assert any("without heights" in note for note in recording.metadata.notes)
    gga = sentence("GPGGA,014401.000,3520.2001,N,13937.9867,E,1,08,1.0,20.0,M,36.0,M,,")
    path.write_text(gga + "".join(map(rmc, range(1, 31))), newline="")
    assert len(read_nmea(path).gnss) == 1  # with a GGA, RMC is no fix


def test_sentences_that_lost_bytes_are_counted_in_the_refusal(tmp_path):
    path = tmp_path / "GPS.TXT"
    path.write_text("".join(rmc(k).replace("250916,", "25091") for k in range(30)), newline="")
    with pytest.raises(FileFormatError, match="30 have a wrong one, since bytes were lost"):
        read_nmea(path)


def test_an_imu_without_a_gyroscope_is_told_so(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("Time,Roll,Pitch,aX,aY,aZ\n" + "".join(f"{0.1 * k:.1f},1,2,0,0,9.8\n" for k in range(40)))
    with pytest.raises(InputError, match=r"names accelerations but no angular rates: .* log the gyroscope too"):
        files_of([path], {})
    with pytest.raises(InputError, match=r"log\.csv has accelerations but no angular rates"):
        files_of([tmp_path], {})


def test_a_header_behind_a_mark_may_have_commas_above_numbers_with_blanks(tmp_path):
    path = tmp_path / "merged.txt"
    path.write_text("### utcPosix,accX,accY,accZ,gyroX,gyroY,gyroZ\n" + "1.5 0 0 9.8 0 0 0\n" * 3)
    opening = text_head.open_text(path, ReadHints())
    assert opening.header == (1, ["utcPosix", *(f"{s}{x}" for s in ("acc", "gyro") for x in "XYZ")])
    assert names_of(path)[1:] == ["ax", "ay", "az", "gx", "gy", "gz"]


@pytest.mark.parametrize(
    ("first", "second", "kept"),
    [
        ("1715966000123", "811020", "timestamp"),
        ("1715966000", "811020", "imu_ms"),  # of whole seconds the counter is finer
        ("811020", "1715966000.25", "imu_ms"),
    ],
)
def test_of_unix_time_and_a_counter_the_former_is_the_clock_unless_it_is_coarse(first, second, kept, tmp_path):
    head = ["id", "timestamp", "imu_ms", "ax", "ay", "az", "gx", "gy", "gz"]
    path = tmp_path / "log.csv"
    path.write_text(",".join(head) + f"\n1,{first},{second},0,0,1,0,0,0\n")
    assert head[names_of(path).index("t")] == kept
    assert names_of(path).count("t") == 1


def test_a_time_that_is_none_gives_way_to_one_that_is(tmp_path):
    path = tmp_path / "gps.csv"
    path.write_text("UNIX_TIMESTAMP(ts)\ttime\tlat\tlon\n1715964782\t0000-00-00 00:00:00\t48.7\t9.1\n")
    assert names_of(path) == ["t", None, "lat", "lon"]
    path.write_text("time\tlat\tlon\n0000-00-00 00:00:00\t48.7\t9.1\n")
    assert names_of(path) == ["t", "lat", "lon"]  # to be refused with its line


def test_milliseconds_may_stand_behind_a_colon():
    assert dates.unix_ns(["2021-12-22 21:09:46:250"])[0].tolist() == [SAME_INSTANT_NS + 250_000_000]


def test_rows_before_there_is_a_time_are_left_out_and_counted(tmp_path):
    stamps = ["nan"] * 3 + [f"2024-05-17T16:53:{k // 10:02d}.{k % 10}00Z" for k in range(40)]
    rows = [f"{stamp},0,0,-9.8,0,0,0,{50 + 1e-5 * (k // 10):.6f},8,100" for k, stamp in enumerate(stamps)]
    path = tmp_path / "flight.csv"
    path.write_text("\n".join(["time,ax,ay,az,gx,gy,gz,lat,lon,h", *rows, ""]))
    imu = read(path, units="m/s^2,rad/s", series="imu")
    assert len(imu.imu) == 40
    assert any("3 of 43 rows have no time" in note for note in imu.metadata.notes)
    fixes = read(path, units="m/s^2,rad/s", series="gnss", sigma="1,1,1").gnss
    assert fixes.t[-1] - fixes.t[0] == pytest.approx(3.0, abs=1e-9)  # rounding; the first fix has no time


def test_folders_of_a_sensor_each_are_one_run(tmp_path):
    for folder, text in (
        ("imu_logs", "t,ax,ay,az,gx,gy,gz\n" + "0,0,0,1,0,0,0\n"),
        ("gps_logs", "t,lat,lon\n0,50,8\n"),
    ):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.csv").write_text(text)
    assert names_in(tmp_path) == ["gps_logs/a.csv", "imu_logs/a.csv"]
    (tmp_path / "gps_logs" / "b.csv").write_text("t,ax,ay,az,gx,gy,gz\n0,0,0,1,0,0,0\n")
    assert names_in(tmp_path) == []  # each may be a run
