"""Our own CSV and Parquet files: nothing is lost, and damaged, newer and foreign files are explained."""

import json
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schuler.exceptions import FileFormatError, InputError, MissingExtraError
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.recording import ImuSeries, Recording
from schuler.recording.formats import parquet
from schuler.recording.formats.parquet import read_table, write_table
from schuler.recording.io import read, write
from schuler.recording.io.dispatch import left_out
from schuler.timebase import TimeBase


def assert_same_satellites(back: Recording, run: Recording) -> None:
    """Equal to the bit, NaN where NaN was, kinds of numbers and all constants."""

    def same(a, b, name: str) -> None:
        assert type(a) is type(b), name
        if is_dataclass(a):
            for f in fields(a):
                same(getattr(a, f.name), getattr(b, f.name), f"{name}.{f.name}")
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, name
            np.testing.assert_array_equal(a, b, err_msg=name)
        else:
            assert a == b, name

    for part in ("observations", "ranges", "ephemerides"):
        same(getattr(back, part), getattr(run, part), part)


def redescribe(path, change):
    """Change the description that a Parquet file carries, and nothing else."""
    with pq.ParquetFile(path) as file:
        groups = [file.read_row_group(k) for k in range(file.num_row_groups)]
    document = json.loads(groups[0].schema.metadata[b"schuler"])
    change(document)
    schema = groups[0].schema.with_metadata({"schuler": json.dumps(document)})
    with pq.ParquetWriter(path, schema) as writer:
        for group in groups:
            writer.write_table(group.cast(schema))


def assert_same(back: Recording, run: Recording, rtol: float = 0.0) -> None:
    assert {f.name for f in fields(Recording)} == {
        "imu", "gnss", "odometer", "reference", "metadata", "heading", "height", "observations", "ephemerides", "ranges"
    }, "a new part has to be written and compared"  # fmt: skip
    assert_same_satellites(back, run)
    for series, names in (
        ("imu", ("t", "gyro", "accel", "temperature", "magnetometer")),
        ("gnss", ("t", "llh", "cov_r_n", "v_n", "cov_v_n", "quality", "n_satellites", "received", "dop")),
        ("odometer", ("t", "speed", "sigma")),
        ("heading", ("t", "value", "sigma")),
        ("height", ("t", "value", "sigma")),
        ("reference", ("t", "r_eb_e", "v_eb_e", "q_eb")),
    ):
        mine, other = getattr(back, series), getattr(run, series)
        given = {*names, "kind", "_cache"}
        assert mine is None or {f.name for f in fields(mine)} <= given, "a new field has to be written and compared"
        assert (mine is None) == (other is None), series
        for name in names if mine is not None else ():
            a, b = getattr(mine, name), getattr(other, name)
            assert (a is None) == (b is None), (series, name)
            if a is not None:
                np.testing.assert_allclose(a, b, rtol=rtol, atol=0.0, err_msg=f"{series}.{name}")
    if back.imu is not None:
        assert back.imu.kind == run.imu.kind
    m, n = back.metadata, run.metadata
    assert (m.name, m.time, m.axes, m.notes, m.options) == (n.name, n.time, n.axes, n.notes, n.options)
    assert n.sources.items() <= m.sources.items()


def test_parquet_keeps_every_bit_of_all_aids(aided, tmp_path):
    [path] = write(aided, tmp_path / "run.parquet")
    assert_same(read(path), aided)
    with pq.ParquetFile(path) as file:
        assert json.loads(file.schema_arrow.metadata[b"schuler"])["format"] == "schuler/recording/2"
        assert file.num_row_groups == 9
        assert file.schema_arrow.field("sqrt_a").metadata == {b"unit": b"m^0.5"}


