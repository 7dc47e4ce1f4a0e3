"""Yaman's nine modes on two drives, emulated: GPS none, full or partial; IMU raw or calibrated; ZUPT and NHC or not.

The source's logs are not available. What can be recovered from its two tables of results (lengths, outages, the
constant sensor errors that explain them) goes in; what comes out stands beside the source's numbers. Nothing is tuned
to them.

Nine navigation states in every mode, as the source's uncalibrated mode must have had: with bias states the 100 mg of
its z accelerometer would not survive into an outage. A filter without bias states has to carry an error b that it
cannot estimate as noise; the rule here is ``N = b sqrt(T)``, with T between two fixes: white noise that adds up to b T
in T.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.navigation.evaluation.modes import parse_mode
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.plotting.table import Cell, ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.yaman.study.drive import ACCEL_NOISE, DRIVES, GNSS_RATE_HZ, GYRO_NOISE, Drive
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, Gps, mode_name
from schuler.units import DEG, DEG_PER_HR, MG, UG

Progress = Callable[[float], None]

#: What the filter is told of errors it cannot estimate: data sheet, and what calibration leaves. [m/s^2], [rad/s]
TOLD = {"raw": (80.0 * MG, 0.1 * DEG), "calibrated": (4.5 * MG, 11.0 * DEG_PER_HR)}
_START_S = 30.0  # levelled over this time at rest, then the filter begins [s]
_HEADING_ERROR = 1.0 * DEG


def mode_config(gps: Gps, calibrated: bool, aided: bool, outage: tuple[float, float]) -> NavigationConfig:
    """Configuration of a mode. Gates, rates and sigmas of ZUPT and NHC are
    ours: the thesis does not state them.
    """
    accel, gyro = TOLD["calibrated" if calibrated else "raw"]
    root = float(np.sqrt(1.0 / GNSS_RATE_HZ))
    base = NavigationConfig.parse(
        {
            "imu": {
                "gyro": {
                    "noise_deg_s_rthz": float(np.hypot(GYRO_NOISE, gyro * root)) / DEG, "density": "two-sided",
                    "bias_deg_s": gyro / DEG,
                },
                "accel": {
                    "noise_ug_rthz": float(np.hypot(ACCEL_NOISE, accel * root)) / UG, "density": "two-sided",
                    "bias_mg": accel / MG,
                },
            },
            # an error of 100 mg that no state can take makes every innovation improbable
            "gnss": {"position_sigma_floor_m": [1.9, 1.9, 5.1], "gate": "off"},
            "filter": {"states": 9, "smooth": False},
            "aiding": {
                "zero_velocity": {"sigma_m_s": 0.05, "rate_hz": 2.0, "gate": "off"},
                "non_holonomic": {
                    "lateral_sigma_m_s": 0.2, "vertical_sigma_m_s": 0.2, "rate_hz": 5.0, "mount_sigma_deg": 0.0,
                    "min_speed_m_s": 2.0, "max_turn_rate_deg_s": 10.0, "max_forward_m_s2": 1.0, "gate": "off",
                },
            },
            "outages": {"windows_s": [list(outage)] if gps == "Partial" else []},
        }
    )  # fmt: skip
    mode = parse_mode(("ins" if gps == "None" else "loose") + ("+zupt+nhc" if aided else ""))
    return mode.configure(base)


@dataclass(frozen=True)
class DriveModes(TabularResult):
    """The nine modes on one drive.

    Attributes
    ----------
    number : {1, 2}
    rms : ndarray, shape (9, 7)
        Rows as :data:`MODES`, columns as :data:`QUANTITIES`; NaN where a mode was not run.
    against : {"truth", "full"}
        What errors are measured against; ``full`` is the source's: the calibrated IMU with full GPS.
    complete : bool
    """

    number: int
    rms: FloatArray
    against: str
    complete: bool = True

    @property
    def published(self) -> FloatArray:
        """The source's table. Shape (9, 7)."""
        return np.array(PRINTED_MODES[self.number])

    def table(self) -> ResultTable:
        """Ours and the source's, row by row."""
        columns = ["mode"]
        for name in QUANTITIES:
            columns += [name, f"source_{name}"]
        rows: list[tuple[Cell, ...]] = []
        for k, mode in enumerate(MODES):
            if np.isfinite(self.rms[k, 0]):
                pairs = zip(self.rms[k], self.published[k], strict=True)
                rows.append((mode_name(*mode), *(float(x) for pair in pairs for x in pair)))
        length, lost = DRIVES[self.number]
        what = "the calibrated full solution" if self.against == "full" else "truth"
        return ResultTable(
            f"Yaman, drive {self.number}: RMS against {what}",
            tuple(columns),
            tuple(rows),
            (
                f"{length:g} s, outage {lost:g} s; RMS over the run, of partial GPS over the outage",
                "constant sensor errors, lengths and outage are recovered from the source's table; route, noise and "
                "settings are not known",
            ),
            self.complete,
        )


