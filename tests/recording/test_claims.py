"""A header that claims 2 GB does not allocate 2 GB: every binary format, in a process of its own (``claims.py``)."""

import functools
import json
import subprocess
import sys
from pathlib import Path

import claims
import pytest
import samples
from places import TESTS

MOST_MB = 300.0  # a few copies of the 64 MB that any packed file may unpack to

pytest.importorskip("rosbags")
pytest.importorskip("pyulog")
pytest.importorskip("h5netcdf")
pytest.importorskip("mcap")
pytest.importorskip("hatanaka")


#: Formats that are always measured; all with ``-m fuzz``.
SOME = ("npy", "npz", "matlab5", "px4", "sbf", "ubx")


@functools.cache
def measured(*names: str) -> dict:
    """What claims in logs of these formats, or of all, ask for and are answered."""
    if not Path("/proc/self/status").exists():
        pytest.skip("this system does not tell the address space of a process")
    script = TESTS / "support" / "claims.py"
    done = subprocess.run([sys.executable, str(script), *names], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


@pytest.mark.campaign
@pytest.mark.parametrize("names", [SOME, pytest.param((), marks=pytest.mark.fuzz)], ids=["some", "all"])
def test_claims_are_refused_and_take_no_memory(names):
    """About a hundred claims in each binary format, and decompression bombs of 2 GB in those that pack."""
    results = measured(*names)
    assert results["errors"] == []
    binary = set(names or samples.ALL) - claims.TEXT
    for name in binary:
        assert len(results["grown_mb"][name]) > 70, name
    grown = {f"{name}, {label}": mb for name, cases in results["grown_mb"].items() for label, mb in cases.items()}
    assert {label: mb for label, mb in grown.items() if mb > MOST_MB} == {}


@pytest.mark.campaign
@pytest.mark.parametrize(
    "case",
    ["npy, a shape of 2 GB", "npz, zeros of 2 GB", "matlab5, packed zeros of 2 GB", "matlab5, a shape of 2 GB"],
)
def test_claims_are_named(case):
    """The message says that the file claims more than it holds, or is damaged."""
    assert_named(measured(*SOME)["said"][case])


@pytest.mark.fuzz
@pytest.mark.parametrize(
    "case",
    ["matlab4, 2 GB of doubles", "rinex_observations, gzip of 2 GB", "rinex_observations, bzip2 of 2 GB",
     "rinex_observations, zip of 2 GB", "parquet_foreign, 40 million rows of zeros", "hdf5, a shape of 2 GB",
     "hdf5, zeros of 235 MB", "mcap, a record of 2 GB", "mcap, zstd of 2 GB that says 1000",
     "mcap, lz4 of 268 MB that says 1000", "rosbag, data of 2 GB", "comma2k19, a shape of 2 GB"],
)  # fmt: skip
def test_claims_of_other_formats_are_named(case):
    assert_named(measured()["said"][case])


def assert_named(message: str) -> None:
    assert any(word in message for word in ("claim", "damaged", "unpacks to", "complete")), message


@pytest.mark.campaign
def test_unix_compress_is_bounded(tmp_path):
    """A .Z file of 100 kB that unpacks to a gigabyte: strings grow by one byte with every code."""
    from schuler.exceptions import FileFormatError
    from schuler.recording.io import read

    ncompress = pytest.importorskip("ncompress")
    path = tmp_path / "rover.obs.Z"
    path.write_bytes(ncompress.compress(bytes(100_000_000)))
    assert path.stat().st_size < 100_000
    with pytest.raises(FileFormatError, match="unpacks to more than 67 MB"):
        read(path)
