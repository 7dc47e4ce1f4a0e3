"""Maps behind the track of a page: files of the folder, and OpenStreetMap where the user asks for it.

Nothing is fetched from elsewhere but tiles of OpenStreetMap, by the server, while they are chosen as the map; each tile
once, it is kept in the folder.
"""

from __future__ import annotations

import base64
import io
import urllib.error
import urllib.request
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.files import package_version, replacing
from schuler.navigation.report.backdrop import Backdrop, Window, backdrop_items, read_backdrop
from schuler.plotting.figure import Line, Picture
from schuler.plotting.tiles import Tiles
from schuler.studio.workspace import JOBS, Workspace

#: Choice of a page that fetches tiles; no file of a folder has this name.
NETWORK = "OpenStreetMap, from the network"
#: Address of a tile.
SERVER = "https://tile.openstreetmap.org/{zoom}/{column}/{row}.png"
_CREDIT = "© OpenStreetMap contributors, openstreetmap.org/copyright"
_ZOOMS = (0, 18)
_WAIT_S = 10.0
_LEAST_HALF_M = 50.0


def backdrop_of(workspace: Workspace, name: str) -> Backdrop:
    """Map by its name.

    Raises
    ------
    InputError, FileFormatError, MissingExtraError
        As :func:`schuler.navigation.report.backdrop.read_backdrop`.
    """
    if name == NETWORK:
        return Backdrop("OpenStreetMap", _CREDIT, tiles=Tiles("OpenStreetMap", _CREDIT, _ZOOMS, _Fetched(workspace)))
    return read_backdrop(workspace.inside(name))


class _Fetched:
    """Tiles of OpenStreetMap, from the folder where they have been before."""

    def __init__(self, workspace: Workspace) -> None:
        self._folder = workspace.root / JOBS / "tiles"

    def __call__(self, zoom: int, column: int, row: int) -> bytes:
        path = self._folder / f"{zoom}-{column}-{row}.png"
        if path.is_file():
            return path.read_bytes()
        address = SERVER.format(zoom=zoom, column=column, row=row)
        agent = {"User-Agent": f"schuler/{package_version()} (workbench for inertial navigation)"}
        try:
            with urllib.request.urlopen(urllib.request.Request(address, headers=agent), timeout=_WAIT_S) as answer:  # noqa: S310 because it is https
                data: bytes = answer.read()
        except (urllib.error.URLError, OSError) as error:
            raise InputError(f"map: expected a tile of OpenStreetMap, got none ({error}): choose another map") from None
        self._folder.mkdir(parents=True, exist_ok=True)
        with replacing(path, at_once=True) as temporary:
            temporary.write_bytes(data)
        return data


def map_document(backdrop: Backdrop, origin: FloatArray, north: FloatArray, east: FloatArray) -> dict[str, Any]:
    """Map of the area of a track for the script of the page, in metres about its origin.

    Parameters
    ----------
    backdrop : Backdrop
    origin : ndarray, shape (3,)
        Latitude, longitude [rad], height [m].
    north, east : ndarray, shape (n,)
        Of the track. [m]

    Returns
    -------
    dict
        ``lines`` of role, ``x`` east and ``y`` north [m], None between parts; ``picture`` with its edges [m] and
        ``address`` of its data, or None; ``credit``.

    Raises
    ------
    InputError
        If nothing of the map lies near the track.
    """
    middle_east, middle_north = (0.5 * float(v.min() + v.max()) for v in (east, north))
    half = max(0.6 * max(float(np.ptp(v)) for v in (east, north)), _LEAST_HALF_M)
    window = Window(origin, middle_east, middle_north, half)
    items = backdrop_items(backdrop, window)
    picture = next((_picture(item) for item in items if isinstance(item, Picture)), None)
    lines = [{"role": i.role, "x": _numbers(i.x), "y": _numbers(i.y)} for i in items if isinstance(i, Line)]
    return {"lines": lines, "picture": picture, "credit": backdrop.credit}


def _numbers(values: FloatArray) -> list[float | None]:
    return [None if v != v else round(v, 1) for v in np.asarray(values, dtype=np.float64).tolist()]


def _picture(item: Picture) -> dict[str, Any]:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(item.pixels).save(out, "png")
    data = base64.b64encode(out.getvalue()).decode("ascii")
    edges = {"left": item.left, "right": item.right, "bottom": item.bottom, "top": item.top}
    return {**edges, "address": f"data:image/png;base64,{data}"}
