"""GNSS tables and reference paths in SI: heights made ellipsoidal, covariances built, quality checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.recording.io import columns, over_ground
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.possible import MAX_SIGMA
from schuler.recording.io.raw import Raw
from schuler.recording.recording import Recording
from schuler.recording.series import QUALITY, GnssSeries, positive_definite, stated_dilution
from schuler.recording.trajectory import Trajectory

_MANY = 20_000  # samples from which loading compiled code is worth its fraction of a second


def gnss_series(raw: Raw, hints: ReadHints, t: FloatArray) -> GnssSeries:
    """GNSS series of columns in SI.

    Parameters
    ----------
    raw : Raw
        With lat, lon, h and any of the other GNSS columns, in SI; takes the notes.
    hints : ReadHints
        ``height``, ``geoid_separation``, ``sigma`` and ``allow`` are used.
    t : ndarray, shape (n,)
        [s]

    Raises
    ------
    FileFormatError
        For impossible positions and qualities, and for accuracies that are missing or not positive.
    """
    no_height = raw.has(("lat", "lon")) and "h" not in raw.values
    if no_height:
        _without_heights(raw, hints)
    llh = _geodetic(raw, hints)
    v_n, cov_v_n = None, None
    _sigmas_of_radius(raw)
    cov_r_n = _covariance(raw, hints, columns.SIGMA, columns.CROSS, 0)
    if no_height:
        cov_r_n[:, 2, :] = cov_r_n[:, :, 2] = 0.0
        cov_r_n[:, 2, 2] = over_ground.NO_HEIGHT**2
    if _over_ground(raw, hints, t, llh):
        hints = replace(hints, sigma=None)  # what it says of velocity is in them
    level = raw.has(columns.VELOCITY[:2]) and "vd" not in raw.values
    if level:
        raw.values["vd"] = np.zeros(len(t))
        if raw.has(columns.VELOCITY_SIGMA[:2]):
            raw.values["svd"] = np.full(len(t), over_ground.NO_VERTICAL_RATE)
        raw.notes.append("There is no vertical velocity: it is zero with a 1-sigma of 10 m/s.")
    if any(name in raw.values for name in columns.VELOCITY):
        if not raw.has(columns.VELOCITY):
            raise raw.fault(
                "a velocity needs vn and ve (north, east), vd (down) where there is one; name them or skip them with -"
            )
        with_sigma = raw.has(columns.VELOCITY_SIGMA) or len(hints.sigmas or ()) == 6
        if with_sigma or not hints.allows("no-velocity"):
            v_n = raw.stack(columns.VELOCITY)
            cov_v_n = _covariance(raw, hints, columns.VELOCITY_SIGMA, columns.VELOCITY_CROSS, 3)
            if level:
                cov_v_n[:, 2, :] = cov_v_n[:, :, 2] = 0.0
                cov_v_n[:, 2, 2] = over_ground.NO_VERTICAL_RATE**2
        else:
            raw.notes.append("Velocities come without an accuracy and were left out.")
    quality = _integers(raw, "q")
    if quality is not None:
        bad = np.flatnonzero((quality < min(QUALITY)) | (quality > max(QUALITY)))
        if len(bad):
            meanings = ", ".join(f"{k} {v}" for k, v in QUALITY.items())
            raise raw.fault(f"expected a quality q of {meanings}, got {quality[bad[0]]}: skip the column", int(bad[0]))
    dop = stated_dilution(*(raw.values.get(name) for name in columns.DILUTION))
    return GnssSeries(t, llh, cov_r_n, v_n, cov_v_n, quality, _integers(raw, "ns"), raw.values.get("received"), dop)


def _sigmas_of_radius(raw: Raw) -> None:
    """1-sigma of the axes from the radius of 68 % that phones state, where it was measured."""
    radius = raw.values.get("radius")
    if radius is None or raw.has(columns.SIGMA[:2]):
        return
    if not np.all(radius > 0.0):
        raw.notes.append("The accuracies of single fixes are zero or missing, so that none is used.")
        return
    sigma = radius / over_ground.CIRCLE_68
    raw.values |= {"sn": sigma, "se": sigma}
    vertical = raw.values.get("sd")
    raw.notes.append("Accuracies are radii of 68 %; 1-sigma of north and east is the radius by 1.51.")
    if vertical is None or not over_ground.measured(vertical, radius):
        raw.values["sd"] = 2.0 * radius
        raw.notes.append("No vertical accuracy was measured: twice the horizontal one is taken.")


def _without_heights(raw: Raw, hints: ReadHints) -> None:
    """Heights of zero for latitudes and longitudes alone; their 1-sigma keeps them from saying anything."""
    if hints.height is not None:
        raise raw.fault(f"height={hints.height!r}, but no column is a height: name it with columns='...,h=Altitude'")
    raw.values["h"] = np.zeros(len(raw.values["lat"]))
    raw.ellipsoidal = True
    if raw.has(columns.SIGMA[:2]):
        raw.values["sd"] = np.full(len(raw.values["lat"]), over_ground.NO_HEIGHT)
    raw.notes.append(
        "There is no height beside latitude and longitude: it is zero with a 1-sigma of "
        f"{over_ground.NO_HEIGHT:g} m, and heights of the solution mean nothing (columns='...,h=Altitude' names one)."
    )


def _over_ground(raw: Raw, hints: ReadHints, t: FloatArray, llh: FloatArray) -> bool:
    """Make velocities of the columns speed and course where there are no others; whether that was done."""
    if not raw.has(("speed", "course")):
        return False
    if any(name in raw.values for name in columns.VELOCITY):
        raw.notes.append("Speed and course were not used: there are velocities.")
        return False
    speed, course, sigma = raw.values["speed"], raw.values["course"], raw.values.get("sspeed")
    if sigma is None and len(hints.sigmas or ()) == 6:
        sigma = np.full(len(t), max((hints.sigmas or ())[3:5]))
    # phones write -1 for a fix without one; courses of -180 to 180 degrees are courses
    still = speed < 0.0
    without = still | ((course < 0.0) & bool(course.min() > -1.001 * units.DEG))
    speed, course = np.where(still, np.nan, speed), np.where(without, np.nan, course)
    made = over_ground.velocities(t, (llh[:, 0], llh[:, 1]), speed, course, (sigma, None), raw.notes)
    raw.values |= made
    return bool(made)


def _geodetic(raw: Raw, hints: ReadHints) -> FloatArray:
    if not raw.has(columns.GEODETIC):
        missing = [name for name in columns.GEODETIC if name not in raw.values]
        raise raw.fault(
            f"a position needs lat, lon and h, but {', '.join(missing)} is missing: name the columns, such as "
            "columns='t=Time,lat=Latitude,lon=Longitude,h=Altitude'"
        )
    llh = np.stack([raw.values[name] for name in columns.GEODETIC], axis=1)  # of its own: it is changed here
    for column, name, limit in ((0, "latitude", 90.0), (1, "longitude", 360.0)):
        bad = np.flatnonzero(np.abs(llh[:, column]) > (limit + 1e-9) * units.DEG)
        if len(bad):
            raise raw.fault(
                f"{name} {llh[bad[0], column] / units.DEG:.6g} deg is beyond +-{limit:g}: are latitude and longitude "
                "exchanged, or in another unit (units='angle=...')?",
                int(bad[0]),
            )
    # rounding of 90 deg must not make a latitude beyond the pole
    llh[:, 0] = np.clip(llh[:, 0], -0.5 * np.pi, 0.5 * np.pi)
    beyond = np.abs(llh[:, 1]) > np.pi
    llh[beyond, 1] = frames.wrap_angle(llh[beyond, 1])
    if hints.height == "msl":
        llh[:, 2] += float(hints.geoid_separation or 0.0)
        raw.notes.append(
            f"Heights above mean sea level were made ellipsoidal with a geoid separation {hints.geoid_separation:g} m."
        )
    elif hints.height is None and not raw.ellipsoidal:
        raw.notes.append("Heights are taken as ellipsoidal (hint height says otherwise).")
    return llh


def _covariance(raw: Raw, hints: ReadHints, names: tuple[str, ...], cross: tuple[str, ...], first: int) -> FloatArray:
    """Covariances north, east, down of 1-sigma columns, the hint sigma in place of those missing or zero."""
    n, given = len(next(iter(raw.values.values()))), (hints.sigmas or ())[first : first + 3]
    what = "position" if first == 0 else "velocity"
    advice = (
        "say sigma='N,E,D' [m]"
        if first == 0
        else "say sigma with six numbers (position [m], velocity [m/s]), or pass allow='no-velocity'"
    )
    if not raw.has(names):
        if not given:
            raise raw.fault(f"there is no accuracy of {what} ({', '.join(names)}): {advice}")
        sigma = np.tile(np.array(given), (n, 1))
        raw.notes.append(f"The log has no accuracy of {what}; 1-sigma north, east, down is taken as {given}.")
    else:
        sigma = raw.stack(names)
        if given and np.all(sigma > 0.0):
            raw.notes.append(f"The hint sigma was not used: the file has accuracies of {what}.")
        zero = np.flatnonzero(np.any(sigma <= 0.0, axis=1))
        if len(zero):
            if not given:
                raise raw.fault(
                    f"expected a positive 1-sigma of {what}, got {sigma[zero[0]].min():g}: {advice}", int(zero[0])
                )
            sigma[zero] = given
            raw.notes.append(f"{len(zero)} epochs had no accuracy of {what}; 1-sigma was set to {given}.")
    cov = np.zeros((n, 3, 3))
    for k in range(3):
        np.square(sigma[:, k], out=cov[:, k, k])
    if raw.has(cross):
        for name, (i, j) in zip(cross, ((0, 1), (0, 2), (1, 2)), strict=True):
            cov[:, i, j] = cov[:, j, i] = raw.values[name]
        beyond = np.flatnonzero(np.abs(raw.stack(cross)).max(axis=1) > MAX_SIGMA**2)
        if len(beyond):
            row = int(beyond[0])
            raise raw.fault(
                f"expected cross terms of the covariance of {what} up to {MAX_SIGMA**2:.0e} ({', '.join(cross)}), got "
                f"{np.abs(raw.stack(cross)[row]).max():.3g}: a damaged number or another unit", row
            )  # fmt: skip
        definite = positive_definite(cov)
        if not definite.all():
            cov[~definite] *= np.eye(3)
            raw.notes.append(
                f"At {int((~definite).sum())} epochs the rounded covariance of {what} was not positive definite; "
                "its cross terms were dropped."
            )
    return cov


def _integers(raw: Raw, name: str) -> IntArray | None:
    if name not in raw.values:
        return None
    values = raw.values[name]
    if not ((values >= 0.0) & (values <= 1e6)).all() or (np.rint(values) != values).any():
        bad = np.flatnonzero((values != np.round(values)) | (values < 0.0) | (values > 1e6))
        raise raw.fault(f"{name}: expected a whole number, got {values[bad[0]]:g}", int(bad[0]))
    return values.astype(np.int64)


def reference_path(raw: Raw, hints: ReadHints, t: FloatArray) -> Trajectory:
    """Reference of columns in SI, Earth-fixed or geodetic, with velocity and attitude where there are any."""
    if raw.has(columns.ECEF):
        v = raw.stack(columns.ECEF_VELOCITY) if raw.has(columns.ECEF_VELOCITY) else None
        q = raw.stack(columns.QUATERNION) if raw.has(columns.QUATERNION) else None
        if q is not None:
            q = unit_quaternions(
                q, lambda row, text: raw.fault(f"qw, qx, qy, qz: {text}, scalar first", row), tolerance=1e-3
            )
        return Trajectory(t, raw.stack(columns.ECEF), v, q)
    llh = _geodetic(raw, hints)
    v_n = raw.stack(columns.VELOCITY) if raw.has(columns.VELOCITY) else None
    rpy = raw.stack(columns.EULER) if raw.has(columns.EULER) else None
    raw.notes.append("The reference is taken as the path of the IMU itself; no lever arm was applied.")
    if len(t) >= _MANY:
        return _compiled(t, llh, v_n, rpy)
    return Trajectory.from_geodetic(t, llh, v_n, None if rpy is None else rotation.dcm_from_rpy(rpy))


def _compiled(t: FloatArray, llh: FloatArray, v_n: FloatArray | None, rpy: FloatArray | None) -> Trajectory:
    """:meth:`Trajectory.from_geodetic` of many samples."""
    from schuler.recording import _kernels

    _kernels.prepare_earth_fixed()
    none = np.empty((0, 3))
    r = np.empty_like(llh)
    v_e, q_eb = (np.empty_like(llh) if v_n is not None else none), np.empty((0 if rpy is None else len(t), 4))
    _kernels.earth_fixed(
        np.ascontiguousarray(llh),
        none if v_n is None else np.ascontiguousarray(v_n),
        none if rpy is None else np.ascontiguousarray(rpy),
        r,
        v_e,
        q_eb,
    )
    return Trajectory(t, r, None if v_n is None else v_e, None if rpy is None else q_eb)


def reference_from_gnss(recording: Recording) -> Recording:
    """The same recording with its GNSS solution as the reference instead of as a measurement."""
    gnss = recording.gnss
    if gnss is None:
        raise InputError(f"{recording.metadata.name} has no GNSS series to take as the reference")
    note = "The reference is a GNSS solution, of the antenna; no lever arm was applied."
    reference = Trajectory.from_geodetic(gnss.t, gnss.llh, gnss.v_n)
    return replace(recording, gnss=None, reference=reference, metadata=recording.metadata.noting(note))


def with_truth_fixes(recording: Recording, period_s: float, sigma_m: float) -> Recording:
    """The same recording with fixes drawn about its reference, which stays what results are compared with.

    Parameters
    ----------
    recording : Recording
    period_s : float
        Of the fixes, on whole periods of the clock. [s]
    sigma_m : float
        1-sigma north, east and down of the noise that is drawn, the same in every run, and stated. [m]

    Raises
    ------
    InputError
        If there is no reference, there are fixes already, or the reference is too short.
    """
    reference, name = recording.reference, recording.metadata.name
    if reference is None or recording.gnss is not None:
        what = "there is no reference" if reference is None else "there are fixes"
        raise InputError(f"{name}: truth_fixes makes fixes of the reference of a log that has no others, but {what}")
    t = period_s * np.arange(np.ceil(reference.t[0] / period_s), np.floor(reference.t[-1] / period_s) + 1.0)
    if len(t) < 2:
        raise InputError(f"{name}: truth_fixes: the reference is shorter than two periods of {period_s:g} s")
    at = reference.at(t)
    noise = sigma_m * np.random.default_rng(len(t)).standard_normal((len(t), 3))
    r_e = at.r_eb_e + np.einsum("nij,nj->ni", frames.C_en(at.llh), noise)
    cov = np.broadcast_to(sigma_m**2 * np.eye(3), (len(t), 3, 3)).copy()
    note = (
        f"Fixes are no measurements: the reference every {period_s:g} s with noise of {sigma_m:g} m added. Errors "
        "beside the reference say how well the IMU is integrated, not how good a receiver would be."
    )
    return replace(
        recording, gnss=GnssSeries(t, frames.llh_from_ecef(r_e), cov), metadata=recording.metadata.noting(note)
    )
