"""Sections of a scenario's file: what they build, and what they say of mistakes."""

import numpy as np
import pytest

from schuler.exceptions import ConfigError
from schuler.navigation.sections import Config
from schuler.rotary import schemes
from schuler.rotary.platform_usage import usage
from schuler.rotary.sections import EncoderSection, LimitsSection, RotarySection, ScheduleSection
from schuler.simulation.motion import StaticMotion
from schuler.units import DEG

T = np.linspace(0.0, 100.0, 301)
W, A = 10.0 * DEG, 5.0 * DEG
SAME = [
    ({"type": "fixed", "angle_deg": 30.0, "axis": "y"}, schemes.fixed("y", 30.0 * DEG)),
    ({"type": "continuous", "axis": "du-Z", "rate_deg_s": 10.0}, schemes.continuous("-z", W)),
    ({"type": "continuous", "axis": [1, 1, 0], "rate_deg_s": -10.0, "acceleration_deg_s2": 5.0, "start_s": 3.0},
     schemes.continuous([1.0, 1.0, 0.0], -W, acceleration=A, start=3.0)),
    ({"type": "reciprocating", "axis": "du-X", "rate_deg_s": 10.0, "turn_deg": 90.0, "both_sides": True,
      "dwell_s": 1.0},
     schemes.reciprocating("y", W, turn=90.0 * DEG, both_sides=True, dwell=1.0)),
    ({"type": "carousel", "rate_deg_s": 10.0, "limit_deg": 100.0, "acceleration_deg_s2": 5.0},
     schemes.carousel("z", W, limit=100.0 * DEG, acceleration=A)),
    ({"type": "dwell", "rate_deg_s": 10.0, "dwell_s": 2.0, "positions": 8, "back": False},
     schemes.dwell("z", 8, dwell=2.0, rate=W, back=False)),
    ({"type": "dwell", "rate_deg_s": 10.0, "dwell_s": 2.0, "positions_deg": [0.0, 90.0, -45.0]},
     schemes.dwell("z", [0.0, 90.0 * DEG, -45.0 * DEG], dwell=2.0, rate=W)),
    ({"type": "dual_axis", "rate_deg_s": 10.0, "dwell_s": 2.0, "positions": 16, "axes": ["du-X", "du-Z"]},
     schemes.dual_axis(16, dwell=2.0, rate=W, outer="y", inner="-z")),
    ({"type": "sequence", "rate_deg_s": 10.0, "axes": ["x", "z"], "repeat": False,
      "moves": [{"axis": 1, "turn_deg": 90.0, "dwell_s": 3.0}, {"turn_deg": -45.0}]},
     schemes.sequence(["x", "z"], [(1, 90.0 * DEG, 3.0), (0, -45.0 * DEG, 0.0)], rate=W, repeat=False)),
    ({"type": "rates", "t_s": [0.0, 2.0, 4.0], "rates_deg_s": [0.0, 10.0, 5.0]},
     schemes.from_rates("z", [0.0, 2.0, 4.0], np.array([0.0, 10.0, 5.0]) * DEG)),
    ({"type": "rates", "t_s": [0.0, 2.0, 4.0], "rates_deg_s": [0.0, 10.0, 5.0], "repeat": True},
     schemes.from_rates("z", [0.0, 2.0, 4.0], np.array([0.0, 10.0, 5.0]) * DEG, repeat=True)),
    ({"type": "continuous", "rate_deg_s": 10.0, "tilt_deg": 30.0, "tilt_axis": "du-X"},
     schemes.tilted(schemes.continuous("z", W), "y", 30.0 * DEG)),
]  # fmt: skip


@pytest.mark.parametrize(("entries", "schedule"), SAME, ids=[f"{k} {e['type']}" for k, (e, _) in enumerate(SAME)])
def test_a_section_builds_the_scheme_it_names(entries, schedule):
    built = ScheduleSection.model_validate(entries).build()
    np.testing.assert_allclose(built.C_bs(T), schedule.C_bs(T), atol=1e-12)
    np.testing.assert_allclose(built.omega_bs_s(T), schedule.omega_bs_s(T), atol=1e-12)
    assert usage(built, 100.0).travel.sum() == pytest.approx(usage(schedule, 100.0).travel.sum())


def test_a_mounting_is_the_imu_in_the_innermost_frame():
    built = ScheduleSection.model_validate({"type": "fixed", "mount_rpy_deg": [0.0, 0.0, 90.0]}).build()
    np.testing.assert_allclose(built.C_bs([0.0])[0] @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


class File(Config):
    rotary: RotarySection


def test_a_whole_section():
    file = File.parse(
        {"rotary": {"schedule": {"type": "continuous", "rate_deg_s": 20.0}, "offset_m": [0.05, 0.0, 0.0],
                    "encoder": {"rate_hz": 100.0, "resolution_deg": 0.01, "time_offset_s": 0.005},
                    "limits": {"rate_deg_s": 60.0, "angle_deg": 720.0}}}
    )  # fmt: skip
    motion = file.rotary.build(StaticMotion(np.zeros(3), np.zeros(3), 10.0))
    np.testing.assert_array_equal(motion.offset_m, [0.05, 0.0, 0.0])
    assert motion.schedule.rates([1.0])[0, 0] == pytest.approx(20.0 * DEG)
    encoder = file.rotary.encoder.build()
    assert encoder.interval == 0.01
    assert encoder.resolution == pytest.approx(0.01 * DEG)
    assert encoder.time_offset == 0.005
    assert file.rotary.limits is not None
    limits = file.rotary.limits.build()
    assert limits.rate == pytest.approx(60.0 * DEG)
    assert limits.angle == pytest.approx(4.0 * np.pi)
    assert np.isinf(limits.acceleration)
    assert np.isinf(LimitsSection().build().angle)
    assert EncoderSection().build().interval == 0.02


@pytest.mark.parametrize(
    ("schedule", "message"),
    [
        ({"type": "continuous"}, "needs rate_deg_s"),
        ({"type": "continuous", "rate_deg_s": 1.0, "dwell_s": 2.0}, "has no dwell_s"),
        ({"type": "carousel", "rate_deg_s": 1.0}, "needs limit_deg"),
        ({"type": "dwell", "rate_deg_s": 1.0, "dwell_s": 1.0, "positions": 4, "positions_deg": [0, 1]}, "positions or"),
        ({"type": "dual_axis", "rate_deg_s": 1.0, "dwell_s": 1.0, "axes": ["x"]}, "two axes"),
        ({"type": "dual_axis", "rate_deg_s": 1.0, "dwell_s": 1.0, "positions": 5}, "4, 8 or 16"),
        ({"type": "spinning"}, "type"),
        ({"type": "continuous", "rate_deg_s": 1.0, "axis": "Z"}, "axis"),
        ({"type": "continuous", "rate_degs": 1.0}, "did you mean rate_deg_s"),
    ],
)
def test_mistakes_are_told_in_words(schedule, message):
    with pytest.raises(ConfigError, match=message):
        File.parse({"rotary": {"schedule": schedule}})
