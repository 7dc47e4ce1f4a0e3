"""Carrier phases against a base: integers fixed with the inertial prediction, held, and put into the schedule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterState
from schuler.filtering.filter_arrays import Aiding, ImuStream, NodeArrays, RecordArrays, TrajectoryArrays
from schuler.filtering.measurements import (
    ARC_START,
    CARRIER_PHASE,
    POSITION,
    REJECTED,
    MeasurementSchedule,
    gate_threshold,
    in_windows,
    merged,
)
from schuler.filtering.states import StateLayout
from schuler.gnss.antennas import Antenna, antenna_of
from schuler.gnss.baseline_result import SAME_IONOSPHERE
from schuler.gnss.carrier_scale import check_carriers
from schuler.gnss.cycle_slips import without_slips
from schuler.gnss.differences import date
from schuler.gnss.integers import CarrierFix, HeldIntegers, Measured, fix_epoch
from schuler.gnss.observations import Observations
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import Ranges, predicted_ranges
from schuler.gnss.relative import RelativeCarriers, relative_ranges, with_second_band
from schuler.gnss.signal_choice import second_band
from schuler.gnss.slow_errors import slow_sigmas
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.satellites import inflated
from schuler.navigation.prepared import PreparedRun
from schuler.recording.recording import Recording

_BASE_OFF = 200.0  # of the stated base from its own single points [m]
_SAME_EPOCH_S = 1e-3  # between times of two bands, each corrected by its own clock [s]
_UNUSED = -1.0  # gate of a row that is not used


@dataclass(frozen=True)
class BaseCarriers:
    """Carriers relative to a base, and the ranges they belong to."""

    ranges: Ranges
    carriers: RelativeCarriers


def ranges_with_base(
    recording: Recording,
    ranges: Ranges,
    near_e: FloatArray,
    config: NavigationConfig,
    base: Observations | Ranges | None,
    notes: list[str],
) -> BaseCarriers:
    """Ranges corrected by a base station, and carriers relative to it.

    Parameters
    ----------
    recording : Recording
        Its ephemerides serve the base, too.
    ranges : Ranges
        As :func:`schuler.navigation.inputs.satellites.satellites` prepares them.
    near_e : ndarray, shape (3,)
        About where the rover is, Earth-fixed. [m]
    config : NavigationConfig
        Sections ``gnss.tight`` and ``gnss.tight.base``.
    base : Observations or Ranges, optional
        Instead of the file that the configuration names.
    notes : list of str
        Gets sentences on the base.

    Raises
    ------
    InputError
        If there is no base, it is not where it is stated to be, or has nothing in common with the rover.
    """
    tight = config.gnss.tight
    section = tight.base
    if base is None:
        base = _read_base(section.observations, recording, notes)
    stated_e, eccentricity_n, entry = None, None, "gnss.tight.base.llh_deg"
    logged = base if isinstance(base, Observations) else None
    if isinstance(base, Observations):
        stated_e, eccentricity_n = base.station_e, base.eccentricity_n
        check_carriers(base, tight.systems, "gnss.tight.base")
        base = _prepared_base(base, recording, config, notes)
    points = solve_points(base)
    if not points.ok.any():
        raise InputError(
            f"gnss.tight.base: no single point of the base could be solved: {points.summary()}; "
            "expected stamps in GPS time, messages of that day, and codes that fit them"
        )
    mean_e = points.r_e[points.ok].mean(axis=0)
    if section.llh_deg is None and stated_e is not None:
        base_e, entry = np.array(stated_e), "gnss.tight.base, as its messages state it"
        notes.append("base position: as the station states it")
    elif section.llh_deg is None:
        base_e = mean_e
        notes.append("base position: the mean of its single points, good to metres; the solution is off by as much")
    else:
        llh = np.array(section.llh_deg) * (units.DEG, units.DEG, 1.0)
        base_e = frames.ecef_from_llh(llh)
        if section.mark:
            base_e = base_e + frames.C_en(llh) @ _eccentricity(eccentricity_n, notes)
    off = float(np.linalg.norm(mean_e - base_e))
    if off > _BASE_OFF:
        raise InputError(
            f"{entry}: {off:.0f} m from where the base's own ranges place it; expected latitude "
            "and longitude in degrees and the ellipsoidal height of its antenna in metres"
        )
    far = float(np.linalg.norm(near_e - base_e))
    if far > SAME_IONOSPHERE:
        notes.append(
            f"the base is {far / 1e3:.0f} km away: beyond {SAME_IONOSPHERE / 1e3:g} km the ionosphere at both antennas "
            "differs by more than integers of one frequency bear, and they may be wrong"
        )
    base = without_slips(base, np.broadcast_to(base_e, (len(base), 3)), float(tight.carrier_sigma_m), [])
    corrected, carriers = relative_ranges(
        ranges, base, base_e, sigma_code=section.code_sigma_m, sigma_carrier=float(tight.carrier_sigma_m)
    )
    if logged is not None:
        carriers = _with_second_band(recording, ranges, carriers, logged, base_e, config, notes)
    measured = ranges.used & np.isfinite(ranges.pseudorange)
    alone = int(np.sum(measured & ~np.isfinite(corrected.pseudorange)))
    if alone:
        notes.append(f"{alone} of {int(measured.sum())} pseudoranges have none of the base beside them: left out")
    return BaseCarriers(inflated(corrected, config.gnss.correlated), carriers)


def _eccentricity(stated_n: tuple[float, float, float] | None, notes: list[str]) -> FloatArray:
    if stated_n is None:
        raise InputError(
            "gnss.tight.base.mark: the base's log does not state its antenna's height (RINEX: ANTENNA: DELTA H/E/N); "
            "give the antenna's own position in gnss.tight.base.llh_deg, and set mark to false"
        )
    notes.append(f"base: its antenna is {-stated_n[2]:.4f} m above the mark, as its log states")
    return np.array(stated_n)


def _read_base(file: str | None, recording: Recording, notes: list[str]) -> Observations:
    if file is None:
        raise InputError(
            'gnss.tight.carrier = "rtk" needs a base station: name its log in gnss.tight.base.observations, or set '
            'carrier to "time-differenced", which needs none'
        )
    from schuler.recording.formats.rtcm import is_rtcm, read_rtcm
    from schuler.recording.io.dispatch import read

    observations: Observations | None
    if is_rtcm(Path(file)):  # its messages say the time of week, the rover which week
        rover = recording.observations
        near = None if rover is None or not len(rover) else rover.epoch_gps_s + float(rover.t[0])
        stream = read_rtcm(file, near)
        observations, remarks = stream.observations, stream.notes
    else:
        log = read(Path(file))
        observations, remarks = log.observations, log.metadata.notes
    if observations is None:
        raise InputError(f"gnss.tight.base.observations: no raw measurements in {file}; give a RINEX or UBX log")
    notes += [f"base: {note}" for note in remarks]
    return observations


def _prepared_base(base: Observations, recording: Recording, config: NavigationConfig, notes: list[str]) -> Ranges:
    if recording.observations is None or recording.ephemerides is None:
        raise InputError(
            "gnss.tight.base: observations of a base need observations and ephemerides of the recording; it has "
            "prepared ranges only"
        )
    spans = [(o.epoch_gps_s + o.t[[0, -1]]).tolist() for o in (recording.observations, base) if len(o)]
    if len(spans) == 2 and max(spans[0][0], spans[1][0]) > min(spans[0][1], spans[1][1]) + _SAME_EPOCH_S:
        rover_span, base_span = (f"{date(first)} to {date(last)}" for first, last in spans)
        raise InputError(
            f"gnss.tight.base: no time in common: the rover's log is of {rover_span}, the base's of {base_span} (GPS "
            "time); give a base log of that time"
        )
    tight = config.gnss.tight
    antennas = recording.ephemerides.antennas
    rover = antenna_of(antennas, recording.observations.antenna, tight.antenna, "rover", [])
    antenna = antenna_of(antennas, base.antenna, tight.base.antenna, "base", notes)
    if (rover is None) != (antenna is None):
        unknown, entry = ("rover", "gnss.tight.antenna") if rover is None else ("base", "gnss.tight.base.antenna")
        notes.append(
            f"the {unknown}'s antenna is not known, and its phase centre not taken out: the height is off by it, some "
            f'centimetres; name it in {entry}, or set both entries to "none" where antennas are of one type'
        )
    ranges = _on_rover_time(base, recording, config, antenna)
    if not ranges.used.any():
        raise InputError(
            "gnss.tight.base: no range of the base is usable; are the recording's ephemerides of its day? "
            f"{'; '.join(ranges.notes)}"
        )
    return ranges


def _on_rover_time(
    o: Observations, recording: Recording, config: NavigationConfig, antenna: Antenna | None,
    signals: Mapping[str, tuple[str, ...]] | None = None,
) -> Ranges:  # fmt: skip
    """Ranges of a receiver, prepared as the rover's are and on its axis of time; of some signals only."""
    rover, ephemerides, tight = recording.observations, recording.ephemerides, config.gnss.tight
    if rover is None or ephemerides is None:
        raise InputError("gnss.tight.base: the recording has no observations or no ephemerides")
    ranges = prepare_ranges(
        o, ephemerides, signals=signals, systems="".join(signals) if signals else tight.systems,
        ionosphere="none" if signals and tight.ionosphere == "free" else tight.ionosphere,
        troposphere=tight.troposphere, elevation_mask=tight.elevation_mask_deg * units.DEG,
        cn0_mask=tight.cn0_mask_dbhz, antenna=antenna,
    )  # fmt: skip
    return replace(ranges, t=ranges.t + (o.epoch_gps_s - rover.epoch_gps_s))


