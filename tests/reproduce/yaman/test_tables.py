"""The source's tables as printed, and the bounds that tell which of their numbers noise allows."""

import numpy as np
import pytest

from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.problem import field_layout, parameter_names
from schuler.calibration.result.parameters import imu_errors
from schuler.exceptions import InputError
from schuler.reproduce.yaman.study.bound import NAMES, accel_columns, gyro_columns, information_bound
from schuler.reproduce.yaman.study.runs import PLACE
from schuler.reproduce.yaman.study.tables import (
    DURATION_S,
    GRADES,
    PRINTED_CAMPAIGNS,
    noise_limit,
    printed_unit,
    published,
    static_spec,
)
from schuler.sensors import catalogue
from schuler.simulation.routine import thesis_routine
from schuler.simulation.steps import Rest, Routine, Turn
from schuler.units import DEG, DEG_PER_HR, MG, PPM


@pytest.mark.parametrize("grade", GRADES)
def test_there_is_a_row_for_every_parameter_of_the_filter(grade):
    layout = field_layout(catalogue.spec(grade), FieldOptions())
    assert set(PRINTED_CAMPAIGNS[grade]) == set(parameter_names(layout))


def test_modelled_errors_are_of_the_grades_and_share_their_draws():
    """Sample deviations of 1000 draws: 4 sampling sigmas (2.2 % each) of table 5.2; ratio to printed digits, 1e-3."""
    for grade in GRADES:
        layout = field_layout(catalogue.spec(grade), FieldOptions())
        prior = dict(zip(parameter_names(layout), np.sqrt(layout.initial_variances()), strict=True))
        for name, sigma in prior.items():
            row = published(grade, name)
            assert row is not None
            assert row[1] == pytest.approx(sigma, rel=4 * 0.0224), name
            assert abs(row[0]) < 4.0 * sigma / np.sqrt(1000.0), name
    ratio = {
        n: PRINTED_CAMPAIGNS[GRADES[0]][n][1] / PRINTED_CAMPAIGNS[GRADES[1]][n][1] for n in PRINTED_CAMPAIGNS[GRADES[1]]
    }
    expected = {"b_a": 50.0, "b_g": 200.0}
    for name, value in ratio.items():
        scale = (100.0 / 3.0 if name[2] == "a" else 200.0 / 3.0) if name[-1] == name[-2] else 20.0
        assert value == pytest.approx(expected.get(name[:3], scale), rel=1e-3), name


def test_units_and_signs():
    assert printed_unit("M_g_zz") == ("ppm", PPM)
    assert published("yaman-automotive", "b_a_z")[2] == pytest.approx(0.0997 * MG)  # printed -0.0997: turned
    assert published("yaman-tactical", "G_g_xx") is None
    assert published("my own", "b_a_x") is None
    with pytest.raises(InputError, match="the source has biases"):
        printed_unit("Q_a_x")


def test_noise_limit_has_printed_digits():
    """N / sqrt(540 s): 1.29 and 0.32 deg/h (0.307 with the prior), 36 and 1.45 ug; printed digits."""
    auto, tactical = (catalogue.spec(grade) for grade in GRADES)
    assert noise_limit(auto, "b_g_x", DURATION_S) / DEG_PER_HR == pytest.approx(1.29, abs=0.005)
    assert noise_limit(tactical, "b_g_x", DURATION_S) / DEG_PER_HR == pytest.approx(0.307, abs=0.0005)
    assert noise_limit(auto, "b_a_x", DURATION_S) / (1e-3 * MG) == pytest.approx(36.4, abs=0.1)
    assert noise_limit(tactical, "b_a_x", DURATION_S) / (1e-3 * MG) == pytest.approx(1.45, abs=0.005)
    assert noise_limit(auto, "M_a_xx", DURATION_S) is None


def test_columns_of_the_bound_are_those_of_the_sensor_model(rng):
    """Numerical twin: the model is linear in its parameters, so differences are exact to rounding."""
    f, omega = 10.0 * rng.standard_normal(3), rng.standard_normal(3)
    values = rng.standard_normal(len(NAMES))
    errors = imu_errors(dict(zip(NAMES, values, strict=True)))
    gyro, accel, _ = errors.apply_rates(omega[None], f[None], 1.0, rng)
    assert accel_columns(f) @ values == pytest.approx(accel[0] - f, abs=1e-12)
    assert gyro_columns(omega, f) @ values == pytest.approx(gyro[0] - omega, abs=1e-12)


def test_bound_of_one_rest_in_closed_form():
    """One level rest: only ``b_a_z - g M_a_zz`` is seen of the z accelerometer, tilt hides x and y. 1e-4, the tilts."""
    spec = catalogue.spec("yaman-automotive")
    bound = information_bound(spec, Routine((Rest(100.0),)), PLACE, heading_sigma=1.0 * DEG)
    g = 9.7985
    b, s, r = spec.accel.turn_on_bias**2, (g * spec.accel.scale_factor) ** 2, spec.accel.random_walk**2 / 100.0
    assert bound["b_a_z"] == pytest.approx(np.sqrt(b - b**2 / (b + s + r)), rel=1e-3)
    assert bound["M_a_xx"] == pytest.approx(spec.accel.scale_factor, rel=1e-3)


def test_bounds_fall_with_what_is_known():
    spec = catalogue.spec("yaman-tactical")
    routine = thesis_routine(repeats=1)
    carried = information_bound(spec, routine, PLACE, heading_sigma=1.0 * DEG, held=False)
    held = information_bound(spec, routine, PLACE, heading_sigma=1.0 * DEG)
    turning = information_bound(spec, routine, PLACE, heading_sigma=1.0 * DEG, gravity_in_turns=True)
    assert set(held) == set(PRINTED_CAMPAIGNS["yaman-tactical"])  # no g-sensitivity in the specification
    assert all(held[n] < carried[n] for n in held)
    assert all(turning[n] <= held[n] * (1.0 + 1e-9) for n in held)


def test_a_turn_about_the_vertical_tells_no_scale_factor():
    routine = Routine((Rest(20.0), Turn("z", 90.0 * DEG, 2.5), Rest(20.0)))
    spec = catalogue.spec("yaman-automotive")
    bound = information_bound(spec, routine, PLACE, heading_sigma=1.0 * DEG)
    assert bound["M_g_zz"] > 0.99 * spec.gyro.scale_factor
    horizontal = Routine((Rest(20.0), Turn("x", 90.0 * DEG, 2.5), Rest(20.0)))
    about_x = information_bound(spec, horizontal, PLACE, heading_sigma=1.0 * DEG)
    assert about_x["M_g_xx"] < 0.8 * spec.gyro.scale_factor


def test_the_vn_200_has_the_bias_the_source_found():
    assert catalogue.spec("VN-200").gyro.turn_on_bias == 0.0
    assert static_spec("VN-200").gyro.turn_on_bias == pytest.approx(1.0 * DEG)
    assert static_spec("MPU-6000") == catalogue.spec("MPU-6000")
