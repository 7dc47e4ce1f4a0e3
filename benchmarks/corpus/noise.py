"""Allan deviations of the first half of a rest against those of the second, beside their bounds; and the peer."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.nonstationarity import allow_for, level_scatter
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.recording.io import read

from .case import Case

_CONFIDENCE = 0.6827  # bounds of one sigma

Signals = tuple[np.ndarray, float]


def halves(data: Path, reader: Callable[[Path], Signals]) -> dict[str, Any]:
    """Logarithms of the deviations of two halves, all axes and averaging times; the error is in per cent."""
    x, rate_hz = reader(data)
    n = len(x) // 2
    d, sigma, own, theirs = [], [], [], []
    for axis in range(x.shape[1]):
        parts = (x[:n, axis], x[n : 2 * n, axis])
        curves = [allan_deviation(part, rate_hz, confidence=_CONFIDENCE) for part in parts]
        # as `schuler allan` bounds a curve: each half allows for what changes between its own parts
        curves = [allow_for(c, level_scatter(part, c)) for c, part in zip(curves, parts, strict=True)]
        d.append(np.log(curves[0].deviation / curves[1].deviation))
        sigma.append(np.hypot(*(0.5 * np.log(c.high / c.low) for c in curves)))
        if importlib.util.find_spec("allantools") is not None:
            own.append(curves[0].deviation)
            theirs.append(_allantools(x[:n, axis], rate_hz, curves[0].tau))
    e, s = np.concatenate(d), np.concatenate(sigma)
    z = e / s
    row: dict[str, Any] = {
        "error": 100.0 * float(np.sqrt(np.mean(e**2))), "claimed": 100.0 * float(np.sqrt(np.mean(s**2))),
        # neighbouring averaging times share half of their differences
        "nees": float(np.mean(z**2)), "nees_band": list(chi_square_band(1, max(len(z) // 2, 1))),
        "inside": [float(np.mean(np.abs(z) < k)) for k in (1.0, 2.0, 3.0)],
    }  # fmt: skip
    if not theirs:
        return row | {"peer": "allantools is not installed"}
    # how far the same estimate of the same series is from the peer's, in per cent: rounding
    largest = max(float(np.abs(a / b - 1.0).max()) for a, b in zip(own, theirs, strict=True))
    return row | {"peer": "allantools", "peer_error": 100.0 * largest}


def _allantools(x: np.ndarray, rate_hz: float, tau: np.ndarray) -> np.ndarray:
    import allantools

    _, deviation, _, _ = allantools.oadev(x, rate=rate_hz, data_type="freq", taus=tau)
    return np.asarray(deviation)


def adis(data: Path, number: int) -> Signals:
    held = np.load(data / "adis16405_static" / f"adis16405_imu{number}.npz")
    return held["counts"] * held["lsb"], 100.0


def lasergyro(data: Path) -> Signals:
    imu = read(data / "psins_lasergyro" / "lasergyro.imu").need_imu().rates()
    return np.concatenate((imu.gyro, imu.accel), axis=1), imu.rate_hz


def xsens(data: Path) -> Signals:
    """The rest at the start, 45 s of 50."""
    gyro, accel = (np.loadtxt(data / "imu_tk_xsens" / f"xsens_{k}.mat", max_rows=4500) for k in ("gyro", "acc"))
    return np.concatenate((gyro[:, 1:], accel[:, 1:]), axis=1), 100.0


def instinct(data: Path) -> Signals:
    imu = read(data / "instinct_tckf" / "vn310-imu.csv").need_imu()
    return np.concatenate((imu.gyro, imu.accel), axis=1), imu.rate_hz


def clock(data: Path, file: str, interval_s: float, phase: bool) -> Signals:
    """Frequency of a clock; its rate like that of any sensor."""
    x = np.loadtxt(data / "allantools_refs" / file, comments="#")
    x = np.diff(x) / interval_s if phase else x - x.mean()
    return x[:, None], 1.0 / interval_s


#: Clocks by folder: file, interval [s], and whether it holds phases.
_CLOCKS = {
    "ocxo": ("ocxo_frequency.txt", 1.0, False),
    "gps": ("gps_1pps_phase_data.txt.gz", 1.0, True),
    "Cs5071A": ("5071A_phase.txt.gz", 1.0, True),
    "pink_frequency": ("pink_frequency.txt", 42.0, False),
    "Keysight53230A_ti_noise_floor": ("tic_phase.txt", 1.0, True),
    "phasedat": ("PHASE.DAT", 1.0, True),
}

CASES = [
    Case(recording, "noise", (needs,), "%", partial(halves, reader=reader), "rest")
    for recording, needs, reader in (
        ("adis16405_static/imu1", "adis16405_static/adis16405_imu1.npz", partial(adis, number=1)),
        ("adis16405_static/imu2", "adis16405_static/adis16405_imu2.npz", partial(adis, number=2)),
        ("imu_tk_xsens", "imu_tk_xsens", xsens),
        ("instinct_tckf", "instinct_tckf", instinct),
        ("psins_lasergyro", "psins_lasergyro", lasergyro),
        *(
            (
                f"allantools_refs/{folder}",
                f"allantools_refs/{folder}/{file}",
                partial(clock, file=f"{folder}/{file}", interval_s=interval, phase=phase),
            )
            for folder, (file, interval, phase) in _CLOCKS.items()
        ),
    )
]
