"""Rotation routines: times and poses of the thesis, and a motion whose derivatives are exact."""

import re

import numpy as np
import pytest
from places import ROOT

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import ImuSeries
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import ideal_rates
from schuler.simulation.routine import RoutineMotion, free_routine, six_face_routine, thesis_routine
from schuler.simulation.steps import Rest, Routine, Turn, pose_in_words, turn_in_words
from schuler.units import DEG

LLH = np.array([39.92 * DEG, 33.2 * DEG, 900.0])
PAGE = ROOT / "docs" / "field-routine.md"


def one_turn(**options) -> Routine:
    return Routine((Rest(1.0), Turn(**{"axis": "x", "angle": 1.0, "duration_s": 2.0} | options), Rest(1.0)))


def test_times_of_the_thesis_routine():
    """Yaman: 90 s an axis, 270 s a set, 540 s; 36 deg/s in the mean of a turn. Rounding of sums."""
    routine = thesis_routine()
    assert routine.duration == pytest.approx(540.0, abs=1e-9)
    assert thesis_routine(repeats=1).duration == pytest.approx(270.0, abs=1e-9)
    assert thesis_routine(dwell_s=20.0, step=30.0 * DEG, repeats=1).duration == pytest.approx(3 * 12 * 21.25, abs=1e-9)
    np.testing.assert_allclose(routine.rests[0], (0.0, 10.0))
    turns = [step for step in routine.steps if isinstance(step, Turn)]
    np.testing.assert_allclose([abs(turn.angle) / turn.duration_s for turn in turns], 36.0 * DEG)
    first = [start for turn, start in zip(turns, routine.turns[:, 0], strict=True) if turn.axis == "x"]
    np.testing.assert_allclose(first[0], 10.0)
    np.testing.assert_allclose(first[8], 280.0)
    # rests and turns take turns, and fill the time
    assert len(routine.rests) == 53
    assert len(routine.turns) == 52
    np.testing.assert_allclose(routine.rests[:-1, 1], routine.turns[:, 0])
    np.testing.assert_allclose(routine.rests[1:, 0], routine.turns[:, 1])


@pytest.mark.parametrize("routine", [thesis_routine(), six_face_routine()])
def test_every_axis_is_turned_through_a_circle_while_it_is_horizontal(routine):
    total = dict.fromkeys("xyz", 0.0)
    for turn, C in zip(routine.steps, routine.attitudes[:-1], strict=True):
        if isinstance(turn, Turn):
            assert abs(C[2] @ turn.unit) < 1e-12  # rounding
            total[turn.axis] += turn.angle
    sets = total["x"] / (2.0 * np.pi)
    np.testing.assert_allclose(list(total.values()), 2.0 * np.pi * sets, atol=1e-12)
    np.testing.assert_allclose(routine.attitudes[-1], np.eye(3), atol=1e-12)  # level again, heading north


def test_poses_of_the_routines():
    """Six faces and twelve edges; gravity's magnitude then determines nine accelerometer parameters, with faces six."""
    for routine, faces, edges, rank in ((thesis_routine(), 6, 12, 9), (six_face_routine(), 6, 0, 6)):
        down = np.unique(np.round(routine.poses[:, 2], 6) + 0.0, axis=0)
        assert np.count_nonzero(np.isclose(np.abs(down).max(axis=1), 1.0)) == faces
        assert np.count_nonzero(np.isclose(np.abs(down).max(axis=1), np.sqrt(0.5), atol=1e-5)) == edges
        assert len(down) == faces + edges
        i, j = np.triu_indices(3)
        assert np.linalg.matrix_rank(np.column_stack((down, down[:, i] * down[:, j])), tol=1e-6) == rank
    assert six_face_routine().duration == pytest.approx(150.0)


def test_words():
    lines = thesis_routine().describe().splitlines()
    assert len(lines) == 105
    assert lines[0].split() == ["1.", "0.0", "s", "rest", "10", "s:", "level", "(z", "down)"]
    assert "turn 45 deg about x in 1.25 s, clockwise seen along x" in lines[1]
    assert lines[2].endswith("halfway between right side down (y down) and level (z down)")
    assert lines[34].endswith("nose up (x up)")
    assert pose_in_words((0.0, -9.8, 0.3)) == "left side down (y up)"
    assert pose_in_words((0.0, 0.35, -1.0)) == "upside down (z up), leaning towards right side down (y down)"
    assert pose_in_words((-1.0, 1.1, 0.9)).startswith("oblique, towards right side down")
    assert turn_in_words(Turn((0.0, 3.0, 4.0), -0.5, 2.0)) == (
        "turn 29 deg about the axis (0.00, 0.60, 0.80) in 2 s, anticlockwise seen along it"
    )
    with pytest.raises(InputError, match="direction"):
        pose_in_words((0.0, 0.0, 0.0))


