"""Time until something is there, as whole processes in a warm environment: import and help, beside a peer."""

from __future__ import annotations

import subprocess
import sys

import pytest

PEER = "import allantools"


def run(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize(
    "arguments",
    [("-c", "pass"), ("-c", "import schuler"), ("-m", "schuler", "--help"), ("-c", PEER)],
    ids=["python alone", "import schuler", "schuler --help", "peer: import allantools"],
)
@pytest.mark.benchmark(group="whole process")
def test_whole_process(benchmark, arguments):
    if PEER in arguments:
        pytest.importorskip("allantools", reason="the peer is not installed: pip install allantools")
    benchmark.pedantic(run, args=arguments, rounds=7, warmup_rounds=1)
