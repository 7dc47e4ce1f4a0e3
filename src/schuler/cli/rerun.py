"""``schuler rerun``, and what a run folder keeps for it: resolved configuration, numbers, log."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.cli.output import Flag, Folder, print_json, progress, say, tabled, writable
from schuler.exceptions import InputError
from schuler.files import json_text, write_text

if TYPE_CHECKING:
    from schuler.cli.reading import Part
    from schuler.navigation.config import NavigationConfig
    from schuler.recording.recording import Recording


def rerun(
    folder: Path, /, *, log: Path | None = None, out: Folder = None, report: bool = False, json: Flag = False
) -> int:
    """Navigate again what a run folder was made from, and say whether the numbers are the same.

    Exit code 1 where they differ. Other input files or another version than then are said.

    Parameters
    ----------
    folder
        Folder that schuler navigate wrote.
    log
        Log, where it is no longer in its place.
    out
        Folder for the new run. Default: the folder's name with -rerun.
    report
        Write report.html too.
    json
        Print one JSON object instead of text.
    """
    from schuler.cli.navigate import write_outputs
    from schuler.cli.reading import Part, read_log
    from schuler.navigation.repetition import read_run_folder
    from schuler.navigation.repetition import rerun as repeat

    run, tables = read_run_folder(folder), tabled()
    path = run.log if log is None else log
    if not path.exists():
        raise InputError(f"{path}: expected the log of the run, got no such file; say where it is with --log")
    place = writable(folder.resolve().parent / f"{folder.resolve().name}-rerun") if out is None else out
    with progress("navigating") as bar:
        again = repeat(folder, read_log(path, run.configuration), progress=bar)
    files = write_outputs(place, again.recording, again.run, report=report, figures=False, tables=tables)
    files |= write_run(
        place, path, again.recording, again.config, again.run.numbers, part=Part(*run.part), unchecked=run.unchecked
    )
    if json:
        print_json(
            {
                "command": "rerun", "same": again.same, "differing": again.differing, "versions": again.versions,
                "changed_inputs": again.changed_inputs, "files": files,
            }
        )  # fmt: skip
        return 0 if again.same else 1
    for note in again.notes:
        say(note)
    print(again.summary())
    print("\n".join(f"{name}: {where}" for name, where in files.items()))
    return 0 if again.same else 1


def write_run(
    folder: Path,
    log: Path,
    recording: Recording,
    config: NavigationConfig,
    numbers: Mapping[str, Any],
    *,
    part: Part,
    unchecked: bool,
    text: str = "",
) -> dict[str, Path]:
    """Write what :func:`rerun` needs and people look for first; paths by name.

    ``metrics.json`` has the numbers without times, ``resolved.toml`` every entry of the configuration that was used,
    ``run.json`` the same with the log, its checksums and the version, and ``run.log`` what was printed.
    """
    from schuler.navigation.repetition import FORMAT, input_checksums, metrics_text
    from schuler.proposal.toml import toml_of

    entries = config.model_dump(mode="json", exclude_unset=True)
    head = f"# Configuration of this run, options of the command line included; schuler rerun {folder} repeats it.\n"
    document = {
        "format": FORMAT, "schuler": version("schuler"), "log": str(log.resolve()),
        "sources": input_checksums(recording, config), "part": [part.start, part.stop], "unchecked": unchecked,
        "config": entries,
    }  # fmt: skip
    files = {
        "resolved": write_text(folder / "resolved.toml", head + toml_of(_stated(entries), {})),
        "metrics": write_text(folder / "metrics.json", metrics_text(numbers)),
        "run": write_text(folder / "run.json", json_text(document) + "\n"),
    }
    if text:
        files["log"] = write_text(folder / "run.log", text.rstrip("\n") + "\n")
    return files


def _stated(value: Any) -> Any:
    """Entries that have a value; TOML has no null."""
    if isinstance(value, dict):
        return {k: _stated(v) for k, v in value.items() if v is not None}
    return value