def test_csv_keeps_every_digit_of_all_aids(aided, tmp_path):
    paths = write(aided, tmp_path / "run.csv")
    assert [p.name for p in paths] == ["run.csv"] + [
        f"run_{part}.csv"
        for part in (
            "gnss", "odometer", "heading", "height", "reference", "observations", "ranges", "ephemerides",
        )
    ]  # fmt: skip
    # rounding: degrees and roots are converted back; satellite parts are compared to the bit
    assert_same(read(paths[0]), aided, rtol=4e-16)
    lines = paths[6].read_text().splitlines()
    assert lines[0].startswith('# schuler {"format": "schuler/csv/2"')
    assert lines[1] == "t [s],sat,signal,pseudorange [m],range_rate [m/s],carrier [cycle],cn0 [dB-Hz],lock"
    assert paths[3].read_text().splitlines()[1] == "t [s],heading [deg],sheading [deg]"
    earlier = [lines[0], *(line.rpartition(",")[0] for line in lines[1:])]  # before there was an indicator of lock
    paths[6].write_text("\n".join(earlier) + "\n")
    again = read(paths[0]).observations
    assert np.array_equal(again.carrier, aided.observations.carrier, equal_nan=True)
    assert not again.lock.any()


def test_what_older_releases_can_read_keeps_its_version(run, tmp_path):
    """A file without new parts is of version 1, whose readers know no other."""
    [path] = write(run, tmp_path / "run.parquet")
    with pq.ParquetFile(path) as file:
        assert json.loads(file.schema_arrow.metadata[b"schuler"])["format"] == "schuler/recording/1"
        assert not {"heading", "sat", "sqrt_a"} & set(file.schema_arrow.names)
    assert '"schuler/csv/1"' in write(run, tmp_path / "run.csv")[0].read_text().splitlines()[0]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_each_new_part_alone(aided, tmp_path, suffix):
    for part in ("heading", "height", "observations", "ranges", "ephemerides"):
        alone = Recording(**{part: getattr(aided, part)}, metadata=aided.metadata)
        [path] = write(alone, tmp_path / f"{part}{suffix}")
        assert_same(read(path), alone, rtol=4e-16)
        assert read(path, series=part).metadata.name == "ring road"


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_parts_without_rows_come_back_empty(aided, tmp_path, suffix):
    nothing = np.zeros(0, dtype=bool)
    empty = replace(
        aided,
        observations=aided.observations.where(nothing[:0].astype(int)),
        ranges=aided.ranges.where(nothing[:0].astype(int)),
        ephemerides=Ephemerides(no_kepler(), no_glonass(), leap_seconds=18),
    )
    [path, *_] = write(empty, tmp_path / f"run{suffix}")
    assert_same(read(path), empty, rtol=4e-16)
    for kepler, glonass in ((aided.ephemerides.kepler, no_glonass()), (no_kepler(), aided.ephemerides.glonass)):
        half = replace(aided, ephemerides=Ephemerides(kepler, glonass))
        [path, *_] = write(half, tmp_path / f"half{suffix}")
        assert_same(read(path), half, rtol=4e-16)
    with pytest.raises(InputError, match="nothing to write; all its parts are empty"):
        write(Recording(ephemerides=empty.ephemerides), tmp_path / f"empty{suffix}")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("satellites"), r"the satellite measurements written with the file are damaged \(KeyError"),
        (lambda d: d["satellites"]["ephemerides"].update(kepler_rows=3), "rows instead of 3 Keplerian"),
        (lambda d: d["satellites"]["observations"].update(signals=["1C"]), "expected places in signals"),
        (lambda d: d["satellites"]["observations"].update(position_e=[1.0]), "instead of 3 numbers"),
        (lambda d: d.update(satellites=[]), "satellite measurements written with the file are damaged"),
    ],
)
def test_damaged_satellite_parts_are_explained(aided, tmp_path, change, message):
    [path] = write(aided, tmp_path / "run.parquet")
    redescribe(path, change)
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_a_csv_of_ranges_without_a_column_is_explained(aided, tmp_path):
    [path] = write(Recording(ranges=aided.ranges, metadata=aided.metadata), tmp_path / "run.csv")
    path.write_text(path.read_text().replace(",cn0 [dB-Hz]", ",snr", 1))
    with pytest.raises(FileFormatError, match=r"run.csv:2: expected the columns of ranges .* got cn0 missing"):
        read(path)


def test_formats_of_one_series_say_what_they_leave_out(aided):
    assert left_out(aided, "run.pos") == "imu, odometer, heading, height, reference, observations, ephemerides, ranges"
    assert "heading" in left_out(aided, "run.kml")
    assert "gnss" not in left_out(aided, "run.kml")
    assert left_out(aided, "run.csv") == left_out(aided, "run.parquet") == ""


