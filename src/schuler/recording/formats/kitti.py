"""KITTI raw data: the folder ``oxts`` of a drive, one text file of 30 numbers a sample and ``timestamps.txt`` beside.

Numbers by the data set's ``dataformat.txt``: latitude, longitude [deg], altitude [m]; roll, pitch (front down), yaw
from east over north [rad]; velocity north, east, forward, left, up [m/s]; acceleration x, y, z of the vehicle
(forward, left, up) and levelled [m/s^2]; angular rate likewise [rad/s]; accuracies of position [m] and velocity [m/s];
status. Geiger et al., Vision meets robotics: the KITTI dataset, IJRR 32(11), 2013.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files, rotation, units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import clock, lines, parts
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.local_frame import FLU
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording

_COLUMNS = 30
_LINE = 4096  # bytes; a sample has about 600
_STAMP = re.compile(r"(19[7-9]\d|20\d\d|21\d\d)-\d\d-\d\d \d\d:\d\d:\d\d(\.\d{1,9})?", re.ASCII)
_HINTS = parts.GNSS_HINTS | {"axes", "time"}


def sniff(head: bytes, path: Path) -> bool:
    """No file is the data set, only its folder."""
    return False


def sniff_folder(path: Path) -> bool:
    """Whether a folder is ``oxts`` or holds it."""
    try:
        return _root(path) is not None
    except OSError:
        return False


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU and reference of a drive.

    Parameters
    ----------
    path : Path
        The drive or its ``oxts``.
    hints : ReadHints
        ``time="unix"`` if the stamps are UTC; ``axes`` other than forward-left-up; ``height``; ``series="gnss"`` takes
        the positions as fixes instead of as the reference.

    Returns
    -------
    Recording
        Positions, velocities and attitude are the output of the vehicle's own INS (RT3003), so they are a reference;
        as fixes they are correlated and already fused, which a note says.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    """
    parts.check_hints(path, hints, _HINTS, "a KITTI drive")
    root = _root(path) if path.is_dir() else None
    if root is None:
        raise FileFormatError("expected a folder with oxts/timestamps.txt and oxts/data/0000000000.txt", path)
    notes: list[str] = []
    stamps = _stamps(root / "timestamps.txt")
    names, rows, digest = _samples(root / "data", len(stamps))
    seconds, base = clock.from_unix({"oxts": stamps[names]}, hints.time, notes)
    keep = parts.later(seconds["oxts"], "oxts", root / "timestamps.txt", notes)
    t, rows = seconds["oxts"][keep], rows[keep]
    position: dict[str, FloatArray] = {
        "t": t, "lat": rows[:, 0] * units.DEG, "lon": rows[:, 1] * units.DEG, "h": rows[:, 2],
        "vn": rows[:, 6], "ve": rows[:, 7], "vd": -rows[:, 10],
    }  # fmt: skip
    tables: dict[str, Table] = {}
    if rows[:, 11:14].any() and hints.series in (None, "imu"):
        columns = dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), rows[:, [11, 12, 13, 17, 18, 19]].T, strict=True))
        tables["imu"] = Table({"t": t, **columns}, axes="FLU")
    elif hints.series in (None, "imu"):
        notes.append("The drive has no accelerations; there is no IMU series.")
    if hints.series == "gnss":
        accuracy = {"sn": 23, "se": 23, "sd": 23, "svn": 24, "sve": 24, "svd": 24}
        position |= {name: rows[:, k] for name, k in accuracy.items()}
        notes.append(
            "The fixes are positions of an INS that has fused them already: their errors are correlated in time, and a "
            "filter that takes them as independent is too sure of itself."
        )
        tables["gnss"] = Table(position, ellipsoidal=False)
    elif hints.series in (None, "reference"):
        attitude = {"roll": rows[:, 3], "pitch": -rows[:, 4], "yaw": 0.5 * np.pi - rows[:, 5]}
        tables["reference"] = Table(position | attitude, ellipsoidal=False)
    name = hints.name or (path if path.name != "oxts" else path.resolve().parent).name
    sources = [root / "timestamps.txt"]
    recording = parts.assemble(path, tables, replace(hints, name=name), base, notes, sources)
    whole = {**recording.metadata.sources, f"oxts/data ({len(names)} files)": digest}
    return replace(recording, metadata=replace(recording.metadata, sources=whole))


def _root(path: Path) -> Path | None:
    for root in (path / "oxts", path):
        if (root / "timestamps.txt").is_file() and (root / "data").is_dir():
            return root
    return None


def _stamps(path: Path) -> IntArray:
    """Stamps in nanoseconds since 1970 of the clock they were written by. Shape (n,)."""
    encoding = lines.encoding_of(lines.check_file(path), path)
    texts = [line.strip() for line in path.read_text(encoding=encoding, errors="replace").splitlines()]
    while texts and not texts[-1]:
        texts.pop()
    wrong = next((k for k, text in enumerate(texts) if _STAMP.fullmatch(text) is None), None)
    if wrong is None and texts:
        try:
            return np.array(texts, dtype="datetime64[ns]").astype(np.int64)
        except ValueError:  # the thirtieth of February
            wrong = next((k for k, text in enumerate(texts) if not _is_date(text)), 0)
    shown = lines.shorten(texts[wrong], 40) if wrong is not None else "an empty file"
    raise FileFormatError(
        f"expected a date and time such as 2011-09-26 13:02:25.594360375, got {shown}",
        path,
        None if wrong is None else wrong + 1,
    )


def _is_date(text: str) -> bool:
    try:
        np.datetime64(text, "ns")
    except ValueError:
        return False
    return True


