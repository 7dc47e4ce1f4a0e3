"""``schuler doctor``: whether this installation works, and what it can do."""

from __future__ import annotations

import platform
import re
import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from inspect import signature
from itertools import product
from pathlib import Path
from typing import Any

import schuler
from schuler.cli.output import Flag, print_json, say
from schuler.exceptions import SchulerError, printable
from schuler.files import check_writable, read_toml

#: What each extra of ``pyproject.toml`` buys.
EXTRAS = {
    "plot": "figures as PNG and SVG",
    "report": "the same: kept for installations that ask for it",
    "data": "Parquet files",
    "fetch": "public recordings (schuler fetch)",
    "symbolic": "formulas of schuler observability --symbolic",
    "ros": "ROS 1 and ROS 2 bags, MCAP with their messages, MCAP of live runs",
    "px4": "PX4 logs (.ulg)",
    "hdf5": "MATLAB 7.3, HDF5 and netCDF files",
    "frames": "tables as pandas, polars and xarray",
    "live": "serial lines, WebSockets and MQTT as sources of schuler live",
    "foxglove": "Foxglove as a display of schuler live",
    "studio": "the workbench in the browser (schuler studio)",
    "cluster": "Monte Carlo on a Dask cluster",
}
_LARGEST_NIS = 2.0  # the seed is fixed: an honest run of 280 measurements is within 0.8 and 1.2 of 1
_LARGEST_DRIFT_M = 0.1  # two minutes of a perfect IMU at 100 Hz; discretisation is below 1 mm


def doctor(*, warm: Flag = False, json: Flag = False) -> int:
    """Say whether this installation works: versions, extras, kernels on disk, a short simulated run.

    Parameters
    ----------
    warm
        Compile the kernels of navigation, smoothing, noise identification and Monte Carlo runs now, a minute or two on
        a fresh machine; those of calibration and budgets are compiled when first used.
    json
        Print one JSON object instead of text.
    """
    required, extras = libraries()
    cache = kernel_cache()
    compiled = warm_up() if warm else None
    test = self_test()
    faults = [
        f"{name}: expected {row['required']}, got {row['version'] or 'nothing'}: pip install -U schuler"
        for name, row in required.items()
        if not row["ok"]
    ]
    if cache["fault"]:
        faults.append(
            f"the compiled kernels cannot be kept ({cache['fault']}), every start compiles them anew: set "
            "NUMBA_CACHE_DIR to a folder that can be written"
        )
    if test["fault"]:
        faults.append(f"self-test: {test['fault']}")
    if json:
        print_json({
            "command": "doctor", "ok": not faults, "faults": faults, "schuler": version("schuler"),
            "python": platform.python_version(), "platform": platform.platform(), "required": required,
            "extras": extras, "cache": cache, "warm_s": compiled, "self_test": test,
        })  # fmt: skip
        return 1 if faults else 0
    print(f"schuler {version('schuler')}, Python {platform.python_version()}, {platform.platform()}")
    print("required: " + ", ".join(f"{name} {row['version'] or 'missing'}" for name, row in required.items()))
    for name, row in extras.items():
        state = "present" if row["present"] else f"missing ({', '.join(row['missing'])})"
        print(
            f"extra {name:<10}{state}: {row['buys']}" + ("" if row["present"] else f": pip install 'schuler[{name}]'")
        )
    print(f"kernels: {cache['folder'] or 'nowhere'}, {'cannot' if cache['fault'] else 'can'} be written")
    if compiled is not None:
        print(f"kernels compiled or loaded in {compiled:.1f} s")
    if not test["fault"]:
        print(
            f"self-test: perfect IMU {1e3 * test['drift_m']:.2g} mm off after {test['duration_s']:.0f} s; with errors "
            f"and GNSS {test['rms_horizontal_m']:.2f} m RMS horizontal, mean NIS {test['nis_mean']:.2f}; "
            f"{test['elapsed_s']:.1f} s"
        )
    print("\n".join(f"BROKEN: {fault}" for fault in faults) or "all is well")
    return 1 if faults else 0


