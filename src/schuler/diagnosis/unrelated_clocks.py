"""Files without a common clock: the meaning of the IMU's stamps with which it moves as GNSS does."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import earth, timebase
from schuler.diagnosis import heights, positions
from schuler.diagnosis.lag import Lag, find_lag
from schuler.diagnosis.motion import Motion, WindowMeans, motion_of
from schuler.diagnosis.result import Finding
from schuler.exceptions import SchulerError
from schuler.recording.recording import Recording

_OVERLAP_S = 20.0
_PLAUSIBLE_S = 60.0  # a clock whose meaning is right is not off by more


@dataclass(frozen=True)
class _Meaning:
    """Possible meaning of the IMU's stamps: in words, as an option, and the shift to the other clock. [s]"""

    words: str
    option: str
    shift: float


def relate_clocks(recording: Recording, alone: Recording) -> tuple[Recording, Finding] | None:
    """Both on one clock, if the motion in both tells it, and the finding ``clock_unknown`` with the option.

    Parameters
    ----------
    recording : Recording
        On a known clock, with a GNSS solution or what it takes to compute one.
    alone : Recording
        IMU on a clock of its own.

    Returns
    -------
    (Recording, Finding), optional
        None if no meaning of the stamps makes the IMU explain the motion.
    """
    motion = _motion(recording)
    if motion is None or not motion.enough or alone.imu is None or len(alone.imu) < 100:
        return None
    means = WindowMeans(alone.imu)
    for meaning in _meanings(recording, alone, motion):
        lag = find_lag(means, motion, meaning.shift)
        off = lag.offset - meaning.shift
        if not lag.matched or (meaning.option and abs(off) > _PLAUSIBLE_S):
            continue
        shift = meaning.shift if meaning.option else lag.offset
        option = meaning.option or _by_offset(recording, lag.offset)
        text = (
            f"nothing says what the IMU's stamps ({alone.imu.t[0]:.1f}..{alone.imu.t[-1]:.1f} s of its own clock) "
            f"mean beside those of GNSS; {_sentence(meaning, lag, off)}. It was judged on that clock"
        )
        evidence = {"shift_s": shift, "offset_s": lag.offset, "sigma_s": lag.sigma, "explained": lag.r2.tolist()}
        finding = Finding("clock_unknown", "error", text, 0.99, f"{option} for the IMU", evidence)
        imu = alone.imu.shifted(shift)
        metadata = replace(recording.metadata, notes=(*recording.metadata.notes, *alone.metadata.notes))
        return replace(recording, imu=imu, metadata=replace(metadata, axes=alone.metadata.axes)), finding
    return None


def unknown_clock(recording: Recording, alone: Recording) -> Finding:
    """The question about the clock, where motion does not answer it.

    Parameters
    ----------
    recording, alone : Recording
        See :func:`relate_clocks`.
    """
    assert alone.imu is not None
    motion = _motion(recording)
    guesses = [m for m in _meanings(recording, alone, motion) if m.option]
    text = (
        f"nothing says what the IMU's stamps ({alone.imu.t[0]:.1f}..{alone.imu.t[-1]:.1f} s of its own clock) mean "
        "beside those of GNSS, and no motion common to both tells: each was judged by itself"
    )
    if guesses:
        text += f"; as {guesses[0].words} they would overlap"
    fix = f"{guesses[0].option if guesses else 'time=...'} for the IMU (gps-tow:WEEK, gps, unix, ...)"
    return Finding(
        "clock_unknown", "error", text, 0.99, fix, {"imu_s": [float(alone.imu.t[0]), float(alone.imu.t[-1])]}
    )


def _motion(recording: Recording) -> Motion | None:
    gnss = recording.gnss
    if gnss is None:
        gnss = heights.single_points(recording)
    if gnss is None or len(gnss) < 20:
        return None
    view = positions.check_positions(gnss)[1]
    h = float(np.clip(np.median(gnss.llh[:, 2]), -1000.0, 50_000.0))
    return motion_of(view.t, view.v_n, float(earth.gravity_somigliana(float(np.median(gnss.llh[:, 0])), h)))


def _meanings(recording: Recording, alone: Recording, motion: Motion | None) -> list[_Meaning]:
    """Meanings under which the two overlap, the likely ones first; last that both begin together."""
    assert alone.imu is not None
    epoch = recording.metadata.time.epoch_gps_s
    start = motion.t[0] if motion is not None else recording.start
    stop = motion.t[-1] if motion is not None else recording.stop
    t = alone.imu.t
    week, _ = timebase.week_tow(epoch + start)
    out = [
        _Meaning(f"seconds of GPS week {week}", f"time='gps-tow:{week}'", week * timebase.WEEK_S - epoch),
        _Meaning("GPS seconds since 1980", "time='gps'", -epoch),
    ]
    try:
        with timebase.leap_second_notes():  # a possibility, of which nothing is said
            leap = timebase.leap_seconds(timebase.calendar(epoch + start).date())
        out.append(_Meaning("Unix time", "time='unix'", leap - timebase.UNIX_TO_GPS_S - epoch))
    except (SchulerError, OverflowError):
        pass
    overlapping = [m for m in out if min(t[-1] + m.shift, stop) - max(t[0] + m.shift, start) > _OVERLAP_S]
    if motion is not None:
        overlapping.append(_Meaning("seconds since the start", "", float(start - t[0])))
    return overlapping


def _by_offset(recording: Recording, shift: float) -> str:
    """Option that brings a counter to GPS time."""
    gps = recording.metadata.time.epoch_gps_s + shift
    week, tow = timebase.week_tow(gps)
    return f"time='gps-tow:{week}', offset={tow:.3f}"


def _sentence(meaning: _Meaning, lag: Lag, off: float) -> str:
    same = f"the same motion is in both (the IMU explains {100.0 * lag.r2.max():.0f} % of it)"
    if meaning.option:
        return f"as {meaning.words} {same}, {off:+.3f} s apart (1-sigma {lag.sigma:.3f} s)"
    return f"{same} if {lag.offset:.3f} s are added (1-sigma {lag.sigma:.3f} s)"
