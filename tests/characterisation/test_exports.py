"""Exports: each program, fed with its file, adds the white noise and the bias wander that were identified.

The propagation formulas of the programs are written down here again, from their sources, as the independent twin.
"""

import ast
import re

import numpy as np
import pytest

from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.exports import EXPORTS, export, export_text
from schuler.characterisation.result import AxisNoise, Estimate, Finding, NoiseIdentification
from schuler.exceptions import InputError
from schuler.sensors import GaussMarkov, ImuSpec, NoiseModel, RandomWalk, TriadSpec, White, allan_minimum
from schuler.sensors.spec_file import read_spec_file

RATE = 200.0
N_G, K_G, N_A, K_A = 2.0e-4, 3.0e-6, 1.5e-3, 4.0e-5
SPEC = ImuSpec(
    "test",
    TriadSpec(random_walk=N_G, rate_random_walk=K_G),
    TriadSpec(random_walk=N_A, rate_random_walk=K_A),
    RATE,
)
PROGRAMS = [name for name in EXPORTS if name != "schuler"]


def estimate(value):
    return Estimate(value, 0.02 * value, 0.96 * value, 1.04 * value)


def axis(name, gm=(), **terms):
    empty = np.empty(0)
    curve = AllanCurve(
        empty, empty, empty, empty, empty, empty.astype(np.int64), empty, "overlapping", 0.95, RATE, 10
    )  # fmt: skip
    model = NoiseModel((White(terms.get("N", 0.0)), *(GaussMarkov(s, t) for s, t in gm)))
    return AxisNoise(
        name, "rad/s", RATE, 3600.0, estimate(1.0), curve, {k: estimate(v) for k, v in terms.items()},
        tuple((estimate(s), estimate(t)) for s, t in gm), model, (), np.empty((0, 0)),
    )  # fmt: skip


def identification(gyro, accel=None, refused=None):
    axes = {f"gyro_{letter}": axis(f"gyro_{letter}", **terms) for letter, terms in gyro.items()}
    accel = {"z": {"N": N_A, "K": K_A}} if accel is None else accel
    axes |= {f"accel_{letter}": axis(f"accel_{letter}", **terms) for letter, terms in accel.items()}
    return NoiseIdentification("log", axes, refused or {}, SPEC, {"gyro": {"random_walk": 0.02}})


def values(text):
    """Numbers by key, of YAML, parameter files and Python alike."""
    parts = {}
    for line in text.splitlines():
        bare = line.split("#")[0].strip()
        if match := re.match(r"(?:1\t1\t)?([A-Za-z_0-9]+)(?:\s*[:=,]\s*|\t)\[?([-+0-9.e]+)", bare):
            parts[match[1]] = float(match[2])
    return parts


def per_second_vins(v, dt):
    """integration_base.h: two samples a step, weight dt/2 each, independent; bias noise times dt."""
    return [2 * (dt / 2) ** 2 * v[k] ** 2 / dt for k in ("gyr_n", "acc_n")] + [
        dt**2 * v[k] ** 2 / dt for k in ("gyr_w", "acc_w")
    ]


def per_second_continuous(v, dt):
    """OpenVINS' Propagator and Kalibr: sample variance N^2/dt and weight dt; bias step K^2 dt."""
    return [
        (v["gyroscope_noise_density"] ** 2 / dt) * dt**2 / dt,
        (v["accelerometer_noise_density"] ** 2 / dt) * dt**2 / dt,
        v["gyroscope_random_walk"] ** 2 * dt / dt,
        v["accelerometer_random_walk"] ** 2 * dt / dt,
    ]


def per_second_gtsam(v, dt):
    """CombinedImuFactor.cpp: covariance / dt with Jacobian dt; bias covariance times dt."""
    white = [(v[k] ** 2 / dt) * dt**2 / dt for k in ("GYRO_NOISE", "ACCEL_NOISE")]
    return white + [v[k] ** 2 * dt / dt for k in ("GYRO_BIAS_WALK", "ACCEL_BIAS_WALK")]


def per_second_px4(v, _):
    """covariance.cpp: (dt noise)^2 a prediction, for increments and biases, at the filter's own 10 ms."""
    keys = ("EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE")
    return [(0.01 * v[k]) ** 2 / 0.01 for k in keys]


def per_second_ardupilot(v, _):
    """AP_NavEKF3_core.cpp at 12 ms; biases are increments over dt there: (dt^2 noise)^2, hence /dt^2 as rates."""
    dt = 0.012
    white = [(dt * v[k]) ** 2 / dt for k in ("EK3_GYRO_P_NSE", "EK3_ACC_P_NSE")]
    return white + [(dt**2 * v[k]) ** 2 / dt**2 / dt for k in ("EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE")]


