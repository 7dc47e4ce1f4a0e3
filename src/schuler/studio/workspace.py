"""The folder that the workbench shows: its logs, configurations and runs, and no file outside of it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from schuler.exceptions import InputError, SchulerError
from schuler.files import LISTED, check_log, read_toml, write_text

#: Hidden folder for jobs of worker processes; not named as temporaries are, which the next command removes.
JOBS = ".schuler_studio"
_DEPTH = 3  # of folders that are looked into
_MOST = 2000  # files and folders that are looked at
_NO_LOGS = frozenset((
    ".toml", ".html", ".htm", ".json", ".md", ".rst", ".png", ".svg", ".jpg", ".pdf", ".kml", ".geojson", ".py",
    ".ipynb", ".tag", ".yml", ".yaml", ".m", ".css", ".js", ".zip",
    ".mbtiles", ".tif", ".tiff", ".jpeg", ".pgw", ".jgw", ".wld", ".prj",
))  # fmt: skip
_MAPS = frozenset((".geojson", ".tif", ".tiff", ".mbtiles"))
_WORLDS = {".png": ".pgw", ".jpg": ".jgw"}  # files that say where a picture is
_TEXTS = frozenset({"README", "LICENSE", "LICENCE", "COPYING", "NOTICE"})


@dataclass(frozen=True)
class Workspace:
    """Folder that is shown.

    Attributes
    ----------
    root : Path
        Absolute, without symbolic links.
    """

    root: Path

    def inside(self, name: str) -> Path:
        """Path of a file or folder by its name from the root on.

        Raises
        ------
        InputError
            If it lies outside, also by a symbolic link, or is hidden.
        """
        if "\0" in name or any(part.startswith(".") for part in Path(name).parts):
            raise InputError(f"{name!r}: expected a file of the folder {self.root}, got a hidden one or one outside")
        path = (self.root / name).resolve()
        if not path.is_relative_to(self.root):
            raise InputError(f"{name!r}: expected a file of the folder {self.root}, got one outside of it")
        return path

    def name(self, path: Path) -> str:
        """Name of a path from the root on, with slashes."""
        return path.relative_to(self.root).as_posix()


def workspace_of(paths: tuple[Path, ...]) -> tuple[Workspace, str | None]:
    """Workspace for a folder, or for files of one folder, and the name of the first file.

    Raises
    ------
    InputError
        If one of them is missing, or files lie in several folders.
    """
    for path in paths:
        check_log(path)
    places = {path.resolve() if path.is_dir() else path.resolve().parent for path in paths} or {Path.cwd().resolve()}
    if len(places) > 1:
        raise InputError(f"studio: expected one folder, or files of one, got {', '.join(sorted(map(str, places)))}")
    file = next((path.name for path in paths if path.is_file()), None)
    return Workspace(places.pop()), file


def logs(workspace: Workspace) -> list[str]:
    """Names of what may be a log: files that are no documents, and folders with several; ``.`` is the root itself."""
    names: list[str] = []
    for folder, files in _folders(workspace.root):
        if (folder / "run.json").is_file():
            continue
        own = sorted(f for f in files if Path(f).suffix.lower() not in _NO_LOGS and Path(f).stem.upper() not in _TEXTS)
        if len(own) > 1:
            names.append(workspace.name(folder))  # of the root itself: "."
        names += [workspace.name(folder / f) for f in own]
    return sorted(names)


def configurations(workspace: Workspace) -> list[str]:
    """Names of the TOML files that are not what a run keeps."""
    return sorted(
        workspace.name(folder / f)
        for folder, files in _folders(workspace.root)
        if not (folder / "run.json").is_file()
        for f in files
        if f.endswith(".toml")
    )


def maps(workspace: Workspace) -> list[str]:
    """Names of the files that may be a map: GeoJSON, GeoTIFF, MBTiles, pictures with a world file; none of runs."""
    return sorted(
        workspace.name(folder / f)
        for folder, files in _folders(workspace.root)
        if not (folder / "run.json").is_file()
        for f in files
        if Path(f).suffix.lower() in _MAPS or Path(f).with_suffix(_WORLDS.get(Path(f).suffix, ".none")).name in files
    )


def missions(workspace: Workspace) -> list[str]:
    """Names of the configurations that are missions for budgets: a motion, and nothing that a mission has not."""
    from schuler.budget.scenario import BudgetScenario

    names: list[str] = []
    for name in configurations(workspace):
        with suppress(SchulerError):
            data = read_toml(workspace.inside(name))
            if "motion" in data and data.keys() <= BudgetScenario.model_fields.keys():
                names.append(name)
    return names


def studies(workspace: Workspace) -> dict[str, str]:
    """Configurations of missions that are simulated many times, and the command that does it, by name.

    ``montecarlo`` for campaigns and for drives as ``schuler simulate`` takes them, ``rotary`` for IMUs on a platform.
    """
    from schuler.montecarlo.job import CampaignFile
    from schuler.rotary.search.scenario import RotaryScenario
    from schuler.simulation.scenario import Scenario

    kinds = (
        ("montecarlo", {"simulation"}, CampaignFile), ("rotary", {"motion", "rotary"}, RotaryScenario),
        ("montecarlo", {"motion", "imu"}, Scenario),
    )  # fmt: skip
    named: dict[str, str] = {}
    for name in configurations(workspace):
        with suppress(SchulerError):
            entries = read_toml(workspace.inside(name)).keys()
            for command, needed, model in kinds:
                if needed <= entries <= model.model_fields.keys():
                    named[name] = command
                    break
    return named


def identified_imus(workspace: Workspace) -> list[str]:
    """Names of the budgets of IMUs that ``schuler allan`` wrote, in folders of runs too."""
    return sorted(
        workspace.name(folder / "imu.toml") for folder, files in _folders(workspace.root) if "imu.toml" in files
    )


def write_mission(workspace: Workspace, kind: Literal["mission", "campaign", "rotary"] = "mission") -> str:
    """Write what to start from under a free name, and return the name.

    ``mission`` is a minute without GNSS in a town, for budgets; ``campaign`` an hour of driving, for Monte Carlo;
    ``rotary`` five minutes at rest on a platform that turns.
    """
    name = _free_name(workspace, kind)
    text = (resources.files("schuler.studio") / "assets" / f"{kind}.toml").read_text(encoding="utf-8")
    write_text(workspace.inside(name), text, at_once=True)
    return name


@dataclass(frozen=True)
class RunEntry:
    """A run on disk.

    Attributes
    ----------
    name : str
        Of its folder, from the root on.
    changed : float
        Unix time of its numbers. [s]
    metrics : dict
        Numbers as ``metrics.json`` has them.
    document : dict
        ``run.json``: log, configuration, version.
    files : tuple of str
        Files in the folder.
    """

    name: str
    changed: float
    metrics: dict[str, Any]
    document: dict[str, Any]
    files: tuple[str, ...]

    @property
    def status(self) -> str:
        """Verdict in a word."""
        verdict = self.metrics.get("verdict")
        return str(verdict.get("status", "")) if isinstance(verdict, dict) else ""


def runs(workspace: Workspace) -> list[RunEntry]:
    """Runs of the folder, the latest first; what is damaged is left out."""
    entries = [
        run_entry(workspace, workspace.name(f)) for f, files in _folders(workspace.root) if "metrics.json" in files
    ]
    return sorted((entry for entry in entries if entry is not None), key=lambda entry: -entry.changed)


def run_entry(workspace: Workspace, name: str) -> RunEntry | None:
    """A run by the name of its folder; None if there is none, or it is damaged."""
    folder = workspace.inside(name)
    try:
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        document = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        changed = (folder / "metrics.json").stat().st_mtime
        files = tuple(sorted(f for f in os.listdir(folder) if not f.startswith(".")))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(metrics, dict) or not isinstance(document, dict):
        return None
    return RunEntry(name, changed, metrics, document, files)


def delete_run(workspace: Workspace, name: str) -> None:
    """Remove the folder of a run.

    Raises
    ------
    InputError
        If it is no run, or holds what no command wrote.
    """
    folder = workspace.inside(name)
    if folder == workspace.root or run_entry(workspace, name) is None:
        raise InputError(f"{name}: expected the folder of a run, with run.json and metrics.json")
    try:
        listed = set(json.loads((folder / LISTED).read_text(encoding="utf-8"))["files"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{name}: holds no list of what was written by commands: remove the folder by hand") from None
    present = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir() and p.name != LISTED}
    if others := sorted(present - listed):
        raise InputError(
            f"{name}: holds {', '.join(others[:3])}, which no command wrote: move it, or remove it by hand"
        )
    shutil.rmtree(folder)


def new_run_name(workspace: Workspace, log: str, kind: str = "run") -> str:
    """Name of a folder for the next run of a log: ``drive-run-3``."""
    stem = workspace.inside(log).stem
    taken = {entry.name for entry in workspace.root.iterdir()}
    return next(name for k in range(1, _MOST**2) if (name := f"{stem}-{kind}-{k}") not in taken)


def new_configuration_name(workspace: Workspace) -> str:
    """Name for a configuration that is written: ``drive.toml``, ``drive-2.toml``."""
    return _free_name(workspace, "drive")


def _free_name(workspace: Workspace, stem: str) -> str:
    names = (f"{stem}{'' if k == 1 else f'-{k}'}.toml" for k in range(1, _MOST**2))
    return next(name for name in names if not (workspace.root / name).exists())


def _folders(root: Path) -> Iterator[tuple[Path, list[str]]]:
    """Folders that are not hidden and the files in each, three deep; symbolic links are not followed."""
    seen = 0
    for place, folders, files in os.walk(root):
        depth = len(Path(place).relative_to(root).parts)
        folders[:] = sorted(f for f in folders if not f.startswith(".")) if depth < _DEPTH else []
        seen += len(files) + 1
        yield Path(place), [f for f in files if not f.startswith(".")]
        if seen > _MOST:
            return
