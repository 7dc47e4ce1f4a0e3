"""Navigation recordings of the corpus, varied: begun in motion, mounted otherwise, at other rates, with fewer fixes.

    python -m benchmarks.variations [--half odd|even] [--only TEXT]

Recordings never seen differ in such ways from those at hand. Read and judged as in :mod:`benchmarks.corpus`, question
*fixes*; a row for each kind of variation, a line for each run on stderr. Defaults are chosen on ``--half odd`` and
reported on ``--half even``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from schuler import rotation
from schuler.exceptions import SchulerError
from schuler.recording.io.over_ground import NO_HEIGHT, NO_VERTICAL_RATE
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.units import DEG

from .corpus.case import DATA, Case, halves
from .corpus.cases import CASES as ALL
from .corpus.judgement import Judge
from .corpus.navigation import CASES, Asked, run

Read = tuple[Recording, Asked, Judge | None]
Variation = Callable[[Read], Read]

LIMIT, BAND = 10.0, (0.3, 3.0)  # normalised error squared that no run may have unnoticed, and that is wanted
PARKED = "vn310_roof"  # has no course
_LONGEST_S, _SHARE = 150.0, 0.45  # of a cut, and of the log


def cut(share: float) -> Variation:
    """A piece of the log begun in motion, at a share of what is left besides the piece."""

    def varied(read: Read) -> Read:
        recording, asked, judge = read
        gnss, imu = recording.need_gnss(), recording.need_imu()
        first, last = max(gnss.t[0], imu.t[0]), min(gnss.t[-1], imu.t[-1])
        length = min(_LONGEST_S, _SHARE * (last - first))
        start = first + share * max(last - first - length, 0.0)
        return recording.between(start, min(start + length, last)), asked, judge

    return varied


def turned(*rotvec_deg: float) -> Variation:
    """The IMU mounted otherwise, and nobody stated it. [deg]"""
    C = rotation.dcm_from_rotvec(DEG * np.array(rotvec_deg))

    def varied(read: Read) -> Read:
        recording, asked, judge = read
        asked = json.loads(json.dumps(asked))
        lever = asked.get("gnss", {}).get("lever_arm_m")
        if lever is not None:
            asked["gnss"]["lever_arm_m"] = (C @ np.array(lever)).tolist()
        mount = asked["imu"].pop("mount_rpy_deg", [0.0, 0.0, 0.0])
        C_bs = C @ rotation.dcm_from_rpy(DEG * np.array(mount))
        return replace(recording, imu=recording.need_imu().rotated(C_bs)), asked, judge

    return varied


def slower(factor: int, mean: bool) -> Variation:
    """The IMU at a lower rate: means of so many samples, or the first of so many."""

    def varied(read: Read) -> Read:
        recording, asked, judge = read
        imu = recording.need_imu()
        n = len(imu) // factor * factor
        parts = (x[:n].reshape(-1, factor, *x.shape[1:]) for x in (imu.t, imu.gyro, imu.accel))
        return replace(recording, imu=ImuSeries(*(x.mean(axis=1) if mean else x[:, 0] for x in parts))), asked, judge

    return varied


def fewer(rate_hz: float) -> Variation:
    """Fixes at a lower rate; the others judge."""

    def varied(read: Read) -> Read:
        recording, asked, judge = read
        gnss = recording.need_gnss()
        keep = np.zeros(len(gnss), dtype=bool)
        keep[np.searchsorted(gnss.t, np.arange(gnss.t[0], gnss.t[-1], 1.0 / rate_hz) - 1e-3)] = True
        if judge is None:
            judge = Judge.of_fixes(gnss.where(~keep))
        return replace(recording, gnss=gnss.where(keep)), asked, judge

    return varied


def positions_only(read: Read) -> Read:
    """Fixes without velocities."""
    recording, asked, judge = read
    return replace(recording, gnss=replace(recording.need_gnss(), v_n=None, cov_v_n=None)), asked, judge


def without_heights(read: Read) -> Read:
    """Fixes with latitude and longitude alone, as tables without a column of heights are read."""
    recording, asked, judge = read
    gnss = recording.need_gnss()
    llh, cov_r_n = gnss.llh.copy(), gnss.cov_r_n.copy()
    llh[:, 2], cov_r_n[:, 2, :], cov_r_n[:, :, 2] = 0.0, 0.0, 0.0
    cov_r_n[:, 2, 2] = NO_HEIGHT**2
    v_n, cov_v_n = gnss.v_n, gnss.cov_v_n
    if v_n is not None and cov_v_n is not None:
        v_n, cov_v_n = v_n * [1.0, 1.0, 0.0], cov_v_n.copy()
        cov_v_n[:, 2, :] = cov_v_n[:, :, 2] = 0.0
        cov_v_n[:, 2, 2] = NO_VERTICAL_RATE**2
    changed = replace(gnss, llh=llh, cov_r_n=cov_r_n, v_n=v_n, cov_v_n=cov_v_n)
    return replace(recording, gnss=changed), asked, judge


VARIATIONS: dict[str, tuple[Variation, ...]] = {
    "as recorded": (lambda read: read,),
    "begun in motion": (cut(0.25), cut(0.5), cut(0.75), cut(1.0)),
    "turned by 90 deg": (turned(0.0, 0.0, 90.0), turned(0.0, 90.0, 0.0), turned(-90.0, 0.0, 0.0)),
    "turned by 180 deg": (turned(0.0, 0.0, 180.0), turned(180.0, 0.0, 0.0)),
    "askew by 10 to 40 deg": (turned(7.0, -5.0, 5.0), turned(10.0, 10.0, -15.0), turned(-25.0, 15.0, 28.0)),
    "half and third of the rate": (slower(2, True), slower(3, False)),
    "fixes at 0.5 and 0.2 Hz": (fewer(0.5), fewer(0.2)),
    "positions only": (positions_only,),
    "without heights": (without_heights,),
}  # fmt: skip


def varied(case: Case, variation: Variation) -> dict[str, Any]:
    """Row of a case with a variation."""
    keywords = case.run.keywords  # type: ignore[attr-defined]
    reader = keywords["reader"]
    try:
        return run(DATA, lambda data: variation(reader(data)), keywords["outages"], keywords["aiding"])
    except SchulerError as error:
        return {"sentence": f"{type(error).__name__}: {error}"}


def wrong(row: dict[str, Any]) -> str:
    """What is wrong with a row, a word; empty where nothing is."""
    if "sentence" in row:
        return "refused"
    if row["nees"] > LIMIT and row["verdict"] == "ok":
        return "silent"
    if row["verdict"] == "failed" and row["nees_band"][0] < row["nees"] < row["nees_band"][1]:
        return "false alarm"
    return "" if BAND[0] <= row["nees"] <= BAND[1] else "outside"


def main(argv: list[str] | None = None) -> int:
    """Print one row a kind of variation; 1 if a run above the limit is called ok."""
    parser = argparse.ArgumentParser("python -m benchmarks.variations", description=__doc__)
    parser.add_argument("--half", choices=("odd", "even"), help="recordings by name (default all)")
    parser.add_argument("--only", default="", help="part of the name of a recording or variation")
    options = parser.parse_args(argv)
    half = halves(ALL)
    cases = [c for c in CASES if c.question == "fixes" and (DATA / c.needs[0]).exists() and c.recording != PARKED]
    if options.half:
        cases = [c for c in cases if (half[c.name] == "choosing") == (options.half == "odd")]
    print("| variation | runs | median NEES | largest | outside of 0.3 to 3 | above 10 and ok | failed inside | "
          "doubtful | refused | error over as recorded, median | largest |")  # fmt: skip
    print("|" + "---|" * 11, flush=True)
    as_recorded: dict[str, float] = {}
    silent = 0
    for name, variations in VARIATIONS.items():
        rows = []
        for case in cases:
            for number, variation in enumerate(variations):
                label = f"{case.recording}, {name} ({number + 1})"
                if options.only and options.only not in label:
                    continue
                rows.append({"name": case.name, **varied(case, variation)})
                row = rows[-1]
                text = row.get("sentence") or f"{row['error']:.3g} m, NEES {row['nees']:.3g}, {row['verdict']}"
                print(f"{label}: {text} {wrong(row)}", file=sys.stderr, flush=True)
        if not rows:
            continue
        good = [row for row in rows if "sentence" not in row]
        if name == "as recorded":
            as_recorded = {row["name"]: row["error"] for row in good}
        nees = [row["nees"] for row in good] or [np.nan]
        ratio = [row["error"] / as_recorded[row["name"]] for row in good if row["name"] in as_recorded] or [np.nan]
        words = [wrong(row) for row in rows]
        doubtful = sum(row.get("verdict") == "doubtful" for row in rows)
        print(
            f"| {name} | {len(rows)} | {np.median(nees):.2f} | {max(nees):.2g} | {words.count('outside')} "
            f"| {words.count('silent')} | {words.count('false alarm')} | {doubtful} | {words.count('refused')} "
            f"| {np.median(ratio):.2f} | {max(ratio):.2g} |", flush=True,
        )  # fmt: skip
        silent += words.count("silent")
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())
