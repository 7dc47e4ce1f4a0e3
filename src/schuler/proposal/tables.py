"""Columns of a table whose header does not name them, told by what the numbers do."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import SchulerError
from schuler.proposal import arrays
from schuler.recording.io import columns, dates, header_words, lines, text_head
from schuler.recording.io.hints import ReadHints
from schuler.timebase import WEEK_S
from schuler.units import G0, QUANTITIES, factor_for, parse_unit

_ROWS = 20_000  # rows that are looked at
_BLOCK = 20  # samples whose mean norm is compared
_STEADY = 0.08  # spread of the norm of gravity among the calm half of the blocks, as a share of it
_CLEARLY = 4.0  # times that the other sensor's norm spreads more
#: Units of a counter, and the steps of an IMU's samples in it: 8 Hz to 4 kHz do not overlap from one to the next.
_TIME_UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
_GRAVITY = 0.7  # logarithm of the median norm over gravity's that motion and a poor scale make
_THOUSANDTHS = 0.15  # the same where they are thousandths of a g, between which and counts of 2048 in one there is more
_POOR_SCALE = 0.15
_FASTEST_S, _SLOWEST_S = 1.0 / 4000.0, 1.0 / 8.0
_COUNTS_PER_G = (2048.0, 4096.0, 8192.0, 16384.0)  # of 16 bits over 16, 8, 4 and 2 g
_UNIT_NORM = 1e-3  # digits of a written quaternion
_WIDEST, _HIGHEST_M = 20, 9000.0  # columns of a table of fixes, and heights of vehicles
_HELD = 0.5  # share of samples over which a receiver's time is held
_COUNTED = 0.99  # share of steps of one that make a counter of rows, which may begin again
_SAME_RATE = 0.01  # share by which clocks of one table may run apart
_RISING = 0.9  # share of rows of fixes that come later than the one before
_UNIX_S = (1e9, 2.1e9)  # the years 2001 to 2036
_WEEKS = (1100, 2950)  # of GPS, the same years


def imu_columns(path: Path) -> tuple[str, str] | None:
    """Hint ``columns`` of a table of an IMU without a usable header, and how it was told.

    Parameters
    ----------
    path : Path

    Returns
    -------
    columns, evidence : str
        None if the file is no table, or its numbers leave it open: gravity has a constant norm in calm moments, which
        makes the accelerometer; the gyroscope's is nearly nothing then. A bias that is constant at rest is told from
        gravity by what turns make of its norm. Time increases.
    """
    values = _numbers(path)
    if values is None or len(values) < 20 * _BLOCK:
        return None
    clock = [k for k in range(values.shape[1]) if is_clock(values[:, k])]
    if not clock and (np.diff(values, axis=0).min(axis=0) >= 0.0).any() and values.shape[1] == 7:
        return None  # a counter of rows
    attitude = _attitude(values)
    if attitude:
        attitude = attitude | _gravity_and_rest(values, attitude)
    idle = attitude | set(np.flatnonzero(np.ptp(values, axis=0) == 0.0).tolist()) | _of_others(path)
    others = [k for k in range(values.shape[1]) if k not in clock and k not in idle]
    triads = [(k, k + 1, k + 2) for k in others if k + 1 in others and k + 2 in others]
    calm = {trio: _spread(values[:, trio]) for trio in triads}
    pairs = [
        (a, g)
        for a, g in itertools.permutations(triads, 2)
        if (_is_gravity(values[:, a]) or (calm[a] < _STEADY and len(others) <= 8))
        and not set(a) & set(g)
        and _aligned(a, g, others, n_attitude=len(attitude))
    ]
    if not pairs or (len(others) > 8 and len({a for a, _ in pairs}) > 1):
        return None  # of three triads only one may be gravity
    lively = {trio: _spread(values[:, trio], calm=False) for trio in triads}
    # a gyroscope's bias is as constant at rest as gravity, but turns change its norm
    for spread in (lively, calm):
        ratio, accel, gyro = max((spread[g] / max(spread[a], 1e-12), a, g) for a, g in pairs)
        if ratio >= _CLEARLY and lively[gyro] >= lively[accel]:
            break
    else:
        return None
    if _is_gravity(values[:, gyro]) and not _is_gravity(values[:, accel]):
        return None
    names = ["-"] * values.shape[1]
    if clock:
        names[clock[0]] = "t"
    for stem, trio in (("a", accel), ("g", gyro)):
        for axis, k in zip(_letters(path, trio), trio, strict=True):
            names[k] = f"{stem}{axis}"
    evidence = (
        f"the norm of columns {accel[0] + 1} to {accel[2] + 1} stays near gravity's (spread "
        f"{100.0 * spread[accel]:.2g} %), that of columns {gyro[0] + 1} to {gyro[2] + 1} does not "
        f"({100.0 * spread[gyro]:.2g} %)"
    )
    return ",".join(names), evidence


def _fields(path: Path) -> list[str]:
    """Fields of a table's header; none of an array, or of a table without one."""
    opening = None if arrays.array(path) is not None else text_head.open_text(path, ReadHints())
    return [] if opening is None or opening.header is None else opening.header[1]


