"""calibrate_field: what was put in comes out, as sure as it says, and what cannot be is refused."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from field_batch import Batch
from field_cases import (
    AUTOMOTIVE,
    LLH,
    TACTICAL,
    Scene,
    calibrated,
    drawn,
    faces,
    in_sigmas,
    log_of,
    names_of,
    nees_of,
    only,
    quiet,
    signed,
    thesis,
)
from scipy.stats import chi2

from schuler.calibration.field.calibration import calibrate_field
from schuler.calibration.field.options import BLOCKS, FieldOptions
from schuler.calibration.result.parameters import vector
from schuler.exceptions import InputError
from schuler.filtering.states import StateModel
from schuler.frames import wrap_angle
from schuler.recording.series import ImuSeries
from schuler.reproduce.yaman.study.runs import FieldJob, simulated_unit
from schuler.reproduce.yaman.study.runs import calibrated as calibrated_job
from schuler.reproduce.yaman.study.tables import static_spec
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.routine import thesis_routine
from schuler.simulation.steps import Rest, Routine, Turn
from schuler.units import DEG

EXACT = FieldOptions(rescale=False, settled=1e-3, passes=12)


# --------------------------------------------------------------------------------------- what was put in comes out

SUBSETS = [subset for n in range(1, 8) for subset in combinations(BLOCKS, n)]
SOME = [subset for subset in SUBSETS if len(subset) in (1, 6, 7)] + [
    ("b_a", "b_g"), ("S_a", "S_g"), ("b_a", "S_a", "M_a"), ("b_g", "S_g", "M_g", "G_g"), ("b_a", "b_g", "S_a", "S_g"),
]  # fmt: skip


def recovered(blocks, sign, scene):
    """A unit with errors of one sigma in these blocks, no noise, but a hundredth of it in the filter's mind."""
    options = replace(EXACT, blocks=blocks)
    errors = only(signed(AUTOMOTIVE, sign), blocks)
    solution = calibrated(
        scene, log_of(scene, errors), quiet(AUTOMOTIVE, 0.01), options, heading=(0.0, 1e-6)
    ).calibration
    assert solution.names == names_of(AUTOMOTIVE, options)
    prior = np.array([solution.prior_sigma[name] for name in solution.names])
    return np.abs(solution.values - vector(errors, solution.names)) / prior


@pytest.mark.thinned(3)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("blocks", SOME, ids=" ".join)
def test_perfect_data_return_what_was_put_in(blocks, sign):
    """To 1e-6 of one sigma before: 50 Hz are not infinitely fast, and the prior pulls. Linearisation leaves nothing."""
    assert recovered(blocks, sign, thesis(1, 50.0)).max() < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("blocks", SUBSETS, ids=" ".join)
def test_perfect_data_return_what_was_put_in_with_every_selection(blocks, sign):
    assert recovered(blocks, sign, thesis(1, 50.0)).max() < 2e-6


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("spec", [AUTOMOTIVE, TACTICAL], ids=["automotive", "tactical"])
def test_units_of_either_sign_with_noise(spec, sign):
    """All errors one sigma of one sign: each within 4.5 sigma, all together in their chi-square band. Statistical."""
    scene, errors = thesis(1, 50.0), signed(spec, sign)
    result = calibrated(scene, log_of(scene, errors, np.random.default_rng(3)), spec, heading=(0.0, 0.1 * DEG))
    assert result.calibration.status == "ok"
    z = in_sigmas(result, errors)
    assert np.abs(z).max() < 4.5
    truth = vector(errors, result.calibration.names)
    assert chi2.ppf(1e-4, len(z)) < nees_of(result, truth) < chi2.isf(1e-4, len(z))


