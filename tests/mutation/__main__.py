"""Break the code on purpose and see the tests fail: ``python -m tests.mutation`` (docs/project/mutation.md).

--modules A,B   of these modules (default: all of tests/mutation/modules.py)
--most N        at most N mutants a module, drawn at random (default: all)
--seed S        of the draw (default 21); a larger N adds to the same draw
--again FILE    only what survived in FILE, which --out wrote: new tests kill nothing less
--count         mutants of each module and the time of its tests, nothing more
--out FILE      every mutant and what became of it, as JSON
"""

import json
import os
import sys
import time
from pathlib import Path

from tests.mutation import mutants, trial
from tests.mutation.modules import MODULES


def main(words: list[str]) -> int:
    """The command; 1 if a mutant survived that is not listed as equivalent."""
    count = "--count" in words
    words = [word for word in words if word != "--count"]
    given = dict(zip(words[::2], words[1::2], strict=False))
    if set(given) - {"--modules", "--most", "--seed", "--out", "--again"} or len(words) % 2:
        print(__doc__)
        return 2
    names = given["--modules"].split(",") if "--modules" in given else list(MODULES)
    trial.prepare()
    again = None
    if "--again" in given:
        before = json.loads(Path(given["--again"]).read_text())
        again = {(result["module"], result["diff"]) for result in before if result["outcome"] == "survived"}
    rows, results = [], []
    for name in names:
        drawn, total = mutants.draw(name, int(given.get("--most", 10**9)), int(given.get("--seed", 21)))
        if again is not None:
            drawn = [mutant for mutant in drawn if (name, mutant.diff) in again]
        seconds = trial.unchanged(MODULES[name])
        print(f"{name}: {len(drawn)} of {total} mutants, tests take {seconds:.1f} s", flush=True)
        if count:
            continue
        counts = dict.fromkeys(("killed", "timed out", "equivalent", "survived"), 0)
        start = time.monotonic()
        for mutant in drawn:
            outcome = trial.outcome(mutant, MODULES[name], 5.0 * seconds + 5.0)
            if outcome == "survived" and mutant.equivalence:
                outcome = "equivalent"
            counts[outcome] += 1
            results.append({"module": name, "outcome": outcome, "diff": mutant.diff})
            if outcome in ("survived", "timed out"):
                print(f"-- {outcome}\n{mutant.diff}", flush=True)
        rows.append((name, total, len(drawn), *counts.values(), time.monotonic() - start))
        if "--out" in given:
            Path(given["--out"]).write_text(json.dumps(results, indent=1))
    if rows:
        print(_table(rows))
    return 1 if any(result["outcome"] == "survived" for result in results) else 0


def _table(rows: list[tuple]) -> str:
    lines = [
        "| Module | Mutants | Tried | Killed | Timed out | Equivalent | Survived | Killed of what can be | s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    numbers = [sum(column) for column in list(zip(*rows, strict=True))[1:]]
    for name, total, tried, killed, late, equal, survived, seconds in [*rows, ("all", *numbers)]:
        share = (killed + late) / max(tried - equal, 1)
        lines.append(
            f"| {name} | {total} | {tried} | {killed} | {late} | {equal} | {survived} | {share:.1%} | {seconds:.0f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    os.chdir(Path(__file__).parents[2])
    sys.exit(main(sys.argv[1:]))
