"""Calibrating while navigating: gravity and Earth rate at stops, what they may be combined with, and their honesty."""

from __future__ import annotations

import aided_cases as ac
import numpy as np
import pytest
from aided_recording import IMU, config, drawn, parse, recorded

from schuler import earth, frames, units
from schuler.exceptions import ConfigError
from schuler.filtering import measurements as ms
from schuler.filtering.states import StateModel
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]
#: With the biases: the 39 states of the thesis, in the order of ``filter.states = 39``.
THESIS = {
    "S_a": StateModel.constant(3e-3),
    "S_g": StateModel.constant(3e-3),
    "M_a": StateModel.constant(2e-3),
    "M_g": StateModel.constant(2e-3),
    "G_g": StateModel.constant(2e-5),
}
PARKED = {"b_a": StateModel.constant(0.05), "b_g": StateModel.constant(2e-3)}


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


@pytest.fixture(scope="module")
def parked():
    return ac.Drive.of(ManoeuvreMotion.of([Manoeuvre(duration=31.0)], ac.ORIGIN, heading=0.4), 30.0)


# --------------------------------------------------------------------------------------------- configuration


def test_a_configuration_measures_at_its_rests():
    recording = recorded(drawn())
    c = parse(aiding={"gravity": {"form": "vector", "sigma_m_s2": 0.01, "block_s": 2.0}, "earth_rate": {}})
    s, notes = aiding_schedule(Sources(recording.imu, recording.gnss), c, imu_spec(c), 0.0, 0.0)
    assert notes[0].startswith("at rest: ")
    for kind, variance in (
        (ms.GRAVITY_VECTOR, ac.ACCEL_N**2 / 2.0 + 0.01**2),
        (ms.EARTH_RATE, ac.GYRO_N**2 + (0.005 * units.DEG) ** 2),
    ):
        assert np.sum(s.kind == kind) >= 3
        np.testing.assert_allclose(s.R[s.kind == kind, 0, 0], variance, rtol=1e-9)
    default = parse(aiding={"gravity": {}})
    s, _ = aiding_schedule(Sources(recording.imu, recording.gnss), default, imu_spec(default), 0.0, 0.0)
    assert np.sum(s.kind == ms.GRAVITY) >= 6
    np.testing.assert_allclose(s.R[s.kind == ms.GRAVITY, 0, 0], ac.ACCEL_N**2 + 0.005**2, rtol=1e-9)
    never = Sources(recording.imu.between(20.0, 35.0))
    s, notes = aiding_schedule(never, replace_rest(default, 60.0), imu_spec(default), 20.0, 0.0)
    assert len(s) == 0
    assert notes == ["at rest: 0 intervals, 0.0 s in all (what is measured at rest has nothing to work with)"]


def replace_rest(c, min_s):
    rest = c.aiding.rest.model_copy(update={"min_s": min_s})
    return c.model_copy(update={"aiding": c.aiding.model_copy(update={"rest": rest})})


@pytest.mark.parametrize(
    ("aiding", "message"),
    [
        ({"gravity": {}, "zero_velocity": {}}, "gravity and zero_velocity compare the same accelerometer readings"),
        ({"earth_rate": {}, "zero_rate": {}}, "earth_rate and zero_rate use the same gyro readings"),
        ({"gravity": {"form": "length"}}, "form"),
        ({"gravity": {"sigma_m_s2": -1.0}}, "sigma_m_s2"),
        ({"earth_rate": {"block_s": 0.0}}, "block_s"),
    ],
)
def test_what_would_count_readings_twice_is_refused(aiding, message):
    with pytest.raises(ConfigError, match=message):
        parse(aiding=aiding)


def test_what_does_not_is_allowed():
    parse(aiding={"gravity": {}, "zero_rate": {}})
    parse(aiding={"zero_velocity": {}, "earth_rate": {}})


# ------------------------------------------------------------------------------------------------- honesty