def test_shifting_and_merging_move_every_part(aided):
    back = aided.shifted(12.5).shifted(-12.5)
    assert_same(back, aided, rtol=1e-15)  # rounding of the times
    late = aided.shifted(12.5)
    for part in ("heading", "height", "observations", "ranges"):
        np.testing.assert_allclose(getattr(late, part).t, getattr(aided, part).t + 12.5, rtol=1e-15)
    # the same instants: stamps later, epoch earlier
    assert late.observations.epoch_gps_s + late.observations.t[3] == pytest.approx(
        aided.observations.epoch_gps_s + aided.observations.t[3], abs=1e-6
    )  # rounding of seconds since 1980
    a = Recording(imu=aided.imu, height=aided.height, metadata=aided.metadata)
    b = Recording(
        heading=aided.heading, observations=aided.observations, ephemerides=aided.ephemerides, ranges=aided.ranges,
        gnss=aided.gnss, odometer=aided.odometer, reference=aided.reference, metadata=aided.metadata,
    ).shifted(100.0)  # fmt: skip
    merged = a.merged_with(b)
    for part in ("heading", "height", "observations", "ranges"):
        np.testing.assert_allclose(getattr(merged, part).t, getattr(aided, part).t, rtol=1e-15)
    assert merged.observations.epoch_gps_s == merged.metadata.time.epoch_gps_s
    assert len(merged.ephemerides.kepler) == len(aided.ephemerides.kepler)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_parts_of_a_recording_are_kept_as_they_are(run, tmp_path, suffix):
    gnss = replace(run.gnss, v_n=None, cov_v_n=None, quality=None, n_satellites=None, received=None, dop=None)
    imu = ImuSeries(run.imu.t, run.imu.gyro, run.imu.accel, "increment")
    reference = replace(run.reference, v_eb_e=None, q_eb=None, _cache={})
    local = replace(run.metadata, time=TimeBase())
    for part in (
        Recording(imu=imu, metadata=local),
        Recording(gnss=gnss, metadata=run.metadata),
        Recording(reference=reference, metadata=run.metadata),
        Recording(imu=imu, reference=reference, metadata=run.metadata),
        Recording(odometer=run.odometer, metadata=run.metadata),
    ):
        [path, *_] = write(part, tmp_path / f"part{suffix}")
        assert_same(read(path), part, rtol=4e-16)  # rounding, as above


def test_a_renamed_recording(run, tmp_path):
    for suffix in (".csv", ".parquet"):
        [path, *_] = write(run, tmp_path / f"run{suffix}")
        assert read(path, name="other").metadata.name == "other"


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_our_own_files_take_no_hints(run, tmp_path, suffix):
    [path, *_] = write(run, tmp_path / f"run{suffix}")
    with pytest.raises(InputError, match="was written by schuler and needs no hints; leave out axes, units"):
        read(path, axes="RFU", units="g,deg/s")


def test_a_covariance_that_was_changed_is_said_or_refused(run, tmp_path):
    """Between sigmas of metres: a cross term of 50 m^2 is no covariance's, one of 1e30 not even a wrong one's."""
    paths = write(run, tmp_path / "run.csv")
    lines = paths[1].read_text().splitlines()
    column = lines[1].split(",").index("cne [m^2]")

    def with_term(value):
        cells = lines[4].split(",")
        cells[column] = value
        paths[1].write_text("\n".join([*lines[:4], ",".join(cells), *lines[5:]]) + "\n")
        return paths[0]

    back = read(with_term("50.0"))
    assert back.gnss.cov_r_n[2, 0, 1] == 0.0
    expected = "At 1 epochs the rounded covariance of position was not positive definite; its cross terms were dropped."
    assert back.metadata.notes == (*run.metadata.notes, expected)
    with pytest.raises(FileFormatError, match=r"run_gnss\.csv:5: expected cross terms .* up to 1e\+14 .*, got 1e\+30"):
        read(with_term("1e30"))


