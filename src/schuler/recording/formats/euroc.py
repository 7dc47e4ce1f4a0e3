"""EuRoC MAV data sets (TUM-VI too, and what copies their layout): ``mav0/imu0/data.csv`` and ground truth.

Columns of the IMU: stamp [ns], angular rate [rad/s], specific force [m/s^2]. Of ground truth: stamp, position in a
local frame, attitude of the sensor (scalar first), and perhaps velocity and biases. Layout: Burri et al., The EuRoC
micro aerial vehicle datasets, IJRR 35(10), 2016, section 4.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import clock, lines, local_frame, parts, plain_text
from schuler.recording.io.hint_texts import axes_matrix, parse_origin, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, stream_of
from schuler.recording.recording import Recording

OWN = "schuler.json"
OWN_FORMAT = "schuler/euroc/1"
#: Folders of ground truth, the first one that is there is read unless ``streams`` names another.
TRUTH = ("state_groundtruth_estimate0", "mocap0", "vicon0", "leica0")
_WIDTHS = {"imu": (7,), "reference": (4, 8, 17)}
_WHAT = {"imu": "stamp, three rates, three specific forces", "reference": "stamp, position, quaternion, velocity, ..."}
_HINTS = {"axes", "time", "origin", "streams"}
_VI_SENSOR = "URF"  # x up, y right, z forward: the VI-Sensor of the EuRoC vehicles, by T_BS of its camera 0


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is the ``data.csv`` of an IMU or of ground truth."""
    return _part(head) is not None


def sniff_folder(path: Path) -> bool:
    """Whether a folder is a data set, or its ``mav0``."""
    try:
        return _root(path) is not None
    except OSError:
        return False


def holds(path: Path) -> tuple[str, ...]:
    """The series of a file."""
    part = _part(lines.check_file(path))
    return () if part is None else (part,)


