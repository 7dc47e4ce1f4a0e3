"""RINEX observations: the text of a real receiver's log, ours and georinex in the same run.

"Epochs" are the file's: 30 satellites with up to 12 observations each, as a two-band receiver writes them.
"""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

from schuler.recording.formats.rinex_observation import read_rinex_observation

NAMES = [
    *(f"G{k:02d}" for k in range(1, 11)),
    *(f"E{k:02d}" for k in range(1, 11)),
    *(f"C{k:02d}" for k in range(21, 31)),
]
CODES = [f"{kind}{band}" for band in ("1C", "5Q", "5X") for kind in "CLDS"]
HEADER = (
    ("     3.04           OBSERVATION DATA    M: MIXED", "RINEX VERSION / TYPE"),
    *((f"{system}   12 {' '.join(CODES)}", "SYS / # / OBS TYPES") for system in "GEC"),
    ("  2025     8    28    17    30   39.0000000     GPS", "TIME OF FIRST OBS"),
    ("", "END OF HEADER"),
)


def written(path, n_epochs, names, rng):
    """A file of version 3, a third of its observations missing."""
    start = dt.datetime(2025, 8, 28, 17, 30, 39)
    values = rng.uniform(2e7, 1.2e8, (n_epochs, len(names), len(CODES)))
    missing = rng.random(values.shape) < 0.33
    with path.open("w") as stream:
        stream.writelines(f"{content:<60}{label}\n" for content, label in HEADER)
        for k in range(n_epochs):
            stream.write(
                (start + dt.timedelta(seconds=0.25 * k)).strftime(f"> %Y %m %d %H %M %S.%f0  0{len(names):3d}\n")
            )
            for name, row, blank in zip(names, values[k], missing[k], strict=True):
                fields = ("" if b else f"{v:14.3f} 7" for v, b in zip(row, blank, strict=True))
                stream.write(name + "".join(f"{text:<16}" for text in fields) + "\n")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rinex")


@pytest.mark.benchmark(group="RINEX observations, 30 satellites")
def test_read(benchmark, folder):
    path = written(folder / "long.obs", 5000, NAMES, np.random.default_rng(0))
    benchmark.extra_info["epochs"] = 5000
    obs = benchmark.pedantic(read_rinex_observation, args=(path,), rounds=3, warmup_rounds=1)
    assert len(obs.epochs) == 5000


@pytest.mark.benchmark(group="RINEX observations, 30 satellites")
@pytest.mark.filterwarnings("ignore")
def test_peer_georinex(benchmark, folder):
    georinex = pytest.importorskip("georinex", reason="the peer is in the bench extra: pip install 'schuler[bench]'")
    path = written(folder / "short.25o", 60, NAMES, np.random.default_rng(0))
    benchmark.extra_info["epochs"] = 60
    data = benchmark.pedantic(georinex.load, args=(path,), rounds=2)
    assert data.sizes["time"] == 60


@pytest.mark.benchmark(group="RINEX observations, 10 satellites")
def test_read_ten(benchmark, folder):
    path = written(folder / "ten.obs", 10_000, NAMES[:10], np.random.default_rng(0))
    benchmark.extra_info["epochs"] = 10_000
    benchmark.pedantic(read_rinex_observation, args=(path,), rounds=3, warmup_rounds=1)
