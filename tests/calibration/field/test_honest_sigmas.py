"""As sure as it says: noise that is not as stated, walks, earlier calibrations, the source's form, and the hand."""

import numpy as np
import pytest
from field_cases import (
    AUTOMOTIVE,
    band,
    calibrated,
    campaign,
    drawn,
    faces,
    log_of,
    names_of,
    nees_of,
    signed,
    thesis,
    wandering,
)
from scipy.signal import lfilter
from scipy.stats import chi2

from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.problem import field_layout
from schuler.calibration.result.parameters import vector
from schuler.filtering.states import StateModel
from schuler.recording.series import ImuSeries
from schuler.units import DEG, DEG_PER_HR_PER_G, G0


def white(imu, scene, rng):
    """Ten times the stated noise of the accelerometers."""
    h = 1.0 / scene.ideal.rate_hz
    more = 10.0 * AUTOMOTIVE.accel.random_walk * np.sqrt(h) * rng.standard_normal(imu.accel.shape)
    return ImuSeries(imu.t, imu.gyro, imu.accel + more, "increment")


def swaying(imu, scene, rng):
    """A hand: 3 mg over a second."""
    h = 1.0 / scene.ideal.rate_hz
    keep = np.exp(-h)
    w = 3e-3 * G0 * np.sqrt(1.0 - keep**2) * rng.standard_normal(imu.accel.shape)
    return ImuSeries(imu.t, imu.gyro, imu.accel + h * lfilter([1.0], [1.0, -keep], w, axis=0), "increment")


def settled(imu, scene, rng):
    """Another offset of 1 mg in each pose: a support that gives way, a bias that depends on the pose."""
    accel, h = imu.accel.copy(), 1.0 / scene.ideal.rate_hz
    for a, b in scene.rests(imu).index:
        accel[a - 5 : b + 5] += 1e-3 * G0 * h * rng.standard_normal(3)
    return ImuSeries(imu.t, imu.gyro, accel, "increment")


