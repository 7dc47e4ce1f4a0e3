"""Files that hold several tables are read as a folder of them: the same numbers, whatever their form."""

import contextlib
import functools
import json
import operator

import numpy as np
import pytest
from tests.fuzz import mutators, targets

from schuler import read
from schuler.cli import main
from schuler.exceptions import FileFormatError, SchulerError
from schuler.proposal.files import files_of
from schuler.recording.io import packed

N = 240
T = np.arange(N) / 50.0
RNG = np.random.default_rng(3)
ACCEL = np.round(RNG.normal([0.2, -0.1, -9.8], 0.3, (N, 3)), 4)
GYRO = np.round(RNG.normal(0.0, 0.2, (N, 3)), 5)
FIX = np.arange(0, N, 50)  # a fix a second
LLH = np.array([[48.7 + 1e-5 * k, 9.1 - 2e-5 * k, 300.0 + k] for k in range(len(FIX))])


def texts(values):
    return [repr(float(x)) for x in values]


def interleaved(imu, fix):
    """Lines of samples with those of fixes between them."""
    out = []
    for k in range(N):
        out += imu(k)
        if k in FIX:
            out.append(fix(int(np.flatnonzero(k == FIX)[0])))
    return out


def json_lines(kinds):
    """Objects by the keys they have, or by a key that says what they are."""
    word = {"sensor": "imu"}, {"sensor": "gps"}
    return interleaved(
        lambda k: [json.dumps({**(word[0] if kinds else {}), "t": T[k], "acc": ACCEL[k].tolist(),
                               "gyro": dict(zip("xyz", GYRO[k].tolist(), strict=True))})],
        lambda k: json.dumps({**(word[1] if kinds else {}), "t": T[FIX[k]], "lat": LLH[k, 0], "lon": LLH[k, 1],
                              "alt": LLH[k, 2], "ok": True}),
    )  # fmt: skip


def json_list():
    return ["[" + ",\n".join(json_lines(False)) + "]"]


def json_columns():
    imu = {"t": T.tolist(), "acc": ACCEL.tolist(), "gyro": GYRO.tolist()}
    fix = {"t": T[FIX].tolist(), "lat": LLH[:, 0].tolist(), "lon": LLH[:, 1].tolist(), "alt": LLH[:, 2].tolist()}
    return [json.dumps({"device": "one", "imu": imu, "gps": fix})]


def labels():
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    return interleaved(
        lambda k: [
            " ".join(f"{n}:{x}" for n, x in zip(("t", *names), texts([T[k], *ACCEL[k], *GYRO[k]]), strict=True))
        ],
        lambda k: f"t={T[FIX[k]]}, lat={LLH[k, 0]}, lon={LLH[k, 1]}, alt={LLH[k, 2]}",
    )


def words():
    head = ["%", "", "% ACCE;AppTimestamp(s);SensorTimestamp(s);Acc_X(m/s^2);Acc_Y(m/s^2);Acc_Z(m/s^2)",
            "% GYRO;AppTimestamp(s);SensorTimestamp(s);Gyr_X(rad/s);Gyr_Y(rad/s);Gyr_Z(rad/s)"]  # fmt: skip
    return head + interleaved(
        lambda k: [";".join(["ACCE", *texts([T[k], 7e4 + T[k], *ACCEL[k]])]),
                   ";".join(["GYRO", *texts([T[k], 7e4 + T[k], *GYRO[k]])])],
        lambda k: ";".join(["GNSS", *texts([T[FIX[k]], *LLH[k]])]),
    )  # fmt: skip


def column(head="time,sensor,x,y,z"):
    return [head, *interleaved(
        lambda k: [",".join([repr(float(T[k])), name, *texts(v)])
                   for name, v in (("accelerometer", ACCEL[k]), ("gyroscope", GYRO[k]))],
        lambda k: ",".join([repr(float(T[FIX[k]])), "location", *texts(LLH[k])]),
    )]  # fmt: skip


def labels_behind_a_log():
    """Levels, milliseconds and a name before each line, as ESP-IDF writes them."""
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    return ["I (311) boot: ESP-IDF v5.0"] + [
        f"I ({1000.0 * t:.0f}) MPU6050: " + " ".join(f"{n}={x}" for n, x in zip(names, texts([*a, *g]), strict=True))
        for t, a, g in zip(T, ACCEL, GYRO, strict=True)
    ]


