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
from schuler.diagnosis.motion import position_velocity
from schuler.diagnosis.result import Finding
from schuler.recording.series import GnssSeries

_BASE_S = 4.0  # displacements are taken over so long, for the noise of positions
_SPEED_UNITS = {"km/h": units.KMH, "kn": units.KNOT, "cm/s": 0.01, "mm/s": 0.001, "ft/s": units.FT}


@dataclass(frozen=True)
class GnssView:
    """Velocities of a GNSS log that can be used as motion.

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
    """Findings on units, axes and signs of positions and velocities, and the velocities that can be used.

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
    return _judge_matrix(gnss, M, down, down_r, evidence, good)


def _judge_matrix(
    gnss: GnssSeries, M: FloatArray, down: float, down_r: float, evidence: dict[str, Any], good: GnssView
) -> tuple[list[Finding], GnssView]:
    """Findings on the fault that a displacement matrix shows, and what of the log can be used.

    Parameters
    ----------
    gnss : GnssSeries
    M, down, down_r
        From :func:`displacement_matrix`.
    evidence : dict
    good : GnssView
        The view of a log without a fault.
    """
    assert good.other is not None
    lat, lon = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 1]))
    cost, fault, unit = classify_displacement_matrix(M, lat, lon)
    distance, exchanged = _distance_from_radians(M, lat)
    if distance < 0.2 and distance < cost:
        return _radians(gnss, M, exchanged, evidence, good)
    if cost > 0.3:
        text = (
            f"velocities and displacements are related by the matrix {np.round(M, 2).tolist()}, where they should be "
            "equal: their unit or axes are wrong in a way of their own"
        )
        finding = Finding("velocity_wrong", "error", text, 0.7, "units='velocity=...'", evidence, "gnss")
        return [finding], GnssView(*good.other, "position")
    findings, scale = [], 1.0
    if unit:
        scale = float(np.mean(np.abs(M[np.abs(_fault_matrices(lat, lon)[fault]) > 0.5])))
        findings.append(_unit_finding(unit, scale, evidence))
    up = down < 0.0 and abs(down_r) > 0.35
    findings += _axes_findings(fault, M, evidence)
    if fault == "good" and not unit and abs(down_r) > 0.7 and abs(np.log(abs(down) / units.FT)) < 0.2:
        text = f"heights change {1.0 / abs(down):.3g} times as fast as the vertical velocity says: they are in feet"
        findings.append(Finding("height_unit", "error", text, 0.85, "units='length=ft'", evidence, "gnss"))
    if up and fault != "enu":
        text = (
            f"the vertical velocity is {down:.2f} times the change of height downwards (correlation {down_r:.2f}): it "
            "is positive up, not down"
        )
        findings.append(Finding("vertical_sign", "error", text, 0.9, "scale='vd=-1'", evidence, "gnss"))
    return findings, _corrected_view(gnss, fault, unit, scale, up, good)


def _fault_matrices(lat: float, lon: float) -> dict[str, FloatArray]:
    """Displacement matrix of each usual fault of axes, order and sign, at a latitude and longitude. [rad]"""
    return {
        "good": np.eye(2),
        "enu": np.array([[0.0, 1.0], [1.0, 0.0]]),
        "order": np.array([[0.0, 1.0 / np.cos(lat)], [np.cos(lon), 0.0]]),
        "lon": np.diag([1.0, -1.0]),
        "lat": np.diag([-1.0, 1.0]),
        "both": -np.eye(2),
        "enu_west": np.array([[0.0, 1.0], [-1.0, 0.0]]),
        "enu_south": np.array([[0.0, -1.0], [1.0, 0.0]]),
    }


def classify_displacement_matrix(M: FloatArray, lat: float, lon: float) -> tuple[float, str, str]:
    """Usual fault whose displacement matrix is nearest to a measured one.

    Parameters
    ----------
    M : ndarray, shape (2, 2)
        From :func:`displacement_matrix`.
    lat, lon : float
        [rad]

    Returns
    -------
    cost : float
        Relative distance, plus 0.06 for a fault of axes and 0.06 for one of the unit.
    fault : str
        ``good``, ``enu``, ``order``, ``lon``, ``lat``, ``both``, ``enu_west`` or ``enu_south``.
    unit : str
        Unit of the velocities if it is not m/s, ``not`` before it if m/s were read as that unit; else empty.
    """
    # latitude and longitude are good to a fifth of the unit, speeds to some per cent of themselves
    scales: dict[str, float] = {"": 1.0}
    scales.update({name: 1.0 / value for name, value in _SPEED_UNITS.items()})
    scales.update({f"not {name}": value for name, value in _SPEED_UNITS.items()})
    best, fault, unit = np.inf, "", ""
    for name, shape in _fault_matrices(lat, lon).items():
        for label, k in scales.items():
            misfit = float(np.linalg.norm(M / k - shape) / np.linalg.norm(shape))
            cost = misfit + (0.0 if name == "good" else 0.06) + (0.0 if not label else 0.06)
            if cost < best:
                best, fault, unit = cost, name, label
    return float(best), fault, unit


