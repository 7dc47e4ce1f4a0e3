"""The folder of a campaign: nothing stored is lost, done twice, or mixed; the same bytes in the end."""

import json
import shutil

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.montecarlo import read_manifest, read_rows
from schuler.montecarlo.engine import campaign
from schuler.montecarlo.fingerprint import fingerprint
from schuler.montecarlo.rows import joined
from schuler.montecarlo.store import Span, identity_of, opened


@pytest.fixture
def runs():
    import montecarlo_runs

    return montecarlo_runs


def table(folder):
    return (folder / "runs.parquet").read_bytes()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.fixture
def undisturbed(runs, tmp_path):
    campaign(runs.fails, {"mean": 2.0}, 300, seed=5, workers=1, store=tmp_path / "undisturbed")
    return tmp_path / "undisturbed"


def test_in_the_end_there_is_one_table(undisturbed, runs):
    assert names(undisturbed) == [".lock", "manifest.json", "runs.parquet"]
    rows = joined(read_rows(undisturbed))
    expected = campaign(runs.fails, {"mean": 2.0}, 300, seed=5, workers=1, keep=True).rows()
    np.testing.assert_array_equal(rows.runs, expected.runs)
    assert rows.failures == expected.failures
    for name, x in expected.columns.items():
        np.testing.assert_array_equal(rows.columns[name], x)
        assert rows.columns[name].dtype == x.dtype


def test_other_programs_can_read_it(undisturbed):
    import pyarrow.parquet as pq

    result = pq.read_table(undisturbed / "runs.parquet")
    assert result.column_names == ["run", "x", "track", "count", "hit"]
    assert result.schema.field("track").type.list_size == 12
    assert result["run"].to_pylist()[:6] == [0, 1, 2, 4, 6, 7]  # 3 and 5 could not be done
    assert json.loads(result.schema.metadata[b"schuler"])["failures"]["5"] == "x is not finite"


@pytest.mark.thinned(3)
@pytest.mark.parametrize("options", [{"batch": 1}, {"batch": 37}, {"workers": 3, "pool": "threads"}])
def test_the_same_bytes_for_any_batches(undisturbed, runs, tmp_path, options):
    campaign(runs.fails, {"mean": 2.0}, 300, seed=5, store=tmp_path / "s", **{"workers": 1, **options})
    assert table(tmp_path / "s") == table(undisturbed)


def test_the_same_bytes_when_it_grew(undisturbed, runs, tmp_path):
    for wanted in (40, 170, 300):
        got = campaign(runs.fails, {"mean": 2.0}, wanted, seed=5, workers=1, store=tmp_path / "s")
    assert got.executed == 130
    assert table(tmp_path / "s") == table(undisturbed)
    fewer = campaign(runs.fails, {"mean": 2.0}, 100, seed=5, workers=1, store=tmp_path / "s")
    assert (fewer.executed, fewer.done, fewer.where) == (0, 100, "nobody: all were stored")
    assert fewer.column("x")[-1] == joined(read_rows(undisturbed)).where(0, 99).columns["x"][-1]
    assert table(tmp_path / "s") == table(undisturbed)


def test_row_groups_do_not_show_how_it_was_filled(runs, tmp_path, monkeypatch):
    """Small row groups, so that parts cross their borders."""
    monkeypatch.setattr("schuler.montecarlo.part_file._GROUP_BYTES", 2000)
    for name, batch in (("a", 300), ("b", 7), ("c", 64)):
        campaign(runs.values, {}, 300, workers=1, batch=batch, store=tmp_path / name)
    assert table(tmp_path / "a") == table(tmp_path / "b") == table(tmp_path / "c")
    assert joined(read_rows(tmp_path / "b")).columns["x"].shape == (300,)


@pytest.mark.parametrize("gone", [["part-0000000010-0000000019.parquet"], ["part-0000000000-0000000009.parquet",
                                  "part-0000000050-0000000059.parquet"]])  # fmt: skip
def test_only_what_is_missing_is_done(runs, tmp_path, executions, gone):
    path, count = executions
    scenario = {"log": str(path)}
    stop_after(runs, scenario, tmp_path / "s", 60)
    before = count()
    for name in gone:
        (tmp_path / "s" / name).unlink()
    got = campaign(runs.counted, scenario, 100, workers=1, batch=10, store=tmp_path / "s")
    assert got.executed == 40 + 10 * len(gone)
    twice = {k for k, n in count().items() if n == 2}
    assert twice == {k for name in gone for k in range(int(name[5:15]), int(name[16:26]) + 1)}
    assert sum(before.values()) == 60


def test_fewer_runs_than_an_interrupted_campaign_left(runs, tmp_path):
    """Its later runs have gaps: they stay, are not counted, and are there when more are asked for."""
    stop_after(runs, {}, tmp_path / "s", 60)
    (tmp_path / "s" / "part-0000000030-0000000039.parquet").unlink()
    got = campaign(runs.counted, {}, 20, workers=1, store=tmp_path / "s")
    assert (got.executed, got.done, got.complete) == (0, 20, True)
    assert got["x"].n == 20
    assert len(got.column("x")) == 20
    assert campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "s").executed == 50
    campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "other")
    assert table(tmp_path / "s") == table(tmp_path / "other")


def stop_after(runs, scenario, folder, n):
    def stop(fraction):
        if fraction * 100 >= n - 0.5:
            raise KeyboardInterrupt

    got = campaign(runs.counted, scenario, 100, workers=1, batch=10, store=folder, progress=stop)
    assert (got.complete, got.done) == (False, n)


