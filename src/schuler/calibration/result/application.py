"""A calibration applied to a log: whether it may be, the corrected recording, and its rests before and after."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import earth
from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.calibration.result.parameters import AXES
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.result_file import result_text
from schuler.calibration.result.session import session_of
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.units import DEG_PER_HR, G0, MG

#: What may be passed over: the check of ...
ALLOWANCES = ("serial", "temperature", "units", "corrected")
#: Entry of a recording's options that says what was taken out of its IMU.
APPLIED = "applied_calibration"
#: Beyond the temperatures of the calibration by this much a log is refused; within it errors of cheap sensors move by
#: as much as data sheets allow from one switch-on to the next. [K]
TEMPERATURE_MARGIN = 10.0
_NORM = (0.5, 2.0)  # median specific force that any log of a vehicle or a bench has, in g


@dataclass(frozen=True, eq=False, repr=False)
class AppliedCalibration(Displayed):
    """A log before and after a calibration was applied to it.

    Attributes
    ----------
    calibration : CalibrationResult
    recording : Recording
        Corrected, in SI and the body axes of the calibration; its options and notes say by what.
    before : ImuSeries
        As recorded, times the nominal factors of the calibration: SI.
    rests : RestComparison or None
        None where the log has no rest.
    notes : tuple of str
        What could not be checked, and what was passed over.
    """

    calibration: CalibrationResult
    recording: Recording
    before: ImuSeries
    rests: RestComparison | None
    notes: tuple[str, ...] = ()

    def summary(self) -> str:
        """What was applied, and the rests before and after, as text."""
        m = self.calibration
        lines = [f"{m.method} calibration applied to {self.recording.metadata.name}: {len(self.before)} samples"]
        lines += self.rests.sentences() if self.rests is not None else ["no rest in the log to compare with gravity"]
        return "\n".join([*lines, *self.notes])

    def report(self, path: Path | str) -> Path:
        """Write the page before and after, see :func:`schuler.calibration.report.applied.applied_report`."""
        from schuler.calibration.report.applied import applied_report

        return applied_report(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "applied": self.recording.metadata.options[APPLIED][-1],
            "rests": None if self.rests is None else self.rests.to_dict(),
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class RestComparison:
    """Means over the rests of a log before and after its correction.

    Attributes
    ----------
    start, stop : ndarray, shape (n,)
        [s]
    gravity : float
        Local gravity. [m/s^2]
    gravity_source : str
    f_before, f_after : ndarray, shape (n, 3)
        Mean specific force. [m/s^2]
    omega_before, omega_after : ndarray, shape (n, 3)
        Mean rate; the Earth's is in it. [rad/s]
    sigma_norm : ndarray, shape (n,)
        1-sigma of the norm after, by the calibration's covariance and the noise of the mean. [m/s^2]
    sigma_omega : ndarray, shape (n, 3)
        The same of the rates. [rad/s]
    """

    start: FloatArray
    stop: FloatArray
    gravity: float
    gravity_source: str
    f_before: FloatArray
    f_after: FloatArray
    omega_before: FloatArray
    omega_after: FloatArray
    sigma_norm: FloatArray
    sigma_omega: FloatArray

    @property
    def norm_errors(self) -> tuple[FloatArray, FloatArray]:
        """Norm of the specific force less gravity, before and after. Shapes (n,). [m/s^2]"""
        before, after = (np.linalg.norm(f, axis=1) - self.gravity for f in (self.f_before, self.f_after))
        return before, after

    def sentences(self) -> list[str]:
        """RMS over the rests before and after, against what the calibration claims."""
        before, after = (_rms(e) / MG for e in self.norm_errors)
        claimed = _rms(self.sigma_norm) / MG
        rates = [_rms(w, axis=0) / DEG_PER_HR for w in (self.omega_before, self.omega_after)]
        return [
            f"{len(self.start)} rests: norm of the specific force off gravity ({self.gravity:.5f} m/s^2, "
            f"{self.gravity_source}) by {before:.3g} mg RMS before, {after:.3g} mg after (claimed {claimed:.2g})",
            "rates at rest, RMS by axis before: "
            + ", ".join(f"{v:.4g}" for v in rates[0])
            + " deg/h; after: "
            + ", ".join(f"{v:.4g}" for v in rates[1])
            + " deg/h (15 of them are the Earth's)",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON. SI"""
        before, after = self.norm_errors
        return {
            "count": len(self.start), "gravity_m_s2": self.gravity, "gravity_source": self.gravity_source,
            "norm_error_before_m_s2": _rms(before), "norm_error_after_m_s2": _rms(after),
            "norm_error_claimed_m_s2": _rms(self.sigma_norm),
            "rate_before_rad_s": _rms(self.omega_before, axis=0), "rate_after_rad_s": _rms(self.omega_after, axis=0),
        }  # fmt: skip


