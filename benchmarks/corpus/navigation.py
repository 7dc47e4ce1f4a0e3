"""Recordings with fixes or ranges, navigated with defaults: an IMU by name, mount and lever as their README says."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import schuler
from schuler import frames, rotation, units
from schuler.exceptions import InputError
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.recording.io import read
from schuler.recording.recording import Recording
from schuler.recording.satellite_positions import gnss_series
from schuler.recording.series import GnssSeries

from .case import ROOT, Case
from .judgement import Judge, Windows, consistency, horizontal_errors, largest, rms, within

MEMS = {"catalogue": "MPU-6000"}  # the only cheap one of the catalogue with a data sheet
GRADE = {"catalogue": "consumer"}  # what one says who does not know the part
Asked = dict[str, Any]
Reader = Callable[[Path], tuple[Recording, Asked, Judge | None]]

WHEELS: Asked = {"non_holonomic": {}, "zero_velocity": {}, "zero_rate": {}}


# --- how each is read: recording, configuration that its README states, truth if there is one ----------------------


def rtkexp_drive(data: Path) -> tuple[Recording, Asked, Judge | None]:
    parts = tomllib.loads((ROOT / "examples" / "rtkexp_drive.toml").read_text(encoding="utf-8"))["recording"]
    imu = {**MEMS, "mount_rpy_deg": [-0.636, -6.760, 5.388], "clock_shift_s": -0.125}  # its README's, beyond "BRU"
    return read(data / "rtkexp_drive", **parts), {"imu": imu, "gnss": {"lever_arm_m": [0.0, -0.05, 0.0]}}, None


def _walk(data: Path) -> dict[str, Any]:
    return dict(tomllib.loads((ROOT / "examples" / "rtkexp_walk.toml").read_text(encoding="utf-8"))["recording"])


def rtkexp_walk(data: Path) -> tuple[Recording, Asked, Judge | None]:
    parts = _walk(data)
    recording = read(data / "rtkexp_walk", imu=parts["imu"], gnss=parts["reference"])
    return recording, {"imu": MEMS, "gnss": {"lever_arm_m": [0.0, 0.05, 0.0]}}, None


def rtkexp_walk_tight(data: Path) -> tuple[Recording, Asked, Judge | None]:
    parts = _walk(data)
    fixes = read(data / "rtkexp_walk", gnss=parts.pop("reference")).need_gnss()
    recording = read(data / "rtkexp_walk", **parts)
    points = gnss_series(solve_points(_ranges(recording)))
    # the base station's own position is metres off, so RTK is moved onto the mean of the single points
    r = frames.ecef_from_llh(fixes.llh)
    at = np.stack([np.interp(points.t, fixes.t, r[:, k]) for k in range(3)], axis=1)
    shift = np.einsum("nji,nj->ni", frames.C_en(points.llh), frames.ecef_from_llh(points.llh) - at).mean(axis=0)
    config = {"imu": MEMS, "gnss": {"coupling": "tight", "lever_arm_m": [0.0, 0.05, 0.0]}}
    return recording, config, Judge.of_fixes(fixes)._replace(offset_n=shift)


def psins_tc(data: Path) -> tuple[Recording, Asked, Judge | None]:
    """Judged by single points of every other epoch, whose ranges are withheld."""
    recording = read(data / "psins_tc" / "insgpseo_tc.mat")
    config = {
        "imu": {"catalogue": "flenniken-tactical", "mount_rpy_deg": [0.0, 0.0, 90.0]},
        "gnss": {"coupling": "tight", "tight": {"systems": "G"}},
    }
    return recording, config, None


def oan_phone_drive(data: Path) -> tuple[Recording, Asked, Judge | None]:
    # upright in its holder, the screen to the driver: what `schuler check` says of it
    return read(data / "oan_phone_drive", axes="RUB"), {"imu": MEMS}, None


def morpinet_car(data: Path, number: int) -> tuple[Recording, Asked, Judge | None]:
    folder = data / "morpinet_car"
    imu = read(
        folder / f"IMU_h_{number}.npy", columns="ax,ay,az,gx,gy,gz", units="m/s^2,deg/s", rate=120.0,
        name=f"morpinet_car/IMU_{number}",
    )  # fmt: skip
    ned = np.load(folder / "ned_h.npy")
    place = np.array([32.76 * units.DEG, 35.02 * units.DEG, 200.0])
    llh = frames.llh_from_ecef(frames.ecef_from_ned(ned, place))
    cov = np.broadcast_to(np.diag([0.02, 0.02, 0.04]) ** 2, (len(ned), 3, 3))  # RTK; nothing is stated
    gnss = GnssSeries(np.arange(len(ned)) / 10.0, llh, np.ascontiguousarray(cov))
    return replace(imu, gnss=gnss), {"imu": MEMS}, None


def euroc_imu(data: Path, name: str, given: bool = False) -> tuple[Recording, Asked, Judge | None]:
    """With fixes of 5 cm every second, drawn about the truth; the attitude at the start given, off by 1, 1, 3 deg."""
    recording = read(data / "euroc_imu" / name, origin="47.377,8.548,500")
    truth = recording.need_reference()
    t = np.arange(np.ceil(truth.t[0]), truth.t[-1])
    at = truth.at(t)
    rng = np.random.default_rng([*name.encode()])
    noise = 0.05 * rng.standard_normal((len(t), 3))
    r = at.r_eb_e + np.einsum("nij,nj->ni", frames.C_en(at.llh), noise)
    cov = np.broadcast_to(0.05**2 * np.eye(3), (len(t), 3, 3))
    gnss = GnssSeries(t, frames.llh_from_ecef(r), np.ascontiguousarray(cov))
    imu = recording.need_imu().between(truth.t[0], truth.t[-1])
    recording = replace(recording, gnss=gnss, imu=imu, reference=None)
    config: Asked = {"imu": MEMS}  # its ADIS16448 is biased by 4 deg/s, beyond any data sheet of its class
    if given:
        off = units.DEG * np.array([1.0, 1.0, 3.0]) * rng.standard_normal(3)
        C = rotation.dcm_from_rotvec(off) @ at.C_nb[0]
        config["alignment"] = {"method": "given", "rpy_deg": (rotation.rpy_from_dcm(C) / units.DEG).tolist()}
    return recording, config, Judge.of_truth(truth)


def of_grade(data: Path, reader: Reader) -> tuple[Recording, Asked, Judge | None]:
    """The same, with the IMU's grade instead of a part's name."""
    recording, stated, judge = reader(data)
    kept = {name: value for name, value in stated["imu"].items() if name != "catalogue"}
    return recording, {**stated, "imu": {**kept, **GRADE}}, judge


# --- what is asked ----------------------------------------------------------------------------------------------------


def held_back(recording: Recording, judge: Judge | None, tight: bool) -> tuple[Recording, Judge]:
    """Every other fix, or epoch of ranges, out of the recording; they judge where there is no truth."""
    if tight:
        ranges = _ranges(recording)
        epochs = np.unique(ranges.t)
        if judge is None:
            points = solve_points(ranges.where(np.isin(ranges.t, epochs[1::2])))
            judge = Judge.of_fixes(gnss_series(points))._replace(apart=False)  # orbits, clocks, atmosphere are shared
            recording = replace(recording, ranges=ranges.where(np.isin(ranges.t, epochs[::2])), observations=None)
        return recording, judge
    gnss = recording.need_gnss()
    if judge is not None:
        return recording, judge
    k = np.arange(len(gnss))
    return replace(recording, gnss=gnss.where(k % 2 == 0)), Judge.of_fixes(gnss.where(k % 2 == 1))


def _ranges(recording: Recording) -> Any:
    if recording.ranges is not None:
        return recording.ranges
    if recording.observations is None or recording.ephemerides is None:
        raise InputError("neither ranges nor observations with ephemerides")
    return prepare_ranges(recording.observations, recording.ephemerides, systems="GEC")


def prepared(data: Path, reader: Reader, outages: Asked | None, aiding: Asked) -> tuple[Recording, Asked, Judge]:
    """Recording without what is held back, configuration, and judge; see :func:`run`."""
    recording, stated, judge = reader(data)
    tight = stated.get("gnss", {}).get("coupling") == "tight"
    if outages is None:
        recording, judge = held_back(recording, judge, tight)
    elif judge is None:
        judge = Judge.of_fixes(gnss_series(solve_points(_ranges(recording))) if tight else recording.need_gnss())
        judge = judge._replace(apart=not tight)
    filtering = {**stated.get("filter", {}), "record_s": 0.2}
    return recording, {**stated, "filter": filtering, "aiding": aiding, "outages": outages or {}}, judge


def run(data: Path, reader: Reader, outages: Asked | None, aiding: Asked) -> dict[str, Any]:
    """Navigate a recording and judge it.

    Parameters
    ----------
    data : Path
    reader : callable
    outages : dict or None
        Section of that name; then judged inside the windows, by the fixes that they withhold. Without it every other
        fix is held back.
    aiding : dict
        Section of that name.
    """
    recording, asked, judge = prepared(data, reader, outages, aiding)
    row: dict[str, Any] = {"warnings": doubts(recording)}
    result = navigate(recording, asked)
    smoothed = result.smooth() if result.can_smooth else None
    row |= judged(result, smoothed, judge)
    if not judge.apart:
        row |= dict.fromkeys(("nees", "nees_band", "inside"))
    verdict = getattr(result, "verdict", None)
    level = getattr(verdict, "level", getattr(verdict, "status", verdict))
    return row | {"verdict": None if verdict is None else str(level), "exit": int(level == "failed")}


def doubts(recording: Recording) -> list[str]:
    """Codes of what ``schuler check`` finds before a log is navigated; errors, which would stop it, in capitals."""
    diagnosis = schuler.check(recording, quick=True)
    return [f.code.upper() if f.severity == "error" else f.code for f in diagnosis.findings if f.severity != "info"]


def judged(result: NavigationResult, smoothed: NavigationResult | None, judge: Judge) -> dict[str, Any]:
    """Numbers of one run."""
    windows: Windows = [w for w in result.outages if w[0] > result.trajectory.t[0]]
    errors = horizontal_errors(result, judge)
    after = None if smoothed is None else horizontal_errors(smoothed, judge)
    counts = result.innovations.counts().values()
    offered = sum(sum(c.values()) for c in counts)
    tested = result.innovations
    row: dict[str, Any] = {
        "nis": tested.mean_nis(), "starts_s": float(result.trajectory.t[0] - judge.t[0]),
        "rejected": sum(result.innovations.rejected().values()) / max(offered, 1), "notes": len(result.notes),
    }  # fmt: skip
    if not windows:
        row |= {"error": rms(errors), "smoothed": None if after is None else rms(after), **consistency(errors)}
        if after is not None:
            row["nees_smoothed"] = consistency(after)["nees"]
        return row
    inside = within(errors.t, windows, 1.0)
    sizes = largest(errors, windows)
    aided = errors.where(~within(errors.t, [(a, b + 1.0) for a, b in windows]))
    row |= {
        "error": rms(errors.where(inside)), "outage": float(np.mean(sizes)), "aided": rms(aided),
        "outages": len(sizes), **consistency(errors.where(inside), len(sizes)),
    }  # fmt: skip
    if after is not None:
        inside = within(after.t, windows, 1.0)
        row |= {
            "smoothed": rms(after.where(inside)), "outage_smoothed": float(np.mean(largest(after, windows))),
            "nees_smoothed": consistency(after.where(inside), len(sizes))["nees"],
        }  # fmt: skip
    return row


def vn310_roof(data: Path) -> tuple[Recording, Asked, Judge | None]:
    """Parked on a roof for half a minute: there is no course."""
    recording = read(data / "instinct_tckf", imu={"file": "vn310-imu.csv"}, gnss={"file": "vn310-gnss.csv"})
    return recording, {"imu": {"catalogue": "VN-200"}}, None


#: Folders of recordings that are not called like them.
_FOLDERS = {"vn310_roof": "instinct_tckf"}


def _cases() -> list[Case]:
    cars = {"every_s": 45.0, "length_s": 15.0, "first_s": 40.0}
    flights = {"every_s": 20.0, "length_s": 5.0, "first_s": 30.0}
    walks = {"every_s": 25.0, "length_s": 10.0, "first_s": 30.0}
    parked = {"windows_s": [[1759.5, 1769.5], [1779.5, 1789.5]]}  # the IMU's 95th to 105th and 115th to 125th second
    lever = {**WHEELS, "non_holonomic": {"lever_m": [0.0, 0.0, 0.65]}}
    asked: list[tuple[str, str, Any, Asked | None, Asked]] = [
        ("rtkexp_drive", "fixes", rtkexp_drive, None, {}),
        ("rtkexp_drive", "outages", rtkexp_drive, cars, {}),
        ("rtkexp_drive", "wheels", rtkexp_drive, cars, lever),
        ("rtkexp_walk", "fixes", rtkexp_walk, None, {}),
        ("rtkexp_walk", "outages", rtkexp_walk, walks, {}),
        ("rtkexp_walk", "tight", rtkexp_walk_tight, None, {}),
        ("rtkexp_walk", "tight-outages", rtkexp_walk_tight, walks, {}),
        ("vn310_roof", "fixes", vn310_roof, None, {}),
        ("psins_tc", "tight", psins_tc, None, {}),
        ("psins_tc", "tight-outages", psins_tc, parked, {}),
        ("oan_phone_drive", "fixes", oan_phone_drive, None, {}),
        ("oan_phone_drive", "outages", oan_phone_drive, {**cars, "first_s": 250.0}, {}),
        ("oan_phone_drive", "wheels", oan_phone_drive, {**cars, "first_s": 250.0}, WHEELS),
    ]
    drive, phone = partial(of_grade, reader=rtkexp_drive), partial(of_grade, reader=oan_phone_drive)
    asked += [
        ("rtkexp_drive", "grade-fixes", drive, None, {}),
        ("rtkexp_drive", "grade-outages", drive, cars, {}),
        ("rtkexp_drive", "grade-wheels", drive, cars, lever),
        ("oan_phone_drive", "grade-fixes", phone, None, {}),
        ("oan_phone_drive", "grade-outages", phone, {**cars, "first_s": 250.0}, {}),
    ]
    for k in range(1, 6):
        name, reader = f"morpinet_car/IMU_{k}", partial(morpinet_car, number=k)
        asked += [
            (name, "fixes", reader, None, {}), (name, "outages", reader, cars, {}),
            (name, "wheels", reader, cars, WHEELS),
        ]  # fmt: skip
    for sequence in ("MH_04_difficult", "V1_02_medium", "V2_01_easy"):
        name, given = f"euroc_imu/{sequence}", partial(euroc_imu, name=sequence, given=True)
        asked += [
            (name, "fixes", partial(euroc_imu, name=sequence), None, {}), (name, "given", given, None, {}),
            (name, "outages", given, flights, {}),
        ]  # fmt: skip
    return [
        Case(
            recording, "navigation", (_FOLDERS.get(recording, recording.partition("/IMU")[0]),), "m",
            partial(run, reader=reader, outages=outages, aiding=aiding), question,
        )
        for recording, question, reader, outages, aiding in asked
    ]  # fmt: skip


CASES = _cases()
