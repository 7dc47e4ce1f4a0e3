"""A recording: the series of one run with what must be known to use them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import units
from schuler.arrays import ArrayLike
from schuler.exceptions import InputError, printable
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.plotting.notebook import Displayed
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import SAME_TIME, TimeBase

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Parts of a recording that have times.
TIMED = ("imu", "gnss", "odometer", "heading", "height", "observations", "ranges", "reference")


@dataclass(frozen=True)
class Metadata:
    """Origin of a recording, its time base, and notes on every conversion.

    Attributes
    ----------
    name : str
        Short name for titles.
    time : TimeBase
        Meaning of zero seconds.
    sources : dict
        File name to SHA-256 of each file read.
    axes : str
        Axes of the original log (the series themselves are always forward-right-down).
    notes : tuple of str
        Sentences on every conversion, repair and assumption, in order.
    options : dict
        Reader options or scenario, for provenance.
    """

    name: str = "recording"
    time: TimeBase = field(default_factory=TimeBase)
    sources: dict[str, str] = field(default_factory=dict)
    axes: str = "FRD"
    notes: tuple[str, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # names of topics, units and devices come from files, and are printed
        object.__setattr__(self, "name", printable(self.name))
        object.__setattr__(self, "notes", tuple(printable(note) for note in self.notes))

    def noting(self, *sentences: str) -> Metadata:
        """The same metadata with more notes."""
        return replace(self, notes=self.notes + sentences)


@dataclass(frozen=True, repr=False)
class Recording(Displayed):
    """IMU, and where there are any GNSS, odometer and reference series on one time axis.

    Attributes
    ----------
    imu : ImuSeries, optional
    gnss : GnssSeries, optional
    odometer : OdometerSeries, optional
    heading, height : ScalarSeries, optional
        Heading of a magnetometer or two antennas [rad]; height of a barometer [m].
    observations : Observations, optional
        Raw measurements of a satellite receiver.
    ephemerides : Ephemerides, optional
        Broadcast messages, for the observations.
    ranges : Ranges, optional
        Ranges ready for positioning, where they do not come from observations (simulation, other programs).
    reference : Trajectory, optional
        Truth or a better solution to compare with, of the IMU's position.
    metadata : Metadata
    """

    imu: ImuSeries | None = None
    gnss: GnssSeries | None = None
    odometer: OdometerSeries | None = None
    reference: Trajectory | None = None
    metadata: Metadata = field(default_factory=Metadata)
    heading: ScalarSeries | None = None
    height: ScalarSeries | None = None
    observations: Observations | None = None
    ephemerides: Ephemerides | None = None
    ranges: Ranges | None = None

    def __post_init__(self) -> None:
        if not self._series() and self.ephemerides is None:
            raise InputError("a recording needs at least one series")

    @property
    def start(self) -> float:
        """Earliest time of any series. [s]"""
        return min(float(s.t[0]) for s in self._need_series())

    @property
    def stop(self) -> float:
        """Latest time of any series. [s]"""
        return max(float(s.t[-1]) for s in self._need_series())

    def _need_series(self) -> list[Any]:
        series = self._series()
        if not series:
            raise InputError(f"{self.metadata.name} holds orbits of satellites only, which have no start and end")
        return series

    def _series(self) -> list[Any]:
        """Whatever is there and has times."""
        return [s for s in (getattr(self, name) for name in TIMED) if s is not None and len(s)]

    def need_imu(self) -> ImuSeries:
        """The IMU series, or an error that says it is missing."""
        if self.imu is None:
            raise InputError(f"{self.metadata.name} has no IMU series, which is needed here")
        return self.imu

    def need_gnss(self) -> GnssSeries:
        """The GNSS series, or an error that says it is missing."""
        if self.gnss is None:
            raise InputError(f"{self.metadata.name} has no GNSS series, which is needed here")
        return self.gnss

    def need_reference(self) -> Trajectory:
        """The reference trajectory, or an error that says it is missing."""
        if self.reference is None:
            raise InputError(f"{self.metadata.name} has no reference trajectory, which is needed here")
        return self.reference

    def merged_with(self, other: Recording) -> Recording:
        """The same recording with the series of another that it lacks, brought to one time axis.

        Raises
        ------
        InputError
            If both have the same series, or their clocks cannot be related.
        """
        both = [n for n in TIMED if getattr(self, n) is not None and getattr(other, n) is not None]
        if both:
            raise InputError(f"{self.metadata.name} and {other.metadata.name} both have: {', '.join(both)}")
        mine, theirs = self.metadata.time, other.metadata.time
        if mine.scale != theirs.scale:
            raise InputError(
                f"{self.metadata.name} runs on {mine.scale} time, {other.metadata.name} on {theirs.scale} time; "
                "say what the stamps of the local one mean (option time)"
            )
        notes: tuple[str, ...] = ()
        if mine.scale == "local":
            notes = (f"{self.metadata.name} and {other.metadata.name} are taken to run on one clock of unknown epoch.",)
        other = other.shifted(theirs.epoch_gps_s - mine.epoch_gps_s)
        metadata = replace(
            self.metadata,
            sources={**self.metadata.sources, **other.metadata.sources},
            notes=tuple(dict.fromkeys(self.metadata.notes + other.metadata.notes + notes)),  # one file, two series
            options={**self.metadata.options, **other.metadata.options},
        )
        series = {n: getattr(other if getattr(self, n) is None else self, n) for n in TIMED}
        return Recording(
            **series,
            ephemerides=(
                self.ephemerides.merged_with(other.ephemerides)
                if self.ephemerides is not None and other.ephemerides is not None
                else self.ephemerides or other.ephemerides
            ),
            metadata=metadata,
        )

    def shifted(self, seconds: float) -> Recording:
        """The recording with ``seconds`` added to every time stamp and taken off its epoch."""
        if seconds == 0.0:
            return self
        moved: dict[str, Any] = {
            name: None if series is None else replace(series, t=series.t + seconds)
            for name, series in ((n, getattr(self, n)) for n in TIMED if n != "reference")
        }
        if self.observations is not None:
            moved["observations"] = replace(moved["observations"], epoch_gps_s=self.observations.epoch_gps_s - seconds)
        gnss = moved["gnss"]
        if isinstance(gnss, GnssSeries) and gnss.received is not None:
            moved["gnss"] = replace(gnss, received=gnss.received + seconds)
        reference = None
        if self.reference is not None:
            r = self.reference
            reference = Trajectory(r.t + seconds, r.r_eb_e, r.v_eb_e, r.q_eb)
        time = replace(self.metadata.time, epoch_gps_s=self.metadata.time.epoch_gps_s - seconds)
        metadata = replace(self.metadata, time=time)
        return Recording(**moved, reference=reference, ephemerides=self.ephemerides, metadata=metadata)

    def between(self, start: float, stop: float) -> Recording:
        """The recording with the samples of ``start <= t <= stop``. [s]

        A reference keeps one more sample on either side, since it is interpolated; a series without a sample there is
        left out, with a note; broadcast messages are all kept.

        Raises
        ------
        InputError
            If the IMU, or where there is none every series, has no sample there.
        """
        parts = {name: series for name in TIMED if (series := getattr(self, name)) is not None}
        inside = {name: _between(series, start, stop) for name, series in parts.items()}
        if not any(series is not None for series in inside.values()):
            span = f"it runs {self.start:.3f}..{self.stop:.3f} s"
            raise InputError(f"{self.metadata.name} has no sample within {start:.3f}..{stop:.3f} s; {span}")
        empty = [f"{name}: no sample within {start:.3f}..{stop:.3f} s" for name, part in inside.items() if part is None]
        return replace(self, **inside, metadata=self.metadata.noting(*empty))

    def rotated(self, C_bs: ArrayLike, note: str) -> Recording:
        """The recording with its IMU in other axes (see :meth:`ImuSeries.rotated`), and a note that says so."""
        return replace(self, imu=self.need_imu().rotated(C_bs), metadata=self.metadata.noting(note))

    def plot(self, **options: Any) -> Figure:
        """Specific force, angular rate, speed and height over time (matplotlib), see
        :func:`schuler.recording.figures.log_figure`.
        """
        from schuler.recording.figures import log_figure

        return log_figure(self, **options)

    def _headline(self) -> str:
        parts = [name for name in TIMED if getattr(self, name) is not None]
        parts += ["ephemerides"] if self.ephemerides is not None else []
        span = f"{self.stop - self.start:.1f} s of " if self._series() else ""
        return f"{self.metadata.name}, {span}{', '.join(parts)}"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        rows = []
        for name in TIMED:
            series = getattr(self, name)
            if series is not None and len(series):
                t = np.unique(series.t)
                rate = f"{1.0 / float(np.median(np.diff(t))):.4g}" if len(t) > 1 else "-"
                rows.append((name, str(len(series)), f"{t[0]:.3f}", f"{t[-1]:.3f}", rate))
        return ("series", "samples", "from [s]", "to [s]", "rate [Hz]"), rows

    def summary(self, *, notes: bool = True) -> str:
        """Contents of the recording in a few lines of text; without its notes where a result prints them."""
        span = f"{self.stop - self.start:.1f} s" if self._series() else "orbits of satellites only"
        lines = [f"{self.metadata.name}: {span}, {self.metadata.time.describe()}"]
        if self.imu is not None:
            imu, gaps = self.imu, self.imu.gaps()
            f, w = imu.magnitudes()
            lines.append(
                f"  IMU   {len(imu)} samples at {imu.rate_hz:.4g} Hz ({imu.kind}), {imu.t[0]:.3f}..{imu.t[-1]:.3f} s"
            )
            lines.append(
                f"        specific force {np.median(f):.3f} m/s^2 (median), angular rate up to "
                f"{w.max() / units.DEG:.1f} deg/s, {len(gaps)} gaps"
                + (f", the longest {gaps[:, 1].max():.3f} s" if len(gaps) else "")
            )
        if self.imu is not None and (m := self.imu.magnetometer) is not None:
            lines.append(f"        magnetometer {np.median(np.linalg.norm(m, axis=1)) / units.UT:.4g} uT (median)")
        if self.gnss is not None:
            sigma = np.sqrt(np.einsum("nii->ni", self.gnss.cov_r_n))
            lines.append(
                f"  GNSS  {len(self.gnss)} epochs, {self.gnss.t[0]:.3f}..{self.gnss.t[-1]:.3f} s, 1-sigma "
                f"{np.median(np.hypot(sigma[:, 0], sigma[:, 1])):.3f} m horizontal, "
                f"{np.median(sigma[:, 2]):.3f} m vertical" + ("" if self.gnss.v_n is not None else "; no velocity")
            )
            view = [] if self.gnss.n_satellites is None else [f"{np.median(self.gnss.n_satellites):.0f} satellites"]
            view += [f"{name} {value:.2g}" for name, value in self.gnss.median_dop().items()]
            if view:
                lines.append(f"        {', '.join(view)} (median)")
        if self.odometer is not None:
            lines.append(
                f"  odometer   {len(self.odometer)} samples, up to {np.abs(self.odometer.speed).max():.1f} m/s"
            )
        if self.heading is not None:
            lines.append(f"  heading    {len(self.heading)} samples")
        if self.height is not None:
            lines.append(f"  height     {len(self.height)} samples")
        if self.observations is not None:
            lines.append(f"  satellites {self.observations.summary()}")
        if self.ephemerides is not None:
            lines.append(
                f"  broadcast  {len(self.ephemerides.kepler)} Keplerian and {len(self.ephemerides.glonass)} GLONASS "
                "messages"
            )
            for name, table in (
                ("orbits", self.ephemerides.precise_orbits), ("clocks", self.ephemerides.precise_clocks),
            ):  # fmt: skip
                if table is not None:
                    lines.append(f"  precise    {name} of {len(table.sat)} satellites at {len(table.t)} epochs")
        if self.ranges is not None:
            lines.append(f"  ranges     {len(self.ranges)} of {len(np.unique(self.ranges.sat))} satellites")
        if self.reference is not None:
            lines.append(f"  reference  {len(self.reference)} samples")
        lines += [f"  - {note}" for note in self.metadata.notes if notes]
        return "\n".join(lines)


def _between(series: Any, start: float, stop: float) -> Any:
    """The samples of a series between two times, None without any; of a reference one more on either side."""
    if isinstance(series, ImuSeries):
        return series.between(start, stop)
    keep = (series.t >= start - SAME_TIME) & (series.t <= stop + SAME_TIME)
    if isinstance(series, Trajectory):
        first, last = int(np.searchsorted(series.t, start, side="right")) - 1, int(np.searchsorted(series.t, stop))
        k = np.arange(max(first, 0), min(last + 1, len(series.t)))
        overlap = series.t[0] <= stop and series.t[-1] >= start
        return series.samples(k) if overlap and len(k) else None
    if not keep.any():
        return None
    columns = {f.name: getattr(series, f.name) for f in fields(series)}
    return replace(
        series, **{n: v[keep] for n, v in columns.items() if isinstance(v, np.ndarray) and len(v) == len(keep)}
    )
