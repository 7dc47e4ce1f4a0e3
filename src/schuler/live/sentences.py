"""Live solutions and events as lines of text: NMEA 0183 and JSON.

The proprietary sentence of NMEA has what the standard ones lack::

    $PSCH,123519.25,ok,0.012,0.013,0.025,0.010,0.010,0.012,0.05,0.05,0.21*1C

UTC, health, 1-sigma of position north, east, down [m], of velocity [m/s] and of attitude about these axes [deg].
"""

from __future__ import annotations

import datetime as dt
import json
import math
from typing import Any

from schuler import units
from schuler.live.messages import Event, Solution
from schuler.recording.io.clock import leaps_at
from schuler.timebase import TimeBase, calendar

#: GGA's quality by health: a GNSS fix stands behind it, it is estimated, it is none.
_QUALITY = {"ok": 1, "doubtful": 6, "coasting": 6, "aligning": 0, "failed": 0}
_MODE = {1: "A", 6: "E", 0: "N"}  # of RMC, by that quality
_AXES = ("north", "east", "down")


def sentence(body: str) -> str:
    """A sentence of NMEA 0183 with its checksum and line end."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n"


def nmea_of(solution: Solution, base: TimeBase | None, geoid_separation: float = 0.0) -> str:
    """GGA, RMC, HDT, GST and PSCH of a solution.

    Parameters
    ----------
    solution : Solution
    base : TimeBase or None
        Of its time; the fields of time and date are empty unless it is GPS time.
    geoid_separation : float
        Height of the geoid above the ellipsoid, taken off the ellipsoidal height and written beside it: a reader that
        adds the two has the right ellipsoidal height whatever it is. [m]

    Returns
    -------
    str
        Sentences with line ends.
    """
    clock, date = _utc(solution.t, base)
    quality = _QUALITY[solution.health]
    north, east, _ = solution.v_eb_n.tolist()
    lat, lon, height = solution.llh.tolist()
    place = f"{_angle(lat, 2)},{'S' if lat < 0.0 else 'N'},{_angle(lon, 3)},{'W' if lon < 0.0 else 'E'}"
    height -= geoid_separation
    speed, course = math.hypot(north, east) / units.KNOT, math.atan2(east, north) / units.DEG % 360.0
    heading = float(solution.rpy_nb[2]) / units.DEG % 360.0
    position, velocity = (",".join(f"{s:.3f}" for s in sigma) for sigma in (solution.sigma_r_n, solution.sigma_v_n))
    attitude = ",".join(f"{s / units.DEG:.3f}" for s in solution.sigma_psi_n)
    return "".join(
        map(
            sentence,
            (
                f"INGGA,{clock},{place},{quality},,,{height:.4f},M,{geoid_separation:.4f},M,,",
                f"INRMC,{clock},{'V' if quality == 0 else 'A'},{place},{speed:.3f},{course:.3f},{date},,,"
                f"{_MODE[quality]},V",
                f"INHDT,{heading:.3f},T",
                f"INGST,{clock},,,,,{position}",
                f"PSCH,{clock},{solution.health},{position},{velocity},{attitude}",
            ),
        )
    )


def _utc(t: float, base: TimeBase | None) -> tuple[str, str]:
    """Time of day and date as NMEA writes them; empty without GPS time."""
    if base is None or base.scale != "gps":
        return "", ""
    gps = base.epoch_gps_s + t
    moment = calendar(round(gps - leaps_at(gps), 3))
    moment += dt.timedelta(microseconds=500)  # strftime cuts, it does not round
    return f"{moment:%H%M%S}.{moment.microsecond // 1000:03d}", f"{moment:%d%m%y}"


def _angle(radians: float, digits: int) -> str:
    """Whole degrees and minutes, ``4807.0380000``."""
    tenmillionths = round(abs(radians) / units.DEG * 60.0 * 1e7)
    degrees, minutes = divmod(tenmillionths, 60 * 10**7)
    return f"{degrees:0{digits}d}{minutes // 10**7:02d}.{minutes % 10**7:07d}"


def json_of(item: Solution | Event, base: TimeBase | None) -> str:
    """A solution or an event as one line of JSON; the names are those of solution files.

    Parameters
    ----------
    item : Solution or Event
    base : TimeBase or None
        Of its time; with GPS time ``gps_s`` counts from 1980.
    """
    values: dict[str, Any] = {"t_s": item.t}
    if base is not None and base.scale == "gps":
        values["gps_s"] = round(base.epoch_gps_s + item.t, 6) if math.isfinite(item.t) else None
    if isinstance(item, Event):
        values |= {"event": item.kind, "text": item.text}
    else:
        smoothed = {"smoother_lag_s": item.smoother_lag_s} if item.smoother_lag_s else {}
        values |= {"health": item.health, **smoothed, **columns_of(item)}
    return json.dumps({k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()})


def columns_of(solution: Solution) -> dict[str, float]:
    """Numbers of a solution by the names of the columns of solution files, see :mod:`schuler.navigation`."""
    lat, lon, height = solution.llh.tolist()
    values = {"lat_deg": lat / units.DEG, "lon_deg": lon / units.DEG, "height_m": height}
    values |= {f"v_{axis}_m_s": v for axis, v in zip(_AXES, solution.v_eb_n.tolist(), strict=True)}
    angles = zip(("roll", "pitch", "yaw"), solution.rpy_nb.tolist(), strict=True)
    values |= {f"{name}_deg": angle / units.DEG for name, angle in angles}
    for name, unit, sigma in (
        ("position", "m", solution.sigma_r_n),
        ("velocity", "m_s", solution.sigma_v_n),
        ("attitude", "deg", solution.sigma_psi_n / units.DEG),
    ):
        values |= {f"sigma_{name}_{axis}_{unit}": s for axis, s in zip(_AXES, sigma.tolist(), strict=True)}
    return values
