"""What a GNSS outage of a given length costs, from many outages over one run.

In an outage the filter only predicts, and a prediction from time t does not depend on any measurement after t. So the
run is navigated once with all measurements, and from its recorded states (navigation state, parameters, covariance) it
is continued without GNSS from many times: as exact as a run of its own for every outage, and with outages that may
overlap. Aids that are no GNSS go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, InitialState, run
from schuler.filtering.measurements import GNSS_KINDS, MeasurementSchedule
from schuler.mechanization.strapdown import NavState
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.config import NavigationConfig, OutageSection
from schuler.navigation.evaluation.architectures import reference_of
from schuler.navigation.evaluation.outage_statistics import OutageStatistics
from schuler.navigation.inputs.preparation import prepared_imu
from schuler.navigation.navigate import imu_spec, navigate
from schuler.navigation.result import NavigationResult
from schuler.navigation.start.start import moved_to
from schuler.recording.recording import Recording
from schuler.recording.series import Increments
from schuler.recording.trajectory import Trajectory

Progress = Callable[[float], None]


def outage_statistics(
    recording: Recording,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    lengths: Sequence[float] = (2.0, 10.0, 30.0, 60.0),
    starts: ArrayLike | None = None,
    settle_s: float = 60.0,
    every_s: float | None = None,
    step_s: float = 1.0,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> OutageStatistics:
    """Lose GNSS again and again over a run, and see how far off the solution is after each length.

    Parameters
    ----------
    recording : Recording
        Errors are measured against its reference, or against its GNSS fixes at the antenna.
    config : NavigationConfig, dict, or path of a TOML file
        Its own outages are left out.
    lengths : sequence of float
        Multiples of ``step_s``. [s]
    starts : array_like, optional
        When GNSS is lost, from the start of the recording; moved to the record of the filter before. [s]
    settle_s : float
        Without ``starts``: first one so long after the filter begins. [s]
    every_s : float, optional
        Without ``starts``: period of the losses; default a third of the longest outage, at least ``step_s``. [s]
    step_s : float
        Spacing of the errors looked at. [s]
    initial : InitialState, optional
        Of the aided run, see :func:`schuler.navigation.navigate.navigate`.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    OutageStatistics
        On Ctrl-C the outages that were finished.

    Raises
    ------
    InputError
        If lengths are no multiples of the step, or the recording is too short for one outage.

    References
    ----------
    Hayal (2010), section 5.4, eqs. (5.1) to (5.4).
    """
    if not isinstance(config, NavigationConfig):
        config = NavigationConfig.parse(config) if isinstance(config, dict) else NavigationConfig.load(config)
    wanted = as_floats(list(lengths), "lengths", (None,))
    if not len(wanted) or not step_s > 0.0 or np.any(wanted < step_s - 1e-9):
        raise InputError(f"lengths: expected one or more of at least step_s = {step_s} s, got {list(lengths)}")
    if np.any(np.abs(wanted / step_s - np.round(wanted / step_s)) > 1e-6):
        raise InputError(f"lengths: expected multiples of step_s = {step_s} s, got {list(lengths)}")
    longest = float(wanted.max())
    config = config.model_copy(
        update={
            "outages": OutageSection(),
            "filter": config.filter.model_copy(update={"smooth": False, "record_s": step_s}),
        }
    )
    reference, at_antenna, _ = reference_of(recording)
    base = navigate(recording, config, initial=initial)
    if not base.complete:
        raise KeyboardInterrupt
    origin = recording.start
    limits = (
        float(base.t[0]) + settle_s,
        min(float(base.trajectory.t[-1]), float(reference.t[-1])) - longest,
    )
    if starts is None:
        period = max(longest / 3.0, step_s) if every_s is None else every_s
        times = np.arange(limits[0], limits[1] + 1e-9, period)
    else:
        times = origin + as_floats(starts, "starts", (None,))
        if np.any(times < base.t[0]) or np.any(times > limits[1] + 1e-9):
            raise InputError(
                f"starts: expected times from {base.t[0] - origin:.1f} to {limits[1] - origin:.1f} s, so that the "
                f"filter runs before and {longest:g} s of the log are left, got {times.min() - origin:.1f} to "
                f"{times.max() - origin:.1f} s"
            )
    if not len(times):
        raise InputError(
            f"the solution runs from {base.t[0] - origin:.1f} to {base.trajectory.t[-1] - origin:.1f} s: too short for "
            f"an outage of {longest:g} s after {settle_s:g} s of settling; give shorter lengths or settle_s"
        )
    records = np.unique(np.searchsorted(base.t, times + 1e-9, side="right") - 1)
    records = records[records >= 0]
    age = step_s * np.arange(round(longest / step_s) + 1.0)
    blind = _blind(recording, config, base, step_s)
    errors, covariances, done = [], [], []
    complete = True
    try:
        for k in records:
            ahead = _continued(blind, base, int(k), longest)
            if ahead is None:
                complete = False
                break
            first = _errors(base, slice(int(k), int(k) + 1), reference, at_antenna)
            rest = _errors(ahead, slice(0, len(age) - 1), reference, at_antenna)
            if len(rest[0]) < len(age) - 1:
                continue  # the log ends, or a gap left a record out
            errors.append(np.concatenate((first[0], rest[0])))
            covariances.append(np.concatenate((first[1], rest[1])))
            done.append(float(base.t[k]) - origin)
            if progress is not None:
                progress(len(done) / len(records))
    except KeyboardInterrupt:
        complete = False
    if not done and complete:
        raise InputError(f"no outage of {longest:g} s fits between the gaps of the log; give shorter lengths")
    n, m = len(done), len(age)
    return OutageStatistics(
        wanted, np.array(done), age, np.array(errors).reshape(n, m, 3), np.array(covariances).reshape(n, m, 3, 3),
        recording.metadata.name, complete,
    )  # fmt: skip


class _Blind(NamedTuple):
    """What a run needs that goes on without GNSS, made once."""

    increments: Increments
    schedule: MeasurementSchedule
    gyro_psd: FloatArray
    accel_psd: FloatArray
    options: FilterOptions


def _blind(recording: Recording, config: NavigationConfig, base: NavigationResult, step: float) -> _Blind:
    """The log and all aids but GNSS, as :func:`schuler.navigation.navigate.navigate` prepares them."""
    spec = imu_spec(config)
    imu = prepared_imu(recording.need_imu(), config, [])
    off = config.model_copy(update={"gnss": config.gnss.model_copy(update={"coupling": "off"})})
    # GNSS must not help to find rest, so all of the log is an outage
    schedule, _ = aiding_schedule(
        Sources(imu, recording.gnss, None, recording.odometer, recording.heading, recording.height),
        off, spec, float(base.trajectory.t[0]), recording.start, ((-np.inf, np.inf),),
    )  # fmt: skip
    options = FilterOptions(
        covariance_rate_hz=None if config.filter.full_rate else config.filter.covariance_rate_hz,
        record_s=step,
        output_rate_hz=1.0 / step,
        lockout=config.filter.lockout,
        earth_rotation=config.filter.earth_rotation,
    )
    return _Blind(
        imu.increments(order=config.imu.rate_order), schedule.where(~np.isin(schedule.kind, GNSS_KINDS)),
        np.full(3, spec.gyro.random_walk**2), np.full(3, spec.accel.random_walk**2), options,
    )  # fmt: skip


def _continued(blind: _Blind, base: NavigationResult, k: int, longest: float) -> NavigationResult | None:
    """The run from its k-th record on, without GNSS; None if interrupted."""
    s = base.states
    t = float(base.t[k])
    start = InitialState(NavState(t, s.r_eb_e[k], s.v_eb_e[k], s.q_eb[k]), base.covariance[k], base.parameters[k])
    step = blind.options.record_s
    increments = blind.increments.between(t - 1e-9, t + longest + 1.5 * step)
    ahead = blind.schedule.where((blind.schedule.t > t + 1e-6) & (blind.schedule.t <= increments.t[-1]))
    forward = run(
        increments, ahead, moved_to(start, increments), base.layout, blind.gyro_psd, blind.accel_psd, blind.options
    )
    if not forward.complete:
        return None
    return NavigationResult.from_run(
        forward, ahead.t, ahead.kind, base.layout, lever_arm_b=base.lever_arm_b, outages=((t, t + longest),)
    )


def _errors(
    result: NavigationResult, part: slice, reference: Trajectory, at_antenna: bool
) -> tuple[FloatArray, FloatArray]:
    """Position errors and claimed covariance at records. Shapes (k, 3), (k, 3, 3). [m], [m^2]"""
    states = result.states.moved_by(result.lever_arm_b) if at_antenna else result.states
    t = result.t[part]
    truth = reference.at(t)
    C = frames.C_en(truth.llh)
    error: FloatArray = np.einsum("nji,nj->ni", C, states.r_eb_e[part] - truth.r_eb_e)
    P = result.covariance_e[part]
    T = np.zeros((len(t), 3, P.shape[1]))
    T[:, :, 6:9] = np.eye(3)
    if at_antenna:
        # the antenna's error is dr + dpsi x (C l) = dr - [C l x] dpsi
        arm = states.r_eb_e[part] - result.states.r_eb_e[part]
        x, y, z = arm.T
        zero = np.zeros(len(t))
        T[:, :, 0:3] = np.stack(
            (np.stack((zero, z, -y), -1), np.stack((-z, zero, x), -1), np.stack((y, -x, zero), -1)), 1
        )
    TC = np.swapaxes(C, 1, 2) @ T
    cov: FloatArray = TC @ P @ np.swapaxes(TC, 1, 2)
    return error, cov
