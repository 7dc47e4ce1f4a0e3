"""Single points with defaults against truth, or RTK moved onto their mean where its base station is off."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.recording.formats.rinex_navigation import read_rinex_navigation
from schuler.recording.formats.rinex_observation import read_rinex_observation
from schuler.recording.io import read
from schuler.timebase import WEEK_S
from schuler.units import DEG

from .case import Case
from .judgement import Errors, consistency, rms


def _judged(
    observations: Any, ephemerides: Any, t_gps: np.ndarray, r_e: np.ndarray, moved: bool = False, **options: Any
) -> dict[str, Any]:
    ranges = prepare_ranges(observations, ephemerides, **options)
    points = solve_points(ranges)
    t = points.t + observations.epoch_gps_s
    covered = (t >= t_gps[0]) & (t <= t_gps[-1])
    ok = points.ok & covered
    true = np.stack([np.interp(t[ok], t_gps, r_e[:, k]) for k in range(3)], axis=1)
    C = frames.C_en(frames.llh_from_ecef(true))
    e = np.einsum("nji,nj->ni", C, points.r_e[ok] - true)[:, :2]
    P = np.einsum("nji,njk,nkl->nil", C, points.cov_r_e[ok], C)[:, :2, :2]
    if moved:
        e = e - e.mean(axis=0)
    errors = Errors(t[ok], e, P, P)
    size = np.hypot(*e.T)
    return {
        "error": rms(errors), "outage": float(np.percentile(size, 95)),
        "rejected": 1.0 - float(ok.sum() / covered.sum()),
        **consistency(errors), "p50": float(np.median(size)),
    }  # fmt: skip


def urbannav(data: Path) -> dict[str, Any]:
    folder = data / "urbannav_tst"
    observations = read_rinex_observation(folder / "COM3_190428_124409.obs")
    messages = read_rinex_navigation(folder / "hksc1180.19n").merged_with(
        read_rinex_navigation(folder / "hksc1180.19b")
    )
    truth = np.genfromtxt(folder / "groundTruth_TST.csv", delimiter=",")
    llh = truth[:, 2:5] * np.array([DEG, DEG, 1.0])
    return _judged(observations, messages, truth[:, 0] * WEEK_S + truth[:, 1], frames.ecef_from_llh(llh))


def spirent(data: Path, kind: str, **options: Any) -> dict[str, Any]:
    folder = data / "instinct_spirent"
    observations = read_rinex_observation(folder / f"iono-{kind}" / "Rover-dynamic_MO_Spirent.obs")
    gps, galileo = (read_rinex_navigation(folder / f"RINEX_{x}_Spirent.23{y}") for x, y in (("GN", "N"), ("EN", "L")))
    truth = np.genfromtxt(folder / "Rover-dynamic_PVA_Spirent.csv", delimiter=",", skip_header=1)
    truth = truth[np.unique(truth[:, 0], return_index=True)[1]]
    return _judged(observations, gps.merged_with(galileo), 2244 * WEEK_S + truth[:, 3], truth[:, 4:7], **options)


def walk(data: Path) -> dict[str, Any]:
    folder = data / "rtkexp_walk"
    rtk = read(folder / "gnss_1730_sf.pos", height="msl", geoid_separation=-16.8)
    gnss = rtk.need_gnss()
    return _judged(
        read_rinex_observation(folder / "gnss_1730.obs"), read_rinex_navigation(folder / "gnss_1730.nav"),
        gnss.t + rtk.metadata.time.epoch_gps_s, frames.ecef_from_llh(gnss.llh), moved=True,
    )  # fmt: skip


CASES = [
    Case(recording, "points", (recording,), "m", run, question)
    for recording, run, question in (
        ("urbannav_tst", urbannav, "points"),
        (
            "instinct_spirent",
            partial(spirent, kind="none_tropo-none", ionosphere="none", troposphere="none"),
            "points-no-atmosphere",
        ),
        ("instinct_spirent", partial(spirent, kind="Klob_tropo-Saast"), "points"),
        ("rtkexp_walk", walk, "points"),
    )
]
