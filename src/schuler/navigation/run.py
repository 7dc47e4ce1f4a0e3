"""Navigation of a recording with a configuration."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import ConfigError
from schuler.files import package_version
from schuler.filtering.engine import Progress, unpack_symmetric
from schuler.filtering.initial_state import InitialState, with_states
from schuler.filtering.measurements import in_windows
from schuler.gnss.observations import Observations
from schuler.gnss.ranges import Ranges
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.aids.vehicle import times_of_fixes, weaker_without_fixes
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.antenna import antenna_note, is_of_antenna
from schuler.navigation.inputs.gnss_faults import rejections
from schuler.navigation.inputs.imu_axes import against_course, axes_covariance, axes_note
from schuler.navigation.inputs.imu_noise import noise_against_budget
from schuler.navigation.inputs.preparation import (
    current_velocities,
    filter_options,
    prepared_gnss,
    prepared_imu,
    with_late_velocities,
)
from schuler.navigation.inputs.rtk import ranges_with_base, with_integers
from schuler.navigation.inputs.satellites import satellites, with_clocks
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.result import NavigationResult
from schuler.navigation.start.alignment import advance_to_log_start, align, aligned_sentence, with_mount_in_heading
from schuler.navigation.start.calibration import CalibrationStart, configured_start
from schuler.navigation.start.carried import carried_starts
from schuler.navigation.start.heading import WIDTH, as_sure_as_shown, judged_start, likeliest_start
from schuler.navigation.states import imu_spec, state_layout, white_noise_psd
from schuler.navigation.tuning.automatic import supported_run
from schuler.navigation.tuning.delay import delay_at_end, delay_note
from schuler.navigation.tuning.tuning import Tuning, tune
from schuler.recording.io.own import time_document
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.sensors.spec import ImuSpec


@explains_arguments
def navigate(
    recording: Recording,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    initial: InitialState | None = None,
    calibration: CalibrationResult | Path | str | None = None,
    base: Observations | Ranges | None = None,
    progress: Progress | None = None,
) -> NavigationResult:
    """Navigate a recording: align, filter, and keep what a smoother needs if the configuration asks for one.

    Parameters
    ----------
    recording : Recording
        With an IMU; without GNSS the solution is free inertial and needs ``initial``.
    config : NavigationConfig, dict, or path of a TOML file
    initial : InitialState, optional
        Start here instead of aligning; the log is cut to begin there. One without the states that satellites ask for
        (clocks) gets them from the nearest epoch. With a calibration only its navigation part and
        the parameters that are not calibrated count.
    calibration : CalibrationResult or path, optional
        Calibration of this unit, instead of ``imu.calibration`` of the configuration: the sensor states start from its
        values and covariance, errors that the filter does not estimate are taken out of the log; see
        :func:`~schuler.navigation.start.calibration.calibration_start`.
    base : Observations or Ranges, optional
        Base station for ``gnss.tight.carrier = "rtk"``, instead of the file in ``gnss.tight.base``.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    NavigationResult
        The filtered solution of the IMU's position, or of the antenna's (``.point``) where no lever arm is stated and
        none is estimated; ``.smooth()`` gives the smoothed one.

    Raises
    ------
    InputError, ConfigError
        If the recording lacks what the configuration needs, has gaps too long to bridge, or cannot be aligned; if the
        calibration was refused or does not fit the log.
    FileFormatError
        If the calibration's file cannot be read.

    Examples
    --------
    >>> result = schuler.navigate(schuler.read("town.parquet"), "examples/town_navigation.toml")
    >>> smoothed = result.smooth()
    >>> result.complete, smoothed.smoothed
    (True, True)
    """
    config = NavigationConfig.checked(config)
    started = time.perf_counter()
    prepare = partial(prepared_later, recording, initial=initial, calibration=calibration, base=base)
    asked = config
    config, prepared, tuned = supported_run(asked, prepare, aligned=initial is None)
    prepared = replace(prepared, headings=None)  # it holds the rates of the log: of increments 830 MB a day at 200 Hz
    doubts = noise_against_budget(prepared.imu, prepared.spec)  # before the run takes memory
    doubts += against_course(prepared.imu, _given_fixes(recording, prepared))
    forward = prepared.run(progress=progress, keep_part=True)
    if forward.epochs == 0 or not len(forward.rec_t):
        raise KeyboardInterrupt  # stopped before the first record
    notes, schedule = [*prepared.notes, *tuned], prepared.schedule
    notes += doubts
    provenance = provenance_of(recording, config, prepared.spec, prepared.calibrated)
    if config.gnss.delay_sigma_s > asked.gnss.delay_sigma_s and asked.imu.clock_shift_sigma_s == 0.0:
        delay, sigma = delay_at_end(forward, prepared)
        notes.append(delay_note(delay, sigma))
        forward.rec_est[:, prepared.layout["delay"].start - 9] += prepared.fixes_later_s
        provenance["fixes_moved_s"] = prepared.fixes_later_s
    P_end = unpack_symmetric(forward.rec_P[-1:], prepared.layout.size)[0, :3, :3]
    notes += axes_note(prepared.axes_covariance_b, P_end, calibrated=prepared.calibrated is not None)
    if not forward.complete:
        ended = forward.t[-1] - recording.start
        notes.append(f"interrupted at {ended:.1f} s of the recording; the solution ends there")
    notes += rejections(schedule.kind, forward.status, schedule.t, schedule.R, forward.noise_factors)
    if is_of_antenna(config, schedule.kind, prepared.layout):
        provenance["point"] = "antenna"
    result = NavigationResult.from_run(
        forward,
        schedule.t,
        schedule.kind,
        prepared.layout,
        outages=prepared.windows,
        lever_arm_b=np.array(config.gnss.lever_arm_m),
        provenance={**provenance, "elapsed_s": time.perf_counter() - started},
        notes=tuple(notes),
        axes_covariance_b=prepared.axes_covariance_b,
        ranges=prepared.ranges,
        points=None if prepared.points is None else prepared.points.solution,
    )
    if result.point == "imu":
        return result
    return replace(result, notes=(*notes, *antenna_note(result.sigma("dr")[:, :2])))


def _given_fixes(recording: Recording, prepared: PreparedRun) -> GnssSeries | None:
    """Fixes at their times by the IMU's clock, those withheld by outages left out."""
    gnss = recording.gnss if prepared.points is None else prepared.points.gnss
    if gnss is None:
        return None
    gnss = replace(gnss, t=gnss.t + prepared.fixes_later_s)
    return gnss.where(~in_windows(gnss.t, prepared.windows))


