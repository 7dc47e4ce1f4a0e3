"""The catalogue: every entry loads; the numbers are those of the sources, in SI by hand."""

import math
import re
from dataclasses import fields

import numpy as np
import pytest

from schuler import units as u
from schuler.exceptions import InputError
from schuler.sensors import ImuErrors, ImuSpec, catalogue

G = 9.80665


@pytest.mark.parametrize("name", catalogue.names())
def test_every_entry_loads(name):
    e = catalogue.entry(name)
    assert e.source
    assert e.notes
    for key, value in e.printed.items():
        assert np.isfinite(value).all(), key
    for which, sheet in (("gyro", e.gyro), ("accel", e.accel)):
        if sheet:
            triad = catalogue.triad(name, which)
            for field in fields(triad):
                value = getattr(triad, field.name)
                assert value is None or (math.isfinite(value) and value >= 0.0)
            assert triad.random_walk > 0.0
    if e.kind in ("gyro", "accelerometer"):
        assert bool(e.gyro) != bool(e.accel)
        assert bool(e.gyro) == (e.kind == "gyro")
    if e.kind == "class":
        assert not e.gyro
        assert not e.accel
    else:
        assert e.gyro or e.accel


@pytest.mark.parametrize("name", [n for n in catalogue.names() if catalogue.entry(n).gyro and catalogue.entry(n).accel])
def test_every_full_entry_gives_a_budget_an_imu_and_a_round_trip(name):
    spec = catalogue.spec(name)
    assert spec.name == name
    assert spec.source
    assert ImuSpec.from_dict(spec.to_dict()) == spec
    assert name in spec.summary()
    zero = np.zeros((3, 3))
    for x in ImuErrors.draw(spec, np.random.default_rng(0)).apply_increments(
        zero, zero, 0.01, np.random.default_rng(1)
    )[:2]:
        assert np.isfinite(x).all()


def test_all_named_sensors_are_there():
    kinds = {
        "imu": "LN-200 HG1700 HG1700-flenniken HG1900 HG1900-flenniken MPU-6000 MPU-9150 VN-200 MTi-G MTi-G-710 NAV440",
        "gyro": "KVH-5000 AQRS-000640-104 AQRS-000640-109 Systron-Donner",
        "accelerometer": "Humphrey",
        "grade": "flenniken-consumer flenniken-automotive flenniken-tactical flenniken-tactical-printed "
        "yaman-automotive yaman-tactical hayal-simulated du-bias du-scale du-installation",
        "class": "yaman-class-military yaman-class-navigation yaman-class-tactical yaman-class-ahrs "
        "yaman-class-control-system stefanisko-marine stefanisko-aviation stefanisko-intermediate stefanisko-tactical "
        "stefanisko-automotive",
    }
    for kind, text in kinds.items():
        assert set(text.split()) <= set(catalogue.names(kind))
    assert sorted(n for kind in kinds for n in catalogue.names(kind)) == sorted(catalogue.names())


def test_names_and_aliases_are_unique():
    plain = [
        a.lower().replace("-", "").replace("_", "").replace(" ", "")
        for n in catalogue.names()
        for a in (n, *catalogue.entry(n).aliases)
    ]
    assert len(plain) == len(set(plain))