def contents(path: Path) -> list[Stream]:
    """The tables of a data set with their times, for ``schuler info``."""
    root = _root(path) if path.is_dir() else None
    streams = []
    for file in sorted(root.glob("*/data.csv")) if root is not None else [path]:
        part = _part(lines.check_file(file))
        if part is None:
            continue
        ns, _ = _load(file, part, ReadHints(allow="truncated"), [])
        name = file.parent.name if root is not None else file.name
        streams.append(stream_of(name, "csv", ns / clock.NS, part))
    return streams


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU and ground truth of a data set, or of one of its files.

    Parameters
    ----------
    path : Path
        The data set, its ``mav0``, or one ``data.csv``.
    hints : ReadHints
        ``axes`` of the sensor, ``time`` ("unix" or "gps-unix" if stamps are dates), ``origin`` of the local frame
        (without it ground truth is left out with a note), ``streams`` such as ``"imu=imu1,reference=vicon0"``.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    InputError
        For hints that have no meaning here, or ground truth alone without an origin.
    """
    parts.check_hints(path, hints, _HINTS, "an EuRoC data set")
    own: dict[str, Any] = {}
    if path.is_dir():
        root = _root(path)
        if root is None:
            raise FileFormatError("expected a folder with mav0/imu0/data.csv", path)
        own = _own(root / OWN)
        files = _chosen(root, hints)
    else:
        part = hints.series if hints.series in _WIDTHS else _part(lines.check_file(path))
        if part is None:
            raise FileFormatError(
                "expected a header '#timestamp [ns],w_RS_S_x ...' or '#timestamp, p_RS_R_x ...'", path
            )
        files = {part: path}
    notes: list[str] = []
    axes = hints.axes or own.get("axes") or _axes_of(files.get("imu"), notes)
    hints = replace(hints, axes=axes, origin=hints.origin or own.get("origin"), time=hints.time or own.get("time"))
    origin = parse_origin(hints.origin)
    if "reference" in files and origin is None and "imu" in files:
        left = files.pop("reference").relative_to(path)
        notes.append(f"Ground truth ({left}) is in a local frame and was left out: origin='LAT,LON,HEIGHT' places it.")
    stamps, tables = {}, {}
    for part, file in files.items():
        stamps[part], tables[part] = _load(file, part, hints, notes)
    seconds, base = clock.from_unix(stamps, hints.time, notes)
    made = {}
    for part, values in tables.items():
        t, values = parts.kept(parts.later(seconds[part], part, files[part], notes), seconds[part], values)
        made[part] = _table(part, t, values, hints, files[part], notes)
    name = hints.name or (path.stem if path.name not in ("mav0", "data.csv") else path.resolve().parent.name)
    root = path if path.is_dir() else None
    return parts.assemble(path, made, replace(hints, name=name), base, notes, files.values(), root)


def _part(head: bytes) -> str | None:
    line = head[:400].lstrip(b"\xef\xbb\xbf").split(b"\n")[0].strip()
    if not line.startswith(b"#") or b"timestamp" not in line.lower():
        return None
    if b"p_RS_R_x" in line:  # asked first: the biases of ground truth are called b_w_RS_S_x and b_a_RS_S_x
        return "reference"
    return "imu" if b"w_RS_S_x" in line and b"a_RS_S_x" in line else None


def _root(path: Path) -> Path | None:
    for root in (path / "mav0", path):
        if (root / "imu0" / "data.csv").is_file() or any((root / name / "data.csv").is_file() for name in TRUTH):
            return root
    return None


def _chosen(root: Path, hints: ReadHints) -> dict[str, Path]:
    chosen = parse_streams(hints.streams)
    folders = sorted(p.parent.name for p in root.glob("*/data.csv"))
    imus = [Stream(name, "csv", 1, part="imu") for name in folders if name.startswith("imu")]
    truths = [Stream(name, "csv", 1, part="reference") for name in TRUTH if name in folders]
    others = [Stream(name, "csv", 1) for name in folders]
    files = {}
    if imu := choose(imus + others, "imu", chosen):
        files["imu"] = root / imu.name / "data.csv"
    first = truths[:1] if "reference" not in chosen else truths
    if truth := choose(first + others, "reference", chosen):
        files["reference"] = root / truth.name / "data.csv"
    if not files:
        raise InputError(f"{root}: streams leaves nothing to read")
    return files


def _own(path: Path) -> dict[str, Any]:
    """Metadata of a data set written by this package; empty for others."""
    if not path.is_file():
        return {}
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["format"] != OWN_FORMAT:
            raise ValueError(document["format"])
        return {name: str(document[name]) for name in ("axes", "origin", "time") if document.get(name) is not None}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileFormatError(f"what schuler wrote beside the data is damaged ({error!r}); delete it", path) from error


def _axes_of(imu: Path | None, notes: list[str]) -> str | None:
    """Axes of the VI-Sensor, if the data set says that it is one; otherwise they are not known."""
    sensor = None if imu is None else imu.parent / "sensor.yaml"
    if sensor is None or not sensor.is_file():
        return None
    text = sensor.read_bytes()[:20_000]
    if b"VI-Sensor IMU" not in text:
        return None
    notes.append("Axes are those of the VI-Sensor that sensor.yaml names: up, right, forward.")
    return _VI_SENSOR


def _load(path: Path, part: str, hints: ReadHints, notes: list[str]) -> tuple[Any, Any]:
    table = plain_text.open_table(path, _WIDTHS[part], _WHAT[part], delimiter=",")
    n = plain_text.width(table)
    return plain_text.load_ns(table, n, allow_truncated=hints.allows("truncated"), notes=notes)


def _table(part: str, t: Any, values: Any, hints: ReadHints, path: Path, notes: list[str]) -> Table:
    if part == "imu":
        columns = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), values.T, strict=True))
        return Table({"t": t, **columns})
    origin = local_frame.need_origin(parse_origin(hints.origin), path, "ground truth poses")
    notes.append("Ground truth: the local frame is taken as east, north, up of the origin.")
    if path.parent.name in TRUTH[2:]:
        notes.append(f"Ground truth is the pose of {path.parent.name}, not of the IMU; its T_BS was not applied.")
    q = values[:, 3:7] if values.shape[1] >= 7 else None
    v = values[:, 7:10] if values.shape[1] >= 10 else None
    columns = local_frame.earth_fixed(origin, values[:, :3], q, v, axes_matrix(hints.axes), path)
    return Table({"t": t, **columns})


def write(recording: Recording, path: Path, origin: str | None = None) -> list[Path]:
    """Write IMU and reference as a data set: a new folder with ``mav0``.

    Parameters
    ----------
    recording : Recording
        With an IMU (written as rates, axes forward-left-up) or a reference (east-north-up about the origin).
    path : Path
        The folder; it must not exist.
    origin : str, optional
        ``"LAT,LON,HEIGHT"`` [deg, m]; default the first position of the reference.

    Returns
    -------
    list of Path
        The files. ``schuler.json`` says axes, origin and meaning of the stamps, so that this package reads the folder
        back without hints.

    Notes
    -----
    Stamps are Unix time [ns], or the recording's own clock. Biases of the ground truth are written as zero. Numbers
    have 17 digits and come back to rounding, stamps to a nanosecond.
    """
    base = recording.metadata.time
    imu, reference = recording.imu, recording.reference
    document: dict[str, Any] = {"format": OWN_FORMAT, "axes": "FLU", "name": recording.metadata.name}
    document["time"] = "unix" if base.scale != "local" else "local"
    C_bs = local_frame.FLU
    with files.new_folder(path) as folder:
        root = folder / "mav0"
        if imu is not None:
            rates = imu.rates()
            head = "timestamp [ns]," + ",".join(
                [f"w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"a_RS_S_{a} [m s^-2]" for a in "xyz"]
            )
            rows = np.column_stack((rates.gyro @ C_bs, rates.accel @ C_bs))
            _write_csv(root / "imu0" / "data.csv", head, clock.to_unix(rates.t, base), rows)
            comment = f"# Written by schuler.\nsensor_type: imu\ncomment: {json.dumps(recording.metadata.name)}\n"
            identity = "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
            rate = f"rate_hz: {rates.rate_hz:.6g}\n" if len(rates) > 1 else ""
            (root / "imu0" / "sensor.yaml").write_text(comment + identity + rate, encoding="utf-8")
        if reference is not None:
            place = local_frame.origin_of(reference, origin)
            document["origin"] = local_frame.origin_text(place)
            r, q, v = local_frame.local(reference, place, C_bs)
            names = [f"p_RS_R_{a} [m]" for a in "xyz"]
            columns = [r]
            if q is not None:
                names += [f"q_RS_{a} []" for a in "wxyz"]
                columns.append(q)
                if v is not None:
                    names += [f"v_RS_R_{a} [m s^-1]" for a in "xyz"]
                    names += [f"b_w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"b_a_RS_S_{a} [m s^-2]" for a in "xyz"]
                    columns += [v, np.zeros((len(r), 6))]
            head = "timestamp," + ",".join(f" {name}" for name in names)
            stamps = clock.to_unix(reference.t, base)
            _write_csv(root / TRUTH[0] / "data.csv", head, stamps, np.column_stack(columns))
        (root / OWN).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return sorted(p for p in Path(path).rglob("*") if p.is_file())


def _write_csv(path: Path, head: str, ns: Any, rows: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pattern = "%d," + ",".join(["%.17g"] * rows.shape[1])
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"#{head}\n")
        for start in range(0, len(rows), 8192):
            block = zip(ns[start : start + 8192].tolist(), rows[start : start + 8192].tolist(), strict=True)
            stream.write("\n".join([pattern % (stamp, *row) for stamp, row in block]) + "\n")
