"""SIMULATION ONLY: deep against tight coupling while signals fade, and the thresholds of conventional loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.deep.loops import ScalarLoops, track
from schuler.reproduce.stefanisko.study.deep.runs import ArchitectureRun, DeepOptions, deep_run, tight_run
from schuler.reproduce.stefanisko.study.deep.scene import DeepScene, calm, deep_scene, draw, signal_strength
from schuler.simulation.motion import Motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ARCHITECTURES = ("deep", "tight")
_SPOKEN = "SIMULATION ONLY: no receiver, no signal samples; ranges contain geometry, clock and thermal noise"


@dataclass(frozen=True)
class LevelRow:
    """One architecture at one C/N0, over all runs.

    Attributes
    ----------
    level_dbhz : float
        During the fade. [dB-Hz]
    architecture : str
    runs : int
    tracked : float
        Part of the channels, those that fade, that tracked all through the fade.
    largest, largest_after : float
        Root mean square over the runs of the largest horizontal error in the fade, and from 2 s after it on. [m]
    end, sigma : float
        Root mean square horizontal error at the end of the fade, and the mean 1-sigma claimed for it. [m]
    nees : float
        Mean normalised squared error per state in the fade.
    accepted : float
        Part of the measurements accepted.
    """

    level_dbhz: float
    architecture: str
    runs: int
    tracked: float
    largest: float
    largest_after: float
    end: float
    sigma: float
    nees: float
    accepted: float


@dataclass(frozen=True)
class DeepStudy:
    """SIMULATION ONLY. What became of both architectures when signals faded.

    Attributes
    ----------
    motion : str
    satellites, fading : int
        In view, and how many of them fade.
    seconds : float
    window : (start, stop)
        Start and end of the fade. [s]
    strong_dbhz : float
        Outside of it. [dB-Hz]
    runs : dict of (level, architecture) to tuple of ArchitectureRun
    options : DeepOptions
    loops : ScalarLoops
    seed : int
    complete : bool
        False if interrupted: what was done until then is here.
    """

    motion: str
    satellites: int
    fading: int
    seconds: float
    window: tuple[float, float]
    strong_dbhz: float
    runs: dict[tuple[float, str], tuple[ArchitectureRun, ...]]
    options: DeepOptions
    loops: ScalarLoops
    seed: int
    complete: bool = True

    @property
    def levels(self) -> list[float]:
        """Levels of the fade, from strong to weak. [dB-Hz]"""
        return sorted({level for level, _ in self.runs}, reverse=True)

    def rows(self) -> list[LevelRow]:
        """The table: both architectures at each level."""
        return [self._row(level, name) for level in self.levels for name in ARCHITECTURES]

    def threshold(self, architecture: str, share: float = 0.9) -> float:
        """Lowest level down to which the given part of the fading channels tracks; inf if it does at none. [dB-Hz]"""
        if architecture not in ARCHITECTURES:
            raise InputError(f"architecture: expected deep or tight, got {architecture!r}")
        lowest = np.inf
        for level in self.levels:
            if self._row(level, architecture).tracked < share:
                break
            lowest = level
        return float(lowest)

    def _row(self, level: float, name: str) -> LevelRow:
        runs = self.runs[level, name]
        start, stop = self.window
        last = [int(np.argmin(np.abs(r.t - stop))) for r in runs]
        during = [(r.t >= start) & (r.t <= stop) for r in runs]
        inside = [(r.channel_t >= start) & (r.channel_t <= stop) for r in runs]
        on = [r.on_signal[i, : self.fading] for r, i in zip(runs, inside, strict=True)]
        return LevelRow(
            level, name, len(runs),
            float(np.mean([x.all(axis=0).mean() for x in on])),
            _rms([r.largest(start, stop) for r in runs]),
            _rms([r.largest(stop + 2.0, self.seconds) for r in runs]),
            _rms([r.horizontal[k] for r, k in zip(runs, last, strict=True)]),
            float(np.mean([np.hypot(*r.sigma_n[k, :2]) for r, k in zip(runs, last, strict=True)])),
            float(np.mean([r.nees[d].mean() for r, d in zip(runs, during, strict=True)])),
            float(np.mean([r.accepted for r in runs])),
        )  # fmt: skip

    def summary(self) -> str:
        """The study in a few lines of text."""
        start, stop = self.window
        lines = [
            f"Deep coupling study ({_SPOKEN})",
            f"  {self.motion}, {self.seconds:g} s, {self.satellites} satellites at {self.strong_dbhz:g} dB-Hz, "
            f"{self.fading} of them weaker from {start:g} to {stop:g} s",
            f"  deep: vector loop through the filter, update every {self.options.update:g} s; "
            f"tight: conventional loops, code {self.loops.code_bandwidth:g} Hz, "
            f"frequency {self.loops.frequency_bandwidth:g} Hz",
            "  C/N0    architecture  tracked  largest error  after it  at the end  1-sigma  NEES  accepted  runs",
            "  dB-Hz                  share              m         m           m        m                    ",
        ]
        lines += [
            f"  {r.level_dbhz:5.1f}   {r.architecture:12s}  {r.tracked:7.2f}  {r.largest:13.2f}  {r.largest_after:8.2f}"
            f"  {r.end:10.2f}  {r.sigma:7.2f}  {r.nees:4.2f}  {r.accepted:8.3f}  {r.runs:4d}"
            for r in self.rows()
        ]
        for name in ARCHITECTURES:
            low = self.threshold(name)
            limit = f"down to {low:g} dB-Hz" if np.isfinite(low) else "at no level of this study"
            lines.append(f"  {name}: nine channels in ten track {limit}")
        if not self.complete:
            lines.append("  interrupted: the runs done until then")
        return "\n".join(lines)

    def plot(self, level_dbhz: float | None = None) -> Figure:
        """Errors, replicas and shares tracked (matplotlib), see
        :func:`schuler.reproduce.stefanisko.study.deep.figures.overview`.
        """
        from schuler.reproduce.stefanisko.study.deep.figures import overview

        return overview(self, level_dbhz)


def deep_study(
    motion: Callable[[float], Motion] = calm,
    levels_dbhz: Sequence[float] = (30.0, 25.0, 20.0, 15.0),
    *,
    runs: int = 4,
    seconds: float = 45.0,
    window: tuple[float, float] = (15.0, 35.0),
    satellites: int = 8,
    fading: int | None = None,
    strong_dbhz: float = 45.0,
    options: DeepOptions | None = None,
    loops: ScalarLoops | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> DeepStudy:
    """SIMULATION ONLY. Both architectures through the same fades.

    Parameters
    ----------
    motion : callable
        Such as :func:`schuler.reproduce.stefanisko.study.deep.scene.calm` or ``agile``.
    levels_dbhz : sequence of float
        C/N0 in the fade, one campaign each. [dB-Hz]
    runs : int
        Realisations of IMU, clock, initial errors and noise; the same worlds for both architectures and all levels.
    seconds : float
    window : (start, stop)
        [s]
    satellites : int
    fading : int, optional
        How many of them fade; all if left out.
    strong_dbhz : float
    options : DeepOptions, optional
    loops : ScalarLoops, optional
        Default: code 1 Hz, frequency 5 Hz, their budget told the root mean square jerk of this motion.
    seed : int
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    DeepStudy
        On Ctrl-C what was done until then; about 1.2 s for each run of 45 s and level.
    """
    if runs < 1 or not levels_dbhz:
        raise InputError(f"expected at least one run and one level, got {runs} and {len(levels_dbhz)}")
    if not 0.0 <= window[0] < window[1] <= seconds - 2.5:
        raise InputError(f"window: expected it to end 2.5 s before the end at {seconds:g} s, got {window}")
    scene = deep_scene(motion, seconds, satellites=satellites)
    fade = satellites if fading is None else fading
    deep, scalar = options or DeepOptions(), loops or ScalarLoops(jerk=scene.jerk)
    done: dict[tuple[float, str], tuple[ArchitectureRun, ...]] = {}
    complete, total = True, runs * len(levels_dbhz)
    try:
        for i, level in enumerate(float(x) for x in levels_dbhz):
            cn0 = signal_strength(scene, level, window, strong_dbhz=strong_dbhz, satellites=fade)
            for k in range(runs):
                world = draw(scene, np.random.default_rng([seed, k, 0]))
                pair = (
                    deep_run(world, cn0, np.random.default_rng([seed, k, 1]), deep),
                    tight_run(world, cn0, np.random.default_rng([seed, k, 2]), scalar),
                )
                for one in pair:
                    done[level, one.architecture] = (*done.get((level, one.architecture), ()), one)
                if progress is not None:
                    progress((i * runs + k + 1) / total)
    except KeyboardInterrupt:
        if not done:
            raise
        complete = False
    return DeepStudy(
        getattr(motion, "__name__", "motion"), satellites, fade, seconds, window, strong_dbhz, done, deep, scalar, seed,
        complete,
    )  # fmt: skip


def loop_shares(
    scene: DeepScene,
    bandwidths: Sequence[float],
    levels_dbhz: Sequence[float],
    rng: np.random.Generator,
    *,
    window: tuple[float, float] = (5.0, 25.0),
    runs: int = 8,
    loops: ScalarLoops | None = None,
) -> FloatArray:
    """Part of conventional channels that track all through a fade, by frequency-loop bandwidth and C/N0.

    Parameters
    ----------
    scene : DeepScene
    bandwidths : sequence of float, length b
        One-sided noise bandwidths of the frequency loop. [Hz]
    levels_dbhz : sequence of float, length c
        [dB-Hz]
    rng : numpy.random.Generator
    window : (start, stop)
        [s]
    runs : int
        Channels of each satellite.
    loops : ScalarLoops, optional

    Returns
    -------
    ndarray, shape (b, c)
        Wide loops lose weak signals, narrow ones lose signals that move: without aiding there is no bandwidth for both.
    """
    if window[1] > scene.t[-1] or runs < 1:
        raise InputError(f"window: expected it within {scene.t[-1]:g} s and at least one run, got {window}, {runs}")
    signals = [signal_strength(scene, level, window) for level in levels_dbhz]
    cn0 = np.stack(signals, axis=-1)[..., None].repeat(runs, axis=-1)  # bits, satellites, levels, runs
    ranges, rates = (
        np.broadcast_to(x[:, :, None, None], (len(scene.t), *cn0.shape[1:])) for x in (scene.range, scene.rate)
    )
    inside = (scene.t[2::2] >= window[0]) & (scene.t[2::2] <= window[1])
    shares = []
    for bandwidth in bandwidths:
        one = replace(loops or ScalarLoops(), frequency_bandwidth=float(bandwidth))
        tracked = track(one, scene.correlator, ranges, rates, cn0, rng)
        on = (tracked.locked & tracked.on_signal(scene.correlator))[inside].all(axis=0)
        shares.append(on.mean(axis=(0, 2)))
    return np.array(shares)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