def _with_second_band(
    recording: Recording, ranges: Ranges, carriers: RelativeCarriers, base: Observations, base_e: FloatArray,
    config: NavigationConfig, notes: list[str],
) -> RelativeCarriers:  # fmt: skip
    """Carriers of a second band beside the first, where both receivers have one."""
    rover, ephemerides, tight = recording.observations, recording.ephemerides, config.gnss.tight
    if rover is None or ephemerides is None:
        return carriers
    signals = second_band(ranges, (rover, base), tight.systems)
    if not signals:
        return carriers
    ours, theirs = (
        _on_rover_time(o, recording, config, antenna_of(ephemerides.antennas, o.antenna, given, name, []), signals)
        for o, given, name in ((rover, tight.antenna, "rover"), (base, tight.base.antenna, "base"))
    )
    try:
        other, second = relative_ranges(
            ours, theirs, base_e, sigma_code=tight.base.code_sigma_m, sigma_carrier=float(tight.carrier_sigma_m)
        )
    except InputError:
        notes.append("no carrier on a second band in both receivers at one time: integers of one band")
        return carriers
    row = _same_rows(ranges, other.t[second.row], other.sat[second.row])
    both = with_second_band(carriers, second, row, ranges.sat)
    used = "; ".join(f"{letter} {names[0][0]}" for letter, names in signals.items())
    notes.append(f"integers of two bands are searched together: beside the ranges' own {used}")
    return both