def test_a_missing_companion_is_noted(run, tmp_path):
    paths = write(run, tmp_path / "run.csv")
    paths[1].unlink()
    back = read(paths[0])
    assert back.gnss is None
    assert "run_gnss.csv, written with this file, is not beside it and was not read." in back.metadata.notes


def test_a_companion_that_names_itself_is_read_once(run, tmp_path):
    paths = write(run, tmp_path / "run.csv")
    paths[1].write_text(paths[0].read_text())
    with pytest.raises(InputError, match="both have: imu"):
        read(paths[0])


def test_an_edited_csv_is_checked_line_by_line(run, tmp_path):
    path = write(Recording(imu=run.imu, metadata=run.metadata), tmp_path / "run.csv")[0]
    lines = path.read_text().splitlines()
    lines[10] = lines[9]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FileFormatError, match=r"run.csv:11: expected increasing times"):
        read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d.update(format="schuler/csv/9"),
            r"the file is schuler/csv/9, written by schuler .* pip install -U",
        ),
        (lambda d: d.update(format="other/csv/1"), "expected the format schuler/csv/2, got 'other/csv/1'"),
        (lambda d: d.pop("metadata"), "the metadata written with the file is damaged"),
        (lambda d: d["metadata"].update(time={"scale": "tai", "epoch_gps_s": 0}), "time base 'tai'"),
        (lambda d: d["metadata"].update(sources=5), "the metadata written with the file is damaged"),
        (lambda d: d.update(series={}), "the list of series written with the file is damaged"),
        (lambda d: d.update(holds=["imu"]), "the line that describes this file is damaged"),
        (lambda d: d.update(holds="gnss2"), "the line that describes this file is damaged"),
        (lambda d: d["series"]["imu"].update(kind=5), "kind: '5' is not known"),
    ],
)
def test_damaged_descriptions_of_a_csv_are_explained(run, tmp_path, change, message):
    path = write(run, tmp_path / "run.csv")[0]
    first, rest = path.read_text().split("\n", 1)
    document = json.loads(first.removeprefix("# schuler "))
    change(document)
    path.write_text(f"# schuler {json.dumps(document)}\n{rest}")
    with pytest.raises(InputError, match=message):
        read(path)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.nc"])
def test_attitudes_of_another_norm_are_refused_and_rounded_ones_made_whole(run, tmp_path, name):
    """What is printed to six digits has a norm that is 1 to 1e-6; a damaged number has another."""

    def written(scale):
        reference = replace(run.reference, q_eb=run.reference.q_eb * scale)
        return write(replace(run, reference=reference), tmp_path / name)[0]

    rounded = read(written(1.0 + 3e-7)).reference
    # rounding of a square root and a division
    np.testing.assert_allclose(np.linalg.norm(rounded.q_eb, axis=1), 1.0, atol=4e-16)
    with pytest.raises(FileFormatError, match=r"expected a unit quaternion, got norm 1\.02"):
        read(written(1.02))


def test_a_broken_description_of_a_csv_names_its_line(run, tmp_path):
    path = write(run, tmp_path / "run.csv")[0]
    text = path.read_text()
    path.write_text(text.replace('{"format"', '{"format', 1))
    with pytest.raises(FileFormatError, match=r"run.csv:1: the line that describes this file is damaged"):
        read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d.update(format="schuler/recording/9"),
            r"the file is schuler/recording/9, written by schuler .*: update",
        ),
        (
            lambda d: d.update(format="schuler/allan/1"),
            "expected the format schuler/recording/2, got 'schuler/allan/1'",
        ),
        (lambda d: d["series"].pop("gnss"), "expected 3 series, got 4 row groups"),
        (lambda d: d["series"]["imu"].update(rows=3), "expected 3 rows of imu, got 400"),
        (lambda d: d.update(series={"gnss": {"rows": 400}, "imu": {}, "odometer": {}, "reference": {}}), "is missing"),
        (lambda d: d["series"]["imu"].update(kind="x"), "imu: kind: expected 'rate' or 'increment', got 'x'"),
    ],
)
def test_damaged_descriptions_of_a_parquet_file_are_explained(run, tmp_path, change, message):
    [path] = write(run, tmp_path / "run.parquet")
    redescribe(path, change)
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_a_parquet_file_carries_units_and_one_row_group_per_series(run, tmp_path):
    [path] = write(run, tmp_path / "run.parquet")
    with pq.ParquetFile(path) as file:
        assert file.num_row_groups == 4
        schema = file.schema_arrow
        assert schema.field("gx").metadata == {b"unit": b"rad/s"}
        assert schema.field("cned" if "cned" in schema.names else "cne").metadata == {b"unit": b"m^2"}
        table = file.read()
    assert table.column("series").to_pylist()[0] == "imu"
    assert table.column("lat").null_count == len(run.imu) + len(run.odometer) + len(run.reference)
    document = json.loads(schema.metadata[b"schuler"])
    assert document["format"] == "schuler/recording/1"
    assert document["metadata"]["sources"] == run.metadata.sources