def per_second_kf_gins(v, _):
    """kf_gins.cpp converts, gi_engine.cpp makes q = 2 sigma^2 / corrtime."""
    deg, tau = np.pi / 180.0, v["corrtime"] * 3600.0
    return [
        (v["arw"] * deg / 60.0) ** 2,
        (v["vrw"] / 60.0) ** 2,
        2.0 / tau * (v["gbstd"] * deg / 3600.0) ** 2,
        2.0 / tau * (v["abstd"] * 1e-5) ** 2,
    ]


PER_SECOND = {
    "vins": per_second_vins, "kalibr": per_second_continuous, "openvins": per_second_continuous,
    "gtsam": per_second_gtsam, "px4": per_second_px4, "ardupilot": per_second_ardupilot, "kf-gins": per_second_kf_gins,
}  # fmt: skip


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_program_adds_the_identified_variances(name):
    """N^2 and K^2 a second. Printed digits: seven, nine decimals for parameters; KF-GINS' bias decays within 100 s."""
    text = export_text(SPEC, name, **({"corrtime_s": 1e6} if name == "kf-gins" else {}))
    parts = PER_SECOND[name](values(text), 1.0 / RATE)
    decimals = 1e-4 if name in ("px4", "ardupilot") else 1e-6  # 9 decimals of 3e-5
    if name == "kf-gins":
        decimals = 1e-4  # 0.75 horizon / corrtime
    np.testing.assert_allclose(parts, [N_G**2, N_A**2, K_G**2, K_A**2], rtol=decimals)


@pytest.mark.parametrize("name", PROGRAMS)
def test_inflation_multiplies_root_densities(name):
    plain, both, two = (
        PER_SECOND[name](values(export_text(SPEC, name, inflation=f)), 1.0 / RATE) for f in (1.0, 10.0, (2.0, 5.0))
    )
    decimals = 1e-3 if name in ("px4", "ardupilot") else 1e-5  # printed digits
    np.testing.assert_allclose(np.divide(both, plain), 100.0, rtol=decimals)
    np.testing.assert_allclose(np.divide(two, plain), [4.0, 4.0, 25.0, 25.0], rtol=decimals)


def test_kf_gins_takes_over_a_gauss_markov_bias_as_it_is():
    spec = ImuSpec("gm", TriadSpec(random_walk=N_G, in_run_bias=1e-4, in_run_time=500.0), SPEC.accel, RATE)
    v = values(export_text(spec, "kf-gins"))
    np.testing.assert_allclose(v["corrtime"] * 3600.0, 500.0, rtol=1e-6)  # printed digits
    np.testing.assert_allclose(v["gbstd"] * np.pi / 180.0 / 3600.0, 1e-4, rtol=1e-6)


@pytest.mark.parametrize(("tau", "horizon"), [(1000.0, 1.0), (1171.0, 10.0)])
def test_without_K_the_walk_is_that_of_the_gauss_markov_bias(tau, horizon):
    """sigma sqrt(2 / tau) for horizons far below tau: the next term of the series is -0.375 horizon / tau."""
    result = identification({"x": {"N": N_G, "gm": [(1e-4, tau)]}})
    text = export_text(result, "kalibr", horizon_s=horizon)
    K = values(text)["gyroscope_random_walk"]
    np.testing.assert_allclose(K, 1e-4 * np.sqrt(2.0 / tau) * (1 - 0.375 * horizon / tau), rtol=2e-4)
    assert "K was not identified" in text
    assert f"Gauss-Markov bias at {horizon:g} s" in text


def test_without_K_and_gauss_markov_the_walk_is_that_of_the_bias_instability():
    """0.664 B sqrt(3 / T), within the 3 % of whatever stands for 1/f noise."""
    text = export_text(identification({"x": {"N": N_G, "B": 1e-5}}), "kalibr")
    np.testing.assert_allclose(
        values(text)["gyroscope_random_walk"], allan_minimum(1e-5) * np.sqrt(3.0 / 100.0), rtol=0.03
    )
    assert "Allan deviation of the bias instability at 100 s" in text


def test_a_budget_and_an_identification_with_the_same_terms_give_the_same_numbers():
    spec = ImuSpec("a", TriadSpec(random_walk=N_G, bias_instability=1e-5, in_run_bias=2e-5, in_run_time=50.0),
                   SPEC.accel, RATE)  # fmt: skip
    result = identification({"y": {"N": N_G, "B": 1e-5, "gm": [(2e-5, 50.0)]}})
    for name in PROGRAMS:
        assert values(export_text(spec, name)) == values(export_text(result, name)), name


