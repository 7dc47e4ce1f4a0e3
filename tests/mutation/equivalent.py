"""Mutants that no test can tell from the original, and why.

Keys: module, the line as it is, the line as it is in the mutant.
"""

_ANY_NEGATIVE = "numpy takes any negative length in reshape for the one that is left"

_BOTH_AGREE = "at the limit of a series both sides are the same to rounding"

EQUIVALENT: dict[tuple[str, ...], str] = {}


def _same(module: str, line: str, mutants: dict[str, str], why: str) -> None:
    """Enter mutants of a line: what is replaced in it, and by what."""
    for old, new in mutants.items():
        EQUIVALENT[module, line, line.replace(old, new, 1)] = why


_same(
    "arrays",
    "bad = int(np.flatnonzero(~np.isfinite(rows.reshape(len(rows), -1)).all(axis=1))[0])",
    {"-1)).all": "- 2)).all"},
    _ANY_NEGATIVE,
)
_same(
    "arrays",
    "return len(shape) == len(expected) and all(w is None or s == w for s, w in zip(shape, expected, strict=True))",
    {"strict=True": "strict=False"},
    "lengths are equal where it is reached",
)
_same(
    "rotary.modulated_errors",
    "once, once_nodes = _integrated(both.reshape(len(h), _NODES, -1), h, inner, weights)",
    {"_NODES, -1": "_NODES, - 2"},
    _ANY_NEGATIVE,
)
_same(
    "rotary.modulated_errors",
    "near |= np.abs(t[np.clip(np.searchsorted(t, breaks) - 1, 0, len(t) - 1)] - breaks) < 1e-9",
    {"len(t) - 1": "len(t) + 1"},
    "a place of searchsorted less one is never beyond the last",
)
_same(
    "timebase",
    "_BLOCK = 1 << 17  # stamps that are compared at a time",
    {"1 <<": "2 <<", "17": "18"},
    "how many are compared at a time changes nothing",
)
_same(
    "timebase",
    "if not abs(self.epoch_gps_s) < 1e11:",
    {"1e11": "99999999999.0"},
    "a limit between the last date there is and no date, a second more or less of 3170 years",
)
_same(
    "timebase",
    'lines = path.read_text(encoding="utf-8")[:100_000].splitlines()',
    {"100_000": " 99999"},
    "a limit of what is read; the list has 5 kB",
)
_same(
    "timebase",
    "return (days, valid_to) if grows and days[: len(LEAP_DAYS)] == LEAP_DAYS and valid_to > own[1] else own",
    {"valid_to >": "valid_to >="},
    "lists that expire on one day are one bulletin",
)
_same(
    "filtering.measurements",
    "given = np.asarray(z, dtype=np.float64).reshape(m, -1) if m else np.zeros((0, 1))",
    {"(0, 1)": "( 1, 1)"},
    "without times there is no row that it could be given to",
)
_same(
    "filtering.error_model",
    "F[3:6, 6:9] = np.stack((g_L - np.cross(2.0 * ie_L + en_L, v), zero, g_h - np.cross(en_h, v)), axis=-1)",
    {"axis=-1": "axis=1"},
    "the last axis of two is the second",
)
_same(
    "rotation",
    "lock = np.hypot(C[..., 2, 1], C[..., 2, 2]) < 1e-6",
    {"<": "<="},
    "on the limit both branches give the matrix to the accuracy stated",
)
_G1 = "g1 = 0.5 - m * (1.0 / 24.0 - m * (1.0 / 720.0 - m * (1.0 / 40320.0 - m * (1.0 / 3628800.0 - m / 479001600.0))))"
_G2 = "g2 = 1.0 / 6.0 - m * (1.0 / 120.0 - m * (1.0 / 5040.0 - m * (1.0 / 362880.0 - m / 39916800.0)))"
for _line, _last, _others in (
    (_G1, "479001600.0", ("479001599.0", "479001601.0")),
    (_G2, "39916800.0", ("39916799.0", "39916801.0")),
):
    for _other in _others:
        _same("mechanization.kernels", _line, {_last: _other}, "1e-8 of the last term of a series is below rounding")