CONFIGURATIONS = {
    "gravity": ({}, [ac.gnss, ac.gravity]),
    "gravity vector": ({}, [ac.gnss, ac.gravity_vector]),
    "Earth rate": ({}, [ac.gnss, ac.zero_velocity, ac.earth_rate]),
    "39 states": (THESIS, [ac.gnss, ac.gravity, ac.earth_rate]),
    "39 states, vector": (THESIS, [ac.gnss, ac.gravity_vector, ac.earth_rate]),
    "39 states, zero velocity": (THESIS, [ac.gnss, ac.zero_velocity, ac.earth_rate]),
}


@pytest.mark.thinned(6)
@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_nees(drive, name, runs):
    """All parameters drawn from their models, measured with the log's own readings, whose noise also drives the state.

    Seen over 100 runs: NEES 0.98 with 15 states, 1.01 to 1.02 with 39, within its band of +-0.09.
    """
    models, aids = CONFIGURATIONS[name]
    lay = ac.layout(**models)
    assert lay.size == (39 if models else 15)
    ac.Campaign.of(drive, lay, aids, range(runs)).check()


def spread(parked, aids, runs=60):
    """Root mean square of the errors of b_a along z and b_g along z, in sigmas, at the end of half a minute parked."""
    final = ac.Campaign.of(parked, ac.layout(**PARKED), aids, range(runs)).final
    return np.sqrt((final[:, [11, 14]] ** 2).mean(axis=0))


def at_standstill(truth):
    """Zero velocity all the time, 2 Hz, 1 cm/s."""
    t = truth.drive.aids_t
    return ms.MeasurementSchedule.of(ms.ZERO_VELOCITY, t, 0.01 * truth.draws(len(t), 3), 0.01**2)


@pytest.mark.campaign
def test_gravity_and_zero_velocity_together_would_be_over_confident(parked):
    """The reason for the refusal: each knows the vertical bias to N/sqrt(T), by the same noise, both claim less."""
    band = 4.5 / np.sqrt(2 * 60)  # statistical, of a spread
    assert abs(spread(parked, [at_standstill])[0] - 1.0) < band
    assert abs(spread(parked, [ac.gravity])[0] - 1.0) < band
    assert abs(spread(parked, [at_standstill, ac.gravity])[0] - np.sqrt(2.0)) < np.sqrt(2.0) * band
    assert spread(parked, [at_standstill, ac.gravity_vector])[0] > 1.25


@pytest.mark.campaign
def test_earth_rate_and_zero_rate_together_would_be_over_confident(parked):
    band = 4.5 / np.sqrt(2 * 60)
    for aid in (ac.zero_rate, ac.earth_rate):
        assert abs(spread(parked, [at_standstill, aid])[1] - 1.0) < band
    assert spread(parked, [at_standstill, ac.zero_rate, ac.earth_rate])[1] > 1.2


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("aids", [[ac.gravity, ac.earth_rate], [ac.gravity_vector, ac.earth_rate]])
def test_biases_of_either_sign_are_estimated_at_rest(parked, aids, sign):
    """Half a minute parked and level, no satellites: both vertical biases; by a direction of gravity what tilts it."""
    given = {"b_a": sign * np.full(3, 0.05), "b_g": sign * np.full(3, 2e-3)}
    one = ac.filtered(parked, ac.layout(**PARKED), aids, 5, given=given, noise=0.1)
    lay = one.result.layout
    _, dx, P = state_errors(one.result, one.truth.reference, one.parameters)
    sigma = np.sqrt(np.diag(P[-1]))
    for name in ("b_a", "b_g"):
        k = lay[name].start + 2
        assert sigma[k] < 0.1 * lay.models[name].sigma
        assert abs(dx[-1, k]) < 1.0 * sigma[k]  # noise is a tenth of what the filter takes it for, and levelling
        assert sign * one.result.parameters[-1, k - 9] > 0.0
        others, tilting = (
            sigma[lay[name].start : k] / lay.models[name].sigma,
            name == "b_g" and ac.gravity_vector in aids,
        )
        assert np.all(others < 0.1) if tilting else np.all(others > 0.6)


