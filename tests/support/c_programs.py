"""C compilers of this machine: programs of an exported filter, compiled and run."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("mechanization.c", "covariance.c", "update.c", "axes.c", "gate.c", "filter.c", "schuler_config.c")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-ffp-contract=off")


def compiler(*names: str) -> str:
    """The first of some compilers that is installed; the test is skipped where none is."""
    path = next((p for p in map(shutil.which, names) if p), None)
    if path is None:
        pytest.skip(f"needs one of the compilers {', '.join(names)}, none is installed")
    return path


def fusing() -> tuple[str, ...]:
    """Options with which products and sums are fused as LLVM does for Python; none where the processor cannot."""
    if platform.machine() in ("aarch64", "arm64"):
        return ("-ffp-contract=fast",)
    flags = Path("/proc/cpuinfo")
    return ("-ffp-contract=fast", "-mfma") if flags.is_file() and " fma " in flags.read_text() else ()


def program(folder: Path, *flags: str, main: str = "main_test.c", cc: str | None = None) -> Path:
    """An executable of the filter's files and a main file."""
    target = folder / f"{Path(main).stem}_{abs(hash((flags, cc))):x}"
    command = [cc or compiler("gcc", "cc"), *STRICT, *(flags or ("-O0",)), "-o", target.name, *SOURCES, main, "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=300)
    return target


def replay(executable: Path, limit: float = 1e-9) -> dict[str, float]:
    """What a replay of ``vector.csv`` prints: counts and largest differences; that it fails fails the test."""
    run = subprocess.run(
        [executable, "vector.csv", repr(limit)], cwd=executable.parent, capture_output=True, text=True, timeout=300
    )
    numbers = re.match(
        r"(\d+) samples.*?; (\d+) measurements, (\d+) judged differently; (\d+) states compared\n"
        r"largest difference: states (\S+) sigma \(root mean square (\S+)\), sigmas (\S+) of themselves",
        run.stdout,
    )
    assert numbers is not None, run.stderr
    names = ("samples", "measurements", "judged_differently", "compared", "states", "rms", "sigmas")
    values = dict(zip(names, map(float, numbers.groups()), strict=True))
    assert run.returncode == 0, run.stdout
    return values
