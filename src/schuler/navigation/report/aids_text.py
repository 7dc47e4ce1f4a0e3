"""What aided a run: a sentence and a table of what was used, what was not and why."""

from __future__ import annotations

import numpy as np

from schuler.filtering.kinds import shown
from schuler.filtering.measurements import ACCEPTED, FORCED, GATED, REJECTED, STATUS, UNUSED
from schuler.navigation.report.residuals import mean_nis
from schuler.navigation.report.subject import Subject
from schuler.plotting.parts import number


def measurement_rows(subject: Subject) -> list[tuple[str, ...]]:
    """Rows of a table: kind, used, rejected, accepted after lock-out, condition not met, outside the run."""
    return [
        (
            shown(kind).text,
            str(count[STATUS[ACCEPTED]] + count[STATUS[FORCED]]),
            str(count[STATUS[REJECTED]]),
            str(count[STATUS[FORCED]]),
            str(count[STATUS[GATED]]),
            str(count[STATUS[UNUSED]]),
        )
        for kind, count in subject.result.innovations.counts().items()
    ]


def aids(subject: Subject) -> str:
    """What aided, how often, what was not used, and whose innovations have another size than predicted."""
    inn = subject.result.innovations
    told, wrong = [], []
    for kind, count in inn.counts().items():
        used = count[STATUS[ACCEPTED]] + count[STATUS[FORCED]]
        more = [
            f"{n} {why}"
            for n, why in (
                (count[STATUS[REJECTED]], "rejected"), (count[STATUS[GATED]], "without their condition"),
            )
            if n
        ]  # fmt: skip
        if used or more:
            told.append(f"{shown(kind).text} ({', '.join([f'{used} used', *more])})")
            mean, right = mean_nis(inn.of(kind))
            if not right:
                wrong.append(f"{shown(kind).text} ({'too sure' if mean > 1.0 else 'too cautious'}, {number(mean)})")
    if not told:
        return "Nothing aided the INS."
    tested = bool(np.isfinite(inn.nis).any())
    verdict_of_nis = "; NIS is " + (f"off for {_listed(wrong)}" if wrong else "right for each") if tested else ""
    return f"Aids: {', '.join(told)}{verdict_of_nis}."


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