def words_around_numbers():
    """As a terminal shows them behind what the device said when it started."""
    head = ["ets Jul 29 2019 12:21:46", "rst:0x1 (POWERON_RESET)", "I (29) boot: version 4.4.5"]
    return head + interleaved(
        lambda k: [f"I ({20 * k}) IMU: a=({', '.join(texts(ACCEL[k]))}) g=({', '.join(texts(GYRO[k]))}) T=34.5"],
        lambda k: f"I ({20 * FIX[k]}) GPS: Location: {LLH[k, 0]},{LLH[k, 1]}  Alt: {LLH[k, 2]}m  Sats: {7 + k % 3}",
    )


def names_before_numbers():
    def row(kind, counts, names, values):
        pairs = ",".join(f"{name},{x}" for name, x in zip(names, texts(values), strict=True))
        packet = f"2024-05-17T18:53:02.{counts // 1000 % 1000:03d},FD,1D,0,{counts % 7:X}"
        return f"{packet},{kind},time_usec,{counts},{pairs},,Len,41"

    names = [f"{axis}{sensor}" for sensor in ("acc", "gyro") for axis in "xyz"]
    return interleaved(
        lambda k: [row("mavlink_raw_imu_t", 20_000 * k, names, [*ACCEL[k], *GYRO[k]])],
        lambda k: row("mavlink_gps_raw_int_t", int(20_000 * FIX[k]), ("lat", "lon", "alt", "eph"), [*LLH[k], 78.0]),
    )


def rows_with_gaps():
    """A row a sensor, below names, units and sources of the columns, some of which come again."""
    head = ["timestamp,latitude,longitude,altitude,speed,lateral_acc,speed,x_acc,y_acc,z_acc,x_rate_of_rotation,"
            "y_rate_of_rotation,z_rate_of_rotation", "s,deg,deg,m,m/s,G,m/s,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s",
            ",gps,gps,gps,gps,calc,calc,acc,acc,acc,gyro,gyro,gyro"]  # fmt: skip
    return head + interleaved(
        lambda k: [",".join([*texts([T[k]]), *[""] * 6, *texts([*ACCEL[k], *GYRO[k]])])],
        lambda k: ",".join([*texts([T[FIX[k]], *LLH[k]]), "0.5", "0.1", "0.5", *[""] * 6]),
    )


def lines_that_name_columns():
    """ArduPilot's text, with a second unit."""
    head = ["FMT, 198, 58, IMU, Qffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ",
            "FMT, 130, 52, GPS, QBLLe, TimeUS,I,Lat,Lng,Alt", "PARM, 1, NAME, 3"]  # fmt: skip

    def imu(k, unit):
        return ", ".join(["IMU", str(20_000 * k), str(unit), *texts([*GYRO[k], *(ACCEL[k] + unit)])])

    return head + interleaved(
        lambda k: [imu(k, 0), imu(k, 1)],
        lambda k: ", ".join(["GPS", str(20_000 * FIX[k]), "0", *texts(LLH[k])]),
    )


def lines_that_name_columns_and_units():
    """FlySight's."""
    head = ["$FLYS,1", "$VAR,DEVICE,003e", "$COL,IMU,time,wx,wy,wz,ax,ay,az",
            "$UNIT,IMU,s,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2", "$COL,GNSS,time,lat,lon,hMSL", "$UNIT,GNSS,s,deg,deg,m",
            "$DATA"]  # fmt: skip
    return head + interleaved(
        lambda k: [",".join(["$IMU", *texts([T[k], *GYRO[k], *ACCEL[k]])])],
        lambda k: ",".join(["$GNSS", *texts([T[FIX[k]], *LLH[k]])]),
    )


def numbers_of_sensors():
    """Sensorstream's; the magnetometer comes with some lines, a fix and its time with few."""

    def row(k, *more):
        values = [("3", ACCEL[k]), ("4", GYRO[k]), *([("5", [1.0, 2.0, 3.0])] if k % 3 == 0 else [])]
        return ", ".join([repr(float(T[k])), *more, *(x for n, v in values for x in (n, *texts(v)))])

    return [
        row(k, "1", *texts(LLH[int(np.flatnonzero(k == FIX)[0])]), "8", "1715964782300") if k in FIX else row(k)
        for k in range(N)
    ]