def test_earth_rate_needs_no_heading(parked):
    """Without it a bias about the vertical is not seen at rest at all, with any heading error."""
    lay = ac.layout(**PARKED)
    without = ac.filtered(parked, lay, [at_standstill], 1).result.sigma("b_g")[-1, 2]
    with_it = ac.filtered(parked, lay, [at_standstill, ac.earth_rate], 1).result.sigma("b_g")[-1, 2]
    assert without > 0.99 * PARKED["b_g"].sigma
    assert with_it == pytest.approx(ac.GYRO_N / np.sqrt(29.0), rel=0.05)


def test_printed_magnitude_takes_noise_for_a_bias(parked):
    """P2 as printed: noise of a block is more than Earth rate, so its magnitude is no measurement of anything."""
    lay = ac.layout(**PARKED)
    wrong = [
        ac.filtered(parked, lay, [at_standstill, ac.earth_rate_magnitude], k, given={"b_g": np.zeros(3)})
        for k in range(10)
    ]
    nees = [(o.result.parameters[-1, 3:6] / o.result.sigma("b_g")[-1]) for o in wrong]
    assert np.mean(np.square(nees)) > 1.5
    assert earth.WGS84.omega_ie < ac.GYRO_N


# ---------------------------------------------------------------------------------------------- navigate()


RUN_MODELS = PARKED | THESIS


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_run_with_39_states_calibrates_at_its_stops(drive, sign):
    """From a configuration to the result: aids used and accepted, biases of either sign found, as honest as it says."""
    lay = ac.layout(**RUN_MODELS)
    given = {"b_a": sign * np.array([0.04, 0.05, 0.05]), "b_g": sign * np.full(3, 2e-3)}
    truth = ac.Truth(drive, lay, np.random.default_rng(7), given)
    s = ac.gnss(truth)
    position, velocity = (s.where(s.kind == k) for k in (ms.POSITION, ms.VELOCITY))
    gnss = GnssSeries(
        position.t, frames.llh_from_ecef(position.z[:, :3]), position.R, velocity.z[:, :3], velocity.R
    )  # fmt: skip
    recording = Recording(imu=truth.series(), gnss=gnss, reference=truth.reference)
    more = {"scale_percent": 0.3, "misalignment_mrad": 2.0}
    g_sensitivity = {"g_sensitivity_deg_hr_g": THESIS["G_g"].sigma / units.DEG_PER_HR_PER_G}
    sections = {
        "imu": {"gyro": IMU["gyro"] | more | g_sensitivity, "accel": IMU["accel"] | more},
        "filter": {"states": 39},
        "aiding": {"gravity": {"sigma_m_s2": 0.0}, "earth_rate": {"sigma_deg_s": 0.0}},
        "outages": {"windows_s": []},
    }
    result = navigate(recording, config(recording, **sections))
    counts = result.innovations.counts()
    for name in ("gravity", "earth_rate"):
        assert counts[name]["accepted"] >= 15
        assert counts[name]["rejected"] == 0
        assert 0.3 < result.innovations.of(name).mean_nis() < 2.0  # statistical, some twenty values
    assert result.layout.size == 39
    at = np.searchsorted(truth.t, result.t - 1e-9)
    _, dx, P = state_errors(result, truth.reference, truth.history[at])
    low, high = chi_square_band(39, 1, 0.9999)
    assert low < dx[-1] @ np.linalg.solve(P[-1], dx[-1]) / 39 < high
    for name in ("b_a", "b_g"):
        assert sign * result.parameter(name)[-1, 2] > 0.0
    # bias and g-sensitivity act as one at stops on level ground, and their sum is known as well as the readings say
    along = np.zeros(39)
    along[result.layout["b_g"].stop - 1], along[result.layout["G_g"].stop - 1] = 1.0, -9.81
    assert np.sqrt(along @ P[-1] @ along) < 1.5 * ac.GYRO_N / np.sqrt(counts["earth_rate"]["accepted"])
    assert "Earth rate" in result.summary() or "earth_rate" in result.summary()