def _letters(path: Path, trio: Sequence[int]) -> str:
    """Axes of three columns: the letters that names of a header end in, which may be z, y, x, or x, y, z."""
    fields = _fields(path)
    ends = "".join(fields[k].strip(" \"'")[-1:].lower() for k in trio if k < len(fields))
    return ends if sorted(ends) == ["x", "y", "z"] else "xyz"


def _of_others(path: Path) -> set[int]:
    """Columns whose header states a unit of lengths, say, that no reading of an IMU has."""
    fields = _fields(path)
    return {k for k, unit in enumerate(map(columns.unit_in, fields)) if unit is not None and not _of_imu(unit)}


def _of_imu(unit: str) -> bool:
    """Whether a unit is one of rates or increments, or none that is known: counts."""
    try:
        dimension = parse_unit(unit).dimension
    except SchulerError:
        return True
    return dimension in [QUANTITIES[q][0] for q in ("specific force", "angular rate", "velocity", "angle")]


def fix_columns(path: Path) -> tuple[str, str] | None:
    """Hint ``columns`` of a table of fixes without a header, and how it was told: clock, latitude, longitude, height.

    Parameters
    ----------
    path : Path

    Returns
    -------
    columns, evidence : str
        None if the file is no table, or no three columns or several go on as a path in degrees and metres does.
    """
    values = _numbers(path)
    if (
        values is None
        or len(values) < _BLOCK
        or values.shape[1] > _WIDEST
        or text_head.open_text(path, ReadHints()).header
    ):
        return None
    places = [at for k in range(values.shape[1] - 2) if _is_path(values[:, at := _place(path, values, k)])]
    of_place = {k for at in places for k in at}  # which may increase as steadily as a clock
    clock = [k for k in range(values.shape[1]) if k not in of_place and is_clock(values[:, k])]
    if not clock and (week := gps_week(path)) is not None:  # once a second it counts like a counter of rows
        clock = [week[0]]
    if len(clock) != 1 or len(places) != 1:
        return None
    names = ["-"] * values.shape[1]
    names[clock[0]] = "t"
    lat, lon, h = places[0]
    names[lat], names[lon], names[h] = "lat", "lon", "h"
    if h > lon + 1:
        names[h - 1], names[h + 1] = "radius", "sd"
    return ",".join(names), f"columns {lat + 1}, {lon + 1}, {h + 1} go on as latitude, longitude, height of a path do"


def gps_week(path: Path) -> tuple[int, int] | None:
    """Column of the seconds of a GPS week behind a column of that week, and the week of the first row.

    Parameters
    ----------
    path : Path

    Returns
    -------
    (int, int) or None
        None unless one column holds whole numbers of weeks since 2001 and the next one seconds that increase.
    """
    values = _numbers(path)
    if values is None or len(values) < _BLOCK:
        return None
    for k in range(values.shape[1] - 1):
        week, second = values[:, k], values[:, k + 1]
        weeks = (week == np.round(week)).all() and _WEEKS[0] < week.min() <= week.max() < _WEEKS[1]
        seconds = second.min() >= 0.0 and second.max() <= WEEK_S and (np.diff(second) > 0.0).mean() > _RISING
        if weeks and seconds:
            return k + 1, int(week[0])
    return None


def _place(path: Path, values: FloatArray, k: int) -> list[int]:
    """Columns of latitude, longitude and height from one on; a phone's locations have accuracies about the height."""
    last = values[:, k + 2 :]
    if "location" in path.stem.lower() and last.shape[1] == 3 and (last[:, [0, 2]] > 0.0).all():
        kinds = [len(np.unique(x)) for x in last.T]
        if kinds[1] > 2 * max(kinds[0], kinds[2]):
            return [k, k + 1, k + 3]
    return [k, k + 1, k + 2]