FORMS = {
    "numbers of sensors": (numbers_of_sensors, "numbered"),
    "words around numbers": (words_around_numbers, "free"), "names before numbers": (names_before_numbers, "pairs"),
    "gaps": (rows_with_gaps, "gaps"), "named columns": (lines_that_name_columns, "named"),
    "named columns and units": (lines_that_name_columns_and_units, "named"),
    "json": (lambda: json_lines(False), "json"), "json with a kind": (lambda: json_lines(True), "json"),
    "list": (json_list, "json-list"), "lists": (json_columns, "json-columns"), "labels": (labels, "labels"),
    "words": (words, "words"), "column": (column, "column"),
    "values": (lambda: column("time,Sensor Type,Value 1,Value 2,Value 3"), "column"),
}  # fmt: skip


def written(tmp_path, rows, name="log.txt"):
    path = tmp_path / name
    path.write_text("\n".join(rows) + "\n")
    return path


def as_proposed(path):
    files = files_of([path], {})
    return files, read(files.log, **files.entries)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("form", FORMS)
def test_lines_that_say_what_they_are_hold_the_numbers_of_an_imu_and_of_fixes(form, tmp_path):
    rows, kind = FORMS[form]
    path = written(tmp_path, rows())
    assert packed.kind_of(path) == kind
    files, recording = as_proposed(path)
    imu, gnss = recording.need_imu(), recording.need_gnss()
    np.testing.assert_allclose(imu.t - imu.t[0], T, atol=1e-9)  # rounding
    np.testing.assert_array_equal(imu.accel, ACCEL)
    np.testing.assert_array_equal(imu.gyro, GYRO)
    np.testing.assert_allclose(np.rad2deg(gnss.llh[:, :2]), LLH[:, :2], atol=1e-12)  # rounding
    np.testing.assert_array_equal(gnss.llh[:, 2], LLH[:, 2])
    np.testing.assert_allclose(gnss.t - imu.t[0], T[FIX], atol=1e-9)
    assert list(recording.metadata.sources) == ["log.txt"]
    beside = tmp_path / "folder"
    beside.mkdir()
    written(beside, rows())
    again = as_proposed(beside)
    assert again[0].entries["gnss"]["file"] == f"log.txt/{files.entries['gnss']['file']}"
    np.testing.assert_array_equal(again[1].need_imu().accel, ACCEL)


def test_hints_that_name_no_part_are_of_the_imu(tmp_path, capsys):
    rows = [json.dumps({"t": t, "acc": a.tolist(), "gyro": g.tolist()}) for t, a, g in zip(T, ACCEL, GYRO, strict=True)]
    path = written(tmp_path, rows + interleaved(lambda k: [], lambda k: json_lines(False)[FIX[k] + k + 1]))
    stated = {"units": "accel=g,gyro=deg/s", "axes": "FLU"}
    files = files_of([path], stated)
    assert files.entries["imu"]["units"] == stated["units"]
    proposed = read(files.log, **files.entries)
    assert len(proposed.need_gnss()) == len(FIX)
    alone = written(tmp_path, rows, "imu.jsonl")
    for recording in (read(alone, **stated), proposed):
        np.testing.assert_allclose(recording.need_imu().accel, 9.80665 * ACCEL * [1.0, -1.0, -1.0], rtol=1e-12)
        np.testing.assert_allclose(recording.need_imu().gyro, np.deg2rad(GYRO * [1.0, -1.0, -1.0]), rtol=1e-12)
    main(["info", str(alone), "--units", "accel=m/s^2,gyro=rad/s", "--axes", "FRD"])  # as the question says to answer
    assert "240 samples" in capsys.readouterr().out


def test_units_behind_numbers_are_their_columns(tmp_path):
    path = written(
        tmp_path, [f"Location: {48.7 + 1e-5 * k:.6f},9.1 Alt: 300.5m Speed: {36 + k}km/h" for k in range(30)]
    )
    [table] = packed.tables(path)
    assert packed.resolved(path / table).read_text().splitlines()[0] == "lat,lon,Alt [m],Speed [km/h]"


