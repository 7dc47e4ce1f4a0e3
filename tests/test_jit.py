"""Machine code on disk: used again by the next process, and never after a source it was made of has changed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import schuler

SCRIPT = """
import numpy as np
from schuler.filtering.kernels import smoother as k
q = np.array([[1.0, 0.0, 0.0, 0.0]])
dx = np.full((2, 9), 0.2)
k.apply_corrections(np.zeros(1), q, np.zeros((1, 3)), np.zeros((1, 3)), np.array([0.0, 1.0]), dx, dx)
print(repr(float(q[0, 0])), sum(k.apply_corrections.stats.cache_hits.values()))
"""


def run(folder: Path) -> tuple[float, int]:
    """Scalar part of the quaternion, and whether the code came from disk, in a fresh process."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=300, env=environment
    )
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_a_changed_helper_in_another_file_is_compiled_in(tmp_path):
    """numba alone looks at the calling function's file only, and went on using the old helper."""
    package = tmp_path / "schuler"
    shutil.copytree(Path(schuler.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    first, hits = run(tmp_path)
    assert hits == 0
    assert run(tmp_path) == (first, 1)
    helper = package / "mechanization" / "kernels.py"
    text = helper.read_text(encoding="utf-8")
    head, found, rest = text.partition("def half_angle_series(px, py, pz):")
    assert found
    close = rest.index('"""', rest.index('"""') + 3) + 3
    helper.write_text(head + found + rest[:close] + "\n    px = 2.0 * px" + rest[close:], encoding="utf-8")
    changed, hits = run(tmp_path)
    assert hits == 0
    assert changed < first - 0.01  # turned further
