"""Verdict on a result by what it shows itself: ok, doubtful or failed, with evidence and likely causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Status = Literal["ok", "doubtful", "failed"]


@dataclass(frozen=True)
class Verdict:
    """Whether a result can be believed, by its own evidence alone: never by a reference.

    Attributes
    ----------
    status : {"ok", "doubtful", "failed"}
        ``ok``: nothing contradicts the claimed uncertainty. ``doubtful``: errors may exceed it; read the reasons.
        ``failed``: model and measurements contradict each other throughout, the solution is not to be used.
    reasons : tuple of str
        Evidence, the gravest first; empty for ``ok``.
    causes : tuple of str
        What would explain the evidence, the likeliest first, with what to do; empty for ``ok``.
    remarks : tuple of str
        What a user should know although it does not shake the verdict: weak evidence alone, aids that never acted,
        long stretches without a fix.
    """

    status: Status
    reasons: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def summary(self) -> str:
        """The verdict in a few lines of text."""
        lines = [f"verdict: {self.status.upper()}" + ("" if self.reasons else ", nothing contradicts the claims")]
        lines += [f"  - {reason}" for reason in self.reasons]
        if self.causes:
            lines.append(f"  likely: {self.causes[0]}")
            lines += [f"  or: {cause}" for cause in self.causes[1:]]
        return "\n".join([*lines, *(f"  (remark: {remark})" for remark in self.remarks)])

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary, for JSON."""
        return {
            "status": self.status, "reasons": list(self.reasons), "causes": list(self.causes),
            "remarks": list(self.remarks),
        }  # fmt: skip