# of sensor and triad: values in SI by hand; tolerance: printed digits
DEG = math.pi / 180.0
NUMBERS = {
    ("LN-200", "gyro"): {"random_walk": 0.10 * DEG / 60, "in_run_bias": 0.35 * DEG / 3600},
    ("LN-200", "accel"): {"random_walk": 50e-6 * G, "in_run_bias": 50e-6 * G, "range": 40 * G},
    ("HG1700-flenniken", "gyro"): {"bias_instability": 2.0 * DEG / 3600},
    ("HG1700-flenniken", "accel"): {"random_walk": 30e-6 * G},
    ("HG1900-flenniken", "gyro"): {"bias_instability": 10.0 * DEG / 3600},
    ("HG1900-flenniken", "accel"): {"bias_instability": 1e-3 * G},
    ("KVH-5000", "gyro"): {"random_walk": 1.383e-3 * DEG, "scale_factor": 1e-3},
    ("KVH-5000-measured", "gyro"): {"random_walk": 8.5e-4 * DEG},
    ("Systron-Donner", "gyro"): {"random_walk": 0.33 * DEG / 60, "scale_factor": 0.005},
    ("AQRS-104", "gyro"): {"random_walk": 0.025 * DEG, "in_run_bias": 0.05 * DEG, "in_run_time": 1000.0,
        "range": 64 * DEG},
    ("AQRS-104-measured", "gyro"): {"random_walk": 0.02373 * DEG, "in_run_bias": 0.054 * DEG, "in_run_time": 1171.0},
    ("AQRS-109", "gyro"): {"scale_factor": 0.05, "range": 75 * DEG},
    ("Humphrey", "accel"): {"random_walk": 9.5e-6 * G, "in_run_bias": 8.5e-5 * G, "in_run_time": 700.0},
    ("consumer", "gyro"): {"random_walk": 0.05 * DEG, "in_run_bias": 0.1 * DEG, "in_run_time": 300.0},
    ("consumer", "accel"): {"random_walk": 0.003 * G, "in_run_bias": 2.4e-3 * G, "in_run_time": 100.0},
    ("automotive", "gyro"): {"in_run_bias": 0.05 * DEG},
    ("automotive", "accel"): {"random_walk": 0.001 * G, "in_run_bias": 1.2e-3 * G},
    ("tactical", "gyro"): {"random_walk": 0.0017 * DEG, "in_run_bias": 0.35 * DEG / 3600, "in_run_time": 100.0},
    ("tactical", "accel"): {"random_walk": 50e-6 * G, "in_run_bias": 50e-6 * G, "in_run_time": 60.0},
    ("tactical_printed", "accel"): {"random_walk": 0.0005 * G, "in_run_bias": 50e-5 * G},
    ("HG1700", "gyro"): {"random_walk": 3.636e-5, "turn_on_bias": 4.848e-6, "misalignment": 5e-4,
        "range": 1074 * DEG},
    ("HG1700", "accel"): {"random_walk": 3.667e-3, "turn_on_bias": 1e-3 * G},
    ("HG1900", "gyro"): {"random_walk": 2.618e-5, "turn_on_bias": 17 * DEG / 3600,
        "bias_instability": 7 * DEG / 3600, "g_sensitivity": 3 * DEG / 3600 / G, "misalignment": 80e-6},
    ("HG1900", "accel"): {"random_walk": 3.667e-3},
    ("hayal-simulated", "gyro"): {"turn_on_bias": 4.848e-6, "misalignment": 1e-4},
    ("hayal-simulated", "accel"): {"turn_on_bias": 0.01, "scale_factor": 3e-4},
    ("yaman-automotive", "gyro"): {"random_walk": 1.4544e-4, "turn_on_bias": 9.696e-4, "scale_factor": 1e-2,
        "misalignment": 1e-2, "g_sensitivity": 4.4493e-5},
    ("yaman-automotive", "accel"): {"turn_on_bias": 0.49033, "random_walk": 0.0083},
    ("yaman-tactical", "gyro"): {"random_walk": 3.636e-5, "turn_on_bias": 4.848e-6, "scale_factor": 1.5e-4,
        "g_sensitivity": 0.0},
    ("yaman-tactical", "accel"): {"turn_on_bias": 9.80665e-3, "random_walk": 3.302e-4, "misalignment": 5e-4},
    ("MPU-6000", "gyro"): {"random_walk": 0.30 * DEG / 60, "turn_on_bias": 20 * DEG, "g_sensitivity": 0.1 * DEG / G},
    ("MPU-6000", "accel"): {"random_walk": 3.9227e-3, "scale_factor": 0.03, "scale_temperature": 2e-4},
    ("MPU-9150", "gyro"): {"resolution": 0.015259 * DEG, "range": 500 * DEG},
    ("MPU-9150", "accel"): {"resolution": 122.07e-6 * G, "range": 4 * G},
    ("VN-200", "gyro"): {"random_walk": 0.0035 * DEG, "bias_instability": 10 * DEG / 3600},
    ("VN-200", "accel"): {"random_walk": 140e-6 * G, "bias_instability": 40e-6 * G},
    ("MTi-G-710", "gyro"): {"random_walk": 0.01 * DEG, "turn_on_bias": 0.2 * DEG, "g_sensitivity": 0.003 * DEG / G},
    ("MTi-G-710", "accel"): {"random_walk": 80e-6 * G, "turn_on_bias": 0.03, "bias_instability": 40e-6 * G,
        "range": 50.0},
    ("MTi-G", "gyro"): {"random_walk": 0.05 * DEG, "bias_instability": 1.0 * DEG, "range": 300 * DEG},
    ("NAV440", "gyro"): {"random_walk": 0.4 * DEG / 60, "bias_instability": 20 * DEG / 3600, "range": 400 * DEG},
    ("MTi-G-emulated", "accel"): {"random_walk": 0.002},
    ("NAV440-emulated", "accel"): {"random_walk": 0.1 / 60},
    ("du-bias", "gyro"): {"turn_on_bias": 30 * DEG / 3600, "random_walk": 0.2 * DEG / 60},
    ("du-bias", "accel"): {"turn_on_bias": 0.2, "random_walk": 0.1 / 60},
    ("du-scale", "gyro"): {"scale_factor": 3000e-6},
    ("du-installation", "gyro"): {"misalignment": 1745e-6},
    ("MPU-6050", "gyro"): {"random_walk": 0.005 * DEG, "turn_on_bias": 20 * DEG, "g_sensitivity": 0.1 * DEG / G},
    ("MPU-6050", "accel"): {"random_walk": 400e-6 * G, "turn_on_bias": 0.08 * G, "scale_temperature": 2e-4},
    ("MPU-9250", "gyro"): {"random_walk": 0.01 * DEG, "turn_on_bias": 5 * DEG},
    ("MPU-9250", "accel"): {"random_walk": 300e-6 * G, "turn_on_bias": 0.08 * G, "bias_temperature": 1.5e-3 * G},
    ("BMI088", "gyro"): {"random_walk": 0.014 * DEG, "turn_on_bias": 1 * DEG, "scale_factor": 0.01,
        "misalignment": 0.01, "bias_temperature": 0.015 * DEG, "scale_temperature": 3e-4},
    ("BMI088", "accel"): {"random_walk": 190e-6 * G, "turn_on_bias": 0.02 * G, "scale_factor": 0.0,
        "misalignment": 0.005, "bias_temperature": 0.2e-3 * G, "range": 24 * G},
    ("BMI160", "gyro"): {"random_walk": 0.007 * DEG, "turn_on_bias": 3 * DEG, "scale_factor": 0.03,
        "bias_temperature": 0.08 * DEG},
    ("BMI160", "accel"): {"random_walk": 180e-6 * G, "turn_on_bias": 0.04 * G, "scale_factor": 0.04,
        "bias_temperature": 1e-3 * G, "scale_temperature": 3e-4},
    ("ICM-20948", "gyro"): {"random_walk": 0.015 * DEG, "turn_on_bias": 5 * DEG, "scale_factor": 0.015,
        "bias_temperature": 0.05 * DEG},
    ("ICM-20948", "accel"): {"random_walk": 230e-6 * G, "turn_on_bias": 0.05 * G, "scale_factor": 0.005,
        "misalignment": 0.02, "bias_temperature": 0.8e-3 * G, "scale_temperature": 2.6e-4},
    ("ICM-42688-P", "gyro"): {"random_walk": 0.0028 * DEG, "turn_on_bias": 0.5 * DEG, "scale_factor": 0.005,
        "misalignment": 0.0125, "bias_temperature": 0.005 * DEG},
    ("ICM-42688-P", "accel"): {"random_walk": 70e-6 * G, "turn_on_bias": 0.02 * G, "scale_factor": 0.005,
        "misalignment": 0.01, "bias_temperature": 0.15e-3 * G},
    ("LSM6DSO", "gyro"): {"random_walk": 0.0038 * DEG, "turn_on_bias": 1 * DEG, "scale_factor": 0.01,
        "bias_temperature": 0.01 * DEG},
    ("LSM6DSO", "accel"): {"random_walk": 70e-6 * G, "turn_on_bias": 0.02 * G},
    ("ADIS16448", "gyro"): {"random_walk": 0.66 * DEG / 60.0, "turn_on_bias": 0.5 * DEG, "misalignment": 0.05 * DEG,
        "bias_instability": 14.5 * DEG / 3600.0, "range": 1000 * DEG},
    ("ADIS16448", "accel"): {"random_walk": 0.11 / 60.0, "turn_on_bias": 0.02 * G, "misalignment": 0.2 * DEG,
        "range": 18 * G},
    ("HG4930", "gyro"): {"random_walk": 0.06 * DEG / 60.0, "bias_instability": 0.45 * DEG / 3600.0},
    ("HG4930", "accel"): {"random_walk": 0.06 / 60.0, "bias_instability": 75e-6 * G},
    ("phone", "gyro"): {"random_walk": 0.015 * DEG, "turn_on_bias": 5 * DEG, "bias_temperature": 0.08 * DEG},
    ("phone", "accel"): {"random_walk": 230e-6 * G, "turn_on_bias": 0.05 * G, "bias_temperature": 1e-3 * G},
    ("STIM300", "gyro"): {"random_walk": 0.15 * DEG / 60, "bias_instability": 0.5 * DEG / 3600},
    ("STIM300", "accel"): {"random_walk": 0.06 / 60, "turn_on_bias": 0.75e-3 * G},
    ("MTi-3", "gyro"): {"random_walk": 0.007 * DEG, "bias_instability": 10 * DEG / 3600, "range": 2000 * DEG},
    ("MTi-3", "accel"): {"random_walk": 120e-6 * G, "bias_instability": 30e-6 * G, "range": 16 * G},
    ("VN-100", "gyro"): {"random_walk": 0.0035 * DEG, "bias_instability": 10 * DEG / 3600},
    ("VN-100", "accel"): {"random_walk": 140e-6 * G, "bias_instability": 40e-6 * G},
    ("ADIS16470", "gyro"): {"random_walk": 0.008 * DEG, "bias_instability": 8 * DEG / 3600, "range": 2000 * DEG},
    ("ADIS16470", "accel"): {"random_walk": 100e-6 * G, "bias_instability": 13e-6 * G, "range": 40 * G},
    ("ADIS16505-1", "gyro"): {"random_walk": 0.13 * DEG / 60, "bias_instability": 2.3 * DEG / 3600,
        "misalignment": 0.25 * DEG},
    ("ICM-20602", "gyro"): {"random_walk": 0.004 * DEG, "scale_factor": 0.01, "range": 2000 * DEG},
    ("ICM-20602", "accel"): {"random_walk": 100e-6 * G, "range": 16 * G},
    ("ICM-42605", "gyro"): {"random_walk": 0.0038 * DEG},
    ("ICM-42605", "accel"): {"random_walk": 70e-6 * G},
    ("BMI270", "gyro"): {"random_walk": 0.007 * DEG, "misalignment": 0.002, "bias_temperature": 0.015 * DEG},
    ("BMI270", "accel"): {"random_walk": 160e-6 * G, "turn_on_bias": 0.02 * G, "scale_factor": 0.004},
}  # fmt: skip


