"""Time and satellite fixes in Xsens packets: UTC beside the sensor's clock, and GnssPvtData."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import ClockLine, clock_line, unwrapped
from schuler.recording.formats.xsens_messages import Packets
from schuler.recording.series import GnssSeries
from schuler.timebase import gps_from_unix

TICK = 1e-4  # of SampleTimeFine [s]
_RESOLVED = 0x7  # of UTC: date, time of day, and leap seconds are known


def utc_line(packets: list[Packets], notes: list[str]) -> ClockLine | None:
    """Relation of the sensor's clock to GPS time by the UTC in its packets; ``None`` without."""
    clock, utc = [], []
    for p in packets:
        if "utc" not in p.fields or "fine" not in p.fields:
            continue
        f = p.fields["utc"]
        good = _valid_utc(f)
        clock.append(np.stack((p.order[good], p.fields["fine"]["value"][good] * TICK), axis=1))
        utc.append(_unix(f, good))
    pairs = np.concatenate(clock) if clock else np.empty((0, 2))
    unix = np.concatenate(utc) if utc else np.empty((0, 2))
    if len(pairs) < 2:
        return None
    order = np.argsort(pairs[:, 0], kind="stable")
    t, unix = unwrapped(pairs[order, 1], 2.0**32 * TICK), unix[order]
    try:
        gps = gps_from_unix(unix[:, 0])
    except InputError as error:
        notes.append(f"UTC of the packets was not used: {error}")
        return None
    line = clock_line(t, gps, unix[:, 1])
    if line is not None:
        notes.append(line.note("SampleTimeFine", "the packets' UTC"))
    return line


def _valid_utc(f: dict[str, FloatArray]) -> BoolArray:
    good = (f["flags"].astype(np.int64) & _RESOLVED == _RESOLVED) & (f["year"] >= 1981) & (f["year"] < 2100)
    good &= (f["month"] >= 1) & (f["month"] <= 12) & (f["day"] >= 1) & (f["day"] <= 31)
    return np.asarray(good & (f["hour"] < 24) & (f["minute"] < 60) & (f["second"] < 61) & (f["nano"] < 1e9))


def _unix(f: dict[str, FloatArray], good: BoolArray) -> FloatArray:
    """Unix time in whole seconds and the rest. Shape (n, 2). [s]"""
    y, m, d = (f[name][good].astype(np.int64) for name in ("year", "month", "day"))
    months = ((y - 1970) * 12 + m - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + d - 1
    seconds = days * 86_400 + (f["hour"][good] * units.HR + f["minute"][good] * units.MIN + f["second"][good])
    return np.stack((seconds, f["nano"][good] * 1e-9), axis=1)


def fixes_of(packets: list[Packets]) -> list[dict[str, Any]]:
    """GnssPvtData as the fields of UBX-NAV-PVT, of which it is a copy, in order; repeated ones once."""
    placed = []
    for p in packets:
        if "gnss" not in p.fields:
            continue
        f = p.fields["gnss"]
        for k, place in enumerate(p.order):
            m = {name: int(values[k]) for name, values in f.items()}
            placed.append((int(place), m))
    placed.sort(key=lambda entry: entry[0])
    made: list[dict[str, Any]] = []
    last = None
    for _, m in placed:
        if m["iTOW"] == last:
            continue
        last = m["iTOW"]
        made.append(m | {
            "validDate": m["valid"] & 1, "validTime": m["valid"] >> 1 & 1, "gnssFixOk": m["flags"] & 1, "invalidLlh": 0,
            "carrSoln": m["flags"] >> 6 & 3, "diffSoln": m["flags"] >> 1 & 1, "lat": m["lat"] * 1e-7,
            "lon": m["lon"] * 1e-7,
        })  # fmt: skip
    return made


def gnss_table(gnss: GnssSeries, shift: float) -> Table:
    """The series as a table with times ``shift`` later. [s]"""
    assert gnss.cov_v_n is not None
    sigma, sigma_v = (np.sqrt(np.einsum("nii->ni", C)) for C in (gnss.cov_r_n, gnss.cov_v_n))
    values = {"t": gnss.t + shift}
    for names, columns in (
        (("lat", "lon", "h"), gnss.llh),
        (("vn", "ve", "vd"), gnss.v_n),
        (("sn", "se", "sd"), sigma),
        (("svn", "sve", "svd"), sigma_v),
    ):
        assert columns is not None
        values |= {name: columns[:, k] for k, name in enumerate(names)}
    assert gnss.quality is not None
    assert gnss.n_satellites is not None
    return Table(values | {"q": gnss.quality.astype(np.float64), "ns": gnss.n_satellites.astype(np.float64)})
