"""Allan deviations: closed forms, other programs' numbers, gaps, real recordings."""

import gzip
import re

import numpy as np
import pytest
from places import ROOT

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.confidence import KINDS
from schuler.characterisation.variance import on_grid
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, RandomWalk, White, quantise_increments

ALL_KINDS = sorted(KINDS)


def nbs14() -> np.ndarray:
    """The 1000-point set of NBS Monograph 140: a congruential generator from 1234567890."""
    n, out = 1234567890, []
    for _ in range(1000):
        out.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(out)


# Riley (NIST SP 1065), table 31: tau = 1, 10, 100, every printed digit
NBS14 = {
    "non-overlapping": ("2.922319e-01", "9.965736e-02", "3.897804e-02"),
    "overlapping": ("2.922319e-01", "9.159953e-02", "3.241343e-02"),
    "modified": ("2.922319e-01", "6.172376e-02", "2.170921e-02"),
    "time": ("1.687202e-01", "3.563623e-01", "1.253382e+00"),
    "hadamard": ("2.943883e-01", "1.052754e-01", "3.910861e-02"),
    "overlapping hadamard": ("2.943883e-01", "9.581083e-02", "3.237638e-02"),
    "total": ("2.922319e-01", "9.134743e-02", "3.406530e-02"),
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("kind", ALL_KINDS)
def test_nbs14(kind):
    """Printed digits; the data are white, so the total deviation has no bias to take off."""
    curve = allan_deviation(nbs14(), 1.0, kind=kind, taus=[1.0, 10.0, 100.0], noise=0.0)
    assert tuple(f"{d:.6e}" for d in curve.deviation) == NBS14[kind]


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_rate_and_integral_are_the_same(kind):
    x = nbs14() - 3.0
    rate = allan_deviation(x, 8.0, kind=kind)
    integral = allan_deviation(7.0 + np.concatenate(([0.0], np.cumsum(x))) / 8.0, 8.0, kind=kind, data="integral")
    np.testing.assert_allclose(rate.deviation, integral.deviation, rtol=1e-9)  # rounding
    np.testing.assert_allclose(rate.tau, integral.tau, rtol=0)
    assert integral.samples == rate.samples == 1000


def by_definition(x: np.ndarray, m: int, kind: str) -> tuple[float, int]:
    """Squares of differences of cluster means, written out."""
    n = len(x)
    mean = np.array([x[i : i + m].mean() for i in range(n - m + 1)])
    order = 3 if "hadamard" in kind else 2
    d = mean[m:] - mean[:-m]
    if order == 3:
        d = d[m:] - d[:-m]
    if kind in ("modified", "time"):
        d = np.array([d[i : i + m].mean() for i in range(len(d) - m + 1)])
    if kind in ("non-overlapping", "hadamard"):
        d = d[::m]
    return float(np.mean(d**2) / (2.0 if order == 2 else 6.0)), len(d)


@pytest.mark.parametrize("kind", [k for k in ALL_KINDS if k != "total"])
@pytest.mark.parametrize("m", [1, 2, 3, 7, 40])
def test_the_definition(kind, m):
    x = np.random.default_rng(1).standard_normal(170).cumsum()
    curve = allan_deviation(x, 5.0, kind=kind, taus=[m / 5.0])
    expected, count = by_definition(x, m, kind)
    scale = m / 5.0 / np.sqrt(3.0) if kind == "time" else 1.0
    assert curve.deviation[0] == pytest.approx(np.sqrt(expected) * scale, rel=1e-10)  # rounding
    assert curve.count[0] == count


@pytest.mark.parametrize("kind", ["overlapping", "modified", "overlapping hadamard"])
def test_blocks_join(kind):
    """More than two blocks of the kernel, averaging times shorter and longer than one."""
    from schuler.characterisation._kernels import BLOCK

    n = 2 * BLOCK + 777
    x = np.random.default_rng(2).standard_normal(n)
    ms = np.array([1, 3, 511, 513, BLOCK // 2 + 5])
    curve = allan_deviation(x, 1.0, kind=kind, taus=ms, noise=0.0)
    X = np.concatenate(([0.0], np.cumsum(x)))
    for m, variance in zip(ms, curve.variance, strict=True):
        d = X[2 * m :] - 2.0 * X[m:-m] + X[: -2 * m]
        norm = 2.0 * m**2
        if kind == "overlapping hadamard":
            d, norm = d[m:] - d[:-m], 6.0 * m**2
        if kind == "modified":
            d, norm = np.convolve(d, np.ones(m), "valid") if m < 100 else moving_sum(d, m), 2.0 * m**4
        assert variance == pytest.approx(np.mean(d**2) / norm, rel=1e-9)  # rounding


def moving_sum(d: np.ndarray, m: int) -> np.ndarray:
    c = np.concatenate(([0.0], np.cumsum(d)))
    return c[m:] - c[:-m]


# ------------------------------------------------------------------------------------------- closed forms


def test_ramp_is_exact():
    """R tau / sqrt(2), rounding only; third differences do not see it."""
    x = 0.3 * np.arange(4000) / 50.0
    curve = allan_deviation(x, 50.0, noise=0.0)
    np.testing.assert_allclose(curve.deviation, 0.3 * curve.tau / np.sqrt(2.0), rtol=1e-6)
    # cluster means of samples are exact for a line; what is left is rounding of the running sum
    assert np.all(allan_deviation(x, 50.0, kind="overlapping hadamard", noise=0.0).deviation < 1e-9)


def test_sinusoid():
    """A sin^2(pi f tau) / (pi f tau), for whole numbers of periods and tau well above a sample."""
    A, f, rate = 2.0, 0.05, 100.0
    x = A * np.sin(2.0 * np.pi * f * np.arange(400_000) / rate)
    curve = allan_deviation(x, rate, taus=[1.0, 3.0, 10.0, 15.0])
    expected = A * np.sin(np.pi * f * curve.tau) ** 2 / (np.pi * f * curve.tau)
    np.testing.assert_allclose(curve.deviation, expected, rtol=0.02)  # the record is not a whole number of differences


@pytest.mark.parametrize(
    "process", [White(0.02), RandomWalk(0.003), GaussMarkov(0.4, 3.0), White(0.1) + GaussMarkov(0.05, 40.0)]
)
def test_noise_has_its_allan_variance(process):
    """Within 4 of the standard errors the curve itself states, from 8 samples on (point samples below that differ)."""
    rate = 20.0
    x = process.sample(200_000, 1.0 / rate, np.random.default_rng(5))
    curve = allan_deviation(x, rate, noise=process)
    there = (curve.tau >= 8.0 / rate) & (curve.edf > 30.0)
    expected = process.allan_variance(curve.tau)
    # 0.5 %: point samples of a continuous process at 8 samples
    error = np.abs(curve.variance / expected - 1.0) - 0.005
    assert np.all(error[there] < 4.0 * curve.relative_sigma[there])


def test_quantisation():
    """Pulses of sqrt(12) Q carried over: sqrt(3) Q / tau; statistical, a few per cent."""
    rate, Q = 100.0, 1e-3
    rng = np.random.default_rng(6)
    increments = rng.standard_normal(100_000) * 0.05 + 0.01
    pulses = quantise_increments(increments, np.sqrt(12.0) * Q)
    error = (pulses - increments) * rate
    curve = allan_deviation(error, rate)
    np.testing.assert_allclose(curve.deviation[:10], np.sqrt(3.0) * Q / curve.tau[:10], rtol=0.03)
    assert np.all(curve.alpha[:8] > 1.5)


@pytest.mark.campaign
def test_total_deviation_is_unbiased_for_a_random_walk():
    """Mean over 300 records at half the record: within 4 standard errors of K^2 tau / 3, and not without correction."""
    rng = np.random.default_rng(7)
    n, K = 256, 1.0
    v = np.array(
        [allan_deviation(RandomWalk(K).sample(n, 1.0, rng), 1.0, kind="total", noise=-2.0).variance for _ in range(300)]
    )
    mean, error = v.mean(axis=0), v.std(axis=0) / np.sqrt(300.0)
    tau = 2.0 ** np.arange(8)
    late = tau >= 8  # the random walk is a series of point samples
    assert np.all(np.abs(mean - K**2 * tau / 3.0)[late] < 4.0 * error[late] + 0.02 * tau[late] / 3.0)
    assert mean[-1] * 0.625 < K**2 * tau[-1] / 3.0 - 3.0 * error[-1]  # bias of 1 - 0.75 / 2


# ------------------------------------------------------------------------------------------------- lists


def test_lists_of_averaging_times():
    x = np.random.default_rng(3).standard_normal(1000)
    assert allan_deviation(x, 2.0).tau.tolist() == [0.5 * 2**k for k in range(9)]  # a third of the record
    assert allan_deviation(x, 1.0, taus="decade").tau.tolist() == [1, 2, 4, 10, 20, 40, 100, 200]
    assert allan_deviation(x, 1.0, taus="all").tau.tolist() == list(range(1, 334))
    assert allan_deviation(x, 1.0, kind="modified").tau[-1] == 128
    assert allan_deviation(x, 1.0, kind="total").tau[-1] == 256
    log = allan_deviation(x, 1.0, taus="log").tau
    assert np.all(np.diff(log) > 0)
    assert np.all(log[1:] / log[:-1] <= 2.0)
    rounded = allan_deviation(x, 3.0, taus=[1.0, 0.4, 0.3, 166.7])
    np.testing.assert_allclose(rounded.tau * 3.0, [1, 3, 500])
    assert len(allan_deviation([0.0, 1.0, 0.0], 1.0)) == 1


def test_dense_lists_are_interpolated_closely():
    """Bounds of a list computed at nodes against all computed one by one."""
    x = (White(1.0) + RandomWalk(0.02)).sample(6000, 1.0, np.random.default_rng(4))
    model = White(1.0) + RandomWalk(0.02)
    dense = allan_deviation(x, 1.0, taus="log", noise=model)
    for i in range(0, len(dense), 3):
        one = allan_deviation(x, 1.0, taus=[dense.tau[i]], noise=model)
        assert dense.edf[i] == pytest.approx(one.edf[0], rel=0.03)
        assert dense.low[i] == pytest.approx(one.low[0], rel=0.01)
        assert dense.high[i] == pytest.approx(one.high[0], rel=0.03)


def test_progress_ends_at_one():
    seen = []
    allan_deviation(np.random.default_rng(0).standard_normal(2_200_000), 100.0, taus=[0.01], progress=seen.append)
    assert seen == sorted(seen)
    assert len(seen) > 1
    assert seen[-1] == 1.0


# -------------------------------------------------------------------------------------------------- gaps


def test_without_gaps_the_gap_rule_changes_nothing():
    x = np.random.default_rng(8).standard_normal(3000)
    padded = np.concatenate((x, [np.nan]))
    for kind in ("overlapping", "non-overlapping", "hadamard", "overlapping hadamard"):
        whole = allan_deviation(x, 1.0, kind=kind, taus=[1, 4, 16, 64], noise=0.0)
        gappy = allan_deviation(padded, 1.0, kind=kind, taus=[1, 4, 16, 64], noise=0.0)
        # only differences that end in the NaN are new: 80 % of a cluster is enough
        np.testing.assert_allclose(whole.deviation[0], gappy.deviation[0], rtol=1e-12)
        np.testing.assert_allclose(whole.deviation, gappy.deviation, rtol=0.02)
        assert (gappy.missing, gappy.samples) == (1, 3001)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("process", [White(1.0), White(1.0) + RandomWalk(0.03), GaussMarkov(1.0, 20.0)])
@pytest.mark.parametrize("kind", ["overlapping", "non-overlapping"])
def test_gaps_leave_the_mean_right(process, kind):
    """5 % dropouts and two long gaps, mean of 60 records within 4 standard errors of the mean without gaps."""
    rng = np.random.default_rng(9)
    n, taus = 4000, [1, 3, 10, 40, 150, 400]
    ratio = []
    for _ in range(60):
        x = process.sample(n, 1.0, rng)
        whole = allan_deviation(x, 1.0, kind="overlapping", taus=taus, noise=0.0).variance
        x[rng.random(n) < 0.05] = np.nan
        x[900:1000] = np.nan
        x[2500:2900] = np.nan
        ratio.append(allan_deviation(x, 1.0, kind=kind, taus=taus, noise=0.0).variance - whole)
        expected = process.allan_variance(np.array(taus, dtype=float))
    mean, error = np.mean(ratio, axis=0), np.std(ratio, axis=0) / np.sqrt(60)
    assert np.all(np.abs(mean) < 4.0 * error + 0.01 * expected)


def test_missing_values_of_an_integral():
    """A lost value of an integral loses no signal: every difference that is left is exact."""
    x = np.random.default_rng(10).standard_normal(500)
    X = np.concatenate(([0.0], np.cumsum(x)))
    X[[50, 51, 300]] = np.nan
    curve = allan_deviation(X, 1.0, data="integral", taus=[7.0], noise=0.0)
    d = X[14:] - 2.0 * X[7:-7] + X[:-14]
    assert curve.variance[0] == pytest.approx(np.nanmean(d**2) / 98.0, rel=1e-9)  # rounding
    assert curve.count[0] == np.count_nonzero(~np.isnan(d))
    assert curve.missing == 3


@pytest.mark.parametrize("kind", ["modified", "time", "total"])
def test_what_needs_a_whole_record_says_so(kind):
    with pytest.raises(InputError, match="without gaps, got 1 missing"):
        allan_deviation(np.r_[np.arange(50.0), np.nan, np.arange(50.0)], 1.0, kind=kind)


def test_on_grid():
    rng = np.random.default_rng(11)
    k = np.concatenate((np.arange(100), np.arange(105, 300)))
    t = 17.0 + (k + 0.3 * (rng.random(len(k)) - 0.5)) / 50.0
    x = np.column_stack((k, -k)).astype(float)
    grid = on_grid(t, x, 50.0)
    assert grid.shape == (300, 2)
    assert np.flatnonzero(np.isnan(grid[:, 0])).tolist() == [100, 101, 102, 103, 104]
    np.testing.assert_array_equal(grid[k, 0], k)
    assert on_grid(t, x[:, 0], 50.0).shape == (300,)


@pytest.mark.parametrize(
    ("t", "rate", "match"),
    [
        (np.arange(1000) / 99.0, 100.0, "suggest 99 Hz"),
        (np.arange(1000) / 100.0, 50.0, "suggest 100 Hz"),
        (np.r_[0.0, 0.01, 0.01, 0.02], 100.0, "between samples 1 and 2"),
        (np.r_[0.0, 0.02, 0.01], 100.0, "sort the samples"),
        (np.r_[0.0, 100.0, 200.0], 10.0, "mostly there"),
        (np.r_[0.0], 10.0, "at least 2 stamps"),
    ],
)
def test_on_grid_refuses(t, rate, match):
    with pytest.raises(InputError, match=match):
        on_grid(t, np.zeros(len(t)), rate)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"x": np.zeros((10, 3))}, "one axis at a time"),
        ({"x": np.r_[np.zeros(9), np.inf]}, "NaN or infinity"),
        ({"x": [1.0, 2.0]}, "at least 3 values"),
        ({"x": ["a"]}, "real numbers"),
        ({"x": np.full(10, np.nan)}, "at least 3 values, got 0"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"kind": "alan"}, "expected one of"),
        ({"taus": "octaves"}, "octave, decade"),
        ({"taus": [100.0]}, "5 s"),
        ({"taus": [0.1]}, "one sample"),
        ({"data": "phase"}, "'rate' or 'integral'"),
        ({"confidence": 95.0}, "between 0 and 1"),
        ({"noise": "flicker"}, "lag1"),
        ({"noise": 3.0}, "from -4 to 2"),
        ({"noise": [0.0, 0.0, 0.0, 0.0]}, "one exponent or 2"),
    ],
)
def test_refusals(change, match):
    arguments = {"x": np.arange(10.0) % 3, "rate_hz": 1.0, **change}
    with pytest.raises(InputError, match=match):
        allan_deviation(arguments.pop("x"), arguments.pop("rate_hz"), **arguments)


