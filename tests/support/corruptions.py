"""Single faults and random pairs of them, of a good recording or of its text logs, and the codes that name them.

What a fault is called follows ``schuler.diagnosis.CODES``. Where physics cannot tell two causes apart either code is
right, and it says so here. Sizes are drawn by the generator: a fault of another seed is another fault. A pair is named
only if both of its faults are.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory
from schuler.units import DEG, G0, KMH, KNOT

SWAP_XY = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
FLU = np.diag([1.0, -1, -1])
RFU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
SIDE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
I3 = np.eye(3)

#: Order in which faults happen: in the sensor, in the logger, in the converter that writes the log.
ORDER = ("reading", "sampling", "GNSS", "velocity", "position", "height", "axes", "accel unit", "gyro unit", "kind",
         "clock", "text")  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """One thing wrong with a log.

    Attributes
    ----------
    name : str
    codes : set of str
        Any of them, as error or warning, names it.
    group : str
        What it acts on: two faults of one group are not put together.
    apply : callable
        Recording and generator to the spoilt recording, or for faults of a text the rows of a log to spoilt rows.
    hides : set of str
        Groups that nobody could see beside it.
    text : str
        Log whose rows it spoils, imu or gnss; empty for faults of the recording.
    """

    name: str
    codes: frozenset[str]
    group: str
    apply: Callable
    hides: frozenset[str] = frozenset()
    text: str = ""

    def named_by(self, findings) -> bool:
        return any(findings.has(code) for code in self.codes)


def _imu(change):
    return lambda r, rng: replace(r, imu=replace(r.imu, **change(r.imu, rng)))


def _gnss(change):
    return lambda r, rng: replace(r, gnss=replace(r.gnss, **change(r.gnss, rng)))


def _scaled(accel=1.0, gyro=1.0):
    return _imu(lambda i, rng: {"accel": i.accel * _size(accel, rng), "gyro": i.gyro * _size(gyro, rng)})


def _size(size, rng):
    return size(rng) if callable(size) else size


def _between(low, high, *, sign=(1.0,)):
    """A size between two, evenly in its logarithm."""

    def draw(rng):
        return rng.choice(sign) * np.exp(rng.uniform(np.log(low), np.log(high)))

    return draw


def _turned(A, G):
    A, G = np.asarray(A, float), np.asarray(G, float)
    return _imu(lambda i, rng: {"accel": i.accel @ A.T, "gyro": i.gyro @ G.T})


def _shifted(seconds):
    return _imu(lambda i, rng: {"t": i.t + _size(seconds, rng)})


def _drift(rate):
    return _imu(lambda i, rng: {"t": i.t[0] + (i.t - i.t[0]) * (1.0 + _size(rate, rng))})


def _place(factor):
    return _gnss(lambda g, rng: {"llh": g.llh * factor})


def _velocity(factor, order=(0, 1, 2)):
    return _gnss(lambda g, rng: {"v_n": g.v_n[:, order] * factor})


def _means(x, n):
    n |= 1
    return np.stack([np.convolve(np.pad(c, n // 2, mode="edge"), np.ones(n) / n, "valid") for c in x.T], axis=1)


def _linear(i, rng):
    return {"accel": i.accel - _means(i.accel, int(10.0 / i.interval))}


def _moving(i, length):
    """First sample of a stretch of so many samples that is full of motion."""
    w = np.abs(i.gyro).sum(axis=1)
    sums = np.convolve(w, np.ones(length), "valid")
    return int(np.argmax(sums))


def _stuck(i, rng):
    n = int(4.0 / i.interval)
    k, w = _moving(i, n), i.gyro.copy()
    w[k : k + n, 2] = w[k, 2]
    return {"gyro": w}


def _stuck_accel(i, rng):
    n = int(4.0 / i.interval)
    k, f = _moving(i, n), i.accel.copy()
    f[k : k + n, 0] = f[k, 0]
    return {"accel": f}


def _spikes(i, rng):
    f = i.accel.copy()
    f[rng.integers(100, len(f) - 100, 10), 1] += 90.0
    return {"accel": f}


def _gyro_spikes(i, rng):
    w = i.gyro.copy()
    w[rng.integers(100, len(w) - 100, 10), 0] += 12.0
    return {"gyro": w}


def _gaps(i, rng):
    keep = np.ones(len(i), dtype=bool)
    for _ in range(4):
        k = int(rng.integers(500, len(i) - 900))
        keep[k : k + int(rng.integers(80, 300))] = False
    return {"t": i.t[keep], "gyro": i.gyro[keep], "accel": i.accel[keep], "temperature": None}


def _resampled(i, rng):
    t = np.arange(i.t[0], i.t[-1], i.interval / 2.6)
    at = [np.stack([np.interp(t, i.t, x) for x in y.T], axis=1) for y in (i.gyro, i.accel)]
    return {"t": t, "gyro": at[0], "accel": at[1], "temperature": None}


def _held(i, rng):
    k = np.arange(len(i)) // 3 * 3
    return {"gyro": i.gyro[k], "accel": i.accel[k]}


def _jitter(i, rng):
    return {"t": np.sort(i.t + rng.uniform(-0.45, 0.45, len(i)) * i.interval)}


def _noise(i, rng):
    return {"gyro": i.gyro + rng.normal(0, 0.3, i.gyro.shape), "accel": i.accel + rng.normal(0, 3.0, i.accel.shape)}


def _rounded(i, rng):
    return {"accel": np.round(i.accel / 0.25) * 0.25, "gyro": np.round(i.gyro / 0.05) * 0.05}


def _clipped(name):
    """At the reading that a hundredth of the samples reach."""

    def change(i, rng):
        values = getattr(i, name)
        limit = np.quantile(np.abs(values - np.median(values, axis=0)).max(axis=1), 0.99)
        middle = np.median(values, axis=0)
        return {name: middle + np.clip(values - middle, -limit, limit)}

    return change


def _smoothed(g, rng):
    n = int(5.0 / np.median(np.diff(g.t)))
    return {"llh": _means(g.llh, n), "v_n": _means(g.v_n, n)}


def _jumps(g, rng):
    llh = g.llh.copy()
    for k in rng.integers(50, len(llh) - 60, 3):
        llh[k : k + 8, 0] += 40.0 / 6.4e6
    return {"llh": llh}


def _noisy(g, rng):
    return {"llh": g.llh + rng.normal(0, 1, g.llh.shape) * [2.0 / 6.4e6, 2.0 / 4.3e6, 2.0]}


def _outages(r, rng):
    t = r.gnss.t
    k = int(rng.uniform(0.3, 0.6) * len(t))
    return replace(r, gnss=r.gnss.where((t < t[k]) | (t > t[k] + 25.0)))


def _beside_reference(r, rng):
    """Sea-level heights beside a reference that is ellipsoidal."""
    g = r.gnss
    truth = Trajectory.from_geodetic(g.t, g.llh)
    return replace(r, gnss=replace(g, llh=g.llh - [0, 0, 47.0]), reference=truth)


def _duplicates(rows, rng):
    again = set(rng.integers(100, len(rows) - 100, 12).tolist())
    return [row for k, row in enumerate(rows) for row in ([row] * (2 if k in again else 1))]


def _backward(rows, rng):
    k = int(0.4 * len(rows))
    return rows[:k] + rows[k + 200 : k + 260] + rows[k : k + 200] + rows[k + 260 :]


def _missing(rows, rng):
    bad = set(rng.integers(100, len(rows) - 100, 9).tolist())
    return [[row[0], "nan", *row[2:]] if k in bad else row for k, row in enumerate(rows)]


def _exchanged(rows, rng):
    """Longitude before latitude."""
    return [[row[0], row[2], row[1], *row[3:]] for row in rows]


def _fault(name, codes, group, apply, hides=(), text=""):
    return Fault(name, frozenset(codes.split("|")), group, apply, frozenset(hides), text)


FAULTS = (
    # unit of specific force
    _fault("specific force in g", "accel_unit", "accel unit", _scaled(accel=1 / G0)),
    _fault("specific force in mg", "accel_unit", "accel unit", _scaled(accel=1e3 / G0)),
    _fault("specific force in counts", "accel_unit", "accel unit", _scaled(accel=_between(30.0, 3000.0))),
    _fault("specific force too large", "accel_scale", "accel unit", _scaled(accel=_between(1.05, 1.12))),
    _fault("gravity taken out", "no_gravity", "accel unit", _imu(_linear), ("axes", "sampling")),
    # angular unit
    _fault("rate in deg/s", "gyro_unit", "gyro unit", _scaled(gyro=1 / DEG)),
    _fault("rate converted twice", "gyro_unit", "gyro unit", _scaled(gyro=DEG)),
    _fault("rate in counts", "gyro_unit", "gyro unit", _scaled(gyro=_between(200.0, 20_000.0))),
    # rates and increments: acts on both units
    _fault("increments read as rates", "kind", "kind",
           _imu(lambda i, rng: {"accel": i.accel * i.interval, "gyro": i.gyro * i.interval}),
           ("accel unit", "gyro unit")),
    _fault("rates read as increments", "kind", "kind", _imu(lambda i, rng: {"kind": "increment"}),
           ("accel unit", "gyro unit")),
    # axes and signs
    _fault("axes FLU", "axes", "axes", _turned(FLU, FLU)),
    _fault("axes RFU", "axes", "axes", _turned(RFU, RFU)),
    _fault("sensor backward", "axes", "axes", _turned(np.diag([-1, -1, 1]), np.diag([-1, -1, 1]))),
    _fault("sensor on its side", "axes", "axes", _turned(SIDE, SIDE)),
    _fault("x and y exchanged", "handedness", "axes", _turned(SWAP_XY, SWAP_XY)),
    _fault("x reversed", "handedness", "axes", _turned(np.diag([-1, 1, 1]), np.diag([-1, 1, 1]))),
    # a mirror of z turns gravity over: an upright left-handed sensor with gravity of the wrong sign is the same
    _fault("z reversed", "handedness|gravity_sign", "axes", _turned(np.diag([1, 1, -1]), np.diag([1, 1, -1]))),
    _fault("gravity of the wrong sign", "gravity_sign", "axes", _turned(-I3, I3)),
    _fault("gravity of the wrong sign in FLU", "gravity_sign|handedness|axes", "axes", _turned(-FLU, FLU)),
    _fault("rates of the wrong sign", "gyro_sign", "axes", _turned(I3, -I3)),
    # one axis of a triad reversed makes it left-handed
    _fault("accelerometer's y reversed", "accel_axes|handedness", "axes", _turned(np.diag([1, -1, 1]), I3)),
    _fault("accelerometer's x and y exchanged", "accel_axes|handedness", "axes", _turned(SWAP_XY, I3)),
    _fault("gyro's x reversed", "gyro_axes|handedness", "axes", _turned(I3, np.diag([-1, 1, 1]))),
    _fault("gyro's z reversed", "gyro_axes|gyro_sign", "axes", _turned(I3, np.diag([1, 1, -1]))),
    _fault("gyro's y and z exchanged", "gyro_axes|handedness", "axes", _turned(I3, [[1, 0, 0], [0, 0, 1], [0, 1, 0]])),
    # positions and velocities
    _fault("velocity east, north, up", "velocity_axes", "velocity", _velocity([1, 1, -1], (1, 0, 2))),
    _fault("velocity up", "vertical_sign", "velocity", _velocity([1, 1, -1])),
    _fault("velocity in km/h", "velocity_unit", "velocity", _velocity(1 / KMH)),
    _fault("velocity in knots", "velocity_unit", "velocity", _velocity(1 / KNOT)),
    _fault("velocity west", "longitude_sign|velocity_axes", "velocity", _velocity([1, -1, 1])),
    _fault("longitude west", "longitude_sign|velocity_axes", "position", _place([1, -1, 1]), ("velocity",)),
    _fault("latitude south", "latitude_sign|velocity_axes", "position", _place([-1, 1, 1]), ("velocity",)),
    _fault("radians read as degrees", "position_unit", "position", _place([DEG, DEG, 1]), ("GNSS",)),
    _fault("latitude and longitude exchanged", "position_order", "position", _exchanged,
           ("velocity", "height", "GNSS"), text="gnss"),
    _fault("height in mm", "height_unit", "height", _place([1, 1, 1e3])),
    _fault("sea-level heights", "height_level", "height", _beside_reference, ("position", "GNSS")),
    # clocks
    _fault("UTC for GPS time", "leap_seconds", "clock", _shifted(-18.0)),
    _fault("leap seconds added twice", "leap_seconds", "clock", _shifted(18.0)),
    _fault("seconds late", "time_offset", "clock", _shifted(_between(0.9, 12.0))),
    _fault("tenths of a second", "time_offset", "clock", _shifted(_between(0.15, 0.35, sign=(-1, 1)))),
    _fault("half a second early", "time_offset", "clock", _shifted(_between(0.35, 0.8, sign=(-1,)))),
    _fault("stamps in ms", "time_unit", "clock", _imu(lambda i, rng: {"t": i.t * 1e3}), ("axes", "gyro unit", "kind")),
    _fault("another day", "no_overlap", "clock", _shifted(86400.0), ("axes", "gyro unit")),
    _fault("another rate", "clock_drift", "clock", _drift(_between(0.004, 0.02, sign=(-1, 1)))),
    # sampling and readings
    _fault("samples lost", "gaps", "sampling", _imu(_gaps)),
    _fault("jitter", "jitter", "sampling", _imu(_jitter)),
    _fault("interpolated", "resampled", "sampling", _imu(_resampled), ("text",)),
    _fault("held", "repeated", "sampling", _imu(_held)),
    _fault("gyro saturated", "saturated", "reading", _imu(_clipped("gyro"))),
    _fault("accelerometer saturated", "saturated", "reading", _imu(_clipped("accel"))),
    _fault("gyro stuck for 4 s", "stuck", "reading", _imu(_stuck)),
    _fault("accelerometer stuck for 4 s", "stuck", "reading", _imu(_stuck_accel)),
    _fault("rounded", "quantised", "reading", _imu(_rounded), ("kind",)),
    _fault("spikes", "spikes", "reading", _imu(_spikes)),
    _fault("spikes of the gyro", "spikes", "reading", _imu(_gyro_spikes)),
    _fault("noise", "imu_noise", "reading", _imu(_noise)),
    _fault("dead axis", "dead_axis", "reading", _imu(lambda i, rng: {"gyro": i.gyro * [1, 0, 1]}), ("axes",)),
    _fault("rows written twice", "duplicates", "text", _duplicates, text="imu"),
    _fault("rows out of order", "backward_times", "text", _backward, text="imu"),
    _fault("missing numbers", "missing", "text", _missing, text="imu"),
    # GNSS
    _fault("GNSS smoothed", "gnss_smoothed", "GNSS", _gnss(_smoothed)),
    _fault("GNSS jumps", "gnss_jumps", "GNSS", _gnss(_jumps)),
    _fault("GNSS noise added", "gnss_noise", "GNSS", _gnss(_noisy)),
    _fault("GNSS held", "gnss_repeated", "GNSS", _gnss(lambda g, rng: {"llh": g.llh[np.arange(len(g)) // 5 * 5]})),
    _fault("GNSS fused", "gnss_fused", "GNSS", _gnss(lambda g, rng: {"quality": np.full(len(g), 7)})),
    _fault("GNSS outage", "gnss_gaps", "GNSS", _outages),
)  # fmt: skip

BY_NAME = {fault.name: fault for fault in FAULTS}


def can_be_together(a: Fault, b: Fault) -> bool:
    """Whether both can be seen: they act on different things and neither hides the other."""
    return a.group != b.group and b.group not in a.hides and a.group not in b.hides


def pairs(number: int, seed: int) -> list[tuple[Fault, Fault]]:
    """Different random pairs of faults that can be seen together, each in the order in which they happen."""
    rng = np.random.default_rng(seed)
    made: list[tuple[Fault, Fault]] = []
    while len(made) < number:
        i, j = sorted(rng.choice(len(FAULTS), 2, replace=False).tolist())
        pair = tuple(sorted((FAULTS[i], FAULTS[j]), key=lambda f: (f.text != "", ORDER.index(f.group))))
        if can_be_together(*pair) and pair not in made:
            made.append(pair)
    return made


def apply(recording: Recording, faults, rng: np.random.Generator) -> Recording:
    """The recording with all faults that are not of its text."""
    for fault in faults:
        if not fault.text:
            recording = fault.apply(recording, rng)
    return recording


def write_logs(recording: Recording, faults, folder: Path, rng: np.random.Generator) -> dict:
    """IMU and GNSS as text, with the faults of the text; the options that read them."""
    imu, gnss = recording.imu, recording.gnss
    sigma = [np.sqrt(np.einsum("nii->ni", cov)) for cov in (gnss.cov_r_n, gnss.cov_v_n)]
    quality = np.ones(len(gnss)) if gnss.quality is None else gnss.quality
    tables = {
        "imu": np.column_stack((imu.t, imu.accel, imu.gyro)),
        "gnss": np.column_stack(
            (gnss.t, gnss.llh / [DEG, DEG, 1.0], gnss.v_n, sigma[0], sigma[1], quality.astype(np.float64))
        ),
    }
    week = round(recording.metadata.time.epoch_gps_s / 604800.0)
    read = {
        "imu": {
            "columns": "t,ax,ay,az,gx,gy,gz",
            "axes": "FRD",
            "kind": imu.kind,
            "units": "m/s^2,rad/s" if imu.kind == "rate" else "m/s,rad",
        },
        "gnss": {
            "columns": "t,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd,q",
            "units": "angle=deg",
            "height": "ellipsoidal",
        },
    }
    for name, table in tables.items():
        rows = [[repr(float(x)) for x in row] for row in table]
        for fault in faults:
            if fault.text == name:
                rows = fault.apply(rows, rng)
        (folder / f"{name}.csv").write_text("".join(",".join(row) + "\n" for row in rows), encoding="ascii")
        read[name] |= {"file": f"{name}.csv", "time": f"gps-tow:{week}"}
    return read
