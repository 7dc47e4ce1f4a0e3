"""Registry of other programs' formats: the one list that readers, writers and ``schuler info`` go through.

To add a format, write ``formats/<name>.py`` and append one line to :data:`FORMATS` (and one to :data:`WRITERS` if it
writes). The module is imported whenever any file is read, so it imports nothing but NumPy and this package at its top;
foreign libraries are imported inside functions, and :func:`needs` makes the error that names the extra. It holds

``sniff(head: bytes, path: Path) -> bool``
    Whether a file is of this format, from its first 64 KiB (all of a smaller file) and, if it must, its name. Cheap,
    certain (a table of plain numbers is nobody's: the hint ``format`` names such formats), raises nothing.
``read(path: Path, hints: ReadHints) -> Recording``
    Raises errors of ours only. :func:`schuler.recording.io.parts.assemble` makes a recording of SI columns with
    all the checks; :func:`schuler.recording.io.parts.check_hints` refuses hints without meaning here.
``sniff_folder(path: Path) -> bool``, optional
    The same for a format that is a folder; ``read`` then gets the folder.
``contents(path: Path) -> list[Stream]``, optional
    Streams of a log that has many (:mod:`schuler.recording.io.streams`), for ``schuler info``.
``holds(path: Path) -> tuple[str, ...]``, optional
    Series that a file holds by its looks, so that it is found in a folder of logs; without it such files are named.
``write(recording: Recording, path: Path, **options) -> list[Path]``, for :data:`WRITERS`
    Writes to a temporary name (:func:`schuler.files.replacing`) and returns the files written.

The first format of the list that claims a file gets it, before the formats of ``recording.io`` are looked at; a text
file with the hint ``columns`` is always read as a table of columns instead.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

from schuler.exceptions import InputError, MissingExtraError, missing_extra
from schuler.recording.io.columns import check_known
from schuler.recording.io.hint_texts import SATELLITES, SERIES

#: Module, and the extra whose library it needs (None: none). Earlier ones are asked first.
FORMATS: tuple[tuple[str, str | None], ...] = (
    ("mcap", "ros"),
    ("rosbag", "ros"),
    ("px4", "px4"),
    ("ardupilot", None),
    ("novatel", None),
    ("sbf", None),
    ("phyphox", None),
    ("vectornav", None),
    ("xsens", None),
    ("sbg", None),
    ("euroc", None),
    ("kitti", None),
    ("kf_gins", None),
    ("sbet", None),
    ("netcdf", "hdf5"),
    ("tum", None),
    ("solution", "data"),
    ("navego", None),
    ("psins", None),
    ("gnss_ins_sim", None),
    ("comma2k19", None),
    ("imr", None),
    ("waypoint", None),
    ("android", None),
    ("sensor_logger", None),
    ("gpx", None),
    ("kml", None),
    ("oan", None),
)

#: Module, suffixes that name the format of a file to be written (none: only ``format=`` does), parts of a recording it
#: holds (one of them is enough to write).
WRITERS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("mcap", (".mcap",), ("imu", "gnss", "reference", "odometer")),
    ("rosbag", (".rosbag2",), ("imu", "gnss", "reference", "odometer")),
    ("euroc", (), ("imu", "reference")),
    ("kitti", (), ("reference", "gnss", "imu")),
    ("kf_gins", (), ("imu", "gnss", "reference")),
    ("sbet", (".sbet", ".out"), ("reference",)),
    ("netcdf", (".nc", ".nc4"), (*SERIES, *SATELLITES)),
    ("tum", (".tum",), ("reference", "gnss")),
    ("gpx", (".gpx",), ("reference", "gnss")),
    ("imr", (".imr",), ("imu",)),
)


def module(name: str) -> ModuleType:
    """The module of a format; an :class:`InputError` that lists the known ones if there is none of this name."""
    check_known(name, [choice for choice, _ in FORMATS], "format")
    return importlib.import_module(f"schuler.recording.formats.{name}")


def find(head: bytes, path: Path) -> ModuleType | None:
    """The format that claims a file by its first bytes, ``None`` if none does."""
    for name, _ in FORMATS:
        candidate = module(name)
        if candidate.sniff(head, path):
            return candidate
    return None


def find_folder(path: Path) -> ModuleType | None:
    """The format that claims a folder as a whole, ``None`` if none does."""
    for name, _ in FORMATS:
        looks = getattr(module(name), "sniff_folder", None)
        if looks is not None and looks(path):
            return module(name)
    return None


def held_by(head: bytes, path: Path) -> tuple[str, ...] | None:
    """Series that a file of one of these formats holds by its looks; ``None`` if it is of none of them."""
    reader = find(head, path)
    if reader is None:
        return None
    held = getattr(reader, "holds", None)
    return () if held is None else tuple(held(path))


def find_writer(path: Path, name: str | None = None) -> tuple[ModuleType, tuple[str, ...]] | None:
    """Module that writes a file and the parts of a recording it holds, by the name of the format or by the suffix.

    Raises
    ------
    InputError
        If a format of this name is not known or not written.
    """
    if name is not None:
        check_known(name, [choice for choice, _, _ in WRITERS], "format to write")
    for choice, suffixes, parts in WRITERS:
        if choice == name or (name is None and path.suffix.lower() in suffixes):
            return importlib.import_module(f"schuler.recording.formats.{choice}"), parts
    return None


def suffixes() -> list[str]:
    """Suffixes of the files that are written, in order."""
    return [suffix for _, suffixes, _ in WRITERS for suffix in suffixes]


def check_installed(library: str, name: str, purpose: str) -> None:
    """Raise the error of :func:`needs` if a library is missing, without loading it: it is another process that will."""
    error = needs(library, name, purpose)
    if missing_extra(library, "", purpose) is not None:
        raise error


def needs(library: str, name: str, purpose: str) -> MissingExtraError:
    """Error for a library that is not installed, naming the extra of the format.

    Parameters
    ----------
    library : str
        Its import name.
    name : str
        The format's module.
    purpose : str
        Task in words, ``"reading ROS bags"``.
    """
    extras: dict[str, Any] = dict(FORMATS)
    if extras.get(name) is None:
        raise InputError(f"the format {name} names no extra in the registry, but needs {library}")
    return MissingExtraError(library, extras[name], purpose)
