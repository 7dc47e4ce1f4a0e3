"""``schuler reproduce``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from schuler.cli.output import File, Flag, print_json, progress, say


def reproduce(
    thesis: Literal["yaman", "du", "hayal", "flenniken", "stefanisko", "all"],
    /,
    *items: str,
    full: Annotated[bool, Parameter(negative="--quick")] = False,
    seed: int = 1,
    out: File = None,
    json: Flag = False,
) -> None:
    """Tables and figures of a thesis: printed number, ours, verdict, and the reason where they differ.

    Parameters
    ----------
    thesis
        By its author, or all.
    items
        Ids such as table-5.3; all by default.
    full
        As many runs as the thesis, which takes hours for all five. --quick, the default: a minute each at most.
    seed
        Of random numbers.
    out
        One HTML book of all that was reproduced, with figures. Default: reproduction.html with --full, none without.
    json
        Print one JSON object instead of text.
    """
    from schuler.exceptions import InputError
    from schuler.reproduce import THESES
    from schuler.reproduce import reproduce as run

    if thesis == "all" and items:
        raise InputError(f"reproduce all: items are of one thesis; name it instead of all, got {', '.join(items)}")
    began = time.perf_counter()
    done = []
    for name in THESES if thesis == "all" else (thesis,):
        with progress(f"reproducing {name}") as bar:
            done.append(run(name, items, quick=not full, seed=seed, progress=bar))
        if not json:
            print(done[-1].summary(), end="\n\n")
        if not done[-1].complete:
            break
    files = {}
    if full and out is None:
        out = Path("reproduction.html")
    if out is not None:
        from schuler.reproduce.book import write_book

        files["book"] = write_book(done, out)
        say(f"book: {files['book']}")
    if json:
        theses = [one.to_dict() for one in done]
        print_json(
            {
                "command": "reproduce", "items": [i for one in theses for i in one["items"]], "theses": theses,
                "elapsed_s": time.perf_counter() - began, "files": files,
            }
        )  # fmt: skip
    if not done[-1].complete:
        raise KeyboardInterrupt
