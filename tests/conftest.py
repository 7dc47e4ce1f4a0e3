"""Fixtures shared by all tests, the choice of cases that run by default, and how processes share them."""

import os
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

SHARED_DATA = DATA
LEFT_OUT = ("slow", "campaign", "reproduce", "fuzz")  # markers of what does not run by default


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of a test marked ``thinned(n)`` every n-th case runs by default, beginning with the first."""
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