def test_rolling_to_the_right_puts_the_right_side_down():
    """Signs: positive about x lowers the right side, about y raises the nose, about z turns the nose to the right."""
    for axis, word in (("x", "right side down"), ("y", "nose up")):
        assert word in pose_in_words(Routine((Turn(axis, 90.0 * DEG, 1.0),)).attitudes[-1, 2])
    nose = Routine((Turn("z", 90.0 * DEG, 1.0),)).attitudes[-1][:, 0]
    np.testing.assert_allclose(nose, (0.0, 1.0, 0.0), atol=1e-15)  # east


def test_rests_in_a_row_are_one():
    routine = Routine((Rest(1.0), Rest(2.0), Turn("x", 1.0, 1.0), Turn("y", 1.0, 1.0), Rest(0.5)))
    np.testing.assert_allclose(routine.rests, [(0.0, 3.0), (5.0, 5.5)])
    np.testing.assert_allclose(routine.turns, [(3.0, 4.0), (4.0, 5.0)])
    assert routine.poses.shape == (2, 3, 3)
    assert Routine((Turn("x", 1.0, 1.0),)).rests.shape == (0, 2)


MOTIONS = {
    "thesis": RoutineMotion(thesis_routine(repeats=1), LLH),
    "lever": RoutineMotion(one_turn(ramp=0.1), LLH, (0.3, -0.2, 0.1)),
    "hand": RoutineMotion(
        Routine(
            (
                Turn((1.0, 2.0, -1.0), 2.5, 1.5, 0.2, 0.7, 0.3, (0.1, -0.2, 0.3)),
                Turn("z", -1.0, 1.0, 0.5, -0.8, -0.2, (0.3, 0.1, 0.0)),
                Rest(1.0),
            ),
            (0.4, -0.3, 2.0),
        ),
        LLH,
        (0.05, 0.1, -0.2),
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_derivatives_are_those_of_attitude_and_position(name):
    """Central differences of 0.1 ms: rounding of Earth-fixed metres, and h^2/6 of the derivative after the next."""
    motion, h = MOTIONS[name], 1e-4
    t = np.linspace(2.0 * h, motion.duration - 2.0 * h, 3001)
    before, now, after = (motion.state(t + s) for s in (-h, 0.0, h))
    C_dot = (after.C_eb - before.C_eb) / (2.0 * h)
    omega = rotation.unskew(np.einsum("nji,njk->nik", now.C_eb, C_dot))
    np.testing.assert_allclose(omega, now.omega_eb_b, atol=2e-6)
    np.testing.assert_allclose((after.r_eb_e - before.r_eb_e) / (2.0 * h), now.v_eb_e, atol=5e-6)
    np.testing.assert_allclose((after.v_eb_e - before.v_eb_e) / (2.0 * h), now.a_eb_e, atol=5e-5)
    assert np.abs(np.einsum("nij,nkj->nik", now.C_eb, now.C_eb) - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("name", MOTIONS)
def test_rate_and_acceleration_are_continuous(name):
    motion = MOTIONS[name]
    for edge in motion.routine.limits[1:-1]:
        state = motion.state(edge + np.array([-1e-9, 1e-9]))
        np.testing.assert_allclose(state.omega_eb_b, 0.0, atol=1e-6)
        np.testing.assert_allclose(state.a_eb_e, 0.0, atol=1e-6)
        np.testing.assert_allclose(np.diff(state.C_eb, axis=0), 0.0, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"ramp": 0.5}, {"skew": 0.9}, {"skew": -0.5, "wobble": 0.4}, {"wobble": -1.0}])
def test_a_turn_ends_where_it_should(options):
    """Whatever happens on the way. Rounding."""
    motion = RoutineMotion(one_turn(angle=-2.0, **options), LLH)
    C = motion.state(np.array([0.5, 3.5])).C_nb
    np.testing.assert_allclose(C[0].T @ C[1], rotation.dcm_from_rotvec((-2.0, 0.0, 0.0)), atol=1e-14)


def test_at_constant_rate_the_lever_feels_centripetal_acceleration():
    """In the middle of a turn about x: f = C^T (0, 0, -g) + omega x (omega x l). Rounding."""
    motion = RoutineMotion(one_turn(), LLH, (0.3, 0.4, 0.0))
    w = 1.0 / (2.0 * 0.75)  # angle over duration, less half of the ramps
    state = motion.state(np.array([1.8, 2.0, 2.2]))
    np.testing.assert_allclose(state.omega_eb_b, np.tile((w, 0.0, 0.0), (3, 1)), atol=1e-13)
    _, f = ideal_rates(motion, np.array([1.8, 2.0, 2.2]), earth_rotation=False)
    expected = -np.einsum("nji,nj->ni", state.C_eb, earth.gravity_ecef(state.r_eb_e)) + (0.0, -0.4 * w**2, 0.0)
    np.testing.assert_allclose(f, expected, atol=1e-12)


def test_specific_force_is_gravity_while_turning_in_place():
    motion = MOTIONS["thesis"]
    _, f = ideal_rates(motion, np.arange(0.0, 270.0, 0.05))
    g = np.linalg.norm(earth.gravity_ecef(frames.ecef_from_llh(LLH)))
    np.testing.assert_allclose(np.linalg.norm(f, axis=1), g, rtol=1e-12)


def test_position_follows_the_hand_and_the_lever():
    motion = MOTIONS["hand"]
    r = motion.state(np.array([0.0, motion.duration])).r_eb_e - frames.ecef_from_llh(LLH)
    r_n = r @ frames.C_en(LLH)
    lever = np.array(motion.lever_m)
    np.testing.assert_allclose(r_n[0], motion.routine.attitudes[0] @ lever, atol=1e-8)  # rounding of 6e6 m
    np.testing.assert_allclose(r_n[1], (0.4, -0.1, 0.3) + motion.routine.attitudes[-1] @ lever, atol=1e-8)


@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(RoutineMotion(thesis_routine(), LLH, (0.1, 0.05, -0.1)), marks=pytest.mark.campaign),
        RoutineMotion(free_routine(np.random.default_rng(4), poses=16, hand_m=0.3), LLH, (0.05, -0.1, 0.03)),
    ],
    ids=["thesis", "free"],
)
def test_an_ideal_imu_mechanizes_back_to_rest(motion):
    """Discretisation: 4 mm and 0.05 mm/s after nine minutes at 100 Hz, less than a third of it at 200 Hz."""
    error = []
    for rate_hz in (100.0, 200.0):
        ideal = ideal_imu(motion, rate_hz)
        true = ideal.truth
        log = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment")
        path = mechanize(log.increments(), NavState(0.0, true.r_eb_e[0], true.v_eb_e[0], true.q_eb[0]))
        error.append(
            (
                np.abs(path.r_eb_e - true.r_eb_e[1:]).max(),
                np.linalg.norm(path.v_eb_e[-1]),
                np.abs(rotation.quat_multiply(rotation.quat_conjugate(path.q_eb[-1]), true.q_eb[-1])[1:]).max(),
            )
        )
    assert error[0][0] < 8e-3
    assert error[0][1] < 1e-4
    assert error[0][2] < 1e-7
    assert error[1][0] < error[0][0] / 3.0