def _is_path(x: FloatArray) -> bool:
    """Whether three columns are degrees of latitude and longitude with decimals, and metres of height. Shape (n, 3)."""
    lat, lon, h = x.T
    if (
        np.abs(lat).max() > 90.0
        or np.abs(lon).max() > 180.0
        or np.abs(h).max() > _HIGHEST_M
        or np.ptp(h) > 0.3 * _HIGHEST_M
    ):
        return False
    steps, spans = np.abs(np.diff(x[:, :2], axis=0)), np.ptp(x[:, :2], axis=0)
    return bool(
        (spans > 0.0).all()
        and (spans < 5.0).all()
        and (steps.max(axis=0) < 0.02).all()
        and (np.abs(x[:, :2] - np.round(x[:, :2], 4)) > 0.0).mean() > 0.5
        and np.abs(np.diff(h)).mean() > 10.0 * steps.mean()
    )


def clock_column(path: Path, names: Sequence[str]) -> int | None:
    """The column without a known name that increases like a clock, by steps of an IMU's samples in some unit.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Of all columns; a hyphen where the header's is not known.

    Returns
    -------
    int or None
        None where a column is the time already, unless that one is held over most samples, as a receiver's is. Of
        several that run together the one that is called the IMU's, or the first.
    """
    needed = [k for k, name in enumerate(names) if name in columns.ACCEL]  # rows between fixes have their fields empty
    if not needed:
        return _unix_column(path, names)
    values = _numbers(path, needed)
    if values is None or len(values) < _BLOCK or values.shape[1] != len(names):
        return None
    if "t" in names:
        held = _numbers(path, [*needed, names.index("t")])
        if held is None or len(held) < _BLOCK or (np.diff(held[:, names.index("t")]) == 0.0).mean() < _HELD:
            return None
    clocks: dict[int, FloatArray] = {}  # steps in seconds
    unix: list[int] = []
    for k in [k for k, name in enumerate(names) if name == "-"]:
        each = _numbers(path, [*needed, k])
        if each is None or len(each) <= 0.9 * len(values) or not is_clock(each[:, k]):
            continue
        if (unit := time_unit(each[:, k])) is not None:
            clocks[k] = dict(_TIME_UNITS)[unit[0]] * np.diff(each[:, k])
            unix += [k] if unit[1] is not None else []
    if len(clocks) < 2:
        return next(iter(clocks), None)
    evenest = min(clocks, key=lambda k: float(np.std(clocks[k])))
    steps = clocks[evenest]
    if any(len(x) != len(steps) or abs(x.sum() / steps.sum() - 1.0) > _SAME_RATE for x in clocks.values()):
        return None
    together = [k for k, x in clocks.items() if np.allclose(x, steps, atol=0.1 * float(steps.mean()))]
    opening = text_head.open_text(path, ReadHints())
    called = [] if opening.header is None else [header_words.words_of(field) for field in opening.header[1]]
    likely = [k for k in together if k < len(called) and "imu" in called[k]] or [k for k in together if k in unix]
    return (likely or together)[0]  # one that jitters more is when the rows came


def _unix_column(path: Path, names: Sequence[str]) -> int | None:
    """The first column without a known name that holds Unix time, of a table of fixes without another time."""
    if "t" in names or "lat" not in names:
        return None
    for k in [k for k, name in enumerate(names) if name == "-"]:
        t = column(path, k)
        if t is not None and len(t) > 1 and unix_unit(t) is not None and (np.diff(t) > 0.0).mean() > _RISING:
            return k
    return None


def time_unit(t: FloatArray) -> tuple[str, str | None] | None:
    """Unit of an IMU's stamps by their step, and the hint ``time`` where their size tells.

    Parameters
    ----------
    t : ndarray, shape (n,)
        As written.

    Returns
    -------
    unit : str
    time : str or None
        ``unix`` for stamps of this century; None for a counter.
    """
    step = float(np.median(np.diff(t))) if len(t) > 1 else np.nan
    for unit, second in _TIME_UNITS:
        if _FASTEST_S <= step * second <= _SLOWEST_S:
            unix = _UNIX_S[0] <= float(t[0]) * second <= _UNIX_S[1]
            return unit, "unix" if unix else None
    return None


def unix_unit(t: FloatArray) -> str | None:
    """Unit in which stamps are Unix time of this century, by their size; None if they are none.

    Parameters
    ----------
    t : ndarray, shape (n,)
        As written.
    """
    sizes = [] if not len(t) else [u for u, second in _TIME_UNITS if _UNIX_S[0] <= float(t[0]) * second <= _UNIX_S[1]]
    return sizes[0] if sizes else None