@pytest.mark.parametrize(("name", "which"), NUMBERS)
def test_numbers_of_the_sources(name, which):
    for field, expected in NUMBERS[name, which].items():
        assert getattr(catalogue.triad(name, which), field) == pytest.approx(expected, rel=3e-4), field


def test_every_sensor_with_numbers_is_checked():
    checked = {catalogue.entry(name).name for name, *_ in NUMBERS}
    assert checked == {n for n in catalogue.names() if catalogue.entry(n).kind != "class"}


#: Makers' sheets of which every value has its page, table or section, or the words that the page was not seen.
PAGED = [
    "MPU-6050", "MPU-9250", "BMI088", "BMI160", "ICM-20948", "ICM-42688", "LSM6DSO", "ADIS16448", "ADIS16470",
    "ADIS16505", "STIM300", "HG4930", "VN-100", "MTi-3", "ICM-20602", "ICM-42605", "BMI270", "phone",
]  # fmt: skip


@pytest.mark.parametrize("name", PAGED)
def test_every_value_of_a_makers_sheet_has_its_page(name):
    e = catalogue.entry(name)
    stated = {f"{which}.{f}" for which in ("gyro", "accel") for f, v in catalogue.quantities(e, which).items() if v}
    assert set(e.pages) == stated | {f"printed.{key}" for key in e.printed}
    for value, place in e.pages.items():
        by_page = r"pages? (\d+( (to|and) \d+)?( of revision \d+)?|not seen)"
        assert re.fullmatch(rf"{by_page}|[Tt]able .+|section \d+\.\d+|product page", place) or (
            name == "phone" and place.split(",")[0] in e.source
        ), value
        assert place != "product page" or "product page" in e.source  # with its address or that of a copy