@explains_arguments
def apply_calibration(
    calibration: CalibrationResult,
    recording: Recording,
    *,
    serial: str = "",
    gravity: float | None = None,
    allow: Collection[str] = (),
) -> AppliedCalibration:
    """Take the calibrated errors out of a log that the calibration holds for.

    Parameters
    ----------
    calibration : CalibrationResult
    recording : Recording
        In the units that the calibrated log was read in (SI, or counts).
    serial : str
        Serial number of the unit that recorded the log, where its metadata do not have it.
    gravity : float, optional
        Local gravity, for the comparison at rest; default: at the GNSS fixes or reference of the log, else that of the
        calibration. [m/s^2]
    allow : collection of str
        Checks to pass over: ``serial``, ``temperature``, ``units``, ``corrected``.

    Returns
    -------
    AppliedCalibration

    Raises
    ------
    InputError
        If the calibration is of another unit, the log is more than :data:`TEMPERATURE_MARGIN` outside of the
        temperatures it was calibrated at, not in its units, or corrected already; ``allow`` passes over it, except for
        a calibration over temperature, which says nothing outside of its range.

    Examples
    --------
    >>> from schuler.calibration import result_from
    >>> calibration = result_from("sixposition", {"b_g_x": (1e-3, 1e-5)}, "full")
    >>> at_rest = np.broadcast_to([0.0, 0.0, 9.81], (3000, 3))
    >>> log = schuler.Recording(schuler.ImuSeries(np.arange(3000) / 100.0, np.full((3000, 3), 1e-3), at_rest))
    >>> applied = schuler.apply_calibration(calibration, log, gravity=9.81)
    >>> print(applied.recording.imu.gyro[0])
    [0.    0.001 0.001]
    """
    if unknown := sorted(set(allow) - set(ALLOWANCES)):
        raise InputError(f"allow: expected any of {', '.join(ALLOWANCES)}, got {', '.join(unknown)}")
    imu = recording.need_imu()
    entry = description(calibration)
    faults, notes = _faults(calibration, recording, entry, serial)
    accel, gyro = calibration.nominal
    before = replace(imu, accel=imu.accel * accel, gyro=imu.gyro * gyro)
    if "units" not in allow and (fault := _unit_fault(calibration, before)):
        raise InputError(f"{fault}; to go on nevertheless allow units")
    for name, sentence in faults.items():
        if name not in allow:
            raise InputError(f"{sentence}; to go on nevertheless allow {name}")
        notes.append(f"passed over ({name}): {sentence}")
    after = calibration.apply(imu)
    if serial:
        entry["log_serial"] = serial
    unsure = [n for n, s in zip(calibration.names, calibration.sigma, strict=True) if not np.isfinite(s)]
    if unsure:
        notes.append(f"not determined by the calibration, taken out as it has them: {', '.join(unsure)}")
    left = [n for n in (*calibration.names, *calibration.fixed) if n[:3] in ("Q_a", "r_a", "del")]
    if left:
        notes.append(f"not taken out, which needs more than a sample: {', '.join(left)}")
    unit = f" of {entry['serial']}" if "serial" in entry else ""
    sentence = (
        f"The {calibration.method} calibration{unit} ({entry['sha256'][:12]}) was applied: biases, response"
        f"{' and g-sensitivity' if calibration.errors.G_g.any() else ''} are taken out, body axes are its own "
        f"(gauge {calibration.gauge})."
    )
    # what was noted of counts holds no more
    kept = tuple(n for n in recording.metadata.notes if "raw counts, not SI" not in n)
    earlier = list(recording.metadata.options.get(APPLIED, []))
    metadata = replace(
        recording.metadata, notes=(*kept, sentence, *(f"{n[:1].upper()}{n[1:]}." for n in notes)),
        options={**recording.metadata.options, APPLIED: [*earlier, entry]},
    )  # fmt: skip
    corrected = replace(recording, imu=after, metadata=metadata)
    return AppliedCalibration(
        calibration, corrected, before, _rests(calibration, corrected, before, gravity), tuple(notes)
    )