def test_passes_settle():
    """Each pass moves the parameters by much less than the one before: quadratically, not for ever."""
    scene, errors = thesis(1, 50.0), signed(AUTOMOTIVE, 1.0)
    result = calibrated(scene, log_of(scene, errors, np.random.default_rng(1)), AUTOMOTIVE, EXACT)
    steps = np.abs(np.diff(result.passes, axis=0) / result.calibration.sigma).max(axis=1)
    assert len(result.passes) <= 6
    assert steps[0] > 1.0  # a single pass is wrong by more than its sigma
    assert np.all(steps[1:] < 0.3 * steps[:-1])
    assert steps[-1] < 1e-3
    np.testing.assert_array_equal(result.passes[-1], result.calibration.values)


def test_a_unit_of_two_and_a_half_sigma_settles():
    """0.2 g, 30 deg/s: of 200 drawn MPU-6000 the one whose first pass bears no thirty sigma of a block."""
    job = FieldJob(static_spec("MPU-6000"), rests="given")
    (imu, _), errors, heading = simulated_unit(job, np.random.SeedSequence(1).spawn(123)[122])
    result = calibrated_job(job, imu, heading)
    assert result.calibration.status == "ok"
    truth = vector(errors, result.calibration.names)
    assert chi2.ppf(1e-4, len(truth)) < nees_of(result, truth) < chi2.isf(1e-4, len(truth))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", ["yaman-automotive", "MPU-6000"])
@pytest.mark.parametrize("share", [0.1, 0.01])
def test_wide_priors_settle(name, share):
    """Good sensors of which hardly anything is known: errors of second order are up to 4000 sigma of a block.

    Noise-free, so what is left is the readings' finite rate; one sigma at a hundredth of the noise.
    """
    spec = catalogue.spec(name)
    for seed in range(3):
        errors = ImuErrors.draw(spec, np.random.default_rng(seed), gauge="upper")
        scene = thesis(1, 50.0)
        result = calibrated(scene, log_of(scene, errors), quiet(spec, share), heading=(0.0, 1e-3))
        assert result.calibration.status != "refused"
        prior = np.array([result.calibration.prior_sigma[n] for n in result.calibration.names])
        off = np.abs(result.calibration.values - vector(errors, result.calibration.names))
        assert np.max(off / prior) < 2e-3


@pytest.mark.campaign
@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("spec", "scene"),
    [
        (AUTOMOTIVE, faces(50.0)),
        (TACTICAL, faces(50.0)),
        pytest.param(AUTOMOTIVE, thesis(1, 50.0), marks=pytest.mark.slow),
        pytest.param(TACTICAL, thesis(1, 50.0), marks=pytest.mark.slow),
    ],
)
def test_agreement_with_a_batch_adjustment(spec, scene):
    """Gauss-Newton over all attitudes and parameters at once, another program from end to end.

    Seen: values to 0.02 sigma, sigmas to 0.5 percent. What differs: the filter carries its covariance at 10 Hz, and has
    the first levelling ten times as uncertain as it is (the batch a hundred times).
    """
    errors, rng, _ = drawn(spec, 0)
    imu = log_of(scene, errors, rng)
    heading = (0.01, DEG)
    options = replace(EXACT, earth_rate="vertical")
    solution = calibrated(scene, imu, spec, options, heading=heading).calibration
    sigma = [solution.prior_sigma[n] for n in solution.names]
    batch = Batch.of(imu, scene.rests(imu), spec, solution.names, sigma, (LLH[0], 0.0, LLH[2]), heading)
    values, covariance, _ = batch.solve(solution.values)
    theirs = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((solution.values - values) / theirs, 0.0, atol=0.05)
    np.testing.assert_allclose(solution.sigma / theirs, 1.0, atol=0.01)


# ---------------------------------------------------------------------------------------------------- heading


