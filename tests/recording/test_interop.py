"""Recordings and results to and from pandas, polars and xarray: bit for bit, with units, and frames made by others."""

import re
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from places import ROOT

import schuler
from schuler import rotation
from schuler.exceptions import InputError, MissingExtraError, SchulerError
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation import solution_tables as result_tables
from schuler.navigation.result import Innovations, NavigationResult
from schuler.recording import Recording, Trajectory
from schuler.recording.io import own
from schuler.recording.tables import pandas as frames_pandas
from schuler.recording.tables import polars as frames_polars
from schuler.recording.tables import xarray as frames_xarray
from schuler.recording.tables.tables import Tables, recording_of, tables_of
from schuler.recording.trajectory import FullTrajectory
from schuler.timebase import TimeBase
from schuler.units import DEG, G0, parse_unit

LIBRARIES = {
    "pandas": (frames_pandas.to_pandas, frames_pandas.from_pandas, frames_pandas.tables_from_pandas),
    "polars": (frames_polars.to_polars, frames_polars.from_polars, frames_polars.tables_from_polars),
    "xarray": (frames_xarray.to_xarray, frames_xarray.from_xarray, frames_xarray.tables_from_xarray),
}
PAGE = ROOT / "docs" / "interop.md"


@pytest.fixture(params=list(LIBRARIES))
def library(request):
    pytest.importorskip(request.param)
    return LIBRARIES[request.param]


def assert_same(a, b, where="recording"):
    """Every field of every data class, arrays bit for bit with their type."""
    assert type(a) is type(b), where
    if is_dataclass(a):
        for f in fields(a):
            if not f.name.startswith("_"):
                assert_same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
    else:
        assert a == b, where


def test_a_recording_with_all_its_parts_comes_back_bit_for_bit(aided, library):
    there, back, _ = library
    assert_same(back(there(aided)), aided)


def test_increments_stay_increments(run, library):
    there, back, _ = library
    increments = replace(run, imu=replace(run.imu, kind="increment"))
    assert_same(back(there(increments)), increments)
    assert tables_of(increments).units["imu"]["ax"] == "m/s"


def test_every_part_alone(aided, library):
    there, back, _ = library
    for name in ("imu", "gnss", "odometer", "heading", "height", "reference", "observations", "ranges", "ephemerides"):
        alone = Recording(**{name: getattr(aided, name)}, metadata=aided.metadata)
        assert_same(back(there(alone)), alone, name)


def test_what_is_optional_stays_out(run, library):
    there, back, _ = library
    g, r = run.gnss, run.reference
    bare = replace(
        run,
        imu=replace(run.imu, temperature=None),
        gnss=schuler.GnssSeries(g.t, g.llh, g.cov_r_n),
        reference=Trajectory(r.t, r.r_eb_e),
    )
    assert_same(back(there(bare)), bare)


def test_units_are_attributes(run):
    pytest.importorskip("pandas")
    pytest.importorskip("polars")
    pytest.importorskip("xarray")
    units = {"ax": "m/s^2", "gz": "rad/s", "t": "s", "temp": "degC"}
    frame = frames_pandas.to_pandas(run)["imu"]
    assert units.items() <= frame.attrs["units"].items()
    assert units.items() <= frames_polars.to_polars(run).attributes["imu"]["units"].items()
    tree = frames_xarray.to_xarray(run)
    assert {c: tree["imu"][c].attrs["units"] for c in units} == units
    assert tree["imu"]["ax"].dims == ("t",)
    # units survive what people do with frames
    assert frame[frame["t"] > frame["t"].iloc[5]].attrs["units"] == frame.attrs["units"]
    for table in tables_of(run).units.values():
        for unit in table.values():
            parse_unit(unit)


def test_frames_are_copies(run):
    """What is done to a frame does not reach the recording."""
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    before = run.imu.accel.copy()
    frame = frames_pandas.to_pandas(run)["imu"]
    frame.loc[:, "ax"] = 1e9
    frames_xarray.to_xarray(run)["imu"]["ax"].values[:] = 1e9
    np.testing.assert_array_equal(run.imu.accel, before)


def frame_columns(n=50):
    t = np.arange(n) / 100.0
    one = np.ones(n)
    return {"t": t, "ax": 0 * one, "ay": 0 * one, "az": -one, "gx": one, "gy": 2 * one, "gz": 3 * one}


UNITS = {**dict.fromkeys(("ax", "ay", "az"), "g"), **dict.fromkeys(("gx", "gy", "gz"), "deg/s"), "t": "ms"}


