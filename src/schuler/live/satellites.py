"""Ranges of a stream: every epoch corrected and screened as it comes, by the code for logs over the last seconds."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.gnss.coarse import epoch_medians
from schuler.gnss.ephemerides import Ephemerides, GlonassRecords, KeplerRecords, no_glonass, no_kepler
from schuler.gnss.observations import Observations, joined_observations
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges, joined_ranges
from schuler.gnss.receiver_clock import MILLISECOND
from schuler.live.decoders.base import fixes
from schuler.live.messages import Fix, SatelliteEpoch
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.satellite_noise import BEFORE, EXCLUDED, WINDOW_S, window_of
from schuler.navigation.inputs.satellites import corrected_ranges, limited, once_each, screened
from schuler.recording.satellite_positions import gnss_series

_FEWEST, _MOST = 10, 20  # epochs by which one is screened
_HELPING = 30  # epochs before these by which reflections of the newest are told
_SETTLED = 5  # epochs that show that a jump of the clock lasts, as in a log
_SMALLEST = 1.0  # jumps are of 20 m and more, the rest is rounding [m]
_RAW_S = 3.0 * WINDOW_S  # how long raw measurements are kept, to be corrected again [s]
_KEPT_S = 86_400.0  # age of the oldest broadcast message that is kept [s]


@dataclass
class Epoch:
    """One epoch of the stream.

    Attributes
    ----------
    t : float
        As stamped by the receiver. [s]
    ranges : Ranges
        Corrected, less the steps of the receiver clock that are settled; not screened.
    usable : Ranges
        Those for the filter.
    step : float
        Steps of the clock taken out of ``ranges``, whole milliseconds apart. [m]
    fix : Fix, optional
        Single-point solution.
    raw : Observations, optional
        What the ranges were corrected from, while later epochs may need it.
    """

    t: float
    ranges: Ranges
    usable: Ranges
    step: float = 0.0
    fix: Fix | None = None
    raw: Observations | None = None


class LiveSatellites:
    """Ranges of a stream as those of a log are prepared (:mod:`schuler.navigation.inputs.satellites`).

    An epoch is screened together with those of the ten seconds before it (ten epochs at least, twenty at most): faults
    in its snapshot, standard deviations by the scatter of single points, jumps of the receiver clock. A log has the
    epochs after it, too: ten seconds that are complete are corrected and screened once more, as those of a log. Orbits
    are those of the messages that came.

    Parameters
    ----------
    config : NavigationConfig
        ``gnss.tight`` and ``gnss.correlated``.
    """

    def __init__(self, config: NavigationConfig) -> None:
        self._config = config
        self.ephemerides = Ephemerides(no_kepler(), no_glonass())
        self.epochs: list[Epoch] = []  # the newest, in order of time
        self._place: FloatArray | None = None  # newest single point, for times with too few satellites [m]

    def learn(self, ephemerides: Ephemerides) -> None:
        """Take navigation messages, the newest of a kind in place of the one before."""
        e = ephemerides  # without what is computed after the fact
        new = Ephemerides(
            e.kepler, e.glonass, e.klobuchar_alpha, e.klobuchar_beta, beidou_alpha=e.beidou_alpha,
            beidou_beta=e.beidou_beta,
        )  # fmt: skip
        both = self.ephemerides.merged_with(new)
        self.ephemerides = replace(
            both.distinct(_KEPT_S),
            klobuchar_alpha=new.klobuchar_alpha or both.klobuchar_alpha,
            klobuchar_beta=new.klobuchar_beta or both.klobuchar_beta,
            beidou_alpha=new.beidou_alpha or both.beidou_alpha,
            beidou_beta=new.beidou_beta or both.beidou_beta,
        )

    def take(self, message: SatelliteEpoch) -> tuple[Epoch, list[str]]:
        """Correct and screen an epoch.

        Returns
        -------
        Epoch
        list of str
            Sentences on what was left out of it or changed.

        Raises
        ------
        InputError
            If it has no time, is of several, was there before, or cannot be corrected.
        """
        t, measured = message.t, message.measured
        if not math.isfinite(t) or np.ptp(measured.t) > 0.0:
            raise InputError("expected rows of one time" + ("" if math.isfinite(t) else ", got none"))
        at = bisect_left(self.epochs, t, key=_time)
        if at < len(self.epochs) and self.epochs[at].t == t:
            raise InputError("it came before")
        earlier = self.epochs[max(at - _MOST + 1, 0) : at]
        first = next((k for k, e in enumerate(earlier) if e.t > t - WINDOW_S), len(earlier))
        earlier = earlier[min(first, max(len(earlier) - _FEWEST + 1, 0)) :]
        step = earlier[-1].step if earlier else 0.0
        raw = measured if isinstance(measured, Observations) else None
        ranges = measured if isinstance(measured, Ranges) else self._newest_corrected(measured, earlier)
        ranges = once_each(replace(ranges, pseudorange=ranges.pseudorange - step), [])
        epoch = Epoch(t, ranges, ranges, step, None, raw)
        begin = at - len(earlier)
        before = self._before(max(begin - _HELPING, 0), begin, earlier[0].t if earlier else t)
        notes = self._screen([*earlier, epoch], before)
        self.epochs.insert(at, epoch)
        return epoch, notes

    def complete(self, newest: Epoch) -> tuple[FloatArray, Ranges | None]:
        """Correct and screen the ten seconds that an epoch completes, or comes late to, with the epochs after them.

        Parameters
        ----------
        newest : Epoch
            The one taken last.

        Returns
        -------
        times : ndarray, shape (k,)
            Of the ranges that they had for the filter; none where nothing changes. [s]
        ranges : Ranges, optional
            Those in their place.
        """
        windows = window_of(np.array([e.t for e in self.epochs]))
        at = bisect_left(self.epochs, newest.t, key=_time)
        due = windows[at] if windows[at] < windows[-1] else windows[max(at - 1, 0)]
        if due == windows[-1]:
            return np.empty(0), None
        first, stop = np.searchsorted(windows, (due, due + 1)).tolist()
        members, after = self.epochs[first:stop], self.epochs[stop : stop + _SETTLED]
        self._correct_again(members, after[0])
        begin = max(first - _FEWEST, 0)
        epochs = self.epochs[begin : stop + _SETTLED]
        before = self._before(0, begin, due * WINDOW_S)
        out, _ = screened(joined_ranges([e.ranges for e in epochs]), self._config, [], before=before)
        of = np.repeat(np.arange(len(epochs)), [len(e.ranges) for e in epochs])
        section, times = self._config.gnss.tight, [e.usable.t for e in members]
        for k, epoch in enumerate(members, first - begin):
            epoch.usable = limited(out.where(of == k), section.min_satellites, section.max_satellites)
        usable = [e.usable for e in members if len(e.usable)]
        return np.unique(np.concatenate(times)), joined_ranges(usable) if usable else None

    def ranges(self, since: float = -math.inf, *, usable: bool = False) -> Ranges | None:
        """Ranges of the epochs that are kept, as a log of them; None without any. [s]"""
        parts = [e.usable if usable else e.ranges for e in self.epochs if e.t >= since]
        parts = [part for part in parts if len(part)]
        return joined_ranges(parts) if parts else None

    def forget(self, t: float) -> None:
        """Drop epochs before a time, but for those by which the next are screened. [s]"""
        older = max(len(self.epochs) - _MOST, 0)
        complete = bisect_left(self.epochs, self.epochs[-1].t - _RAW_S, key=_time) if self.epochs else 0
        for epoch in self.epochs[: min(complete, older)]:
            epoch.raw = None
        del self.epochs[: min(bisect_left(self.epochs, t - (BEFORE + 2.1) * WINDOW_S, key=_time), older)]

    def document(self) -> dict[str, Any]:
        """What goes on from one epoch to the next, for files."""
        e = self.ephemerides
        return {
            "kepler": _plain(e.kepler), "glonass": _plain(e.glonass),
            "klobuchar": None if e.klobuchar_alpha is None else [*e.klobuchar_alpha, *(e.klobuchar_beta or ())],
            "beidou": None if e.beidou_alpha is None else [*e.beidou_alpha, *(e.beidou_beta or ())],
            "place": self._place,
            "epochs": [
                {
                    "t": x.t, "step": x.step, "ranges": _plain(x.ranges), "usable": _plain(x.usable),
                    "fix": None if x.fix is None else _plain(x.fix), "raw": None if x.raw is None else _plain(x.raw),
                }
                for x in self.epochs
            ],
        }  # fmt: skip

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from a :meth:`document`."""
        k, c = document["klobuchar"], document.get("beidou")
        self.ephemerides = Ephemerides(
            KeplerRecords(**document["kepler"]), GlonassRecords(**document["glonass"]),
            None if k is None else tuple(k[:4]), tuple(k[4:]) if k and len(k) == 8 else None,
            beidou_alpha=None if c is None else tuple(c[:4]),
            beidou_beta=tuple(c[4:]) if c and len(c) == 8 else None,
        )  # fmt: skip
        self._place = document["place"]
        self.epochs = [
            Epoch(
                x["t"], _ranges(x["ranges"]), _ranges(x["usable"]), x["step"],
                None if x["fix"] is None else Fix(**x["fix"]), None if x["raw"] is None else _observations(x["raw"]),
            )
            for x in document["epochs"]
        ]  # fmt: skip

    def _newest_corrected(self, raw: Observations, earlier: list[Epoch]) -> Ranges:
        """Ranges of raw measurements, with the receiver clock as continuous as in the epochs before."""
        if not (np.isfinite(raw.pseudorange) | np.isfinite(raw.range_rate)).any():
            raise InputError("it has neither pseudoranges nor Doppler shifts")
        before = [e for e in earlier if e.raw is not None and e.raw.epoch_gps_s == raw.epoch_gps_s]
        raws = [*(e.raw for e in before if e.raw is not None), raw]
        ranges = self._corrected(raws, before[0] if before else None)
        return ranges.where(ranges.t == ranges.t[-1])

    def _correct_again(self, epochs: list[Epoch], following: Epoch) -> None:
        """Correct consecutive epochs by the places and ephemerides that there are now."""
        raws = [e.raw for e in (*epochs, following) if e.raw is not None]
        if len(raws) <= len(epochs) or len({raw.epoch_gps_s for raw in raws}) > 1:
            return
        ranges = self._corrected(raws, epochs[0])
        times = np.unique(ranges.t)
        if len(times) != len(raws):
            return
        for epoch, t in zip(epochs, times, strict=False):
            own = ranges.where(ranges.t == t)
            epoch.ranges = once_each(replace(own, pseudorange=own.pseudorange - epoch.step), [])

    def _corrected(self, raws: list[Observations], reference: Epoch | None) -> Ranges:
        """Ranges of consecutive epochs, with the receiver clock as the first of them, the reference, had it before."""
        section, observations = self._config.gnss.tight, joined_observations(raws)
        ranges = corrected_ranges(observations, self.ephemerides, section, causal=True)
        if self._place is not None and not np.isfinite(ranges.elevation).any():
            ranges = corrected_ranges(observations, self.ephemerides, section, causal=True, position_e=self._place)
        if reference is None:
            return ranges
        # steps of whole milliseconds are taken out from the first of these epochs on, which had some before
        first = ranges.where(ranges.t == ranges.t[0])
        _, i, j = np.intersect1d(first.sat, reference.ranges.sat, return_indices=True)
        moved = first.pseudorange[i] - reference.ranges.pseudorange[j] - reference.step
        moved = moved[np.isfinite(moved)]
        taken_out = MILLISECOND * np.round(np.median(moved) / MILLISECOND) if len(moved) else 0.0
        return replace(ranges, pseudorange=ranges.pseudorange - taken_out)

    def _before(self, first: int, stop: int, t: float) -> Ranges | None:
        """Ranges of some epochs, those by which reflections in a window that begins at ``t`` are told. [s]"""
        parts = [e.ranges for e in self.epochs[first:stop] if e.t > t - (BEFORE + 0.1) * WINDOW_S and len(e.ranges)]
        return joined_ranges(parts) if parts else None

    def _screen(self, epochs: list[Epoch], before: Ranges | None) -> list[str]:
        """Screen the last of some consecutive epochs, after others; sentences on it."""
        joined = joined_ranges([e.ranges for e in epochs])
        out, solution = screened(joined, self._config, [], float(joined.t[0]), before)
        of = np.repeat(np.arange(len(epochs)), [len(e.ranges) for e in epochs])
        epoch, section = epochs[-1], self._config.gnss.tight
        last = out.where(of == len(epochs) - 1)
        epoch.usable = limited(last, section.min_satellites, section.max_satellites)
        epoch.fix = self._fix(solution, float(last.t[-1]))
        moved = epoch_medians(of, joined.pseudorange - out.pseudorange, len(epochs))
        notes = self._settle(epochs, np.nan_to_num(moved))
        if count := int(np.sum(last.reason == EXCLUDED)):
            notes.append(f"{count} ranges of {epoch.t:.3f} s were excluded by fault detection among its satellites")
        return notes

    def _settle(self, epochs: list[Epoch], moved: FloatArray) -> list[str]:
        """Take jumps of the clock that last out of the epochs for good; ``moved`` is what they are, by epoch. [m]"""
        k = len(epochs) - _SETTLED
        if k < 1 or abs(jump := float(moved[k] - moved[0])) < _SMALLEST:
            return []
        first = int(np.flatnonzero(np.abs(moved - moved[k]) < _SMALLEST)[0])
        for epoch in epochs[first:]:
            epoch.ranges = replace(epoch.ranges, pseudorange=epoch.ranges.pseudorange - jump)
            epoch.step += jump
        return [f"the receiver clock jumped by {jump:+.1f} m at {epochs[first].t:.3f} s: taken out"]

    def _fix(self, solution: PointSolution, t: float) -> Fix | None:
        """Single point of the newest epoch, if it has one."""
        if not solution.ok[-1]:
            return None
        self._place = solution.r_e[-1].copy()
        return next((fix for fix in fixes(gnss_series(solution)) if fix.t == t), None)


def _time(epoch: Epoch) -> float:
    return epoch.t


def _plain(x: Any) -> dict[str, Any]:
    """Fields of a dataclass, for files."""
    values = {f.name: getattr(x, f.name) for f in fields(x)}
    return {
        name: [list(pair) for pair in value.items()] if isinstance(value, dict)
        else list(value) if isinstance(value, tuple) else value
        for name, value in values.items() if name != "notes"
    }  # fmt: skip


def _ranges(document: dict[str, Any]) -> Ranges:
    return Ranges(**{**document, "groups": tuple(document["groups"])})


def _observations(document: dict[str, Any]) -> Observations:
    places = {
        name: None if document[name] is None else tuple(document[name])
        for name in ("position_e", "station_e", "eccentricity_n")
    }
    return Observations(
        **{
            **document, **places, "signals": tuple(document["signals"]),
            "glonass_channels": {int(sat): int(channel) for sat, channel in document["glonass_channels"]},
        }
    )  # fmt: skip