@pytest.mark.thinned(3)
@pytest.mark.parametrize("true", [0.0, 100.0 * DEG, -160.0 * DEG])
@pytest.mark.parametrize("spec", [AUTOMOTIVE, TACTICAL], ids=["automotive", "tactical"])
def test_a_heading_that_is_not_known_is_found(spec, true):
    """By the Earth's horizontal rate: to 11..14 deg at automotive, 2 deg at tactical grade, and honestly so."""
    scene = Scene.of(replace(thesis_routine(), rpy_nb=(0.0, 0.0, true)), 50.0)
    errors, rng, _ = drawn(spec, 5)
    result = calibrated(scene, log_of(scene, errors, rng), spec, heading=None)
    assert result.heading is not None
    angle, sigma = result.heading
    assert abs(wrap_angle(angle - true)) < 4.0 * sigma  # statistical
    assert sigma < (20.0 if spec is AUTOMOTIVE else 3.0) * DEG
    truth = vector(errors, result.calibration.names)
    assert chi2.ppf(1e-4, len(truth)) < nees_of(result, truth) < chi2.isf(1e-4, len(truth))
    assert any(line.startswith("heading of the first rest") for line in result.calibration.verdicts)


def test_a_heading_that_is_hardly_known_is_found():
    """Told to 60 deg and 70 deg off: linearised where the log has it, as if it had not been told. To 0.05 sigma."""
    scene = Scene.of(replace(thesis_routine(repeats=1), rpy_nb=(0.0, 0.0, -70.0 * DEG)), 50.0)
    errors, rng, _ = drawn(AUTOMOTIVE, 5)
    imu = log_of(scene, errors, rng)
    untold, given = (calibrated(scene, imu, AUTOMOTIVE, heading=h) for h in (None, (0.0, 60.0 * DEG)))
    assert given.heading == pytest.approx(untold.heading, abs=0.01)
    off = (given.calibration.values - untold.calibration.values) / untold.calibration.sigma
    np.testing.assert_allclose(off, 0.0, atol=0.05)
    np.testing.assert_allclose(given.calibration.sigma, untold.calibration.sigma, rtol=0.01)


def test_a_heading_that_is_wrong_shows():
    """Tactical gyroscopes see the Earth's horizontal rate: a heading that is off by a right angle spoils the biases."""
    scene = thesis(1, 50.0)
    errors, rng, _ = drawn(TACTICAL, 2)
    imu = log_of(scene, errors, rng)
    right, wrong = (calibrated(scene, imu, TACTICAL, heading=(angle, DEG)) for angle in (0.0, 90.0 * DEG))
    truth = vector(errors, right.calibration.names)
    assert nees_of(wrong, truth) > 3.0 * nees_of(right, truth)
    assert wrong.nis["gravity_vector"][0] > 1.02 * right.nis["gravity_vector"][0]


# ---------------------------------------------------------------------------------------- warned, refused, errors


def scene_of(*steps):
    return Scene.of(Routine(tuple(steps)), 50.0)


def about(axis, n, dwell=5.0):
    steps = []
    for _ in range(n):
        steps += [Rest(dwell), Turn(axis, 45.0 * DEG, 1.25)]
    return (*steps, Rest(dwell))


@pytest.mark.parametrize("rests", [1, 3])
def test_too_few_rests_are_refused_with_what_to_do(rests):
    scene = scene_of(*about("x", rests - 1))
    imu = log_of(scene, signed(AUTOMOTIVE, 1.0), np.random.default_rng(0))
    result = calibrated(scene, imu, AUTOMOTIVE).calibration
    assert result.status == "refused"
    assert result.verdicts[0].startswith(f"only {rests} rests were found, at least four in different attitudes")
    assert "turn by 45 deg or more" in result.verdicts[0]
    assert np.isfinite(result.values).all()


