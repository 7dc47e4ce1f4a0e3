"""Routines of rests and turns in scenarios."""

import numpy as np
import pytest
from places import ROOT

from schuler.exceptions import ConfigError
from schuler.simulation.motion import ideal_rates
from schuler.simulation.routine import RoutineMotion, six_face_routine, thesis_routine
from schuler.simulation.scenario import Scenario
from schuler.simulation.steps import Rest, Routine, Turn
from schuler.units import DEG

EXAMPLE = ROOT / "examples" / "field_routine.toml"


def motion(**entries):
    data = {"motion": {"type": "routine", "lat_deg": 40.0, "lon_deg": 33.0, **entries}, "imu": {"ideal": True}}
    return Scenario.parse(data).motion.build()


def test_the_example_is_the_routine_of_the_thesis():
    built = Scenario.load(EXAMPLE).motion.build()
    assert isinstance(built, RoutineMotion)
    assert built.duration == 540.0
    assert built.routine.steps == thesis_routine().steps
    np.testing.assert_allclose(built.routine.rpy_nb, [0.0, 0.0, 30.0 * DEG])
    np.testing.assert_allclose(built.llh, [39.92 * DEG, 33.2 * DEG, 1000.0])


@pytest.mark.parametrize(
    ("entries", "routine"),
    [
        ({"repeats": 1, "dwell_s": 6.0, "turn_s": 2.0}, thesis_routine(dwell_s=6.0, turn_s=2.0, repeats=1)),
        ({"routine": "six_faces"}, six_face_routine()),
        ({"routine": "six_faces", "repeats": 2}, six_face_routine(repeats=2)),
        (
            {"steps": [{"rest_s": 3.0}, {"axis": "x", "turn_deg": 90.0, "duration_s": 2.0}, {"rest_s": 1.0}]},
            Routine((Rest(3.0), Turn("x", 90.0 * DEG, 2.0), Rest(1.0))),
        ),
        (
            {"steps": [{"rest_s": 1.0}, {"axis": [0.0, 3.0, 4.0], "turn_deg": -30.0, "duration_s": 2.0}]},
            Routine((Rest(1.0), Turn((0.0, 0.6, 0.8), -30.0 * DEG, 2.0))),
        ),
    ],
)
def test_entries_make_the_routine(entries, routine):
    assert motion(**entries).routine.steps == routine.steps


def test_it_ends_as_it_is_turned_and_the_lever_is_felt():
    """Closed forms: attitude after the turn; at its fastest the IMU feels the square of the rate times the lever."""
    steps = [{"rest_s": 2.0}, {"axis": "z", "turn_deg": 180.0, "duration_s": 2.0}, {"rest_s": 2.0}]
    built = motion(steps=steps, rpy_deg=[0.0, 0.0, 20.0], lever_m=[0.1, 0.0, 0.0])
    t = np.array([0.0, 3.0, 6.0])
    state = built.state(t)
    # the vertical of a place 0.1 m away differs by that over the Earth's radius
    np.testing.assert_allclose(state.rpy_nb[[0, 2]], [[0, 0, 20 * DEG], [0, 0, -160 * DEG]], atol=2e-8)
    omega, f = ideal_rates(built, t)
    np.testing.assert_allclose(f[0, :2], 0.0, atol=1e-4)  # gravity's deflection at height zero, and Earth rate
    peak = np.pi / (2.0 * 0.75)  # ramps of a quarter of the duration
    assert omega[1, 2] - omega[0, 2] == pytest.approx(peak, rel=1e-6)
    assert f[1, 0] == pytest.approx(-(peak**2) * 0.1, rel=1e-3)  # towards the axis; Coriolis and curvature apart


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"steps": [{"rest_s": 1.0, "axis": "x"}]}, "give rest_s, or axis, turn_deg and duration_s"),
        ({"steps": [{"axis": "x", "turn_deg": 10.0}]}, "give rest_s, or axis, turn_deg and duration_s"),
        ({"steps": [{}]}, "give rest_s, or axis, turn_deg and duration_s"),
        ({"routine": "nine_faces"}, "routine"),
        ({"repeats": 0}, "repeats"),
        ({"steps": [{"axis": "w", "turn_deg": 10.0, "duration_s": 1.0}]}, "axis"),
    ],
)
def test_faulty_entries(entries, message):
    with pytest.raises(ConfigError, match=message):
        motion(**entries)
