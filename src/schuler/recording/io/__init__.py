"""Reading and writing recordings: the only place where units, axes, heights and time scales of others are converted."""

from __future__ import annotations

from schuler.recording.io.dispatch import read, write
from schuler.recording.io.hints import ReadHints

__all__ = ["ReadHints", "read", "write"]