def test_units_of_others_are_converted_and_noted():
    back = recording_of(Tables({"imu": frame_columns()}, {"imu": UNITS}), name="mine")
    np.testing.assert_allclose(back.imu.accel[0], [0, 0, -G0], rtol=1e-15)  # rounding
    np.testing.assert_allclose(back.imu.gyro[0], np.array([1, 2, 3]) * DEG, rtol=1e-15)
    np.testing.assert_allclose(back.imu.t[1], 1e-5, rtol=1e-15)
    assert back.metadata.name == "mine"
    assert back.metadata.time == TimeBase()
    assert any("from g to m/s^2" in note for note in back.metadata.notes)


def test_frames_of_pandas_with_time_as_index_and_surplus_columns():
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({**frame_columns(), "norm": 1.0}).set_index("t")
    frame.attrs["units"] = {k: v for k, v in UNITS.items() if k != "t"}
    back = frames_pandas.from_pandas(frame, kind="rate", time=TimeBase("gps", 1e9))
    np.testing.assert_array_equal(back.imu.t, frame_columns()["t"])
    np.testing.assert_allclose(back.imu.accel[:, 2], -G0, rtol=1e-15)
    assert back.metadata.time == TimeBase("gps", 1e9)
    assert any("left out: norm" in note for note in back.metadata.notes)


def test_a_plain_frame_of_polars_and_a_dataset_of_xarray():
    pl, xr = pytest.importorskip("polars"), pytest.importorskip("xarray")
    a = frames_polars.from_polars(pl.DataFrame(frame_columns()))
    dataset = xr.Dataset({c: (("t",), v) for c, v in frame_columns().items()})
    b = frames_xarray.from_xarray(dataset)
    assert_same(a.imu, b.imu)