def prepared_later(recording: Recording, config: NavigationConfig, fixes_later_s: float, **given: Any) -> PreparedRun:
    """A run made ready with fixes so much later than their stamps. [s]"""
    if recording.gnss is not None and fixes_later_s != 0.0:
        recording = replace(recording, gnss=replace(recording.gnss, t=recording.gnss.t + fixes_later_s))
    return replace(prepared_run(recording, config, **given), fixes_later_s=fixes_later_s)


def prepared_run(
    recording: Recording,
    config: NavigationConfig,
    *,
    initial: InitialState | None = None,
    calibration: CalibrationResult | Path | str | None = None,
    base: Observations | Ranges | None = None,
) -> PreparedRun:
    """Everything a run of the filter needs: series made ready, aligned start, schedule; see :func:`navigate`."""
    _check_earth_rotation(recording, config)
    notes = list(recording.metadata.notes)
    spec = imu_spec(config, notes)
    calibrated = configured_start(config, recording.need_imu(), calibration)
    begins = None if initial is None else initial.nav.t
    imu = prepared_imu(recording.need_imu(), config, notes, calibrated, begins)
    ranges, points, relative = None, None, None
    if config.gnss.coupling == "tight":
        ranges, points = satellites(recording, config, notes)
        config = points.put_into(config)
        if config.gnss.tight.carrier == "rtk":
            near_e = np.mean(points.solution.r_e[points.solution.ok], axis=0)
            relative = ranges_with_base(recording, ranges, near_e, config, base, notes)
            ranges = relative.ranges
    gnss = recording.gnss if points is None else points.gnss
    gnss = None if gnss is None else prepared_gnss(gnss, config, notes, imu if initial is None else None)
    layout = state_layout(config, spec, ranges)
    start, delay = recording.start, config.gnss.velocity_delay_s
    windows = config.outages.resolve(start, recording.stop if gnss is None else float(gnss.t[-1]))
    increments = imu.increments(order=config.imu.rate_order)
    aligned, fixes = None, None
    if initial is None:
        fixes = None if gnss is None else current_velocities(gnss, delay)
        aligned = align(imu, fixes, config, spec, layout, windows, notes, calibrated)
        if aligned.source == "course":
            lever = np.array(config.gnss.lever_arm_m)
            aligned = replace(aligned, initial=with_mount_in_heading(aligned.initial, layout, lever))
        initial = aligned.initial
    elif calibrated is not None:
        initial = calibrated.put_into(initial)
    if points is not None and aligned is None:
        own = state_layout(config, spec)  # a start that was made before satellites were looked at
        if len(initial.P) == own.size:
            initial = with_clocks(with_states(initial, own, layout.visible), points, layout.visible)
    increments = increments.between(initial.nav.t - 1e-9, increments.t[-1])
    initial = advance_to_log_start(initial, increments)
    schedule, notes_of_aids = aiding_schedule(
        Sources(imu, gnss, ranges, recording.odometer, recording.heading, recording.height),
        config, spec, initial.nav.t, start, windows,
    )  # fmt: skip
    notes += notes_of_aids
    schedule = with_late_velocities(schedule.outside(windows), delay, initial.nav.t, notes)
    if config.aiding.non_holonomic is not None:
        factor, times = config.aiding.non_holonomic.unaided_factor, times_of_fixes(schedule, initial.nav.t)
        schedule = weaker_without_fixes(schedule, factor, times)
    if not len(schedule):
        notes.append("no measurement is used: this is a free inertial solution")
    prepared = PreparedRun(
        imu, increments, schedule, initial, layout, spec, white_noise_psd(config, spec),
        filter_options(config, imu), windows, (), calibrated, ranges, points,
        axes_covariance(spec, layout, config.aiding, calibrated),
    )  # fmt: skip
    if aligned is not None:

        def finish(state: InitialState) -> InitialState:
            state = state if points is None else with_clocks(state, points, layout)
            return advance_to_log_start(state, increments)

        judged, method, sentences = judged_start(aligned, prepared, finish)
        if judged is aligned.initial and fixes is not None:
            carried = carried_starts(aligned, prepared, fixes, config)
            shown, doubts = as_sure_as_shown(aligned, prepared, finish)
            judged, method = likeliest_start(shown, carried, prepared, finish)
            sentences += doubts if judged is shown.initial else []
        notes += [*sentences, aligned_sentence(judged, method, float(imu.t[0]))]
        prepared = replace(prepared, initial=finish(judged))
        if aligned.source in ("course", "none"):

            def turned(angle: float) -> InitialState:
                return finish(aligned.at_heading(aligned.heading + angle, 2.0 * WIDTH))

            prepared = replace(prepared, headings=turned)
    prepared = replace(prepared, notes=tuple(notes))
    return prepared if relative is None else with_integers(prepared, relative, config)