def test_half_written_parts_are_cleared_away(runs, tmp_path):
    stop_after(runs, {}, tmp_path / "s", 30)
    (tmp_path / "s" / ".part-0000000030-0000000039.parquet.x7.parquet").write_bytes(b"PAR1half")
    (tmp_path / "s" / ".runs.parquet.abc.parquet").write_bytes(b"PAR1")
    campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "s")
    assert names(tmp_path / "s") == [".lock", "manifest.json", "runs.parquet"]


def test_killed_between_the_table_and_taking_its_parts_away(runs, tmp_path):
    stop_after(runs, {}, tmp_path / "s", 90)
    shutil.copytree(tmp_path / "s", tmp_path / "parts")
    campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "s")
    whole = table(tmp_path / "s")
    for part in (tmp_path / "parts").glob("part-*"):
        shutil.copy(part, tmp_path / "s")
    assert len(joined(read_rows(tmp_path / "s")).runs) == 100
    got = campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "s")
    assert (got.executed, got.done) == (0, 100)
    assert names(tmp_path / "s") == [".lock", "manifest.json", "runs.parquet"]
    assert table(tmp_path / "s") == whole


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scenario": {"mean": 2.5}}, "is the store of a campaign of another scenario"),
        ({"seed": 6}, r"with another seed \(5; this one is 6\)"),
        ({"function": "values"}, "of another function"),
        ({"resume": False}, r"already holds 300 runs of this campaign.*--resume"),
    ],
)
def test_a_store_of_something_else_is_refused(undisturbed, runs, options, message):
    before = table(undisturbed)
    function = getattr(runs, options.pop("function", "fails"))
    scenario = options.pop("scenario", {"mean": 2.0})
    with pytest.raises(InputError, match=message):
        campaign(function, scenario, 300, **{"seed": 5, "workers": 1, "store": undisturbed, **options})
    assert table(undisturbed) == before


def test_a_store_of_another_version_is_refused(undisturbed, runs, monkeypatch):
    monkeypatch.setattr("schuler.montecarlo.store.package_version", lambda: "9.9")
    with pytest.raises(InputError, match=r"of another version of schuler \(.*; this one is 9.9\)"):
        campaign(runs.fails, {"mean": 2.0}, 300, seed=5, workers=1, store=undisturbed)


def test_folders_that_are_no_stores(runs, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"it holds notes\.txt; give another folder"):
        campaign(runs.values, {}, 5, workers=1, store=tmp_path)
    assert names(tmp_path) == ["notes.txt"]
    with pytest.raises(InputError, match="expected a folder"):
        campaign(runs.values, {}, 5, workers=1, store=tmp_path / "notes.txt")
    with pytest.raises(FileFormatError, match="not the store of a campaign"):
        list(read_rows(tmp_path))
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(FileFormatError, match="expected the format schuler/montecarlo/1, got None"):
        read_manifest(tmp_path)


def test_damaged_parts_are_named(runs, tmp_path):
    stop_after(runs, {}, tmp_path / "s", 30)
    part = tmp_path / "s" / "part-0000000010-0000000019.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=r"part-0000000010-0000000019.parquet: damaged.*delete it"):
        campaign(runs.counted, {}, 100, workers=1, store=tmp_path / "s")


def test_one_at_a_time(runs, tmp_path):
    identity = identity_of("f", "s", 0, None)
    with (
        opened(tmp_path / "s", identity),
        pytest.raises(InputError, match="another process is running this campaign"),
        opened(tmp_path / "s", identity),
    ):
        pass
    with opened(tmp_path / "s", identity) as store:
        assert store.missing(5) == [Span(0, 4)]
        store.put(Span(1, 1), campaign(runs.values, {}, 1, workers=1, keep=True).rows())
        (tmp_path / "s" / ".lock").unlink()  # as if this one had ended
        with pytest.raises(InputError, match="holds 1 runs"), opened(tmp_path / "s", identity, resume=False):
            pass
        assert store.missing(5) == [Span(0, 0), Span(2, 4)]
        with pytest.raises(InputError, match="not all runs are there"):
            store.finish()


def test_fingerprints_tell_scenarios_apart(runs, tmp_path):
    from functools import partial

    from schuler.navigation.config import NavigationConfig
    from schuler.sensors import catalogue

    x = np.arange(100.0)
    (tmp_path / "a").write_text("one")
    (tmp_path / "b").write_text("two")
    different = [
        1, 1.5, "1", True, None, [1], [1.0], {"a": 1}, {"a": 2}, {1: "a"}, x, x + 1e-15 * (x == 3), x.reshape(10, 10),
        x.astype(np.float32), np.arange(3), np.arange(3.0), tmp_path / "a", tmp_path / "b", tmp_path / "none",
        catalogue.spec("MTi-G-710"), catalogue.spec("MPU-6000"), runs.values, runs.fails, partial(runs.values, a=1),
        partial(runs.values, a=2), {1, 2}, {1, 3}, np.inf,
        NavigationConfig.parse({"imu": {"catalogue": "MPU-6000"}}),
        NavigationConfig.parse({"imu": {"catalogue": "MPU-6000"}, "filter": {"states": 9}}),
    ]  # fmt: skip
    prints = [fingerprint(v) for v in different]
    assert len(set(prints)) == len(different)
    assert fingerprint({"b": x, "a": (1, 2)}) == fingerprint({"a": [1, 2], "b": x[::1].copy()})
    (tmp_path / "c").write_text("one")
    assert fingerprint(tmp_path / "c") == fingerprint(tmp_path / "a")
    for odd in (object(), lambda: 1, np.array([None]), float("nan")):
        with pytest.raises(InputError, match=r"scenario\.a"):
            fingerprint({"a": odd})
