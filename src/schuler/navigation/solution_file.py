"""Solutions as files: one Parquet table with the trajectory, its uncertainty and the provenance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult

FORMAT = "schuler/solution/1"


def write_solution(result: NavigationResult, path: Path | str) -> Path:
    """Write a solution.

    Parameters
    ----------
    result : NavigationResult
    path : Path or str

    Returns
    -------
    Path

    Notes
    -----
    Columns, one row for each output epoch: ``t_s``; ``lat_deg``, ``lon_deg``, ``height_m``; ``v_north_m_s`` ...;
    ``roll_deg``, ``pitch_deg``, ``yaw_deg``; ``q_eb_w`` ... ``z``; ``x_ecef_m`` ...; 1-sigma values of position,
    velocity and attitude about north, east, down, interpolated from the covariance records; the parameters with
    their sigmas, held from record to record. The metadata key ``schuler`` holds format, layout, options,
    notes and input hashes.
    """
    from schuler.recording.formats.parquet import write_table

    T = result.trajectory
    llh, v, rpy = T.llh, T.v_eb_n, T.rpy_nb
    columns: dict[str, FloatArray] = {
        "t_s": T.t, "lat_deg": llh[:, 0] / units.DEG, "lon_deg": llh[:, 1] / units.DEG, "height_m": llh[:, 2],
        "v_north_m_s": v[:, 0], "v_east_m_s": v[:, 1], "v_down_m_s": v[:, 2],
        "roll_deg": rpy[:, 0] / units.DEG, "pitch_deg": rpy[:, 1] / units.DEG, "yaw_deg": rpy[:, 2] / units.DEG,
    }  # fmt: skip
    columns |= {f"q_eb_{c}": T.q_eb[:, i] for i, c in enumerate("wxyz")}
    columns |= {f"{c}_ecef_m": T.r_eb_e[:, i] for i, c in enumerate("xyz")}
    if len(result.t):
        for block, unit, scale in (("dr", "m", 1.0), ("dv", "m_s", 1.0), ("dpsi", "deg", 1.0 / units.DEG)):
            sigma = result.sigma(block) * scale
            names = {"dr": "position", "dv": "velocity", "dpsi": "attitude"}[block]
            for i, axis in enumerate(("north", "east", "down")):
                columns[f"sigma_{names}_{axis}_{unit}"] = np.interp(T.t, result.t, sigma[:, i])
        held = np.clip(np.searchsorted(result.t, T.t + 1e-9, side="right") - 1, 0, len(result.t) - 1)
        for block in result.layout.models:
            value, sigma = result.parameter(block), result.sigma(block)
            for i in range(value.shape[1]):
                columns[f"{block}_{i}"] = value[held, i]
                columns[f"sigma_{block}_{i}"] = sigma[held, i]
    meta: dict[str, Any] = {
        "format": FORMAT,
        "smoothed": result.smoothed,
        "complete": result.complete,
        "states": result.layout.to_dict(),
        "outages": [list(w) for w in result.outages],
        "lever_arm_b_m": list(map(float, result.lever_arm_b)),
        "notes": list(result.notes),
        "provenance": {k: v for k, v in result.provenance.items() if k != "elapsed_s"},
    }
    return write_table(path, columns, meta)


def read_solution(path: Path | str) -> tuple[Trajectory, dict[str, Any]]:
    """Trajectory and metadata of a solution file.

    Parameters
    ----------
    path : Path or str
        Written by :func:`write_solution`.

    Returns
    -------
    trajectory : Trajectory
    meta : dict

    Raises
    ------
    FileFormatError
        If the file is of another kind or a newer version.
    """
    from schuler.exceptions import FileFormatError
    from schuler.recording.formats.parquet import read_table

    columns, meta = read_table(path)
    if meta.get("format") != FORMAT:
        raise FileFormatError(f"expected a solution of format {FORMAT!r}, got {meta.get('format')!r}", path)
    r = np.column_stack([columns[f"{c}_ecef_m"] for c in "xyz"])
    q = np.column_stack([columns[f"q_eb_{c}"] for c in "wxyz"])
    llh = np.column_stack([columns["lat_deg"] * units.DEG, columns["lon_deg"] * units.DEG, columns["height_m"]])
    v_n = np.column_stack([columns[f"v_{a}_m_s"] for a in ("north", "east", "down")])
    from_geodetic = Trajectory.from_geodetic(columns["t_s"], llh, v_n)
    return Trajectory(columns["t_s"], r, from_geodetic.v_eb_e, q), meta