@explains_arguments
def tune_noise(
    recording: Recording, config: NavigationConfig | dict[str, Any] | Path | str, *, initial: InitialState | None = None
) -> Tuning:
    """Tune the noise of IMU and GNSS from a recording's own fixes.

    Parameters
    ----------
    recording : Recording
    config : NavigationConfig, dict, or path of a TOML file
        Its noise is where the search starts; outages are withheld.
    initial : InitialState, optional
        Start here instead of aligning.

    Returns
    -------
    Tuning
        Factors with intervals, and whether held-back fixes bear them out;
        :func:`~schuler.navigation.tuning.entries.tuned_configuration` puts them into the configuration.

    Raises
    ------
    InputError, ConfigError
        As :func:`navigate`; if there are too few fixes.

    Examples
    --------
    >>> tuning = schuler.tune_noise(schuler.read("town.parquet"), "examples/town_navigation.toml")
    >>> tuning.better  # the configuration states what was simulated
    False
    """
    return tune(prepared_run(recording, NavigationConfig.checked(config), initial=initial), aligned=initial is None)


def _check_earth_rotation(recording: Recording, config: NavigationConfig) -> None:
    """Raise ConfigError if the recording was simulated with another rotation of the Earth than configured."""
    scenario = recording.metadata.options.get("scenario")
    simulated = scenario.get("motion") if isinstance(scenario, dict) else None
    simulated = simulated if isinstance(simulated, dict) else {}
    rotating = simulated.get("earth_rotation", True)
    if rotating != config.filter.earth_rotation:
        raise ConfigError(
            f"filter.earth_rotation is {str(config.filter.earth_rotation).lower()}, but the recording was simulated "
            f"with {str(rotating).lower()}; set the same"
        )


def provenance_of(
    recording: Recording, config: NavigationConfig, spec: ImuSpec, calibrated: CalibrationStart | None
) -> dict[str, Any]:
    """Provenance of a solution: versions, options and hashes of everything that a result was made from."""
    return {
        "schuler": package_version(),
        "config": config.model_dump(mode="json", exclude_defaults=True),
        "sources": recording.metadata.sources,
        "recording": recording.metadata.name,
        "recording_options": recording.metadata.options,
        "time": time_document(recording.metadata.time),
        "imu": spec.name,
        **({} if calibrated is None else {"calibration": calibrated.provenance}),
    }