def test_standard_deviations_of_gnss_will_do(run):
    g = run.gnss
    columns = {"t": g.t, "lat": g.llh[:, 0] / DEG, "lon": g.llh[:, 1] / DEG, "h": g.llh[:, 2]}
    columns |= {name: np.full(len(g.t), s) for name, s in (("sn", 1.0), ("se", 2.0), ("sd", 3.0))}
    back = recording_of(Tables({"gnss": columns}, {"gnss": {"lat": "deg", "lon": "deg"}})).gnss
    np.testing.assert_array_equal(back.cov_r_n[0], np.diag([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(back.llh, g.llh, rtol=1e-15)  # rounding
    assert back.v_n is None


def test_a_part_of_a_frame_comes_back_as_that_part(run):
    pytest.importorskip("pandas")
    frames = frames_pandas.to_pandas(run)
    back = frames_pandas.from_pandas({"imu": frames["imu"].iloc[10:40]})
    np.testing.assert_array_equal(back.imu.t, run.imu.t[10:40])
    assert back.metadata == run.metadata
    assert frames_pandas.from_pandas(frames["gnss"]).gnss is not None  # one alone knows what it is


def bad(change):
    columns, units, document = frame_columns(), {}, {}
    table = change(columns, units, document) or "imu"
    return Tables({table: columns}, {table: units}, document)


BAD = {
    "a missing column": (lambda c, u, d: c.pop("gy") is None and None, "needs a column 'gy'"),
    "a unit of something else": (lambda c, u, d: u.update(ax="deg"), "expected a unit such as m/s\\^2, got 'deg'"),
    "no unit": (lambda c, u, d: u.update(ax="furlong"), "furlong"),
    "text": (lambda c, u, d: c.update(ax=np.array(["x"] * 50)), "imu.ax: expected numbers"),
    "NaN": (lambda c, u, d: c.update(ax=np.full(50, np.nan)), "the table imu"),
    "times that go back": (lambda c, u, d: c.update(t=c["t"][::-1]), "goes back"),
    "lengths": (lambda c, u, d: c.update(ax=np.zeros(3)), "imu"),
    "another name": (lambda c, u, d: "wheel", "is part of a recording"),
    "dates": (lambda c, u, d: c.update(t=np.arange(50).astype("datetime64[s]")), "imu.t: expected numbers"),
    "a damaged document": (lambda c, u, d: d.update(series=3), "damaged"),
    "damaged metadata": (lambda c, u, d: d.update(metadata={"name": "x"}), "damaged"),
}


@pytest.mark.parametrize(("change", "message"), BAD.values(), ids=list(BAD))
def test_what_cannot_be_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        recording_of(bad(change))


def test_things_of_another_kind_are_refused(run, library):
    there, back, tables = library
    with pytest.raises(InputError, match=r"Recording\(imu=series\)"):
        there(run.imu)
    with pytest.raises(InputError, match="expected"):
        back(3)
    with pytest.raises(InputError, match="navigation result"):
        result_tables.result_of(tables(there(run)))


def test_damaged_attributes_are_refused(run):
    pytest.importorskip("pandas")
    frame = frames_pandas.to_pandas(run)["imu"]
    for text in ("{", "[]", 3.5):
        frame.attrs["schuler"] = text
        with pytest.raises(InputError, match="damaged"):
            frames_pandas.from_pandas(frame)


def test_a_missing_library_names_the_extra(run, monkeypatch):
    import sys

    for name, (there, _, tables) in LIBRARIES.items():
        monkeypatch.setitem(sys.modules, name, None)
        for call in (lambda there=there: there(run), lambda tables=tables: tables({})):
            with pytest.raises(MissingExtraError, match=r"schuler\[frames\]"):
                call()


@pytest.mark.campaign
def test_a_tree_is_laid_out_as_our_netcdf_files(aided, tmp_path):
    xr = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    tree = frames_xarray.to_xarray(aided)
    tree.to_netcdf(tmp_path / "tree.nc", engine="h5netcdf")
    read = schuler.read(tmp_path / "tree.nc")
    assert_same(replace(read, metadata=aided.metadata), aided)
    schuler.write(aided, tmp_path / "ours.nc")
    with xr.open_datatree(tmp_path / "ours.nc", engine="h5netcdf") as opened:
        assert_same(frames_xarray.from_xarray(opened), aided)


@pytest.fixture
def result(run, rng) -> NavigationResult:
    layout = StateLayout(
        {"b_a": StateModel(0.1), "b_g": StateModel(1e-3, 1e-6, 100.0), "lever": StateModel.constant(0.5)}
    )
    k, n, m = len(run.reference), layout.size, 30
    A = rng.standard_normal((k, n, n))
    P = A @ np.swapaxes(A, 1, 2) + np.eye(n)
    nis = np.where(rng.uniform(size=m) < 0.2, np.nan, 1.0)
    innovations = Innovations(
        np.sort(rng.uniform(0, 9, m)), rng.integers(0, 3, m), rng.integers(0, 3, m), nis,
        rng.standard_normal((m, 3)), rng.uniform(1, 2, (m, 3)),
    )  # fmt: skip
    llh = run.gnss.llh
    C_eb = rotation.dcm_from_quat(run.reference.q_eb)
    reference = FullTrajectory.from_geodetic(run.gnss.t, llh, rng.standard_normal((k, 3)), C_eb)
    return NavigationResult(
        reference.at(np.linspace(reference.t[0], reference.t[-1], 25)), reference.t, reference,
        rng.standard_normal((k, n - 9)), 0.5 * (P + np.swapaxes(P, 1, 2)), innovations, layout, 400, 900,
        outages=((1.5, 2.5),), lever_arm_b=rng.standard_normal(3), provenance={"options": {"a": 0.1}}, notes=("one",),
    )  # fmt: skip


def test_a_navigation_result_comes_back_bit_for_bit(result, library):
    there, _, tables = library
    back = result_tables.result_of(tables(there(result_tables.tables_of(result))))
    assert_same(back, result)
    lopsided = replace(result, covariance_e=result.covariance_e + np.triu(np.ones((result.layout.size,) * 2), 1))
    assert_same(result_tables.result_of(tables(there(result_tables.tables_of(lopsided)))), lopsided)


def test_tables_of_a_result_can_be_read_by_people(result):
    tables = result_tables.tables_of(result)
    trajectory, records = tables.columns["trajectory"], tables.columns["records"]
    np.testing.assert_array_equal(trajectory["yaw"], result.trajectory.rpy_nb[:, 2])
    np.testing.assert_array_equal(records["b_g_1"], result.parameter("b_g")[:, 1])
    np.testing.assert_array_equal(records["sigma_dr_down"], result.sigma("dr")[:, 2])
    assert tables.units["trajectory"]["vn"] == "m/s"
    assert tables.units["records"]["sigma_b_g_0"] == "rad/s"


def test_tables_of_a_result_that_are_not_whole_are_refused(result):
    tables = result_tables.tables_of(result)
    for change in ({"records": {}}, {"innovations": {"t": np.zeros(3)}}):
        with pytest.raises(InputError, match="no complete navigation result"):
            result_tables.result_of(replace(tables, columns={**tables.columns, **change}))
    with pytest.raises(SchulerError):
        result_tables.result_of(replace(tables, document={**tables.document, "states": {"nonsense": {"sigma": 1.0}}}))


def test_examples_of_the_page_run(tmp_path, monkeypatch, run):
    for name in ("pandas", "polars", "xarray", "h5netcdf", "pyarrow"):
        pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    schuler.write(run, "drive.parquet")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 4
    for code in blocks:
        exec(compile(code, str(PAGE), "exec"), {})


def test_the_page_names_every_column():
    text = PAGE.read_text(encoding="utf-8")
    words = set(re.findall(r"[A-Za-z_0-9]+", " ".join(re.findall(r"`+[^`]+`+", text))))
    for name in ("imu", "gnss", "odometer", "heading", "height", "reference"):
        assert name in words
        assert own.COLUMNS[name] & set(own.UNITS) <= words, name
