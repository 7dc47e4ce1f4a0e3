"""A run of ``schuler navigate`` made again from what its folder keeps, and whether its numbers are the same."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from schuler.arguments import explains_arguments
from schuler.diagnosis.admission import checked
from schuler.exceptions import FileFormatError, InputError
from schuler.files import json_text, note_input, read_toml, sha256
from schuler.filtering.engine import Progress
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.evaluated import EvaluatedRun, evaluate_run
from schuler.navigation.run import navigate
from schuler.plotting.notebook import Abridged, Displayed
from schuler.recording.io.dispatch import read
from schuler.recording.part import cut
from schuler.recording.recording import Recording

FORMAT = "schuler/run/1"
_TIMES = ("elapsed_s",)
_LISTED = 20  # numbers that differ in a summary


@dataclass(frozen=True, repr=False)
class RunFolder(Abridged):
    """What a folder of ``schuler navigate`` keeps of its run.

    Attributes
    ----------
    folder : Path
    log : Path
        File or folder that was read, where it was then.
    sources : dict of str to str
        SHA-256 of the files that were read, by name.
    part : (float or None, float or None)
        Seconds from the start of the log that were used.
    unchecked : bool
        Errors that the checks of units, axes, signs and clocks found were passed over.
    config : NavigationConfig
        With all options of the command line.
    metrics : str
        ``metrics.json``, the numbers of the run without times.
    version : str
        Of schuler.
    """

    folder: Path
    log: Path
    sources: dict[str, str]
    part: tuple[float | None, float | None]
    unchecked: bool
    config: NavigationConfig
    metrics: str
    version: str

    @property
    def configuration(self) -> Path:
        """File of the resolved configuration, whose section ``[recording]`` says how the log was read."""
        return self.folder / "resolved.toml"


def read_run_folder(folder: Path | str) -> RunFolder:
    """Read what a folder of ``schuler navigate`` keeps of its run.

    Raises
    ------
    InputError
        If the folder has no ``run.json``.
    FileFormatError
        If a file of it is damaged or missing.
    """
    folder = Path(folder)
    entries = _document(folder / "run.json")
    return RunFolder(
        folder, Path(entries["log"]), entries["sources"], tuple(entries["part"]), entries["unchecked"],
        NavigationConfig.parse(entries["config"], str(folder / "run.json")),
        _numbers_text(folder / "metrics.json"), entries["schuler"],
    )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Repetition(Displayed):
    """A run made again, beside the numbers that it had then.

    Attributes
    ----------
    before : RunFolder
    recording : Recording
        The log as it was navigated now, cut and checked.
    run : EvaluatedRun
    """

    before: RunFolder
    recording: Recording
    run: EvaluatedRun

    @property
    def config(self) -> NavigationConfig:
        """Configuration of both runs."""
        return self.before.config

    @cached_property
    def metrics(self) -> str:
        """The numbers of now as the text of ``metrics.json``."""
        return metrics_text(self.run.numbers)

    @property
    def same(self) -> bool:
        """Whether the numbers are the same to the last digit."""
        return self.metrics == self.before.metrics

    @cached_property
    def differing(self) -> dict[str, tuple[Any, Any]]:
        """Numbers that are not the same, then and now, by their path in ``metrics.json``."""
        return _differing(json.loads(self.before.metrics), json.loads(self.metrics))

    @property
    def versions(self) -> tuple[str, str]:
        """Version of schuler then and now."""
        return self.before.version, version("schuler")

    @cached_property
    def changed_inputs(self) -> list[str]:
        """Files that are others than then, in words."""
        return _changed(self.before.sources, input_checksums(self.recording, self.config))

    @property
    def notes(self) -> list[str]:
        """Why numbers may differ: other inputs, another version."""
        notes = [f"input differs: {text}" for text in self.changed_inputs]
        then, now = self.versions
        return notes if then == now else [*notes, f"made by schuler {then}, this is {now}"]

    def summary(self) -> str:
        """Whether the numbers are the same, and the first of those that are not."""
        if self.same:
            return f"{self.before.folder}: the same numbers to the last digit"
        rows = [f"  {name}: {old} then, {new} now" for name, (old, new) in list(self.differing.items())[:_LISTED]]
        return "\n".join((f"{self.before.folder}: {len(self.differing)} numbers differ", *rows))


@explains_arguments
def rerun(
    folder: Path | str, recording: Recording | Path | str | None = None, *, progress: Progress | None = None
) -> Repetition:
    """Navigate again what a folder of ``schuler navigate`` was made from, and compare the numbers.

    Nothing is written.

    Parameters
    ----------
    folder : Path or str
        With ``run.json``, ``metrics.json`` and ``resolved.toml``.
    recording : Recording, Path or str, optional
        The log, complete; or where it is now. Default: where the run read it.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Repetition

    Raises
    ------
    InputError
        If the folder is none of a run, or the log is no longer there.
    FileFormatError
        If a file of the folder or the log cannot be read.

    Examples
    --------
    >>> again = schuler.rerun("town-solution")
    >>> again.same, again.differing
    (True, {})
    """
    before = read_run_folder(folder)
    if not isinstance(recording, Recording):
        path = before.log if recording is None else Path(recording)
        if not path.exists():
            raise InputError(f"{path}: expected the log of the run, got no such file; say where it is now")
        recording = read(path, **read_toml(before.configuration).get("recording", {}))
    config = before.config
    recording = checked(
        cut(recording, *before.part), unchecked=before.unchecked, clock_shift_s=config.imu.clock_shift_s
    )
    result = navigate(recording, config, progress=progress)
    return Repetition(before, recording, evaluate_run(recording, result, config.filter.smooth))


def metrics_text(numbers: Mapping[str, Any]) -> str:
    """Numbers of a run as JSON text, without what differs from run to run: the same run gives the same text."""
    return json_text({k: v for k, v in numbers.items() if k not in _TIMES}) + "\n"


def _document(path: Path) -> dict[str, Any]:
    """Entries of a run's file."""
    for file in (path, path.parent / "metrics.json"):
        note_input(file)
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path.parent}: expected a folder of schuler navigate with run.json, got none; give its --out"
        ) from None
    except (ValueError, OSError, RecursionError) as error:
        raise FileFormatError(f"expected the JSON that schuler navigate wrote ({error})", path) from None
    needed = ("schuler", "log", "sources", "part", "unchecked", "config")
    if not isinstance(data, dict) or data.get("format") != FORMAT or any(key not in data for key in needed):
        raise FileFormatError(f"expected a run of format {FORMAT}, got {str(data)[:60]!r}", path)
    if not (path.parent / "metrics.json").is_file():
        raise FileFormatError("expected metrics.json beside it, got none", path)
    kinds = {"log": str, "sources": dict, "part": list, "unchecked": bool, "config": dict}
    if wrong := [key for key, kind in kinds.items() if not isinstance(data[key], kind)]:
        raise FileFormatError(f"is damaged: {', '.join(wrong)} cannot be what a run has; navigate again", path)
    return data