def _same_rows(ranges: Ranges, t: FloatArray, sat: IntArray) -> IntArray:
    """Rows in use of these satellites at these times, -1 where there is none. Shape (m,)."""
    epochs = np.unique(ranges.t)
    last = len(epochs) - 1
    place = np.minimum(np.searchsorted(epochs, t), last)
    place -= np.abs(epochs[np.maximum(place - 1, 0)] - t) < np.abs(epochs[place] - t)
    key = np.searchsorted(epochs, ranges.t) * 1000 + ranges.sat
    order = np.argsort(key, kind="stable")
    at = np.minimum(np.searchsorted(key[order], place * 1000 + sat), len(key) - 1)
    row = order[at]
    present = (key[row] == place * 1000 + sat) & (np.abs(epochs[place] - t) < _SAME_EPOCH_S) & ranges.used[row]
    return np.where(present, row, -1)


def with_integers(prepared: PreparedRun, base: BaseCarriers, config: NavigationConfig) -> PreparedRun:
    """A run whose schedule also has the positions by carriers with held integers.

    Parameters
    ----------
    prepared : PreparedRun
        With its start, and with carrier phases in its schedule.
    base : BaseCarriers
    config : NavigationConfig

    Returns
    -------
    PreparedRun
        At each epoch with held integers a position with the covariance that these carriers leave, a kilometre in
        directions they do not measure; arcs of ambiguities that are states begin anew with such a phase.

    Notes
    -----
    The filter runs once to make the schedule, stopping at each epoch before its measurements: the predicted antenna and
    its covariance are the prior of the ambiguities. What is decided there is data for every run that follows. A fix
    that the innovation test rejects gives up all integers.
    """
    from schuler.filtering.kernels import run as k

    tight = config.gnss.tight
    ranges, carriers = base.ranges, base.carriers
    start, stop = prepared.increments.start, float(prepared.increments.t[-1])
    t = ranges.t[carriers.row]
    inside = (t > start + 1e-6) & (t <= stop) & ~in_windows(t, prepared.windows)
    epochs, epoch = np.unique(t[inside], return_inverse=True)
    rows = np.flatnonzero(inside)
    schedule, at = _with_places(prepared.schedule, epochs, config)
    aiding = Aiding.of(schedule)
    state = FilterState(
        prepared.initial, prepared.layout, *prepared.psd, replace(prepared.options, smoother=False),
        float(np.median(prepared.increments.dt)),
    )  # fmt: skip
    n = prepared.layout.size
    nothing = (
        TrajectoryArrays.of_size(0), RecordArrays.of_size(0, n), NodeArrays.of_size(0, 0, n, prepared.layout.n_sensor)
    )  # fmt: skip
    i = prepared.increments
    dtheta, dv, dt, times = (np.ascontiguousarray(x) for x in (i.dtheta_ib_b, i.dv_ib_b, i.dt, i.t))
    ends = np.searchsorted(i.t, epochs - 1e-9)  # the sample in which an epoch lies
    lever = np.array(config.gnss.lever_arm_m)
    phases = np.flatnonzero(schedule.kind == CARRIER_PHASE)
    # a slow error is in the prediction, too, of which it is not independent: it counts as often as it is new
    white = config.gnss.sigma_scale * tight.range_sigma_scale * carriers.sigma_code
    sigma_code = np.hypot(white, slow_sigmas(ranges, config.gnss.correlated.of_ranges)[carriers.row])
    held, gate = HeldIntegers(), gate_threshold(_gate(config.gnss.gate), 3)
    fixed, refused, first = np.zeros(len(epochs), dtype=bool), 0, 0
    for e, end in enumerate(ends.tolist()):
        if end > first:
            part = slice(first, end)
            stream = ImuStream(dtheta[part], dv[part], dt[part], times[part], False)
            k.run_filter(stream, aiding, state.arrays, state.model, state.settings, state.work, *nothing)
            first = end
        if e and aiding.status[at[e - 1]] == REJECTED:
            refused += 1
            held.forget()
        if e and any(epochs[e - 1] < b <= epochs[e] or epochs[e - 1] <= a < epochs[e] for a, b in prepared.windows):
            held.forget()
        r_e, P = _predicted(state, prepared.layout, lever, epochs[e])
        mine = rows[epoch == e] if len(epochs) < 2 else rows[np.searchsorted(epoch, e) : np.searchsorted(epoch, e + 1)]
        fix = fix_epoch(_measured(ranges, carriers, mine, r_e, sigma_code), P, held, ratio=tight.base.ratio)
        if fix is None:
            continue
        fixed[e] = float(np.diag(fix.cov).max()) < 0.1**2
        _put(fix, r_e, aiding, int(at[e]), gate)
        now = phases[np.searchsorted(schedule.t[phases], epochs[e] - 1e-9) :]
        now = now[schedule.t[now] <= epochs[e] + 1e-9]
        sats = ranges.r_sat_e[carriers.row[mine[fix.used]]]
        for j in now:
            if (sats == aiding.z[j, :3]).all(axis=1).any():
                aiding.kind[j] = ARC_START
    notes = [
        f"integers of carrier phases against the base are held at {int((aiding.gate[at] != _UNUSED).sum())} of "
        f"{len(epochs)} epochs, and fix the position at {int(fixed.sum())}"
    ]
    if held.contradicted or refused:
        notes.append(
            f"held integers were given up {held.contradicted} times by codes and carriers, {refused} times by the "
            "inertial prediction"
        )
    out = replace(schedule, kind=aiding.kind, z=aiding.z, R=aiding.R.reshape(-1, 3, 3), gate=aiding.gate)
    left = aiding.gate == _UNUSED
    starts, links = out.kind == ARC_START, out.kind == CARRIER_PHASE
    left[starts] = ~np.isin(out.z[starts, 4] + 1j * out.t[starts], out.z[links, 4] + 1j * out.z[links, 5])
    out = out.where(~left)
    return replace(prepared, schedule=out, notes=(*prepared.notes, *notes))


