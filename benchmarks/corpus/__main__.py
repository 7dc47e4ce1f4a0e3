"""Command line of the corpus: ``python -m benchmarks.corpus``."""

from __future__ import annotations

import argparse
import fnmatch
import json
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from . import peers
from .case import DATA, ROOT, Case, row_of
from .cases import CASES
from .navigation import prepared
from .page import page_of, table_of

PAGE = ROOT / "docs" / "corpus.md"


def chosen(pattern: str | None, cases: list[Case]) -> list[Case]:
    """Cases whose name has the pattern in it, or fits it (``*``)."""
    if pattern is None:
        return cases
    return [c for c in cases if pattern in c.name or pattern == c.kind or fnmatch.fnmatch(c.name, pattern)]


def run_all(cases: list[Case], jobs: int = 2, say: Any = None) -> list[dict[str, Any]]:
    """Rows of the cases by name, run in processes of their own."""
    rows: list[dict[str, Any]] = []
    if jobs == 1:
        for case in cases:
            rows.append(row_of(case))
            if say is not None:
                say(rows[-1])
        return sorted(rows, key=lambda row: row["name"])
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        for done in as_completed([pool.submit(row_of, case) for case in cases]):
            rows.append(done.result())
            if say is not None:
                say(rows[-1])
    return sorted(rows, key=lambda row: row["name"])


def run_peers(cases: list[Case]) -> int:
    """Run the peer on all cases that it can do, and keep what comes out; 1 if it is not installed."""
    name = peers.version()
    if name is None:
        print(f"{peers.PYTHON} has no python-ins: pip install python-ins, or name a Python that has it in "
              "SCHULER_PEER_PYTHON", file=sys.stderr)  # fmt: skip
        return 1
    results: dict[str, Any] = {}
    for case in cases:
        if case.kind != "navigation" or any(x in case.question for x in ("tight", "wheels")):
            continue
        try:
            asked = case.run.keywords  # type: ignore[attr-defined]
            results[case.name] = {"peer": f"python-ins {name}", **peers.run(*prepared(DATA, **asked))}
        except Exception as error:  # the reason is kept beside the others' errors
            results[case.name] = {"failed": f"{type(error).__name__}: {error}"}
        print(case.name, results[case.name], flush=True)
    together = {**peers.kept(), **results}
    peers.KEPT.write_text(json.dumps(dict(sorted(together.items())), indent=1) + "\n", encoding="utf-8")
    return 0


def main(argv: list[str] | None = None) -> int:
    """Run, print, write; 0 unless nothing was asked for."""
    parser = argparse.ArgumentParser("python -m benchmarks.corpus", description=__doc__)
    parser.add_argument("--only", help="part of a name, a kind, or a pattern with *")
    parser.add_argument("--json", action="store_true", help="print rows as JSON instead of the table")
    parser.add_argument("--before", type=Path, help="JSON of an earlier run, printed beside this one")
    parser.add_argument("--out", type=Path, help="also write the JSON here")
    parser.add_argument("--peers", action="store_true", help="run python-ins on the cases instead, and keep its errors")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    options = parser.parse_args(argv)
    cases = chosen(options.only, CASES)
    if not cases:
        print(f"no case is called {options.only!r}; there are " + ", ".join(c.name for c in CASES), file=sys.stderr)
        return 2
    if options.peers:
        return run_peers(cases)
    before = None if options.before is None else json.loads(options.before.read_text(encoding="utf-8"))["rows"]
    began = time.perf_counter()
    rows = run_all(cases, options.jobs, lambda row: print(".", end="", flush=True, file=sys.stderr))
    rows = [peers.beside(row) if row["kind"] == "navigation" else row for row in rows]
    elapsed = time.perf_counter() - began
    print(f" {elapsed:.0f} s", file=sys.stderr)
    text = json.dumps({"elapsed_s": elapsed, "rows": rows}, indent=1)
    if options.out is not None:
        options.out.write_text(text + "\n", encoding="utf-8")
    print(text if options.json else table_of(rows, before))
    if options.only is None and any("skipped" not in row for row in rows):
        page_of(PAGE, rows, elapsed, options.jobs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
