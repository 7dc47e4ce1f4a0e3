"""``schuler baseline``."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from cyclopts import Parameter

from schuler import frames, units
from schuler.cli.output import Flag, Folder, print_json, print_verdict, say, writable
from schuler.cli.reading import Part, read_log
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.gnss.ephemerides import Ephemerides
    from schuler.gnss.observations import Observations

_ALL = Part()
_HEADER = "header"
_BELOW_GROUND = 6e6  # distance from the Earth's centre; files write zeros where they do not know [m]


def baseline(
    rover: Path,
    base: Path,
    /,
    *,
    nav: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    base_position: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    static: Flag = False,
    systems: str = "GEC",
    elevation_mask: float = 15.0,
    cn0_mask: float = 30.0,
    sigma_code: float = 0.3,
    sigma_carrier: float = 0.003,
    ratio: float = 3.0,
    fix: bool = True,
    hold: int = 0,
    rover_antenna: str | None = None,
    base_antenna: str | None = None,
    marks: Flag = False,
    ionosphere: Literal["same", "free"] = "same",
    out: Folder = None,
    report: bool = True,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Baseline between two receivers by carrier phases (RTK after the fact): positions of the rover, a page, a table.

    The verdict on the solution stands first; the exit code is 1 where it is failed.

    Parameters
    ----------
    rover
        Raw measurements of the rover with carriers: RINEX, u-blox, or any log that has them.
    base
        Those of the base at the same time.
    nav
        File with broadcast ephemerides, precise orbits (SP3), clocks or antennas (ANTEX); several allowed. Messages in
        the logs themselves are used too.
    base_position
        Base antenna: latitude,longitude in degrees and ellipsoidal height in metres; or header, the position in the
        header of the base's RINEX file, with the height of the antenna above it. Default: the mean of its single
        points, good to metres: the rover is off by as much, the baseline is not.
    static
        The rover does not move.
    systems
        Letters out of GECJ (GPS, Galileo, BeiDou, QZSS).
    elevation_mask
        Lowest elevation in degrees.
    cn0_mask
        Weakest signal in dB-Hz, in either receiver.
    sigma_code
        1-sigma in metres of one receiver's pseudorange of a strong satellite overhead.
    sigma_carrier
        1-sigma in metres of one receiver's carrier of a strong satellite overhead.
    ratio
        How many times as far away, in squared norm, the second-best integers must be as the best for a fix.
    fix
        Fix ambiguities to integers; otherwise all is float.
    hold
        Epochs in a row in which an integer must come out the same to be held from then on; 0: never.
    rover_antenna
        Type and radome of the rover's antenna in an ANTEX file among --nav: its phase centres are taken out. Default:
        as the header of the log states, if the file has both antennas; none: they are not taken out.
    base_antenna
        Those of the base's antenna.
    marks
        From mark to mark: heights and eccentricities of the antennas, as the logs state them, are taken off, and
        --base-position is the base's mark.
    ionosphere
        same: above both antennas, good to 10 km; free: taken out by two bands, whose wide lanes are fixed first. Noise
        is then three times as large, and a fix takes minutes.
    out
        Folder for rover.pos, baseline.csv and report.html. Default: the rover's name with -baseline.
    report
        Write report.html.
    json
        Print one JSON object instead of text.
    """
    from schuler.gnss.antennas import antenna_pair
    from schuler.gnss.baseline import solve_baseline
    from schuler.recording.io import write
    from schuler.recording.satellite_positions import baseline_series

    began = time.perf_counter()
    roving = read_log(rover, None)
    measured_rover = _observations(part.of(roving), rover, "rover")
    fixed_station = _station(base, measured_rover)
    measured = measured_rover, _observations(fixed_station, base, "base")
    messages = ephemerides_of((roving, fixed_station), nav, "neither log has ephemerides")
    base_llh = _base_position(measured[1], base_position, marks=marks)
    notes = [f"{name}: {x}" for name, log in (("rover", roving), ("base", fixed_station)) for x in log.metadata.notes]
    antennas = antenna_pair(
        messages.antennas, (measured[0].antenna, measured[1].antenna), (rover_antenna, base_antenna), notes
    )
    folder = writable(Path(f"{rover.resolve().stem}-baseline")) if out is None else out
    eccentricities_n = _eccentricities(measured, notes) if marks else None
    try:
        solution = solve_baseline(
            *measured, messages, base_llh, static=static, systems=systems, elevation_mask=elevation_mask * units.DEG,
            cn0_mask=cn0_mask, sigma_code=sigma_code, sigma_carrier=sigma_carrier, ratio=ratio, fix=fix, hold=hold,
            antennas=antennas, eccentricities_n=eccentricities_n, ionosphere=ionosphere,
        )  # fmt: skip
        solution = replace(solution, notes=(*solution.notes, *notes))
    except InputError as error:
        text = str(error).replace("base_llh:", "--base-position:").replace("[rad, rad, m]", "degrees,degrees,metres")
        raise InputError(text) from None
    files = {"table": solution.table().to_csv(folder / "baseline.csv")}
    if solution.ok.any():
        sources = {**roving.metadata.sources, **fixed_station.metadata.sources}
        about = Metadata(rover.stem, roving.metadata.time, sources, notes=solution.notes)
        (files["rover"],) = write(Recording(gnss=baseline_series(solution), metadata=about), folder / "rover.pos")
    if report:
        files["report"] = solution.report(folder / "report.html", f"{rover.stem} from {base.stem}")
    if json:
        data = {"command": "baseline", **solution.to_dict(), "elapsed_s": time.perf_counter() - began, "files": files}
        print_json(data)
    else:
        print_verdict(solution.verdict)
        print(solution.summary())
        for note in solution.notes:
            say(note)
        print("\n".join(f"{name}: {path}" for name, path in files.items()))
    return int(solution.verdict.status == "failed")


