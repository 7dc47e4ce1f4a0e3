"""Fixtures shared by all tests, the choice of cases that run by default, and how processes share them."""

import gc
import os
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from places import DATA

# One thread of linear algebra a test process, set before numpy is loaded: each of them using all cores, they would wait
# for each other (a Cholesky factorisation of 60 by 60 took 0.3 s instead of 0.1 ms).
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# Compiled modules are kept, whatever the shell says: without them every test process rewrites the assertions of all
# tests again (16 s of a processor), and every command that a test starts compiles the package. Kernels are kept beside
# them anyway.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# In the background of a shell Ctrl-C is ignored, and so it would be by tests of it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED_DATA = DATA
LEFT_OUT = ("slow", "campaign", "reproduce", "fuzz")  # markers of what does not run by default
# Rooms that run no filter, more than half of all tests. They stand last, so that of two processes the second begins
# with them while the first compiles the kernels for both.
WITHOUT_FILTER = {
    "recording", "sensors", "gnss", "growth", "simulation", "standstill", "characterisation", "test_rotation.py",
    "test_site.py", "test_units.py", "test_frames.py", "test_earth.py", "test_arrays.py", "test_project.py",
}  # fmt: skip


def pytest_configure(config):
    """Dates of damaged logs are no error. Said in pyproject.toml, it would load the package, and numpy, before the
    number of threads above: a single test process then computes with all cores, and half of its time is waiting."""
    config.addinivalue_line("filterwarnings", "default::schuler.timebase.LeapSecondWarning")
    draw_without_local_constants()


def draw_without_local_constants():
    """Examples of property tests do not depend on what else a process has imported.

    Hypothesis takes constants from all modules there are, 870 of them, which it reads and parses to find these.
    """
    from hypothesis.internal.conjecture import providers

    if hasattr(providers, "_get_local_constants"):
        providers._get_local_constants = lambda: providers._local_constants


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """Python's search for cycles waits until all tests are there; a second process imports them from the end.

    Imports make millions of objects that stay: looking through them again and again takes a third of the collection.
    Of two processes that import in the same order both would rewrite the assertions of every file.
    """
    gc.disable()
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if int(worker[2:]) % 2 and not session.config.option.file_or_dir:
        import_backwards(session.config)


def import_backwards(config):
    """Import test files from the last to the first; what cannot be imported is left to the collection to tell."""
    from _pytest.pathlib import import_path

    here = Path(__file__).parent
    for path in sorted(here.rglob("test_*.py"), reverse=True):
        try:
            import_path(path, mode="importlib", root=config.rootpath, consider_namespace_packages=False)
        except BaseException:  # a skip of the whole file is one
            for name in [n for n, m in sys.modules.items() if getattr(m, "__file__", None) == str(path)]:
                del sys.modules[name]


def pytest_collection_finish(session):
    """What was imported is there to stay, and is not looked through any more; what tests make, thirty times
    less often.

    Syntax trees of the package, tables and figures are many objects that live for a test: a tenth of the processor.
    """
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of a test marked ``thinned(n)`` every n-th case runs by default, beginning with the first."""
    items.sort(key=lambda item: not WITHOUT_FILTER.isdisjoint(item.nodeid.partition("::")[0].split("/")[1:2]))
    seen: Counter[str] = Counter()
    for item in items:
        thinned = item.get_closest_marker("thinned")
        if thinned is not None and not any(item.get_closest_marker(name) for name in LEFT_OUT):
            function = item.nodeid.partition("[")[0]
            if seen[function] % thinned.args[0]:
                item.add_marker(pytest.mark.campaign)
            seen[function] += 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Files stay together while they can: fixtures of modules and kernels are made once, not once a process."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings; the test skips, with the reason, where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real recordings are not here ({SHARED_DATA}); set SCHULER_DATA to their folder")
    return SHARED_DATA


@pytest.fixture
def rng():
    import numpy as np

    return np.random.default_rng(20151)