def test_a_horizon_overrules_K():
    """All terms count then: with K alone nothing changes, with a Gauss-Markov bias beside it K grows."""
    alone = identification({"x": {"N": N_G, "K": K_G}})
    beside = identification({"x": {"N": N_G, "K": K_G, "gm": [(1e-4, 300.0)]}})
    for result, grows in ((alone, False), (beside, True)):
        as_found = values(export_text(result, "kalibr"))["gyroscope_random_walk"]
        at_100 = values(export_text(result, "kalibr", horizon_s=100.0))["gyroscope_random_walk"]
        assert as_found == pytest.approx(K_G, rel=1e-6)
        assert (at_100 > 1.5 * K_G) is grows
        model = RandomWalk(K_G) + GaussMarkov(1e-4, 300.0) if grows else RandomWalk(K_G)
        assert at_100 == pytest.approx(np.sqrt(3.0 * model.allan_variance(100.0) / 100.0), rel=1e-6)


def test_three_axes_become_one():
    result = identification({"x": {"N": 1e-4}, "y": {"N": 2e-4}, "z": {"N": 3e-4, "K": 3e-6}})
    worst, rms = (values(export_text(result, "kalibr", axes=a)) for a in ("worst", "rms"))
    assert worst["gyroscope_noise_density"] == pytest.approx(3e-4)
    assert rms["gyroscope_noise_density"] == pytest.approx(1e-4 * np.sqrt(14.0 / 3.0), rel=1e-6)
    assert worst["gyroscope_random_walk"] == pytest.approx(3e-6)
    assert rms["gyroscope_random_walk"] == pytest.approx(3e-6 / np.sqrt(3.0), rel=1e-6)  # two axes have none


def test_axes_that_were_refused_are_named():
    refused = {"gyro_y": (Finding("stuck", "the same value for 3 min"),)}
    text = export_text(identification({"x": {"N": N_G}, "z": {"K": 1e-6}}, refused=refused), "kalibr")
    assert "worst of gyro_x; N is known to 2 % (1 sigma)" in text
    assert "without gyro_y, gyro_z: the same value for 3 min" in text


def test_a_bias_that_does_not_wander_is_held_constant():
    text = export_text(identification({"x": {"N": N_G}}), "kalibr")
    assert values(text)["gyroscope_random_walk"] == 0.0
    assert "zero, a bias held constant" in text


def test_a_triad_without_white_noise_is_refused():
    with pytest.raises(InputError, match=r"no axis of the gyro has an identified white noise .*motion at 3 s"):
        export_text(identification({}, refused={"gyro_x": (Finding("motion", "motion at 3 s"),)}), "kalibr")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("ros", {}, "expected one of ardupilot, gtsam"),
        ("kalibr", {"topics": "/imu"}, "unknown option 'topics'; known are axes, inflation, horizon_s, rate_hz, topic"),
        ("schuler", {"inflation": 2.0}, "unknown option 'inflation'; known are none"),
        ("kalibr", {"axes": "mean"}, "axes: expected 'worst' or 'rms', got 'mean'"),
        ("kalibr", {"inflation": 0.0}, "inflation: expected a positive number, got 0.0"),
        ("kalibr", {"inflation": (1.0, 2.0, 3.0)}, "expected one factor, or two"),
        ("kalibr", {"horizon_s": float("inf")}, "horizon_s: expected a positive number"),
        ("kalibr", {"rate_hz": "200"}, "rate_hz: expected a positive number, got '200'"),
        ("px4", {"filter_rate_hz": 0.0}, "filter_rate_hz: expected a positive rate"),
        ("kf-gins", {"corrtime_s": -1.0}, "corrtime_s: expected a positive time"),
        ("gtsam", {"integration": float("nan")}, "integration: expected a covariance"),
    ],
)
def test_what_cannot_be_written_is_said(name, options, message):
    with pytest.raises(InputError, match=message):
        export_text(SPEC, name, **options)


def test_a_rate_is_asked_for_where_it_is_needed():
    spec = ImuSpec("no rate", SPEC.gyro, SPEC.accel)
    with pytest.raises(InputError, match="needs the sampling rate; give rate_hz"):
        export_text(spec, "vins")
    assert "acc_n" in export_text(spec, "vins", rate_hz=100.0)
    assert "EKF2_ACC_NOISE" in export_text(spec, "px4")  # works at the filter's rate


def test_something_else_is_refused():
    with pytest.raises(InputError, match="expected a NoiseIdentification or an ImuSpec, got dict"):
        export_text({}, "kalibr")


