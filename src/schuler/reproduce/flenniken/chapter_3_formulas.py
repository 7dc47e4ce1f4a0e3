"""Chapter 3: heading of a KVH-5000 beside the formula, and all formulas of growth by white noise against runs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.growth import (
    growth,
    lateral_white,
    lateral_white_sampled,
    planar_bounds,
    planar_reckoning,
    white,
)
from schuler.growth.dead_reckoning import readings
from schuler.reproduce.cells import against, claimed, shown
from schuler.reproduce.flenniken.bands import ERRORS, deviation
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.catalogue import spec, triad
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from schuler.growth import Bounds
    from schuler.plotting.figure import Figure
    from schuler.sensors.spec import ImuSpec

#: Samples beside the continuous forms: 3 / k of a variance after k = 2000 steps.
_SAMPLED = 0.005
_KVH_S, _KVH_HZ = 2000.0, 1.0


def _kvh(*, bias: bool) -> ImuSpec:
    """The KVH as measured; its sheet's 1 deg/h with the time constant of its grade, as none is stated for it."""
    own, grade = triad("KVH-5000-measured", "gyro"), spec("flenniken-tactical")
    wander = {"in_run_bias": 1.0 * DEG_PER_HR, "in_run_time": grade.gyro.in_run_time} if bias else {}
    gyro = replace(own, bias_instability=0.0, **wander)
    return replace(grade, name="KVH-5000", gyro=gyro)


@cache
def _kvh_bounds(bias: bool, effort: Effort) -> Bounds:
    runs = effort.runs(800, 5000)
    return planar_bounds(_kvh(bias=bias), _KVH_S, rate_hz=_KVH_HZ, runs=runs, seed=effort.seed, start="zero")


def kvh_with_bias(effort: Effort) -> Outcome:
    """Figure 3.7."""
    b = _kvh_bounds(True, effort)
    form = np.sqrt(white(1, b.t, _kvh(bias=True).gyro.random_walk))
    exact = growth(_kvh(bias=True), b.t, gravity=0.0, start="zero").total("heading")
    early, late = b.index(10.0), len(b.t) - 1
    ratio = b.sigma["heading"] / form
    cells = (
        claimed("2000 s: bound over (3.8)", "grows faster after a time", float(ratio[late]),
             low=1.0 + ERRORS * b.uncertainty, tolerance="statistical"),
        claimed("bound over (3.8), 2000 s over 10 s", "grows faster after a time", float(ratio[late] / ratio[early]),
             low=1.0 + ERRORS * sqrt(2.0) * b.uncertainty, tolerance="statistical"),
        deviation("2000 s: heading", float(exact[late]) / DEG, float(b.sigma["heading"][late]) / DEG, b.runs,
                  unit="deg", also=_SAMPLED, source="curve"),
    )  # fmt: skip
    reason = "The time constant of the KVH's bias is not stated: 100 s, that of tactical grade, is taken."
    return Outcome(cells, reason, (lambda: _kvh_figure(True, effort),))


def kvh_without_bias(effort: Effort) -> Outcome:
    """Figure 3.8."""
    b = _kvh_bounds(False, effort)
    form = np.sqrt(white(1, b.t, _kvh(bias=False).gyro.random_walk))
    cells = tuple(
        deviation(f"{seconds:g} s: heading", float(form[k]) / DEG, float(b.sigma["heading"][k]) / DEG, b.runs,
                  unit="deg", reference="thesis", source="as (3.8)")
        for seconds in (20.0, 200.0, 2000.0)
        for k in (b.index(seconds),)
    )  # fmt: skip
    return Outcome(cells, "", (lambda: _kvh_figure(False, effort),))


def kvh_log_inside(effort: Effort) -> Outcome:
    """Figure 3.9."""
    heading, bound, t = _kvh_logs(effort)
    inside = np.abs(heading) <= bound[:, None]
    n = heading.shape[1]
    cells = (
        # a log of the model itself would be inside one sigma in 68 % of cases
        claimed("logs inside the 1-sigma bound at the end", "well within", float(inside[-1].mean()),
             low=0.683, tolerance="band"),
        shown("share of time that a log is inside, mean of logs", float(inside.mean())),
        shown("logs", float(n)),
    )  # fmt: skip
    reason = (
        "The log is not public: logs of the noise found in it, which shows no bias, are simulated. The bound has the "
        "sheet's bias and so holds them easily."
    )
    return Outcome(cells, reason, (lambda: _inside_figure(t, heading[:, 0], bound),))


@cache
def _kvh_logs(effort: Effort) -> tuple[FloatArray, FloatArray, FloatArray]:
    count, runs = round(_KVH_S * _KVH_HZ), effort.runs(200, 1000)
    rng = np.random.default_rng([effort.seed, 39])
    rate = readings(_kvh(bias=False).gyro, (count, runs), 1.0 / _KVH_HZ, rng)
    heading, _, _ = planar_reckoning(rate, np.zeros((count, runs)), 1.0 / _KVH_HZ)
    t = np.arange(1, count + 1) / _KVH_HZ
    return heading, growth(_kvh(bias=True), t, gravity=0.0, start="zero").total("heading"), t