def test_a_phone_is_the_largest_of_its_parts():
    """Of what the parts state, by the rule of its source; ranges are those of the part with most noise."""
    parts = [catalogue.spec(n) for n in ("LSM6DSO", "BMI160", "BMI270", "ICM-20948", "ICM-42688")]
    phone = catalogue.spec("phone")
    for which in ("gyro", "accel"):
        for field in fields(phone.gyro):
            largest = max(getattr(getattr(part, which), field.name) or 0.0 for part in parts)
            assert (getattr(getattr(phone, which), field.name) or 0.0) == largest, (which, field.name)


def test_pages_of_values_that_an_entry_does_not_state_are_refused(monkeypatch):
    gyro = {"noise_deg_s_rthz": 0.01, "density": "two-sided", "range_deg_s": 250.0, "page": 8}
    read = {"A": {"kind": "imu", "source": "sheet", "gyro": dict(gyro, pages={"range_deg_s": "Table 2"})}}
    monkeypatch.setattr(catalogue, "read_toml", lambda path: read)
    e = catalogue._entries.__wrapped__()["A"]
    assert e.pages == {"gyro.random_walk": "page 8", "gyro.range": "Table 2"}
    assert not {"page", "pages"} & set(e.gyro)
    read["A"]["gyro"] = dict(gyro, pages={"range_deg": 2})
    with pytest.raises(InputError, match=r"catalogue entry A: pages of gyro: .*'range_deg'; did you mean range_deg_s"):
        catalogue._entries.__wrapped__()


