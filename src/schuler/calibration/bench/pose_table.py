"""Tables of mean readings, one row a pose: triads, one triad, or one axis beside its reference."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.bench.linear_fit import linear_fit
from schuler.calibration.bench.multiposition import calibrate_multiposition
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.sixposition import calibrate_sixposition
from schuler.calibration.magnetometer.calibrate import with_magnetometer
from schuler.calibration.result.halves import widen
from schuler.calibration.result.parameters import BIAS_G
from schuler.calibration.result.rest_scatter import rest_scatter
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import FileFormatError, InputError
from schuler.files import note_input
from schuler.plotting.notebook import Abridged
from schuler.recording.io.checks import norm_causes
from schuler.recording.io.columns import ACCEL, GYRO, MAG, SKIPS, recognise, unit_in
from schuler.recording.io.hint_texts import COUNTS, factor, parse_units
from schuler.units import G0

#: Column of references along the one axis of a table.
REFERENCE = "reference"
_GROUPS = {"a": "accel", "g": "gyro", "m": "mag"}
_SI = {"accel": "m/s^2", "gyro": "rad/s", "mag": COUNTS}  # where neither the first line nor the user states a unit
# mean readings at rest further from gravity are no sensor error but another unit
_SANE = (0.7, 1.4)


@dataclass(frozen=True, eq=False, repr=False)
class PoseTable(Abridged):
    """Mean readings of poses, SI.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (n,)
        Some of ``ax, ay, az`` [m/s^2], ``gx, gy, gz`` [rad/s], ``mx, my, mz`` [T or counts] and ``reference`` (specific
        force or rate along the one axis that is there, in its unit).
    notes : tuple of str
        Sentences on how the table was read.
    """

    columns: dict[str, FloatArray]
    notes: tuple[str, ...] = ()

    def triad(self, names: tuple[str, ...]) -> FloatArray | None:
        """Three columns, shape (n, 3), or None if one is missing."""
        return np.stack([self.columns[n] for n in names], axis=1) if all(n in self.columns for n in names) else None


def read_pose_table(path: Path | str, columns: str | None = None, units: str | None = None) -> PoseTable:
    """Read a CSV table, one row a pose.

    Parameters
    ----------
    path : Path or str
        Comma, semicolon, tab or blank separated; lines that begin with # are left out.
    columns : str, optional
        Such as ``"ax,ay,az,gx,gy,gz"``; ``-`` skips one. None: the first line says it, names and units as in logs
        (``acc_x [mg]``, ``gyro_z_dps``); others are left out, and a note says so.
    units : str, optional
        Of accelerometers and gyroscopes, ``"g,deg/s"``, or by group, ``"gyro=deg/h"``. None: as the first line states,
        else m/s^2 and rad/s.

    Raises
    ------
    FileFormatError
        If a row has another number of entries, or one that is no finite number, or the table states another unit.
    InputError
        If a unit or the columns are unknown.
    """
    place = Path(path)
    given = parse_units(units)
    note_input(place)
    try:
        text = place.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FileFormatError(f"expected a table of mean readings, one row a pose: {error}", place) from None
    lines = [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1)]
    lines = [(k, line) for k, line in lines if line and not line.startswith("#")]
    mark = next((c for c in ",;\t" if lines and c in lines[-1][1]), None)

    def cells(line: str) -> list[str]:
        return [c.strip() for c in (next(csv.reader([line], delimiter=mark)) if mark else line.split())]

    stated: dict[str, str] = {}
    notes: tuple[str, ...] = ()
    if columns is None:
        if not lines:
            raise FileFormatError("expected a first line with the names of the columns, got an empty file", place)
        names, stated, notes = _header(cells(lines[0][1]), place, lines[0][0])
        lines = lines[1:]
    else:
        names = [c.strip() for c in columns.split(",")]
    kept = [n for n in names if n not in SKIPS]
    if not kept or not set(kept) <= {*ACCEL, *GYRO, *MAG, REFERENCE} or len(set(kept)) != len(kept):
        raise InputError(
            f"columns: expected some of {', '.join((*ACCEL, *GYRO, *MAG, REFERENCE))}, each once, got {','.join(names)}"
        )
    data = _rows([(number, cells(line)) for number, line in lines], names, place)
    factors = _factors(kept, given, stated, place)
    return PoseTable({n: data[:, names.index(n)] * factors[n] for n in kept}, notes)


def _header(fields: list[str], place: Path, number: int) -> tuple[list[str], dict[str, str], tuple[str, ...]]:
    """Short names of the columns of a first line (``-``: not used), their units, and a note on those not used."""
    names, units = [], {}
    for field in fields:
        bare = field.partition("[")[0].partition("(")[0].strip().lower()
        name = bare if bare in (REFERENCE, "-") else (recognise(field) or ("-", None))[0]
        names.append(name if name in (*ACCEL, *GYRO, *MAG, REFERENCE) else "-")
        if names[-1] != "-" and (unit := unit_in(field)) is not None:
            units[name] = unit
    if twice := sorted({n for n in names if n != "-" and names.count(n) > 1}):
        raise FileFormatError(f"{twice[0]} is there more than once: say which with --table-columns", place, number)
    if set(names) <= {"-"}:
        raise FileFormatError(
            f"no sensor is recognised in the first line ({', '.join(fields)}): expected such as ax,ay,az,gx,gy,gz",
            place, number,
        )  # fmt: skip
    unused = [field for field, name in zip(fields, names, strict=True) if name == "-" and field != "-"]
    return names, units, (f"Columns not used: {', '.join(unused)}.",) if unused else ()


def _rows(lines: list[tuple[int, list[str]]], names: list[str], place: Path) -> FloatArray:
    """Numbers of the table, shape (n, columns); zero in those that are skipped."""
    rows = []
    for number, entries in lines:
        if len(entries) != len(names):
            raise FileFormatError(f"expected {len(names)} entries, got {len(entries)}", place, number)
        try:
            row = [0.0 if n in SKIPS else float(c) for n, c in zip(names, entries, strict=True)]
        except ValueError:
            raise FileFormatError(f"expected numbers, got {', '.join(entries)!r}", place, number) from None
        if not np.isfinite(row).all():
            raise FileFormatError(f"expected finite numbers, got {', '.join(entries)!r}", place, number)
        rows.append(row)
    if not rows:
        raise FileFormatError("expected one row a pose, got none", place)
    return np.array(rows)


def _factors(kept: list[str], given: dict[str, str], stated: dict[str, str], place: Path) -> dict[str, float]:
    """Factor to SI of each column; that of the reference is its axis', unless the first line states its own."""
    factors = {}
    axis = next((n for n in kept if n != REFERENCE), "ax")
    for name in (n for n in kept if n != REFERENCE):
        group = _GROUPS[name[0]]
        unit, in_file = given.get(group), stated.get(name)
        if unit and in_file and factor(unit, group) != factor(in_file, group):
            raise FileFormatError(
                f"the first line says {name} is in {in_file}, --table-units says {unit}: leave one out", place
            )
        factors[name] = factor(unit or in_file or _SI[group], group)
    own = stated.get(REFERENCE)
    factors[REFERENCE] = factors.get(axis, 1.0) if own is None else factor(own, _GROUPS[axis[0]])
    return factors