def formulas(effort: Effort) -> Outcome:
    """Equations (3.8), (3.18), (3.28), (3.41) and (3.51) against runs."""
    t, rate_hz = 20.0, 20.0
    b, imu = _white_bounds(effort)
    N_a, N_g = imu.accel.random_walk, imu.gyro.random_walk
    v, p = (sqrt(float(x)) for x in lateral_white(t, N_a, N_g))
    v_k, p_k = (sqrt(float(x)) for x in lateral_white_sampled(t, 1.0 / rate_hz, N_a, N_g))
    printed = p * sqrt(12.0 / 8.0)
    plain = {
        "heading, (3.8)": (sqrt(float(white(1, t, N_g))), "heading"),
        "velocity north, (3.18)": (sqrt(float(white(1, t, N_a))), "velocity_north"),
        "position north, (3.28)": (sqrt(float(white(2, t, N_a))), "position_north"),
    }
    cells = [
        deviation(f"{name}: runs over formula", 1.0, float(b.sigma[key][-1]) / form, b.runs, reference="thesis",
                  also=1.0 / (t * rate_hz))
        for name, (form, key) in plain.items()
    ]  # fmt: skip
    # sums of products of two normal numbers have a kurtosis of 7
    error = ERRORS * sqrt(6.0 / (4.0 * b.runs))
    east_v, east_p = (float(b.sigma[f"{q}_east"][-1]) for q in ("velocity", "position"))
    cells += [
        against("velocity east, (3.41): runs over formula", 1.0, east_v / v, relative=error + 1.0 / (t * rate_hz)),
        against("position east, (3.51) with 1/8: runs over formula", 1.0, east_p / printed,
                relative=error + 1.0 / (t * rate_hz)),
        against("velocity east, sampled", 1.0, east_v / v_k, relative=error, reference="corrected", source="3.41"),
        against("position east with 1/12, sampled", 1.0, east_p / p_k, relative=error, reference="corrected",
                source="3.51"),
    ]  # fmt: skip
    reason = (
        "(3.51) sums variances that grow with time as if they were alike: 1/8 is to be 1/12, the printed deviation "
        "22.5 % too large. The printed derivation of (3.28) has two errors that cancel."
    )
    return Outcome(tuple(cells), reason, (lambda: _formulas_figure(effort),))


@cache
def _white_bounds(effort: Effort) -> tuple[Bounds, ImuSpec]:
    imu = spec("flenniken-consumer")
    gyro, accel = (replace(t, in_run_bias=0.0, in_run_time=0.0) for t in (imu.gyro, imu.accel))
    imu = replace(imu, gyro=gyro, accel=accel)
    return planar_bounds(imu, 20.0, rate_hz=20.0, runs=effort.runs(4000, 12_000), seed=effort.seed), imu


def _kvh_figure(bias: bool, effort: Effort) -> Figure:
    from schuler.growth.figures import beside_figure

    b = _kvh_bounds(bias, effort)
    form = {"(3.8)": {"heading": np.sqrt(white(1, b.t, _kvh(bias=bias).gyro.random_walk))}}
    return beside_figure({"KVH-5000": b}, ("heading",), form, "Heading of a KVH-5000 at rest")


def _inside_figure(t: FloatArray, heading: FloatArray, bound: FloatArray) -> Figure:
    from schuler.plotting import figure as content
    from schuler.plotting.figure import Figure as Drawn
    from schuler.plotting.figure import Panel

    items = (
        content.band(t, -bound / DEG, bound / DEG, "sigma", "1-sigma bound"),
        content.line(t, heading / DEG, "filtered", "simulated log"),
    )
    return Drawn("kvh_inside", "A log inside its bound", "", (Panel("time [s]", "heading [deg]", items),))


def _formulas_figure(effort: Effort) -> Figure:
    from schuler.growth.figures import beside_figure

    b, imu = _white_bounds(effort)
    v, p = lateral_white(b.t, imu.accel.random_walk, imu.gyro.random_walk)
    right = {"velocity_east": np.sqrt(v), "position_east": np.sqrt(p)}
    wrong = {"position_east": np.sqrt(1.5 * p)}
    names = ("velocity_east", "position_east")
    return beside_figure({"white noise": b}, names, {"1/12": right, "1/8 as printed": wrong}, "Across the track")


ITEMS = (
    Item("fig-3.7", "KVH-5000: heading bound beside the formula", "statistical", kvh_with_bias),
    Item("fig-3.8", "KVH-5000: the same without moving bias", "statistical", kvh_without_bias),
    Item("fig-3.9", "KVH-5000: a log inside the bound", "hardware", kvh_log_inside),
    Item("text-3.7", "Five formulas of growth by white noise against runs", "statistical", formulas),
)  # fmt: skip
