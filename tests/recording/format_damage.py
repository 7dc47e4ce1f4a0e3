"""Damaged files for the parsers: whatever is in them, readers raise errors of ours or return a recording."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schuler.exceptions import SchulerError
from schuler.recording import Recording
from schuler.recording.formats import registry

TOKENS = (
    b"nan", b"inf", b"1e999", b"-", b"", b",", b"\n", b"\x00", b"\xff" * 8, b"9" * 30, b"#", b'"', b" ", b"0x1", b"1_0",
    b"\xef\xbb\xbf", b"-1e300", b"\x7f\xf0\x00\x00\x00\x00\x00\x00", b"\x00\x00\x00\x00\x00\x00\xf0\x7f",
    b"\x7f" * 4,
)  # fmt: skip


@st.composite
def damaged(draw, good: bytes) -> bytes:
    """A file with bytes replaced, removed, repeated or put in, cut off, or not of the format at all."""
    if draw(st.integers(0, 19)) == 0:
        return draw(st.binary(max_size=600))
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(data) - 1, 0)))
        length = draw(st.sampled_from((1, 2, 4, 8, 40)))
        kind = draw(st.integers(0, 4))
        if kind == 0:
            data[start : start + length] = draw(st.binary(min_size=1, max_size=8))
        elif kind == 1:
            data[start : start + length] = draw(st.sampled_from(TOKENS))
        elif kind == 2:
            del data[start : start + length]
        elif kind == 3:
            data[start:start] = data[start : start + draw(st.sampled_from((8, 80, 136)))]
        else:
            del data[start:]
    return bytes(data)


def check_damaged(
    good: bytes, path: Path, open_it: Callable[[], object], *, examples: int = 200, memory_mb: float = 50.0
) -> None:
    """Read ``examples`` damaged versions of a file (the same ones each time) in place of ``path``.

    Asserts that telling the format raises nothing, that nothing but errors of ours comes out of the reader, and that no
    more than ``memory_mb`` is ever held.
    """

    @settings(max_examples=examples, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(damaged(good))
    def run(data: bytes) -> None:
        path.write_bytes(data)
        if data:
            registry.held_by(data[: 1 << 16], path)  # whose it is by its looks; raises nothing
        with suppress(SchulerError):
            assert isinstance(open_it(), Recording)

    tracemalloc.start()
    try:
        run()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        path.write_bytes(good)
    assert peak < memory_mb * 1e6, f"{peak / 1e6:.0f} MB for a file of {len(good)} bytes"
