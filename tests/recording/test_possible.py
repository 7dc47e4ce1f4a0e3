"""Numbers that no vehicle, sensor and clock has are refused with their row, in all formats; stated rows are counted."""

import re
from dataclasses import replace

import numpy as np
import pytest

from schuler.cli import main
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.ephemerides import no_glonass
from schuler.recording import Recording
from schuler.recording.io import read, write
from schuler.recording.series import GnssSeries, ImuSeries

ROW = 7


def spoilt(values, row, value):
    """Copy with the last number of a row changed."""
    out = np.array(values)
    out.reshape(len(out), -1)[row, -1] = value
    return out


def beyond(recording, series, field, value):
    part = getattr(recording, series)
    return replace(recording, **{series: replace(part, **{field: spoilt(getattr(part, field), ROW, value)})})


CASES = {
    "a lost decimal point": ("imu", "accel", -9.8e15, r"row 8 of imu \(.*specific force is -9.8e\+15 m/s\^2"),
    "a force": ("imu", "accel", 2500.0, "specific force is 2500 m/s"),
    "a rate": ("imu", "gyro", -150.0, r"angular rate is -150 rad/s, expected up to 100"),
    "a temperature": ("imu", "temperature", -300.0, "temperature is -300 degC"),
    "a height": ("gnss", "llh", 1e9, r"row 8 of gnss .*the height is 1e\+09 m, expected -1.2e\+04 to 1e\+08"),
    "a velocity": ("gnss", "v_n", 8e16, r"velocity is 8e\+16 m/s"),
    "a wheel speed": ("odometer", "speed", 1e5, "speed is 100000 m/s, expected up to 1000"),
    "a radius": ("reference", "r_eb_e", 1e24, r"distance from the Earth's centre is 1e\+24 m"),
    "a speed": ("reference", "v_eb_e", 1.3e4, "velocity is 13000 m/s, expected up to 1.2e.04"),
    "a sigma of height": ("height", "sigma", 1e21, r"1-sigma is 1e\+21 m"),
}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("case", CASES)
def test_an_impossible_number_is_refused_with_its_row_unless_allowed(aided, tmp_path, case, suffix):
    series, field, value, message = CASES[case]
    path = write(beyond(aided, series, field, value), tmp_path / f"run{suffix}")[0]
    with pytest.raises(FileFormatError, match=message + r".*pass allow='magnitude' if it is right"):
        read(path)
    back = read(path, allow="magnitude")
    assert any(note.startswith("Passed over: row 8 of") for note in back.metadata.notes)


def test_a_radius_whose_square_no_number_holds_is_refused(aided, tmp_path):
    path = write(beyond(aided, "reference", "r_eb_e", 1e200), tmp_path / "run.parquet")[0]
    with pytest.raises(FileFormatError, match="distance from the Earth's centre is inf m"):
        read(path)


def test_a_whole_log_beyond_is_a_unit_and_left_to_the_checks(aided, tmp_path):
    counts = replace(aided, imu=replace(aided.imu, accel=400.0 * aided.imu.accel))
    back = read(write(counts, tmp_path / "run.parquet")[0])
    assert any("100 % of the rows have a specific force beyond" in note for note in back.metadata.notes)


def test_the_centre_of_the_earth_is_no_place(aided, tmp_path):
    r = aided.reference.r_eb_e.copy()
    r[ROW] = 0.0
    path = write(replace(aided, reference=replace(aided.reference, r_eb_e=r)), tmp_path / "run.parquet")[0]
    with pytest.raises(FileFormatError, match=r"row 8 of reference .*distance from the Earth's centre is 0 m"):
        read(path)


STILL = {"gyro": (0.01, -0.02, 0.4), "accel": (0.1, -0.2, -9.8)}


def calm(noise=0.2, rate=100.0, n=60):
    """A vehicle that shakes a little."""
    rng = np.random.default_rng(3)
    made = {key: np.array(value) + noise * rng.uniform(-0.3, 0.3, (n, 3)) for key, value in STILL.items()}
    return ImuSeries(np.arange(n) / rate, made["gyro"], made["accel"])


@pytest.mark.parametrize(
    ("field", "value", "unit"), [("accel", 1000.0, "m/s^2"), ("accel", -981.0, "m/s^2"), ("gyro", 57.3, "rad/s")]
)
@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_a_reading_that_stands_alone_is_no_motion(tmp_path, field, value, unit, kind):
    imu = calm()
    imu = replace(imu, **{field: spoilt(getattr(imu, field), ROW, value)})
    if kind == "increment":
        imu = replace(imu, gyro=0.01 * imu.gyro, accel=0.01 * imu.accel, kind=kind)
    path = write(Recording(imu=imu), tmp_path / "run.parquet")[0]
    message = rf"row 8 of imu \(0.07 s\): .* is {value:g} {re.escape(unit)}, those of the three samples .*allow='magn"
    with pytest.raises(FileFormatError, match=message):
        read(path)
    assert len(read(path, allow="magnitude").imu) == 60


