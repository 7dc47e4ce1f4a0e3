"""Machine code on disk: used again by the next process, never after a source it was made of has changed, and for
numbers and lanes apart."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import time
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

import schuler
from schuler import jit

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


@pytest.mark.campaign
def test_a_changed_helper_in_another_file_is_compiled_in(tmp_path):
    """numba alone looks at the calling function's file only, and went on using the old helper."""
    package = tmp_path / "schuler"
    shutil.copytree(Path(schuler.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    first, hits = run(tmp_path)
    assert hits == 0
    assert run(tmp_path) == (first, 1)
    helper = package / "mechanization" / "kernels.py"
    text = helper.read_text(encoding="utf-8")
    head, signature, rest = text.partition("def half_angle(px, py, pz):")
    assert signature
    close = rest.index('"""', rest.index('"""') + 3) + 3
    helper.write_text(head + signature + rest[:close] + "\n    px = 2.0 * px" + rest[close:], encoding="utf-8")
    changed, hits = run(tmp_path)
    assert hits == 0
    assert changed < first - 0.01  # turned further


# ------------------------------------------------------------------------------------------- parts of kernels


@jit.inlined
def power(x, n):
    y = 1.0
    for _ in range(n):
        y *= x
    return y


@jit.kernel
def sum_of_powers(x):
    s = 0.0
    for i in range(x.shape[0]):
        s += power(x[i], 2) + power(x[i], i)
    return s


def test_a_helper_becomes_machine_code_only_when_python_calls_it():
    """In a kernel it is part of the kernel: one part for a constant and a variable, with the same numbers."""
    x = np.array([1.0, 3.0, 5.0])
    assert sum_of_powers(x) == sum(v**2 + v**i for i, v in enumerate(x))
    assert power.signatures == []
    assert power(3.0, 2) == 9.0
    assert len(power.signatures) == 1


def test_kernels_neither_raise_nor_print():
    """Parts have no Python environment, in which numba keeps texts."""
    root = Path(schuler.__file__).parent
    for path in (*root.rglob("*kernels.py"), *root.glob("*/kernels/*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            assert not isinstance(node, ast.Raise), (path.name, node.lineno)
            assert not (isinstance(node, ast.Name) and node.id == "print"), (path.name, node.lineno)


FILTER = """
import filter_cases as cases
import numpy as np
from schuler.filtering.engine import run
from schuler.filtering.measurements import gnss_measurements
case, layout, rng = cases.Case.of(cases.drive(1.0), 1.3), cases.layout(15), np.random.default_rng(1)
schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER)
forward = run(case.increments, schedule, cases.start(case, layout, rng), layout, np.full(3, 1e-8), np.full(3, 1e-6))
print(*forward.r[-1], *forward.rec_P[-1])
"""


def test_a_filter_runs_in_plain_python(capsys, monkeypatch):
    """NUMBA_DISABLE_JIT=1, to step through kernels: the numbers of the compiled ones, to rounding."""
    exec(FILTER, {})
    compiled = np.array(capsys.readouterr().out.split(), dtype=np.float64)
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    places = os.pathsep.join([str(Path(schuler.__file__).parents[1]), str(Path(__file__).parent / "support")])
    monkeypatch.setenv("PYTHONPATH", places)
    done = subprocess.run([sys.executable, "-c", FILTER], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    np.testing.assert_allclose(np.array(done.stdout.split(), dtype=np.float64), compiled, rtol=1e-8, atol=1e-15)


TWO = """
import numba as nb
from schuler.jit import kernel, prepare

@kernel
def first(x):
    return x + 1.0

@kernel
def second(x):
    return x + 2.0

def prepare_first(beside):
    prepare([(first, (nb.float64,))], beside=beside)

def prepare_second():
    prepare([(second, (nb.float64,))])
"""


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("beside", "hits"), [("two:prepare_second", 1), ("two:prepare_third", 0)])
def test_what_comes_next_is_compiled_in_another_process(tmp_path, beside, hits):
    """It is waited for and loaded; where that process fails, the kernel is compiled here."""
    (tmp_path / "two.py").write_text(TWO)
    script = (
        "import os; os.cpu_count = lambda: 2\n"
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        f"import two; two.prepare_first({beside!r}); two.prepare_second()\n"
        f"assert two.second(1.0) == 3.0 and sum(two.second.stats.cache_hits.values()) == {hits}"
    )
    in_a_process(["-c", script], tmp_path, 300.0)


TOGETHER = """
import sys
import two
print("ready", flush=True)
sys.stdin.readline()
two.first(1.0)
print(sum(two.first.stats.cache_hits.values()))
"""


@pytest.mark.campaign
@pytest.mark.skipif(jit.fcntl is None, reason="no locks of files here: each process compiles for itself")
def test_of_processes_that_begin_together_one_compiles(tmp_path):
    """The other waits for it and loads what it leaves."""
    (tmp_path / "two.py").write_text(TWO)
    processes = [
        subprocess.Popen([sys.executable, "-c", TOGETHER], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    for process in processes:
        assert process.stdout.readline() == b"ready\n"
    for process in processes:
        process.stdin.write(b"\n")
        process.stdin.flush()
    assert sorted(int(process.communicate(timeout=300.0)[0]) for process in processes) == [0, 1]


@pytest.mark.campaign
def test_what_is_wanted_later_is_compiled_meanwhile(tmp_path):
    """Only kernels of its module wait for that process; none is started for what is on disk."""
    (tmp_path / "two.py").write_text(TWO)
    (tmp_path / "other.py").write_text(TWO)
    script = (
        "import os; os.cpu_count = lambda: 2\n"
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "import other, two; from schuler import jit; from schuler.jit_beside import _waiting\n"
        "jit.prepare_beside('two:prepare_second', two.second)\n"
        "assert list(_waiting) == ['two:prepare_second']; beside = _waiting['two:prepare_second']\n"
        "waited = []; beside.join = lambda join=beside.join: waited.append(join())\n"
        "other.prepare_second(); assert not waited\n"
        "two.prepare_second(); assert waited == [None]\n"
        "assert two.second(1.0) == 3.0 and sum(two.second.stats.cache_hits.values()) == 1\n"
        "_waiting.clear(); jit.prepare_beside('other:prepare_second', other.second); assert not _waiting"
    )
    in_a_process(["-c", script], tmp_path, 300.0)


THREADS = """
import os, subprocess, sys, threading, time
import two
from schuler import jit
os.cpu_count = lambda: 2
begun, begin = [], subprocess.Popen.__init__
def counted(process, *args, **options):
    begun.append(args)
    time.sleep(0.05)  # as long as a system under load may take
    begin(process, [sys.executable, "-c", "import time; time.sleep(0.5)"], **options)
subprocess.Popen.__init__ = counted
together = threading.Barrier(4)
def prepare():
    together.wait()
    two.prepare_first("two:prepare_second")
threads = [threading.Thread(target=prepare) for _ in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert len(begun) == 1, begun
"""


def test_threads_that_prepare_together_start_one_process_which_may_outlive_this_one(tmp_path):
    """Without a word: one that was replaced by another's, or left at the end, was reported as still running."""
    (tmp_path / "two.py").write_text(TWO)
    assert in_a_process(["-W", "error::ResourceWarning", "-c", THREADS], tmp_path, 300.0) == ""


PARTS = """
import os, sys
import numba as nb
from schuler import jit

@jit.borrowing
def half(x):
    return 0.5 * x

@jit.borrowing
def whole(x):
    return half(x) + half(x)

def parts():
    return [(half, (nb.float64,))]

def hand_over():
    jit.compile_parts(parts())

def fail_halfway():
    sys.stdout.buffer.write((1000).to_bytes(8, "little") + b"x")

def prepare_whole(beside):
    jit.prepare([(whole, (nb.float64,))], beside=beside, parts=parts())
"""
COMPILED_HERE = """
import os
os.cpu_count = lambda: 2
from schuler import jit
here, compiled_part = [], jit._compiled_part
def counted(kernel, args):
    here.append(kernel.py_func.__name__)
    return compiled_part(kernel, args)
jit._compiled_part = counted
"""


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("beside", "here"), [("hand_over", []), ("fail_halfway", ["half"]), ("nothing_of_this_name", ["half"])]
)
def test_a_part_comes_from_another_process_or_is_compiled_here(tmp_path, beside, here):
    (tmp_path / "two.py").write_text(PARTS)
    script = (
        f"{COMPILED_HERE}\nimport sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        f"import two; two.prepare_whole('two:{beside}'); assert here == {here}, here; assert two.whole(3.0) == 3.0"
    )
    in_a_process(["-c", script], tmp_path, 300.0)


@pytest.mark.campaign
def test_the_filter_takes_the_parts_that_are_compiled_beside_it(tmp_path):
    """Their types are written in the process beside: others would be compiled twice, and nobody would notice."""
    script = (
        f"{COMPILED_HERE}\nfrom schuler.filtering.kernels import run\n"
        "run.prepare_filter(); names = [part.py_func.__name__ for part, _ in run._parts()]\n"
        "assert here and names and not set(here) & set(names), here"
    )
    in_a_process(["-c", script], tmp_path, 300.0)


# ------------------------------------------------------------------------------- numbers and lanes, one cache

NUMBERS = """
import numba as nb
from schuler.filtering.kernels.covariance import transition
v, m = nb.float64[::1], nb.float64[:, ::1]
transition.compile((m, v, v, nb.float64))
"""
LANES = """
import numba as nb
from schuler.filtering.kernels.vector import lane
from schuler.montecarlo.lanes._shared_kernels import transition
x, y = (nb.types.Array(lane, d, "C", aligned=False) for d in (1, 2))
transition.compile((y, x, x, nb.float64))
"""
CALLER = """
import numba as nb
from schuler.budget import _replay_kernels as k
k.prepare = lambda kernels: [kernel.compile(types) for kernel, types in kernels if kernel is k.replay_columns]
k.prepare_replay()
"""


def in_a_process(arguments: list[str], folder: Path, timeout_s: float) -> str:
    """Run Python in a process of its own whose machine code is kept in ``folder / cache``; what it says of errors."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True, text=True, check=False, timeout=timeout_s, env=environment, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stderr


@pytest.fixture(scope="module")
def lanes(tmp_path_factory):
    """Folder with the machine code for lanes on disk."""
    folder = tmp_path_factory.mktemp("lanes")
    in_a_process(["-c", LANES], folder, 300.0)
    return folder


@pytest.mark.campaign
def test_machine_code_for_lanes_does_not_disturb_a_compilation_for_numbers(lanes, tmp_path):
    """The third process compiles a caller of a function whose code for numbers and for lanes is on disk.

    With one index on disk for both, it ended in ``KeyError: (float64,)``.
    """
    shutil.copytree(lanes, tmp_path, dirs_exist_ok=True)
    for script in (NUMBERS, CALLER):
        in_a_process(["-c", script], tmp_path, 300.0)


EXAMPLES = Path(__file__).parents[1] / "examples"
COMMANDS = {
    "demo": ["demo"],
    "lanes": ["montecarlo", str(EXAMPLES / "montecarlo_hour.toml"), "--runs", "8"],
    "budget": ["budget", str(EXAMPLES / "budget_town.toml")],
}


@pytest.mark.slow
@pytest.mark.parametrize("order", list(permutations(COMMANDS)), ids="-".join)
def test_commands_in_any_order_from_an_empty_cache(tmp_path, order):
    for command in order:
        in_a_process(["-m", "schuler", *COMMANDS[command]], tmp_path, 1200.0)


def test_a_lane_version_names_the_lane_version_of_everything_it_calls():
    from schuler.mechanization import kernels as k

    with pytest.raises(TypeError, match="expected a lane version of half_angle_coefficients"):
        jit.lane_version(k.half_angle)


@pytest.mark.campaign
def test_an_index_of_types_that_are_gone_is_compiled_anew(lanes, tmp_path):
    """An earlier version of the package may have left it; reading it would end in ModuleNotFoundError."""
    shutil.copytree(lanes, tmp_path, dirs_exist_ok=True)
    (index,) = (tmp_path / "cache").rglob("*transition_in_lanes*.nbi")
    name = b"schuler.filtering.kernels.vector"
    content = index.read_bytes()
    assert name in content
    index.write_bytes(content.replace(name, name[:-6] + b"sector"))
    in_a_process(["-c", LANES], tmp_path, 300.0)


# ------------------------------------------------------------------------------- no folder, no room, damaged entries

DOUBLED = """
from schuler.jit import kernel

@kernel
def doubled(x):
    return 2.0 * x
"""


@pytest.fixture
def doubled(tmp_path):
    """A kernel in a file of its own, as a new process would make it, and the hits of its machine code on disk."""
    path = tmp_path / "kernels.py"
    path.write_text(DOUBLED, encoding="utf-8")

    def made():
        names: dict[str, object] = {"__name__": "kernels", "__file__": str(path)}
        exec(compile(DOUBLED, str(path), "exec"), names)
        return names["doubled"]

    jit._say_not_kept.cache_clear()
    return made


def hits(compiled) -> int:
    return sum(compiled.stats.cache_hits.values())


@pytest.mark.parametrize(
    "damage", [b"", b"\x80", b"\x80\x04K\x01.", bytes(200)], ids=["empty", "cut", "cut later", "zeros"]
)
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_entry_on_disk_is_removed_and_made_anew(doubled, tmp_path, damage, suffix):
    assert doubled()(2.0) == 4.0
    again = doubled()
    assert (again(2.0), hits(again)) == (4.0, 1)
    (entry,) = (tmp_path / "__pycache__").glob(f"*.{suffix}")
    good = len(entry.read_bytes())
    entry.write_bytes(damage)
    compiled = doubled()
    assert (compiled(2.0), hits(compiled)) == (4.0, 0)
    (entry,) = (tmp_path / "__pycache__").glob(f"*.{suffix}")
    assert len(entry.read_bytes()) > 0.5 * good
    again = doubled()
    assert (again(2.0), hits(again)) == (4.0, 1)


@pytest.mark.campaign
def test_a_flipped_byte_anywhere_in_an_entry_never_stops_a_run(doubled, tmp_path):
    doubled()(2.0)
    (index,) = (tmp_path / "__pycache__").glob("*.nbi")
    good = index.read_bytes()
    for place in range(0, len(good), 61):
        index.write_bytes(good[:place] + bytes([good[place] ^ 0xFF]) + good[place + 1 :])
        assert doubled()(2.0) == 4.0


@pytest.mark.skipif(jit.fcntl is None, reason="no locks of files here")
def test_a_process_that_is_stopped_while_it_compiles_holds_up_others_for_a_while(doubled, tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "WAIT_FOR_ANOTHER_S", 0.2)
    waited = []
    monkeypatch.setattr(time, "sleep", waited.append)
    with (tmp_path / "kernels.py").open("rb") as file:
        jit.fcntl.flock(file, jit.fcntl.LOCK_EX)
        assert doubled()(2.0) == 4.0
        assert waited
        waited.clear()
        compiled = doubled()
        assert (compiled(2.0), hits(compiled), waited) == (4.0, 1, [])  # what is on disk is loaded at once


def test_without_a_folder_to_keep_it_in_it_compiles_and_says_so_once(doubled, monkeypatch, capsys):
    from numba.core import caching

    monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    for _ in range(2):
        assert doubled()(2.0) == 4.0
    stated = capsys.readouterr().err
    assert stated.count("the compiled kernels cannot be kept (there is no folder to write to)") == 1
    assert "set NUMBA_CACHE_DIR" in stated


def test_a_full_disk_costs_only_the_compilation(doubled, monkeypatch, capsys):
    from numba.core import caching

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "_save_data", full)
    assert doubled()(2.0) == 4.0
    assert "cannot be kept (No space left on device)" in capsys.readouterr().err


APART = """
from schuler.jit import apart, borrowing, inlined

@apart
def seldom(x):
    for i in range(x.shape[0]):
        x[i] *= 3.0

@inlined
def update(x):
    if x[0] > 1.0:
        seldom(x)
    if x[1] > 1.0:
        seldom(x)

@borrowing
def run(x):
    update(x)
    return 0
"""


def test_what_a_run_seldom_comes_to_is_one_function_whoever_calls_it(tmp_path):
    """Of an inlined caller numba would hand on that it is to be inlined: one copy a call."""
    path = tmp_path / "kernels.py"
    path.write_text(APART, encoding="utf-8")
    names: dict[str, object] = {"__name__": "kernels", "__file__": str(path)}
    exec(compile(APART, str(path), "exec"), names)
    compiled, x = names["run"], np.array([2.0, 2.0])
    compiled(x)
    assert x.tolist() == [18.0, 18.0]
    (text,) = compiled.inspect_llvm().values()
    code = [line for line in text.splitlines() if "seldom" in line]
    assert sum(line.startswith("define") for line in code) == 1
    assert sum(" call " in line for line in code) == 2
