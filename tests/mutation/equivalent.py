"""Mutants that no test can tell from the original, and why.

Keys: module, the line as it is, the line as it is in the mutant.
"""

_ANY_NEGATIVE = "numpy takes any negative length in reshape for the one that is left"

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
