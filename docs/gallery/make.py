"""Makes the pictures of ``docs/gallery.md`` by running its programs: ``python docs/gallery/make.py [NAME ...]``.

Programs run one after the other in one namespace, as on the page; each picture is the ``figure`` of the program below.
Seeds are fixed, so that a picture changes only with the code (or with the versions of what draws it).
"""

from __future__ import annotations

import io
import os
import re
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "gallery.md"
WIDTH = 800  # of a picture [pixels]
COLOURS = 192  # of its palette
MOST = 60_000  # size of a picture [bytes]


def programs(text: str) -> list[tuple[str, str]]:
    """Name of the picture ("" for none) and program, in the order of the page."""
    pictures, picture = [], ""
    for name, program in re.findall(r"!\[[^]]*\]\(gallery/([\w-]+)\.png\)|```python\n(.*?)```", text, re.S):
        if name:
            picture = name
        else:
            pictures.append((picture, program))
            picture = ""
    return pictures


def picture(figure: Any) -> bytes:
    """A matplotlib figure as a PNG with a palette."""
    from PIL import Image

    stream, small = io.BytesIO(), io.BytesIO()
    figure.savefig(stream, format="png", dpi=WIDTH / figure.get_figwidth(), metadata={"Software": None})
    image = Image.open(stream).convert("RGB")
    # the commonest colours as they are: mixed ones would make bands of two meanings alike
    pixels = np.asarray(image)
    colours, where, count = np.unique(pixels.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True)
    common = colours[np.argsort(-count, kind="stable")[:COLOURS]].astype(np.int64)
    nearest = np.array([np.argmin(((common - colour) ** 2).sum(axis=1)) for colour in colours.astype(np.int64)])
    image = Image.fromarray(nearest[where.reshape(pixels.shape[:2])].astype(np.uint8), "P")
    image.putpalette(common.astype(np.uint8).ravel().tolist())
    image.save(small, "PNG", optimize=True)
    return small.getvalue()


def main(wanted: list[str]) -> None:
    """Make the pictures of these names, or all."""
    os.chdir(ROOT)  # where the programs of the page find their files
    space: dict[str, Any] = {}
    total = 0
    for name, program in programs(PAGE.read_text(encoding="utf-8")):
        start = time.process_time()
        exec(program, space)  # noqa: S102, the programs of our own page
        took = time.process_time() - start
        if name and (not wanted or name in wanted):
            data = picture(space["figure"])
            if len(data) > MOST:
                raise SystemExit(f"{name}: {len(data)} bytes, expected {MOST} or fewer")
            (ROOT / "docs" / "gallery" / f"{name}.png").write_bytes(data)
            total += len(data)
            sys.stdout.write(f"{name}: {len(data) / 1e3:.1f} kB, {took:.1f} s of CPU\n")
    sys.stdout.write(f"{total / 1e3:.0f} kB in all\n")


if __name__ == "__main__":
    main(sys.argv[1:])