def test_free_routines():
    a, b, c = (free_routine(np.random.default_rng(seed), poses=30, hand_m=0.5) for seed in (1, 1, 2))
    assert a == b
    assert a != c
    assert len(a.rests) == 30
    assert np.diff(a.rests[0]) == 15.0
    assert np.all((np.diff(a.rests[1:], axis=1) >= 4.0) & (np.diff(a.rests[1:], axis=1) <= 8.0))
    # in every octant, and the hand comes back
    assert len({tuple(np.sign(row)) for row in a.poses[:, 2]}) >= 8
    place = np.cumsum([step.shift_m for step in a.steps if isinstance(step, Turn)], axis=0)
    assert np.linalg.norm(place, axis=1).max() <= 0.5
    still = RoutineMotion(a, LLH).state(a.rests.mean(axis=1))
    np.testing.assert_allclose(still.omega_eb_b, 0.0, atol=1e-15)
    np.testing.assert_allclose(still.v_eb_e, 0.0, atol=1e-15)
    turns = [step for step in free_routine(np.random.default_rng(3)).steps if isinstance(step, Turn)]
    assert not any(np.any(turn.shift_m) for turn in turns)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Rest(0.0), "positive time"),
        (lambda: Turn("x", 1.0, -1.0), "positive time"),
        (lambda: Turn("w", 1.0, 1.0), "expected 'x', 'y', 'z' or a vector"),
        (lambda: Turn((0.0, 0.0, 0.0), 1.0, 1.0), "zero length"),
        (lambda: Turn("x", np.nan, 1.0), "finite angles"),
        (lambda: Turn("x", 1.0, 1.0, ramp=0.6), "ramp"),
        (lambda: Turn("x", 1.0, 1.0, skew=1.0), "skew"),
        (lambda: Routine(()), "at least one"),
        (lambda: thesis_routine(step=50.0 * DEG), "circle divided"),
        (lambda: thesis_routine(step=0.0), "circle divided"),
        (lambda: thesis_routine(dwell_s=0.5), "longer rests or faster turns"),
        (lambda: thesis_routine(repeats=0), "1 or more"),
        (lambda: six_face_routine(turn_s=0.0), "positive time"),
        (lambda: free_routine(np.random.default_rng(1), poses=1), "2 or more"),
        (lambda: free_routine(np.random.default_rng(1), dwell_s=(5.0, 2.0)), "smaller one first"),
        (lambda: free_routine(np.random.default_rng(1), uneven=1.0), "uneven"),
        (lambda: RoutineMotion(thesis_routine(), LLH).state(np.array([541.0])), "lasts 540"),
    ],
)
def test_errors_say_what_was_expected(make, match):
    with pytest.raises(InputError, match=match):
        make()


def test_examples_of_the_page_run(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), {})
    assert "intervals at rest" in capsys.readouterr().out
