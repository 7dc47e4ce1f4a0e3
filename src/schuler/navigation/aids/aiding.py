"""Measurements of a run from its configuration: GNSS, vehicle, scalar sensors, rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler import units
from schuler.exceptions import InputError
from schuler.filtering.measurements import PSEUDORANGE, MeasurementSchedule, gnss_measurements, merged
from schuler.filtering.states import AMBIGUITIES, CHANNELS
from schuler.gnss.ranges import Ranges
from schuler.navigation.aids.rest import SHAKEN, earth_rates, gravities, rests, zero_rates, zero_velocities
from schuler.navigation.aids.satellite import carrier_measurements, range_measurements, resets, thinned
from schuler.navigation.aids.scalar import heading_measurements, height_measurements, known_positions
from schuler.navigation.aids.vehicle import VehicleConditions, non_holonomic, odometer_measurements
from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import AidingSection, NonHolonomicSection
from schuler.navigation.states import state_layout
from schuler.plotting.notebook import Abridged
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries
from schuler.sensors.spec import ImuSpec
from schuler.standstill.stationarity import StaticIntervals


@dataclass(frozen=True, repr=False)
class Sources(Abridged):
    """Series that aids are made from: IMU in vehicle axes, prepared fixes and ranges, other series of the recording."""

    imu: ImuSeries
    gnss: GnssSeries | None = None
    ranges: Ranges | None = None
    odometer: OdometerSeries | None = None
    heading: ScalarSeries | None = None
    height: ScalarSeries | None = None


def aiding_schedule(
    sources: Sources,
    config: NavigationConfig,
    spec: ImuSpec,
    start: float,
    origin: float,
    windows: tuple[tuple[float, float], ...] = (),
) -> tuple[MeasurementSchedule, list[str]]:
    """All measurements of a run after its start, in order of time, and a sentence on each aid.

    Parameters
    ----------
    sources : Sources
    config : NavigationConfig
    spec : ImuSpec
        Its noise weighs means at rest against Earth rate and gravity.
    start : float
        Time of the initial state. [s]
    origin : float
        Start of the recording, from which known places count their time. [s]
    windows : tuple of (start, stop)
        Outages, in which GNSS speed does not help to find rest. [s]

    Raises
    ------
    InputError
        If an aid is configured whose series the recording does not have.
    """
    aiding, notes = config.aiding, []
    parts = [_satellite_parts(sources, config, spec)]
    if aiding.non_holonomic is not None:
        parts.append(_vehicle_part(sources.imu, aiding, start))
    if aiding.odometer is not None:
        series, section = sources.odometer, aiding.odometer
        if series is None:
            raise InputError(
                "aiding.odometer is configured, but the recording has no odometer series: "
                "read one with the log, or leave the aid out"
            )
        if section.sigma_m_s is not None:
            series = replace(series, sigma=np.full(len(series), section.sigma_m_s))
        parts.append(
            odometer_measurements(
                series, lever_b=section.lever_m, gate=_gate(section.gate), max_rate_hz=section.rate_hz
            )
        )
    if aiding.heading is not None:
        sigma = aiding.heading.sigma_deg
        heading = _scalar(sources.heading, "heading", None if sigma is None else sigma * units.DEG)
        parts.append(
            heading_measurements(
                heading,
                declination=aiding.heading.declination_deg * units.DEG,
                from_gnss=aiding.heading.from_gnss,
                gate=_gate(aiding.heading.gate),
            )
        )
    if aiding.barometer is not None:
        height = _scalar(sources.height, "height", aiding.barometer.sigma_m)
        parts.append(height_measurements(height, lever_b=aiding.barometer.lever_m, gate=_gate(aiding.barometer.gate)))
    if aiding.fixes is not None:
        llh = np.array(aiding.fixes.llh_deg) * (units.DEG, units.DEG, 1.0)
        t = origin + np.array(aiding.fixes.t_s)
        parts.append(known_positions(t, llh, aiding.fixes.sigma_m, lever_b=aiding.fixes.lever_m))
    if any(x is not None for x in (aiding.zero_velocity, aiding.zero_rate, aiding.gravity, aiding.earth_rate)):
        intervals = rests(sources.imu, sources.gnss, aiding.rest, windows)
        notes.append(
            f"at rest: {len(intervals)} intervals, {intervals.duration.sum():.1f} s in all"
            + (" (what is measured at rest has nothing to work with)" if not len(intervals) else "")
        )
        notes += [note for note in intervals.notes if note.startswith(SHAKEN)]
        parts += rest_measurements(sources.imu, intervals, aiding, spec)
    schedule = merged(*parts)
    return schedule.where(schedule.t > start + 1e-6), notes


def rest_measurements(
    imu: ImuSeries, intervals: StaticIntervals, aiding: AidingSection, spec: ImuSpec
) -> list[MeasurementSchedule]:
    """Measurements at rest that are configured, in intervals of this log."""
    parts = []
    if aiding.zero_velocity is not None:
        z = aiding.zero_velocity
        parts.append(zero_velocities(intervals, sigma=z.sigma_m_s, rate_hz=z.rate_hz, gate=_gate(z.gate), imu=imu))
    gyro_noise, accel_noise = spec.gyro.random_walk, spec.accel.random_walk
    for section, function in ((aiding.zero_rate, zero_rates), (aiding.earth_rate, earth_rates)):
        if section is not None:
            sigma = section.sigma_deg_s * units.DEG
            gate = _gate(section.gate)
            parts.append(
                function(imu, intervals, sigma_noise=gyro_noise, sigma=sigma, block_s=section.block_s, gate=gate)
            )
    if aiding.gravity is not None:
        g = aiding.gravity
        parts.append(
            gravities(
                imu,
                intervals,
                sigma_noise=accel_noise,
                sigma=g.sigma_m_s2,
                vector=g.form == "vector",
                block_s=g.block_s,
                gate=_gate(g.gate),
            )
        )
    return parts


def _satellite_parts(sources: Sources, config: NavigationConfig, spec: ImuSpec) -> MeasurementSchedule:
    section = config.gnss
    gate = _gate(section.gate)
    if section.coupling == "tight":
        if sources.ranges is None:
            raise InputError("gnss.coupling is tight, but there are no ranges")
        return tight_measurements(sources.ranges, config, spec)
    if sources.gnss is None or section.coupling == "off":
        return MeasurementSchedule.empty()
    if section.coupling == "reset":
        return resets(sources.gnss, section.lever_arm_m, every_s=section.reset_every_s)
    return gnss_measurements(
        thinned(sources.gnss, section.every_s), section.lever_arm_m, use_velocity=section.velocity, gate=gate
    )


def tight_measurements(ranges: Ranges, config: NavigationConfig, spec: ImuSpec) -> MeasurementSchedule:
    """Codes, range rates and carrier phases of a tightly coupled run, of ranges that are prepared."""
    section, layout = config.gnss, state_layout(config, spec, ranges)
    gate = _gate(section.gate)
    schedule = range_measurements(
        ranges, section.lever_arm_m, use_rates=section.tight.rates, sigma_scale=section.sigma_scale, gate=gate,
        slow=section.correlated.of_ranges, channels=sum(name in layout for name in CHANNELS),
    )  # fmt: skip
    own = np.where(schedule.kind == PSEUDORANGE, section.tight.range_sigma_scale, section.tight.rate_sigma_scale)
    schedule = replace(schedule, R=schedule.R * own[:, None, None] ** 2)
    if section.tight.carrier == "off":
        return schedule
    return merged(
        schedule,
        carrier_measurements(
            ranges, section.lever_arm_m, sigma=float(section.tight.carrier_sigma_m), gate=gate,
            channels=sum(name in layout for name in AMBIGUITIES),
        ),
    )  # fmt: skip


def _vehicle_part(imu: ImuSeries, aiding: AidingSection, start: float) -> MeasurementSchedule:
    section = aiding.non_holonomic
    assert section is not None
    return non_holonomic(imu, rate_hz=section.rate_hz, start=start, **no_slip_options(section))


def no_slip_options(section: NonHolonomicSection) -> dict[str, Any]:
    """Sigmas, lever arm, conditions and gate of a configuration, for
    :func:`~schuler.navigation.aids.vehicle.no_slip`.
    """
    return {
        "sigma_lateral": section.lateral_sigma_m_s,
        "sigma_vertical": section.vertical_sigma_m_s,
        "lever_b": section.lever_m,
        "conditions": VehicleConditions(
            section.max_turn_rate_deg_s * units.DEG,
            section.max_lateral_m_s2,
            section.max_forward_m_s2,
            section.min_speed_m_s,
        ),
        "gate": _gate(section.gate),
    }


def _gate(value: float | str) -> float | None:
    return None if isinstance(value, str) else value


def _scalar(series: ScalarSeries | None, name: str, sigma: float | None) -> ScalarSeries:
    if series is None:
        raise InputError(f"aiding needs a {name} series, and the recording has none; see docs/reading-data.md")
    return series if sigma is None else replace(series, sigma=np.full(len(series), sigma))
