"""Foot-mounted inertial navigation: a strapdown filter with zero velocity wherever the shoe rests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import earth, frames, units
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, Progress, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.foot.alignment import align_foot, walk_start
from schuler.navigation.foot.by_stride import by_stride
from schuler.navigation.foot.clipping import clip_noise, clip_sentences, gyro_clips, restored
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.foot.motion import in_motion, noise_in_motion, spike_doubts
from schuler.navigation.foot.rests import detect_rests, zero_velocities
from schuler.navigation.foot.result import FootResult
from schuler.navigation.foot.strides import Strides, segment
from schuler.navigation.result import NavigationResult
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.standstill.gait import stride_period
from schuler.standstill.intervals import Rests, rests_from_mask

_MOST_OF_BIAS_SIGMA = 4.0  # 3.6 at most on walks of unbiased gyroscopes, 4.1 and more where errors were ten claims
_UNTOLD = 0.9  # of the variance of gyro biases that rests leave: 0.87 at most where one told them, chosen on half
_FEW_STRIDES = 6
_STILL_M = 1.0  # within which somebody stands without a stride
_SHOE_M = 0.5  # from an IMU to any point of its shoe


@explains_arguments
def navigate_foot(
    source: Recording | ImuSeries,
    config: FootConfig | dict[str, Any] | Path | str | None = None,
    *,
    rest: ArrayLike | None = None,
    progress: Progress | None = None,
) -> FootResult:
    """Navigate the log of an IMU on a shoe.

    Parameters
    ----------
    source : Recording or ImuSeries
        The foot must rest at the start, if only for a tenth of a second.
    config : FootConfig, dict, or path of a TOML file, optional
        Default: 15 states and the resting point of the shoe, likelihood-ratio detector with a threshold that follows
        the motion.
    rest : array_like of bool, shape (n,), optional
        Samples at rest, instead of those the detector finds.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    FootResult

    Raises
    ------
    InputError, ConfigError
        If the log has long gaps, or the foot does not rest at its start.

    Notes
    -----
    A zero velocity corrects velocity, tilt, and through the correlations that grow in a swing the displacement of that
    swing. It does not correct position and heading: both are dead reckoning, and so is the gyro bias about the
    vertical except through turns of the foot about other axes.

    Where ``zupt.pivot`` is set, what rests is not the IMU but a fixed point of the shoe, at ``l`` from it:
    ``v + C (omega x l) = 0``, with l among the states (block ``lever_v``). While the foot
    rolls over the ball it removes most of the velocity the IMU really has.

    References
    ----------
    Foxlin (2005), Pedestrian tracking with shoe-mounted inertial sensors; Skog, Nilsson, Handel (2010), Evaluation of
    zero-velocity detectors for foot-mounted inertial navigation systems; Groves (2013), section 15.3; Stefanisko
    (2015), appendix B. Departure: the resting point is a state.

    Examples
    --------
    >>> import numpy as np
    >>> from schuler.simulation import ideal_rates, walk
    >>> motion = walk([0.8, 0.1, 0.0], strides=6)  # 1.3 m each
    >>> t = np.arange(0.0, motion.duration, 0.005)
    >>> result = schuler.navigate_foot(schuler.ImuSeries(t, *ideal_rates(motion, t)))
    >>> print(f"{result.distance:.2f} m")
    7.80 m
    """
    config = FootConfig() if config is None else FootConfig.checked(config)
    recording = source if isinstance(source, Recording) else Recording(imu=source)
    notes = list(recording.metadata.notes)
    imu = recording.need_imu()
    _check_gaps(imu, config, notes)
    clips = gyro_clips(imu)
    spikes, (clip_notes, clip_doubts) = spike_doubts(imu), clip_sentences(imu, clips)
    imu = restored(imu, clips)
    notes += clip_notes
    llh = np.array([config.place.lat_deg * units.DEG, config.place.lon_deg * units.DEG, config.place.height_m])
    gravity = float(np.linalg.norm(earth.gravity_ned(llh[0], llh[2])))
    stride = stride_period(imu)
    if rest is None:
        rests = detect_rests(
            imu, config.detector, gravity=gravity, rest_s=config.alignment.rest_s, period_s=stride or 0.0
        )
    else:
        rests = rests_from_mask(imu.t, rest)
    increments = imu.increments(order=config.sensor.rate_order)
    begin = walk_start(imu.rates(), rests, increments, config, gravity, notes)
    increments = increments.between(begin - 1e-9, increments.t[-1])
    layout = foot_layout(config)
    initial = align_foot(imu, rests, begin, llh, layout, config, notes)
    navigated = imu.t >= begin - 1e-9
    rests = _from(rests, navigated, begin, imu.t)
    schedule = zero_velocities(imu, rests, config)
    schedule = schedule.where(schedule.t > rests.t[0])  # that one is the start
    gyro_psd, accel_psd, note = noise_in_motion(imu, config.sensor, gravity)
    notes += [note] if note else []
    psd = gyro_psd + clip_noise(imu, clips), accel_psd
    options = FilterOptions(
        covariance_rate_hz=config.filter.covariance_rate_hz, record_s=config.filter.record_s,
        smoother=config.filter.smooth != "none",
    )  # fmt: skip
    smoothed: NavigationResult | None
    if config.filter.smooth == "stride":
        filtered, smoothed = by_stride(increments, schedule, initial, layout, psd, options, rests, progress)
    else:
        forward = run(increments, schedule, initial, layout, *psd, options, progress, keep_part=True)
        if forward.epochs == 0 or not len(forward.rec_t):
            raise KeyboardInterrupt  # stopped before there was anything to keep
        filtered = NavigationResult.from_run(forward, schedule.t, schedule.kind, layout)
        smoothed = filtered.smooth() if options.smoother and filtered.complete else None
    if (wider := _bias_needed(filtered, initial, config)) is not None:
        sensor = config.sensor.model_copy(update={"gyro_bias_deg_s": wider})
        again = navigate_foot(source, config.model_copy(update={"sensor": sensor}), rest=rest, progress=progress)
        text = (
            f"the strides contradict gyro biases of {config.sensor.gyro_bias_deg_s:.2g} deg/s (1 sigma): navigated "
            f"again with sensor.gyro_bias_deg_s = {wider:.2g}, the largest that came out"
        )
        return replace(again, notes=(*again.notes, text), doubts=(*_bias_doubts(text, rests, config), *again.doubts))
    best = filtered if smoothed is None else smoothed
    if not filtered.complete:
        notes.append(f"interrupted at {filtered.trajectory.t[-1]:.2f} s; the solution ends there")
        before_end = rests.t <= filtered.trajectory.t[-1] + 1e-9
        rests = rests_from_mask(rests.t[before_end], rests.mask[before_end], method=rests.method)
    position = np.concatenate((np.zeros((1, 3)), frames.ned_from_ecef(best.trajectory.r_eb_e, llh)))
    heading = np.concatenate(([initial.nav.rpy_nb[2]], best.trajectory.rpy_nb[:, 2]))
    strides = segment(
        rests, position, heading, min_rest_s=config.stride.min_rest_s, min_motion_s=config.stride.min_motion_s,
        min_length_m=config.stride.min_length_m,
    )  # fmt: skip
    smoothing = "none" if smoothed is None else config.filter.smooth
    expected = None if stride is None else float(in_motion(imu).sum()) * imu.interval / stride
    speeds = residual_speeds(filtered, config.stride.min_motion_s)
    doubts = [*_foot_doubts(best, position, strides), *spikes, *clip_doubts, *strides.doubts(expected, speeds)]
    if _bias_untold(initial, layout, config) and strides.walking.sum() >= _FEW_STRIDES:
        text = f"no rest tells the gyro biases, taken as {config.sensor.gyro_bias_deg_s:.2g} deg/s (1 sigma)"
        doubts += _bias_doubts(text, rests, config)
    return FootResult(filtered, smoothed, smoothing, rests, strides, llh, tuple(notes), tuple(doubts))


def _foot_doubts(best: NavigationResult, position: FloatArray, strides: Strides) -> list[str]:
    """Sentences on what no foot does: it goes somewhere without a stride, or rests at a point that is not its shoe."""
    sentences = []
    reach = float(np.hypot(position[:, 0], position[:, 1]).max())
    if not strides.walking.any() and reach > _STILL_M:
        sentences.append(
            f"there is no stride, and yet the solution goes {reach:.1f} m: the IMU is not on a foot (schuler navigate "
            "is for vehicles and hands), or stances are missed"
        )
    if "lever_v" in best.layout:
        size, sigma = (float(np.linalg.norm(x)) for x in (best.parameter("lever_v")[-1], best.sigma("lever_v")[-1]))
        if size - 3.0 * sigma > _SHOE_M:
            sentences.append(
                f"the point that rests is {size:.1f} m from the IMU, which no shoe is large enough for: the IMU is not "
                "on a foot, or units or axes are wrong"
            )
    return sentences


def _bias_needed(filtered: NavigationResult, initial: InitialState, config: FootConfig) -> float | None:
    """1-sigma of gyro biases that the biases found ask for, where those of the start contradict them. [deg/s]

    The bias about the vertical is hardly seen: that of the others tells how large it may be.
    """
    if "b_g" not in filtered.layout or not filtered.complete:
        return None
    part = filtered.layout["b_g"]
    before, sigma = initial.parameters[part.start - 9 : part.stop - 9], np.sqrt(np.diag(initial.P)[part])
    after = filtered.parameter("b_g")[-1]
    largest = float(np.abs(after).max()) / units.DEG
    contradicts = float(np.max(np.abs(after - before) / sigma)) > _MOST_OF_BIAS_SIGMA
    return largest if contradicts and largest > 2.0 * config.sensor.gyro_bias_deg_s else None


def _bias_untold(initial: InitialState, layout: StateLayout, config: FootConfig) -> bool:
    """Whether the rests of the log leave the gyro biases as uncertain as the configuration has them."""
    if "b_g" not in layout:
        return False
    variance = float(np.diag(initial.P)[layout["b_g"]].max())
    return variance > _UNTOLD * (config.sensor.gyro_bias_deg_s * units.DEG) ** 2


def _bias_doubts(text: str, rests: Rests, config: FootConfig) -> list[str]:
    """Sentence on gyro biases that strides alone tell; none where the foot stood somewhere.

    Strides show a bias about the vertical by where a swing ends sideways, as misalignments do in every stride alike:
    the filter is surer of it than it can be.
    """
    rest_s = config.alignment.rest_s
    if len(rests) and float(np.max(rests.stop - rests.start)) >= rest_s - 1e-9:
        return []
    return [
        f"{text}, and the foot never stands for {rest_s:g} s: the heading drifts by more than is claimed; let it stand "
        "before or after the walk"
    ]


def residual_speeds(filtered: NavigationResult, min_motion_s: float) -> FloatArray:
    """Speed left at the first zero velocity of every stance but that of the start. Shape (k,). [m/s]

    Parameters
    ----------
    filtered : NavigationResult
    min_motion_s : float
        Shorter motions are within a stance. [s]
    """
    innovations = filtered.innovations
    first = np.flatnonzero(np.diff(innovations.t) > min_motion_s) + 1
    speed: FloatArray = np.linalg.norm(innovations.innovation[first, :3], axis=1)
    return speed[np.isfinite(speed)]


def foot_layout(config: FootConfig) -> StateLayout:
    """State layout of a configuration: biases, scale factors, resting point."""
    s, models = config.sensor, {}
    if config.filter.states >= 15:
        models["b_a"] = StateModel.constant(s.accel_bias_m_s2)
        models["b_g"] = StateModel.constant(s.gyro_bias_deg_s * units.DEG)
    if config.filter.states >= 21:
        models["S_a"], models["S_g"] = StateModel.constant(s.accel_scale), StateModel.constant(s.gyro_scale)
    if config.zupt.pivot:
        models["lever_v"] = StateModel.constant(config.zupt.pivot_sigma_m)
    return StateLayout(models)


def _check_gaps(imu: ImuSeries, config: FootConfig, notes: list[str]) -> None:
    gaps = imu.gaps(2.5)
    if not len(gaps):
        return
    longest = gaps[np.argmax(gaps[:, 1])]
    if longest[1] > config.sensor.max_gap_s:
        raise InputError(
            f"the IMU log pauses for {longest[1]:.3f} s at {longest[0]:.3f} s, longer than sensor.max_gap_s = "
            f"{config.sensor.max_gap_s} s: a swing lasts hardly longer; navigate the parts separately"
        )
    notes.append(f"{len(gaps)} pauses of the IMU log bridged, the longest {longest[1]:.3f} s at {longest[0]:.3f} s")


def _from(rests: Rests, navigated: BoolArray, begin: float, t: FloatArray) -> Rests:
    """The rests of the samples that are navigated; the first sample is the start."""
    mask, times = rests.mask[navigated], t[navigated]
    statistic, threshold = (x[navigated] if len(x) else x for x in (rests.statistic, rests.threshold))
    if times[0] > begin + 1e-9:  # increments: the first interval begins before the first stamp
        times, mask = np.concatenate(([begin], times)), np.concatenate(([mask[0]], mask))
        statistic, threshold = (np.concatenate((x[:1], x)) for x in (statistic, threshold))
    return rests_from_mask(times, mask, statistic=statistic, threshold=threshold, method=rests.method)