def _station(base: Path, rover: Observations) -> Recording:
    """Log of the base; a stream of RTCM 3, which says the time of week only, is of the rover's week."""
    from schuler.recording.formats.rtcm import is_rtcm
    from schuler.recording.io import read
    from schuler.timebase import WEEK_S

    if not is_rtcm(base):
        return read_log(base, None)
    return read(base, time=f"gps-tow:{int((rover.epoch_gps_s + float(rover.t[0])) // WEEK_S)}")


def _observations(recording: Recording, path: Path, name: str) -> Observations:
    o = recording.observations
    if o is None or not len(o):
        raise InputError(
            f"{path}: expected raw measurements of the {name} (RINEX observations, u-blox RXM-RAWX, RTCM 3), got "
            f"{recording.summary(notes=False).splitlines()[0]}"
        )
    return o


def ephemerides_of(recordings: Iterable[Recording], nav: Iterable[Path], missing: str) -> Ephemerides:
    """Messages of the files given with ``--nav``, then those of the logs.

    Parameters
    ----------
    recordings : iterable of Recording
    nav : iterable of Path
    missing : str
        Begin of the sentence where there are none.
    """
    parts = [r.ephemerides for r in recordings if r.ephemerides is not None]
    given = []
    for path in nav:
        messages = read_log(path, None).ephemerides
        if messages is None:
            raise InputError(f"--nav {path}: expected broadcast ephemerides (RINEX navigation, u-blox), got none")
        given.append(messages)
    if not given + parts:
        raise InputError(f"{missing}: give a RINEX navigation file of that day with --nav")
    first, *others = given + parts
    for other in others:
        first = first.merged_with(other)
    return first


def _eccentricities(measured: tuple[Observations, Observations], notes: list[str]) -> FloatArray:
    """Antennas of rover and base from their marks as the logs state them. Shape (2, 3). [m]"""
    out = np.zeros((2, 3))
    for k, (o, name) in enumerate(zip(measured, ("rover", "base"), strict=True)):
        if o.eccentricity_n is None:
            raise InputError(
                f"--marks: the {name}'s log does not state its antenna's height (RINEX: ANTENNA: DELTA H/E/N); without "
                "--marks the baseline is from antenna to antenna"
            )
        out[k] = o.eccentricity_n
        north, east, down = o.eccentricity_n
        notes.append(f"{name}: antenna {-down:.4f} m above its mark, {north:.4f} m north, {east:.4f} m east of it")
    return out


def _base_position(base: Observations, given: str | None, *, marks: bool) -> tuple[float, ...] | None:
    """Base antenna, or its mark [rad, rad, m]; None if it is to be found from the base's own ranges."""
    from schuler.recording.io.hint_texts import parse_origin

    if given == _HEADER:
        if base.position_e is None or np.linalg.norm(base.position_e) < _BELOW_GROUND:
            raise InputError("--base-position header: the base's file states none; give latitude,longitude,height")
        # RINEX states the mark, RTCM 3 the antenna
        at_antenna = base.station_e is not None
        place_e = np.array(base.station_e if base.station_e is not None else base.position_e)
        if at_antenna is marks and base.eccentricity_n is not None:
            to_antenna_e = frames.C_en(frames.llh_from_ecef(place_e)) @ base.eccentricity_n
            place_e = place_e - to_antenna_e if marks else place_e + to_antenna_e
        return tuple(frames.llh_from_ecef(place_e).tolist())
    try:
        return parse_origin(given)
    except InputError as error:
        raise InputError(str(error).replace("origin:", "--base-position:")) from None
