"""Requirements read as written, the catalogue ranked, what limits an IMU and what would pass."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.budget import bottleneck, catalogue_specs, choose_imu, linear_covariance, requirement, true_covariance
from schuler.budget.choice import scaled
from schuler.exceptions import InputError
from schuler.sensors.catalogue import spec
from schuler.units import DEG


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("horizontal < 10 m @ 60 s outage", ("horizontal", 10.0, 1.0, "outage", 60.0)),
        ("horizontal<10m@60s outage", ("horizontal", 10.0, 1.0, "outage", 60.0)),
        ("heading <= 0.5 deg (2 sigma) @ always", ("heading", 0.5 * DEG, 2.0, "always", 0.0)),
        ("velocity < 36 km/h", ("velocity", 10.0, 1.0, "end", 0.0)),
        ("position < 2 km @ 1.5 h", ("position", 2000.0, 1.0, "at", 5400.0)),
        ("tilt < 1 mrad @ outage", ("tilt", 1e-3, 1.0, "outage", 0.0)),
    ],
)
def test_requirements_are_read(text, expected):
    result = requirement(text)
    assert (result.quantity, result.factor, result.when, result.seconds) == (expected[0], *expected[2:])
    assert_allclose(result.limit, expected[1], rtol=1e-12)


@pytest.mark.parametrize(
    "text", ["", "speed < 1 m", "horizontal < 1 deg", "horizontal > 1 m", "tilt < 0 deg", "heading < 1 deg @ soon"]
)
def test_requirements_that_cannot_be_read_say_what_is_expected(text):
    with pytest.raises(InputError, match="requirement"):
        requirement(text)


def test_epochs_that_count(mission):
    """The outage of the example lasts from 90 to 150 s."""
    t = mission.times
    within = requirement("horizontal < 1 m @ 20 s outage").epochs(mission)
    assert_allclose([t[within].min(), t[within].max()], [90.0, 110.0])
    assert t[requirement("horizontal < 1 m @ outage").epochs(mission)].max() == 150.0
    assert requirement("horizontal < 1 m").epochs(mission).nonzero()[0].tolist() == [len(t) - 1]
    assert t[requirement("horizontal < 1 m @ always").epochs(mission)].min() == 60.0
    value, time = requirement("horizontal < 1 m (3 sigma) @ 100 s").worst(mission, np.eye(9)[None].repeat(len(t), 0))
    assert_allclose([value, time], [3.0 * np.sqrt(2.0), 100.0])
    with pytest.raises(InputError, match="records run"):
        requirement("horizontal < 1 m @ 9 h").epochs(mission)


def test_catalogue_is_ranked(mission):
    wanted = requirement("horizontal < 10 m @ 60 s outage")
    specs, left_out = catalogue_specs()
    result = choose_imu(mission, wanted, specs, left_out=left_out)
    for v, row in zip(result.verdicts, result.table().rows, strict=True):
        one = bottleneck(mission, wanted, spec(v.imu)) if v.imu in ("LN-200", "MPU-6000", "VN-200") else None
        assert v.limited_by
        assert one is None or (v.limited_by, v.share) == (one.words, one.share)
        assert row[-1] == f"{v.limited_by} ({100.0 * v.share:.0f} %)"
    values = [v.value for v in result.verdicts]
    order = [({True: 0, None: 1, False: 2}[v.certain], v.value) for v in result.verdicts]
    assert order == sorted(order)
    assert len(values) == len(specs) > 15
    by = {v.imu: v for v in result.verdicts}
    assert by["LN-200"].passes
    assert not by["flenniken-consumer"].passes
    again = wanted.worst(mission, linear_covariance(mission, spec("LN-200")).P)[0]
    assert_allclose(by["LN-200"].value, again, rtol=1e-8)
    assert "KVH-5000" in result.summary()
    assert result.table().row(imu="LN-200")["passes"] == "unknown"  # its turn-on biases are not stated
    assert by["LN-200"].unstated == ("gyro turn_on_bias", "accel turn_on_bias")
    assert (by["LN-200"].certain, by["HG1900"].unstated) == (None, ())
    assert by["BMI088"].unstated == ("accel scale_factor",)
    assert (by["MTi-3"].certain, by["VN-100"].certain) == (None, None)  # nor their scale factors
    assert values.index(by["HG1900"].value) < values.index(by["VN-200"].value)
    assert "lower bounds, turn-on bias or scale factor not being stated" in result.summary()
    assert result.to_dict()["ranking"][0]["imu"] == result.verdicts[0].imu
    assert result.plot() is not None


def test_bottleneck_and_what_would_pass(mission):
    """The value it names is tried: it passes, and 5 % more does not."""
    wanted, imu = requirement("horizontal < 10 m @ 60 s outage"), spec("MTi-G-710")
    result = bottleneck(mission, wanted, imu)
    assert result.field == "gyro random_walk"
    assert result.needed is not None
    assert result.needed < result.present
    field = ("gyro", "random_walk")
    for factor, passes in ((1.0, True), (1.05, False)):
        changed = scaled(imu, field, factor * result.needed / result.present)
        assert (wanted.worst(mission, true_covariance(mission, changed))[0] <= wanted.limit) is passes
    assert_allclose(max(result.sensitivity.values()), result.share)


def test_bottleneck_that_no_specification_has(mission):
    """Asymmetric accelerometers of a good IMU limit it: they are named, and half of what is said to pass passes too."""
    wanted, uneven = requirement("horizontal < 10 m @ 60 s outage"), replace(mission, asymmetry=0.2)
    result = bottleneck(uneven, wanted, spec("LN-200"))
    assert (result.field, result.words) == ("accel asymmetry", "accelerometer asymmetry")
    assert result.present == 0.2
    assert result.needed is not None
    for factor, passes in ((0.5, True), (1.0, True), (1.05, False)):
        given = replace(mission, asymmetry=factor * result.needed)
        assert (wanted.worst(given, true_covariance(given, spec("LN-200")))[0] <= wanted.limit) is passes


def test_sensitivity_is_a_derivative(mission):
    """d ln sigma / d ln N by differences, gains following: 3 %, since this filter is nearly optimal."""
    wanted, imu = requirement("horizontal < 10 m @ 60 s outage"), spec("MTi-G-710")
    result = bottleneck(mission, wanted, imu)
    up, down = (
        np.log(wanted.worst(mission, true_covariance(mission, scaled(imu, ("gyro", "random_walk"), f)))[0])
        for f in (1.05, 1.0 / 1.05)
    )
    assert_allclose((up - down) / (2.0 * np.log(1.05)), result.sensitivity["gyro random_walk"], rtol=0.03)


def test_passing_and_hopeless(mission):
    easy, hard = requirement("horizontal < 1 km @ end"), requirement("horizontal < 1 cm @ end")
    assert bottleneck(mission, easy, spec("LN-200")).needed == bottleneck(mission, easy, spec("LN-200")).present
    assert bottleneck(mission, hard, spec("LN-200")).needed is None
    with pytest.raises(InputError, match="at least one"):
        choose_imu(mission, easy, [])
    with pytest.raises(InputError, match="explain"):
        choose_imu(mission, easy, [spec("LN-200")], explain=("other",))