def test_a_stuck_sensor_has_zero_deviation_and_no_nan():
    curve = allan_deviation(np.full(1000, 4.2), 1.0)
    for field in (curve.deviation, curve.low, curve.high):
        assert np.all(np.abs(field) < 1e-12)
    assert np.all(np.isfinite(curve.edf))


def test_the_page_runs(capsys):
    page = (ROOT / "docs" / "allan.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL):
        exec(compile(block, "allan.md", "exec"), {})
    tau, low, deviation, high, edf = map(float, capsys.readouterr().out.split())
    assert tau == 163.84
    assert low < deviation < high
    assert 1.0 < edf < 5.0


# ----------------------------------------------------------------------------------------- other programs


def test_equals_allantools():
    """To rounding, where the peer is installed."""
    at = pytest.importorskip("allantools")
    x = (White(1.0) + RandomWalk(0.01)).sample(20_000, 0.01, np.random.default_rng(12))
    names = {"overlapping": at.oadev, "modified": at.mdev, "overlapping hadamard": at.ohdev, "time": at.tdev,
             "non-overlapping": at.adev, "hadamard": at.hdev, "total": at.totdev}  # fmt: skip
    for kind, peer in names.items():
        curve = allan_deviation(x, 100.0, kind=kind, noise=0.0)
        _, deviation, _, count = peer(x, rate=100.0, data_type="freq", taus=curve.tau)
        np.testing.assert_allclose(curve.deviation, deviation, rtol=1e-10 if kind != "overlapping" else 1e-12)
        np.testing.assert_array_equal(curve.count, count)


def stable32(path) -> np.ndarray:
    """Columns AF, tau, count, alpha, low, sigma, high."""
    rows = [line.split() for line in path.read_text(errors="replace").splitlines() if line[:1] != "#"]
    return np.array([[float(v) for v in row] for row in rows if len(row) == 7])


def numbers(path) -> np.ndarray:
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return np.array([float(line.split()[0]) for line in text.splitlines() if line.strip() and line[:1] != "#"])


STABLE32_KINDS = {
    "adev": "non-overlapping", "oadev": "overlapping", "mdev": "modified", "tdev": "time", "hdev": "hadamard",
    "ohdev": "overlapping hadamard", "totdev": "total",
}  # fmt: skip
STABLE32_DATA = {
    "phasedat": ("PHASE.DAT", "integral", 1.0),
    "ocxo": ("ocxo_frequency.txt", "rate", 1.0),
    "gps": ("gps_1pps_phase_data.txt.gz", "integral", 1.0),
    "Cs5071A": ("5071A_phase.txt.gz", "integral", 1.0),
    "pink_frequency": ("pink_frequency.txt", "rate", 1.0 / 42.0),
    "Keysight53230A_ti_noise_floor": ("tic_phase.txt", "integral", 1.0),
}


@pytest.mark.campaign
@pytest.mark.thinned(3)
@pytest.mark.realdata
@pytest.mark.parametrize("folder", STABLE32_DATA)
def test_stable32(folder, shared_data):
    """Every row of every export: five printed digits and the count; bounds to 0.3 % from our degrees of freedom.

    Stable32's exponents are taken over (the column alpha), its bounds are chi-square at 68.3 %. The bounds differ by
    the fits in Greenhall and Riley's tables, which we sum. Two things are Stable32's own. Its octave exports of the
    OCXO were run on frequencies near 1 without removing the mean, summed in double precision: rounding of up to 0.18 %,
    which the same sums reproduce. And its total deviation takes the tables of degrees of freedom, which are for many
    samples, at one sample too, and those of white noise for alpha > 0.
    """
    name, data, rate = STABLE32_DATA[folder]
    x = numbers(shared_data / "allantools_refs" / folder / name)
    if folder == "ocxo":
        x = x / 1e7
    exports = [p for p in sorted((shared_data / "allantools_refs" / folder).glob("*.txt")) if p.name != name]
    compared = 0
    for path in exports:
        kind = [STABLE32_KINDS[w] for w in re.split(r"[_.]", path.name.lower()) if w in STABLE32_KINDS]
        table = stable32(path) if kind else np.empty((0, 7))
        if not len(table):
            continue
        _, _, count, alpha, low, sigma, high = table.T
        arguments = {"kind": kind[0], "noise": alpha, "confidence": 0.683}
        if folder == "ocxo" and path.name.endswith("_octave.txt"):
            curve = with_stable32_rounding(x, table[:, 0], arguments)
        else:
            signal = x - 1.0 if folder == "ocxo" else x
            curve = allan_deviation(signal, rate, taus=table[:, 0] / rate, data=data, **arguments)
        digit = 10.0 ** (np.floor(np.log10(sigma)) - 4.0)
        np.testing.assert_allclose(curve.deviation / digit, sigma / digit, rtol=0, atol=0.52, err_msg=path.name)
        np.testing.assert_array_equal(curve.count, count, err_msg=path.name)
        compared += len(table)
        if low.max() > 0.0:
            bounded = np.full(len(table), True) if kind[0] != "total" else (alpha <= 0.0) & (table[:, 0] >= 32)
            ours = chi_square_bounds(curve.deviation, curve.edf, 0.683)
            np.testing.assert_allclose(ours[0][bounded], low[bounded], rtol=0.003, err_msg=path.name)
            np.testing.assert_allclose(ours[1][bounded], high[bounded], rtol=0.003, err_msg=path.name)
    assert compared > 100


def with_stable32_rounding(x, ms, arguments):
    """Sums of numbers near 1 lose 4 digits: the whole phase for overlapping kinds, each cluster for the others."""
    if arguments["kind"] not in ("non-overlapping", "hadamard"):
        phase = np.concatenate(([0.0], np.cumsum(x)))
        curve = allan_deviation(phase, 1.0, taus=ms, data="integral", **arguments)
        for i, m in enumerate(ms.astype(int) if arguments["kind"] == "overlapping hadamard" else []):
            d = phase[3 * m :] - 3.0 * phase[2 * m : -m] + 3.0 * phase[m : -2 * m] - phase[: -3 * m]
            curve.deviation[i] = np.sqrt(np.mean(d**2) / 6.0) / m  # in this order 3 x rounds once more
        return curve
    curve = allan_deviation(x - 1.0, 1.0, taus=ms, **arguments)
    for i, m in enumerate(ms.astype(int)):
        clusters = np.cumsum(x[: len(x) // m * m].reshape(-1, m), axis=1)[:, -1] / m
        curve.deviation[i] = allan_deviation(clusters, 1.0, taus=[1.0], kind=arguments["kind"], noise=0.0).deviation[0]
    return curve


def chi_square_bounds(deviation, edf, confidence):
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - confidence)
    return deviation * np.sqrt(edf / chi2.ppf(1.0 - tail, edf)), deviation * np.sqrt(edf / chi2.ppf(tail, edf))


@pytest.mark.realdata
def test_adis16405(shared_data):
    """Published curve of six axes: 3e-6 (its printed digits).

    Its 95 % bounds are ``dev (1 -+ 2 / sqrt(2 (n/m - 1)))``: symmetric, 2 for 1.96, clusters that do not overlap. Near
    the end of the record ours are narrower below and wider above.
    """
    folder = shared_data / "adis16405_static"
    log = np.load(folder / "adis16405_imu1.npz")
    table = read_csv(folder / "imu1_oadev_reference_avar_pkg.csv")
    tau = table[:, 0]
    lsb = np.ravel(log["lsb"])
    for axis in range(6):
        x = log["counts"][:, axis] * (lsb[axis] if len(lsb) == 6 else lsb[0 if axis < 3 else 1])
        curve = allan_deviation(x, 100.0, taus=tau)
        dev, low, high = table[:, 1 + 3 * axis : 4 + 3 * axis].T
        np.testing.assert_allclose(curve.deviation, dev, rtol=3e-6)
        half = 2.0 / np.sqrt(2.0 * (len(x) / np.round(tau * 100.0) - 1.0))
        np.testing.assert_allclose(low, dev * (1.0 - half), rtol=1e-5)
        np.testing.assert_allclose(high, dev * (1.0 + half), rtol=1e-5)
        assert np.all(curve.low < curve.deviation)
        assert np.all(curve.deviation < curve.high)
        assert curve.low[-1] > low[-1]
        assert curve.high[-1] > high[-1]


def read_csv(path) -> np.ndarray:
    rows = [line for line in path.read_text().splitlines() if line[:1] != "#"]
    return np.array([[float(v) for v in row.split(",")] for row in rows])
