"""Positions against velocities of the same receiver: units, order, axes and signs of both.

The 2 x 2 matrix between displacements over some seconds and the integral of the velocity is the unit matrix in a good
log; each usual fault has one of its own. Which of them is so is judged by the likelihoods of the displacements, so that
a straight road, where many matrices do the same, or fixes that are lost in their noise accuse nobody.
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
_DISTINCT = 6.0  # log-likelihood by which a fault must lead a log in order
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


@dataclass(frozen=True)
class Displacements:
    """Displacements over some seconds by velocities and by positions.

    Attributes
    ----------
    d : ndarray, shape (n, 3)
        Integral of velocity. [m]
    r : ndarray, shape (n, 3)
        Difference of positions. [m]
    """

    d: FloatArray
    r: FloatArray

    def __len__(self) -> int:
        return len(self.d)

    def matrix(self) -> tuple[FloatArray, float]:
        """Least squares ``d = M r`` of the horizontal, and the share of the variance that M explains."""
        x, y = self.r[:, :2], self.d[:, :2]
        scale = float(np.sqrt(np.mean(x**2)))
        G = x.T @ x
        if np.linalg.eigvalsh(G)[0] < 1e-3 * np.trace(G):
            G = G + 1e-12 * scale**2 * np.eye(2)  # a straight way
        M = np.asarray(np.linalg.solve(G, x.T @ y).T, dtype=np.float64)
        return M, self.explained(M)

    def explained(self, M: FloatArray) -> float:
        """Share of the variance of ``d`` that a matrix explains."""
        y = self.d[:, :2]
        return 1.0 - float(np.sum((y - self.r[:, :2] @ M.T) ** 2) / max(float(np.sum(y**2)), 1e-300))

    def vertical(self) -> tuple[float, float]:
        """Factor and correlation of the vertical."""
        u, w = self.r[:, 2], self.d[:, 2]
        power = float(u @ u)
        both = float(np.sqrt(power * float(w @ w)))
        return (float(u @ w / power) if power > 0.0 else 1.0), (float(u @ w / both) if both > 0.0 else 0.0)

    def scale(self, shape: FloatArray) -> float:
        """Factor of a matrix with which it explains most."""
        x = self.r[:, :2] @ shape.T
        return float(np.sum(x * self.d[:, :2]) / max(float(np.sum(x**2)), 1e-300))

    def lead(self, M: FloatArray, over: FloatArray) -> float:
        """Least log-likelihood by which one matrix leads another, of all and of either half of the log.

        Parameters
        ----------
        M, over : ndarray, shape (2, 2)
            Horizontal matrices, or shape (1, 1) for the vertical.
        """
        # axes: the horizontal ones, or down
        axes = slice(0, 2) if M.shape == (2, 2) else slice(2, 3)
        half = len(self) // 2
        parts = [(slice(None), 1.0), (slice(0, half), 2.0), (slice(half, None), 2.0)]
        return min(weight * _log_ratio(self.d[k, axes], self.r[k, axes], M, over) for k, weight in parts)


def _log_ratio(y: FloatArray, x: FloatArray, M: FloatArray, over: FloatArray) -> float:
    """Log-likelihood of ``y = M x`` less that of ``y = over x``, whichever of the two is noisy."""
    power = [float(np.mean(_trimmed(np.sum((y - x @ F.T) ** 2, axis=1)))) for F in (M, over)]
    # noise of x is scaled by the matrix, that of y is not: the case that says less
    gain = [np.sqrt(abs(float(np.linalg.det(F @ F.T)))) if F.size == 4 else float(F[0, 0] ** 2) for F in (M, over)]
    tiny = 1e-12 * float(np.mean(y**2)) + 1e-300
    ratio = np.log((power[1] + tiny) / (power[0] + tiny))
    with np.errstate(divide="ignore"):  # a matrix of no gain leads nothing
        scaled = ratio + np.log(gain[0] / gain[1])
    # neighbouring displacements share a position
    return float(0.5 * 0.5 * y.shape[1] * len(y) * min(ratio, scaled))


def _trimmed(x: FloatArray) -> FloatArray:
    """Without the largest tenth: jumps."""
    return np.sort(x)[: max(int(0.9 * len(x)), 1)]


def likelihood(lead: float) -> float:
    """Likelihood of a fault whose log-likelihood leads that of a log in order by so much.

    Parameters
    ----------
    lead : float
    """
    return float(np.clip(1.0 - 0.5 * np.exp(-(lead - _DISTINCT) / 2.0), 0.5, 0.999))


def displacements(t: FloatArray, v_n: FloatArray, t_r: FloatArray, v_r: FloatArray) -> Displacements:
    """Displacements over 4 s by velocities and by positions, outages and jumps left out; none if there are too few.

    Parameters
    ----------
    t, v_n : ndarray, shapes (n,), (n, 3)
        Velocity.
    t_r, v_r : ndarray, shapes (m,), (m, 3)
        Velocity from positions.
    """
    none = Displacements(np.zeros((0, 3)), np.zeros((0, 3)))
    if len(t_r) < 2:
        return none
    a, b = max(t[0], t_r[0]), min(t[-1], t_r[-1])
    if b - a < 5.0 * _BASE_S:
        return none
    # only stretches that hold a position: of a log with a pause of years the others would fill the memory
    stretch = np.unique(np.floor((t_r - a) / _BASE_S))
    stretch = stretch[(stretch >= 0.0) & (stretch < np.ceil((b - a) / _BASE_S) - 1.0)]
    base = (a + _BASE_S) - a  # rounded as the stamps are
    start, stop = a + base * stretch, a + base * (stretch + 1.0)
    d = _integral(t, v_n, start, stop)
    r = _integral(t_r, v_r, start, stop)
    gap = np.zeros(len(start), dtype=bool)
    for x in (t, t_r):
        for k in np.flatnonzero(np.diff(x) > 2.0):
            gap[np.searchsorted(stop, x[k]) : np.searchsorted(start, x[k + 1])] = True
    keep = ~gap & np.isfinite(d).all(axis=1) & np.isfinite(r).all(axis=1)
    d, r = d[keep], r[keep]
    size_d, size_r = np.hypot(d[:, 0], d[:, 1]), np.hypot(r[:, 0], r[:, 1])
    # a jump of a position is not a displacement
    ok = size_r <= 10.0 * max(float(np.quantile(size_r, 0.8)), 1e-12) if len(r) else size_r > 0.0
    d, r, size_d = d[ok], r[ok], size_d[ok]
    if len(d) < 5 or np.quantile(size_d, 0.8) <= 0.0 or not np.any(np.abs(r[:, :2]) > 0.0):
        return none
    return Displacements(d, r)


def _integral(t: FloatArray, v: FloatArray, start: FloatArray, stop: FloatArray) -> FloatArray:
    s = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)))
    return np.stack([np.interp(stop, t, s[:, i]) - np.interp(start, t, s[:, i]) for i in range(3)], axis=1)


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
    if not np.isfinite(gnss.v_n).all():
        # a velocity without its vertical part
        gnss = replace(gnss, v_n=np.where(np.isfinite(gnss.v_n), gnss.v_n, 0.0))
    changes = np.any(np.diff(gnss.need_velocity()[0], axis=0) != 0.0, axis=1)
    fresh = gnss.where(np.concatenate((np.ones(1, dtype=bool), changes)))
    if len(fresh) < 10 or len(fresh) > 0.85 * len(gnss):
        fresh = gnss
    t, v = fresh.t, fresh.v_n
    assert v is not None
    pairs = displacements(t, v, t_r, v_r)
    good = GnssView(t, v, "velocity", (t_r, v_r))
    moved = float(np.quantile(np.hypot(v[:, 0], v[:, 1]), 0.8))
    path = float(np.quantile(np.hypot(v_r[:, 0], v_r[:, 1]), 0.8))
    if len(pairs) == 0 or max(moved, path) < 0.3:
        return [], replace(good, other=None)
    M, r2 = pairs.matrix()
    down, _ = pairs.vertical()
    evidence: dict[str, Any] = {"matrix_v_of_r": M.tolist(), "r2": r2, "pairs": len(pairs), "down_factor": down}
    if r2 < 0.5:
        return _unrelated(fresh, pairs, moved, path, evidence, good)
    if r2 < 0.8:
        return [], good
    return _judge_matrix(fresh, pairs, evidence, good)


def _unrelated(
    gnss: GnssSeries, pairs: Displacements, moved: float, path: float, evidence: dict[str, Any], good: GnssView
) -> tuple[list[Finding], GnssView]:
    """Finding on velocities that do not belong to the positions, if noise of neither can explain it."""
    r2 = evidence["r2"]
    if not (moved > 0.3 and r2 < 0.2 and path < 100.0):
        return [], good
    # what positions, and velocities over the base, may be off by in a log that is in order
    off = np.sqrt(2.0 * np.median(np.einsum("nii->ni", gnss.cov_r_n)[:, :2].sum(axis=1)))
    if gnss.cov_v_n is not None:
        off += _BASE_S * np.sqrt(np.median(np.einsum("nii->ni", gnss.cov_v_n)[:, :2].sum(axis=1)))
    rough = np.diff(pairs.r[:, :2], 2, axis=0)
    noise = max(float(off), 1.4826 * float(np.median(np.linalg.norm(rough, axis=1))) / np.sqrt(6.0))
    half = len(pairs) // 2
    left = [float(np.median(np.linalg.norm((pairs.d - pairs.r)[k, :2], axis=1)))
            for k in (slice(0, half), slice(half, None))]  # fmt: skip
    evidence |= {"off_m": left, "noise_m": noise}
    if min(left) < 4.0 * noise:
        return [], replace(good, other=None)
    text = (
        f"the velocities explain {100.0 * max(r2, 0.0):.0f} % of the displacements: they do not belong to these "
        "positions, or positions stand still"
    )
    fix = "leave the velocities out (skip vn, ve, vd with -), or find what the columns are"
    sure = float(np.clip(1.0 - np.exp(-min(left) / (2.0 * noise)), 0.5, 0.95))
    return [Finding("velocity_wrong", "error", text, sure, fix, evidence, "gnss")], replace(good, other=None)


def _judge_matrix(
    gnss: GnssSeries, pairs: Displacements, evidence: dict[str, Any], good: GnssView
) -> tuple[list[Finding], GnssView]:
    """Findings on the fault that displacements show, and what of the log can be used.

    Parameters
    ----------
    gnss : GnssSeries
    pairs : Displacements
    evidence : dict
    good : GnssView
        The view of a log without a fault.
    """
    assert good.other is not None
    lat, lon = float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 1]))
    one = np.eye(2)
    free, _ = pairs.matrix()
    distance, exchanged = _distance_from_radians(free, lat)
    findings: list[Finding] = []
    fault, unit, scale = "good", "", 1.0
    _, fault, unit, M = classify_displacements(pairs, lat, lon)
    size = float(np.linalg.norm(M))
    lead = pairs.lead(M, one)
    if distance < 0.2 and pairs.lead(free, M) > 0.0 and pairs.lead(free, one) > _DISTINCT:
        return _radians(gnss, free, exchanged, evidence, good)
    # what no usual fault explains, each direction that the motion shows by itself
    own = 1.0 - pairs.explained(M) > 0.09 + 2.0 * (1.0 - evidence["r2"])
    if own and min(pairs.lead(free, M), pairs.lead(free, one)) > _DISTINCT:
        text = (
            f"velocities and displacements are related by the matrix {np.round(free, 2).tolist()}, where they should "
            "be equal: their unit or axes are wrong in a way of their own"
        )
        finding = Finding("velocity_wrong", "error", text, 0.9, "units='velocity=...'", evidence, "gnss")
        return [finding], GnssView(*good.other, "position")
    if (fault != "good" or unit) and lead < _DISTINCT:
        fault, unit = "good", ""
    sure = likelihood(lead)
    evidence |= {"lead_log_likelihood": lead, "size": size}
    if unit:
        scale = float(pairs.scale(_fault_matrices(lat, lon)[fault]))
        findings.append(_unit_finding(unit, scale, sure, evidence))
    findings += _axes_findings(fault, free, sure, evidence)
    vertical, up = _vertical_findings(pairs, fault, evidence, plain=fault == "good" and not unit)
    return findings + vertical, _corrected_view(gnss, fault, unit, scale, up, good)


def _vertical_findings(
    pairs: Displacements, fault: str, evidence: dict[str, Any], *, plain: bool
) -> tuple[list[Finding], bool]:
    """Findings on the vertical: its sign, heights in feet; and whether velocities are up."""
    down, down_r = pairs.vertical()
    same, reverse = np.eye(1), -np.eye(1)
    findings = []
    if plain and abs(down_r) > 0.7 and abs(np.log(abs(down) / units.FT)) < 0.2:
        lead = pairs.lead(units.FT * np.sign(down) * same, np.sign(down) * same)
        if lead > _DISTINCT:
            text = f"heights change {1.0 / abs(down):.3g} times as fast as the vertical velocity says: they are in feet"
            findings.append(
                Finding("height_unit", "error", text, likelihood(lead), "units='length=ft'", evidence, "gnss")
            )
    lead = max(pairs.lead(k * reverse, k * same) for k in (1.0, abs(down)) if k > 0.0)
    up = down < 0.0 and abs(down_r) > 0.35 and lead > _DISTINCT
    if up and fault != "enu":
        text = (
            f"the vertical velocity is {down:.2f} times the change of height downwards (correlation {down_r:.2f}): it "
            "is positive up, not down"
        )
        findings.append(Finding("vertical_sign", "error", text, likelihood(lead), "scale='vd=-1'", evidence, "gnss"))
    return findings, up


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


def classify_displacements(pairs: Displacements, lat: float, lon: float) -> tuple[float, str, str, FloatArray]:
    """Usual fault that explains displacements best.

    Parameters
    ----------
    pairs : Displacements
    lat, lon : float
        [rad]

    Returns
    -------
    cost : float
        RMS of what is left over that of the displacements, plus 0.06 for a fault of axes and 0.06 for one of the unit.
    fault : str
        ``good``, ``enu``, ``order``, ``lon``, ``lat``, ``both``, ``enu_west`` or ``enu_south``.
    unit : str
        Unit of the velocities if it is not m/s, ``not`` before it if m/s were read as that unit; else empty.
    M : ndarray, shape (2, 2)
        Its matrix.
    """
    # latitude and longitude are good to a fifth of the unit, speeds to some per cent of themselves
    scales: dict[str, float] = {"": 1.0}
    scales.update({name: 1.0 / value for name, value in _SPEED_UNITS.items()})
    scales.update({f"not {name}": value for name, value in _SPEED_UNITS.items()})
    best, fault, unit, matrix = np.inf, "good", "", np.eye(2)
    size = float(np.mean(_trimmed(np.sum(pairs.d[:, :2] ** 2, axis=1))))
    for name, shape in _fault_matrices(lat, lon).items():
        for label, k in scales.items():
            left = pairs.d[:, :2] - pairs.r[:, :2] @ (k * shape).T
            misfit = float(np.sqrt(np.mean(_trimmed(np.sum(left**2, axis=1))) / max(size, 1e-300)))
            cost = misfit + (0.0 if name == "good" else 0.06) + (0.0 if not label else 0.06)
            if cost < best:
                best, fault, unit, matrix = cost, name, label, k * shape
    return float(best), fault, unit, matrix


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
    findings = [Finding("position_unit", "error", text, 0.99, "units='angle=rad'", evidence_, "gnss")]
    if not exchanged:
        return findings, replace(good, other=None)
    v = gnss.v_n[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    return [*findings, _enu(0.99, evidence)], GnssView(gnss.t, v, "corrected velocity")


def _unit_finding(unit: str, scale: float, sure: float, evidence: dict[str, Any]) -> Finding:
    """Finding on velocities in another unit; see :func:`classify_displacements` for ``unit``."""
    name = unit.removeprefix("not ")
    right, wrong = ("m/s", name) if unit.startswith("not ") else (name, "m/s")
    text = f"velocities are {scale:.4g} times the displacements per second: they are in {right}, not {wrong}"
    return Finding(
        "velocity_unit", "error", text, sure, f"units='velocity={right}'", {**evidence, "scale": scale}, "gnss"
    )


def _axes_findings(fault: str, M: FloatArray, sure: float, evidence: dict[str, Any]) -> list[Finding]:
    """Findings on axes, order and sign of positions or velocities."""
    if fault == "enu":
        return [_enu(sure, evidence)]
    if fault in ("enu_west", "enu_south", "both"):
        text = (
            f"velocities and displacements are related by the matrix {np.round(M, 2).tolist()}: the velocity has other "
            "axes than north, east, down"
        )
        return [Finding("velocity_axes", "error", text, sure, "columns='...,vn,ve,vd'", evidence, "gnss")]
    if fault == "order":
        text = (
            "displacements north and east are exchanged against the velocities, stretched as at the wrong latitude: "
            "latitude and longitude are exchanged"
        )
        fix = "columns='...,lon,lat,...' exchanged"
        return [Finding("position_order", "error", text, sure, fix, evidence, "gnss")]
    if fault in ("lon", "lat"):
        code, axis, name, fix = {
            "lon": ("longitude_sign", "east", "longitude (counted west?)", "scale='lon=-1' or scale='ve=-1'"),
            "lat": ("latitude_sign", "north", "latitude", "scale='lat=-1' or scale='vn=-1'"),
        }[fault]
        text = (
            f"displacements {axis} have the opposite sign of the velocities {axis}: that of {name} "
            f"or of the velocity is wrong"
        )
        return [Finding(code, "error", text, sure, fix, evidence, "gnss")]
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


def _enu(sure: float, evidence: dict[str, Any]) -> Finding:
    """Finding on velocities east, north, up."""
    text = (
        "displacements north belong to velocities east and the reverse: the velocity is east, north, up and "
        "was read as "
        "north, east, down"
    )
    fix = "columns='...,ve,vn,vd,...' with scale='vd=-1'"
    return Finding("velocity_axes", "error", text, sure, fix, evidence, "gnss")


def plausible_place(gnss: GnssSeries) -> list[Finding]:
    """Finding on heights that no log has."""
    h = gnss.llh[:, 2]
    typical = float(np.median(h))
    if -600.0 < typical < 60_000.0:
        return []
    for name, value in (("mm", 1e-3), ("cm", 1e-2), ("ft", units.FT)):
        if -600.0 < typical * value < 20_000.0:
            text = f"the height is {typical:.6g} m, which is no place on or near the Earth: it may be in {name}"
            return [
                Finding("height_unit", "error", text, 0.99, f"units='length={name}'", {"height_m": typical}, "gnss")
            ]
    return [Finding("height_unit", "error", f"the height is {typical:.6g} m", 0.99, "", {"height_m": typical}, "gnss")]
