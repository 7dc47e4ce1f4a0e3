"""Noise terms of Allan curves that were computed elsewhere: averaging times and deviations in a table."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.axis_noise import estimates_of, fit_findings
from schuler.characterisation.fitting import Weights
from schuler.characterisation.moments import Moments
from schuler.characterisation.records import read_off, with_bounds
from schuler.characterisation.result import AXES, AxisNoise, Estimate, Finding
from schuler.characterisation.selection import select
from schuler.characterisation.simulation_model import terms_of_fit
from schuler.exceptions import FileFormatError, InputError
from schuler.files import note_input

_SPACING = 1.9  # least ratio of averaging times fitted; closer ones hardly tell anything new
_FEWEST = 5  # of them
_OFF_GRID = 0.05  # of an averaging time, by which it may miss a multiple of a sample; others are not fitted
_SEPARATOR = re.compile(r"\s*[,;\t]\s*|\s+")


def identify_curve(
    tau: ArrayLike,
    deviation: ArrayLike,
    *,
    axis: str = "gyro_x",
    duration_s: float | None = None,
    rate_hz: float | None = None,
    method: Literal["gmwm", "allan"] = "gmwm",
    models: tuple[str, ...] | None = None,
) -> AxisNoise:
    """Identify the noise behind an overlapping Allan deviation that was computed elsewhere.

    Parameters
    ----------
    tau : array_like, shape (k,)
        Averaging times, increasing. Those that are multiples of a sample, to 5 %, are fitted: all long ones. [s]
    deviation : array_like, shape (k,)
        Overlapping Allan deviation of angular rate [rad/s] or specific force [m/s^2].
    axis : str
        Name of the axis, one of :data:`.result.AXES`, which also tells the unit.
    duration_s : float, optional
        Length of the log, which decides how far the curve can be believed. Left out: twice the longest averaging time,
        the shortest log that has it. [s]
    rate_hz : float, optional
        Sampling rate. Left out: one sample in the shortest averaging time. [Hz]
    method, models
        See :func:`.identification.identify_noise`.

    Returns
    -------
    AxisNoise
        Its mean is not known (NaN), and of the log no fault can be seen.

    Raises
    ------
    InputError
        If the curve is no curve, or too short.
    NoFitError
        If no model can be fitted.
    """
    t, d = as_floats(tau, "tau"), as_floats(deviation, "deviation")
    if t.ndim != 1 or t.shape != d.shape:
        raise InputError(f"expected as many deviations as averaging times, got shapes {t.shape} and {d.shape}")
    if axis not in AXES:
        raise InputError(f"axis: expected one of {', '.join(AXES)}, got {axis!r}")
    if not (np.all(np.isfinite(t) & np.isfinite(d)) and np.all(t > 0.0) and np.all(d > 0.0) and np.all(np.diff(t) > 0)):
        raise InputError("expected averaging times that increase and deviations, all of them positive and finite")
    for name, number in (("duration_s", duration_s), ("rate_hz", rate_hz)):
        if number is not None and not (np.isfinite(number) and number > 0.0):
            raise InputError(f"{name}: expected a positive number, got {number}")
    dt = float(t[0]) if rate_hz is None else 1.0 / rate_hz
    duration = 2.0 * float(t[-1]) if duration_s is None else duration_s
    if duration < 2.0 * t[-1] * (1.0 - 1e-9):
        raise InputError(
            f"duration_s: a log of {duration:g} s has no Allan deviation at {t[-1]:g} s; expected {2.0 * t[-1]:g} s "
            "or more"
        )
    m = np.round(t / dt).astype(np.int64)
    if m[0] < 1:
        raise InputError(f"rate_hz: a sample of {dt:g} s is longer than the shortest averaging time, {t[0]:g} s")
    kept: list[int] = []
    for k in np.flatnonzero(np.abs(m * dt / t - 1.0) < _OFF_GRID).tolist():
        if not kept or m[k] >= _SPACING * m[kept[-1]]:
            kept.append(k)
    if len(kept) < _FEWEST:
        raise InputError(
            f"expected averaging times over at least {_FEWEST} octaves, multiples of {dt:g} s (one sample), got "
            f"{len(kept)} such from {t[0]:g} to {t[-1]:g} s"
        )
    samples = round(duration / dt)
    data = Moments(m[kept], np.square(d[kept]), dt, np.array([samples]))
    weights: Weights = "full" if method == "gmwm" else "diagonal"
    selection = select(data, models, weights)
    model = terms_of_fit(selection.fit, dt)
    unknown: FloatArray = np.full(len(t), np.nan)
    count = np.maximum(samples - 2 * m + 1, 1)
    bare = AllanCurve(t, d, unknown, unknown, unknown, count, unknown, "overlapping", 0.95, 1.0 / dt, samples)
    unit = "rad/s" if axis.startswith("gyro") else "m/s^2"
    findings = []
    if duration_s is None or rate_hz is None:
        assumed = [f"a log of {duration:g} s, the shortest with this curve"] if duration_s is None else []
        assumed += [f"{1.0 / dt:g} Hz, one sample in its shortest averaging time"] if rate_hz is None else []
        findings.append(Finding("assumed", f"{axis}: taken as {' at '.join(assumed)}", severity="note"))
    findings += fit_findings(axis, selection, dt, duration, "that of the terms")
    estimates, names = estimates_of(selection, unit), selection.fit.names
    wider = np.array([selection.spreads[name].sigma for name in names]) / selection.fit.sigma
    curve = with_bounds(bare, data, model)
    return AxisNoise(
        axis=axis, unit=unit, rate_hz=1.0 / dt, duration_s=duration,
        mean=Estimate(np.nan, np.nan, np.nan, np.nan, unit), curve=curve,
        terms={n: estimates[n] for n in names if n in "QNBKR" and not (n == "Q" and selection.shortest > 1)},
        gauss_markov=tuple((estimates[n], estimates["tau" + n[5:]]) for n in names if n.startswith("sigma")),
        model=model, names=tuple("V" if n == "Q" and selection.shortest > 1 else n for n in names),
        covariance=selection.fit.covariance * np.outer(wider, wider),
        limits={n: s.high for n, s in selection.spreads.items() if n not in names},
        candidates=selection.candidates, read_off=read_off(curve),
        method={"gmwm": "generalised method of wavelet moments", "allan": "weighted fit"}[method] + " on a given curve",
        findings=tuple(findings),
    )  # fmt: skip


def is_curve_file(path: Path, columns: str | None = None) -> bool:
    """Whether a text file is a table of an Allan curve: its first column is the averaging time, ``tau``."""
    if columns is not None:
        return columns.strip().lower().startswith("tau")
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        head = stream.read(4096)
    first = head.decode("latin-1").lstrip("\ufeff# \t").splitlines()[:1]
    return b"\x00" not in head and bool(first) and re.match(r"tau\b|tau_|tau\[", first[0].lower()) is not None


def read_curves(path: Path, columns: str | None = None) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Averaging times and columns of deviations of a text file.

    Parameters
    ----------
    path : Path
        A table with a header whose first column is ``tau`` [s]; numbers apart by comma, semicolon, tab or blanks.
    columns : str, optional
        Names of the columns instead of the header, ``tau,gyro_x,gyro_y``; ``-`` skips one.

    Returns
    -------
    tau : ndarray, shape (k,)
        [s]
    deviations : dict of str to ndarray, shape (k,)
        By name; columns whose name is that of a bound, a count or an error are left out.

    Raises
    ------
    FileFormatError
        With the first line that is no row of numbers.
    """
    note_input(path)
    lines = path.read_text(encoding="latin-1").lstrip("\ufeff").splitlines()
    rows = [(k, _SEPARATOR.split(text.strip().lstrip("# "))) for k, text in enumerate(lines, 1) if text.strip()]
    names = [name.strip().lower() for name in columns.split(",")] if columns is not None else []
    values: list[list[float]] = []
    for number, fields in rows:
        try:
            row = [float(field) for field in fields if field]
        except ValueError:
            if values:
                got = " ".join(fields)[:60]
                raise FileFormatError(f"expected a row of numbers, got {got!r}", path, number) from None
            names = names or [field.lower() for field in fields]
            continue
        if values and len(row) != len(values[0]):
            raise FileFormatError(f"expected {len(values[0])} numbers, got {len(row)}", path, number)
        values.append(row)
    if not values or len(names) != len(values[0]) or len(names) < 2:
        width = len(values[0]) if values else 0
        raise FileFormatError(
            f"expected a table whose columns are named, tau first: {len(names)} names for {width} columns; say "
            "columns='tau,gyro_x,...'", path
        )  # fmt: skip
    table = np.array(values)
    skipped = ("low", "high", "err", "count", "edf", "model", "sigma", "min", "max", "n")
    return table[:, 0], {
        name: table[:, k]
        for k, name in enumerate(names)
        if k and name != "-" and not any(word in re.split(r"[^a-z]+", name) for word in skipped)
    }
