"""``schuler catalogue``: the values of the sources with their units, and nothing that a source does not state."""

import re

import pytest
from command import answer, refusal, run

from schuler import units
from schuler.sensors import catalogue
from schuler.sensors.sheets import ALLAN_FLICKER, AccelerometerSheet, GyroSheet, sheet_keys, sheet_unit


@pytest.mark.parametrize("sheet", [GyroSheet, AccelerometerSheet])
def test_the_unit_of_every_keyword_has_its_factor(sheet):
    for key, (_, factor) in sheet_keys(sheet).items():
        expected = factor * (ALLAN_FLICKER if key.startswith("allan_minimum") else 1.0)
        if key.startswith("misalignment_percent"):
            assert sheet_unit(key) == "%"
        text = sheet_unit(key)
        assert units.parse_unit(text).factor == pytest.approx(expected, rel=1e-14), key  # rounding
    assert sheet_unit("density") == ""


def test_a_value_is_that_of_the_source_and_si_that_of_the_budget(capsys):
    data = answer(capsys, "catalogue", "mpu 6000", "--json")
    assert (data["devices"], data["constructs"]) == (["MPU-6000"], [])
    noise = data["entries"]["MPU-6000"]["gyro"]["random_walk"]
    assert (noise["value"], noise["unit"]) == (0.005, "deg/s/sqrt(Hz)")
    assert noise["si"] == catalogue.spec("MPU-6000").gyro.random_walk
    assert data["entries"]["MPU-6000"]["gyro"]["bias_instability"] is None
    assert "InvenSense data sheet" in data["entries"]["MPU-6000"]["source"]


def test_what_is_not_stated_is_unknown(capsys):
    code, out, _ = run(capsys, "catalogue", "VN-200")
    assert code == 0
    assert len(re.findall(r"^  turn-on bias +unknown$", out, re.MULTILINE)) == 2
    assert len(re.findall(r"^  scale factor +unknown$", out, re.MULTILINE)) == 2
    assert re.search(r"^  bias instability B +10 deg/h$", out, re.MULTILINE)
    assert "unknown, not zero: gyro.turn_on_bias, accel.turn_on_bias, gyro.scale_factor" in out
    _, out, _ = run(capsys, "catalogue", "NAV440")
    assert "accelerometers: unknown" in out
    _, out, _ = run(capsys, "catalogue", "KVH-5000")
    assert "accelerometers" not in out  # it is a gyroscope


def test_each_value_has_its_page_behind_it(capsys):
    code, out, _ = run(capsys, "catalogue", "BMI088")
    assert code == 0
    assert re.search(r"^  turn-on bias +1 deg/s +page 10$", out, re.MULTILINE)
    assert re.search(r"^  misalignment +1 % +page 11$", out, re.MULTILINE)
    assert re.search(r"^  accel_alignment_deg +0.5 +page 9$", out, re.MULTILINE)
    assert re.search(r"^  bias instability B +10 deg/h +product page$", run(capsys, "catalogue", "VN-100")[1], re.M)
    assert re.search(r"^  bias instability B +0.45 deg/h +page not seen$", run(capsys, "catalogue", "HG4930")[1], re.M)
    data = answer(capsys, "catalogue", "BMI088", "--json")["entries"]["BMI088"]
    assert (data["gyro"]["scale_factor"]["page"], data["accel"]["misalignment"]["page"]) == ("page 10", "page 9")
    assert data["printed_pages"]["gyro_nonlinearity_percent"] == "page 10"
    data = answer(capsys, "catalogue", "VN-200", "--json")["entries"]["VN-200"]  # of a thesis: its source says where
    assert data["gyro"]["random_walk"]["page"] is None


def test_devices_stand_apart_from_what_theses_made(capsys):
    data = answer(capsys, "catalogue", "--json")
    assert sorted(data["devices"] + data["constructs"]) == sorted(catalogue.names())
    assert {"MPU-6000", "HG1700", "VN-200", "KVH-5000-measured", "MK-49"} <= set(data["devices"])
    assert {"yaman-tactical", "du-bias", "NAV440-emulated", "hayal-class-low"} <= set(data["constructs"])
    assert all(catalogue.entry(name).kind in ("imu", "grade", "class") for name in data["constructs"])
    code, out, _ = run(capsys, "catalogue")
    assert code == 0
    assert out.index("\nVN-200 ") < out.index("grades, classes and sets of theses") < out.index("\nyaman-tactical ")


def test_part_of_a_name_is_looked_for(capsys):
    assert answer(capsys, "catalogue", "hg", "--json")["devices"] == [n for n in catalogue.names() if "HG" in n]
    code, out, err = run(capsys, "catalogue", "HG1700")
    assert code == 0
    assert out.startswith("HG1700 (also HG1700-hayal)")  # the name itself, although another begins with it
    assert "similar names: HG1700-flenniken" in err
    assert answer(capsys, "catalogue", "g-710", "--json")["devices"] == ["MTi-G-710"]
    assert "did you mean MPU-60" in refusal(capsys, "catalogue", "MPU-6001")


def test_every_entry_can_be_shown(capsys):
    for name in catalogue.names():
        assert run(capsys, "catalogue", name)[1].startswith(name)