def column(path: Path, index: int) -> FloatArray | None:
    """One column of a text table, at most its first rows. Shape (n,)."""
    values = _numbers(path, [index])
    return None if values is None or not 0 <= index < values.shape[1] else values[:, index]


def norm(path: Path, accel: Sequence[int]) -> float:
    """Median norm of specific force, in whatever unit.

    Parameters
    ----------
    path : Path
    accel : sequence of int
        Its columns.
    """
    values = _numbers(path, accel)
    if values is None or not len(values) or max(accel) >= values.shape[1]:  # a header of more fields than its rows
        return float("nan")
    with np.errstate(over="ignore"):  # damaged rows may hold anything
        return float(np.median(np.linalg.norm(values[:, accel], axis=1)))


def is_gravity(path: Path, accel: Sequence[int]) -> bool:
    """Whether the norm of specific force is gravity's in some unit; true of a table too short to tell.

    Parameters
    ----------
    path : Path
    accel : sequence of int
        Its columns.
    """
    values = _numbers(path, accel)
    if values is None or len(values) < _BLOCK or max(accel) >= values.shape[1]:
        return True
    with np.errstate(over="ignore", invalid="ignore"):  # damaged rows may hold anything
        return _is_gravity(values[:, accel])


def accel_unit(size: float) -> str:
    """Unit in which gravity has about a norm; m/s^2 where it is none of the usual ones.

    Counts may be near thousandths of a g: these have to fit better, and what does not is judged by gravity at rest.

    Parameters
    ----------
    size : float
    """
    near = {unit: abs(np.log(size * factor_for(unit, "specific force") / G0)) for unit in ("m/s^2", "g", "mg")}
    unit = min(near, key=lambda name: near[name])
    return unit if near[unit] < (_THOUSANDTHS if unit == "mg" else _GRAVITY) else "m/s^2"


def _numbers(path: Path, needed: Sequence[int] | None = None) -> FloatArray | None:
    """First rows of a text table or an array in which all columns are numbers, or those needed; None if it is none."""
    if (whole := arrays.array(path)) is not None:
        return whole[:_ROWS]
    state = path.stat()
    rows = _first_rows(path, state.st_mtime_ns, state.st_size)
    if rows is None:
        return None
    width = len(rows)
    used = list(range(width)) if needed is None else [k for k in needed if 0 <= k < width]
    values = np.full((len(rows[0]), width), np.nan)  # words in a column that is not needed say nothing of the others
    for k in used:
        values[:, k] = _numbers_in(path, state.st_mtime_ns, state.st_size, k)
    sound: BoolArray = np.isfinite(values[:, used]).all(axis=1)
    return values[sound]


@functools.lru_cache(maxsize=1)
def _first_rows(path: Path, _changed_ns: int, _size: int) -> list[tuple[str, ...]] | None:
    """Fields of the first rows of a text table by column, kept for one file: it is asked for many columns in turn."""
    try:
        opening = text_head.open_text(path, ReadHints())
    except SchulerError:
        return None
    width = len(opening.fields)
    rows = [fields for _, fields in itertools.islice(opening.table.rows(), _ROWS) if len(fields) == width]
    return list(zip(*rows, strict=True)) if rows else [()] * width


@functools.lru_cache(maxsize=64)
def _numbers_in(path: Path, changed_ns: int, size: int, k: int) -> FloatArray:
    """Column ``k`` of the first rows, NaN for what is no number."""
    rows = _first_rows(path, changed_ns, size)
    assert rows is not None
    values = np.full(len(rows[k]), np.nan)
    for row, field in enumerate(rows[k]):
        number = field if lines.is_number(field) else _seconds(field) if _is_stamp(field) else ""
        if lines.is_number(number):
            values[row] = float(number)
    return values


def _is_stamp(field: str) -> bool:
    return dates.is_date(field) or dates.is_clock(field) or dates.is_day(field)


def _seconds(field: str) -> str:
    """A date as Unix time, a time of day in its seconds, a day as nothing, any other field as it is. [s]"""
    if dates.is_clock(field):
        return f"{dates.seconds_of_day([field])[0][0]:.6f}"
    if dates.is_day(field):
        return "0"
    ns, _, bad = dates.unix_ns([field]) if dates.is_date(field) else (None, True, 0)
    return field if ns is None or bad is not None else f"{ns[0] / dates.NS:.6f}"