def calibrate_poses(table: PoseTable, *, gravity: float = G0, field_strength: float | None = None) -> CalibrationResult:
    """Calibrate what a table of mean readings holds.

    Parameters
    ----------
    table : PoseTable
        Accelerometers: nine poses or more of any direction, or the six faces. Gyroscopes at rest, with them or alone:
        their bias. One axis with its ``reference``: its bias and scale factor. A magnetometer beside accelerometers.
    gravity : float
        Local gravity. [m/s^2]
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]

    Returns
    -------
    CalibrationResult
        Of the triads or the axis that the table has. The noise of the means is not in a table: it is taken from the
        residuals, so six faces and nine poses, which leave hardly any, have a sigma that says so.

    Raises
    ------
    InputError
        If the columns make neither a triad nor an axis with its reference, there are too few rows, or the specific
        forces are far from gravity, which another unit makes.
    """
    axes = [n for n in (*ACCEL, *GYRO) if n in table.columns]
    if REFERENCE in table.columns:
        if len(axes) != 1:
            raise InputError(f"columns: expected one axis beside its reference, got {', '.join(axes) or 'none'}")
        one = _one_axis(axes[0], table.columns[axes[0]], table.columns[REFERENCE])
        return replace(one, verdicts=(*one.verdicts, *table.notes))
    f, omega, m = table.triad(ACCEL), table.triad(GYRO), table.triad(MAG)
    if f is None and omega is None:
        raise InputError(
            f"columns: expected ax, ay, az or gx, gy, gz, or one axis beside its reference, got {', '.join(axes)}"
        )
    results = []
    if f is not None:
        _check_unit(f, gravity)
        results.append(_accelerometers(f, gravity))
    if omega is not None:
        results.append(_bias_alone(omega))
    result = _joined(results)
    if f is not None and m is not None:
        labels = [f"pose {k + 1}" for k in range(len(m))]
        unknown = np.full(len(m), 1e-6 * float(np.linalg.norm(m, axis=1).max()))  # their scatter says it
        result = with_magnetometer(result, f, m, unknown, labels, field=field_strength)
    return replace(result, verdicts=(*result.verdicts, *table.notes))