def test_a_damaged_document_beside_a_log_is_none_of_its_tables(tmp_path):
    written(tmp_path, json_lines(False))
    (tmp_path / "settings.json").write_text('{"weights": [1, 2, 3], "other": [')
    files, recording = as_proposed(tmp_path)
    assert files.entries["imu"]["file"] == "log.txt/imu.csv"
    assert len(recording.need_imu()) == N


def test_lines_of_no_table_are_counted(tmp_path):
    rows = json_lines(False)
    rows[40], rows[90] = rows[40][:25], "garbage"
    path = written(tmp_path, rows)
    _, recording = as_proposed(path)
    assert len(recording.need_imu()) == N - 2
    assert any("2 lines of log.txt are of no table" in note for note in recording.metadata.notes)


def test_a_list_that_was_cut_off_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="was it cut off"):
        packed.tables(written(tmp_path, [json_list()[0][:-300]]))


@pytest.mark.parametrize("first", [False, True])
def test_a_column_of_remarks_does_not_split_a_table(first, tmp_path):
    names = ["time", "ax", "ay", "az", "gx", "gy", "gz"]
    rows = [names, *(texts([T[k], *ACCEL[k], *GYRO[k]]) for k in range(N))]
    words = ["event", *("lap" if k % 50 == 0 else "none" for k in range(N))]
    both = [[word, *row] if first else [*row, word] for word, row in zip(words, rows, strict=True)]
    path = written(tmp_path, [",".join(row) for row in both])
    assert packed.kind_of(path) is None
    np.testing.assert_array_equal(read(path, units="m/s^2,rad/s").need_imu().accel, ACCEL)


