"""Error budgets: conversions from data sheets against hand-computed numbers, refusals, round trips."""

import doctest
import math

import pytest

from schuler import units
from schuler.exceptions import InputError
from schuler.sensors import ImuSpec, TriadSpec, allan_minimum
from schuler.sensors import spec as spec_module
from schuler.sensors.sheets import AccelerometerSheet, GyroSheet, sheet_keys

# keyword -> unit as text, read by schuler.units: a second way to every factor
COMMON_UNITS = {
    "scale_ppm": "ppm", "scale_percent": "%", "misalignment_mrad": "mrad", "misalignment_urad": "urad",
    "misalignment_deg": "deg", "misalignment_percent": "%", "scale_temperature_ppm_K": "ppm/K",
    "scale_temperature_percent_K": "%/K", "in_run_time_s": "s",
}  # fmt: skip
GYRO_UNITS = COMMON_UNITS | {
    "arw_deg_rthr": "deg/sqrt(h)", "noise_deg_s_rthz": "deg/s/sqrt(Hz)", "noise_deg_hr_rthz": "deg/h/sqrt(Hz)",
    "bias_instability_deg_hr": "deg/h", "rrw_deg_hr_rthr": "deg/h/sqrt(h)", "ramp_deg_hr_hr": "deg/h/h",
    "quantisation_arcsec": "arcsec", "bias_deg_hr": "deg/h", "bias_deg_s": "deg/s", "in_run_deg_hr": "deg/h",
    "in_run_deg_s": "deg/s", "g_sensitivity_deg_hr_g": "deg/h/g", "g_sensitivity_deg_s_g": "deg/s/g",
    "bias_temperature_deg_hr_K": "deg/h/K", "bias_temperature_deg_s_K": "deg/s/K", "range_deg_s": "deg/s",
    "resolution_deg_s": "deg/s",
}  # fmt: skip
ACCEL_UNITS = COMMON_UNITS | {
    "vrw_m_s_rthr": "m/s/sqrt(h)", "noise_ug_rthz": "ug/sqrt(Hz)", "noise_mg_rthz": "mg/sqrt(Hz)",
    "noise_m_s2_rthz": "m/s^2/sqrt(Hz)", "bias_instability_ug": "ug", "bias_instability_mg": "mg",
    "rrw_ug_rthr": "ug/sqrt(h)", "ramp_ug_hr": "ug/h", "quantisation_m_s": "m/s", "bias_mg": "mg", "bias_ug": "ug",
    "bias_m_s2": "m/s^2", "in_run_mg": "mg", "in_run_ug": "ug", "bias_temperature_mg_K": "mg/K",
    "bias_temperature_ug_K": "ug/K", "range_g": "g", "range_m_s2": "m/s^2", "resolution_mg": "mg",
    "resolution_ug": "ug",
}  # fmt: skip


@pytest.mark.parametrize(
    ("sheet", "table", "other"),
    [(GyroSheet, GYRO_UNITS, "allan_minimum_deg_hr"), (AccelerometerSheet, ACCEL_UNITS, "allan_minimum_ug")],
)
def test_every_factor_agrees_with_its_unit(sheet, table, other):
    keys = sheet_keys(sheet)
    assert set(keys) == set(table) | {other}
    for key, unit in table.items():
        assert keys[key][1] == pytest.approx(units.parse_unit(unit).factor, rel=1e-14), key  # rounding
    fields = {field for field, _ in keys.values()}
    assert fields <= set(TriadSpec.__slots__)


