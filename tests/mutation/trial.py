"""Tests run against a mutant in a forked process: the working tree is never changed, kernels are never compiled."""

import contextlib
import importlib.abc
import importlib.util
import io
import math
import os
import resource
import signal
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]


def prepare() -> None:
    """What must be set before numba and numpy are loaded."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    sys.dont_write_bytecode = True
    sys.meta_path.insert(0, _FINDER)
    from hypothesis import Phase, settings

    # the same examples for every mutant, none kept on disk, none made small
    settings.register_profile(
        "mutants", derandomize=True, database=None, phases=(Phase.explicit, Phase.generate), deadline=None
    )
    settings.load_profile("mutants")


def unchanged(files: tuple[str, ...]) -> float:
    """Processor time of the tests, which must pass, on the second of two runs: the first loads other libraries. [s]"""
    seconds = 0.0
    for _ in range(2):
        start = time.process_time()
        status, text = _run(files)
        seconds = time.process_time() - start
        if status:
            raise SystemExit(f"tests fail without any mutant:\n{text[-3000:]}")
    return seconds


def outcome(mutant, files: tuple[str, ...], limit: float) -> str:
    """``killed``, ``survived``, or ``timed out`` after so many seconds of processor time, or thirty times as long."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            _FINDER.replaced[f"schuler.{mutant.module}"] = mutant.code
            os.setpgid(0, 0)
            most = math.ceil(limit)
            resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1))
            status = int(_run(files)[0] != 0)
        finally:
            os._exit(status)
    end = time.monotonic() + 30.0 * limit
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
                return "timed out"
            return "killed" if status else "survived"
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return "timed out"
        time.sleep(0.01)


def _run(files: tuple[str, ...]) -> tuple[int, str]:
    import pytest

    _forget()
    text = io.StringIO()
    quiet = (
        "-W",
        "ignore::pytest.PytestAssertRewriteWarning",
    )  # plugins are loaded once, for many runs
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        status = pytest.main(["-q", "-x", "--tb=short", "-p", "no:xdist", "-p", "no:cacheprovider", *quiet, *files])
    return int(status), text.getvalue()


def _forget() -> None:
    """Let everything of this repository be loaded anew, but not this package, nor an environment in it."""
    own = tuple(f"{ROOT / folder}{os.sep}" for folder in ("src", "tests", "benchmarks"))
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None) or ""
        if file.startswith(own) and not name.startswith(("tests.mutation", "__main__")):
            del sys.modules[name]


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Modules whose source is not that on disk."""

    def __init__(self) -> None:
        self.replaced: dict[str, str] = {}

    def find_spec(self, fullname, path=None, target=None):
        if fullname not in self.replaced:
            return None
        file = ROOT / "src" / (fullname.replace(".", "/") + ".py")
        return importlib.util.spec_from_loader(fullname, self, origin=str(file))

    def exec_module(self, module) -> None:
        file = module.__spec__.origin
        module.__file__ = file
        exec(compile(self.replaced[module.__name__], file, "exec"), module.__dict__)


_FINDER = _Finder()
