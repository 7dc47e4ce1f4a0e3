"""Which navigation jobs runs in lock-step can do, and their scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.navigation.config import GnssSection, ImuSection
from schuler.navigation.sections import AidingSection
from schuler.navigation.states import white_noise_psd
from schuler.simulation.aid_sections import StreamSection

if TYPE_CHECKING:
    from schuler.montecarlo.job import NavigationJob
    from schuler.montecarlo.lanes.run import LaneScenario
    from schuler.simulation.scenario import Mission

#: Terms of a specification that lanes do not have, and that are small beside the noise of most IMUs.
ROUNDING = ("resolution", "quantisation")
_SHARE, _MANY = 0.8, 6.0  # of a range, for motion and so many sigmas of bias; the rest is for noise


def lane_scenario(job: NavigationJob) -> LaneScenario | str:
    """Scenario for :func:`schuler.montecarlo.lanes.run.run_lanes`, or a sentence on what of the job lanes do not
    have.
    """
    from schuler.montecarlo.lanes.aiding import LaneAiding, true_gnss
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
    section = job.simulation.gnss
    try:
        aiding = LaneAiding.none()
        if section is not None and config.gnss.coupling == "loose":
            aiding = true_gnss(mission.motion, section.model(), use_velocity=config.gnss.velocity, gate=gate)
            begin, end = mission.ideal.t[[0, -1]]
            aiding = aiding.without(config.outages.resolve(float(begin), float(end)))
        rate = job.simulation.imu.rate_hz
        f = config.filter
        return LaneScenario(
            mission.ideal,
            LaneErrors.of_spec(mission.spec, rate, len(mission.ideal.gyro), left_out=left_out),
            aiding,
            plan.layout,
            plan.initial,
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
    imu, aids = simulation.imu, config.aiding
    plain = GnssSection(
        coupling=config.gnss.coupling, lever_arm_m=config.gnss.lever_arm_m, velocity=config.gnss.velocity,
        gate=config.gnss.gate,
    )  # fmt: skip
    mounted = any(imu.mount_rpy_deg) or any(config.imu.mount_rpy_deg)
    source = ImuSection(
        catalogue=config.imu.catalogue, spec=config.imu.spec, gyro=config.imu.gyro, accel=config.imu.accel
    )
    for wrong, text in (
        (config.gnss.coupling not in ("loose", "off"), f"know no coupling {config.gnss.coupling!r}"),
        (job.start is None, "do not align themselves; give the errors they start with (section [start])"),
        (imu.ideal, "need an IMU with errors"),
        (imu.kind != "increment", 'take increments (imu.kind = "increment")'),
        (imu.stream != StreamSection(), "have no lost or late samples"),
        (imu.temperature_degC is not None, "know no temperature"),
        (mounted, "know no mounting of the IMU"),
        (config.imu != source and not mounted, "take the IMU as it is (no calibration, clock or rate entries)"),
        (config.gnss != plain, "take GNSS as it comes (only coupling, lever_arm_m, velocity and gate)"),
        (aids != AidingSection(), "have no aids but GNSS"),
        (
            simulation.gnss is not None and simulation.gnss.lever_arm_m != config.gnss.lever_arm_m,
            "need the true lever arm in the filter",
        ),
        (simulation.motion.earth_rotation != config.filter.earth_rotation, "need one Earth for truth and filter"),
    ):
        if wrong:
            return text
    return None
