"""The corpus: cases that run, raise or lack data; halves; what judges what; JSON, earlier runs, page, peers."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.corpus import __main__ as command
from benchmarks.corpus import navigation, page, peers
from benchmarks.corpus.case import Case, Skipped, halves, row_of
from benchmarks.corpus.cases import CASES
from benchmarks.corpus.judgement import (
    Errors,
    Judge,
    antenna_covariance,
    consistency,
    horizontal_errors,
    independent,
    largest,
    nees,
    within,
)
from places import ROOT, module

from schuler.filtering.error_model import ecef_from_ned_states
from schuler.navigation.run import navigate

tn = module("navigation/test_navigate.py")
CONFIG = {**tn.config(filter={"smooth": True}), "imu": dict(tn.IMU)}


def fake(data: Path) -> dict:
    return {
        "error": 2.0,
        "claimed": 1.0,
        "nees": 4.0,
        "nees_band": [0.5, 1.5],
        "inside": [0.3, 0.6, 0.9],
        "warnings": [],
    }


def raising(data: Path) -> dict:
    raise ValueError("this recording is no good")


def skipping(data: Path) -> dict:
    raise Skipped("the peer is not installed")


TINY = [
    Case("a", "navigation", (), "m", fake, "fixes"),
    Case("b", "navigation", (), "m", raising, "fixes"),
    Case("c", "navigation", ("nowhere",), "m", fake),
    Case("d", "navigation", (), "m", skipping),
]


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_raises_or_is_absent_is_a_row_and_never_the_end(jobs):
    rows = {row["name"]: row for row in command.run_all(TINY, jobs)}
    assert list(rows) == ["a/fixes", "b/fixes", "c", "d"]
    assert rows["a/fixes"]["exit"] == 0
    assert rows["b/fixes"]["exit"] == 1
    assert rows["b/fixes"]["sentence"] == "ValueError: this recording is no good"
    assert "nowhere is absent" in rows["c"]["skipped"]
    assert rows["d"]["skipped"] == "the peer is not installed"


def test_table_json_before_and_page(tmp_path, monkeypatch, capsys):
    """A run is written, read as an earlier one and printed beside a later one; the page has all of it."""
    monkeypatch.setattr(command, "CASES", TINY)
    monkeypatch.setattr(command, "PAGE", tmp_path / "corpus.md")
    monkeypatch.setattr(page, "HALVES", halves(TINY))
    earlier = tmp_path / "before.json"
    assert command.main(["--only", "a/fixes", "--json", "--out", str(earlier), "--jobs", "1"]) == 0
    held = json.loads(capsys.readouterr().out)
    assert held == json.loads(earlier.read_text())
    assert not (tmp_path / "corpus.md").exists()  # of some cases only
    held["rows"][0]["error"] = 7.0
    earlier.write_text(json.dumps(held))
    assert command.main(["--before", str(earlier), "--jobs", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1:3] for line in lines if line.startswith("a/fixes")] == [["was", "7"], ["c", "2"]]
    assert "choosing half of navigation: 1 of 1 ran, NEES 0.3 to 3 in 0 of 1" in "\n".join(lines)
    text = (tmp_path / "corpus.md").read_text()
    assert "| a/fixes | c | 2 |" in text
    assert "- `b/fixes`: ValueError: this recording is no good" in text
    assert "is absent" in text
    assert (tmp_path / "images" / "corpus.png").stat().st_size > 1000
    assert command.main(["--only", "nothing like it"]) == 2


def test_all_questions_to_a_recording_are_in_one_half():
    """The 1st, 3rd, ... recording of each kind by name; every kind has both halves."""
    of = halves(CASES)
    assert len(of) == len(CASES)
    for kind in {case.kind for case in CASES}:
        recordings = sorted({case.recording for case in CASES if case.kind == kind})
        for case in CASES:
            if case.kind == kind:
                expected = "choosing" if recordings.index(case.recording) % 2 == 0 else "reporting"
                assert of[case.name] == expected


def test_defaults_only():
    """A configuration of the corpus states the IMU by name and what a README states, and asks; it sets nothing else."""
    source = (ROOT / "benchmarks" / "corpus" / "navigation.py").read_text(encoding="utf-8")
    for entry in ("sigma", "gate", "noise", "lockout", "tau", "states", "floor", "_rate_hz"):
        assert f'{entry}"' not in source.replace('"filter": {"record_s": 0.2}', ""), entry


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_independent_values_of_a_correlated_series(rho):
    """Of an autoregression of first order n (1 - rho) / (1 + rho); statistical, mean of 40 series within 4 errors."""
    rng = np.random.default_rng(3)
    n = 2000
    count = []
    for _ in range(40):
        x, w = np.empty(n), rng.standard_normal(n)
        x[0] = w[0] / np.sqrt(1.0 - rho**2)
        for k in range(1, n):
            x[k] = rho * x[k - 1] + w[k]
        count.append(independent(x) / n)
    expected = (1.0 - rho) / (1.0 + rho)
    # the sum ends at the first zero, which lies early where there is no correlation: up to a tenth too few
    assert expected * 0.85 < np.mean(count) < expected * 1.15 + 4.0 * np.std(count) / np.sqrt(40)


def test_an_honest_claim_is_inside_its_band():
    """White errors of the claimed covariance: NEES 1, 68, 95, 99.7 %; statistical, 4 standard errors of 4000 values."""
    rng = np.random.default_rng(5)
    C = np.array([[4.0, 1.2], [1.2, 1.0]])
    e = rng.multivariate_normal(np.zeros(2), C, 4000)
    P = np.broadcast_to(C, (4000, 2, 2))
    row = consistency(Errors(np.arange(4000.0), e, 0.0 * P, P))
    assert abs(row["nees"] - 1.0) < 4.0 / np.sqrt(4000)
    assert row["nees_band"][0] < row["nees"] < row["nees_band"][1]
    for share, expected in zip(row["inside"], (0.6827, 0.9545, 0.9973), strict=True):
        assert abs(share - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / 8000)
    assert row["claimed"] == 0.0  # the judge's own is no claim
    np.testing.assert_allclose(nees(Errors(np.arange(4000.0), 2.0 * e, P, P)).mean(), 4.0 * row["nees"])


def test_windows():
    t = np.arange(10.0)
    np.testing.assert_array_equal(t[within(t, [(2.0, 6.0)], 1.0)], [4.0, 5.0])
    errors = Errors(t, np.column_stack((t, 0.0 * t)), np.zeros((10, 2, 2)), np.zeros((10, 2, 2)))
    assert largest(errors, [(2.0, 6.0), (7.0, 9.0), (20.0, 30.0)]) == [5.0, 8.0]


@pytest.fixture(scope="module")
def drive():
    return tn.drive()


def test_a_simulated_drive_as_a_case(drive, monkeypatch):
    """Every other fix is held back and judges; in outages the withheld ones do; a well modelled run is honest."""
    seen = []

    def kept(recording, config):
        seen.append(recording)
        return navigate(recording, config)

    monkeypatch.setattr(navigation, "navigate", kept)

    def reader(data):
        return replace(drive, reference=None), CONFIG, None

    row = navigation.run(Path(), reader, None, {})
    assert len(seen[0].gnss) == (len(drive.gnss) + 1) // 2
    assert 0.3 < row["nees"] < 3.0
    assert row["smoothed"] < row["error"] < 3.0
    assert row["exit"] == 0
    row = navigation.run(Path(), reader, {"windows_s": [[60.0, 70.0], [85.0, 95.0]]}, {})
    assert len(seen[1].gnss) == len(drive.gnss)
    assert row["outages"] == 2
    assert row["outage"] >= row["error"]
    assert 0.05 < row["nees"] < 5.0


def test_errors_are_of_the_antenna(drive):
    """Against noise-free fixes at the antenna and against the truth of the IMU a run has the same errors."""
    result = navigate(drive, CONFIG)
    truth = drive.reference
    antenna = truth.moved_by(tn.LEVER)
    exact = Judge(antenna.t, antenna.llh, np.zeros((len(antenna.t), 3, 3)), True, np.zeros(3))
    a, b = horizontal_errors(result, exact), horizontal_errors(result, Judge.of_truth(truth))
    np.testing.assert_array_equal(a.total, a.claim)  # nothing of an exact judge
    fuzzy = horizontal_errors(result, exact._replace(cov_n=exact.cov_n + np.eye(3)))
    np.testing.assert_allclose(fuzzy.total, a.claim + np.eye(2))
    at = int(np.argmin(np.abs(a.t - result.t[-1])))
    np.testing.assert_allclose(np.sqrt(np.diag(a.claim[at])), result.sigma("dr")[-1, :2], rtol=0.05)
    k = np.isin(a.t, b.t)
    assert np.abs(a.error[k] - b.error[np.isin(b.t, a.t)]).max() < 0.06  # attitude errors at a lever of 1.2 m


class _Layout(dict):
    size = 16


@pytest.mark.parametrize("left", [1.0, 0.25, 1e-12])
def test_a_claim_at_the_offset_of_the_end(left):
    """Of constants the last estimate of an offset errs by ``left`` of the variance that it has at a record."""
    rng = np.random.default_rng(4)
    A = rng.standard_normal((16, 16))
    P = A @ A.T
    last = P.copy()
    last[15] *= left
    last[:15, 15] *= left
    llh, v = np.array([0.8, 0.1, 300.0]), np.array([12.0, -3.0, 0.5])
    T = ecef_from_ned_states(llh[None], 16)[0]
    result = SimpleNamespace(
        layout=_Layout(delay=slice(15, 16)),
        states=SimpleNamespace(llh=np.tile(llh, (2, 1)), v_eb_n=np.tile(v, (2, 1))),
        filter_covariance_e=lambda: np.stack([T @ X @ T.T for X in (P, last)]),
    )
    c, d = P[6:9, 15] / P[15, 15], left * P[15, 15]
    expected = P[6:9, 6:9] + d * (np.outer(c, v) + np.outer(v, c) + np.outer(v, v))
    np.testing.assert_allclose(antenna_covariance(result)[0], expected, rtol=1e-9, atol=1e-9)  # rounding


def test_a_peer_that_is_not_installed_is_said(monkeypatch, capsys):
    monkeypatch.setattr(peers, "version", lambda: None)
    assert command.main(["--peers"]) == 1
    assert "pip install python-ins" in capsys.readouterr().err


def test_errors_of_the_peer_stand_beside_ours(monkeypatch):
    monkeypatch.setattr(
        peers, "kept", lambda: {"x": {"peer": "python-ins", "error": 4.0}, "y": {"failed": "it raised"}}
    )
    row = {"name": "x", "error": 1.0, "outage": 2.0}
    assert peers.beside(row)["ratio"] == 0.5
    assert peers.beside({**row, "outage": None})["ratio"] == 0.25
    assert peers.beside({**row, "name": "y"})["peer"] == "it raised"
    assert peers.beside({**row, "name": "z"}) == {**row, "name": "z"}


@pytest.mark.realdata
def test_a_recording_of_the_corpus(shared_data):
    """One of each kind that takes a second; numbers are of the page."""
    for name in (
        "openshoe/square2",
        "vn200_ratetable/IMU0",
        "imu_tk_xsens/rest",
        "instinct_spirent/points-no-atmosphere",
    ):
        [case] = [c for c in CASES if c.name == name]
        row = row_of(case, shared_data)
        assert row["exit"] == 0, row
        assert np.isfinite([row["error"], row["claimed"], row["nees"]]).all()