def libraries() -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Libraries that the installed package requires, and its extras with what of each is missing."""
    required: dict[str, dict[str, Any]] = {}
    wanted: dict[str, list[str]] = {name: [] for name in EXTRAS}
    for line in requires("schuler") or ():
        text, _, marker = (part.strip() for part in line.partition(";"))
        name = re.match(r"[\w.-]+", text)
        assert name is not None
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", marker)
        if extra is None:
            given = _version(name[0])
            required[name[0]] = {"version": given, "required": text, "ok": given is not None and _enough(given, text)}
        elif extra[1] in wanted:
            wanted[extra[1]].append(text)
    extras = {}
    for extra_name, texts in wanted.items():
        missing = [t for t in texts if (v := _version(re.split(r"[^\w.-]", t)[0])) is None or not _enough(v, t)]
        missing = missing if texts else ["not known to this installation: install it anew"]
        extras[extra_name] = {"present": not missing, "missing": missing, "buys": EXTRAS[extra_name]}
    return required, extras


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _enough(given: str, text: str) -> bool:
    """Whether a version is not below the one after ``>=``."""
    least = re.search(r">=\s*([\d.]+)", text)
    return least is None or _numbers(given) >= _numbers(least[1])


def _numbers(text: str) -> list[int]:
    numbers = [int(n) for n in re.match(r"[\d.]*", text)[0].split(".") if n]  # type: ignore[index]
    while numbers and numbers[-1] == 0:  # 3.0 is 3
        numbers.pop()
    return numbers


def kernel_cache() -> dict[str, Any]:
    """Folder of the compiled mechanization, and why it cannot be written, or None."""
    from schuler.mechanization import kernels

    folder = getattr(getattr(kernels.strapdown, "_cache", None), "cache_path", None)
    if folder is None:
        return {"folder": None, "fault": "there is no folder to write to"}
    try:
        check_writable(Path(folder))
    except OSError as error:
        return {"folder": folder, "fault": f"{folder}: {error.strerror}"}
    return {"folder": folder, "fault": None}


def preparations() -> list[Callable[..., None]]:
    """Functions ``prepare_...`` of all kernel modules, which compile or load what is there."""
    root = Path(schuler.__file__).parent
    functions = []
    for path in sorted([*root.rglob("*kernels.py"), *root.glob("*/kernels/*.py")]):
        name = ".".join(path.relative_to(root.parent).with_suffix("").parts)
        members = vars(import_module(name))
        functions += [f for key, f in members.items() if key.startswith("prepare_") and f.__module__ == name]
    return functions


def warm_up() -> float:
    """Compile or load the kernels that commands wait for. [s]"""
    began = time.perf_counter()
    say("compiling the kernels for this machine, up to two minutes the first time")
    for prepare in preparations():
        # an argument chooses one of two branches
        for branches in product((False, True), repeat=len(signature(prepare).parameters)):
            prepare(*branches)
    return time.perf_counter() - began


def self_test() -> dict[str, Any]:
    """Simulate two minutes of the demo's drive and navigate it, without errors and GNSS, and with both."""
    began = time.perf_counter()
    numbers: dict[str, Any] = {"fault": None}
    try:
        numbers |= _drive()
    except SchulerError as error:
        numbers["fault"] = printable(str(error))
    except Exception as error:  # whatever a broken library ends in is the answer
        numbers["fault"] = printable(f"{type(error).__name__}: {error}")
    else:
        if not numbers["drift_m"] < _LARGEST_DRIFT_M:
            numbers["fault"] = f"a perfect IMU is {numbers['drift_m']:.3g} m off, expected below {_LARGEST_DRIFT_M} m"
        elif not numbers["rms_horizontal_m"] < numbers["sigma_gnss_m"]:
            numbers["fault"] = (
                f"{numbers['rms_horizontal_m']:.3g} m RMS with GNSS, expected below the {numbers['sigma_gnss_m']:.3g} "
                "m of the fixes themselves"
            )
        elif not 1.0 / _LARGEST_NIS < numbers["nis_mean"] < _LARGEST_NIS:
            numbers["fault"] = f"mean NIS {numbers['nis_mean']:.3g}, expected 1"
    numbers["elapsed_s"] = time.perf_counter() - began
    return numbers


def _drive() -> dict[str, float]:
    import numpy as np

    from schuler.mechanization.strapdown import NavState, mechanize
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.run import navigate
    from schuler.recording.series import Increments
    from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

    data = read_toml(Path(__file__).with_name("demo.toml"))
    data["motion"]["waypoints"] = data["motion"]["waypoints"][:5]
    mission = prepare_mission(Scenario.parse(data))
    ideal, truth = mission.ideal, mission.ideal.truth
    start = NavState(float(truth.t[0]), truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    free = mechanize(Increments(ideal.t[1:], np.diff(ideal.t), ideal.gyro, ideal.accel), start)
    simulation = simulate_mission(mission, np.random.default_rng(1))
    config = NavigationConfig.parse(
        {
            "imu": {"gyro": data["imu"]["gyro"], "accel": data["imu"]["accel"]},
            "gnss": {"lever_arm_m": data["gnss"]["lever_arm_m"]},
            "alignment": {"sideslip_deg": 0.5},
            "filter": {"smooth": False},
        }
    )
    result = navigate(simulation.recording, config)
    return {
        "duration_s": float(truth.t[-1] - truth.t[0]),
        "drift_m": float(np.linalg.norm(free.r_eb_e[-1] - truth.r_eb_e[-1])),
        "rms_horizontal_m": float(result.errors(truth).rms_horizontal),
        "sigma_gnss_m": float(np.hypot(*data["gnss"]["sigma_position_m"][:2])),
        "nis_mean": float(result.innovations.mean_nis()),
    }
