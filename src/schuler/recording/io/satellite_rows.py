"""Tables with a row for each satellite that repeats the receiver's place in all rows of an epoch: ``device_gnss.csv``.

Of Google's Smartphone Decimeter Challenge: ``utcTimeMillis`` [ms], ``WlsPositionXEcefMeters`` and Y, Z, a weighted
least-squares solution, beside what each satellite was received with.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from schuler import frames
from schuler.recording.io import line_forms, lines
from schuler.recording.io.possible import RADII
from schuler.units import DEG

_PLACE = tuple(f"WlsPosition{axis}EcefMeters" for axis in "XYZ")
_TIME = "utcTimeMillis"


def has_places(head: str) -> bool:
    """Whether the first line of a file names the columns of such a table.

    Parameters
    ----------
    head : str
    """
    return {_TIME, *_PLACE} <= set(line_forms.fields_of(head.partition("\n")[0].strip(), ","))


def place_rows(path: Path) -> Iterator[tuple[str, line_forms.Row]]:
    """One place for each epoch that has one.

    Parameters
    ----------
    path : Path
    """
    rows = line_forms.text_of(path)
    names = line_forms.fields_of(next(rows), ",")
    time, place = names.index(_TIME), [names.index(name) for name in _PLACE]
    before = ""
    for text in rows:
        fields = line_forms.fields_of(text, ",")
        if len(fields) != len(names):
            yield "", {}
            continue
        if fields[time] == before or not all(fields[k] and lines.is_number(fields[k]) for k in place):
            continue
        before = fields[time]
        r_e = np.array([[float(fields[k]) for k in place]])
        if not RADII[0] <= math.hypot(*r_e[0]) <= RADII[1]:
            yield "", {}  # nowhere
            continue
        lat, lon, h = frames.llh_from_ecef(r_e)[0]
        yield (
            "fix",
            {"t [ms]": before, "lat [deg]": f"{lat / DEG:.9f}", "lon [deg]": f"{lon / DEG:.9f}", "h [m]": f"{h:.4f}"},
        )