@pytest.mark.parametrize(
    ("sheet", "field", "expected"),
    [
        # by hand: x deg/sqrt(h) * (pi/180)/60, x deg/h * (pi/180)/3600; tolerance: printed digits
        ({"arw_deg_rthr": 0.125}, "random_walk", 3.6361e-5),
        ({"arw_deg_rthr": 0.5}, "random_walk", 1.45444e-4),
        ({"arw_deg_rthr": 0.09}, "random_walk", 2.6180e-5),
        ({"noise_deg_s_rthz": 0.005, "density": "two-sided"}, "random_walk", 8.72665e-5),
        ({"noise_deg_s_rthz": 0.005, "density": "one-sided"}, "random_walk", 6.17067e-5),
        ({"noise_deg_hr_rthz": 18.0, "density": "two-sided"}, "random_walk", 8.72665e-5),
        ({"arw_deg_rthr": 1, "bias_deg_hr": 1.0}, "turn_on_bias", 4.84814e-6),
        ({"arw_deg_rthr": 1, "bias_deg_hr": 200.0}, "turn_on_bias", 9.69627e-4),
        ({"arw_deg_rthr": 1, "bias_deg_s": 20.0}, "turn_on_bias", 0.349066),
        ({"arw_deg_rthr": 1, "g_sensitivity_deg_hr_g": 90.0}, "g_sensitivity", 4.44934e-5),
        ({"arw_deg_rthr": 1, "rrw_deg_hr_rthr": 6.0}, "rate_random_walk", 4.84814e-7),
        ({"arw_deg_rthr": 1, "allan_minimum_deg_hr": 1.0}, "bias_instability", 7.2983e-6),
        ({"arw_deg_rthr": 1, "scale_ppm": 150}, "scale_factor", 1.5e-4),
        ({"arw_deg_rthr": 1, "misalignment_deg": 0.1}, "misalignment", 1.745329e-3),
        ({"arw_deg_rthr": 1, "range_deg_s": 1074.0}, "range", 18.74484),
    ],
)
def test_gyro_numbers(sheet, field, expected):
    assert getattr(TriadSpec.gyro(**sheet), field) == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize(
    ("sheet", "field", "expected"),
    [
        ({"noise_ug_rthz": 846.0, "density": "two-sided"}, "random_walk", 8.29643e-3),
        ({"noise_mg_rthz": 0.846, "density": "one-sided"}, "random_walk", 5.86646e-3),
        ({"vrw_m_s_rthr": 0.5}, "random_walk", 8.33333e-3),
        ({"vrw_m_s_rthr": 0.22}, "random_walk", 3.66667e-3),
        ({"noise_m_s2_rthz": 0.0083, "density": "two-sided"}, "random_walk", 0.0083),
        ({"vrw_m_s_rthr": 1, "bias_mg": 50.0}, "turn_on_bias", 0.4903325),
        ({"vrw_m_s_rthr": 1, "bias_ug": 50.0}, "turn_on_bias", 4.903325e-4),
        ({"vrw_m_s_rthr": 1, "in_run_mg": 2.4, "in_run_time_s": 100}, "in_run_bias", 0.02353596),
        ({"vrw_m_s_rthr": 1, "scale_temperature_percent_K": 0.02}, "scale_temperature", 2e-4),
        ({"vrw_m_s_rthr": 1, "range_g": 4}, "range", 39.2266),
        ({"vrw_m_s_rthr": 1, "resolution_ug": 122.0703125}, "resolution", 1.197101e-3),
    ],
)
def test_accelerometer_numbers(sheet, field, expected):
    assert getattr(TriadSpec.accelerometer(**sheet), field) == pytest.approx(expected, rel=2e-5)  # printed digits


def test_one_sided_density_is_sqrt2_N():
    """The same sensor described three ways; rms in a band W is d sqrt(W) one-sided and N sqrt(2 W) two-sided."""
    N = TriadSpec.gyro(arw_deg_rthr=0.3).random_walk
    two = TriadSpec.gyro(noise_deg_s_rthz=0.005, density="two-sided").random_walk
    one = TriadSpec.gyro(noise_deg_s_rthz=0.005 * math.sqrt(2.0), density="one-sided").random_walk
    assert two == pytest.approx(N, rel=1e-14)  # rounding
    assert one == pytest.approx(N, rel=1e-14)  # rounding


def test_allan_minimum():
    assert allan_minimum(1.0) == pytest.approx(0.664, abs=5e-4)  # printed digits
    B = TriadSpec.gyro(arw_deg_rthr=1, allan_minimum_deg_hr=2.0).bias_instability
    assert allan_minimum(B) == pytest.approx(2.0 * units.DEG_PER_HR, rel=1e-14)  # rounding