def description(calibration: CalibrationResult) -> dict[str, Any]:
    """What a corrected log says of the calibration: checksum of its contents, method, unit, date, parameters."""
    session = session_of(calibration)
    stated = {n: v for n in ("serial", "date", "place", "operator") if (v := getattr(session, n))}
    return {
        "sha256": hashlib.sha256(result_text(calibration).encode()).hexdigest(), "method": calibration.method,
        "gauge": calibration.gauge, "nominal": list(calibration.nominal), **stated,
        "parameters": calibration.parameters,
    }  # fmt: skip


def _faults(
    calibration: CalibrationResult, recording: Recording, entry: dict[str, Any], serial: str
) -> tuple[dict[str, str], list[str]]:
    """What speaks against applying a calibration to a log, by the name that allows it, and what cannot be checked."""
    session, name = session_of(calibration), recording.metadata.name
    faults, notes = {}, []
    of_log = serial or str(recording.metadata.options.get("serial", ""))
    if session.serial and of_log and session.serial != of_log:
        faults["serial"] = f"{name}: expected a log of the calibrated unit {session.serial}, got one of {of_log}"
    elif not (session.serial and of_log):
        missing = "the calibration" if not session.serial else "the log"
        notes.append(f"not checked that both are of one unit: {missing} has no serial number")
    imu = recording.need_imu()
    T = None if imu.temperature is None else imu.temperature[np.isfinite(imu.temperature)]
    span = session.temperature_range
    if span is None and calibration.temperature is not None:
        span = (calibration.temperature, calibration.temperature)
    if "thermal" in calibration.extra:
        if T is None or not len(T):
            faults["temperature"] = (
                f"{name}: expected a log with temperature, for a calibration over temperature, got none; without it "
                f"the values at {calibration.extra['thermal']['reference_temperature']:.1f} degC are taken out"
            )
    elif T is None or not len(T) or span is None:
        missing = "the calibration" if span is None else "the log"
        notes.append(f"not checked that it holds at the temperature of the log: {missing} has none")
    else:
        middle = float(np.median(T))
        if not span[0] - TEMPERATURE_MARGIN <= middle <= span[1] + TEMPERATURE_MARGIN:
            faults["temperature"] = (
                f"{name}: expected temperatures within {TEMPERATURE_MARGIN:g} K of the calibration "
                f"({span[0]:.1f} to {span[1]:.1f} degC), got a median of {middle:.1f} degC; calibrate there, or over "
                "temperature (schuler calibrate thermal)"
            )
    earlier = recording.metadata.options.get(APPLIED, [])
    # a calibration made of corrected logs finds what was left in them
    own = [e for o in calibration.provenance.get("recording_options", []) for e in o.get(APPLIED, [])]
    inherited = {e.get("sha256") for e in own}
    again = [e for e in earlier if e.get("sha256") not in inherited]
    if again:
        same = again[-1].get("sha256") == entry["sha256"]
        faults["corrected"] = (
            f"{name}: expected a log as recorded, got one that is corrected already by "
            f"{'this calibration' if same else 'another calibration'} ({again[-1].get('method')}, "
            f"{str(again[-1].get('sha256'))[:12]}); give the log it was made from"
        )
    return faults, notes


