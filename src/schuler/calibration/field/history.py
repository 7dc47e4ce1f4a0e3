"""History of a calibration: parameters with uncertainties and innovations over time, and its table as a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import files
from schuler.arrays import FloatArray
from schuler.calibration.field.filter_pass import Pass, replace_start_by_prior
from schuler.calibration.field.problem import Problem
from schuler.calibration.result.parameters import GAUGES, unit
from schuler.exceptions import InputError
from schuler.filtering.engine import ForwardRun, unpack_symmetric
from schuler.filtering.measurements import DIMENSIONS, FIX, KINDS, ZERO_VELOCITY, MeasurementSchedule

FORMAT = "schuler/field-history/1"
_HELD = (FIX, ZERO_VELOCITY)  # hold the place and carry no information on the sensors


@dataclass(frozen=True)
class FieldHistory:
    """Parameters over the time of the log.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    names : tuple of str
        See :mod:`schuler.calibration.result.parameters`.
    values, sigma : ndarray, shape (k, p)
        Estimate and 1-sigma after each time, linearised at the final result. SI.
    prior_sigma : ndarray, shape (p,)
        1-sigma before the log.
    """

    t: FloatArray
    names: tuple[str, ...]
    values: FloatArray
    sigma: FloatArray
    prior_sigma: FloatArray

    @property
    def normalised(self) -> FloatArray:
        """Square root of the variance over that before the log. Shape (k, p)."""
        return np.asarray(self.sigma / self.prior_sigma)

    def reached(self, share: float = 0.1) -> dict[str, float]:
        """Time from which the uncertainty stays below a share of that before the log, by name; inf if never. [s]"""
        if not share > 0.0:
            raise InputError(f"share: expected a positive number, got {share!r}")
        above = self.normalised >= share
        times = {}
        for i, name in enumerate(self.names):
            last = np.flatnonzero(above[:, i])
            if not len(last):
                times[name] = float(self.t[0])
            elif last[-1] + 1 < len(self.t):
                times[name] = float(self.t[last[-1] + 1])
            else:
                times[name] = float("inf")
        return times


def parameter_history(problem: Problem, last: Pass, names: tuple[str, ...]) -> FieldHistory:
    """Parameters at the records of a pass, each with the prior in place of the start."""
    forward = last.run
    P = unpack_symmetric(forward.rec_P, problem.layout.size)[:, 9:, 9:]
    values, sigma = forward.rec_est.copy(), np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    if last.variance is not None:
        for k in range(len(values)):
            values[k], C = replace_start_by_prior(problem, last.start, last.variance, forward.rec_est[k], P[k])
            sigma[k] = np.sqrt(np.maximum(np.diag(C), 0.0))
    return FieldHistory(forward.rec_t, names, values, sigma, np.sqrt(problem.layout.initial_variances()))


@dataclass(frozen=True, eq=False)
class Innovations:
    """Innovations of one kind of measurement.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    z : ndarray, shape (k, d)
        Each component, measured less expected, over its own 1-sigma. [-]
    """

    t: FloatArray
    z: FloatArray


def innovations_by_kind(schedule: MeasurementSchedule, forward: ForwardRun) -> dict[str, Innovations]:
    """Innovations of the measurements that a pass used, by kind; those that hold the place are left out."""
    innovations = {}
    for kind in np.unique(schedule.kind):
        if kind in _HELD:
            continue
        d = DIMENSIONS[int(kind)]
        used = (schedule.kind == kind) & np.isfinite(forward.nis)
        z = forward.innovation[used, :d] / np.sqrt(forward.variance[used, :d])
        innovations[KINDS[int(kind)]] = Innovations(schedule.t[used], z)
    return innovations


def write_history(history: FieldHistory, path: Path | str) -> Path:
    """Write estimates and uncertainties over time.

    Parameters
    ----------
    history : FieldHistory
    path : Path or str
        ``.csv`` or ``.parquet``.

    Returns
    -------
    Path
        One row a time: ``t [s]``; for each parameter its value, ``sigma_NAME`` in the same unit, and ``left_NAME``,
        the square root of its variance over that before the log. SI, no digit lost, body axes of the gauge upper.

    Raises
    ------
    InputError
        If the suffix is another.
    MissingExtraError
        For Parquet without pyarrow (extra ``data``).
    """
    path = Path(path)
    table = _table(history)
    if path.suffix == ".parquet":
        from schuler.recording.formats.parquet import write_table

        meta = {
            "format": FORMAT, "gauge": "upper", "gauge_means": GAUGES["upper"],
            "prior_sigma": dict(zip(history.names, history.prior_sigma.tolist(), strict=True)),
        }  # fmt: skip
        return write_table(path, {name.partition(" ")[0]: values for name, values in table.items()}, meta)
    if path.suffix != ".csv":
        raise InputError(f"{path.name}: expected a name that ends in .csv or .parquet")
    # lists of Python numbers print the shortest text that reads back as the same number
    rows = zip(*(map(repr, values.tolist()) for values in table.values()), strict=True)
    return files.write_text(path, "\n".join([",".join(table), *(",".join(row) for row in rows)]) + "\n")


def _table(history: FieldHistory) -> dict[str, FloatArray]:
    columns = {"t [s]": history.t}
    left = history.normalised
    for i, name in enumerate(history.names):
        columns[f"{name} [{unit(name)}]"] = history.values[:, i]
        columns[f"sigma_{name} [{unit(name)}]"] = history.sigma[:, i]
        columns[f"left_{name} [-]"] = left[:, i]
    return columns