def _gate(value: float | str) -> float | None:
    return None if isinstance(value, str) else value


def _with_places(
    schedule: MeasurementSchedule, epochs: FloatArray, config: NavigationConfig
) -> tuple[MeasurementSchedule, IntArray]:
    """Schedule with an unused position at each epoch, behind codes and before carriers; and their places."""
    late = np.isin(schedule.kind, (CARRIER_PHASE, ARC_START))
    lever = np.array(config.gnss.lever_arm_m)
    places = MeasurementSchedule.of(POSITION, epochs, np.zeros((len(epochs), 3)), 1.0, lever, _UNUSED)
    joined = merged(schedule.where(~late), places, schedule.where(late))
    return joined, np.flatnonzero((joined.kind == POSITION) & (joined.gate == _UNUSED))


def _predicted(state: FilterState, layout: StateLayout, lever: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
    """Antenna and its covariance at a time just behind the state, before any measurement then. (3,), (3, 3)

    The state is at most a sample old, its covariance a propagation: both are carried on with the velocity.
    """
    nav, est = state.navigation, state.arrays.est
    C = rotation.dcm_from_quat(nav.q_eb)
    arm = lever.copy()
    if "lever" in layout:
        arm += est[layout["lever"].start - 9 : layout["lever"].stop - 9]
    L = C @ arm
    since = float(t - nav.t)
    age = since + float(state.arrays.acc[0])
    J = np.zeros((3, layout.size))
    J[0, 1], J[0, 2], J[1, 0], J[1, 2], J[2, 0], J[2, 1] = L[2], -L[1], -L[2], L[0], L[1], -L[0]
    J[:, 3:6], J[:, 6:9] = age * np.eye(3), np.eye(3)
    if "lever" in layout:
        J[:, layout["lever"]] = C
    return nav.r_eb_e + since * nav.v_eb_e + L, J @ state.covariance_e @ J.T


def _measured(ranges: Ranges, c: RelativeCarriers, rows: IntArray, r_e: FloatArray, sigma_code: FloatArray) -> Measured:
    """What an epoch's carriers and codes differ by from their prediction."""
    k = c.row[rows]
    distance, gradient = predicted_ranges(ranges.r_sat_e[k], r_e)
    return Measured(
        1000 * c.kind[rows] + ranges.sat[k], c.arc[rows], c.kind[rows], c.carrier[rows] - distance,
        c.code[rows] - distance, c.sigma[rows], sigma_code[rows], c.wavelength[rows], ranges.elevation[k], gradient,
    )  # fmt: skip


def _put(fix: CarrierFix, r_e: FloatArray, aiding: Aiding, j: int, gate: float) -> None:
    """Make the unused position of an epoch the one of its carriers."""
    C_en = frames.C_en(frames.llh_from_ecef(r_e))
    aiding.z[j, :3] = r_e + fix.offset
    aiding.R[j] = (C_en.T @ fix.cov @ C_en).ravel()
    aiding.gate[j] = gate