_same(
    "growth.schuler_loop",
    "half = 2.0 * np.sin(0.5 * w * t) ** 2  # 1 - cos without cancellation",
    {"np.sin(0.5": "np.sin( -0.5"},
    "a sine is squared",
)
_same(
    "calibration.bench.gauss_helmert",
    "values = np.array([prior[name][0] if name in prior else 0.0 for name in PARAMETERS])",
    {"else 0.0": "else 1.0"},
    "values without a finite sigma are not read",
)
_same(
    "calibration.bench.gauss_helmert",
    "lost = (np.abs(null) > 1e-2).any(axis=1)",
    {"> 1e-2": ">= 1e-2"},
    "a computed part of a direction is never a hundredth to the last bit",
)
_same(
    "calibration.bench.gauss_helmert",
    "if free[:3].all():",
    {"[:3]": "[: 4]"},
    "where the iteration begins, not where it ends",
)
_same("calibration.bench.gauss_helmert", "max_iterations: int = 100,", {"100": "101"}, "what converges does in ten")
_same(
    "characterisation.confidence",
    "for differenced in range(4):",
    {"4": " 5"},
    "the third difference ends it",
)
_same(
    "characterisation.confidence",
    "if delta < 0.25 or differenced == 3:",
    {"3": "4"},
    "the fourth round is the last of the loop, and what is differenced after it is not read",
)
_same(
    "characterisation.confidence",
    "share = dof(short, power_law(alpha, short), 1.0) / dof(long, power_law(alpha, long), 1.0)",
    {"long), 1.0": "long), 0.0"},
    "lags of power laws are counted in samples: the interval is not read",
)
_same(
    "characterisation.confidence",
    "*((g := GaussMarkov(1.0, float(t)), g.allan_variance(tau)) for t in times),",
    {"(1.0": "( 2.0"},
    "of twice the size, a quarter of the strength",
)
_same(
    "calibration.bench.gauss_helmert",
    'float((q.S[0] / q.S[-1]) ** 2) if r == len(q.S) == q.Vt.shape[0] else float("inf"),',
    {"shape[0]": "shape[ 1]"},
    "the matrix is square",
)
_same(
    "calibration.bench.gauss_helmert",
    "Order: TypeAlias = Literal[3, 6, 9]",
    {"3,": "2,", "6": "5", "9": "8"},
    "a type for readers and checkers",
)
_same(
    "calibration.bench.gauss_helmert",
    "stages = [free & (np.arange(9) < m) for m in (3, 6, 9) if m <= order]",
    {"< m": "<= m"},
    "where the iteration begins, not where it ends",
)
_same(
    "calibration.bench.gauss_helmert",
    "e * L, (v - p.rho) * L, np.sqrt(C * np.clip(redundancy, 0.0, 1.0)) / (2.0 * p.rho) * L,",
    {"1.0": "2.0"},
    "a redundancy is above one by rounding only",
)
_CONFIDENCE = {
    "below = min(floor(alpha), 1)": ({"1)": "2)"}, "the exponent above has no share then"),
    "variance = autocovariance(d, ((1.0, exponent),), 1.0, np.zeros(1))[0]": (
        {"1.0, np": "0.0, np", "), 1.0": "), 2.0", "s(1)": "s( 2)", "[0]": "[ -1]"},
        "lags of power laws are counted in samples; one lag is asked for",
    ),
    "share = dof(short, power_law(alpha, short), 1.0) / dof(long, power_law(alpha, long), 1.0)": (
        {"short), 1.0": "short), 0.0", "short), 1": "short), 2", "long), 1": "long), 2"},
        "lags of power laws are counted in samples: the interval is not read",
    ),
    "chi_square = freedom > _CHI_SQUARE_FROM": ({">": ">="}, "degrees of freedom are never 20 to the last bit"),
    "for i in range(len(ms) - 2, -1, -1):": (
        {"- 2": "- 1", "-1,": "- 2,"},
        "the last one is no fraction of itself",
    ),
    "f, step = 0.5 / tau, 1.1": ({"0.5": "-0.5"}, "spectra are even"),
    "f = 0.5 / tau": ({"0.5": "-0.5"}, "a ratio of spectra, which are even"),
    "freedom = np.array([dof(Differences(2, int(m), n), ((1.0, 0),), dt) for m in ms])": (
        {"((1.0": "(( 2.0"},
        "degrees of freedom do not depend on the size of a noise",
    ),
    "return ((1.0, White(1.0)),)": (
        {"((1.0": "(( 2.0", "White(1.0": "White( 2.0"},
        "bounds do not depend on the size of a noise",
    ),
    "w = np.sqrt(0.5 * freedom) / model": ({"0.5": " 1.5"}, "a factor of all weights"),
    "return tuple((float(s) * unit, part) for s, (part, _) in zip(strength, parts, strict=True) if s > 0.0)": (
        {"strict=True": "strict=False"},
        "there is a strength for each part",
    ),
    "walk = RandomWalk(1.0)": ({"1.0": " 2.0"}, "of twice the size, a quarter of the strength"),
    "u = np.linspace(-1.0, 1.0, len(z))": (
        {"-1.0": "- 0.0", "-1": "- 2", " 1.0, len": " 0.0, len", " 1.0, l": " 2.0, l"},
        "a parabola is one over any interval",
    ),
    "if delta < 0.25 or differenced == 3:": ({"<": "<="}, "never a quarter to the last bit"),
}
for _line, (_mutants, _why) in _CONFIDENCE.items():
    _same("characterisation.confidence", _line, _mutants, _why)

