"""Which navigation jobs runs in lock-step can do, and their scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.initial_state import with_states
from schuler.navigation.aids.aiding import tight_measurements
from schuler.navigation.config import GnssSection, ImuSection
from schuler.navigation.sections import AidingSection, TightSection
from schuler.navigation.states import state_layout, white_noise_psd
from schuler.simulation.aid_sections import StreamSection
from schuler.simulation.satellites import draw_satellites

if TYPE_CHECKING:
    from schuler.montecarlo.job import NavigationJob
    from schuler.montecarlo.lanes.run import LaneScenario
    from schuler.simulation.scenario import Mission

#: Terms of a specification that lanes do not have, and that are small beside the noise of most IMUs.
ROUNDING = ("resolution", "quantisation")
#: Entries of ``gnss.tight`` that lanes know; those of corrections and masks do not act on simulated ranges.
_TIGHT = (
    "systems", "ionosphere", "troposphere", "elevation_mask_deg", "cn0_mask_dbhz", "rates", "carrier",
    "carrier_sigma_m", "carrier_walk_m", "integrity", "clock_noise_m", "clock_drift_noise_m_s", "clock_sigma_m",
    "clock_drift_sigma_m_s", "range_sigma_scale", "rate_sigma_scale", "system_noise_m",
)  # fmt: skip
_SHARE, _MANY = 0.8, 6.0  # of a range, for motion and so many sigmas of bias; the rest is for noise


def lane_scenario(job: NavigationJob) -> LaneScenario | str:
    """Scenario for :func:`schuler.montecarlo.lanes.run.run_lanes`, or a sentence on what of the job lanes do not
    have.
    """
    from schuler.montecarlo.lanes.aiding import LaneAiding, true_gnss, true_satellites
    from schuler.montecarlo.lanes.errors import LaneErrors
    from schuler.montecarlo.lanes.run import LaneScenario

    why = _refusal(job)
    if why is not None:
        return f"runs in lanes {why}"
    plan = job.plan
    config, mission = plan.config, plan.mission
    left_out = ROUNDING if job.unrounded else ()
    if _within_range(mission):
        left_out = ("range", *left_out)
    assert plan.layout is not None
    assert plan.initial is not None
    assert mission.spec is not None
    gate = None if config.gnss.gate == "off" else config.gnss.gate
    section, satellites, layout = job.simulation.gnss, job.simulation.satellites, plan.layout
    try:
        aiding = LaneAiding.none()
        begin, end = (float(t) for t in mission.ideal.t[[0, -1]])
        if section is not None and config.gnss.coupling == "loose":
            aiding = true_gnss(mission.motion, section.model(), use_velocity=config.gnss.velocity, gate=gate)
        elif satellites is not None and config.gnss.coupling == "tight":
            assert mission.sky is not None
            model = satellites.model()
            seen = draw_satellites(mission.sky, model, np.random.default_rng(0)).ranges
            layout = state_layout(config, plan.spec, seen)
            aiding = true_satellites(mission.sky, model, lambda r: tight_measurements(r, config, plan.spec))
            aiding = aiding.where(aiding.schedule.t > begin + 1e-6)  # as every run of the engine
        aiding = aiding.without(config.outages.resolve(begin, end))
        rate = job.simulation.imu.rate_hz
        f = config.filter
        return LaneScenario(
            mission.ideal,
            LaneErrors.of_spec(mission.spec, rate, len(mission.ideal.gyro), left_out=left_out),
            aiding,
            layout,
            with_states(plan.initial, plan.layout, layout.visible),
            *white_noise_psd(config, plan.spec),
            FilterOptions(
                covariance_rate_hz=None if f.full_rate else f.covariance_rate_hz, record_s=f.record_s,
                lockout=f.lockout, hold_s=f.hold_s, adaptive=f.adaptive, earth_rotation=f.earth_rotation,
            ),
            nees=("navigation",),
        )  # fmt: skip
    except InputError as error:
        return str(error)


def _within_range(mission: Mission) -> bool:
    """Whether the motion is so far from the ends of the scales that no drawn error clips."""
    spec, ideal = mission.spec, mission.ideal
    assert spec is not None
    for triad, increments in ((spec.gyro, ideal.gyro), (spec.accel, ideal.accel)):
        peak = float(np.abs(increments).max()) * ideal.rate_hz
        if triad.range is not None and peak + _MANY * triad.turn_on_bias > _SHARE * triad.range:
            return False
    return True


def _refusal(job: NavigationJob) -> str | None:
    """What lanes do not do, of what the job asks for."""
    simulation, config = job.simulation, job.navigation
    imu, aids, tight = simulation.imu, config.aiding, config.gnss.coupling == "tight"
    kept = ("coupling", "lever_arm_m", "velocity", "gate") + (("sigma_scale", "tight") if tight else ())
    plain = GnssSection(**{name: getattr(config.gnss, name) for name in kept})
    receiver = simulation.satellites if tight else simulation.gnss
    whole = TightSection(**{name: getattr(config.gnss.tight, name) for name in _TIGHT})
    mounted = any(imu.mount_rpy_deg) or any(config.imu.mount_rpy_deg)
    source = ImuSection(
        catalogue=config.imu.catalogue, spec=config.imu.spec, gyro=config.imu.gyro, accel=config.imu.accel
    )
    clock_noise, carrier_sigma = config.gnss.tight.clock_noise_m, config.gnss.tight.carrier_sigma_m
    for wrong, text in (
        (config.gnss.coupling not in ("loose", "off", "tight"), f"know no coupling {config.gnss.coupling!r}"),
        (job.start is None, "do not align themselves; give the errors they start with (section [start])"),
        (imu.ideal, "need an IMU with errors"),
        (imu.kind != "increment", 'take increments (imu.kind = "increment")'),
        (imu.stream != StreamSection(), "have no lost or late samples"),
        (imu.temperature_degC is not None, "know no temperature"),
        (mounted, "know no mounting of the IMU"),
        (config.imu != source and not mounted, "take the IMU as it is (no calibration, clock or rate entries)"),
        (config.gnss != plain, f"take GNSS as it comes (only {', '.join(kept[:-1])} and {kept[-1]})"),
        (tight and receiver is None, "need simulated satellites for tight coupling"),
        (
            tight and simulation.satellites is not None and simulation.satellites.give != "ranges",
            'take prepared ranges (satellites.give = "ranges")',
        ),
        (
            tight and (config.gnss.tight.carrier == "rtk" or "log" in (clock_noise, carrier_sigma)),
            "know no base station, and no noise that is left to the log",
        ),
        (tight and config.gnss.tight != whole, f"take all ranges as they are (in gnss.tight only {', '.join(_TIGHT)})"),
        (aids != AidingSection(), "have no aids but GNSS"),
        (
            receiver is not None and receiver.lever_arm_m != config.gnss.lever_arm_m,
            "need the true lever arm in the filter",
        ),
        (simulation.motion.earth_rotation != config.filter.earth_rotation, "need one Earth for truth and filter"),
    ):
        if wrong:
            return text
    return None
