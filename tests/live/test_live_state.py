"""A live run that was saved goes on with the same numbers; a file that is none is refused."""

import json

import live_cases as cases
import numpy as np
import pytest
from result_cases import calibration

from schuler.exceptions import FileFormatError, InputError
from schuler.live import LiveNavigator

CONFIG = {**cases.CONFIG, "aiding": {"zero_velocity": {}, "zero_rate": {}, "non_holonomic": {}}}


@pytest.fixture(scope="module")
def recording():
    return cases.drive()


def part(live, recording, start, stop):
    """Feed the messages of a stretch; the solution at its end."""
    imu, waiting = recording.imu, [f for f in cases.fixes(recording) if start < f.t <= stop]
    rows = np.flatnonzero((imu.t > start) & (imu.t <= stop))
    for k in range(0, len(rows), 20):
        at = rows[k : k + 20]
        live.imu_many(imu.t[at], imu.gyro[at], imu.accel[at], np.full(len(at), 21.0))
        while waiting and waiting[0].t <= imu.t[at][-1]:
            live.take(waiting.pop(0))
    return live.solution()


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "at",
    [
        pytest.param(10.005, marks=pytest.mark.campaign),
        30.005,
        47.005,
        pytest.param(90.005, marks=pytest.mark.campaign),
    ],
)
def test_a_restart_goes_on_to_the_same_last_bit(recording, tmp_path, at):
    """Saved while it collects, while its start may be revised, at rest, and long after."""
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    part(live, recording, 0.0, at)
    other = LiveNavigator.load(live.save(tmp_path / "state"))
    ends = [part(run, recording, at, 110.0) for run in (live, other)]
    for name in ("llh", "v_eb_n", "rpy_nb", "sigma_r_n"):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name))
    np.testing.assert_array_equal(live.covariance, other.covariance)
    assert ends[0].health == ends[1].health == "ok"
    files = [run.save(tmp_path / name).read_bytes() for run, name in ((live, "one"), (other, "two"))]
    assert files[0] == files[1]
    assert "goes on from the state" in other.events[0].text


def test_a_late_fix_is_made_good_across_a_restart(recording, tmp_path):
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    part(live, recording, 0.0, 80.0)
    other = LiveNavigator.load(live.save(tmp_path / "state"))
    fix = next(f for f in cases.fixes(recording) if f.t > 78.0)
    late = type(fix)(fix.t + 0.1, fix.llh, fix.cov_r_n)
    for run in (live, other):
        run.take(late)
    np.testing.assert_array_equal(live.solution().llh, other.solution().llh)


def test_a_file_that_is_none_is_refused(recording, tmp_path):
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    part(live, recording, 0.0, 30.0)
    path = live.save(tmp_path / "state")
    text = path.read_text()
    (tmp_path / "cut").write_text(text[: len(text) // 2])
    (tmp_path / "changed").write_text(text.replace('"health":"ok"', '"health":"OK"'))
    head, _, rest = text.partition("\n")
    (tmp_path / "newer").write_text(json.dumps({**json.loads(head), "format": "schuler/live/9"}) + "\n" + rest)
    for name in ("cut", "changed", "newer", "absent"):
        with pytest.raises(FileFormatError):
            LiveNavigator.load(tmp_path / name)


def test_another_calibration_is_refused(recording, tmp_path):
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    part(live, recording, 0.0, 30.0)
    path = live.save(tmp_path / "state")
    with pytest.raises(InputError, match="give the same"):
        LiveNavigator.load(path, calibration=calibration(sigma=1e-3))
