"""Numbers of a recording that no vehicle, sensor, satellite and clock has, looked for without the gate of the readers.

The limits are those of issue texts and data sheets, written down here a second time on purpose: a gate that forgets a
series (:func:`schuler.recording.io.possible.check_possible`) is noticed.
"""

from collections.abc import Iterator

import numpy as np

from schuler.recording import Recording

G0 = 9.80665
#: Most that each number may be, by series and field, sign apart. [SI]
LIMITS = {
    "imu": {"t": 1e11, "gyro": 100.0, "accel": 200 * G0, "temperature": 2000.0, "magnetometer": 0.1},
    "gnss": {"t": 1e11, "llh": 1e8, "cov_r_n": 1e14, "v_n": 12e3, "cov_v_n": 1e14, "received": 1e11},
    "odometer": {"t": 1e11, "speed": 1e3, "sigma": 1e7},
    "heading": {"t": 1e11, "value": 1e3, "sigma": 1e3},
    "height": {"t": 1e11, "value": 1e8, "sigma": 1e7},
    "reference": {"t": 1e11, "r_eb_e": 1e8, "v_eb_e": 12e3, "q_eb": 1.0 + 1e-6},
    "observations": {"t": 1e11, "pseudorange": 1e9, "range_rate": 1e6, "carrier": 1e12, "cn0": 1e3},
    "ranges": {"t": 1e11, "r_sat_e": 1e9, "v_sat_e": 1e5, "pseudorange": 1e9, "range_rate": 1e6, "sigma_range": 1e7,
               "sigma_rate": 1e7, "elevation": 1e3, "azimuth": 1e3, "cn0": 1e3},
}  # fmt: skip
#: Fields in which NaN means "not measured", by their docstrings.
HOLES = {("observations", name) for name in ("pseudorange", "range_rate", "carrier", "cn0")} | {
    ("ranges", name) for name in LIMITS["ranges"] if name != "t"
}
ORBITS = {"sqrt_a": 2e4, "e": 1.0, "toe": 1e11, "toc": 1e11, "r_e": 1e8, "v_e": 1e5, "accuracy": 1e7}


def impossible(recording: Recording) -> list[str]:
    """Sentences on numbers that cannot be, and of which no note of the recording speaks; empty if there are none."""
    return list(_impossible(recording))


def _impossible(recording: Recording) -> Iterator[str]:
    notes = " ".join(recording.metadata.notes)
    for name, fields in LIMITS.items():
        series = getattr(recording, name)
        if series is None:
            continue
        for field, limit in fields.items():
            values = getattr(series, field)
            if values is None:
                continue
            if name == "imu" and field in ("gyro", "accel", "magnetometer"):
                # as rates; counts and other units are said
                if "another unit?" in notes or "counts" in notes:
                    limit = 1e20  # more than 64 bits count
                elif series.kind == "increment" and len(series) > 1 and field != "magnetometer":
                    dt = np.maximum(np.diff(series.t, prepend=series.t[0] - series.interval), series.interval)
                    with np.errstate(over="ignore"):
                        values = values / dt[:, None]
            if (name, field) in HOLES:
                values = values[~np.isnan(values)]
            if values.size and not (float(values.max()) <= limit and float(values.min()) >= -limit):
                yield f"{name}.{field}: {values.min():.6g} to {values.max():.6g}, at most {limit:.6g}"
    if (gnss := recording.gnss) is not None:
        if np.abs(gnss.llh[:, 0]).max(initial=0.0) > np.pi / 2 + 1e-9 or gnss.llh[:, 2].min(initial=0.0) < -12e3:
            yield "gnss: a latitude beyond a pole, or a height below the sea's ground"
        if np.abs(gnss.llh[:, 1]).max(initial=0.0) > 2 * np.pi + 1e-6:
            yield f"gnss: a longitude of {np.abs(gnss.llh[:, 1]).max():.6g} rad"
        if np.linalg.eigvalsh(gnss.cov_r_n).min(initial=1.0) < -1e-6 * gnss.cov_r_n.max(initial=1.0):
            yield "gnss: a covariance that is none"
    temperature = None if recording.imu is None else recording.imu.temperature
    if temperature is not None and temperature.min(initial=0.0) < -273.15:
        yield "imu: a temperature below absolute zero"
    if (reference := recording.reference) is not None and len(reference):
        radius = np.linalg.norm(reference.r_eb_e, axis=1)
        if radius.min() < 6.3e6:
            yield f"reference: {radius.min():.6g} m from the Earth's centre"
        if reference.q_eb is not None and np.abs(np.linalg.norm(reference.q_eb, axis=1) - 1.0).max() > 1e-6:
            yield "reference: a quaternion that is not of norm 1"
    for name in ("imu", "gnss", "odometer", "heading", "height", "reference"):
        series = getattr(recording, name)
        if series is not None and len(series) > 1 and np.diff(series.t).min() <= 0.0:
            yield f"{name}: times that do not increase"
    if (ephemerides := recording.ephemerides) is not None:
        for records in (ephemerides.kepler, ephemerides.glonass):
            for field, limit in ORBITS.items():
                values = getattr(records, field, None)
                if values is not None and field == "accuracy":
                    values = values[~np.isnan(values)]  # where none is stated
                if values is not None and values.size and not np.abs(values).max() <= limit:
                    yield f"ephemerides.{field}: {np.abs(values).max():.6g}, at most {limit:.6g}"
            for field, values in vars(records).items():
                stated = field not in ("sent", "group_delay", "accuracy") and np.issubdtype(values.dtype, np.floating)
                if stated and not np.isfinite(values).all():
                    yield f"ephemerides.{field}: not a number"