@pytest.mark.parametrize("row", [0, 1, 2, -3, -2, -1])
@pytest.mark.parametrize(("field", "value"), [("accel", 1000.0), ("gyro", 57.3)])
def test_a_reading_that_stands_alone_at_an_end_of_the_log_is_no_motion(tmp_path, row, field, value):
    imu = calm()
    reading = getattr(imu, field).copy()
    reading[row, 2] = value
    path = write(Recording(imu=replace(imu, **{field: reading})), tmp_path / "run.parquet")[0]
    with pytest.raises(FileFormatError, match=rf"row {row % 60 + 1} of imu .* is {value:g} "):
        read(path)
    reading[row + 1 if row != -1 else -2] = 0.6 * value  # a blow of two samples
    path = write(Recording(imu=replace(imu, **{field: reading})), tmp_path / "blow.parquet")[0]
    assert len(read(path).imu) == 60


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("row", [0, 1, ROW, -3])
@pytest.mark.parametrize(
    "cells",
    [((0, 2, -981.0), (2, 0, 1000.0)), ((0, 2, 981.0), (1, 2, 981.0)), ((0, 0, 900.0), (1, 1, 300.0), (2, 0, -700.0))],
)
def test_a_few_numbers_of_three_rows_that_no_other_axis_and_sensor_feels_are_no_blow(tmp_path, cells, row, kind):
    imu = calm()
    start = row % len(imu)
    for field, scale, unit in (("accel", 1.0, "m/s"), ("gyro", 0.08, "rad/s")):
        reading = getattr(imu, field).copy()
        for k, axis, value in cells:
            reading[start + k, axis] = scale * value
        wrong = replace(imu, **{field: reading})
        if kind == "increment":
            wrong = replace(wrong, gyro=0.01 * wrong.gyro, accel=0.01 * wrong.accel, kind=kind)
        path = write(Recording(imu=wrong), tmp_path / f"{field}.parquet")[0]
        message = rf"row {start + 1} of imu .* is {scale * cells[0][2]:g} {unit}.*felt along all axes.*allow='magn"
        with pytest.raises(FileFormatError, match=message):
            read(path)
        felt = getattr(wrong, field).copy()  # the same as a blow, aside by two hundredths
        felt[start, (cells[0][1] + 1) % 3] += 0.02 * felt[start, cells[0][1]]
        blow = write(Recording(imu=replace(wrong, **{field: felt})), tmp_path / f"{field}_blow.parquet")[0]
        assert len(read(blow).imu) == 60


def crash(accel, rows, after=(0.0, 0.0, 0.0)):
    out = np.array(accel)
    for k, value in enumerate(rows):
        out[ROW + k, 0] = value
        if len(rows) > 1:  # along no axis exactly
            out[ROW + k, 1] += 0.02 * value
    out[ROW + len(rows) :] += after
    return out


@pytest.mark.parametrize(
    ("what", "rate", "rows", "after"),
    [
        ("a crash of 100 g rings", 100.0, (1000.0, -120.0, 40.0, -12.0), (0, 0, 0)),
        ("a pulse of two samples", 100.0, (900.0, 700.0), (0, 0, 0)),
        ("a fall that ends on another side", 100.0, (1000.0,), (3.0, 0.0, 3.0)),
        ("a tap with a hammer, half a millisecond", 2000.0, (1000.0,), (0, 0, 0)),
        ("a knock of 40 g", 100.0, (392.0,), (0, 0, 0)),
    ],
)
def test_what_a_body_can_feel_passes(tmp_path, what, rate, rows, after):
    imu = calm(rate=rate)
    path = write(Recording(imu=replace(imu, accel=crash(imu.accel, rows, after))), tmp_path / "run.parquet")[0]
    assert read(path).imu.accel.max() == max(rows), what


def test_a_log_of_blows_is_not_refused_for_one_of_them(tmp_path):
    imu = calm()
    accel = crash(imu.accel, (1000.0,))
    accel[30:34, 0] = 600.0, 900.0, -700.0, 300.0
    assert len(read(write(Recording(imu=replace(imu, accel=accel)), tmp_path / "run.parquet")[0]).imu) == 60


SEEN = {"pseudorange": 2.2e13, "range_rate": -1e9, "carrier": 1e15}


@pytest.mark.parametrize("part", ["observations", "ranges"])
@pytest.mark.parametrize("field", SEEN)
def test_ranges_of_no_satellite_are_refused(aided, tmp_path, part, field):
    if part == "ranges" and field == "carrier":
        field, value = "r_sat_e", 1e12
    else:
        value = SEEN[field]
    path = write(beyond(aided, part, field, value), tmp_path / "run.parquet")[0]
    with pytest.raises(FileFormatError, match=rf"row 8 of {part} .*expected up to .*allow='magnitude'"):
        read(path)


