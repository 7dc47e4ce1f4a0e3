"""Intervals contain the choice of the model and what changes in the log: closed forms, then the law of halves."""

from pathlib import Path

import numpy as np
import pytest

from schuler.characterisation.averaging import changes, spreads, widened
from schuler.characterisation.fitting import Fit
from schuler.characterisation.records import AxisSignal, half_moments, mean_moments
from schuler.characterisation.selection import select
from schuler.characterisation.spectrum import clean_spectrum
from schuler.sensors.noise import Flicker, GaussMarkov, Process, Quantisation, RandomWalk, White

DATA = Path(__file__).parents[3] / "shared" / "data"
DT = 0.1


def fitted(names, values, sigma, misfit=10.0):
    sigma = np.broadcast_to(sigma, len(names))
    return Fit(tuple(names), np.array(values, dtype=float), np.diag(np.square(sigma)), misfit, 10)


def test_one_model_alone_keeps_its_own_interval():
    """Closed form; the tolerance is that of 1.96 for the 97.5 % quantile."""
    kept = fitted(["N", "K"], [2.0, 0.1], [0.01, 0.3])
    s = spreads(kept, [(kept, 0)], 0)
    assert (s["N"].sigma, s["N"].share) == pytest.approx((0.01, 1.0))
    assert (s["N"].low, s["N"].high) == pytest.approx((2.0 * np.exp(-0.0196), 2.0 * np.exp(0.0196)), rel=1e-5)
    assert set(s) == {"N", "K"}


def test_two_models_as_likely_give_an_interval_from_one_to_the_other():
    """Closed form: half the weight at either place, so the 2.5 % quantile is the 5 % one of the lower model."""
    kept, other = (fitted(["N"], [value], 1e-3) for value in (1.0, 1.2))
    s = spreads(kept, [(kept, 0), (other, 0)], 0)["N"]
    assert s.low == pytest.approx(np.exp(-1.6449e-3), rel=1e-5)
    assert s.high == pytest.approx(1.2 * np.exp(1.6449e-3), rel=1e-5)
    assert s.sigma == pytest.approx(np.hypot(1e-3, np.log(1.2) / np.sqrt(2.0)), rel=1e-6)  # about the value kept


def test_weights_are_those_of_the_criterion():
    """``misfit + 2 p + 2 c``: ten averaging times less and ten less of misfit weigh as ten of misfit more."""
    kept, other = fitted(["N"], [1.0], 0.01, 10.0), fitted(["N", "K"], [1.1, 0.1], 0.01, 8.0)
    assert spreads(kept, [(other, 0)], 0)["K"].share == pytest.approx(0.5)
    assert spreads(kept, [(other, 1)], 0)["K"].share == pytest.approx(1.0 / (1.0 + np.e))
    assert "K" not in spreads(kept, [(other, 5)], 0)  # 0.7 %: no word of it


def test_a_term_that_others_do_without_may_be_zero():
    kept, other = fitted(["N", "B"], [1.0, 0.1], 0.05), fitted(["N"], [1.0], 0.05, 12.0)
    s = spreads(kept, [(other, 0)], 0)
    assert s["B"].low == 0.0
    assert s["N"].low > 0.0
    assert s["B"].high < 0.1 * np.exp(1.96 * 0.05)  # half of its weight is at zero


def test_a_change_between_halves_is_half_of_it_in_the_uncertainty():
    kept = fitted(["N"], [1.0], 0.01)
    halves = fitted(["N"], [1.2], 0.014), fitted(["N"], [0.9], 0.014)
    change = changes(kept, halves)
    assert change["N"] == pytest.approx(np.log(0.75))
    s = widened(kept, spreads(kept, [], 0), change)["N"]
    assert s.sigma == pytest.approx(np.hypot(0.01, 0.5 * np.log(0.75)))
    assert s.high == pytest.approx(np.exp(1.96 * s.sigma), rel=1e-4)
    assert changes(kept, (halves[0], halves[0])) == {}


def overlap(a, b):
    return a.low <= b.high and b.low <= a.high


def selected(x, rate_hz):
    signal = [AxisSignal(np.ascontiguousarray(x, dtype=np.float64), rate_hz, 0)]
    clean = clean_spectrum(signal[0].x, rate_hz)
    lines = () if clean is None else clean.lines
    return select(mean_moments(signal, lines), halves=half_moments(signal, lines))


def overlaps(x, rate_hz):
    """Whether the intervals of N, B, K of a log and its halves overlap, for every pair and term that both have."""
    n = len(x) // 2
    parts = [selected(part, rate_hz).spreads for part in (x, x[:n], x[n:])]
    return [
        (term, overlap(parts[i][term], parts[k][term]))
        for i, k in ((0, 1), (0, 2), (1, 2))
        for term in "NBK"
        if term in parts[i] and term in parts[k]
    ]


def real_axis(name, k):
    if name == "laser":
        from schuler.recording.io import read

        imu = read(DATA / "psins_lasergyro" / "lasergyro.imu").need_imu().rates()
        return np.concatenate((imu.gyro, imu.accel), axis=1)[:, k], imu.rate_hz
    held = np.load(DATA / "adis16405_static" / f"adis16405_{name}.npz")
    return held["counts"][:, k] * held["lsb"][k], 100.0


REAL = [(name, k) for name in ("imu1", "imu2", "laser") for k in range(6)]


@pytest.mark.realdata
@pytest.mark.campaign
def test_white_noise_of_a_log_and_its_halves_overlap():
    """An axis on which those of one model alone were disjoint: the laser gyro was moved in the first half."""
    assert all(inside for term, inside in overlaps(*real_axis("laser", 1)) if term == "N")


@pytest.mark.realdata
@pytest.mark.campaign
def test_intervals_of_halves_overlap_on_every_axis_at_hand():
    """Statistical: 95 % intervals of eighteen axes, every pair of log, first and second half; N without exception."""
    several = [pair for name, k in REAL for pair in overlaps(*real_axis(name, k))]
    assert all(inside for term, inside in several if term == "N")
    assert np.mean([inside for _, inside in several]) >= 0.95


KINDS: dict[str, Process] = {
    "N": White(1.0),
    "N+B": White(1.0) + Flicker(0.1),
    "N+K": White(1.0) + RandomWalk(0.02),
    "N+GM": White(1.0) + GaussMarkov(0.5, 20.0),
    "Q+N": Quantisation(1.0) + White(1.0),
    "N+B+K": White(1.0) + Flicker(0.1) + RandomWalk(0.005),
}


@pytest.mark.campaign
@pytest.mark.parametrize("name", list(KINDS))
def test_intervals_of_simulated_logs_hold_the_truth_and_overlap(name):
    """Statistical, 20 logs: fewer than 17 with the true N inside have a probability of 0.3 % at 95 %."""
    rng = np.random.default_rng(8)
    several, inside = [], 0
    for _ in range(20):
        x = KINDS[name].sample(20_000, DT, rng)
        several += [yes for _, yes in overlaps(x, 1.0 / DT)]
        N = selected(x, 1.0 / DT).spreads["N"]
        inside += N.low <= 1.0 <= N.high
    assert np.mean(several) >= 0.95
    assert inside >= 17