@pytest.mark.thinned(4)
@pytest.mark.parametrize("runs", [8, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("spoil", "factor", "allowed"),
    [(None, (1.0, 1.0), 0.0), (white, (1.0, 1.0), 0.0), (swaying, (1.5, 6.0), 0.25), (settled, (5.0, 30.0), 0.0)],
    ids=["as stated", "white", "swaying", "settled"],
)
def test_sigmas_are_honest_when_the_noise_is_not_as_stated(spoil, factor, allowed, runs):
    """White noise is found in the scatter of blocks; what is common to the blocks of a rest in the rests themselves.

    NEES seen over 60 runs: 1.00, 1.02, 1.16 (the sway also tilts what is taken for up), 0.91. Without the test of rests
    the last two are 1.8 and 3.2.
    """
    mean, _, solutions = campaign(thesis(2, 50.0), AUTOMOTIVE, runs, spoil)
    low, high = band(runs, 30)
    assert low < mean < high + allowed
    enlarged = [r.calibration.extra["noise_enlarged"].get("gravity_vector", 1.0) for r in solutions]
    assert factor[0] <= np.mean(enlarged) <= factor[1]
    if factor[1] > 1.0:
        assert any("times as large as the noise at rest" in line for line in solutions[0].calibration.verdicts)


def test_noise_is_not_enlarged_if_not_wanted():
    errors, rng, heading = drawn(AUTOMOTIVE, 1)
    scene = thesis(1, 50.0)
    imu = settled(log_of(scene, errors, rng), scene, rng)
    on, off = (
        calibrated(scene, imu, AUTOMOTIVE, FieldOptions(rescale=flag), heading=heading).calibration
        for flag in (True, False)
    )
    assert off.extra["noise_enlarged"] == {}
    assert np.median(on.sigma / off.sigma) > 1.2
    assert off.variance_of_unit_weight > 1.05


@pytest.mark.thinned(3)
@pytest.mark.parametrize("runs", [6, pytest.param(40, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "models",
    [
        {"b_a": StateModel.random_walk(0.05, 1e-2)},  # 0.17 m/s^2 in a set: more than was known before
        {"b_g": StateModel.random_walk(1e-3, 1e-5)},
        {"b_g": StateModel.gauss_markov(1e-4, 100.0)},
        {"b_a": StateModel.gauss_markov(0.01, 50.0)},
        {"S_a": StateModel.random_walk(1e-2, 1e-4), "S_g": StateModel.random_walk(1e-2, 1e-4)},
    ],
    ids=["b_a walks", "b_g walks", "b_g decays", "b_a decays", "S walk"],
)
def test_walks_and_decays_are_what_they_are(models, runs):
    """Parameters that move as their models say: those at the end of the log, NEES in its band. Statistical."""
    scene, options = thesis(1, 50.0), FieldOptions(models=models)
    layout, nees = field_layout(AUTOMOTIVE, options), []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        imu, truth = wandering(scene, layout, AUTOMOTIVE, rng)
        result = calibrated(scene, imu, AUTOMOTIVE, options, heading=(DEG * rng.standard_normal(), DEG))
        nees.append(nees_of(result, truth) / len(truth))
    low, high = band(runs, 30)
    # noise from the log has some of a walk in it, and is then conservative
    assert 0.85 * low < np.mean(nees) < high


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_two_sessions_are_better_than_one(runs):
    """The second starts from the first: as sure as both together, to 30 percent, and honest.

    The largest sigma of a block is taken for all of it, without correlations, so it is not the same.
    """
    ratio, nees = [], []
    for seed in range(runs):
        errors, rng, heading = drawn(AUTOMOTIVE, seed)
        one, two = thesis(1, 50.0), faces(50.0)
        a = calibrated(one, log_of(one, errors, rng), AUTOMOTIVE, heading=heading).calibration
        imu = log_of(two, errors, rng)
        alone = calibrated(two, imu, AUTOMOTIVE, heading=(0.0, DEG)).calibration
        both = calibrated(two, imu, AUTOMOTIVE, heading=(0.0, DEG), prior=a)
        prior = np.diag([1.0 / a.prior_sigma[n] ** 2 for n in a.names])
        together = np.linalg.inv(np.linalg.inv(a.covariance) + np.linalg.inv(alone.covariance) - prior)
        ratio.append(both.calibration.sigma / np.sqrt(np.diag(together)))
        nees.append(nees_of(both, vector(errors, a.names)) / len(a.names))
    np.testing.assert_allclose(np.mean(ratio, axis=0), 1.0, atol=0.3)
    low, high = band(runs, 30)
    assert low < np.mean(nees) < high


def test_a_prior_in_another_gauge_is_the_same():
    errors, rng, heading = drawn(AUTOMOTIVE, 4)
    one, two = thesis(1, 50.0), faces(50.0)
    a = calibrated(one, log_of(one, errors, rng), AUTOMOTIVE, heading=heading).calibration
    imu = log_of(two, errors, rng)
    upper, lower = (
        calibrated(two, imu, AUTOMOTIVE, heading=(0.0, DEG), prior=p).calibration for p in (a, a.in_gauge("lower"))
    )
    # back and forth through derivatives: 1e-3 of a sigma
    np.testing.assert_allclose((upper.values - lower.values) / upper.sigma, 0.0, atol=5e-3)
    np.testing.assert_allclose(upper.sigma / lower.sigma, 1.0, atol=5e-3)


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [20, pytest.param(200, marks=pytest.mark.slow)])
def test_the_source_takes_earth_rate_for_g_sensitivity(runs):
    """P2 as printed and one pass: diagonal of G_g off by +8..+13 deg/h/g, scale factors by the pattern of Table 5.3.

    Signs are estimate minus truth, the thesis prints truth minus estimate. The corrected form has neither.
    """
    scene = thesis(2, 50.0)
    names = names_of(AUTOMOTIVE)
    diagonal = [names.index(f"G_g_{i}{i}") for i in "xyz"]
    scale = [names.index(f"M_a_{i}{i}") for i in "xyz"]
    mean, error, _ = campaign(scene, AUTOMOTIVE, runs, options=FieldOptions.thesis())
    g = error[:, diagonal].mean(axis=0) / DEG_PER_HR_PER_G
    assert np.all((g > 8.0) & (g < 13.0)), g
    ppm, ppm_error = error[:, scale].mean(axis=0) * 1e6, error[:, scale].std(axis=0) * 1e6 / np.sqrt(runs)
    assert ppm[0] > 0.0 > max(ppm[1:])  # x the other way, y and z far more
    assert np.all(ppm[1:] < -3.0 * ppm_error[1:])
    assert mean > 2.0
    honest, error, solutions = campaign(scene, AUTOMOTIVE, runs)
    low, high = band(runs, 30)
    assert low < honest < high
    for k in diagonal + scale:
        limit = 3.5 * solutions[0].calibration.sigma[k] / np.sqrt(runs)  # statistical
        assert abs(error[:, k].mean()) < limit, names[k]


def test_options_of_the_source():
    options = FieldOptions.thesis()
    assert (options.passes, options.earth_rate, options.secondary, options.secondary_from_s) == (
        1, "magnitude", "reduced", 270.0,
    )  # fmt: skip
    scene = thesis(2, 50.0)
    result = calibrated(scene, log_of(scene, signed(AUTOMOTIVE, 1.0), np.random.default_rng(0)), AUTOMOTIVE, options)
    assert set(result.nis) == {"gravity", "earth_rate_magnitude", "gravity_vector"}
    assert len(result.passes) == 1
    assert result.calibration.extra["noise_enlarged"] == {}
    # gyro scale factors are only seen from the second half on
    h = result.history
    before = np.searchsorted(h.t, 265.0)
    for name in ("M_g_xx", "M_g_yy", "M_g_zz"):
        assert h.normalised[before, h.names.index(name)] > 0.9
        assert h.normalised[-1, h.names.index(name)] < 0.1


@pytest.mark.parametrize("lever", [(0.05, -0.03, 0.02), (0.2, 0.1, 0.0)])
def test_an_imu_off_the_turning_axis_costs_nothing_at_rest(lever):
    """In turns it feels centripetal force: readings at rest are the same, so the result is, to 0.003 sigma."""
    errors, rng, heading = drawn(AUTOMOTIVE, 0)
    results = []
    for scene in (thesis(1, 100.0), thesis(1, 100.0, lever)):
        imu = log_of(scene, errors, np.random.default_rng(7))
        results.append(calibrated(scene, imu, AUTOMOTIVE, heading=heading).calibration)
    here, off = results
    np.testing.assert_allclose((here.values - off.values) / here.sigma, 0.0, atol=5e-3)
    del rng


@pytest.mark.campaign
def test_in_turns_it_costs_more_than_turns_tell():
    """Gravity in turns as well: in place 1 percent better, 6 cm off the axis 15 percent worse, 22 cm twice as bad.

    Seen over ten runs; tactical 13 and 33 times worse. Noise is enlarged, so the result stays honest.
    """
    ratio = []
    for lever in ((0.0, 0.0, 0.0), (0.05, -0.03, 0.02), (0.2, 0.1, 0.0)):
        scene = thesis(2, 100.0, lever)
        errors, _, heading = drawn(AUTOMOTIVE, 0)
        imu = log_of(scene, errors, np.random.default_rng(7))
        rest, turns = (
            calibrated(scene, imu, AUTOMOTIVE, FieldOptions(during_turns=flag), heading=heading)
            for flag in (False, True)
        )
        ratio.append(float(np.median(turns.calibration.sigma / rest.calibration.sigma)))
        assert turns.nis["gravity_vector"][1] > 2 * rest.nis["gravity_vector"][1]
        truth = vector(errors, rest.calibration.names)
        assert nees_of(turns, truth) < chi2.isf(1e-4, len(truth))
    assert 0.97 < ratio[0] < 1.0
    assert 1.03 < ratio[1] < 1.3
    assert ratio[2] > 1.3
