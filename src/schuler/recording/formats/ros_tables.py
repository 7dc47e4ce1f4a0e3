"""Tables of ROS messages in SI, north-east-down and as ROS's conventions have them (REP 103, 105, 145)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.ros_messages import Messages
from schuler.recording.io import parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table

#: Turns between east-north-up and north-east-down, and forward-left-up and forward-right-down: their own inverses.
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU = np.diag([1.0, -1.0, -1.0])
#: Solution quality (RTKLIB's numbers) of NavSatStatus: fix, satellite-based, ground-based augmentation.
QUALITY = {0: 5, 1: 3, 2: 4}
NO_VELOCITY = 1000.0  # 1-sigma of a velocity that is missing at single epochs [m/s]


def imu_table(m: Messages, t: FloatArray, path: Path, notes: list[str], hints: ReadHints) -> Table:
    """IMU of ``sensor_msgs/Imu``; a sensor whose covariance starts with -1 is not there.

    Parameters
    ----------
    m : Messages
    t : ndarray, shape (n,)
        Times of the messages on the recording's time base. [s]
    path : Path
        For messages.
    notes : list of str
        Takes what was done.
    hints : ReadHints
        ``axes``, forward-left-up if not given.

    Raises
    ------
    FileFormatError
        If stamps go back.
    """
    keep = parts.later(t, "imu", path, notes)
    values = {"t": t[keep]}
    for name, source in (("a", "linear_acceleration"), ("g", "angular_velocity")):
        if (m.values[f"{source}_covariance.0"] == -1.0).all():
            continue  # ROS's way to say that the sensor has none
        values |= {f"{name}{axis}": m.values[f"{source}.{axis}"][keep] for axis in "xyz"}
    if hints.axes is None:
        notes.append("Axes of the IMU are taken as forward, left, up (REP 103); the hint axes says otherwise.")
    return Table(values, axes="FLU")


def gnss_table(
    m: Messages, t: FloatArray, velocity: tuple[Messages, FloatArray] | None, path: Path, notes: list[str]
) -> Table:
    """Fixes of ``sensor_msgs/NavSatFix``, with velocities of a topic of twists if there is one.

    Parameters
    ----------
    m : Messages
    t : ndarray, shape (n,)
        Times of the messages on the recording's time base. [s]
    velocity : tuple of Messages and ndarray, optional
        Twists, east-north-up, and their times [s].
    path : Path
        For messages.
    notes : list of str
        Takes what was done.

    Raises
    ------
    FileFormatError
        If no message has a fix, stamps go back, or fewer than half of the fixes have a velocity.
    """
    place = np.stack([m.values[name] for name in ("latitude", "longitude", "altitude")], axis=1)
    fix = (m.values["status.status"] >= 0) & np.isfinite(place).all(axis=1)
    if not fix.all():
        notes.append(f"gnss: {int((~fix).sum())} messages without a fix were left out.")
    if not fix.any():
        raise FileFormatError("gnss: no message has a fix; leave it out with streams='gnss=none'", path)
    keep = np.flatnonzero(fix)
    keep = keep[parts.later(t[keep], "gnss", path, notes)]
    cov = m.stack("position_covariance", range(9))[keep].reshape(-1, 3, 3)
    values = {
        "t": t[keep],
        "lat": place[keep, 0] * units.DEG,
        "lon": place[keep, 1] * units.DEG,
        "h": place[keep, 2],
        "q": np.array([QUALITY.get(int(s), 5) for s in m.values["status.status"][keep]], dtype=np.float64),
    }
    kinds = m.values["position_covariance_type"][keep]
    if (kinds == 1).any():
        notes.append("gnss: the driver calls its covariances approximate (from dilution of precision).")
    cov[kinds == 0] = 0.0  # not known: a sigma is asked for
    values |= _ned_covariance(cov, "")
    if velocity is not None:
        values |= _velocity(*velocity, values["t"], path, notes)
    return Table(values)


def _velocity(m: Messages, t: FloatArray, epochs: FloatArray, path: Path, notes: list[str]) -> dict[str, FloatArray]:
    """Velocities of a topic of twists, east-north-up, at the stamps of the fixes."""
    order = np.argsort(t, kind="stable")
    t = t[order]
    step = float(np.median(np.diff(epochs))) if len(epochs) > 1 else 1.0
    right = np.clip(np.searchsorted(t, epochs), 1, max(len(t) - 1, 1))
    near = right - (np.abs(epochs - t[right - 1]) <= np.abs(epochs - t[np.minimum(right, len(t) - 1)]))
    matched = np.abs(t[near] - epochs) <= 0.05 * step
    if matched.sum() < 0.5 * len(epochs):
        raise FileFormatError(
            f"velocity: only {int(matched.sum())} of {len(epochs)} fixes have a velocity of the same stamp: is it of "
            "this receiver?",
            path,
        )
    if not matched.all():
        notes.append(
            f"velocity: {int((~matched).sum())} fixes have none; theirs is zero with {NO_VELOCITY:g} m/s 1-sigma."
        )
    twist, pick = ("twist.twist", order[near]) if "twist.covariance.0" in m.values else ("twist", order[near])
    v_n = m.stack(f"{twist}.linear")[pick] @ ENU
    cov = np.zeros((len(epochs), 3, 3))
    if "twist.covariance.0" in m.values:
        cov = m.stack("twist.covariance", range(36))[pick].reshape(-1, 6, 6)[:, :3, :3]
    v_n[~matched] = 0.0
    cov[~matched] = NO_VELOCITY**2 * np.eye(3)
    return {name: v_n[:, k] for k, name in enumerate(("vn", "ve", "vd"))} | _ned_covariance(cov, "v")


def _ned_covariance(cov: FloatArray, stem: str) -> dict[str, FloatArray]:
    """Columns of covariances given east-north-up. Shape (n, 3, 3)."""
    C = ENU @ cov @ ENU
    sigma = np.sqrt(np.maximum(np.einsum("nii->ni", C), 0.0))
    named = {f"s{stem}{axis}": sigma[:, k] for k, axis in enumerate("ned")}
    return named | {f"c{stem}ne": C[:, 0, 1], f"c{stem}nd": C[:, 0, 2], f"c{stem}ed": C[:, 1, 2]}


def reference_table(
    m: Messages, t: FloatArray, origin: tuple[float, float, float], path: Path, notes: list[str]
) -> Table:
    """Poses in a local frame as an Earth-fixed path.

    Parameters
    ----------
    m : Messages
        Messages of any type of pose, see :data:`schuler.recording.formats.ros_recording.PARTS`.
    t : ndarray, shape (n,)
        Times of the messages on the recording's time base. [s]
    origin : tuple of float
        Origin of the local frame, which is east, north, up there: latitude, longitude [rad], height [m].
    path : Path
        For messages.
    notes : list of str
        Takes what was done.

    Raises
    ------
    FileFormatError
        If orientations are no unit quaternions, or stamps go back.
    """
    keep = parts.later(t, "reference", path, notes)
    if "transform.translation.x" in m.values:
        place, turn = "transform.translation", "transform.rotation"
    else:
        stem = "pose.pose" if "pose.pose.position.x" in m.values else "pose"
        place, turn = f"{stem}.position", f"{stem}.orientation"
    C_en = frames.C_en(np.array(origin))
    with np.errstate(invalid="ignore", over="ignore"):  # of damaged numbers, which are refused as positions
        r_e = frames.ecef_from_ned(m.stack(place)[keep] @ ENU, np.array(origin))
    values = {"t": t[keep], **{axis: r_e[:, k] for k, axis in enumerate("xyz")}}
    q = m.stack(turn, ("w", "x", "y", "z"))[keep]
    notes.append("reference: the local frame is taken as east, north, up of the origin (REP 103).")
    if not q.any():
        notes.append("reference: the poses have no orientation.")
    else:
        q = unit_quaternions(
            q, lambda row, text: FileFormatError(f"reference {row + 1}: {text}; is the topic of poses?", path), 1e-3
        )
        C_nb = ENU @ rotation.dcm_from_quat(q) @ FLU
        q_eb = rotation.quat_from_dcm(C_en @ C_nb)
        values |= {name: q_eb[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
        if "twist.twist.linear.x" in m.values:
            with np.errstate(invalid="ignore"):  # what is no number then is refused with its row
                v_e = np.einsum("ij,njk,nk->ni", C_en, C_nb, m.stack("twist.twist.linear")[keep] @ FLU)
            values |= {f"v{axis}": v_e[:, k] for k, axis in enumerate("xyz")}
            notes.append("reference: its velocity is that of the twist, in axes of the body as ROS defines it.")
    return Table(values)


def odometer_table(m: Messages, t: FloatArray, path: Path, notes: list[str], hints: ReadHints) -> Table:
    """Forward speed of twists or odometry, with its variance where it is given and ``sigma_speed`` is not."""
    keep = parts.later(t, "odometer", path, notes)
    with_covariance = "twist.covariance.0" in m.values
    speed = m.values["twist.twist.linear.x" if with_covariance else "twist.linear.x"][keep]
    values = {"t": t[keep], "speed": speed}
    if with_covariance and hints.sigma_speed is None:
        variance = m.values["twist.covariance.0"][keep]
        if (variance > 0.0).all():
            values["sspeed"] = np.sqrt(variance)
    return Table(values)
