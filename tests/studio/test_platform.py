"""The platform for the page: attitude and axes are those of the schedule."""

import numpy as np

from schuler.rotary.profiles import AngleProfile
from schuler.rotary.search.scenario import RotaryScenario
from schuler.studio.figures import platform_document
from schuler.studio.workspace import Workspace, write_mission


def test_frames_are_those_of_the_schedule(tmp_path):
    folder = Workspace(tmp_path.resolve())
    scenario = RotaryScenario.load(folder.inside(write_mission(folder, "rotary")))
    schedule = scenario.rotary.schedule.build()
    assert all(isinstance(profile, AngleProfile) for profile in schedule.profiles)
    document = platform_document(schedule, 300.0)
    t, C = np.array(document["t"]), np.array(document["C"]).reshape(-1, 3, 3)
    assert t[0] == 0.0
    assert abs(t[-1] - 18.0) < 0.5  # a turn at 20 deg/s
    assert np.allclose(C, schedule.C_bs(t), rtol=0.0, atol=3e-4)  # printed digits, of times too
    axes = np.array(document["axes"])
    assert axes.shape == (len(t), len(schedule.axes), 3)
    assert np.allclose(axes[:, 0], schedule.axes[0], rtol=0.0, atol=1e-4)  # printed digits
    if len(schedule.axes) == 1:  # an axis is where it was, whatever turns about it
        assert np.allclose(np.einsum("nij,j->ni", C, schedule.axes[0]), schedule.axes[0], rtol=0.0, atol=3e-4)
    view = np.array(document["view"])
    assert np.allclose(view @ view.T, np.eye(3), atol=1e-5)  # printed digits