def test_messages_of_no_satellite_are_left_out_and_said(aided, tmp_path):
    kepler = aided.ephemerides.kepler
    broken = replace(kepler, e=np.where(np.arange(len(kepler)) == 3, 10.5, kepler.e))
    path = write(replace(aided, ephemerides=replace(aided.ephemerides, kepler=broken)), tmp_path / "run.parquet")[0]
    back = read(path)
    assert len(back.ephemerides.kepler) == len(kepler) - 1
    assert any("1 broadcast messages (" in note and "left out" in note for note in back.metadata.notes)
    none = replace(aided.ephemerides, kepler=replace(kepler, sqrt_a=0.0 * kepler.sqrt_a), glonass=no_glonass())
    path = write(Recording(ephemerides=none, metadata=aided.metadata), tmp_path / "none.parquet")[0]
    with pytest.raises(FileFormatError, match="numbers that a satellite's orbit and clock can have"):
        read(path)


def test_what_was_allowed_once_needs_no_allowance_in_our_own_copy(aided, tmp_path):
    recording = beyond(aided, "imu", "accel", 2500.0)
    meta = replace(recording.metadata, options={"allow": "norm,magnitude"})
    path = write(replace(recording, metadata=meta), tmp_path / "run.parquet")[0]
    assert read(path).imu.accel.max() == 2500.0


def test_stamps_of_no_clock_are_refused(run, tmp_path):
    imu = replace(run.imu, t=run.imu.t + 1e12)
    path = write(Recording(imu=imu), tmp_path / "run.parquet")[0]
    with pytest.raises(FileFormatError, match=r"row 1 of imu \(1e\+12 s\): the stamp is 1e\+12 s"):
        read(path)


def test_fast_but_possible_vehicles_pass(aided, tmp_path):
    """A geostationary satellite's antenna, 3 km/s, seen by a receiver that does not know its height."""
    t = np.arange(5.0)
    llh = np.tile([0.0, 0.3, 35_786e3], (5, 1))
    cov = np.tile(np.diag([1e6, 1e6, 1e12]), (5, 1, 1))
    fast = GnssSeries(t, llh, cov, np.tile([0.0, 3075.0, 0.0], (5, 1)), cov)
    back = read(write(Recording(gnss=fast), tmp_path / "geo.parquet")[0])
    np.testing.assert_array_equal(back.gnss.llh, llh)


@pytest.mark.parametrize("part", ["", "_gnss", "_reference", "_observations"])
@pytest.mark.parametrize("cut", ["one row", "half"])
def test_a_table_of_ours_that_was_cut_off_is_refused(aided, tmp_path, part, cut):
    write(aided, tmp_path / "run.csv")
    path = tmp_path / f"run{part}.csv"
    lines = path.read_bytes().splitlines(keepends=True)
    keep = len(lines) - 1 if cut == "one row" else len(lines) // 2 + 2
    path.write_bytes(b"".join(lines[:keep]))
    with pytest.raises(
        FileFormatError, match=rf"expected {len(lines) - 2} rows of .*, got {keep - 2}: the file was cut"
    ):
        read(tmp_path / "run.csv")


def test_the_command_line_lets_it_pass_in_its_own_spelling(aided, tmp_path, capsys):
    path = write(beyond(aided, "imu", "accel", 2500.0), tmp_path / "run.parquet")[0]
    assert main(["info", str(path)]) == 2
    assert capsys.readouterr().err.count("--allow magnitude") == 1
    assert main(["info", str(path), "--allow", "magnitude"]) == 0


def test_covariances_are_positive_semidefinite():
    t, llh = np.arange(2.0), np.zeros((2, 3))
    good = np.tile(np.eye(3), (2, 1, 1))
    full = good + 0.0
    full[1, 0, 1] = full[1, 1, 0] = 1.0  # fully correlated: singular, but a covariance
    GnssSeries(t, llh, full)
    wrong = good + 0.0
    wrong[1, 0, 1] = wrong[1, 1, 0] = 1.5
    with pytest.raises(InputError, match=r"semidefinite matrices, got an eigenvalue -0\.5 first at index 1"):
        GnssSeries(t, llh, wrong)
    three = good + 0.0  # every pair is possible, all three are not
    for i, j, r in ((0, 1, 0.9), (0, 2, 0.9), (1, 2, -0.9)):
        three[1, i, j] = three[1, j, i] = r
    with pytest.raises(InputError, match="semidefinite"):
        GnssSeries(t, llh, good, np.zeros((2, 3)), three)