def _numbers_text(path: Path) -> str:
    """Text of ``metrics.json``, if it is JSON."""
    try:
        text = path.read_text(encoding="utf-8")
        json.loads(text)
    except (ValueError, OSError, RecursionError) as error:
        raise FileFormatError(f"expected the JSON that schuler navigate wrote ({error})", path) from None
    return text


def input_checksums(recording: Recording, config: NavigationConfig) -> dict[str, str]:
    """SHA-256 of the files that a run is made from, by name: of the log, a calibration, and a base station."""
    named = (config.imu.calibration, config.gnss.tight.base.observations)
    files = [Path(file) for file in named if file is not None]
    return {**recording.metadata.sources, **{file.name: sha256(file) for file in files if file.is_file()}}


def _changed(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Files that are others than then, in words."""
    words = []
    for name in dict.fromkeys((*then, *now)):
        if then.get(name) != now.get(name):
            why = "is new" if name not in then else "is no longer read" if name not in now else "has other contents"
            words.append(f"{name} {why}")
    return words


def _differing(then: Any, now: Any, name: str = "") -> dict[str, tuple[Any, Any]]:
    """Entries of two documents that are not the same, by their path."""
    if isinstance(then, dict) and isinstance(now, dict):
        keys = dict.fromkeys((*then, *now))
        return {
            k: v
            for key in keys
            for k, v in _differing(then.get(key), now.get(key), f"{name}.{key}" if name else key).items()
        }
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = enumerate(zip(then, now, strict=True))
        return {k: v for i, (a, b) in pairs for k, v in _differing(a, b, f"{name}[{i}]").items()}
    return {} if then == now else {name: (then, now)}