def levelled_start(recording: Recording, calibrated: bool) -> InitialState:
    """Position of a fix, roll and pitch of the mean specific force at rest, heading one degree off.

    The package's own levelling refuses 100 mg: it takes a specific force that is not gravity for a log in other units.

    References
    ----------
    Yaman (2017), section 6.2.1.1.
    """
    gnss, truth = recording.need_gnss(), recording.need_reference()
    rates = recording.need_imu().rates().between(0.0, _START_S)
    f = rates.accel.mean(axis=0)
    roll, pitch = np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2]))
    heading = float(truth.at([_START_S]).rpy_nb[0, 2]) + _HEADING_ERROR
    k = int(np.searchsorted(gnss.t, _START_S - 1e-6))
    accel, _ = TOLD["calibrated" if calibrated else "raw"]
    nav = NavState.from_geodetic(float(gnss.t[k]), gnss.llh[k], np.zeros(3), np.array([roll, pitch, heading]))
    tilt = np.arctan(accel / 9.8)
    return InitialState.from_sigmas(
        nav, StateLayout({}), attitude=np.array([tilt, tilt, 2.0 * _HEADING_ERROR]), velocity=np.full(3, 0.02),
        position=np.array([1.9, 1.9, 5.1]),
    )  # fmt: skip


def drive_modes(
    drive: Drive, *, against: Literal["full", "truth"] = "full", progress: Progress | None = None
) -> DriveModes:
    """Run the nine modes.

    Parameters
    ----------
    drive : Drive
    against : {"full", "truth"}
        See :class:`DriveModes`.
    progress : callable, optional

    Returns
    -------
    DriveModes
        On Ctrl-C the modes that were finished.

    References
    ----------
    Yaman (2017), section 6.2.2, tables 6.2 and 6.3.
    """
    if against not in ("full", "truth"):
        raise InputError(f"against: expected 'full' or 'truth', got {against!r}")
    rms = np.full((len(MODES), len(QUANTITIES)), np.nan)
    complete = True
    try:
        if against == "full":
            best = mode_solution(drive, "Full", True, False)
            reference = best.trajectory
        else:
            reference = drive.raw.need_reference().full()
        for k, (gps, calibrated, aided) in enumerate(MODES):
            result = mode_solution(drive, gps, calibrated, aided)
            window = drive.outage if gps == "Partial" else None
            rms[k] = rms_errors(result.trajectory, reference, window)
            if progress is not None:
                progress((k + 1) / len(MODES))
    except KeyboardInterrupt:
        complete = False
    return DriveModes(drive.number, rms, against, complete)


def rms_errors(estimate: Trajectory, reference: Trajectory, window: tuple[float, float] | None = None) -> FloatArray:
    """The seven numbers of the source's tables over a run or a window of it. Shape (7,), see :data:`QUANTITIES`."""
    e = trajectory_errors(estimate, reference)
    keep = np.ones(len(e.t), dtype=bool) if window is None else (e.t >= window[0]) & (e.t <= window[1])
    if not keep.any():
        raise InputError(f"no reference epoch lies within {window}")
    t = e.t[keep]
    angles = frames.wrap_angle(estimate.at(t).rpy_nb - reference.at(t).rpy_nb) / DEG
    assert e.velocity_n is not None
    r, v = e.position_n[keep], e.velocity_n[keep]
    columns = (np.hypot(r[:, 0], r[:, 1]), r[:, 2], np.hypot(v[:, 0], v[:, 1]), v[:, 2], *angles.T)
    return np.array([np.sqrt(np.mean(c**2)) for c in columns])


def mode_solution(drive: Drive, gps: Gps, calibrated: bool, aided: bool) -> NavigationResult:
    """Navigate a drive in one mode.

    Parameters
    ----------
    drive : Drive
    gps : {"None", "Full", "Partial"}
    calibrated, aided : bool
        Calibrated IMU; zero-velocity updates and the constraint of wheels.

    Returns
    -------
    NavigationResult

    Raises
    ------
    KeyboardInterrupt
        If it was interrupted.
    """
    recording = drive.calibrated if calibrated else drive.raw
    start = levelled_start(recording, calibrated)
    if gps == "None":
        recording = replace(recording, gnss=None)  # it must not help to find rest either
    result = navigate(recording, mode_config(gps, calibrated, aided, drive.outage).untuned(), initial=start)
    if not result.complete:
        raise KeyboardInterrupt
    return result
