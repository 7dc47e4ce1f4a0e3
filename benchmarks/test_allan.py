"""Overlapping Allan deviation of six hours at 200 Hz, 93 averaging times, bounds included; the peer has none."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.characterisation.allan import allan_deviation
from schuler.sensors.noise import White, flicker

RATE, SAMPLES = 200.0, 4_320_000


@pytest.fixture(scope="module")
def log():
    return (White(1.0) + flicker(0.05)).sample(SAMPLES, 1.0 / RATE, np.random.default_rng(0))


@pytest.fixture(scope="module")
def taus():
    m = np.unique(np.round(np.geomspace(1, SAMPLES // 3, 101)))
    assert len(m) == 93
    return m / RATE


def octaves():
    return 2.0 ** np.arange(21) / RATE


@pytest.mark.benchmark(group="overlapping Allan deviation, 4.32 M samples, 93 averaging times")
def test_allan_deviation(benchmark, log, taus):
    allan_deviation(log, RATE, taus=taus)
    benchmark.extra_info["epochs"] = SAMPLES
    benchmark.pedantic(allan_deviation, args=(log, RATE), kwargs={"taus": taus}, rounds=9)


@pytest.mark.benchmark(group="overlapping Allan deviation, 4.32 M samples, 93 averaging times")
def test_peer_allantools(benchmark, log, taus):
    allantools = pytest.importorskip("allantools", reason="the peer is not installed: pip install allantools")
    benchmark.extra_info["epochs"] = SAMPLES
    arguments = {"rate": RATE, "data_type": "freq", "taus": taus}
    peer = benchmark.pedantic(allantools.oadev, args=(log,), kwargs=arguments, rounds=3)
    np.testing.assert_allclose(allan_deviation(log, RATE, taus=taus).deviation, peer[1], rtol=1e-12)


@pytest.mark.parametrize("kind", ["modified", "overlapping hadamard", "total"])
def test_other_kinds(benchmark, log, kind):
    benchmark.group = f"{kind}, 4.32 M samples, octaves"
    tau = octaves()[:-2]
    allan_deviation(log, RATE, kind=kind, taus=tau)
    benchmark.extra_info["epochs"] = SAMPLES
    benchmark.pedantic(allan_deviation, args=(log, RATE), kwargs={"kind": kind, "taus": tau}, rounds=3)


@pytest.mark.parametrize("kind", ["modified", "overlapping hadamard", "total"])
def test_peer_allantools_other_kinds(benchmark, log, kind):
    allantools = pytest.importorskip("allantools", reason="the peer is not installed: pip install allantools")
    benchmark.group = f"{kind}, 4.32 M samples, octaves"
    peer = {"modified": allantools.mdev, "overlapping hadamard": allantools.ohdev, "total": allantools.totdev}[kind]
    benchmark.extra_info["epochs"] = SAMPLES
    arguments = {"rate": RATE, "data_type": "freq", "taus": octaves()[:-2]}
    benchmark.pedantic(peer, args=(log,), kwargs=arguments, rounds=1)
