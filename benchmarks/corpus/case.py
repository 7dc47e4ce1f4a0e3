"""One case of the corpus, and the row that its run becomes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCHULER_DATA", ROOT.parent / "shared" / "data"))

#: Columns of a row; what a case does not have is None.
COLUMNS = (
    "error", "smoothed", "outage", "outage_smoothed", "aided", "claimed", "nees", "nees_band", "nis", "inside",
    "rejected", "warnings", "verdict", "exit", "peer", "peer_error", "ratio",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A recording and what is asked of it.

    Attributes
    ----------
    recording : str
        Sorted names of a kind alternate between the half that defaults are chosen on and the one they are reported on.
    kind : str
        "navigation", "foot", "calibration", "noise" or "points".
    needs : tuple of str
        Files or folders below the recordings that it is made of.
    unit : str
        Of its errors.
    run : callable
        Takes the folder of the recordings, gives numbers by column.
    question : str
        What is asked of the recording, where there are several questions.
    """

    recording: str
    kind: str
    needs: tuple[str, ...]
    unit: str
    run: Callable[[Path], dict[str, Any]]
    question: str = ""

    @property
    def name(self) -> str:
        """``recording/question``."""
        return f"{self.recording}/{self.question}" if self.question else self.recording


class Skipped(Exception):
    """A case that cannot be run here; the message is the reason."""


def row_of(case: Case, data: Path = DATA) -> dict[str, Any]:
    """Run a case. Whatever it raises is its row."""
    row: dict[str, Any] = {"name": case.name, "kind": case.kind, "unit": case.unit, **dict.fromkeys(COLUMNS)}
    absent = [name for name in case.needs if not (data / name).exists()]
    if absent:
        return row | {"skipped": f"{data / absent[0]} is absent"}
    began = time.perf_counter()
    try:
        row |= {"exit": 0, **case.run(data)}
    except Skipped as reason:
        row |= {"skipped": str(reason)}
    except Exception as error:
        row |= {"exit": 1, "sentence": f"{type(error).__name__}: {error}"}
    return row | {"elapsed_s": time.perf_counter() - began}


def halves(cases: Sequence[Case]) -> dict[str, str]:
    """Half of each case by name: "choosing" for the 1st, 3rd, ... recording of a kind, "reporting" for the others.

    All questions to a recording are in one half: its noise is the same in all of them.
    """
    half = {}
    for kind in {case.kind for case in cases}:
        recordings = sorted({case.recording for case in cases if case.kind == kind})
        for case in cases:
            if case.kind == kind:
                half[case.name] = ("choosing", "reporting")[recordings.index(case.recording) % 2]
    return half