_same(
    "growth.schuler_loop",
    "terms = ((-1.0) ** k * (0.5 * 4.0**k - 2.0) * x ** (2 * k) / (factorial(2 * k) * (2 * k + 1)) "
    "for k in range(2, 10))",
    {"(2, 10)": "( 1, 10)"},
    "the first term is nought",
)
_same(
    "rotary.modulated_errors",
    "near |= np.abs(t[np.clip(np.searchsorted(t, breaks) - 1, 0, len(t) - 1)] - breaks) < 1e-9",
    {"len(t) - 1": "len(t) - 0"},
    "a place of searchsorted less one is never beyond the last",
)
_same(
    "rotary.modulated_errors",
    "parts = np.maximum(np.ceil(np.diff(stops) / step - 1e-9), 1).astype(np.int64)",
    {"1).": "0)."},
    "stops are further apart than a billionth of a step",
)
_same(
    "filtering.measurements",
    "given = np.asarray(z, dtype=np.float64).reshape(m, -1) if m else np.zeros((0, 1))",
    {"-1": "- 2"},
    _ANY_NEGATIVE,
)
_same(
    "timebase",
    "moment = calendar(epoch) + dt.timedelta(microseconds=500)  # isoformat cuts, it does not round",
    {"500": " 499"},
    "epochs are rounded to milliseconds before",
)
_same(
    "timebase",
    "moment = calendar(epoch) + dt.timedelta(microseconds=500)  # isoformat cuts, it does not round",
    {"500": " 501"},
    "epochs are rounded to milliseconds before",
)
_same(
    "frames",
    "for _ in range(2):",
    {"2": " 3"},
    "two of Bowring's steps reach rounding, a third changes what rounding does",
)
_same(
    "arrays",
    "_BLOCK = 1 << 20  # values that are looked at at a time",
    {"1 <<": "2 <<", "20": "19"},
    "how many are looked at at a time changes nothing",
)
_same("arrays", "values = array.reshape(-1)", {"-1": "- 2"}, _ANY_NEGATIVE)
_same(
    "growth.schuler_loop",
    "return np.asarray(np.where(x < 0.5, low, 1.5 * t - 2.0 * np.sin(x) / w + twice))",
    {"<": "<="},
    _BOTH_AGREE,
)
_same(
    "growth.schuler_loop",
    "return np.asarray(np.where(x < 0.05, series, t - np.sin(x) / w))",
    {"<": "<="},
    _BOTH_AGREE,
)
_same(
    "mechanization.kernels",
    "h1 = h2 = 0.0",
    {"0.0": "-1.0"},
    "before the first interval there is none: only whether it is positive is asked",
)
_same(
    "filtering.measurements",
    "given = np.asarray(z, dtype=np.float64).reshape(m, -1) if m else np.zeros((0, 1))",
    {"(0, 1)": "(0, 0)"},
    "of no measurements no values are taken",
)
_same(
    "calibration.bench.gauss_helmert",
    "values = np.array([prior[name][0] if name in prior else 0.0 for name in PARAMETERS])",
    {"else 0.0": "else -1.0"},
    "where there is no prior its sigma is infinite, and its value not used",
)
_same(
    "calibration.bench.gauss_helmert",
    "if (moved < p.tolerance and wandered < 1e-6) or (np.abs(step).max() < 1e-15 and np.abs(e).max() < 1e-13):",
    {"moved <": "moved <="},
    "a step as large as the tolerance to the last bit",
)
_same(
    "calibration.bench.gauss_helmert",
    "keep = (S[0] * RANK_TOLERANCE < S) & (uncertain <= limit)",
    {"RANK_TOLERANCE <": "RANK_TOLERANCE <="},
    "a singular value as small as the tolerance to the last bit",
)
_same(
    "calibration.bench.gauss_helmert",
    'float((q.S[0] / q.S[-1]) ** 2) if r == len(q.S) == q.Vt.shape[0] else float("inf"),',
    {"shape[0]": "shape[ -1]"},
    "a square matrix",
)
_same(
    "rotary.modulated_errors",
    "near = np.abs(t[np.clip(np.searchsorted(t, breaks), 1, len(t) - 1)] - breaks) < 1e-9",
    {"< 1e-9": "<= 1e-9"},
    "a jump a billionth of a second from a time, to the last bit",
)
