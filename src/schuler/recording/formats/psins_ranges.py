"""PSINS's tightly coupled data (``.mat`` with ``imu``, ``obss`` and ``ephs``): increments, ranges and ephemerides.

``imu`` is angle increments [rad], velocity increments [m/s] and time [s]; ``obss`` is time of week, PRN, pseudorange
[m], carrier [m], 1-sigma of the pseudorange [m] and the rate [m/s], positive for an approaching satellite (found in the
data: its sum with the pseudorange's own rate is zero to centimetres per second); ``ephs`` has one GPS ephemeris a row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.gnss.ephemerides import Ephemerides, KeplerRecords, no_glonass
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SPEED_OF_LIGHT, frequency_hz
from schuler.recording.formats import matlab_file
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.timebase import WEEK_S, TimeBase

_COLUMNS = {"imu": 7, "obss": 6, "ephs": 31}
#: Columns of ``ephs`` (as RINEX orders them); angles are radians, times seconds of the week in column 23.
_EPHEMERIS = {
    "af0": 2, "af1": 3, "af2": 4, "issue": 5, "crs": 6, "delta_n": 7, "m0": 8, "cuc": 9, "e": 10, "cus": 11,
    "sqrt_a": 12, "cic": 14, "omega0": 15, "cis": 16, "i0": 17, "crc": 18, "omega": 19, "omega_dot": 20, "idot": 21,
}  # fmt: skip
_PRN, _TOC, _TOE, _WEEK, _ACCURACY, _HEALTH, _TGD = 0, 1, 13, 23, 25, 26, 27
_LATEST = 1e7  # no time of week or number of a satellite is greater
_USUAL_ACCURACY = 2.0  # of an ephemeris whose accuracy the file does not have [m]


@dataclass(frozen=True)
class RangeLog:
    """Increments, measurements and ephemerides of one run on one time axis.

    Attributes
    ----------
    recording : Recording
        With all of it.
    observations : Observations
    ephemerides : Ephemerides
    sigma_range : ndarray, shape (n,)
        1-sigma of each pseudorange as the file has it. [m]
    """

    recording: Recording
    observations: Observations
    ephemerides: Ephemerides
    sigma_range: FloatArray


def read_psins_ranges(path: Path | str) -> RangeLog:
    """Read a PSINS file of increments, pseudoranges and ephemerides.

    Parameters
    ----------
    path : Path or str
        ``.mat`` up to version 7 with ``imu`` (N x 7), ``obss`` (M x 6), ``ephs`` (32 x 31) and ``t0``, the time of week
        of zero seconds of ``imu``.

    Returns
    -------
    RangeLog
        On GPS time from the start of the week; increments turned from right-forward-up to forward-right-down.

    Raises
    ------
    FileFormatError
        If an array is missing or of another shape, or no ephemeris is filled in.
    """
    path = Path(path)
    check_file(path)
    arrays = _arrays(path)
    ephemerides, week = _ephemerides(path, arrays["ephs"])
    start, t0 = week * WEEK_S, float(np.ravel(arrays["t0"])[0])
    imu = arrays["imu"]
    if not 0.0 <= t0 < WEEK_S or np.any(np.diff(imu[:, 6]) <= 0.0):
        raise FileFormatError(f"expected t0 within a week and increasing times of imu, got t0 = {t0:g}", path)
    C_bs = axes_matrix("RFU")
    series = ImuSeries(t0 + imu[:, 6], imu[:, :3] @ C_bs.T, imu[:, 3:6] @ C_bs.T, "increment")
    observations, sigma = _observations(path, arrays["obss"], start)
    notes = (
        "Increments were turned from right, forward, up.",
        f"Week {week} is that of the ephemerides; zero seconds of imu is {t0:.6f} s of it.",
        "Rates of obss are positive for an approaching satellite; range rates have the opposite sign.",
        *observations.notes,
        *ephemerides.notes,
    )
    metadata = replace(metadata_of(path, ReadHints(), TimeBase("gps", start), notes), axes="RFU")
    recording = Recording(imu=series, observations=observations, ephemerides=ephemerides, metadata=metadata)
    return RangeLog(recording, observations, ephemerides, sigma)


def _arrays(path: Path) -> dict[str, FloatArray]:
    contents = matlab_file.load(path, {*_COLUMNS, "t0"})
    arrays = {}
    for name, columns in (*_COLUMNS.items(), ("t0", 1)):
        array = np.asarray(contents.get(name, np.empty((0, 0))))
        if array.ndim != 2 or array.shape[1] != columns or array.size == 0 or array.dtype.kind not in "fiu":
            raise FileFormatError(
                f"expected an array {name} of numbers with {columns} columns, got shape {array.shape}", path
            )
        arrays[name] = array.astype(np.float64)
    if not np.isfinite(arrays["imu"]).all():
        raise FileFormatError("expected finite numbers in imu", path)
    return arrays


def _observations(path: Path, obss: FloatArray, start: float) -> tuple[Observations, FloatArray]:
    if not np.isfinite(obss[:, :2]).all() or np.abs(obss[:, :2]).max() > _LATEST:
        raise FileFormatError("expected times of week and satellite numbers in the first columns of obss", path)
    order = np.argsort(obss[:, 0], kind="stable")
    tow, prn, pseudorange, carrier, sigma, approach = obss[order].T
    cycle = SPEED_OF_LIGHT / frequency_hz(1, "1C")
    n = len(tow)
    observations = Observations(
        tow, prn.astype(np.int64), np.zeros(n, dtype=np.int64), ("1C",), pseudorange, -approach, carrier / cycle,
        np.full(n, np.nan), start, notes=("The file has no carrier to noise densities.",),
    )  # fmt: skip
    return observations, sigma


def _ephemerides(path: Path, ephs: FloatArray) -> tuple[Ephemerides, int]:
    """Ephemerides of the rows that are filled in, and their week."""
    rows = ephs[(ephs[:, 12] > 0.0) & (ephs[:, _WEEK] > 0.0) & np.isfinite(ephs[:, _WEEK])]
    weeks = np.unique(rows[:, _WEEK])
    if len(weeks) != 1:
        raise FileFormatError(f"expected ephemerides of one week, got weeks {weeks.astype(int).tolist()}", path)
    n, start = len(rows), float(weeks[0]) * WEEK_S
    accuracy = rows[:, _ACCURACY]
    known = np.isfinite(accuracy) & (accuracy > 0.0)
    notes: tuple[str, ...] = (f"{len(ephs) - n} of {len(ephs)} rows of ephs are empty.",)
    if not known.all():
        notes += (f"{int(np.sum(~known))} ephemerides have no accuracy; it was set to {_USUAL_ACCURACY:g} m.",)
    values: dict[str, Any] = {name: rows[:, column] for name, column in _EPHEMERIS.items()}
    kepler = KeplerRecords(
        sat=rows[:, _PRN].astype(np.int64),
        toe=start + rows[:, _TOE],
        toc=start + rows[:, _TOC],
        sent=np.full(n, np.nan),
        group_delay=np.stack((rows[:, _TGD], np.full(n, np.nan)), axis=1),
        health=rows[:, _HEALTH].astype(np.int64),
        accuracy=np.where(known, accuracy, _USUAL_ACCURACY),
        source=np.zeros(n, dtype=np.int64),
        **values,
    )
    return Ephemerides(kepler, no_glonass(), notes=notes), int(weeks[0])
