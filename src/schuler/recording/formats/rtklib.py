"""RTKLIB's solution files (``.pos``): geodetic and Earth-fixed layouts, GPS time or UTC, with or without velocities.

RTKLIB writes a covariance as the root of its size with its own sign, ``s = sign(c) sqrt(abs(c))``, so ``c = s abs(s)``.
Its axes are north, east, up: the terms that pair one horizontal axis with the vertical change sign on the way to ours.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import files, frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.files import hashed
from schuler.recording.io import checks, columns, lines
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.clock import from_gps
from schuler.recording.io.gnss_table import gnss_series
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.raw import Raw, check_increasing, reject_not_finite
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.timebase import GPS_EPOCH, UNIX_TO_GPS_S, WEEK_S, calendar, gps_from_unix

_LAYOUTS = {"latitude(deg)": "llh", "x-ecef(m)": "ecef", "latitude(d'": "dms", "e-baseline(m)": "baseline"}
_TIME_SCALES = ("GPST", "UTC", "JST")
_LONGEST_S = 8e9  # from 1980 to 2233; nanoseconds of more are no 64-bit number
_POSITION, _WITH_VELOCITY = 13, 22  # columns after the time
_NEEDLESS = {"columns", "units", "rate", "axes", "time", "delimiter", "skip", "comment", "scale", "rest", "variable"}


@dataclass(frozen=True, slots=True)
class PosHeader:
    """Comment lines of a ``.pos`` file: layout, time scale, kind of heights, first row of numbers."""

    layout: str
    scale: str
    height: str | None
    first: int
    delimiter: str
    fields: list[str]
    encoding: str


def looks_like_pos(head: bytes) -> bool:
    """Whether the first bytes of a file are those of an RTKLIB solution, whatever its suffix."""
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"%") and any(key.encode() in head for key in _LAYOUTS)


def read_pos(path: Path, hints: ReadHints) -> Recording:
    """GNSS series of an RTKLIB solution.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``height``, ``geoid_separation``, ``sigma`` (for epochs without accuracy), ``allow``, ``offset``, ``name``.

    Returns
    -------
    Recording
        On GPS time, counted from the start of the first epoch's week.

    Raises
    ------
    FileFormatError
        With file and line, for malformed lines, baselines, times out of order and accuracies of zero.
    """
    if surplus := sorted(set(hints.given()) & _NEEDLESS):
        raise InputError(f"{path} is an RTKLIB solution and says this itself; leave out {', '.join(surplus)}")
    header = read_header(path)
    dates = "/" in header.fields[0]
    # the date and the time of day have a blank between them, whatever the delimiter
    blanks = ("/:" if dates else "") + header.delimiter.strip(" ")
    table = TextTable(path, header.first, " ", "%", header.encoding, blanks)
    first_row = table.split(" ".join(header.fields))
    n_time, n = (6 if dates else 2), len(first_row)
    if n - n_time not in (_POSITION, _WITH_VELOCITY):
        raise FileFormatError(
            f"expected 13 columns after the time (position to ratio) or 22 (with velocity), got {n - n_time}; write "
            "the solution with RTKLIB's own layout",
            path,
            header.first,
        )
    raw = Raw(path, {}, {}, table.line_of)
    try:
        values, truncated = lines.load(table, n, list(range(n)), allow_truncated=hints.allows("truncated"))
    except FileFormatError:
        some = _some_with_velocity(table, n_time, raw)
        if some is None:
            raise
        values, truncated = some, False
    if truncated:
        raw.notes.append("The last line was cut off and left out.")
    reject_not_finite(raw, values)
    t, base = from_gps(*_gps_seconds(raw, values[:, :n_time], header.scale))
    check_increasing(raw, t)
    body = values[:, n_time:]
    hints = _heights(raw, hints, header)
    if header.layout == "ecef":
        _from_ecef(raw, body)
    else:
        _from_geodetic(raw, body)
    raw.values |= {"q": body[:, 3], "ns": body[:, 4]}
    if hints.offset:
        raw.notes.append(f"{hints.offset:g} s was added to every time stamp.")
        t = t + hints.offset
        check_increasing(raw, t)
    with hashed([path]) as sources:
        gnss = gnss_series(raw, hints, t)
        raw.notes += checks.timing_notes(t)
        return Recording(gnss=gnss, metadata=metadata_of(path, hints, base, raw.notes, sources()))


def _some_with_velocity(table: TextTable, n_time: int, raw: Raw) -> FloatArray | None:
    """Rows of a file some of which end before their velocity, as RTKLIB reads them, noted; None where others fail.

    A series has velocities for all epochs or for none: the epochs without one are left out, or, if they are more than
    half, the velocities.
    """
    rows = list(table.rows())
    complete = np.array([len(fields) == n_time + _WITH_VELOCITY for _, fields in rows])
    if not all(len(fields) in (n_time + _POSITION, n_time + _WITH_VELOCITY) for _, fields in rows):
        return None
    missing, n = int(np.sum(~complete)), len(rows)
    all_of_them = missing > n // 2
    kept = [k for k in range(n) if all_of_them or complete[k]]
    try:
        values = np.array([rows[k][1][: n_time + _POSITION] if all_of_them else rows[k][1] for k in kept], dtype=float)
    except ValueError:
        return None
    lost = f"velocities of the other {n - missing} were" if all_of_them else "were"
    raw.notes.append(f"{missing} of {n} epochs have no velocity: {lost} left out.")
    raw.line_of = lambda row: rows[kept[row]][0]
    return values


def read_header(path: Path) -> PosHeader:
    """Layout and time scale of a ``.pos`` file, in the long form of its header or the short one.

    Raises
    ------
    FileFormatError
        If the line that names the columns is missing or names baselines, degrees and minutes, or Japan time.
    """
    encoding = lines.encoding_of(lines.check_file(path), path)
    layout, scale, height, named = None, None, None, 0
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        for number, line in enumerate(stream, 1):
            text = line.strip()
            if not text:
                continue
            if not text.startswith("%"):
                break
            if key := next((key for key in _LAYOUTS if key in text), None):
                layout, named = _LAYOUTS[key], number
                scale = next((word for word in _TIME_SCALES if word in text), None)
            elif "/ellipsoidal" in text or "/geodetic" in text:
                height = "ellipsoidal" if "/ellipsoidal" in text else "msl"
        else:
            raise FileFormatError("there are comment lines but no solutions", path)
    if layout is None:
        raise FileFormatError(
            "expected RTKLIB's line '%  GPST  latitude(deg) longitude(deg) ...' or '... x-ecef(m) ...' before the "
            "first solution; for other tables use a suffix such as .txt and the hint columns",
            path,
            number,
        )
    advice = {
        "baseline": "these are baselines from a base station (e/n/u), not positions: write the solution as llh or xyz "
        "(out-solformat)",
        "dms": "degrees, minutes and seconds are not read: write decimal degrees (out-degform=deg)",
    }
    if layout in advice:
        raise FileFormatError(advice[layout], path, named)
    if scale not in ("GPST", "UTC"):
        raise FileFormatError(f"expected times in GPST or UTC, got {scale or 'neither'}: set out-timesys", path, named)
    delimiter = next((character for character in ",;\t" if character in text), " ")
    fields = TextTable(path, 1, delimiter, "%", encoding).split(text)
    return PosHeader(layout, scale, height, number, delimiter, fields, encoding)


def _gps_seconds(raw: Raw, time: FloatArray, scale: str) -> tuple[FloatArray, FloatArray]:
    """GPS time since 1980 as whole minutes or weeks and the rest, so that no digit is lost. Shapes (n,). [s]"""
    if time.shape[1] == 2:
        week, tow = time[:, 0], time[:, 1]
        _reject(raw, (week < 0) | (week > 9999) | (week != np.round(week)), "impossible GPS week {:g}", week)
        _reject(raw, (tow < 0.0) | (tow >= WEEK_S), "impossible time of week {:g}", tow)
        whole, part = week * WEEK_S, tow
    else:
        year, month, day, hour, minute, second = time.T
        date = time[:, :3]
        wrong = np.any(date != np.round(date), axis=1) | (year < 1980) | (year > 2100) | (month < 1) | (month > 12)
        wrong |= (day < 1) | (day > 31) | (hour < 0) | (hour > 23) | (minute < 0) | (minute > 59)
        wrong |= (second < 0.0) | (second > 61.0)
        _reject(raw, wrong, "impossible date or time; expected yyyy/mm/dd hh:mm:ss.sss", year)
        months = ((year - 1970) * 12 + month - 1).astype("i8").astype("M8[M]")
        days = (months.astype("M8[D]") - np.datetime64(GPS_EPOCH.date())).astype(np.float64) + day - 1.0
        whole, part = days * 86_400.0 + hour * 3600.0 + minute * 60.0, second
        _reject(raw, days < 0, "date before GPS time began (1980-01-06)", days)
    if scale == "UTC":
        try:
            leaps = np.round(gps_from_unix(whole + part + UNIX_TO_GPS_S) - (whole + part))
        except InputError as error:
            raise raw.fault(str(error), len(whole) - 1) from error
        raw.notes.append(f"UTC was turned to GPS time; {leaps[0]:.0f} leap seconds were added to the first.")
        whole = whole + leaps
    return whole, part


def _reject(raw: Raw, wrong: np.ndarray, message: str, values: FloatArray) -> None:
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise raw.fault(message.format(values[row]), row)


def _heights(raw: Raw, hints: ReadHints, header: PosHeader) -> ReadHints:
    """The hints with the kind of height the file states, where it states one."""
    if header.layout == "ecef":
        if hints.height == "msl":
            raise raw.fault(
                "Earth-fixed positions have no height above sea level: leave out height and geoid_separation"
            )
        raw.ellipsoidal = True
        return hints
    if header.height is None or hints.allows("height"):
        return hints
    if hints.height is None and header.height == "msl":
        raise raw.fault(
            "the file says its heights are geodetic, that is above mean sea level: say height='msl' and "
            "geoid_separation=... [m]"
        )
    if hints.height is not None and hints.height != header.height:
        stated = "above the ellipsoid" if header.height == "ellipsoidal" else "above mean sea level"
        raise raw.fault(
            f"the file says its heights are {stated}, the hint says {hints.height}; allow='height' overrules it"
        )
    raw.ellipsoidal = header.height == "ellipsoidal"
    return hints


def _from_geodetic(raw: Raw, body: FloatArray) -> None:
    raw.values |= {"lat": body[:, 0] * units.DEG, "lon": body[:, 1] * units.DEG, "h": body[:, 2].copy()}
    _put_sigmas(raw, body[:, 5:11], columns.SIGMA, columns.CROSS)
    if body.shape[1] == _WITH_VELOCITY:
        raw.values |= {"vn": body[:, 13], "ve": body[:, 14], "vd": -body[:, 15]}
        _put_sigmas(raw, body[:, 16:22], columns.VELOCITY_SIGMA, columns.VELOCITY_CROSS)


def _put_sigmas(raw: Raw, s: FloatArray, sigma: tuple[str, ...], cross: tuple[str, ...]) -> None:
    """Columns of sdn, sde, sdu, sdne, sdeu, sdun: roots of variances, then signed roots of covariances."""
    c_ne, c_eu, c_un = (s[:, 3:] * np.abs(s[:, 3:])).T
    raw.values |= dict(zip(sigma, s[:, :3].T, strict=True))
    raw.values |= dict(zip(cross, (c_ne, -c_un, -c_eu), strict=True))


def _from_ecef(raw: Raw, body: FloatArray) -> None:
    r_eb_e = body[:, :3]
    radius = np.linalg.norm(r_eb_e, axis=1)
    _reject(raw, (radius < 6.2e6) | (radius > 1e8), "position {:.0f} m from the Earth's centre is impossible", radius)
    llh = frames.llh_from_ecef(r_eb_e)
    raw.values |= dict(zip(columns.GEODETIC, llh.T, strict=True))
    C_en = frames.C_en(llh)
    _put_rotated(raw, _ecef_cov(body[:, 5:11]), C_en, columns.SIGMA, columns.CROSS)
    if body.shape[1] == _WITH_VELOCITY:
        v_n = np.einsum("nji,nj->ni", C_en, body[:, 13:16])
        raw.values |= dict(zip(columns.VELOCITY, v_n.T, strict=True))
        _put_rotated(raw, _ecef_cov(body[:, 16:22]), C_en, columns.VELOCITY_SIGMA, columns.VELOCITY_CROSS)


def _ecef_cov(s: FloatArray) -> FloatArray:
    """Covariances of sdx, sdy, sdz, sdxy, sdyz, sdzx. Shape (n, 3, 3)."""
    xx, yy, zz, xy, yz, zx = (s * np.abs(s)).T
    return np.stack((xx, xy, zx, xy, yy, yz, zx, yz, zz), axis=-1).reshape(-1, 3, 3)


def _put_rotated(raw: Raw, cov_e: FloatArray, C_en: FloatArray, sigma: tuple[str, ...], cross: tuple[str, ...]) -> None:
    cov_n = np.swapaxes(C_en, 1, 2) @ cov_e @ C_en
    # an axis without accuracy stays without one, however the axes lie
    absent = np.any(np.einsum("nii->ni", cov_e) <= 0.0, axis=1)
    diagonal = np.where(absent[:, None], 0.0, np.einsum("nii->ni", cov_n))
    raw.values |= dict(zip(sigma, np.sqrt(np.maximum(diagonal, 0.0)).T, strict=True))
    raw.values |= dict(zip(cross, (cov_n[:, 0, 1], cov_n[:, 0, 2], cov_n[:, 1, 2]), strict=True))


def write_pos(recording: Recording, path: Path | str, *, velocities: GnssSeries | None = None) -> list[Path]:
    """Write the GNSS series as an RTKLIB solution: GPS time, degrees, ellipsoidal heights.

    Parameters
    ----------
    recording : Recording
        With a GNSS series on GPS time.
    path : Path or str
    velocities : GnssSeries, optional
        Series with the velocities at some of the times. Rows of the others end before it, which RTKLIB reads as "none".

    Returns
    -------
    list of Path
        The file.

    Raises
    ------
    InputError
        If there is no GNSS series, or its clock has no relation to GPS time.

    Notes
    -----
    More digits are written than RTKLIB does (1e-11 deg, 1e-6 m, 1e-6 m/s), which its readers accept. Age and ratio are
    not part of a :class:`GnssSeries` and are written as zero; a quality not known is written as 5 (single).
    """
    gnss, base = recording.need_gnss(), recording.metadata.time
    if base.scale != "gps":
        raise InputError(
            f"a .pos file needs GPS time, and this recording runs on {base.scale} time: give the hint time"
        )
    table = _sigma_columns(gnss.cov_r_n)
    n = len(gnss)
    quality = np.full(n, 5) if gnss.quality is None else gnss.quality
    satellites = np.zeros(n, dtype=int) if gnss.n_satellites is None else gnss.n_satellites
    title = (
        "%  GPST                      latitude(deg)   longitude(deg)       height(m)   Q  ns      sdn(m)      sde(m)"
        "      sdu(m)     sdne(m)     sdeu(m)     sdun(m) age(s)  ratio"
    )
    moving = gnss if velocities is None else velocities
    velocity = np.empty((n, 0))
    if moving.v_n is not None and moving.cov_v_n is not None:
        velocity = np.full((n, _WITH_VELOCITY - _POSITION), np.nan)
        stated = np.column_stack((moving.v_n * (1.0, 1.0, -1.0), _sigma_columns(moving.cov_v_n)))
        velocity[np.searchsorted(gnss.t, moving.t)] = stated
        title += "       vn(m/s)     ve(m/s)     vu(m/s)        sdvn        sdve        sdvu       sdvne       sdveu"
        title += "       sdvun"
    with files.replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"% program   : schuler\n% name      : {' '.join(recording.metadata.name.split())}\n")
        stream.write(
            "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
        )
        stream.write(f"{title}\n")
        for k, stamp in enumerate(_calendar_texts(gnss.t, base.epoch_gps_s)):
            lat, lon, h = gnss.llh[k] * (1.0 / units.DEG, 1.0 / units.DEG, 1.0)
            accuracy = " ".join(map(_accuracy_text, table[k]))
            tail = "".join(f" {value:11.6f}" for value in velocity[k] if value == value)
            stream.write(
                f"{stamp} {lat:16.11f} {lon:16.11f} {h:15.6f} {quality[k]:3d} {satellites[k]:3d} {accuracy}"
                f" {0.0:6.2f} {0.0:6.1f}{tail}\n"
            )
    return [Path(path)]


def _sigma_columns(cov: FloatArray) -> FloatArray:
    """sdn, sde, sdu, sdne, sdeu, sdun of covariances north, east, down. Shapes (n, 3, 3) to (n, 6)."""
    sigma = np.sqrt(np.einsum("nii->ni", cov))
    cross = np.stack((cov[:, 0, 1], -cov[:, 1, 2], -cov[:, 0, 2]), axis=1)
    return np.column_stack((sigma, np.sign(cross) * np.sqrt(np.abs(cross))))


def _accuracy_text(value: float) -> str:
    # fixed digits would turn a very small accuracy into none at all
    return f"{value:11.6f}" if value == 0.0 or abs(value) >= 1e-3 else f"{value:11.4e}"


def _calendar_texts(t: FloatArray, epoch_gps_s: float) -> list[str]:
    """Dates and times with as many decimals of a second (3, 6 or 9) as the stamps need."""
    if (longest := float(np.abs(np.concatenate(([epoch_gps_s], t, t + epoch_gps_s))).max())) > _LONGEST_S:
        raise InputError(
            f"a .pos file has dates, and stamps up to {longest:.3g} s have none: expected up to {_LONGEST_S:g} s"
        )
    # whole nanoseconds keep 59.9999999996 s from being printed as 60
    whole_epoch = int(epoch_gps_s // 1.0)
    nanoseconds = np.round(t * 1e9).astype(np.int64) + whole_epoch * 10**9 + round((epoch_gps_s - whole_epoch) * 1e9)
    decimals = next((d for d in (3, 6) if not np.any(nanoseconds % 10 ** (9 - d))), 9)
    texts = []
    for whole, part in zip((nanoseconds // 10**9).tolist(), (nanoseconds % 10**9).tolist(), strict=True):
        moment: dt.datetime = calendar(whole)
        texts.append(f"{moment:%Y/%m/%d %H:%M:%S}.{part // 10 ** (9 - decimals):0{decimals}d}")
    return texts
