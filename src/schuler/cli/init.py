"""``schuler init``: the configuration that a log proposes, as a file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from schuler.cli.configuration import entries
from schuler.cli.output import File, Flag, Texts, print_json, writable
from schuler.cli.proposal import proposed
from schuler.cli.reading import Part
from schuler.exceptions import InputError
from schuler.files import write_text

_ALL = Part()


def init(
    *logs: Path,
    imu: str | None = None,
    out: File = None,
    set: Texts = (),
    trials: bool = True,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Write the configuration that a log proposes, each entry with its evidence, without navigating.

    Parameters
    ----------
    logs
        A folder, a file, the files of one run, or its folder and files that lie elsewhere.
    imu
        The IMU by its name in the catalogue, or a file of schuler allan.
    out
        The file, default drive.toml in the working folder.
    set
        Any entry that is known: SECTION.KEY=VALUE in TOML's spelling, such as recording.imu.axes=FLU; may be given
        several times.
    trials
        Decide clock, lever arm and aids by trial runs of the filter; otherwise they keep their defaults.
    json
        Print one JSON object instead of text.
    """
    if not logs:
        raise InputError("init: expected a file or folder, got none")
    target = Path("drive.toml") if out is None else out
    writable(target.parent)
    proposal = proposed(logs, imu, entries(set), trials=trials, part=part)
    write_text(target, proposal.toml())
    if json:
        print_json({"command": "init", "decisions": [asdict(d) for d in proposal.decisions], "file": target})
    else:
        print(f"configuration: {target}")
    return 0