@pytest.mark.parametrize("density", [None, "both", ""])
@pytest.mark.parametrize(
    "build",
    [
        lambda d: TriadSpec.gyro(noise_deg_s_rthz=0.005, density=d),
        lambda d: TriadSpec.gyro(noise_deg_hr_rthz=18.0, density=d),
        lambda d: TriadSpec.accelerometer(noise_ug_rthz=400.0, density=d),
        lambda d: TriadSpec.accelerometer(noise_mg_rthz=0.4, density=d),
        lambda d: TriadSpec.accelerometer(noise_m_s2_rthz=0.004, density=d),
    ],
)
def test_density_must_be_stated(build, density):
    with pytest.raises(InputError, match=r"needs density='one-sided' or 'two-sided', got .*N = d/sqrt\(2\)"):
        build(density)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: TriadSpec.gyro(bias_deg_hr=1.0), "gyro: expected one noise figure out of arw_deg_rthr, noise_deg"),
        (lambda: TriadSpec.accelerometer(), "accelerometer: expected one noise figure out of vrw_m_s_rthr"),
        (
            lambda: TriadSpec.gyro(arw_deg_rthr=0.1, noise_deg_s_rthz=0.1, density="two-sided"),
            "arw_deg_rthr and noise_deg_s_rthz are the same quantity; give one",
        ),
        (
            lambda: TriadSpec.gyro(arw_deg_rthr=0.1, bias_deg_hr=1, bias_deg_s=1),
            "bias_deg_hr and bias_deg_s are the same quantity",
        ),
        (lambda: TriadSpec.gyro(arw_deg_rthr=0.1, density="two-sided"), "arw_deg_rthr is a random walk and equals N"),
        (
            lambda: TriadSpec.gyro(arw_deg_rthr=0.1, bias_deg_h=1),
            "unknown entry 'bias_deg_h'; did you mean bias_deg_hr",
        ),
        (lambda: TriadSpec.gyro(arw_deg_rthr=0.1, bias_mg=1), "gyro: unknown entry 'bias_mg'"),
        (
            lambda: TriadSpec.gyro(arw_deg_rthr=-0.1),
            "arw_deg_rthr: expected a finite 1-sigma value, not negative, got -0.1",
        ),
        (lambda: TriadSpec.gyro(arw_deg_rthr="small"), "arw_deg_rthr: expected one number, got 'small'"),
        (lambda: TriadSpec(random_walk=float("nan")), "random_walk: expected a finite 1-sigma value"),
        (lambda: TriadSpec(random_walk=1.0, scale_factor=-1e-6), "scale_factor: expected a finite"),
        (lambda: TriadSpec(random_walk=1.0, turn_on_bias=None), "turn_on_bias: expected a number, got None"),
        (lambda: TriadSpec(random_walk=1.0, range=0.0), "range: expected a positive number or None"),
        (lambda: TriadSpec(random_walk=1.0, resolution=0.0), "resolution: expected a positive number or None"),
        (lambda: TriadSpec(random_walk=1.0, in_run_bias=1.0), "expected both in_run_bias and in_run_time"),
        (lambda: TriadSpec(random_walk=1.0, in_run_time=1.0), "without a correlation time is a bias_instability"),
        (
            lambda: TriadSpec.from_dict({"random_walk": 1.0, "scale": 1}),
            "unknown entry 'scale'; did you mean scale_factor",
        ),
        (lambda: TriadSpec.from_dict({}), "expected the entry 'random_walk', got none"),
        (lambda: ImuSpec.from_dict({"name": "x", "gyro": {"random_walk": 1}}), "IMU: expected the entry 'accel', got"),
        (
            lambda: ImuSpec("x", TriadSpec(random_walk=1), TriadSpec(random_walk=1, g_sensitivity=1)),
            "g_sensitivity belongs to the gyroscope",
        ),
        (
            lambda: ImuSpec("x", TriadSpec(random_walk=1), TriadSpec(random_walk=1), rate_hz=0),
            "rate_hz: expected a positive number",
        ),
    ],
)
def test_refusals(build, message):
    with pytest.raises(InputError, match=message):
        build()


def full_triad() -> TriadSpec:
    values = {name: (k + 1) / 7.0 for k, name in enumerate(TriadSpec.__slots__)}
    return TriadSpec(**values)


def test_dictionary_round_trip():
    from dataclasses import replace

    for triad in (full_triad(), TriadSpec(random_walk=0.0), TriadSpec(random_walk=1.0, range=3.0)):
        assert TriadSpec.from_dict(triad.to_dict()) == triad
    spec = ImuSpec("x", full_triad(), replace(full_triad(), g_sensitivity=0.0), rate_hz=100.0, source="test")
    assert ImuSpec.from_dict(spec.to_dict()) == spec
    assert spec != replace(spec, rate_hz=200.0)
    bare = ImuSpec("y", TriadSpec(random_walk=1), TriadSpec(random_walk=2))
    assert bare.to_dict() == {"name": "y", "gyro": {"random_walk": 1.0}, "accel": {"random_walk": 2.0}}
    assert ImuSpec.from_dict(bare.to_dict()) == bare


def test_summary_shows_both_unit_systems():
    spec = ImuSpec(
        "unit",
        TriadSpec.gyro(arw_deg_rthr=0.125, bias_deg_hr=3.0, in_run_deg_hr=0.35, in_run_time_s=100.0),
        TriadSpec.accelerometer(vrw_m_s_rthr=0.22, bias_mg=1.0),
        rate_hz=100.0,
        source="a sheet",
    )
    text = spec.summary()
    assert text.splitlines()[0] == "unit, 100 Hz (a sheet)"
    for line in (
        "3.636e-05",
        "0.125      deg/sqrt(h)",
        "3          deg/h",
        "100        s",
        "0.22       m/s/sqrt(h)",
        "1          mg",
    ):
        assert line in text
    assert "scale" not in text  # terms that are zero are left out
    full = ImuSpec("all", full_triad(), TriadSpec.from_dict(full_triad().to_dict() | {"g_sensitivity": 0.0}))
    assert len(full.summary().splitlines()) == 1 + 2 + 15 + 14


def test_documented_examples_run():
    assert doctest.testmod(spec_module).failed == 0
    for method, sheet in ((TriadSpec.gyro, GyroSheet), (TriadSpec.accelerometer, AccelerometerSheet)):
        documented = (TriadSpec.gyro.__doc__ or "") + (method.__doc__ or "")
        assert [key for key in sheet_keys(sheet) if key not in documented] == []
