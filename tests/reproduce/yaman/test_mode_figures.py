"""Figures of modes on a drive, of a routine, and of one group of parameters: what is drawn is what was computed."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Line
from schuler.recording.series import ImuSeries
from schuler.reproduce.yaman.study.campaign_figures import family_figure
from schuler.reproduce.yaman.study.drive import Drive
from schuler.reproduce.yaman.study.figures import poses_figure, readings_figure
from schuler.reproduce.yaman.study.mode_figures import (
    attitude_figure,
    outage_figure,
    position_figure,
    velocity_figure,
)
from schuler.reproduce.yaman.study.modes import mode_solution
from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, simulated_unit
from schuler.sensors import catalogue
from schuler.simulation.routine import thesis_routine


@pytest.fixture(scope="module")
def drive():
    return Drive.of(1, rate_hz=20.0)


@pytest.fixture(scope="module")
def solutions(drive):
    return {
        "with": mode_solution(drive, "Partial", True, True),
        "without": mode_solution(drive, "Partial", True, False),
    }


def lines(panel, label):
    return [i for i in panel.items if isinstance(i, Line) and i.label == label]


def test_a_drive_ends_where_the_source_says(drive):
    for part in (drive.raw, drive.calibrated):
        assert part.imu.t[-1] == pytest.approx(561.0, abs=0.051)
        assert part.gnss.t[-1] <= 561.0
        assert part.reference.t[-1] == pytest.approx(561.0, abs=0.051)


def test_errors_through_the_outage_are_those_of_the_solutions(drive, solutions):
    truth = drive.raw.reference
    horizontal, vertical = outage_figure(solutions, truth, drive.outage).panels
    e = trajectory_errors(solutions["with"].trajectory, truth)
    (drawn,) = lines(horizontal, "with")
    at = np.searchsorted(e.t, drawn.x)
    np.testing.assert_allclose(drawn.y, np.maximum(e.horizontal[at], 1e-2))
    (drawn,) = lines(vertical, "without")
    assert drawn.x[0] >= drive.outage[0] - 20.0
    assert drawn.x[-1] <= drive.outage[1] + 20.0
    (claimed,) = lines(horizontal, "1 sigma as claimed")
    assert claimed.y.max() > 3.0 * claimed.y[0]


def test_positions_velocities_and_angles_are_drawn(drive, solutions):
    truth = drive.raw.reference
    figures = [
        position_figure(solutions, truth, drive.outage), velocity_figure(solutions, truth),
        attitude_figure(solutions, truth),
    ]  # fmt: skip
    for figure in figures:
        assert set(solutions) <= set(figure.legend())
        draw(figure).draw_without_rendering()
    down = figures[1].panels[2]
    assert len(lines(down, "reference")) == 1
    assert "±3 sigma of the first" in figures[2].legend()


def test_too_many_modes_are_refused(drive, solutions):
    many = {str(k): solutions["with"] for k in range(8)}
    for make in (position_figure, velocity_figure, attitude_figure):
        with pytest.raises(InputError, match="one to 7"):
            make(many, drive.raw.reference)
        with pytest.raises(InputError, match="one to 7"):
            make({}, drive.raw.reference)


def test_a_routine_shows_gravity_in_each_axis():
    """Every axis points up and down once, to 1e-9: rounding; readings reach gravity, to sculling of 2e-5."""
    routine = thesis_routine(repeats=1)
    figure = poses_figure(routine)
    for panel in figure.panels:
        (up,) = [i.y for i in panel.items if isinstance(i, Line)]
        assert np.nanmax(up) == pytest.approx(1.0, abs=1e-9)
        assert np.nanmin(up) == pytest.approx(-1.0, abs=1e-9)
    draw(figure).draw_without_rendering()
    ideal = FieldJob(catalogue.spec("yaman-automotive"), routine=routine, rate_hz=20.0).ideal
    force, rate = readings_figure(ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment")).panels
    assert max(np.abs(i.y).max() for i in force.items) == pytest.approx(9.7985, abs=1e-3)
    assert max(i.y.max() for i in rate.items) == pytest.approx(48.0, rel=1e-2)


def test_a_family_has_estimates_beside_what_is_left():
    job = FieldJob(catalogue.spec("yaman-automotive"), routine=thesis_routine(repeats=1), rests="given", rate_hz=50.0)
    (imu, _), truth, heading = simulated_unit(job, np.random.SeedSequence(1))
    result = calibrated(job, imu, heading)
    figure = family_figure(result, ("M_g_xy", "M_g_zy"), truth, "two rows")
    assert [p.title for p in figure.panels] == ["M_g_xy, M_g_xz"] * 2 + ["M_g_zx, M_g_zy"] * 2
    assert figure.columns == 2
    left = figure.panels[1]
    k = result.history.names.index("M_g_xy")
    np.testing.assert_allclose(lines(left, "first")[0].y, result.history.normalised[:, k])
    draw(figure).draw_without_rendering()
    with pytest.raises(InputError, match="names: expected some of"):
        family_figure(result, ("b_x",))
