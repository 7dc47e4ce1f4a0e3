"""``schuler fetch``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from schuler.cli.output import Flag, Folder, print_json, say
from schuler.recording import public
from schuler.recording.io.columns import check_known


def fetch(name: str | None = None, /, *, out: Folder = None, json: Flag = False) -> None:
    """List public recordings with their licences, or fetch one; needs pooch (schuler[fetch]) and a network.

    Parameters
    ----------
    name
        Recording to fetch; without one they are listed and nothing is fetched.
    out
        Folder for its files. Default: its name, in the working folder.
    json
        Print one JSON object instead of text.
    """
    chosen = (
        public.RECORDINGS
        if name is None
        else {name: public.RECORDINGS[check_known(name, public.RECORDINGS, "recording")]}
    )
    data: dict[str, Any] = {"command": "fetch", "recordings": {key: _described(r) for key, r in chosen.items()}}
    if name is not None:
        if not json:
            say(text(name, chosen[name]))
        folder = public.fetch(name, out)
        data["files"] = {Path(file.path).name: folder / Path(file.path).name for file in chosen[name].files}
    if json:
        print_json(data)
    elif name is None:
        print("\n\n".join(text(key, r) for key, r in chosen.items()))
    else:
        print("\n".join(str(path) for path in data["files"].values()))


def _described(r: public.PublicRecording) -> dict[str, Any]:
    return {
        "what": r.what, "repository": f"https://github.com/{r.repository}", "licence": r.licence, "bytes": r.size,
        "example": r.example, "files": {f.path: {"commit": f.commit, "sha256": f.sha256} for f in r.files},
    }  # fmt: skip


def text(name: str, r: public.PublicRecording) -> str:
    """What a recording is, whose, under which licence, and a command to begin with."""
    return (
        f"{name}: {r.what}\n  https://github.com/{r.repository}, licence {r.licence}, {r.size / 1e6:.1f} MB in "
        f"{len(r.files)} files\n  then: {r.example}"
    )