def _samples(folder: Path, n: int) -> tuple[IntArray, FloatArray, str]:
    """Numbers of the files that are there, their rows of numbers, and one digest of all."""
    files = sorted(folder.glob("*.txt"))
    if not files:
        raise FileFormatError("there is no sample, 0000000000.txt", folder)
    digest, rows, places = hashlib.sha256(), [], []
    for file in files:
        if not (file.stem.isascii() and file.stem.isdigit()) or int(file.stem) >= n:
            raise FileFormatError(f"expected a file numbered 0..{n - 1} ({n} lines in timestamps.txt)", file)
        with file.open("rb") as stream:
            data = stream.read(_LINE)
        if len(data) == _LINE:
            raise FileFormatError(f"expected one line of {_COLUMNS} numbers, got a longer file", file)
        digest.update(data)
        fields = data.decode("latin-1").split()
        if len(fields) != _COLUMNS or not all(map(lines.is_number, fields)):
            wrong = next((k for k, field in enumerate(fields, 1) if not lines.is_number(field)), 0)
            got = f"{len(fields)} fields" + (
                f", field {wrong} is {lines.shorten(fields[wrong - 1], 30)}" if wrong else ""
            )
            raise FileFormatError(f"expected {_COLUMNS} numbers, got {got}", file, 1)
        rows.append([float(field) for field in fields])
        places.append(int(file.stem))
    return np.array(places, dtype=np.int64), np.array(rows, dtype=np.float64), digest.hexdigest()


def write(recording: Recording, path: Path) -> list[Path]:
    """Write a drive: a new folder with ``oxts``.

    Parameters
    ----------
    recording : Recording
        With a reference that has velocity and attitude, or else fixes with a velocity. An IMU is interpolated to
        its times (forward-left-up); without one, accelerations and rates are written as zero.
    path : Path
        The folder; it must not exist.

    Returns
    -------
    list of Path
        ``timestamps.txt`` and the folder of samples.

    Raises
    ------
    InputError
        If velocities are missing, or the IMU does not cover the times.

    Notes
    -----
    Stamps are UTC, or the recording's own clock counted from 1970. Accuracies are those of the fixes where fixes are
    written, else zero; the status fields are zero. Numbers have 17 digits.
    """
    t, llh, v_n, rpy, accuracy = _motion(recording)
    n = len(t)
    rows = np.zeros((n, _COLUMNS))
    rows[:, 0:2], rows[:, 2] = llh[:, :2] / units.DEG, llh[:, 2]
    rows[:, 3], rows[:, 4] = rpy[:, 0], -rpy[:, 1]
    rows[:, 5] = np.arctan2(np.cos(rpy[:, 2]), np.sin(rpy[:, 2]))
    level = rotation.dcm_from_rpy(rpy * (0.0, 0.0, 1.0))  # forward and right in the horizontal plane
    rows[:, 6:8], rows[:, 10] = v_n[:, :2], -v_n[:, 2]
    rows[:, 8:10] = (np.einsum("nji,nj->ni", level, v_n) @ FLU)[:, :2]
    if recording.imu is not None:
        imu = recording.imu.rates()
        if t[0] < imu.t[0] - 1e-6 or t[-1] > imu.t[-1] + 1e-6:
            raise InputError(
                f"the IMU runs {imu.t[0]:.3f}..{imu.t[-1]:.3f} s, the motion {t[0]:.3f}..{t[-1]:.3f} s: cut the "
                "recording (Trajectory.between) to what both cover"
            )
        turn = np.swapaxes(level, 1, 2) @ rotation.dcm_from_rpy(rpy)
        for at, series in ((11, imu.accel), (17, imu.gyro)):
            b = np.stack([np.interp(t, imu.t, series[:, k]) for k in range(3)], axis=1)
            rows[:, at : at + 3] = b @ FLU
            rows[:, at + 3 : at + 6] = np.einsum("nij,nj->ni", turn, b) @ FLU
    rows[:, 23:25] = accuracy
    ns = clock.to_unix(t, recording.metadata.time)
    pattern = " ".join(["%.17g"] * 25 + ["%d"] * 5) + "\n"
    with files.new_folder(path) as folder:
        data = folder / "oxts" / "data"
        data.mkdir(parents=True)
        texts = np.datetime_as_string(ns.astype("M8[ns]"), unit="ns")
        stamps = "".join(f"{text.replace('T', ' ')}\n" for text in texts.tolist())
        (folder / "oxts" / "timestamps.txt").write_text(stamps, encoding="utf-8", newline="\n")
        for k, row in enumerate(rows.tolist()):
            (data / f"{k:010d}.txt").write_text(pattern % tuple(row), encoding="utf-8", newline="\n")
    return [Path(path) / "oxts" / "timestamps.txt", Path(path) / "oxts" / "data"]


def _motion(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, Any]:
    reference, gnss = recording.reference, recording.gnss
    if reference is not None and reference.v_eb_e is not None:
        rpy = reference.rpy_nb if reference.q_eb is not None else _along(reference.v_eb_n)
        return reference.t, reference.llh, reference.v_eb_n, rpy, 0.0
    if gnss is not None and gnss.v_n is not None and gnss.cov_v_n is not None:
        sigma = [np.sqrt(np.einsum("nii->n", cov) / 3.0) for cov in (gnss.cov_r_n, gnss.cov_v_n)]
        return gnss.t, gnss.llh, gnss.v_n, _along(gnss.v_n), np.stack(sigma, axis=1)
    raise InputError("a KITTI drive needs velocities: a reference with them, or fixes with them")


def _along(v_n: FloatArray) -> FloatArray:
    """Roll, pitch, yaw of a level body that looks where it goes. Shape (n, 3)."""
    return np.stack((0.0 * v_n[:, 0], 0.0 * v_n[:, 0], np.arctan2(v_n[:, 1], v_n[:, 0])), axis=1)
