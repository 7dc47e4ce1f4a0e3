"""Wrong arguments in Python: one sentence that says what was expected, what came, and what to do."""

import numpy as np
import pytest

import schuler
from schuler.exceptions import InputError

CONFIG = {"imu": {"catalogue": "MTi-G-710"}}


@pytest.fixture
def recording():
    t = np.arange(100) * 0.01
    return schuler.Recording(imu=schuler.ImuSeries(t, np.zeros((100, 3)), np.tile([0.0, 0.0, -9.8], (100, 1))))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: schuler.navigate("town.parquet", CONFIG), r"navigate: .* got str, .*schuler.read\('town.parquet'\)"),
        (lambda r: schuler.navigate(r.imu, CONFIG), r"got ImuSeries, make one of it: schuler.Recording\(imu="),
        (lambda r: schuler.navigate(CONFIG, r), "navigate: expected a Recording, got dict"),
        (lambda r: schuler.apply_calibration(r, r.imu), "apply_calibration: expected a Recording, got ImuSeries"),
        (lambda r: schuler.calibrate_freepose(r), "got Recording, give its series: recording.imu"),
        (lambda r: schuler.calibrate_ferraris(r), "calibrate_ferraris: expected an ImuSeries, got Recording"),
        (
            lambda r: schuler.calibrate_field(r, None, latitude=0.8),
            "calibrate_field: expected an ImuSeries, got Recording",
        ),
        (lambda r: schuler.NavigationConfig(), "NavigationConfig: imu: missing"),
    ],
)
def test_what_is_of_another_kind_is_one_sentence(recording, call, message):
    with pytest.raises(InputError, match=message):
        call(recording)
