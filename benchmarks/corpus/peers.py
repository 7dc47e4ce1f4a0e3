"""python-ins on the fixes and outages of the cases: run once, kept in ``peers.json`` with its version.

    python -m benchmarks.corpus --peers [--only PATTERN]

The peer has no alignment, no gate and no rests: it starts a minute before the first outage (or with the log) from our
smoothed solution without a gate, attitude, velocity and biases, and gets the same noise of the same IMU.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames, rotation, units
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.preparation import prepared_imu
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec
from schuler.recording.trajectory import Trajectory

from .judgement import Errors, horizontal_errors_of, largest, rms, within

KEPT = Path(__file__).with_name("peers.json")
#: A Python that has the peer; by default the one that runs.
PYTHON = os.environ.get("SCHULER_PEER_PYTHON", sys.executable)
_SD = (1.0, 0.5, 1.0, 3.0)  # at the start: position [m], velocity [m/s], level, azimuth [deg]
_LEAD_S = 60.0


def kept() -> dict[str, dict[str, Any]]:
    """Results of the peer by case."""
    return json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else {}


def version() -> str | None:
    """Version of python-ins in the Python that is to run it; None if there is none."""
    ask = "from importlib.metadata import version; import pyins; print(version('python-ins'))"
    done = subprocess.run([PYTHON, "-c", ask], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def beside(row: dict[str, Any]) -> dict[str, Any]:
    """A row of navigation with what is kept of the peer."""
    peer = kept().get(row["name"])
    if peer is None or row.get("error") is None:
        return row
    if "failed" in peer:
        return row | {"peer": peer["failed"]}
    own = row["outage"] if row.get("outage") is not None else row["error"]
    return row | {"peer": peer["peer"], "peer_error": peer["error"], "ratio": own / peer["error"]}


def run(recording: Any, asked: dict[str, Any], judge: Any, lead_s: float = _LEAD_S) -> dict[str, Any]:
    """Error of the peer: mean of the largest in outages, RMS where there are none. [m]"""
    config = NavigationConfig.checked({**asked, "gnss": {**asked.get("gnss", {}), "gate": "off"}, "aiding": {}})
    no_rest = config.model_copy(update={"alignment": config.alignment.model_copy(update={"rest_s": 0.01})})
    runs = [navigate(recording, config)]
    if config.alignment.method != "given":  # a start that takes a turn for a rest would be no help
        runs.append(navigate(recording, no_rest))
    ours = min(runs, key=lambda result: result.innovations.mean_nis()).smooth()
    windows = [w for w in ours.outages if w[0] > ours.trajectory.t[0]]
    imu = prepared_imu(recording.need_imu(), config, []).rates()
    begin = max(float(ours.t[0]), windows[0][0] - lead_s) if windows else float(ours.t[0])
    k = int(np.searchsorted(ours.t, begin))
    imu = imu.between(float(ours.t[k]), imu.t[-1])
    at = ours.trajectory.at(imu.t[:1])
    b_a, b_g = (ours.parameter(block)[k] for block in ("b_a", "b_g"))
    gnss = recording.need_gnss()
    gnss = gnss.where((gnss.t > imu.t[0]) & ~within(gnss.t, windows))
    spec = imu_spec(config)

    def walk(sensor: Any) -> float:
        sigma, tau = getattr(sensor, "in_run_bias", 0.0) or 0.0, getattr(sensor, "in_run_time", None)
        return float(sigma * np.sqrt(2.0 / tau)) if sigma and tau else 0.0

    degrees = np.array([1.0 / units.DEG, 1.0 / units.DEG, 1.0])
    given = {
        "t": imu.t, "gyro": imu.gyro - b_g, "accel": imu.accel - b_a, "kind": "rate",
        "pva": np.concatenate((at.llh[0] * degrees, at.v_eb_n[0], at.rpy_nb[0] / units.DEG)),
        "t_fix": gnss.t, "lla": gnss.llh * degrees, "lever": np.array(config.gnss.lever_arm_m),
        "sigma_r": np.sqrt(np.median(gnss.cov_r_n[:, 0, 0])),
        "v": np.empty((0, 3)) if gnss.v_n is None else gnss.v_n,
        "sigma_v": 0.0 if gnss.cov_v_n is None else np.sqrt(np.median(gnss.cov_v_n[:, 0, 0])),
        "gyro_model": [0.1 * units.DEG, np.median(spec.gyro.random_walk), walk(spec.gyro)],
        "accel_model": [0.05, np.median(spec.accel.random_walk), walk(spec.accel)],
        "sd": _SD, "step": 0.2,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(source, **given)
        script = Path(__file__).with_name("peer_python_ins.py")
        done = subprocess.run(
            [PYTHON, str(script), str(source), str(target)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            return {"failed": done.stderr.strip().splitlines()[-1]}
        out = np.load(target)
        t, path = out["t"], out["path"]
    q = rotation.quat_from_rpy(path[:, 6:9] * units.DEG)
    llh = path[:, :3] / degrees
    r = frames.ecef_from_llh(llh)
    q_eb = rotation.quat_multiply(rotation.quat_from_dcm(frames.C_en(llh)), q)
    v_e = np.einsum("nij,nj->ni", frames.C_en(llh), path[:, 3:6])
    theirs = Trajectory(t, r, v_e, q_eb)
    moved = theirs.moved_by(given["lever"]) if judge.at_antenna else theirs
    errors: Errors = horizontal_errors_of(moved, judge)
    if windows:
        return {"error": float(np.mean(largest(errors, windows)))}
    return {"error": rms(errors)}
