"""Wrong arguments of ``schuler.*`` are said in a sentence; an error inside of a right call passes as it is."""

import contextlib
import inspect
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import schuler
from schuler.arguments import explains_arguments
from schuler.calibration import result_from
from schuler.exceptions import InputError, SchulerError
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

IMU = ImuSeries(np.arange(300) / 100.0, np.zeros((300, 3)), np.full((300, 3), -9.8))
WRONG = (3, None, Recording(IMU), "nowhere.csv", [Recording(IMU)], {"a": 1}, IMU)
CONFIG = {"imu": {"catalogue": "MTi-G-710"}}
FUNCTIONS = sorted(n for n in schuler.__all__ if inspect.isfunction(getattr(schuler, n)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_no_function_ends_inside_of_itself(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function = getattr(schuler, name)
    needed = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    positional = sum(p.kind is p.POSITIONAL_OR_KEYWORD for p in needed)
    others = {p.name: None for p in needed if p.kind is p.KEYWORD_ONLY}
    for value in (v for v in WRONG if (name, type(v)) != ("campaign", int)):  # three runs of anything are begun
        with contextlib.suppress(SchulerError):
            function(*[value] * positional, **others)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: schuler.navigate("a.parquet", CONFIG), r"navigate: .* got str, .*schuler.read\('a.parquet'\)"),
        (lambda r: schuler.navigate(r.imu, CONFIG), r"got ImuSeries, make one of it: schuler.Recording\(imu="),
        (lambda r: schuler.navigate(CONFIG, r), "navigate: recording: expected Recording, got dict"),
        (lambda r: schuler.apply_calibration(r, r.imu), "apply_calibration: calibration: expected CalibrationResult"),
        (lambda r: schuler.calibrate_freepose(r), "got Recording, take its series: recording.imu"),
        (lambda r: schuler.calibrate_ferraris(r), "calibrate_ferraris: imu: expected ImuSeries, got Recording"),
        (lambda r: schuler.calibrate_field(r, None, latitude=0.8), "calibrate_field: imu: expected ImuSeries"),
        (lambda r: result_from("sixposition", {}, "full").apply(r), "apply: imu: expected ImuSeries, got Recording"),
        (
            lambda r: schuler.calibrate_fleet("log.csv"),
            r"expected Sequence\[ImuSeries\], got str, read each first: ",
        ),
        (
            lambda r: schuler.calibrate_fleet([r.imu], labels="A1"),
            r"labels: expected Sequence\[str\] or None, got str",
        ),
        (lambda r: schuler.NavigationConfig(), "NavigationConfig: imu: missing"),
    ],
)
def test_what_a_user_is_likely_to_give(call, message):
    with pytest.raises(InputError, match=message):
        call(Recording(IMU))


@explains_arguments
def sample(log: "Recording | Path | str", names: "Sequence[str]" = (), *, rate: "float | None" = None) -> int:
    if not isinstance(log, str | Recording):
        raise AttributeError("inside")
    if rate == 13:
        raise TypeError("inside")
    return len(names) + (rate or 0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"log": 3}, r"sample: log: expected Recording or Path or str, got int$"),
        ({"log": IMU}, r"got ImuSeries, make one of it: schuler\.Recording\(imu=\.\.\.\)$"),
        ({"log": "a", "names": 3}, r"sample: names: expected Sequence\[str\], got int$"),
        ({"log": "a", "names": "bc"}, r"sample: names: expected Sequence\[str\], got str, give a list: \['bc'\]$"),
        ({"log": "a", "rate": "13"}, r"sample: rate: expected float or None, got str$"),
    ],
)
def test_the_first_wrong_argument_is_named(given, message):
    with pytest.raises(InputError, match=message):
        sample(**given)


def test_right_arguments_leave_results_and_errors_alone():
    assert sample("a", ["b", "c"], rate=1) == 3
    with pytest.raises(TypeError, match=r"^inside$"):
        sample("a", rate=13)
    with pytest.raises(AttributeError, match=r"^inside$"):
        sample(Path("a"))
    with pytest.raises(TypeError, match="unexpected keyword"):
        sample("a", speed=3)


def test_a_sequence_is_judged_by_what_it_holds():
    with pytest.raises(InputError, match=r"names: expected Sequence\[str\], got list"):
        sample("a", [1, 2], rate=13)
