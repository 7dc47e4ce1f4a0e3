"""CSV files that say what they hold: one table per part, units in the header, the rest in one comment line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import files, units
from schuler.recording.formats.text import OWN_FAMILY, OWN_MARK
from schuler.recording.io import columns, own
from schuler.recording.io.own import Columns
from schuler.recording.recording import Recording

_DEGREES = ("lat", "lon", "heading", "sheading")
_ROWS_PER_BLOCK = 65_536


def write_csv(recording: Recording, path: Path | str) -> list[Path]:
    """Write a recording as CSV, in SI but for latitudes, longitudes and headings in degrees, losing no digit.

    Parameters
    ----------
    recording : Recording
    path : Path or str
        File of the first part (the IMU if there is one); further parts go beside it as ``NAME_gnss.csv``,
        ``NAME_odometer.csv``, ``NAME_heading.csv``, ``NAME_height.csv``, ``NAME_reference.csv``,
        ``NAME_observations.csv``, ``NAME_ranges.csv``, ``NAME_ephemerides.csv``.

    Returns
    -------
    list of Path
        The files written. Reading the first reads all of them, without any hint.
    """
    path = Path(path)
    flat = own.flatten(recording)
    names = list(flat)
    described = {"format": f"{OWN_FAMILY}/{own.version(recording)}", **own.document(recording, flat)}
    paths = {
        name: path if k == 0 else path.with_name(f"{path.stem}_{name}{path.suffix}") for k, name in enumerate(names)
    }
    # companions first: a reader that sees the first file finds those it names
    for k, name in reversed(list(enumerate(names))):
        document = {**described, "holds": name}
        if k == 0 and len(names) > 1:
            document["beside"] = {other: paths[other].name for other in names[1:]}
        kind = recording.imu.kind if name == "imu" and recording.imu is not None else "rate"
        _write_table(paths[name], _for_people(flat[name]), own.to_json(document), kind)
    return list(paths.values())


def _write_table(path: Path, table: Columns, document: str, kind: str) -> None:
    si = own.INCREMENT_UNITS if kind == "increment" else own.UNITS
    header = ",".join(f"{name} [{'deg' if name in _DEGREES else si[name]}]" for name in table)
    header = header.replace(" [1]", "")
    # lists of Python numbers print the shortest text that reads back as the same number
    arrays = list(table.values())
    with files.replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"{OWN_MARK}{document[1:]}\n{header}\n")
        for start in range(0, len(arrays[0]), _ROWS_PER_BLOCK):
            block = [map(repr, array[start : start + _ROWS_PER_BLOCK].tolist()) for array in arrays]
            stream.writelines(",".join(row) + "\n" for row in zip(*block, strict=True))


def _for_people(table: Columns) -> Columns:
    """Degrees for positions and headings, and 1-sigma values before cross terms instead of covariance matrices."""
    shown: Columns = {}
    sigmas = {"cnn": "sn", "cee": "se", "cdd": "sd", "cvnn": "svn", "cvee": "sve", "cvdd": "svd"}
    for name, values in table.items():
        if name in _DEGREES:
            shown[name] = values / units.DEG
        elif name in sigmas:
            shown[sigmas[name]] = np.sqrt(values)
        elif name not in (*columns.CROSS, *columns.VELOCITY_CROSS):
            shown[name] = values
    shown |= {n: v for n, v in table.items() if n in (*columns.CROSS, *columns.VELOCITY_CROSS)}
    return shown
