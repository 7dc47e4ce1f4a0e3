"""``schuler simulate``."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from schuler.cli.output import File, Flag, print_json, say, writable


def simulate(scenario: Path, /, *, out: File = None, seed: int | None = None, json: Flag = False) -> None:
    """Simulate a scenario: true motion, IMU, GNSS solutions, satellite ranges and other aids, with all their errors.

    Parameters
    ----------
    scenario
        TOML file, see docs/simulation.md.
    out
        File to write; the suffix names the format. Default: the scenario's name with .parquet.
    seed
        Instead of the scenario's own.
    json
        Print one JSON object instead of text.
    """
    from schuler.cli.convert import described
    from schuler.recording.io import write
    from schuler.recording.io.dispatch import left_out
    from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

    began = time.perf_counter()
    loaded = Scenario.load(scenario)
    path = Path(f"{loaded.name}.parquet") if out is None else out
    writable(path.parent)
    used = loaded.seed if seed is None else seed
    simulation = simulate_mission(prepare_mission(loaded), np.random.default_rng(used))
    written = write(simulation.recording, path)
    missing = left_out(simulation.recording, path)
    if json:
        errors = simulation.errors
        print_json(
            {
                **described(simulation.recording),
                "seed": used,
                "elapsed_s": time.perf_counter() - began,
                "true_errors": {name: getattr(errors, name) for name in ("b_g", "b_a", "M_g", "M_a", "G_g")},
                "truth": simulation.recording.metadata.options["truth"],
                "left_out": missing.split(", ") if missing else [],
                "files": {"written": written},
            }
        )
    else:
        say(simulation.recording.summary())
        if missing:
            say(f"not in {path.name}, whose format does not hold them: {missing}")
        print("\n".join(str(p) for p in written))