def test_sampled_noise_of_the_sources():
    """Hayal's sample deviations at 1 Hz, Stefanisko's at 6 ms (digest 4.2), Yaman's noise limit of a 540 s mean."""
    assert catalogue.spec("HG1700").gyro.random_walk == pytest.approx(
        catalogue.entry("hayal-simulated").printed["gyro_sigma_1hz_rad_s"], rel=2e-4
    )
    mpu = catalogue.spec("MPU-9150")
    assert mpu.rate_hz == pytest.approx(1 / 0.006)
    assert mpu.gyro.random_walk * math.sqrt(mpu.rate_hz) / u.DEG == pytest.approx(0.0646, abs=1e-4)  # printed digits
    assert mpu.accel.random_walk * math.sqrt(mpu.rate_hz) == pytest.approx(0.0506, abs=5e-5)  # printed digits
    tactical = catalogue.spec("yaman-tactical").gyro
    assert tactical.random_walk / math.sqrt(540.0) / u.DEG_PER_HR == pytest.approx(0.323, abs=5e-4)  # printed digits


@pytest.mark.parametrize("name", ["ln200", "LN 200", "ln_200", "LN-200"])
def test_lookup_ignores_case_and_separators(name):
    assert catalogue.entry(name).name == "LN-200"
    assert catalogue.spec(name).name == "LN-200"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: catalogue.spec("HG1800"), "no sensor 'HG1800' in the catalogue; did you mean .*HG1900"),
        (lambda: catalogue.entry("yaman"), "did you mean yaman"),
        (lambda: catalogue.entry("zzzzzz"), r"catalogue.names\(\) lists what there is"),
        (lambda: catalogue.spec("NAV440"), "has no accelerometer noise and bias figures.*NAV440-emulated adds"),
        (lambda: catalogue.spec("AQRS-104"), r"has no accelerometer noise .*use triad\(\) for the part it has"),
        (lambda: catalogue.spec("Humphrey"), "Humphrey .*has no gyroscope noise and bias figures"),
        (
            lambda: catalogue.spec("stefanisko-marine"),
            "no gyroscope and no accelerometer .* only has drift_km_day_below, price_eur_above",
        ),
        (lambda: catalogue.triad("Humphrey", "gyro"), "Humphrey .* has no gyro figures"),
        (lambda: catalogue.triad("LN-200", "magnetometer"), "which: expected 'gyro' or 'accel'"),
        (lambda: catalogue.names("IMU"), "kind: expected one of imu, gyro"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_entries_cannot_be_changed():
    with pytest.raises(TypeError):
        catalogue.entry("LN-200").gyro["arw_deg_rthr"] = 0.0


def test_table_lists_everything():
    lines = catalogue.table().splitlines()
    assert len(lines) == 1 + len(catalogue.names())
    assert all(line.startswith(name) for line, name in zip(lines[1:], catalogue.names(), strict=True))
    assert "0.1 deg/sqrt(h), 0.35 deg/h" in catalogue.table()
