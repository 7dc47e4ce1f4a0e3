"""Allan curve for the page: terms add up to the model, lines of slopes have the coefficients of the fit."""

import json

import numpy as np
import pytest

from schuler.characterisation import identify_noise
from schuler.characterisation.report.terms import sheet_variances, term_variances
from schuler.cli.allan import numbers
from schuler.cli.output import json_text
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors import catalogue
from schuler.studio.allan import allan_document


@pytest.fixture(scope="module")
def noise():
    rng = np.random.default_rng(2)
    n, dt = 6_000, 0.01
    walk = np.cumsum(rng.standard_normal((n, 3)), axis=0) * 2e-6
    gyro = rng.standard_normal((n, 3)) * 1e-3 + walk
    accel = rng.standard_normal((n, 3)) * 1e-2 - (0.0, 0.0, 9.8)
    imu = ImuSeries(dt * np.arange(1, n + 1), gyro, accel)
    return identify_noise(imu, models=("N", "N+K"), method="allan")


@pytest.fixture(scope="module")
def answer(noise):
    return json.loads(json_text(numbers(noise)))


def test_terms_are_those_of_the_fit_in_data_sheet_units(noise, answer):
    document = allan_document(answer, "gyro_x")
    axis = noise.axes["gyro_x"]
    assert document["unit"] == "deg/h"
    fitted = term_variances(axis, np.array(document["grid"]))
    scale = np.degrees(3600.0) ** 2
    assert document["terms"].keys() == fitted.keys()
    for label, values in fitted.items():
        assert np.allclose(document["terms"][label], values * scale, rtol=2e-5)  # printed digits
    assert np.allclose(document["adev"], axis.curve.deviation * np.sqrt(scale), rtol=1e-5)


def test_a_line_at_the_level_of_a_term_has_its_coefficient(noise, answer):
    document = allan_document(answer, "gyro_x")
    slope = next(s for s in document["slopes"] if s["letter"] == "N")
    N = noise.axes["gyro_x"].terms["N"].value
    assert (slope["exponent"], slope["unit"]) == (-0.5, "deg/sqrt(h)")
    assert slope["level"] * slope["scale"] == pytest.approx(np.degrees(N) * 60.0, rel=1e-12)  # rounding


def test_lines_of_other_slopes_touch_the_curve_from_below(answer):
    document = allan_document(answer, "accel_y")
    tau, curve = np.array(document["tau"]), np.array(document["adev"])
    for slope in document["slopes"]:
        if slope["letter"] not in document["terms"]:
            line = slope["level"] * tau ** slope["exponent"]
            assert np.min(curve / line) == pytest.approx(1.0, rel=1e-5)  # printed digits


def test_the_sheet_of_an_imu(answer):
    document = allan_document(answer, "gyro_z", "MTi-G-710")
    spec = catalogue.spec("MTi-G-710").gyro
    total = sum(sheet_variances(spec, np.array(document["grid"])).values())
    assert np.allclose(document["sheet"], np.degrees(np.sqrt(total)) * 3600.0, rtol=2e-5)  # printed digits
    assert allan_document(answer, "gyro_z")["sheet"] is None


def test_what_is_no_axis(answer):
    with pytest.raises(InputError, match="axis: expected one of gyro_x"):
        allan_document(answer, "gyro_q")
    with pytest.raises(InputError, match="no sensor"):
        allan_document(answer, "gyro_x", "no such unit")
