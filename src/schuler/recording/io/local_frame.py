"""Poses in a local frame, east-north-up about a named origin, to and from our Earth-fixed trajectories."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io.columns import GEODETIC, LOCAL
from schuler.recording.io.hint_texts import parse_origin
from schuler.recording.io.hints import ReadHints
from schuler.recording.trajectory import Trajectory

#: Turns between east-north-up and north-east-down, and forward-left-up and forward-right-down: their own inverses.
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU = np.diag([1.0, -1.0, -1.0])

Origin = tuple[float, float, float]
_BLOCK = 8192  # rows whose columns stay in the cache


def need_origin(origin: Origin | None, path: Path, what: str) -> Origin:
    """The origin, or an error that says what is missing."""
    if origin is None:
        raise InputError(
            f"{path}: {what} are in a local frame: say where its zero is, origin='LAT,LON,HEIGHT' (degrees, "
            "ellipsoidal metres); x is taken as east, y as north, z as up"
        )
    return origin


def place_local(values: dict[str, FloatArray], hints: ReadHints, path: Path) -> None:
    """Make columns north, east, down of an origin latitude, longitude and height, in place.

    Parameters
    ----------
    values : dict of str to ndarray, shape (n,)
        With n, e, d. [m]
    hints : ReadHints
        ``origin`` counts.
    path : Path
        For messages.

    Raises
    ------
    InputError
        If no origin is stated.
    """
    origin = parse_origin(hints.origin)
    if origin is None:
        raise InputError(
            f"{path}: n, e, d are in a local frame: say where its zero is, origin='LAT,LON,HEIGHT' (degrees, "
            "ellipsoidal metres)"
        )
    r_n = np.stack([values.pop(name) for name in LOCAL], axis=1)
    llh = frames.llh_from_ecef(frames.ecef_from_ned(r_n, np.array(origin)))
    values |= dict(zip(GEODETIC, llh.T.copy(), strict=True))


def earth_fixed(
    origin: Origin,
    r_l: FloatArray,
    q_ls: FloatArray | None,
    v_l: FloatArray | None,
    C_bs: FloatArray,
    path: Path,
) -> dict[str, FloatArray]:
    """Columns of a reference, see :class:`schuler.recording.io.parts.Table`.

    Parameters
    ----------
    origin : tuple of float
        Latitude, longitude [rad], ellipsoidal height [m].
    r_l : ndarray, shape (n, 3)
        Positions east, north, up of the origin. [m]
    q_ls : ndarray, shape (n, 4), optional
        Attitude of the sensor to the local frame, scalar first.
    v_l : ndarray, shape (n, 3), optional
        Velocity in the local frame. [m/s]
    C_bs : ndarray, shape (3, 3)
        Sensor's axes to forward-right-down.
    path : Path
        For messages.

    Raises
    ------
    FileFormatError
        If numbers are missing or no unit quaternions.
    """
    if not np.isfinite(r_l).all() or np.abs(r_l).max(initial=0.0) > 1e7:
        raise FileFormatError(
            "expected positions within 10 000 km of the origin; a number is missing or too large", path
        )
    llh = np.array(origin)
    C_el = frames.C_en(llh) @ ENU
    r_e = _small_product(r_l, C_el.T)
    r_e += frames.ecef_from_llh(llh)
    values = {axis: r_e[:, k] for k, axis in enumerate("xyz")}
    if q_ls is not None:
        norm = np.sqrt(np.einsum("ni,ni->n", q_ls, q_ls))
        bad = np.flatnonzero(~(np.abs(norm - 1.0) < 1e-2))
        if len(bad):
            raise FileFormatError(f"pose {bad[0] + 1}: expected a unit quaternion, got norm {norm[bad[0]]:.4g}", path)
        # q_el q_ls q_sb is linear in q_ls: the columns of its matrix are the products with the four units
        q_el, q_sb = rotation.quat_from_dcm(C_el), rotation.quat_from_dcm(C_bs.T)
        units_to = rotation.quat_multiply(rotation.quat_multiply(q_el, np.eye(4)), q_sb)
        q_eb = _small_product(q_ls, units_to)
        q_eb *= np.copysign(1.0 / norm, q_eb[:, 0])[:, None]
        values |= {name: q_eb[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
    if v_l is not None:
        v_e = _small_product(v_l, C_el.T)
        values |= {f"v{axis}": v_e[:, k] for k, axis in enumerate("xyz")}
    return values


def _small_product(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """``rows @ matrix``; BLAS, which packs its arguments first, is slow where one side is so short. Shape (n, k)."""
    product = np.empty((len(rows), matrix.shape[1]))
    for start in range(0, len(rows), _BLOCK):
        block = rows[start : start + _BLOCK].T.copy()
        for k, column in enumerate(matrix.T):
            product[start : start + _BLOCK, k] = sum(c * row for c, row in zip(column, block, strict=True))
    return product


def local(
    trajectory: Trajectory, origin: Origin, C_bs: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Positions, attitude and velocity in the local frame; the inverse of :func:`earth_fixed`."""
    llh = np.array(origin)
    C_el = frames.C_en(llh) @ ENU
    r_l = frames.ned_from_ecef(trajectory.r_eb_e, llh) @ ENU
    q = v = None
    if trajectory.q_eb is not None:
        C_ls = C_el.T @ rotation.dcm_from_quat(trajectory.q_eb) @ C_bs
        q = rotation.quat_from_dcm(C_ls)
        flips = np.cumprod(np.where(np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0, -1.0, 1.0))
        q[1:] *= flips[:, None]  # one branch, so that readers may interpolate
    if trajectory.v_eb_e is not None:
        v = trajectory.v_eb_e @ C_el
    return r_l, q, v


def origin_of(trajectory: Trajectory, stated: str | None = None) -> Origin:
    """The origin stated in degrees and metres, else the first position of a trajectory, rounded to be printed."""
    if stated is not None:
        origin = parse_origin(stated)
        assert origin is not None
        return origin
    lat, lon, h = trajectory.llh[0]
    origin = parse_origin(f"{lat / units.DEG:.9f},{lon / units.DEG:.9f},{h:.4f}")
    assert origin is not None
    return origin


def origin_text(origin: Origin) -> str:
    """``LAT,LON,HEIGHT`` in degrees and metres, as the hint ``origin`` takes it."""
    return f"{origin[0] / units.DEG:.12g},{origin[1] / units.DEG:.12g},{origin[2]:.12g}"