@pytest.mark.parametrize("damage", [lambda b: b[:-200], lambda b: b[:100], lambda b: b"PAR1" + b"\xff" * 300 + b"PAR1"])
def test_damaged_parquet_files_are_errors_of_ours(run, tmp_path, damage):
    [path] = write(run, tmp_path / "run.parquet")
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(FileFormatError, match=r"cannot be read as Parquet .*is the file complete"):
        read(path)


def test_a_parquet_column_that_ends_before_the_others_is_refused(run, tmp_path):
    """A page whose header states fewer values than there are rows; pyarrow returns the short column without a word."""
    path = tmp_path / "run.parquet"
    imu = run.imu
    write(replace(run, imu=ImuSeries(imu.t[:25], imu.gyro[:25], imu.accel[:25])), path)
    data = bytearray(path.read_bytes())
    group = pq.ParquetFile(path).metadata.row_group(0)
    column = next(group.column(k) for k in range(group.num_columns) if group.column(k).path_in_schema == "ay")
    count = data.index(b"\x2c\x15\x32", column.data_page_offset) + 2  # 25 as a zigzag integer of Thrift
    assert count < column.data_page_offset + 16
    data[count] = 2 * 13
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match="expected 25 rows of imu, got 13 of its column ay"):
        read(path)


def test_columns_of_a_parquet_file_are_forgotten_when_they_are_joined(run, tmp_path, monkeypatch):
    """Stamps and what becomes one array, not all columns beside the arrays: of a day at 200 Hz 1.5 GB."""
    held = {}

    def keep(columns, name, values):
        dict.__setitem__(columns, name, values)
        held[columns._part] = max(held.get(columns._part, 0), len(columns))

    monkeypatch.setattr(parquet._RowGroup, "__setitem__", keep, raising=False)
    [path] = write(run, tmp_path / "run.parquet")
    assert read(path).reference.q_eb is not None
    assert (held["imu"], held["reference"]) == (3, 5)


def test_a_column_of_one_value_is_made_of_parts(run, tmp_path, monkeypatch):
    [whole] = write(run, tmp_path / "whole.parquet")
    monkeypatch.setattr(parquet, "_ALIKE", 7)
    [parts] = write(run, tmp_path / "parts.parquet")
    assert pq.read_table(parts).equals(pq.read_table(whole))


def test_a_parquet_file_with_a_column_twice_is_refused(tmp_path):
    path = write_table(tmp_path / "table.parquet", {"a": np.arange(3.0), "b": np.arange(3.0)}, {"format": "test/1"})
    table = pq.read_table(path)
    pq.write_table(table.rename_columns(["a", "a"]).replace_schema_metadata(table.schema.metadata), path)
    with pytest.raises(FileFormatError, match="each column once, got 'a' twice"):
        read_table(path)