@pytest.mark.parametrize(
    "text", ["{}\n" * 9, "[{}, 1, null, [2]]", '{"a": ' * 4000, "a:1 b:2 c:3 d:4\n" * 2, "[[1, 2]]"]
)
def test_what_is_no_log_is_refused_or_none(text, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(text)
    assert packed.tables(path) in ((), ("others.csv",))
    with pytest.raises(SchulerError):
        read(path)


def test_a_table_that_is_not_in_a_file_is_named_with_those_that_are(tmp_path):
    path = written(tmp_path, json_lines(False))
    with pytest.raises(FileFormatError, match=r"gnss\.csv, imu\.csv"):
        read(path, imu={"file": "accel.csv"})


def test_a_prefix_with_milliseconds_is_a_time(tmp_path):
    recording = as_proposed(written(tmp_path, labels_behind_a_log()))[1]
    np.testing.assert_allclose(recording.need_imu().t - recording.need_imu().t[0], T, atol=1e-9)
    np.testing.assert_array_equal(recording.need_imu().gyro, GYRO)


def test_sentences_between_rows_of_numbers_are_a_log_of_their_own(tmp_path):
    def sentence(k):
        place = f"GPGGA,1000{k:02d}.00,4842.00{k:02d},N,00906.0000,E,1,10,0.9,300.0,M,47.0,M,,"
        bodies = place, f"GPZDA,1000{k:02d}.00,01,05,2024,00,00"
        return "\n".join(f"${body}*{functools.reduce(operator.xor, body.encode()):02X}" for body in bodies)

    rows = interleaved(lambda k: [",".join(["IMU", f"{20 * k}", *texts([*ACCEL[k], *GYRO[k]])])], sentence)
    path = written(tmp_path, rows)
    assert packed.tables(path) == ("7_columns.csv", "sentences.csv")
    gnss = read(path, gnss={"file": "sentences.csv"}).need_gnss()
    np.testing.assert_allclose(gnss.llh[:, 2], 347.0)
    assert len(gnss) == len(FIX)
    imu = read(
        path, imu={"file": "7_columns.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "accel=m/s^2,gyro=rad/s,t=ms"}
    )
    np.testing.assert_array_equal(imu.need_imu().accel, ACCEL)


VBOX = """File created on 12/05/2023 @ 10:11

[header]
time
latitude
longitude

[column names]
sats time lat long velocity heading height vert-vel x_accel y_accel z_accel roll_rate pitch_rate yaw_rate

[data]
"""


def test_minutes_and_longitudes_to_the_west_of_a_vbox(tmp_path):
    rows = [
        f"012 1011{12 + k // 100:02d}.{k % 100:02d} +02922.000229 -{546.0006 + 8e-5 * k:010.5f} 036.0 090.0 "
        f"+00300.5 +000.00 +0.01 -0.02 +1.0 +9.0 {k % 7:.1f} -3.0"
        for k in range(300)
    ]
    path = tmp_path / "VBOX0001.vbo"
    path.write_text(VBOX + "\n".join(rows) + "\n")
    recording = as_proposed(path)[1]
    imu, gnss = recording.need_imu(), recording.need_gnss()
    np.testing.assert_allclose(np.diff(imu.t), 0.01, atol=1e-9)
    np.testing.assert_allclose(imu.gyro[0], np.deg2rad([9.0, 0.0, -3.0]), rtol=1e-12)
    np.testing.assert_allclose(np.rad2deg(gnss.llh[0, :2]), [2922.000229 / 60.0, 546.0006 / 60.0], atol=1e-9)
    np.testing.assert_allclose(gnss.v_n[0, :2], [0.0, 10.0], atol=1e-9)


@pytest.mark.fuzz
@pytest.mark.parametrize("form", FORMS)
def test_damaged_texts_are_read_or_refused_in_words(form, tmp_path):
    """Without the guard of readers: what they do not foresee, warnings among it, is a finding."""
    sample = ("\n".join(FORMS[form][0]()) + "\n").encode()
    rng = np.random.default_rng(11)
    marks = [b"9" * 400, b'"', b"{", b"nan", b"1e999", b",", b"\n", b"\x00", b"[[", b"\xff\xfe"]
    for k in range(40):
        text = bytearray(sample)
        for at in rng.integers(len(text) // 2, size=rng.integers(1, 8)):
            cut = int(rng.choice([0, 1, 3, 50, 2000]))
            text[at : at + cut] = marks[rng.integers(len(marks))] if k % 2 else b""
        path = tmp_path / f"log{k}.txt"
        path.write_bytes(bytes(text) if k < 20 else mutators.damage("csv", sample, k))
        with targets.unguarded(), contextlib.suppress(SchulerError):
            as_proposed(path)


def test_numbers_beyond_all_floats_and_samples_that_are_words_make_no_table(tmp_path):
    signals = {"a": {"unit": "g", "values": [[k, 10**400 if k == 5 else 1.0] for k in range(30)]}}
    (tmp_path / "signals.json").write_text(json.dumps(signals))
    assert packed.tables(tmp_path / "signals.json") == ()
    line = 'Data,2,gps,lat,"581",deg,alt,"x",counts,b,"1|2",counts\n'
    (tmp_path / "log.csv").write_text(40 * line)
    assert packed.tables(tmp_path / "log.csv") == ("gps.csv",)
    (tmp_path / "log.csv").write_text(40 * f'Data,2,gps,lat,"{140_000 * "1"}",deg,b,"1|2",counts\n')
    assert packed.tables(tmp_path / "log.csv") == ()


def test_a_header_names_the_columns_of_kinds_that_stand_first(tmp_path):
    """As phones' ``device_imu.csv`` has it: clocks of two kinds, ``MeasurementX``, and a kind in the first column."""
    path = tmp_path / "device_imu.csv"
    rows = ["MessageType,utcTimeMillis,elapsedRealtimeNanos,MeasurementX,MeasurementY,MeasurementZ,BiasX"]
    for k, t in enumerate(1_715_964_782_000 + 20 * np.arange(N)):
        for kind, values in (("UncalAccel", ACCEL[k]), ("UncalGyro", GYRO[k])):
            rows.append(",".join([kind, str(t), str(91_234_567 + 20_000_000 * k), *texts(values), "0"]))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert packed.tables(path) == ("UncalAccel.csv", "UncalGyro.csv")
    for name, values in (("UncalAccel.csv", ACCEL), ("UncalGyro.csv", GYRO)):
        table = np.genfromtxt(packed.resolved(path / name), delimiter=",", names=True)
        np.testing.assert_array_equal(np.stack([table[axis] for axis in "xyz"], axis=1), values)
        assert table["utcTimeMillis"][0] == 1_715_964_782_000