def _unit_fault(calibration: CalibrationResult, before: ImuSeries) -> str | None:
    """A sentence where the specific force cannot be in the units of the calibration; ``before`` is in SI if it is."""
    if not before.accel.any():  # zeros hold the place of a triad that is missing
        return None
    # biases of a converter without sign are half of its range, tens of g
    size = float(np.median(np.linalg.norm(before.rates().accel - calibration.errors.b_a, axis=1))) / G0
    if _NORM[0] < size < _NORM[1]:
        return None
    accel, gyro = calibration.nominal
    units = "SI" if (accel, gyro) == (1.0, 1.0) else f"{accel:g} m/s^2 and {gyro:g} rad/s"
    return (
        f"expected a log in the units of the calibrated one ({units}), got a specific force with a median of "
        f"{size:.3g} g in them; read the log as the calibrated one was read (--units)"
    )


def local_gravity(recording: Recording) -> tuple[float, str] | None:
    """Normal gravity at the first fix or reference of a recording, and its origin in words; None without. [m/s^2]"""
    if recording.gnss is not None:
        latitude, height, source = *recording.gnss.llh[0, [0, 2]], "normal gravity at the GNSS fixes"
    elif recording.reference is not None:
        latitude, height, source = *recording.reference.llh[0, [0, 2]], "normal gravity at the reference"
    else:
        return None
    return float(earth.gravity_somigliana(float(latitude), float(height))), source


def _rests(
    calibration: CalibrationResult, corrected: Recording, before: ImuSeries, gravity: float | None
) -> RestComparison | None:
    from schuler.calibration.bench.poses import poses_of

    session, at_log = session_of(calibration), local_gravity(corrected)
    if gravity is not None:
        g, source = gravity, "as stated"
    elif at_log is not None:
        g, source = at_log
    elif session.gravity is not None:
        g, source = session.gravity, "of the calibration"
    else:
        g, source = G0, "standard gravity, nothing being known of the place"
    imu = corrected.need_imu()
    try:
        poses = poses_of(imu, gravity=g)
    except InputError:
        return None
    raw = poses_of(before, list(zip(poses.start, poses.stop, strict=True)), gravity=g)
    sigma_norm, sigma_omega = _claimed(calibration, poses.f, poses.omega)
    noise = np.sqrt(np.mean(poses.sigma_f**2, axis=1))
    return RestComparison(
        poses.start, poses.stop, g, source, raw.f, poses.f, raw.omega, poses.omega,
        np.hypot(sigma_norm, noise), np.hypot(sigma_omega, poses.sigma_omega),
    )  # fmt: skip


def _claimed(calibration: CalibrationResult, f: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
    """1-sigma of the norm of f, shape (n,), and of the rates, (n, 3), after correction, by the covariance alone."""
    e, n = calibration.errors, len(f)
    A_a, A_g = (np.linalg.inv(np.eye(3) + M) for M in (e.M_a, e.M_g))
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    J_f, J_w = np.zeros((n, 3, len(calibration.names))), np.zeros((n, 3, len(calibration.names)))
    for k, name in enumerate(calibration.names):
        if name[:3] not in ("b_a", "M_a", "b_g", "M_g", "G_g"):
            continue
        i, one = AXES.index(name[4]), np.ones(n)
        by = one if name[0] == "b" else (omega if name[:3] == "M_g" else f)[:, AXES.index(name[5])]
        if name[2] == "a":
            J_f[:, :, k] = -np.outer(by, A_a[:, i])
        else:
            J_w[:, :, k] = -np.outer(by, A_g[:, i])
    J_w -= np.einsum("ij,njk->nik", A_g @ e.G_g, J_f)
    determined = np.isfinite(calibration.sigma)
    C = calibration.covariance[np.ix_(determined, determined)]
    J_n, J_w = np.einsum("ni,nik->nk", up, J_f)[:, determined], J_w[:, :, determined]
    norm = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", J_n, C, J_n), 0.0))
    return norm, np.sqrt(np.maximum(np.einsum("nik,kl,nil->ni", J_w, C, J_w), 0.0))


def _rms(x: FloatArray, axis: int | None = None) -> Any:
    value = np.sqrt(np.mean(np.square(x), axis=axis))
    return float(value) if axis is None else value
