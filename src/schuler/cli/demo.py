"""``schuler demo``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.cli.navigate import sentences, write_outputs
from schuler.cli.output import Flag, Folder, drawable, print_json, print_verdict, progress, say, tabled, writable
from schuler.files import outputs, read_toml, replacing, write_text
from schuler.navigation.evaluation.evaluated import EvaluatedRun, evaluate_run

_OUTAGE_S = (300.0, 340.0)
_SCENARIO = Path(__file__).with_name("demo.toml")
_RUNS = 25  # repetitions with other errors, for the consistency of the filter


def demo(
    *, out: Folder = None, seed: int | None = None, report: bool = True, figures: Flag = False, json: Flag = False
) -> None:
    """Simulate a drive with a MEMS IMU and GNSS, lose GNSS for 40 s, navigate, smooth, and write a report.

    Parameters
    ----------
    out
        Folder for the files. Default: demo.
    seed
        Draw other sensor errors and noise.
    report
        Write report.html.
    figures
        Write each figure as PNG and SVG, for print; they take longer than all the rest.
    json
        Print one JSON object instead of text.
    """
    began = time.perf_counter()
    folder = writable(Path("demo")) if out is None else out
    figures, tables = drawable(figures), tabled()
    say("simulating ten minutes of driving: MEMS IMU at 100 Hz, GNSS at 1 Hz, 40 s without GNSS")
    with progress("running the demo") as bar:
        outcome, recording, repeated = run_demo(seed, bar)
    numbers = outcome.numbers
    numbers["nees_this_run"] = numbers["nees_mean"]
    numbers["nees_mean"], numbers["nees_runs"] = repeated, _RUNS
    numbers["max_horizontal_outage_m"] = max(o["max_horizontal_m"] for o in numbers["outages"])
    numbers["smoothed_rms_horizontal_m"] = numbers["smoothed"]["rms_horizontal_m"]
    written = write_outputs(folder, recording, outcome, report=report, figures=figures, tables=tables)
    numbers["elapsed_s"] = time.perf_counter() - began
    if json:
        print_json({"command": "demo", **numbers, "files": written})
        return
    print_verdict(outcome.result.verdict)
    print(outcome.result.summary())
    print(sentences(numbers) + f", mean of {_RUNS} drives with other errors")
    print("\n".join(f"{name}: {path}" for name, path in written.items() if not name.startswith("figure")))
    if "report" in written:
        print(f"open {written['report']} in a browser")


def run_demo(seed: int | None, bar: Any = None) -> tuple[EvaluatedRun, Any, float]:
    """The drive, its solution, and the mean normalised estimation error over repetitions.

    Parameters
    ----------
    seed : int, optional
        Default: the scenario's.
    bar : callable, optional
        Called with the fraction done.
    """
    from schuler.filtering.kernels.run import compile_filter_beside

    compile_filter_beside()
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.run import navigate
    from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

    data = read_toml(_SCENARIO)
    scenario = Scenario.parse(data)
    config = NavigationConfig.parse(configuration_of(data) | {"outages": {"windows_s": [_OUTAGE_S]}})
    mission = prepare_mission(scenario)
    seeds = _seeds(scenario.seed if seed is None else seed)
    # the noise of the others is that of their simulation: nothing to tune
    quick = config.model_copy(update={"filter": config.filter.model_copy(update={"smooth": False, "tune": False})})
    nees = []
    for k in range(_RUNS, -1, -1):
        simulation = simulate_mission(mission, np.random.default_rng(seeds[k]))
        result = navigate(simulation.recording, config if k == 0 else quick)
        if not result.complete:
            raise KeyboardInterrupt
        truth = true_parameters(simulation, result)
        if k > 0:
            nees.append(float(np.mean(result.nees(mission.ideal.truth, truth))))
        if bar is not None:
            bar((_RUNS + 1 - k) / (_RUNS + 1))
    outcome = evaluate_run(simulation.recording, result, True, truth)
    outcome.numbers["seed"] = scenario.seed if seed is None else seed
    return outcome, simulation.recording, float(np.mean(nees))


def write_demo_drive(folder: Path) -> None:
    """Write the drive of the demo as a log, ``demo.parquet``, and its configuration without the outage, ``drive.toml``.

    Files that are there are kept, whatever is in them.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    """
    from schuler.proposal.toml import toml_of
    from schuler.recording.io import write
    from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

    data = read_toml(_SCENARIO)
    if not (log := folder / "demo.parquet").exists():
        scenario = Scenario.parse(data)
        generator = np.random.default_rng(_seeds(scenario.seed)[0])
        recording = simulate_mission(prepare_mission(scenario), generator).recording
        # there when this returns, and not in a list of the folder's: runs in it have lists of their own
        with replacing(log, at_once=True) as temporary, outputs(force=True):
            write(recording, temporary)
    if not (config := folder / "drive.toml").exists():
        remarks = {
            "imu.gyro": "of the simulated IMU, as on its data sheet",
            "gnss.lever_arm_m": "IMU to antenna: forward, right, down",
        }
        write_text(config, toml_of(configuration_of(data), remarks), at_once=True)


def configuration_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Configuration for the navigation of the demo's drive.

    Parameters
    ----------
    data : mapping
        The scenario that simulates it.
    """
    return {
        "imu": {"gyro": data["imu"]["gyro"], "accel": data["imu"]["accel"]},
        "gnss": {"lever_arm_m": data["gnss"]["lever_arm_m"], "gate": 0.99999},
        "alignment": {"sideslip_deg": 0.5},
        "filter": {"states": 33},
    }


def _seeds(seed: int) -> list[np.random.SeedSequence]:
    """A seed for each drive, so that the first does not depend on how many follow."""
    return np.random.SeedSequence(seed).spawn(_RUNS + 1)


def true_parameters(simulation: Any, result: Any) -> FloatArray:
    """What the filter's parameters should be at its records. Shape (k, m)."""
    errors, report, imu = simulation.errors, simulation.report, simulation.recording.imu
    k = np.clip(np.searchsorted(imu.t, result.t + 1e-9, side="right") - 1, 0, len(imu.t) - 1)
    off = ~np.eye(3, dtype=bool)
    constant = {
        "S_a": np.diag(errors.M_a), "S_g": np.diag(errors.M_g), "M_a6": errors.M_a[off], "M_g": errors.M_g[off],
        "G_g": errors.G_g.ravel(),
    }  # fmt: skip
    blocks = [
        {"b_a": report.b_a, "b_g": report.b_g}[name][k]
        if name in ("b_a", "b_g")
        else np.tile(constant[name], (len(k), 1))
        for name in result.layout.models
    ]
    return np.concatenate(blocks, axis=1)
