"""One run of python-ins, in a Python of its own: ``python peer_python_ins.py IN.npz OUT.npz``.

It knows nothing of this package: arrays in, arrays out, so that the two need not share an environment.
"""

from __future__ import annotations

import sys

import numpy as np


def main(source: str, target: str) -> None:
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    d = np.load(source)
    imu = pd.DataFrame(
        np.column_stack((d["gyro"], d["accel"])), index=pd.Index(d["t"], name="time"),
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )  # fmt: skip
    increments = strapdown.compute_increments_from_imu(imu, str(d["kind"]))
    start = pd.Series(
        d["pva"], index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"], name=d["t"][0]
    )
    fixes = pd.Index(d["t_fix"], name="time")
    lever = d["lever"]
    aids = [measurements.Position(pd.DataFrame(d["lla"], fixes, ["lat", "lon", "alt"]), float(d["sigma_r"]), lever)]
    if d["v"].size:
        aids.append(
            measurements.NedVelocity(pd.DataFrame(d["v"], fixes, ["VN", "VE", "VD"]), float(d["sigma_v"]), lever)
        )
    models = [
        inertial_sensor.EstimationModel(bias_sd=float(b), noise=float(n), bias_walk=float(w) or None)
        for b, n, w in (d["gyro_model"], d["accel_model"])
    ]
    result = filters.run_feedback_filter(
        start, *map(float, d["sd"]), increments, *models, measurements=aids, time_step=float(d["step"])
    )
    path = result.trajectory
    np.savez(target, t=path.index.to_numpy(float), path=path.to_numpy(float))


if __name__ == "__main__":
    main(*sys.argv[1:])
