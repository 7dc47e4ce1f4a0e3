"""``kill -9`` of every command that writes: no half file, no lost input, and the next run removes what is hidden.

Each run is a fork of this process, killed just before a change of the file system (an audit hook counts those below the
test's folder; which one is drawn), so that no moment between two of them is left out for being short.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from writing_commands import COMMANDS, check_complete, content, forked, hidden, visible, write_inputs

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks, and counts changes of files")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_inputs(tmp_path_factory.mktemp("inputs"))


#: Kills of the commands that take seconds; five of the others. ``-m slow`` kills each ten times, a hundred in all.
FEW = {"tune": 2, "allan": 2, "budget": 2}


@pytest.mark.parametrize(
    ("name", "kills"),
    [
        *(pytest.param(name, FEW.get(name, 5), marks=pytest.mark.campaign) for name in COMMANDS),
        *(pytest.param(name, 10, marks=pytest.mark.slow) for name in COMMANDS),
    ],
)
def test_kill_9_at_any_change_of_files(name, kills, inputs, tmp_path):
    """All files of a command are there, or none; those of folders that exist one after the other, each complete."""
    command = COMMANDS[name]

    def fresh(place: str) -> Path:
        shutil.copytree(inputs, tmp_path / place / "in")
        return tmp_path / place

    folder = fresh("complete")
    status, changes, _ = forked(folder, command)
    assert status == 0
    assert changes > 1
    expected, before = visible(folder), {f"in/{n}" for n in content(inputs)}
    assert expected > before
    digests = {n: hashlib.sha256(x).hexdigest() for n, x in content(inputs).items()}
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big"))
    moments = sorted(rng.permutation(np.arange(1, changes + 1))[:kills])
    folder, killed = fresh("killed"), 0
    for moment in moments:
        status, *_ = forked(folder, command, int(moment))
        killed += os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL
        assert {n: hashlib.sha256(x).hexdigest() for n, x in content(folder / "in").items() if n in digests} == digests
        made = visible(folder) - before
        assert made <= expected
        new = [p for p in (folder / "out").glob("*") if p.is_dir() and not p.name.startswith(".")]
        for top in new:  # a folder that a command makes is complete when it appears
            assert visible(top) == visible(tmp_path / "complete" / "out" / top.name)
        for one in made:
            check_complete(folder / one)
        if made:  # it was as good as done: begin again, so that it has something to do
            shutil.rmtree(folder)
            folder = fresh("killed")
    assert killed == len(moments)
    status, *_ = forked(folder, command)
    assert status == 0
    assert visible(folder) == expected
    assert hidden(folder) == []
    print(f"{name}: killed {killed} times at {changes} changes of files")