def _check_unit(f: FloatArray, gravity: float) -> None:
    """Refuse mean readings at rest that no sensor error takes so far from gravity."""
    size = float(np.median(np.linalg.norm(f, axis=1)))
    if not _SANE[0] < size / gravity < _SANE[1]:
        causes = norm_causes(size, "m/s^2", 1.0, "rate") or "another unit, or no rests"
        raise InputError(
            f"expected a specific force of about {gravity:.4g} m/s^2 in each row, got {size:.4g} in the median: "
            f"{causes}; state units in the first line, ax [mg], or with --table-units mg,deg/s"
        )


def _poses(f: FloatArray, sigma: float) -> Poses:
    n = len(f)
    t = np.arange(0.0, 10.0 * n, 10.0)
    every = np.full((n, 3), sigma)
    return Poses(f, np.zeros((n, 3)), every, np.ones((n, 3)), t, t + 5.0)


def _accelerometers(f: FloatArray, gravity: float) -> CalibrationResult:
    """Nine parameters from magnitudes, or twelve from six faces, with the noise that the residuals show."""

    def run(sigma: float, halves: bool) -> CalibrationResult:
        if len(f) < 9:
            return calibrate_sixposition(_poses(f, sigma), gravity=gravity, gyro="none", halves=halves)
        return calibrate_multiposition(_poses(f, sigma), gravity=gravity, gyro_order=0, halves=halves)

    sigma, first = 1e-3, run(1e-3, False)
    for _ in range(2):  # the chi-square test of a stated noise does not count: it is not stated
        if first.freedom < 1 or not first.variance_of_unit_weight > 0.0:
            break
        sigma *= float(np.sqrt(first.variance_of_unit_weight))
        first = run(max(sigma, 1e-9), False)
    result = run(max(sigma, 1e-9), True)
    # the noise comes from few residuals: Student's distribution has this much more variance
    few = result.freedom / (result.freedom - 2.0) if result.freedom > 2 else 9.0
    names = [n for n in result.names if n[2] == "a"]
    k = [result.names.index(n) for n in names]
    covariance = widen(result.covariance[np.ix_(k, k)], np.full(len(k), np.sqrt(few)))
    if result.freedom < 1:
        covariance = np.diag(np.full(len(k), np.inf))
    return _with(result, tuple(names), result.values[k], covariance)


def _with(
    result: CalibrationResult, names: tuple[str, ...], values: FloatArray, covariance: FloatArray
) -> CalibrationResult:
    return replace(
        result, names=names, values=values, covariance=covariance, prior_sigma={},
        fixed={n: v for n, v in result.fixed.items() if n[2:3] == "a"}, history=None,
    )  # fmt: skip


def _bias_alone(omega: FloatArray) -> CalibrationResult:
    """Bias of gyroscopes at rest, from their scatter between the rows."""
    n = len(omega)
    if n < 3:
        raise InputError(f"rows: expected three poses or more for the bias of gyroscopes, got {n}")
    tiny = np.full((n, 3), 1e-6 * max(float(omega.std(axis=0).max()), 1e-12))
    fit = rest_scatter(np.arange(0.0, 10.0 * n, 10.0), omega, tiny)
    return CalibrationResult(
        "poses", BIAS_G, fit.values[0], np.diag(fit.covariance[:, 0, 0]), "full",
        verdicts=("Gyroscopes at rest: the mean over the poses, Earth rate in its scatter, is their bias.",),
        freedom=fit.freedom,
    )  # fmt: skip


def _one_axis(axis: str, reading: FloatArray, reference: FloatArray) -> CalibrationResult:
    """Bias and scale factor of one axis: ``reading - reference = b + M reference``."""
    letter = axis[1]
    names = (f"b_{axis[0]}_{letter}", f"M_{axis[0]}_{letter}{letter}")
    A = np.column_stack((np.ones(len(reading)), reference))
    fit = linear_fit(A, reading - reference, np.ones(len(reading)), names)
    if not fit.determined.all() or fit.freedom < 1:
        raise InputError(
            f"rows: expected three or more with different references for bias and scale factor, got {len(reading)}"
        )
    few = fit.freedom / (fit.freedom - 2.0) if fit.freedom > 2 else 9.0
    covariance = fit.covariance * max(fit.variance_of_unit_weight, 1e-24) * few
    return CalibrationResult(
        "poses", names, fit.values, covariance, "full", condition=fit.condition, freedom=fit.freedom,
        verdicts=(f"One axis, {axis}: cross-coupling and the other axes are not in the table.",),
    )  # fmt: skip


def _joined(results: list[CalibrationResult]) -> CalibrationResult:
    """Triads in one result, without correlation between them."""
    if len(results) == 1:
        return replace(results[0], method="poses")
    a, g = results
    n = len(a.names)
    covariance = np.zeros((n + len(g.names),) * 2)
    covariance[:n, :n], covariance[n:, n:] = a.covariance, g.covariance
    return replace(
        a, method="poses", names=(*a.names, *g.names), values=np.concatenate((a.values, g.values)),
        covariance=covariance, verdicts=(*a.verdicts, *g.verdicts),
    )  # fmt: skip
