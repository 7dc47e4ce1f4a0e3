"""How a calibration came about, as a table: CSV or Parquet."""

from __future__ import annotations

from pathlib import Path

from schuler import files
from schuler.arrays import FloatArray
from schuler.calibration.field.history import FieldHistory
from schuler.calibration.result.parameters import GAUGES, unit
from schuler.exceptions import InputError

FORMAT = "schuler/field-history/1"


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