def test_a_foreign_parquet_file_is_read_with_hints(still, tmp_path):
    names = ["stamp", "fx", "fy", "fz", "wx", "wy", "wz"]
    path = tmp_path / "foreign.parquet"
    pq.write_table(pa.table(dict(zip(names, still.T, strict=True))), path)
    with pytest.raises(FileFormatError, match=r"not written by schuler: say which column .* it has stamp, fx, fy"):
        read(path)
    mapped = "t=stamp,ax=fx,ay=fy,az=fz,gx=wx,gy=wy,gz=wz"
    for columns in (mapped, "t,ax,ay,az,gx,gy,gz"):
        np.testing.assert_array_equal(read(path, columns=columns, units="m/s^2,rad/s").imu.accel, still[:, 1:4])
    with pytest.raises(FileFormatError, match="columns names 2 of 7 columns"):
        read(path, columns="t,ax", units="m/s^2,rad/s")
    with pytest.raises(FileFormatError, match=r"there is no array 'f'; the file holds stamp \(300\)"):
        read(path, columns="t=stamp,ax=f", units="m/s^2,rad/s")
    with pytest.raises(FileFormatError, match="was not written by schuler"):
        read_table(path)


def test_tables_are_written_and_read_back(tmp_path):
    columns = {
        "t": np.array([0.0, 0.1]),
        "rejected": np.array([3, -4]),
        "used": np.array([True, False]),
        "kind": np.array(["position", "zupt"]),
    }
    meta = {"format": "schuler/solution/1", "states": ["dpsi", "dv"], "seed": np.int64(7), "path": tmp_path}
    path = write_table(tmp_path / "deep" / "solution.parquet", columns, meta)
    back, document = read_table(path, "schuler/solution/1")
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)
    assert back["rejected"].dtype == np.int64
    assert document["states"] == ["dpsi", "dv"]
    assert document["seed"] == 7
    assert document["package"].startswith("schuler")
    with pytest.raises(FileFormatError, match="expected the format schuler/allan/1, got 'schuler/solution/1'"):
        read_table(path, "schuler/allan/1")
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_table(tmp_path / "absent.parquet")
    with pytest.raises(FileFormatError, match="columns are missing: t_s"):
        read(path)


@pytest.mark.parametrize(
    ("columns", "meta", "message"),
    [
        ({}, {"format": "a/1"}, "expected at least one column"),
        ({"t": np.zeros(3)}, {}, "a format name in meta"),
        ({"t": np.zeros(3), "x": np.zeros(4)}, {"format": "a/1"}, "expected columns of one length"),
        ({"t": np.zeros((3, 2))}, {"format": "a/1"}, "expected columns of one length and one axis"),
        ({"t": np.zeros(3, dtype=complex)}, {"format": "a/1"}, "got complex128 in 't'"),
        ({"t": np.zeros(3)}, {"format": "a/1", "x": float("nan")}, "expected finite numbers, got NaN"),
    ],
)
def test_tables_that_cannot_be_written_are_explained(tmp_path, columns, meta, message):
    with pytest.raises(InputError, match=message):
        write_table(tmp_path / "x.parquet", columns, meta)
    assert not list(tmp_path.iterdir())


def test_unknown_suffixes_and_options_are_explained(run, tmp_path):
    with pytest.raises(InputError, match=r"cannot tell the format from '.xlsx'; write to .parquet, .csv"):
        write(run, tmp_path / "run.xlsx")
    with pytest.raises(InputError, match=r"option of .kml: 'color' is not known; did you mean 'colour'"):
        write(run, tmp_path / "run.kml", color="quality")
    with pytest.raises(InputError, match=r"option of .csv: 'digits' is not known"):
        write(run, tmp_path / "run.csv", digits=3)


def test_without_pyarrow_the_extra_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"writing Parquet needs pyarrow.*pip install 'schuler\[data\]'"):
        write(run, tmp_path / "run.parquet")
    (tmp_path / "x.parquet").write_bytes(b"PAR1")
    with pytest.raises(MissingExtraError, match="reading Parquet needs pyarrow"):
        read(tmp_path / "x.parquet")


def test_importing_the_readers_is_cheap():
    code = "import sys, schuler.recording.io; print([m for m in ('scipy', 'pyarrow', 'pandas') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_failed_write_leaves_nothing_behind(run, tmp_path):
    bad = replace(run, metadata=replace(run.metadata, options={"x": float("inf")}))
    for suffix in (".csv", ".parquet"):
        with pytest.raises(InputError, match="expected finite numbers, got NaN or infinity"):
            write(bad, tmp_path / f"run{suffix}")
    assert not list(tmp_path.iterdir())
