"""A log as it was recorded: every sample, its spectrogram; and cutting it."""

import base64
import gzip
from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.plotting.figure import Picture
from schuler.plotting.interactive import panel_data
from schuler.recording import GnssSeries, ImuSeries, Recording, Trajectory
from schuler.recording.figures import log_content, spectrogram_content

N, RATE = 40_000, 100.0


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(5)
    t = np.arange(N) / RATE
    accel = rng.normal((0.0, 0.0, -9.8), 0.02, (N, 3))
    gyro = rng.normal(0.0, 1e-3, (N, 3))
    accel[t > 200.0, 1] += 0.5 * np.sin(2.0 * np.pi * 17.0 * t[t > 200.0])  # an engine is started
    gyro[12_345, 2] = 1.0  # a bump
    imu = ImuSeries(t, gyro, accel)
    fixes = np.arange(0.0, 400.0)
    llh = np.tile([0.8, 0.2, 300.0], (len(fixes), 1))
    gnss = GnssSeries(fixes, llh, np.tile(np.eye(3), (len(fixes), 1, 1)))
    reference = Trajectory.from_geodetic(fixes, llh)
    return Recording(imu=imu, gnss=gnss, reference=reference)


def unpacked(packed):
    """Numbers as the script of the page makes them."""
    planes = np.frombuffer(gzip.decompress(base64.b64decode(packed["data"])), dtype=np.uint8).reshape(4, -1)
    folded = np.ascontiguousarray(planes.T).view("<u4").ravel().astype(np.int64)
    change = np.where(folded % 2, -(folded + 1) // 2, folded // 2)
    return packed["zero"] + packed["step"] * np.cumsum(change)


def test_a_page_holds_every_sample_rounded_below_what_can_be_seen(recording):
    figure = log_content(recording)
    for panel, columns in zip(figure.panels, (recording.imu.accel, np.degrees(recording.imu.gyro)), strict=False):
        for k, packed in panel_data(figure, panel)["samples"].items():
            t, y = unpacked(packed["t"]), unpacked(packed["y"])
            assert packed["each"] == 1
            assert np.allclose(t, recording.imu.t, atol=0.1 / RATE)
            change = np.median(np.abs(np.diff(columns[:, k])))
            assert np.abs(y - columns[:, k]).max() <= 0.26 * change  # rounding: half of the step, which is half of it


def test_samples_that_are_too_many_become_extremes_and_no_spike_is_lost(recording, monkeypatch):
    monkeypatch.setattr("schuler.plotting.interactive._SAMPLES", 60_000)
    figure = log_content(recording)
    packed = panel_data(figure, figure.panels[1])["samples"][2]
    y = unpacked(packed["y"])
    assert packed["each"] > 1
    assert len(y) == 2 * packed["n"]
    assert y.max() == pytest.approx(np.degrees(1.0), abs=1.0)
    assert (y[1::2] >= y[0::2]).all()


def test_a_spectrogram_shows_when_an_engine_was_started_and_at_which_frequency(recording):
    figure = spectrogram_content(recording.imu, 0.0)
    picture = next(item for item in figure.panels[0].items if isinstance(item, Picture))
    light = picture.pixels[..., :3].astype(float).sum(axis=2)
    rows, columns = light.shape
    frequency = (1.0 - (np.arange(rows) + 0.5) / rows) * 0.5 * RATE
    after, before = light[:, int(0.6 * columns) :].mean(axis=1), light[:, : int(0.4 * columns)].mean(axis=1)
    assert frequency[np.argmax(after - before)] == pytest.approx(17.0, abs=1.0)


def test_a_log_too_short_has_no_spectrogram():
    imu = ImuSeries(np.arange(20) / RATE, np.zeros((20, 3)), np.zeros((20, 3)))
    assert spectrogram_content(imu, 0.0) is None


def test_a_part_has_the_samples_of_all_series_between_two_times(recording):
    part = recording.between(100.0, 150.0)
    assert (part.imu.t[0], part.imu.t[-1]) == pytest.approx((100.0, 150.0))
    assert (part.gnss.t[0], part.gnss.t[-1]) == (100.0, 150.0)
    assert (part.reference.t[0], part.reference.t[-1]) == (100.0, 150.0)
    again = recording.between(100.5, 149.5).reference
    assert (again.t[0], again.t[-1]) == (100.0, 150.0)  # interpolated: one more on either side


def test_a_part_outside_of_the_log_is_an_error_that_says_what_there_is(recording):
    with pytest.raises(InputError, match=r"0\.000\.\.399\.990 s"):
        recording.between(500.0, 600.0)
    with pytest.raises(InputError, match="no sample within"):
        replace(recording, imu=None).between(500.0, 600.0)


def test_plot_draws_a_panel_for_everything_there_is(recording):
    figure = recording.plot()
    assert [a.get_ylabel() for a in figure.axes] == ["specific force [m/s²]", "angular rate [deg/s]", "height [m]"]