@pytest.mark.parametrize(
    ("pitch", "missing"), [(0.0, ("M_a_xx", "M_a_yy", "M_a_xy")), (90.0 * DEG, ("M_a_zz",))], ids=["x, y", "z"]
)
def test_an_axis_that_is_never_up_is_named(pitch, missing):
    """Turned about z alone: lying flat x and y never see gravity, with the nose up z does not.

    What is not seen keeps its prior: value and sigma.
    """
    scene = Scene.of(Routine(about("z", 8), (0.0, pitch, 0.0)), 50.0)
    imu = log_of(scene, signed(AUTOMOTIVE, -1.0), np.random.default_rng(0))
    result = calibrated(scene, imu, AUTOMOTIVE).calibration
    assert result.status == "warning"
    text = next(line for line in result.verdicts if line.startswith("not determined"))
    assert "rest with the" in result.next_pose
    for name in missing:
        assert name in text
        value, sigma = result[name]
        assert sigma > 0.7 * result.prior_sigma[name]
        assert abs(value) < 3.0 * result.prior_sigma[name]


def test_only_the_blocks_that_are_wanted():
    """Blocks left out stay zero; those the specification knows nothing of are left out by themselves."""
    scene = thesis(1, 50.0)
    unit = only(signed(TACTICAL, 1.0), ("b_a", "b_g"))
    imu = log_of(scene, unit, np.random.default_rng(0))
    solution = calibrated(scene, imu, TACTICAL, FieldOptions(blocks=("b_a", "b_g")))
    result = solution.calibration
    assert result.names == tuple(f"b_{t}_{i}" for t in "ag" for i in "xyz")
    assert result.fixed["M_a_xx"] == 0.0
    assert np.abs(in_sigmas(solution, unit)).max() < 4.5
    assert not any(name.startswith("G_g") for name in names_of(TACTICAL))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"latitude": 39.92}, "latitude: expected radians within a quarter turn, got 39.92"),
        ({"options": FieldOptions(blocks=())}, "says nothing on biases, scale factors or misalignments"),
    ],
)
def test_impossible_arguments(more, message):
    scene = faces(50.0)
    imu = log_of(scene, signed(AUTOMOTIVE, 1.0))
    with pytest.raises(InputError, match=message):
        calibrate_field(imu, AUTOMOTIVE, **({"latitude": LLH[0], "rests": scene.rests(imu)} | more))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FieldOptions(blocks=("b_a", "bias")), "blocks: expected some of b_a, b_g, .* got 'bias'"),
        (lambda: FieldOptions(models={"M_a6": StateModel.constant(1.0)}), "got 'M_a6'"),
        (lambda: FieldOptions(passes=0), "expected positive block_s, passes"),
        (lambda: FieldOptions(block_s=0.0), "expected positive block_s, passes"),
    ],
)
def test_impossible_options(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_rests_of_another_log_and_no_rest_at_all():
    scene = faces(50.0)
    imu = log_of(scene, signed(AUTOMOTIVE, 1.0), np.random.default_rng(0))
    with pytest.raises(InputError, match="rests: expected those of this log"):
        calibrate_field(imu.between(0.0, 50.0), AUTOMOTIVE, latitude=LLH[0], rests=scene.rests(imu))
    t = np.arange(3000) / 50.0
    shaken = ImuSeries(t, np.sin(7.0 * t)[:, None] * [1.0, 1.2, 0.8], 10.0 * np.cos(5.0 * t)[:, None] * [1.0, 0.7, 1.1])
    with pytest.raises(InputError, match="no rest was found in the log: lay the unit down"):
        calibrate_field(shaken, AUTOMOTIVE, latitude=LLH[0])


# ------------------------------------------------------------------------------------------------ the result


def test_the_result_is_that_of_any_other_method():
    """Gauge, compensation, residuals, history: a compensated log reads gravity at its rests."""
    scene, seen = thesis(1, 50.0), []
    errors, rng, heading = drawn(AUTOMOTIVE, 8)
    imu = log_of(scene, errors, rng)
    solution = calibrated(scene, imu, AUTOMOTIVE, heading=heading, progress=seen.append)
    result = solution.calibration
    assert result.method == "field"
    assert result.gauge == "upper"
    assert seen[-1] == 1.0
    assert np.all(np.diff(seen) >= 0.0)
    f = solution.rests.means(result.apply(imu))[1]
    np.testing.assert_allclose(np.linalg.norm(f, axis=1), 9.79854, atol=6.0 * 0.0083 / np.sqrt(7.0))
    accel = result.residuals["accel"]
    assert np.abs(accel.value / accel.sigma).max() < 4.5  # statistical
    assert accel.rms < 0.02 * np.sqrt(np.mean(accel.before**2))
    history = solution.history
    assert history.names == result.names
    np.testing.assert_allclose(history.sigma[-1], result.sigma, rtol=1e-9)
    np.testing.assert_allclose(history.values[-1], result.values, atol=1e-12)
    assert np.all(history.normalised[0] < 1.0 + 1e-9)
    again = calibrated(scene, imu, AUTOMOTIVE, heading=heading)
    np.testing.assert_array_equal(again.calibration.values, result.values)
    assert f"{len(solution.passes)} passes" in solution.summary()


def test_rates_and_increments_give_the_same():
    """The same samples as rates: trapezoids for parabolas, small beside a sigma."""
    scene = thesis(1, 100.0)
    errors, rng, heading = drawn(AUTOMOTIVE, 8)
    imu = log_of(scene, errors, rng)
    h = 1.0 / scene.ideal.rate_hz
    # a rate at the middle of the interval whose increment it is
    rates = ImuSeries(imu.t - 0.5 * h, imu.gyro / h, imu.accel / h, "rate")
    a = calibrated(scene, imu, AUTOMOTIVE, heading=heading).calibration
    b = calibrated(scene, rates, AUTOMOTIVE, heading=heading).calibration
    np.testing.assert_allclose((a.values - b.values) / a.sigma, 0.0, atol=0.25)
    np.testing.assert_allclose(a.sigma / b.sigma, 1.0, atol=0.01)


def test_local_gravity_scales_the_accelerometers():
    """1e-3 more gravity than the ellipsoid's is 1e-3 less scale factor, of all axes."""
    scene = thesis(1, 50.0)
    errors, rng, heading = drawn(TACTICAL, 8)
    imu = log_of(scene, errors, rng)
    plain = calibrated(scene, imu, TACTICAL, heading=heading).calibration
    more = calibrated(scene, imu, replace(TACTICAL, accel=replace(TACTICAL.accel, scale_factor=3e-3)), heading=heading,
                      gravity=1.001 * 9.798539).calibration  # fmt: skip
    for name in ("M_a_xx", "M_a_yy", "M_a_zz"):
        assert more[name][0] - plain[name][0] == pytest.approx(-1e-3, abs=3e-5)


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [1, pytest.param(30, marks=pytest.mark.campaign)])
def test_halves_agree_by_default_with_the_heading_of_the_complete_log(runs):
    """Statistical: no log is doubted, and root mean squares are those of right claims; the heading is not given."""
    scene, squares = thesis(), []
    for seed in range(runs):
        errors, rng, _ = drawn(AUTOMOTIVE, 1000 + seed)
        result = calibrated(scene, log_of(scene, errors, rng), AUTOMOTIVE, heading=None, halves=True).calibration
        halves = result.extra["halves"]
        assert halves["verdict"]["status"] == "ok"
        squares += [z**2 for z in halves["splits"]["first and second half"].values()]
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.5


def test_a_bias_that_jumps_between_the_halves_is_found_by_default():
    """A gyroscope that is another one from the middle on: five claims of b_g or more."""
    scene = thesis()
    errors, rng, heading = drawn(AUTOMOTIVE, 7)
    imu = log_of(scene, errors, rng)
    late = imu.t > imu.t[len(imu.t) // 2]
    jumped = replace(imu, gyro=imu.gyro + np.outer(late, np.full(3, 3e-3 * imu.interval)))
    result = calibrated(scene, jumped, AUTOMOTIVE, heading=heading, halves=True).calibration
    assert result.status == "warning"
    assert result.extra["halves"]["widened"]["b_g"] > 2.0