def _distance_from_radians(M: FloatArray, lat: float) -> tuple[float, bool]:
    """Relative distance of M from that of radians read as degrees, and whether with north and east exchanged."""
    # the positions lie at the wrong latitude, where a degree of longitude is longer
    true_lat = lat / units.DEG
    if not abs(true_lat) < 1.6:
        return float(np.inf), False
    radians = np.diag([1.0, np.cos(true_lat) / np.cos(lat)]) / units.DEG
    exchanged = np.array([[0.0, 1.0], [1.0, 0.0]]) @ radians
    straight = float(np.linalg.norm(M - radians) / np.linalg.norm(radians))
    crossed = float(np.linalg.norm(M - exchanged) / np.linalg.norm(exchanged))
    return min(straight, crossed), crossed < straight


def _radians(
    gnss: GnssSeries, M: FloatArray, exchanged: bool, evidence: dict[str, Any], good: GnssView
) -> tuple[list[Finding], GnssView]:
    """Finding on latitude and longitude in radians, with velocities east, north, up if ``exchanged``."""
    assert gnss.v_n is not None
    size = float(np.sqrt(np.abs(np.linalg.det(M))))
    text = (
        f"displacements of the positions are {size:.3g} times too small for the velocities: latitude and "
        "longitude are radians and were read as degrees"
    )
    evidence_ = {**evidence, "scale": size}
    findings = [Finding("position_unit", "error", text, 0.97, "units='angle=rad'", evidence_, "gnss")]
    if not exchanged:
        return findings, replace(good, other=None)
    v = gnss.v_n[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    return [*findings, _enu(evidence)], GnssView(gnss.t, v, "corrected velocity")


def _unit_finding(unit: str, scale: float, evidence: dict[str, Any]) -> Finding:
    """Finding on velocities in another unit; see :func:`classify_displacement_matrix` for ``unit``."""
    name = unit.removeprefix("not ")
    right, wrong = ("m/s", name) if unit.startswith("not ") else (name, "m/s")
    text = f"velocities are {scale:.4g} times the displacements per second: they are in {right}, not {wrong}"
    return Finding(
        "velocity_unit", "error", text, 0.95, f"units='velocity={right}'", {**evidence, "scale": scale}, "gnss"
    )


def _axes_findings(fault: str, M: FloatArray, evidence: dict[str, Any]) -> list[Finding]:
    """Findings on axes, order and sign of positions or velocities."""
    if fault == "enu":
        return [_enu(evidence)]
    if fault in ("enu_west", "enu_south", "both"):
        text = (
            f"velocities and displacements are related by the matrix {np.round(M, 2).tolist()}: the velocity has other "
            "axes than north, east, down"
        )
        return [Finding("velocity_axes", "error", text, 0.9, "columns='...,vn,ve,vd'", evidence, "gnss")]
    if fault == "order":
        text = (
            "displacements north and east are exchanged against the velocities, stretched as at the wrong latitude: "
            "latitude and longitude are exchanged"
        )
        fix = "columns='...,lon,lat,...' exchanged"
        return [Finding("position_order", "error", text, 0.95, fix, evidence, "gnss")]
    if fault in ("lon", "lat"):
        code, axis, name, fix = {
            "lon": ("longitude_sign", "east", "longitude (counted west?)", "scale='lon=-1' or scale='ve=-1'"),
            "lat": ("latitude_sign", "north", "latitude", "scale='lat=-1' or scale='vn=-1'"),
        }[fault]
        text = (
            f"displacements {axis} have the opposite sign of the velocities {axis}: that of {name} "
            f"or of the velocity is wrong"
        )
        return [Finding(code, "error", text, 0.9, fix, evidence, "gnss")]
    return []


def _corrected_view(gnss: GnssSeries, fault: str, unit: str, scale: float, up: bool, good: GnssView) -> GnssView:
    """Velocities that can be used, corrected where their fault is plain."""
    assert gnss.v_n is not None
    assert good.other is not None
    v = gnss.v_n / np.array([scale, scale, -scale if up else scale])
    if fault == "good":
        return GnssView(gnss.t, v, "corrected velocity" if unit or up else "velocity", good.other)
    if fault == "enu":
        v = gnss.v_n[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]) / scale
        return GnssView(gnss.t, v, "corrected velocity", good.other)
    if fault == "order":
        return replace(good, other=None)
    if fault in ("lon", "lat"):
        return GnssView(gnss.t, v, "velocity", good.other, mirrored=True)
    return GnssView(*good.other, "position")


def _enu(evidence: dict[str, Any]) -> Finding:
    """Finding on velocities east, north, up."""
    text = (
        "displacements north belong to velocities east and the reverse: the velocity is east, north, up and "
        "was read as "
        "north, east, down"
    )
    fix = "columns='...,ve,vn,vd,...' with scale='vd=-1'"
    return Finding("velocity_axes", "error", text, 0.95, fix, evidence, "gnss")


def plausible_place(gnss: GnssSeries) -> list[Finding]:
    """Finding on heights that no log has."""
    h = gnss.llh[:, 2]
    typical = float(np.median(h))
    if -600.0 < typical < 60_000.0:
        return []
    for name, value in (("mm", 1e-3), ("cm", 1e-2), ("ft", units.FT)):
        if -600.0 < typical * value < 20_000.0:
            text = f"the height is {typical:.6g} m, which is no place on or near the Earth: it may be in {name}"
            return [Finding("height_unit", "error", text, 0.7, f"units='length={name}'", {"height_m": typical}, "gnss")]
    return [Finding("height_unit", "error", f"the height is {typical:.6g} m", 0.7, "", {"height_m": typical}, "gnss")]
