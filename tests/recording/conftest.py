"""Recordings made for the tests, and writers of the formats under test that share no code with the readers."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.recording import GnssSeries, ImuSeries, Metadata, OdometerSeries, Recording, Trajectory
from schuler.recording.io import dispatch
from schuler.recording.series import ScalarSeries
from schuler.timebase import TimeBase


@pytest.fixture(scope="module")
def unguarded():
    """Readers as they are: what they do not foresee is not turned into an error of ours."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatch, "guarded", lambda _path: np.errstate())
        yield


@pytest.fixture
def still(rng) -> np.ndarray:
    """t [s], f_x..f_z [m/s^2], omega_x..omega_z [rad/s] of a level sensor at rest, 3 s at 100 Hz, axes FRD."""
    n = 300
    table = np.empty((n, 7))
    table[:, 0] = np.arange(n) / 100.0
    table[:, 1:4] = (0.12, -0.2, -9.79) + 0.01 * rng.standard_normal((n, 3))
    table[:, 4:7] = 0.001 * rng.standard_normal((n, 3))
    return table


@pytest.fixture
def table(tmp_path: Path) -> Callable[..., Path]:
    """Write rows as text: ``table(rows, header=..., delimiter=..., name=...)``."""

    def write(rows, *, header: str = "", delimiter: str = ",", name: str = "log.csv", footer: str = "") -> Path:
        path = tmp_path / name
        lines = [delimiter.join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in rows]
        path.write_text((header + "\n" if header else "") + "\n".join(lines) + "\n" + footer, encoding="utf-8")
        return path

    return write


@pytest.fixture
def run(rng) -> Recording:
    """A recording with all four series on GPS time, with times and covariances that are not round numbers."""
    t = 259_200.0 + np.cumsum(rng.uniform(0.008, 0.012, 400))
    imu = ImuSeries(
        t, 0.1 * rng.standard_normal((400, 3)), rng.standard_normal((400, 3)) - (0, 0, 9.8), "rate", 20.0 + t % 7
    )
    k = 12
    llh = np.stack((np.linspace(0.69, 0.6901, k), np.linspace(-1.83, -1.8299, k), rng.uniform(900, 910, k)), axis=1)
    A, B = rng.standard_normal((2, k, 3, 3))
    gnss = GnssSeries(
        259_200.25 + np.arange(k) * 0.25,
        llh,
        0.01 * (A @ np.swapaxes(A, 1, 2) + np.eye(3)),
        rng.standard_normal((k, 3)),
        0.01 * (B @ np.swapaxes(B, 1, 2) + np.eye(3)),
        rng.integers(1, 8, k),
        rng.integers(4, 30, k),
        259_200.25 + np.arange(k) * 0.25 + rng.uniform(0.01, 0.1, k),
    )
    odometer = OdometerSeries(t[::10], rng.uniform(-1, 20, 40), rng.uniform(0.01, 0.2, 40))
    q = rng.standard_normal((k, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    reference = Trajectory(gnss.t, 6.37e6 + rng.standard_normal((k, 3)), rng.standard_normal((k, 3)), q)
    metadata = Metadata(
        name="ring road",
        time=TimeBase("gps", 2374 * 604_800.0),
        sources={"raw.csv": "ab" * 32},
        axes="RFU",
        notes=("Axes were turned.", "Größe: 5 µg"),
        options={"units": "g,deg/s", "rate": 100.0},
    )
    return Recording(imu, gnss, odometer, reference, metadata)


@pytest.fixture
def aided(run, rng) -> Recording:
    """The same with a heading, a height, dilutions and all satellite parts, numbers not round, some not measured."""
    t = run.imu.t
    dop = np.random.default_rng(3).uniform(0.5, 9.0, (len(run.gnss), 2))
    dop[2], dop[5, 1] = np.nan, np.nan
    n, m = 60, 45
    holes = np.where(rng.uniform(size=(3, n)) < 0.2, np.nan, 1.0)
    observations = Observations(
        np.repeat(t[:20], 3), rng.integers(1, 33, n), rng.integers(0, 3, n), ("1C", "2W", "5Q"),
        2.2e7 * rng.uniform(0.9, 1.1, n), 900.0 * rng.standard_normal(n) * holes[0],
        1.1e8 * rng.uniform(0.9, 1.1, n) * holes[1], rng.uniform(20, 50, n) * holes[2],
        run.metadata.time.epoch_gps_s, {101: -7, 124: 6}, (4.0e6 + 0.1, 8.5e5, 4.8e6), ("Größe: 5 µs",),
    )  # fmt: skip
    ranges = Ranges(
        np.repeat(t[:15], 3), rng.integers(1, 33, m), rng.integers(0, 2, m), ("G", "E"),
        2.6e7 * rng.standard_normal((m, 3)), 3e3 * rng.standard_normal((m, 3)), 2.2e7 * rng.uniform(0.9, 1.1, m),
        np.where(rng.uniform(size=m) < 0.2, np.nan, 900.0), rng.uniform(0.5, 9.0, m), rng.uniform(0.05, 0.5, m),
        rng.uniform(0.1, 1.5, m), rng.uniform(0.0, 6.2, m), rng.uniform(20, 50, m), rng.integers(0, 7, m), ("a note",),
    )  # fmt: skip
    start = run.metadata.time.epoch_gps_s
    made = nominal_orbits("GER", epoch_gps_s=start).ephemerides(start, start + 1800.0)
    ephemerides = Ephemerides(
        replace(made.kepler, af0=1e-5 * rng.standard_normal(len(made.kepler))), made.glonass,
        (1.1e-8, -7.5e-9, 5.9e-8, 1e-7), None, (63.7, 0.1, 3e-3), 18, ("orbits", "made up"),
    )  # fmt: skip
    return replace(
        run,
        gnss=replace(run.gnss, dop=dop),
        heading=ScalarSeries(t[::7], rng.uniform(-3.1, 3.1, len(t[::7])), rng.uniform(0.01, 0.1, len(t[::7]))),
        height=ScalarSeries(t[::9], rng.uniform(200, 300, len(t[::9])), rng.uniform(0.1, 1.0, len(t[::9]))),
        observations=observations,
        ranges=ranges,
        ephemerides=ephemerides,
    )
