"""``schuler rerun``, and what a run folder keeps for it: resolved configuration, numbers, log."""

from __future__ import annotations

import json as documents
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.cli.output import Flag, Folder, json_text, print_json, progress, say
from schuler.exceptions import FileFormatError, InputError
from schuler.files import write_text

if TYPE_CHECKING:
    from schuler.cli.reading import Part
    from schuler.navigation.config import NavigationConfig
    from schuler.recording.recording import Recording

FORMAT = "schuler/run/1"
_TIMES = ("elapsed_s",)


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
    from schuler.cli.navigate import evaluated, write_outputs
    from schuler.cli.reading import Part, read_log
    from schuler.diagnosis.admission import checked
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.run import navigate

    entries = _document(folder / "run.json")
    before = (folder / "metrics.json").read_text(encoding="utf-8")
    config = NavigationConfig.parse(entries["config"], str(folder / "run.json"))
    path = Path(entries["log"]) if log is None else log
    if not path.exists():
        raise InputError(f"{path}: expected the log of the run, got no such file; say where it is with --log")
    part = Part(*entries["part"])
    recording = part.of(read_log(path, folder / "resolved.toml"))
    recording = checked(recording, unchecked=entries["unchecked"], clock_shift_s=config.imu.clock_shift_s)
    with progress("navigating") as bar:
        result = navigate(recording, config, progress=bar)
    outcome = evaluated(recording, result, config.filter.smooth)
    place = folder.resolve().parent / f"{folder.resolve().name}-rerun" if out is None else out
    files = write_outputs(place, recording, outcome, report=report, figures=False)
    files |= write_run(place, path, recording, config, outcome.numbers, part=part, unchecked=entries["unchecked"])
    changed_inputs = _changed(entries["sources"], recording.metadata.sources)
    versions = [entries["schuler"], version("schuler")]
    after = metrics_text(outcome.numbers)
    differing = _differing(documents.loads(before), documents.loads(after))
    notes = [f"input differs: {text}" for text in changed_inputs]
    if versions[0] != versions[1]:
        notes.append(f"made by schuler {versions[0]}, this is {versions[1]}")
    same = before == after
    if json:
        print_json(
            {
                "command": "rerun", "same": same, "differing": differing, "versions": versions,
                "changed_inputs": changed_inputs, "files": files,
            }
        )  # fmt: skip
        return 0 if same else 1
    for note in notes:
        say(note)
    if same:
        print(f"{folder}: the same numbers to the last digit")
    else:
        print(f"{folder}: {len(differing)} numbers differ")
        for name, (old, new) in list(differing.items())[:20]:
            print(f"  {name}: {old} then, {new} now")
    print("\n".join(f"{name}: {where}" for name, where in files.items()))
    return 0 if same else 1


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
    from schuler.proposal.toml import toml_of

    entries = config.model_dump(mode="json", exclude_unset=True)
    head = f"# Configuration of this run, options of the command line included; schuler rerun {folder} repeats it.\n"
    document = {
        "format": FORMAT, "schuler": version("schuler"), "log": str(log.resolve()),
        "sources": dict(recording.metadata.sources), "part": [part.start, part.stop], "unchecked": unchecked,
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


def metrics_text(numbers: Mapping[str, Any]) -> str:
    """Numbers of a run as JSON text, without what differs from run to run: the same run gives the same text."""
    return json_text({k: v for k, v in numbers.items() if k not in _TIMES}) + "\n"


def _document(path: Path) -> dict[str, Any]:
    """Entries of a run's file."""
    try:
        data: Any = documents.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path.parent}: expected a folder of schuler navigate with run.json, got none; give its --out"
        ) from None
    except (ValueError, OSError) as error:
        raise FileFormatError(f"expected the JSON that schuler navigate wrote ({error})", path) from None
    needed = ("schuler", "log", "sources", "part", "unchecked", "config")
    if not isinstance(data, dict) or data.get("format") != FORMAT or any(key not in data for key in needed):
        raise FileFormatError(f"expected a run of format {FORMAT}, got {str(data)[:60]!r}", path)
    if not (path.parent / "metrics.json").is_file():
        raise FileFormatError("expected metrics.json beside it, got none", path)
    return data


def _stated(value: Any) -> Any:
    """Entries that have a value; TOML has no null."""
    if isinstance(value, dict):
        return {k: _stated(v) for k, v in value.items() if v is not None}
    return value


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