def is_clock(x: FloatArray) -> bool:
    """Whether a column increases like a clock: nearly always, by steps of nearly one size, not as a counter of rows.

    Parameters
    ----------
    x : ndarray, shape (n,)
    """
    step = np.diff(x)
    usual = float(np.median(step))
    if usual <= 0.0 or np.mean(step > 0.0) < 0.98:
        return False
    near = np.abs(step - usual) < 0.8 * usual
    counts = usual == 1.0 and (step == 1.0).mean() > _COUNTED and (x == np.round(x)).all()
    return bool(near.mean() > 0.9 and not counts)


def _attitude(values: FloatArray) -> set[int]:
    """Four columns in a row that are a quaternion of norm one."""
    for k in range(values.shape[1] - 3):
        if np.all(np.abs(np.linalg.norm(values[:, k : k + 4], axis=1) - 1.0) < _UNIT_NORM):
            return set(range(k, k + 4))
    return set()


def _gravity_and_rest(values: FloatArray, attitude: set[int]) -> set[int]:
    """Three columns in a row that are the plumb line by an attitude, of one norm, and those that are the rest."""
    width = values.shape[1]
    apart = [k for k in range(width - 2) if not attitude & {k, k + 1, k + 2}]
    norms = {k: np.linalg.norm(values[:, k : k + 3], axis=1) for k in apart}
    plumb = [k for k, norm in norms.items() if np.ptp(norm) < _UNIT_NORM * G0 and 0.5 < np.median(norm) < 11.0]
    if len(plumb) != 1:
        return set()
    k = plumb[0]
    left = [a for a in range(width - 2) if not set(range(a, a + 3)) & set(range(k, k + 3))]
    down = values[:, k : k + 3]
    rest = {
        j for a in left for i in left
        if i != a and np.abs(values[:, a : a + 3] - down - values[:, i : i + 3]).max() < _UNIT_NORM
        for j in range(i, i + 3)
    }  # fmt: skip
    return set(range(k, k + 3)) | rest if rest else set()


def _spread(x: FloatArray, calm: bool = True) -> float:
    """Spread of block means' norm over its median: in the calmer half of the blocks, or in both extreme tenths."""
    n = len(x) // _BLOCK
    blocks = x[: n * _BLOCK].reshape(n, _BLOCK, 3)
    order = np.argsort(blocks.std(axis=1).sum(axis=1))
    chosen = order[: n // 2] if calm else np.concatenate((order[: n // 10], order[-(n // 10) :]))
    norm = np.linalg.norm(blocks.mean(axis=1), axis=1)[chosen]
    middle = float(np.median(norm))
    return float(np.subtract(*np.quantile(norm, (0.9, 0.1))) / middle) if middle > 0.0 else np.inf


def _is_gravity(x: FloatArray) -> bool:
    """Whether the norm is gravity's in a unit of accelerometers or counts, to a poor scale factor.

    In the median, or in that of the calmest tenth of the blocks: the stances of a runner.
    """
    blocks = x[: len(x) // _BLOCK * _BLOCK].reshape(-1, _BLOCK, 3)
    calmest = np.argsort(blocks.std(axis=1).sum(axis=1))[: max(len(blocks) // 10, 1)]
    usual = [factor_for(unit, "specific force") / G0 for unit in ("m/s^2", "g", "mg")]
    factors = np.array([*usual, *(1.0 / counts for counts in _COUNTS_PER_G)])
    sizes = [np.median(np.linalg.norm(part, axis=-1)) for part in (x, blocks[calmest].mean(axis=1))]
    return bool((np.abs(np.outer(sizes, factors) - 1.0) < _POOR_SCALE).any())


def _aligned(accel: tuple[int, ...], gyro: tuple[int, ...], others: list[int], *, n_attitude: int) -> bool:
    """Whether the triads fill the columns that are no clock, x, y, z of each in order.

    But for a temperature or two, or a third triad, of magnetometers, with a temperature at the end; beside a
    quaternion its angles may come before them.
    """
    first, second = sorted((others.index(accel[0]), others.index(gyro[0])))
    rest = len(others) - 6
    if n_attitude > 4 and (first, second) == (0, 3) and rest <= 6:  # beside the plumb line, too
        return True
    if n_attitude and rest in (6, 7):
        return (first, second) == (3, 6)
    if rest in (3, 4):
        return (first, second) in ((0, 3), (0, 6), (3, 6))
    return (first, second) in ((0, 3), (0, 4), (1, 4)) and rest <= 2
