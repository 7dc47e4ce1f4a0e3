"""Solutions as Parquet files, and results as tables for data frames of other libraries and back, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.states import BLOCK_TEXT, StateLayout, StateModel
from schuler.navigation.result import Innovations, NavigationResult
from schuler.recording.io.own import Columns
from schuler.recording.tables.tables import Tables
from schuler.recording.trajectory import FullTrajectory, Trajectory

SOLUTION_FORMAT = "schuler/solution/1"


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

    meta: dict[str, Any] = {
        "format": SOLUTION_FORMAT,
        "smoothed": result.smoothed,
        "complete": result.complete,
        "states": result.layout.to_dict(),
        "outages": [list(w) for w in result.outages],
        "lever_arm_b_m": list(map(float, result.lever_arm_b)),
        "notes": list(result.notes),
        "provenance": {k: v for k, v in result.provenance.items() if k != "elapsed_s"},
    }
    T = result.trajectory
    return write_table(path, (_solution_columns(result, T.samples(rows)) for rows in T.blocks()), meta)


def _solution_columns(result: NavigationResult, T: FullTrajectory) -> dict[str, FloatArray]:
    """Columns of a solution file for a part of its trajectory."""
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
    return columns


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
    if meta.get("format") != SOLUTION_FORMAT:
        raise FileFormatError(f"expected a solution of format {SOLUTION_FORMAT!r}, got {meta.get('format')!r}", path)
    r = np.column_stack([columns[f"{c}_ecef_m"] for c in "xyz"])
    q = np.column_stack([columns[f"q_eb_{c}"] for c in "wxyz"])
    llh = np.column_stack([columns["lat_deg"] * units.DEG, columns["lon_deg"] * units.DEG, columns["height_m"]])
    v_n = np.column_stack([columns[f"v_{a}_m_s"] for a in ("north", "east", "down")])
    from_geodetic = Trajectory.from_geodetic(columns["t_s"], llh, v_n)
    return Trajectory(columns["t_s"], r, from_geodetic.v_eb_e, q), meta


TABLES_FORMAT = "schuler/result-tables/1"
_STATE = ("x", "y", "z", "vx", "vy", "vz", "qw", "qx", "qy", "qz")
_NED = ("north", "east", "down")
_TRAJECTORY_UNITS = {
    "t": "s", **dict.fromkeys("xyz", "m"), **dict.fromkeys(("vx", "vy", "vz", "vn", "ve", "vd"), "m/s"),
    **dict.fromkeys(("qw", "qx", "qy", "qz"), "1"), "h": "m",
    **dict.fromkeys(("lat", "lon", "roll", "pitch", "yaw"), "rad"),
}  # fmt: skip


def tables_of(result: NavigationResult) -> Tables:
    """Tables of a navigation result.

    Parameters
    ----------
    result : NavigationResult

    Returns
    -------
    Tables
        ``trajectory``: Earth-fixed position, velocity, attitude, and the same as latitude to yaw; ``records``: the
        states, parameters (``b_g_0``), 1-sigma values (``sigma_b_g_0``, navigation errors ``sigma_dr_north``) and the
        covariance (``P_i_j``, navigation errors in Earth-fixed axes; ``P_filter_i_j``, the attitude's without what is
        not known of the sensors' axes, where that counts); ``innovations``. Columns that repeat others are
        for reading. Satellite parts and what a smoother needs are left out, as in solution files.
    """
    trajectory = _state_columns(result.trajectory, with_angles=True)
    records: Columns = _state_columns(result.states)
    units = {"trajectory": _units(trajectory), "records": _units(records), "innovations": {"t": "s"}}
    for block, part in result.layout._slices.items():
        axes = _NED if part.stop <= 9 else tuple(str(i) for i in range(part.stop - part.start))
        for i, axis in enumerate(axes):
            if part.stop > 9:
                records[f"{block}_{axis}"] = result.parameters[:, part.start - 9 + i]
                units["records"][f"{block}_{axis}"] = BLOCK_TEXT[block][1]
            if len(result.t):
                records[f"sigma_{block}_{axis}"] = result.sigma(block)[:, i]
                units["records"][f"sigma_{block}_{axis}"] = BLOCK_TEXT[block][1]
    P = result.covariance_e
    n = result.layout.size
    symmetric = bool(np.array_equal(P, np.swapaxes(P, 1, 2)))
    records |= {f"P_{i}_{j}": P[:, i, j] for i in range(n) for j in range(i + 1 if symmetric else n)}
    if (own := result._attitude_e) is not None:
        records |= {f"P_filter_{i}_{j}": own[:, i, j] for i in range(3) for j in range(i + 1)}
    s = result.innovations
    innovations: Columns = {"t": s.t, "kind": s.kind, "status": s.status, "nis": s.nis}
    for i in range(3):
        innovations |= {f"innovation_{i}": s.innovation[:, i], f"sigma_{i}": s.sigma[:, i]}
    document = {
        "format": TABLES_FORMAT,
        "states": result.layout.to_dict(),
        "epochs": result.epochs,
        "propagations": result.propagations,
        "smoothed": result.smoothed,
        "complete": result.complete,
        "outages": [list(map(float, w)) for w in result.outages],
        "lever_arm_b_m": list(map(float, result.lever_arm_b)),
        "notes": list(result.notes),
        "axes_covariance_b_rad2": result.axes_covariance_b.tolist(),
        "provenance": dict(result.provenance),
    }
    return Tables({"trajectory": trajectory, "records": records, "innovations": innovations}, units, document)


def result_of(tables: Tables) -> NavigationResult:
    """Navigation result of its tables, the inverse of :func:`tables_of`.

    Parameters
    ----------
    tables : Tables
        Tables from :func:`schuler.recording.tables.pandas.tables_from_pandas` and the like.

    Returns
    -------
    NavigationResult
        Without satellite parts and without what smoothing needs; tuples of the provenance are lists.

    Raises
    ------
    InputError
        If the tables are not of a result, or a column is missing.
    """
    d = tables.document
    if d.get("format") != TABLES_FORMAT:
        raise InputError(f"expected the tables of a navigation result ({TABLES_FORMAT}), got {d.get('format')!r}")
    try:
        layout = StateLayout({name: StateModel(**model) for name, model in d["states"].items()})
        records, s = tables.columns["records"], tables.columns["innovations"]
        n = layout.size
        P = np.empty((len(records["t"]), n, n))
        for i in range(n):
            for j in range(n):
                P[:, i, j] = records[f"P_{i}_{j}" if f"P_{i}_{j}" in records else f"P_{j}_{i}"]
        own = None
        if "P_filter_0_0" in records:
            own = _stack(records, [f"P_filter_{max(i, j)}_{min(i, j)}" for i in range(3) for j in range(3)])
        names = [f"{b}_{i}" for b in layout.models for i in range(layout[b].stop - layout[b].start)]
        return NavigationResult(
            trajectory=_trajectory(tables.columns["trajectory"]),
            t=np.asarray(records["t"], dtype=np.float64),
            states=_trajectory(records),
            parameters=_stack(records, names),
            covariance_e=P,
            innovations=Innovations(
                np.asarray(s["t"], dtype=np.float64),
                np.asarray(s["kind"], dtype=np.int64),
                np.asarray(s["status"], dtype=np.int64),
                np.asarray(s["nis"], dtype=np.float64),
                _stack(s, [f"innovation_{i}" for i in range(3)]),
                _stack(s, [f"sigma_{i}" for i in range(3)]),
            ),
            layout=layout,
            epochs=int(d["epochs"]),
            propagations=int(d["propagations"]),
            smoothed=bool(d["smoothed"]),
            complete=bool(d["complete"]),
            outages=tuple((float(a), float(b)) for a, b in d["outages"]),
            lever_arm_b=np.array(d["lever_arm_b_m"], dtype=np.float64),
            provenance=dict(d["provenance"]),
            notes=tuple(map(str, d["notes"])),
            axes_covariance_b=np.array(d.get("axes_covariance_b_rad2", np.zeros((3, 3))), dtype=np.float64),
            _attitude_e=None if own is None else own.reshape(-1, 3, 3),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"these tables are of no complete navigation result ({error!r}); make them anew") from error


def _state_columns(T: FullTrajectory, *, with_angles: bool = False) -> Columns:
    columns: Columns = {"t": T.t}
    columns |= dict(zip(_STATE, np.hstack((T.r_eb_e, T.v_eb_e, T.q_eb)).T, strict=True))
    if with_angles:
        names = ("lat", "lon", "h", "vn", "ve", "vd", "roll", "pitch", "yaw")
        columns |= dict(zip(names, np.hstack((T.llh, T.v_eb_n, T.rpy_nb)).T, strict=True))
    return columns


def _trajectory(columns: Columns) -> FullTrajectory:
    state = _stack(columns, list(_STATE))
    return FullTrajectory(np.asarray(columns["t"], dtype=np.float64), state[:, :3], state[:, 3:6], state[:, 6:])


def _units(columns: Columns) -> dict[str, str]:
    return {name: _TRAJECTORY_UNITS[name] for name in columns}


def _stack(columns: Columns, names: list[str]) -> FloatArray:
    rows: Any = columns["t"]
    return np.stack([columns[c] for c in names], axis=1).astype(np.float64) if names else np.zeros((len(rows), 0))
