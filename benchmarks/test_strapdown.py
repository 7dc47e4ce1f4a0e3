"""Strapdown: 100 000 and a million epochs of increments."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.mechanization import kernels as _kernels
from schuler.mechanization.strapdown import mechanize


@pytest.mark.benchmark(group="strapdown")
@pytest.mark.parametrize("frame", ["ecef", "ned"])
def test_mechanize(benchmark, million, start, frame):
    mechanize(million.between(0.0, 1.0), start, frame=frame)
    log = million.between(0.0, 5000.0)  # later the drift of the repeated log comes to a pole, refused by frame="ned"
    benchmark.extra_info["epochs"] = len(log)
    benchmark.pedantic(mechanize, args=(log, start), kwargs={"frame": frame}, rounds=7)


@pytest.mark.benchmark(group="strapdown")
def test_kernel_ecef(benchmark, million, start):
    n = len(million)
    out = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
    nav = np.concatenate((start.q_eb, start.v_eb_e, start.r_eb_e))
    args = (million.dtheta_ib_b, million.dv_ib_b, million.dt, nav, 7.292115e-5, 0, *out)
    _kernels.strapdown(*args)
    benchmark.extra_info["epochs"] = n
    benchmark.pedantic(_kernels.strapdown, args=args, rounds=7)


@pytest.mark.benchmark(group="strapdown")
def test_peer_python_ins(benchmark, million, peer_start):
    import pandas as pd
    from pyins import strapdown

    table = pd.DataFrame(
        np.column_stack((million.dt, million.dtheta_ib_b, million.dv_ib_b)),
        columns=["dt", "theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"],
        index=pd.Index(million.t, name="time"),
    )

    def run() -> object:
        return strapdown.Integrator(peer_start).integrate(table)

    benchmark.extra_info["epochs"] = len(million)
    benchmark.pedantic(run, rounds=5, warmup_rounds=1)