@pytest.mark.parametrize("name", list(EXPORTS))
def test_files_are_written_whole_and_alike(tmp_path, name):
    result = identification({"x": {"N": N_G, "B": 1e-5, "gm": [(2e-5, 50.0)]}})
    path = export(result, name, tmp_path / f"noise{EXPORTS[name].suffix}")
    assert path.read_text(encoding="utf-8") == export_text(result, name)
    assert path.read_text().isascii()
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_gtsam_is_python_that_sets_every_covariance():
    text = export_text(SPEC, "gtsam")
    called = {}

    class Params:
        @classmethod
        def MakeSharedU(cls, g):
            called["g"] = g
            return cls()

        def __getattr__(self, name):
            return lambda matrix: called.__setitem__(name, matrix)

    space: dict = {}
    exec(compile(ast.parse(text), "gtsam.py", "exec"), space)
    space["preintegration_params"](type("gtsam", (), {"PreintegrationCombinedParams": Params}))
    np.testing.assert_allclose(called["setGyroscopeCovariance"], N_G**2 * np.eye(3), rtol=1e-6)
    np.testing.assert_allclose(called["setBiasAccCovariance"], K_A**2 * np.eye(3), rtol=1e-6)
    assert set(called) == {
        "g", "setGyroscopeCovariance", "setAccelerometerCovariance", "setBiasOmegaCovariance", "setBiasAccCovariance",
        "setIntegrationCovariance", "setBiasAccOmegaInit",
    }  # fmt: skip


@pytest.mark.parametrize("name", ["kalibr", "vins", "kf-gins", "openvins"])
def test_numbers_are_numbers_to_yaml(name):
    """YAML 1.1 reads 1e-5 as text: a number needs its point and, before an exponent, a sign."""
    lines = [line.split("#")[0] for line in export_text(SPEC, name).splitlines()]
    words = [word for line in lines if ":" in line for word in re.split(r"[,\[\]\s]+", line.split(":", 1)[1]) if word]
    numbers = [word for word in words if word[0].isdigit()]
    assert len(numbers) >= 4
    assert all(re.fullmatch(r"\d+\.\d+(e[-+]\d\d)?", word) for word in numbers), numbers


def test_openvins_has_every_key_of_its_own_files():
    text = export_text(SPEC, "openvins", topic="/d455/imu")
    for key in ("T_i_b", "Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC", "Tg", "time_offset", "model", "update_rate"):
        assert re.search(rf"^  {key}:", text, re.MULTILINE), key
    assert text.startswith("%YAML:1.0\n")
    assert "rostopic: /d455/imu" in text


def test_qgroundcontrol_lines_have_five_fields():
    rows = [line.split("\t") for line in export_text(SPEC, "px4").splitlines() if not line.startswith("#")]
    assert [row[2] for row in rows] == ["EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE"]
    assert all(row[:2] == ["1", "1"] and row[4] == "9" and len(row) == 5 for row in rows)


def test_values_outside_a_documented_range_are_marked():
    text = export_text(SPEC, "px4")  # ACC_NOISE 0.015 is within 0.01..1, GYR_NOISE 0.002 too
    assert "outside" not in text
    assert "EKF2_ACC_NOISE [m/s^2]: outside the documented range 0.01 to 1; default 0.35, 0.117 times" in export_text(
        SPEC, "px4", inflation=200.0
    )


def test_turn_on_biases_go_where_the_program_has_a_place():
    spec = ImuSpec("on", TriadSpec(random_walk=N_G, turn_on_bias=0.01, scale_factor=3e-4), SPEC.accel, RATE)
    assert values(export_text(spec, "px4"))["EKF2_GBIAS_INIT"] == 0.01
    text = export_text(spec, "kf-gins")
    assert values(text)["gsstd"] == pytest.approx(300.0)
    assert "(initbgstd: 2063 deg/h)" in text


def test_our_own_file_has_axes_and_uncertainty(tmp_path):
    result = identification({"x": {"N": N_G, "B": 1e-5, "gm": [(2e-5, 50.0)]}})
    parts = read_spec_file(export(result, "schuler", tmp_path / "imu.toml"))
    assert parts.spec == SPEC
    assert parts.sigma == {"gyro": {"random_walk": 0.02}}
    assert parts.axes["gyro_x"] == {"random_walk": N_G, "bias_instability": 1e-5, "gauss_markov": [[2e-5, 50.0]]}
    assert export_text(SPEC, "schuler")
    with pytest.raises(InputError, match="a triad has no axis left"):
        export_text(NoiseIdentification("log", {}, {}, None, {}), "schuler")
