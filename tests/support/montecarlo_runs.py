"""Functions of a scenario and a seed, in a module of their own so that workers can import them."""

import os
import time

import numpy as np

from schuler.exceptions import InputError
from schuler.montecarlo import traits


def note(scenario, k):
    """Append the number of the run, and of its process, to files: short writes, nothing comes between."""
    for path, number in ((scenario.get("log"), k), (scenario.get("processes"), os.getpid())):
        if path:
            handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            os.write(handle, f"{number}\n".encode())
            os.close(handle)


def values(scenario, seed):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((4, 3))
    return {"x": scenario.get("mean", 0.0) + x[0, 0], "track": np.cumsum(x, axis=0), "count": int(rng.integers(9)),
            "hit": bool(x[0, 0] > 1.0)}  # fmt: skip


def counted(scenario, seed):
    """A run that takes a while; it is noted before it begins."""
    note(scenario, seed.spawn_key[-1])
    time.sleep(scenario.get("sleep", 0.0))
    return values(scenario, seed)


@traits(threads=True)
def threaded(scenario, seed):
    return values(scenario, seed)


@traits(batched=True, preferred=8)
def batched(scenario, seeds):
    rows = [values(scenario, s) for s in seeds]
    return {name: np.array([r[name] for r in rows]) for name in rows[0]}


@traits(batched=True)
def batched_failing(scenario, seeds):
    for s in seeds:
        fails(scenario, s)
    return batched(scenario, seeds)


def fails(scenario, seed):
    k = seed.spawn_key[-1]
    if k % 7 == 3:
        raise InputError(f"run {k} cannot\nbe done")
    x = values(scenario, seed)
    return {**x, "x": np.nan} if k % 7 == 5 else x


def defect(scenario, seed):
    if seed.spawn_key[-1] == 30:
        raise RuntimeError("a defect")
    return counted(scenario, seed)


def other_shape(scenario, seed):
    k = seed.spawn_key[-1]
    return {"x": np.zeros(2 if k == 12 else 3)}


def text(scenario, seed):
    return {"x": "text"}


def dies_once(scenario, seed):
    """Ends its process the first time run 20 is done."""
    if seed.spawn_key[-1] == 20 and not os.path.exists(scenario["flag"]):
        open(scenario["flag"], "w").close()
        os._exit(9)
    return counted(scenario, seed)


def dies_always(scenario, seed):
    if seed.spawn_key[-1] == 20:
        os._exit(9)
    return values(scenario, seed)
