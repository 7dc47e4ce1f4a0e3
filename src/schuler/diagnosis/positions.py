"""Positions against velocities of the same receiver: units, order, axes and signs of both.

The displacement over some seconds is regressed on the integral of the velocity. The 2 x 2 matrix between them is the
unit matrix in a good log; each usual fault has one of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis.findings import Finding
from schuler.diagnosis.motion import position_velocity
from schuler.recording.series import GnssSeries

_BASE_S = 4.0  # displacements are taken over so long, for the noise of positions
_SPEED_UNITS = {"km/h": units.KMH, "kn": units.KNOT, "cm/s": 0.01, "mm/s": 0.001, "ft/s": units.FT}


@dataclass(frozen=True)
class GnssView:
    """What of a GNSS log can be trusted for motion.

    Attributes
    ----------
    t : ndarray, shape (n,)
    v_n : ndarray, shape (n, 3)
        Velocity to compare the IMU with, corrected where its fault is plain. [m/s]
    source : str
        "velocity", "corrected velocity" or "position".
    other : tuple of ndarray, optional
        Times and velocities of the other one of positions and velocities, if it is good.
    mirrored : bool
        Positions and velocities are mirror images; the IMU tells which is right.
    """

    t: FloatArray
    v_n: FloatArray
    source: str
    other: tuple[FloatArray, FloatArray] | None = None
    mirrored: bool = False


def displacement_matrix(
    t: FloatArray, v_n: FloatArray, t_r: FloatArray, v_r: FloatArray
) -> tuple[FloatArray, float, float, float, int]:
    """Least squares ``v_n = M v_r`` of horizontal displacements, and of the vertical ones.

    Parameters
    ----------
    t, v_n : ndarray, shapes (n,), (n, 3)
        Velocity.
    t_r, v_r : ndarray, shapes (m,), (m, 3)
        Velocity from positions.

    Returns
    -------
    M : ndarray, shape (2, 2)
    r2 : float
        Share of the displacement's variance that M explains.
    down : float
        Factor of the vertical.
    down_r : float
        Correlation of the vertical.
    n : int
        Pairs used, 0 if there is too little motion.
    """
    a, b = max(t[0], t_r[0]), min(t[-1], t_r[-1])
    none = (np.eye(2), 0.0, 1.0, 0.0, 0)
    if b - a < 5.0 * _BASE_S:
        return none
    edges = np.arange(a, b, _BASE_S)
    d = _integral(t, v_n, edges)
    r = _integral(t_r, v_r, edges)
    gap = np.zeros(len(edges) - 1, dtype=bool)
    for x in (t, t_r):
        for k in np.flatnonzero(np.diff(x) > 2.0):
            gap[max(np.searchsorted(edges, x[k]) - 1, 0) : np.searchsorted(edges, x[k + 1])] = True
    keep = ~gap & np.isfinite(d).all(axis=1) & np.isfinite(r).all(axis=1)
    d, r = d[keep], r[keep]
    size_d, size_r = np.hypot(d[:, 0], d[:, 1]), np.hypot(r[:, 0], r[:, 1])
    # a jump of a position is not a displacement
    ok = size_r <= 10.0 * max(float(np.quantile(size_r, 0.8)), 1e-12) if len(r) else size_r > 0.0
    d, r, size_d = d[ok], r[ok], size_d[ok]
    if len(d) < 5 or np.quantile(size_d, 0.8) <= 0.0 or not np.any(np.abs(r[:, :2]) > 0.0):
        return none
    x, y = r[:, :2], d[:, :2]
    scale = float(np.sqrt(np.mean(x**2)))
    G = x.T @ x
    if np.linalg.eigvalsh(G)[0] < 1e-3 * np.trace(G):
        G = G + 1e-12 * scale**2 * np.eye(2)  # a straight way
    M = np.linalg.solve(G, x.T @ y).T
    left = y - x @ M.T
    r2 = 1.0 - float(np.sum(left**2) / np.sum(y**2))
    u, w = r[:, 2], d[:, 2]
    power = float(u @ u)
    down = float(u @ w / power) if power > 0.0 else 1.0
    both = float(np.sqrt(power * float(w @ w)))
    down_r = float(u @ w / both) if both > 0.0 else 0.0
    return np.asarray(M, dtype=np.float64), r2, down, down_r, len(d)


def _integral(t: FloatArray, v: FloatArray, edges: FloatArray) -> FloatArray:
    s = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)))
    at = np.stack([np.interp(edges, t, s[:, i]) for i in range(3)], axis=1)
    return np.diff(at, axis=0)


def check_positions(gnss: GnssSeries) -> tuple[list[Finding], GnssView]:
    """Findings on units, axes and signs of positions and velocities, and what of them can be used.

    Parameters
    ----------
    gnss : GnssSeries
    """
    if len(gnss) < 10:
        zero = np.zeros((len(gnss), 3)) if gnss.v_n is None else gnss.v_n
        return [], GnssView(gnss.t, zero, "velocity")
    t_r, v_r = position_velocity(gnss)
    if gnss.v_n is None:
        return [], GnssView(t_r, v_r, "position")
    v = gnss.v_n
    M, r2, down, down_r, n = displacement_matrix(gnss.t, v, t_r, v_r)
    size = float(np.sqrt(np.abs(np.linalg.det(M))))
    moved = float(np.quantile(np.hypot(v[:, 0], v[:, 1]), 0.8))
    path = float(np.quantile(np.hypot(v_r[:, 0], v_r[:, 1]), 0.8))
    evidence: dict[str, Any] = {"matrix_v_of_r": M.tolist(), "r2": r2, "pairs": n, "down_factor": down}
    good = GnssView(gnss.t, v, "velocity", (t_r, v_r))
    if n == 0 or max(moved, path) < 0.3:
        return [], replace(good, other=None)
    if r2 < 0.5:
        if moved > 0.3 and r2 < 0.2 and path < 100.0:
            text = (
                f"the velocities explain {100.0 * max(r2, 0.0):.0f} % of the displacements: they do not belong "
                f"to these "
                "positions, or positions stand still"
            )
            fix = "leave the velocities out (skip vn, ve, vd with -), or find what the columns are"
            return [Finding("velocity_wrong", "error", text, 0.7, fix, evidence, "gnss")], replace(good, other=None)
        return [], good
    if r2 < 0.8:
        return [], good
    return _named(gnss, M, size, down, down_r, evidence, good)


def _named(
    gnss: GnssSeries,
    M: FloatArray,
    size: float,
    down: float,
    down_r: float,
    evidence: dict[str, Any],
    good: GnssView,
) -> tuple[list[Finding], GnssView]:
    assert gnss.v_n is not None
    assert good.other is not None
    t_r, v_r = good.other
    lat, lon = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 1]))
    found: list[Finding] = []
    by_position = GnssView(t_r, v_r, "position")
    candidates: dict[str, FloatArray] = {
        "good": np.eye(2),
        "enu": np.array([[0.0, 1.0], [1.0, 0.0]]),
        "order": np.array([[0.0, 1.0 / np.cos(lat)], [np.cos(lon), 0.0]]),
        "lon": np.diag([1.0, -1.0]),
        "lat": np.diag([-1.0, 1.0]),
        "both": -np.eye(2),
        "enu_west": np.array([[0.0, 1.0], [-1.0, 0.0]]),
        "enu_south": np.array([[0.0, -1.0], [1.0, 0.0]]),
    }
    # radians read as degrees: positions lie at the wrong latitude, where a degree of longitude is longer
    rad_lat = lat / units.DEG
    radians = np.diag([1.0, np.cos(rad_lat) / np.cos(lat)]) / units.DEG if abs(rad_lat) < 1.6 else None
    # latitude and longitude are known to a fifth of the unit, speeds to some per cent of themselves
    scales: dict[str, float] = {"": 1.0}
    scales.update({name: 1.0 / value for name, value in _SPEED_UNITS.items()})
    scales.update({f"not {name}": value for name, value in _SPEED_UNITS.items()})
    best, which, unit = np.inf, "", ""
    for name, shape in candidates.items():
        for label, k in scales.items():
            misfit = float(np.linalg.norm(M / k - shape) / np.linalg.norm(shape))
            cost = misfit + (0.0 if name == "good" else 0.06) + (0.0 if not label else 0.06)
            if cost < best:
                best, which, unit = cost, name, label
    far = 1.0
    if radians is not None:
        far = float(np.linalg.norm(M - radians) / np.linalg.norm(radians))
        swapped = np.array([[0.0, 1.0], [1.0, 0.0]]) @ radians
        far_swapped = float(np.linalg.norm(M - swapped) / np.linalg.norm(swapped))
        if min(far, far_swapped) < 0.2 and min(far, far_swapped) < best:
            text = (
                f"displacements of the positions are {size:.3g} times too small for the velocities: latitude and "
                "longitude are radians and were read as degrees"
            )
            found.append(
                Finding("position_unit", "error", text, 0.97, "units='angle=rad'", {**evidence, "scale": size}, "gnss")
            )
            if far_swapped < far:
                found.append(_enu(evidence, M))
                v = gnss.v_n[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
                return found, GnssView(gnss.t, v, "corrected velocity")
            return found, replace(good, other=None)
    if best > 0.3:
        text = (
            f"velocities and displacements are related by the matrix {np.round(M, 2).tolist()}, where they should be "
            "equal: their unit or axes are wrong in a way of their own"
        )
        found.append(Finding("velocity_wrong", "error", text, 0.7, "units='velocity=...'", evidence, "gnss"))
        return found, by_position
    value = 1.0
    if unit:
        value = float(np.mean(np.abs(M[np.abs(candidates[which]) > 0.5])))
        said = unit[4:] if unit.startswith("not ") else unit
        what = f"in {said}, not m/s" if not unit.startswith("not ") else f"in m/s, not {said}"
        text = f"velocities are {value:.4g} times the displacements per second: they are {what}"
        fix = f"units='velocity={said if not unit.startswith('not ') else 'm/s'}'"
        found.append(Finding("velocity_unit", "error", text, 0.95, fix, {**evidence, "scale": value}, "gnss"))
    up = down < 0.0 and abs(down_r) > 0.35
    if which == "enu":
        found.append(_enu(evidence, M))
    elif which in ("enu_west", "enu_south", "both"):
        text = (
            f"velocities and displacements are related by the matrix {np.round(M, 2).tolist()}: the velocity has other "
            "axes than north, east, down"
        )
        found.append(Finding("velocity_axes", "error", text, 0.9, "columns='...,vn,ve,vd'", evidence, "gnss"))
    elif which == "order":
        text = (
            "displacements north and east are exchanged against the velocities, stretched as at the wrong latitude: "
            "latitude and longitude are exchanged"
        )
        found.append(
            Finding("position_order", "error", text, 0.95, "columns='...,lon,lat,...' exchanged", evidence, "gnss")
        )
        good = replace(good, other=None)
    elif which in ("lon", "lat"):
        axis = {"lon": ("east", "longitude (counted west?)", "scale='lon=-1' or scale='ve=-1'"),
                "lat": ("north", "latitude", "scale='lat=-1' or scale='vn=-1'")}[which]  # fmt: skip
        code = {"lon": "longitude_sign", "lat": "latitude_sign"}[which]
        text = (
            f"displacements {axis[0]} have the opposite sign of the velocities {axis[0]}: that of {axis[1]} "
            f"or of the velocity is wrong"
        )
        found.append(Finding(code, "error", text, 0.9, axis[2], evidence, "gnss"))
    if which == "good" and not unit and abs(down_r) > 0.7 and abs(np.log(abs(down) / units.FT)) < 0.2:
        text = f"heights change {1.0 / abs(down):.3g} times as fast as the vertical velocity says: they are in feet"
        found.append(Finding("height_unit", "error", text, 0.85, "units='length=ft'", evidence, "gnss"))
    if up and which != "enu":
        text = (
            f"the vertical velocity is {down:.2f} times the change of height downwards (correlation {down_r:.2f}): it "
            "is positive up, not down"
        )
        found.append(Finding("vertical_sign", "error", text, 0.9, "scale='vd=-1'", evidence, "gnss"))
    scale = value if unit else 1.0
    v = gnss.v_n / np.array([scale, scale, -scale if up else scale])
    if which == "good":
        return found, GnssView(gnss.t, v, "corrected velocity" if unit or up else "velocity", (t_r, v_r))
    if which == "enu":
        v = gnss.v_n[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]) / scale
        return found, GnssView(gnss.t, v, "corrected velocity", (t_r, v_r))
    if which == "order":
        return found, good
    if which in ("lon", "lat"):
        return found, GnssView(gnss.t, v, "velocity", (t_r, v_r), mirrored=True)
    return found, by_position


def _enu(evidence: dict[str, Any], M: FloatArray) -> Finding:
    text = (
        "displacements north belong to velocities east and the reverse: the velocity is east, north, up and "
        "was read as "
        "north, east, down"
    )
    fix = "columns='...,ve,vn,vd,...' with scale='vd=-1'"
    return Finding("velocity_axes", "error", text, 0.95, fix, evidence, "gnss")


def plausible_place(gnss: GnssSeries) -> list[Finding]:
    """Heights no log has, and a path that fits no place. [m]"""
    h = gnss.llh[:, 2]
    typical = float(np.median(h))
    if -600.0 < typical < 60_000.0:
        return []
    for name, value in (("mm", 1e-3), ("cm", 1e-2), ("ft", units.FT)):
        if -600.0 < typical * value < 20_000.0:
            text = f"the height is {typical:.6g} m, which is no place on or near the Earth: it may be in {name}"
            return [Finding("height_unit", "error", text, 0.7, f"units='length={name}'", {"height_m": typical}, "gnss")]
    return [Finding("height_unit", "error", f"the height is {typical:.6g} m", 0.7, "", {"height_m": typical}, "gnss")]
