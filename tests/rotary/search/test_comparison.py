"""A scenario simulated and navigated with its IMU turning and not: as uncertain as linear covariance says."""

from functools import cache

import numpy as np
import pytest

from schuler.exceptions import ConfigError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.rotary.search.comparison import compare_rotary
from schuler.rotary.search.scenario import load_rotary
from schuler.units import DEG, DEG_PER_HR

ALONE = {
    "name": "alone",
    "seed": 5,
    "imu": {"name": "NAV440-emulated", "rate_hz": 20.0, "gyro_bias_deg_h": 50.0, "gyro_instability_deg_h": 0.0,
            "gyro_misalignment_mrad": 2.0, "gyro_scale_ppm": 1000.0},
    "motion": {"type": "static", "lat_deg": 45.0, "lon_deg": 0.0, "duration_s": 60.0, "rpy_deg": (3.0, -5.0, 40.0)},
    "start": {"attitude_deg": (0.05, 0.05, 0.2)},
    "rotary": {"schedule": {"type": "continuous", "axis": "z", "rate_deg_s": 20.0, "acceleration_deg_s2": 50.0}},
}  # fmt: skip
AIDED = {
    **ALONE,
    "name": "aided",
    "motion": {
        "type": "manoeuvres", "lat_deg": 45.0, "lon_deg": 0.0, "heading_deg": 30.0,
        "manoeuvres": [
            {"duration_s": 5.0}, {"duration_s": 8.0, "speed_m_s": 10.0}, {"duration_s": 6.0, "turn_deg": 90.0},
            {"duration_s": 10.0}, {"duration_s": 6.0, "turn_deg": -80.0}, {"duration_s": 45.0},
        ],
    },
    "gnss": {"sigma_position_m": (0.3, 0.3, 0.5), "lever_arm_m": (0.5, 0.2, -1.0), "outages_s": ((50.0, 80.0),)},
    "rotary": {**ALONE["rotary"], "offset_m": (0.4, 0.2, 0.0), "encoder": {"rate_hz": 50.0, "between": "cubic"}},
}  # fmt: skip


@cache
def alone():
    return compare_rotary(ALONE, runs=40)


@cache
def aided():
    return compare_rotary(AIDED, runs=6)


def normalised(way, rows, name, time):
    """Squared errors at a time in units of the predicted covariance, summed over runs; degrees of freedom."""
    at = [int(np.argmin(np.abs(h.t - time))) for h in way.histories]
    ned = np.array([getattr(h, name)[k][[1, 0, 2]] * (1.0, 1.0, -1.0) for h, k in zip(way.histories, at, strict=True)])
    P = way.P[int(np.argmin(np.abs(way.t - time)))][np.ix_(rows, rows)]
    return float(np.einsum("ri,ij,rj->", ned, np.linalg.inv(P), ned)), ned.size


@pytest.mark.campaign
@pytest.mark.thinned(4)
@pytest.mark.parametrize("which", [0, 1], ids=["conventional", "rotary"])
@pytest.mark.parametrize(("rows", "name"), [((0, 1, 2), "attitude"), ((3, 4, 5), "velocity"), ((6, 7, 8), "position")])
def test_free_navigation_scatters_as_predicted(which, rows, name):
    result = alone()
    total, n = normalised(result.ways[which], rows, name, 60.0)
    low, high = chi_square_band(3, n // 3, 0.999)
    assert low < total / n < high  # statistical


@pytest.mark.campaign
@pytest.mark.thinned(2)
@pytest.mark.parametrize("which", [0, 1], ids=["conventional", "rotary"])
def test_the_filter_scatters_as_predicted(which):
    """GNSS, lever arm, offset of the IMU, encoder and an outage together. Few runs: all three kinds of error."""
    result = aided()
    for time in (40.0, 79.0):
        for rows, name in (((0, 1, 2), "attitude"), ((3, 4, 5), "velocity"), ((6, 7, 8), "position")):
            total, n = normalised(result.ways[which], rows, name, time)
            low, high = chi_square_band(3, n // 3, 0.9995)
            assert low < total / n < high, (name, time)  # statistical


@pytest.mark.campaign
def test_only_outages_count_where_there_are_any():
    result = aided()
    t = result.rotary.t
    assert set(t[result.counted(t)]) == {x for x in t if 50.0 <= x < 80.0}
    assert alone().counted(alone().rotary.t).all()
    assert "in the outages" in result.table().title


def test_modulation_leaves_what_lies_along_the_axis():
    result = alone()
    for way, what, bias in ((result.rotary, "gyro", 50.0 * DEG_PER_HR), (result.rotary, "accel", 0.0904)):
        mean = getattr(way, what).mean_n[-1]
        down = result.rotary.schedule.axes[0] @ np.ones(3) * bias
        # the vehicle is tilted: the axis leans from the vertical
        assert np.linalg.norm(mean) == pytest.approx(abs(down), rel=0.05)
        still = getattr(result.conventional, what).bias_n
        np.testing.assert_allclose(still, still[:1].repeat(len(still), 0), rtol=1e-9)
        assert np.linalg.norm(still[0]) == pytest.approx(bias * np.sqrt(3.0), rel=1e-9)


def test_rates_and_tables():
    result = alone()
    assert len(result.rates) == 9
    assert np.all(np.diff(result.sigma["heading"]) > 0.0)  # scale factor
    k = int(np.flatnonzero(np.isclose(result.rates, 20.0 * DEG))[0])
    # rounding: the scenario's own rate
    assert result.sigma["horizontal"][k] == pytest.approx(result.predicted(result.rotary, "horizontal"), rel=1e-9)
    assert "predicted_ratio" in result.summary()
    data = result.to_dict()
    assert data["runs"] == 40
    assert {row["quantity"] for row in data["rms"]} >= {"horizontal [m]", "tilt [deg]"}


def test_a_schedule_without_a_rate_has_no_sweep():
    scheme = {"type": "rates", "axis": "z", "t_s": (0.0, 60.0), "rates_deg_s": (0.0, 20.0)}
    result = compare_rotary({**ALONE, "rotary": {"schedule": scheme}}, runs=1)
    assert len(result.rates) == 0
    assert "against the rate" not in result.summary()


def test_interrupted_after_the_first_run_it_keeps_what_it_has():
    def stop(fraction):
        if fraction > 0.3:
            raise KeyboardInterrupt

    result = compare_rotary(ALONE, runs=4, progress=stop)
    assert not result.complete
    assert len(result.rotary.histories) == len(result.conventional.histories) == 2
    assert "INTERRUPTED" in result.table().summary()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gnss": {"heading_sigma_deg": 1.0}}, "heading is of the vehicle"),
        ({"objective": {"when": "outages"}}, "needs gnss.outages_s"),
        ({"imu": {"name": "NAV440-emulated", "gyro_scale_pppm": 1.0}}, "gyro_scale_ppm"),
        ({"search": {"evaluations": 3}}, "evaluations"),
        ({"rotary": {"schedule": {"type": "dwell", "axis": "z", "rate_deg_s": 3.0}}}, "dwell_s"),
    ],
)
def test_faults_of_a_scenario_are_named(changes, message):
    with pytest.raises(ConfigError, match=message):
        load_rotary({**ALONE, **changes})


def test_what_a_calibration_left_replaces_the_budget():
    spec = load_rotary(ALONE).imu.spec()
    assert spec.gyro.turn_on_bias == pytest.approx(50.0 * DEG_PER_HR)
    assert spec.gyro.bias_instability == 0.0
    assert spec.gyro.misalignment == pytest.approx(2e-3)
    assert spec.accel.turn_on_bias == pytest.approx(0.0904)
