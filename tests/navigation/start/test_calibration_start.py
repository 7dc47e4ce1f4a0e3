"""A calibration as the start of a filter: values and P0 as mapped, the log without the rest, and what it is worth."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler import files, rotation, units
from schuler.calibration.bench.counts import CountFactors
from schuler.calibration.result.parameters import LINEAR, imu_errors, vector
from schuler.calibration.result.result import CalibrationResult, result_from
from schuler.exceptions import ConfigError, FileFormatError, InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.error_model import parameter_columns
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout, StateModel, layout_for
from schuler.mechanization.alignment import levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.inputs.preparation import prepared_imu
from schuler.navigation.navigator import Navigator
from schuler.navigation.run import navigate
from schuler.navigation.solution_tables import read_solution
from schuler.navigation.start.calibration import Age, calibration_start, configured_start
from schuler.navigation.states import imu_spec, state_layout
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.simulation.imu import simulate_imu
from schuler.simulation.scenario import prepare_mission, simulate_mission

#: Uncertainty of the calibrations here: a good multi-position one. SI
SIGMA = {"b_a": 2e-4, "b_g": 1e-6, "M_a": 1e-4, "M_g": 1e-4, "G_g": 1e-7}
SHEET = {
    "gyro": {
        "arw_deg_rthr": 0.06, "bias_deg_hr": 20.0, "scale_ppm": 8000.0, "misalignment_mrad": 8.0,
        "g_sensitivity_deg_hr_g": 100.0,
    },
    "accel": {"vrw_m_s_rthr": 0.03, "bias_mg": 1.0, "scale_ppm": 8000.0, "misalignment_mrad": 8.0},
}  # fmt: skip
SPEC = ImuSpec("test", TriadSpec.gyro(**SHEET["gyro"]), TriadSpec.accelerometer(**SHEET["accel"]))
LEVER = [0.7, 0.1, -1.0]
MISSION = {
    "seed": 1,
    "motion": {
        "type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0,
        "waypoints": [
            {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 25.0},
            {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
            {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0},
            {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
        ],
    },
    "imu": {"rate_hz": 100.0, "kind": "increment", **SHEET},
    "gnss": {
        "rate_hz": 1.0, "first_s": 0.37, "lever_arm_m": LEVER,
        "sigma_position_m": [0.03, 0.03, 0.05], "sigma_velocity_m_s": [0.02, 0.02, 0.03],
    },
}  # fmt: skip
OUTAGE = (45.0, 75.0)
STATES = {15: ("b_a", "b_g"), 42: ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")}


def calibration(seed=1, gauge="full", names=None, values=None, scale=1.0, **rest):
    """Errors drawn from the budget, uncertainty ``SIGMA``, all correlated."""
    rng = np.random.default_rng([11, seed])
    zero = {"upper": ("M_a_yx", "M_a_zx", "M_a_zy"), "lower": ("M_a_xy", "M_a_xz", "M_a_yz")}.get(gauge, ())
    names = tuple(n for n in (names or LINEAR) if n not in zero)
    A = rng.standard_normal((len(names), 2 * len(names)))
    C = A @ A.T
    s = np.array([SIGMA[n[:3]] for n in names]) / np.sqrt(np.diag(C))
    C *= np.outer(s, s)
    drawn = vector(ImuErrors.draw(SPEC, rng, gauge=gauge if gauge in ("upper", "lower") else "full"), names)
    return CalibrationResult("multiposition", names, drawn if values is None else values, scale**2 * C, gauge, **rest)


def place(layout, name):
    """Number of the state of a parameter."""
    family, axes = name[:3], name[4:]
    pairs = {
        "M_a6": ("xy", "xz", "yx", "yz", "zx", "zy"),
        "M_a": ("xy", "xz", "yz"),
        "M_g": ("xy", "xz", "yx", "yz", "zx", "zy"),
    }
    if family[0] == "b":
        return layout[family].start + "xyz".index(axes)
    if family == "G_g":
        return layout["G_g"].start + 3 * "xyz".index(axes[0]) + "xyz".index(axes[1])
    if axes[0] == axes[1]:
        return layout[f"S_{family[2]}"].start + "xyz".index(axes[0])
    block = "M_a6" if family == "M_a" and "M_a6" in layout else family
    return layout[block].start + pairs[block].index(axes)


def blank(layout):
    nav = NavState.from_geodetic(0.0, [0.8, 0.1, 400.0])
    return InitialState.from_sigmas(nav, layout, attitude=[0.01] * 3, velocity=[0.1] * 3, position=[1.0] * 3)


SAME = Age(switched=False)


# ------------------------------------------------------------------------------------------- values and P0


@pytest.mark.parametrize(("states", "gauge"), [(39, "upper"), (42, "full"), (42, "lower"), (42, "upper")])
def test_values_and_covariance_come_over_as_they_are(states, gauge):
    """Every parameter has a state: the numbers of the calibration to the last bit, correlations too."""
    layout = layout_for(SPEC, states)
    c = calibration(gauge=gauge)
    calibrated = calibration_start(c, layout, SPEC, age=SAME)
    assert calibrated.correction.is_identity
    initial = calibrated.put_into(blank(layout))
    at = [place(layout, n) for n in c.names]
    assert np.array_equal(initial.parameters[np.array(at) - 9], c.values)
    assert np.array_equal(initial.P[np.ix_(at, at)], c.covariance)
    assert np.array_equal(initial.P[:9, :9], blank(layout).P[:9, :9])
    assert not initial.P[:9, 9:].any()
    # a gauge's zeros are exact
    others = sorted(set(range(9, layout.size)) - set(at))
    assert len(others) == (3 if states == 42 and gauge != "full" else 0)
    assert not initial.P[others].any()
    assert not initial.parameters[np.array(others, dtype=int) - 9].any()


def test_what_is_not_calibrated_starts_as_without():
    layout = layout_for(SPEC, 42)
    names = ("b_a_x", "b_a_y", "b_a_z", "M_a_xx", "M_a_yy", "M_a_zz")
    initial = calibration_start(calibration(names=names), layout, SPEC, age=SAME).put_into(blank(layout))
    for block in ("b_g", "S_g", "M_a6", "M_g", "G_g"):
        part = layout[block]
        assert np.array_equal(initial.P[part], blank(layout).P[part])
    assert initial.P[place(layout, "b_a_x"), place(layout, "M_a_xx")] != 0.0


def test_a_calibration_in_another_gauge_keeps_its_axes():
    """M_a upper from a full M_a: P0 is that of ``in_gauge("upper")``, axes those of the calibration."""
    layout = layout_for(SPEC, 39)
    c = calibration(gauge="full", scale=10.0)
    small = replace(c, values=1e-4 * c.values)  # so that the two gauges differ by nothing but their uncertainty
    calibrated = calibration_start(small, layout, SPEC, age=SAME)
    other = small.in_gauge("upper")
    at = [place(layout, n) - 9 for n in other.names]
    order = [list(calibrated.places).index(k) for k in at]
    C = calibrated.covariance[np.ix_(order, order)]
    s = np.sqrt(np.diag(other.covariance))
    # first order in M, which is 1e-6 here: the derivative of the one gauge at the place of the other
    assert np.abs(C - other.covariance).max() / (s.max() ** 2) < 1e-5
    assert np.abs((C - other.covariance) / np.outer(s, s)).max() < 1e-4
    for name in ("M_g_xy", "M_g_yx", "M_a_xy", "b_a_x"):  # of the calibration's axes, unlike those of in_gauge
        assert calibrated.values[list(calibrated.places).index(place(layout, name) - 9)] == small[name][0]
    assert any("body axes stay those of the calibration" in note for note in calibrated.notes)


def test_biases_have_changed_since():
    """The repeatability from one switch-on to the next unless the unit stayed on, and twice what wanders."""
    gyro = replace(SPEC.gyro, in_run_bias=3e-5, in_run_time=300.0, bias_instability=1e-5)
    spec = replace(SPEC, gyro=gyro)
    c = calibration()
    wander = 2.0 * 3e-5**2 + 2.0 * (1.9 * 1e-5) ** 2
    for age, turn_on_g, turn_on_a in (
        (None, spec.gyro.turn_on_bias, spec.accel.turn_on_bias), (SAME, 0.0, 0.0), (Age(True, 2e-5, 3e-3), 2e-5, 3e-3),
    ):  # fmt: skip
        layout = layout_for(spec, 42)
        P = calibration_start(c, layout, spec, age=age).put_into(blank(layout)).P
        for i, axis in enumerate("xyz"):
            k, j = layout["b_g"].start + i, layout["b_a"].start + i
            assert P[k, k] == pytest.approx(c[f"b_g_{axis}"][1] ** 2 + wander + turn_on_g**2, rel=1e-12)
            assert P[j, j] == pytest.approx(c[f"b_a_{axis}"][1] ** 2 + turn_on_a**2, rel=1e-12)
        i = c.names.index
        assert P[layout["b_g"].start, layout["S_g"].start] == c.covariance[i("b_g_x"), i("M_g_xx")]
    # a state for the in-run part holds one of the two moments
    both = layout_for(spec, ("b_a", "b_g", "b_g_run"))
    P = calibration_start(c, both, spec, age=SAME).put_into(blank(both)).P
    k = both["b_g"].start
    share = (units.G0 * c["G_g_xz"][1]) ** 2  # of the g-sensitivity, which has no state
    T = np.linalg.inv(np.eye(3) + c.errors.M_g)  # which turns the errors of the log
    rough = c["b_g_x"][1] ** 2 + 3e-5**2 + 2.0 * (1.9 * 1e-5) ** 2 + share
    assert P[k, k] == pytest.approx(rough, rel=3.0 * np.abs(T - np.eye(3)).max())
    assert both["b_g_run"].start - 9 not in calibration_start(c, both, spec).places


def test_temperature_slopes_of_the_budget_count():
    spec = replace(SPEC, gyro=replace(SPEC.gyro, bias_temperature=1e-6, scale_temperature=1e-5))
    layout = layout_for(spec, 21)
    c = calibration(temperature=20.0, names=("b_g_x", "b_g_y", "b_g_z", "M_g_xx", "M_g_yy", "M_g_zz"))
    calibrated = calibration_start(c, layout, spec, age=Age(switched=False, temperature=50.0))
    P = calibrated.put_into(blank(layout)).P
    k, j = layout["b_g"].start, layout["S_g"].start
    assert P[k, k] == pytest.approx(c["b_g_x"][1] ** 2 + 3e-5**2, rel=1e-9)
    assert P[j, j] == pytest.approx(c["M_g_xx"][1] ** 2 + 3e-4**2, rel=1e-9)
    assert any("30 K warmer" in note for note in calibrated.notes)


def test_not_determined_and_held_parameters():
    layout = layout_for(SPEC, 42)
    c = calibration(gauge="upper", names=LINEAR[:12])
    C = c.covariance.copy()
    lost = c.names.index("M_a_xz")
    C[lost], C[:, lost] = 0.0, 0.0
    C[lost, lost] = np.inf
    calibrated = calibration_start(
        replace(c, covariance=C, fixed={"G_g_xz": 3e-5, "Q_a_x": 1e-4}), layout, SPEC, age=SAME
    )
    initial = calibrated.put_into(blank(layout))
    k, j = place(layout, "M_a_xz"), place(layout, "G_g_xz")
    assert (initial.parameters[k - 9], initial.P[k, k]) == (0.0, SPEC.accel.misalignment**2)
    assert (initial.parameters[j - 9], initial.P[j, j]) == (3e-5, SPEC.gyro.g_sensitivity**2)
    text = " ".join(calibrated.notes)
    assert "not determined by the calibration, as uncertain as without it: M_a_xz" in text
    assert "held in the calibration, so as uncertain as without it: G_g_xz" in text
    assert "not used, no linear error of the sensors: Q_a_x" in text


def test_gyroscopes_in_their_own_axes_get_the_turn_between_the_triads():
    layout = layout_for(SPEC, 42)
    names = tuple(n for n in LINEAR if n[:3] != "G_g" and n not in ("M_g_xy", "M_g_xz", "M_g_yz"))
    c = calibration(gauge="lower", names=names, extra={"accel": {}, "gyro": {}})
    P = calibration_start(c, layout, SPEC, age=SAME).put_into(blank(layout)).P
    up, low, m2 = place(layout, "M_g_xy"), place(layout, "M_g_yx"), SPEC.gyro.misalignment**2
    assert P[up, up] == pytest.approx(m2, rel=1e-12)
    assert P[low, low] == pytest.approx(m2 + c["M_g_yx"][1] ** 2, rel=1e-12)
    assert P[up, low] == pytest.approx(-m2, rel=1e-12)


def test_hayals_study_seeds_the_same_by_hand():
    """What the emulated study of 2010 puts into its filter: independent sigmas of accelerometers and gyro biases."""
    from schuler.reproduce.hayal.study.walk import (
        CalibrationSigma,
        CartWalk,
        cart_config,
        cart_recording,
        seeded_start,
    )

    config = cart_config("HG1900", wander=False)
    recording, errors, rng = cart_recording(CartWalk.of(minutes=0.5), "HG1900", 1, 0, False)
    sigma = CalibrationSigma(np.linspace(1e-4, 9e-4, 9), np.linspace(1e-6, 9e-6, 9), np.array([1e-6, 2e-6, 3e-6]))
    by_hand = seeded_start(recording, config, errors, "3.3", sigma, rng)
    spec = imu_spec(config)
    layout = state_layout(config, spec)
    names = ("b_a_x", "b_a_y", "b_a_z", "M_a_xx", "M_a_yy", "M_a_zz", "M_a_xy", "M_a_xz", "M_a_yz")
    values = {n: (by_hand.parameters[place(layout, n) - 9], s) for n, s in zip(names, sigma.accel, strict=True)}
    for i, axis in enumerate("xyz"):
        n = f"b_g_{axis}"
        values[n] = (by_hand.parameters[place(layout, n) - 9], sigma.gyro_bias[i])
    c = result_from("multiposition", values, "upper")
    steady = replace(
        spec, gyro=replace(spec.gyro, bias_instability=0.0), accel=replace(spec.accel, bias_instability=0.0)
    )
    again = calibration_start(c, layout, steady, age=SAME).put_into(by_hand)
    assert np.array_equal(again.parameters, by_hand.parameters)
    assert np.array_equal(again.P, by_hand.P)


# ------------------------------------------------------------------------------------- the log without the rest


LAYOUTS = {
    "none": (), "biases": ("b_a", "b_g"), "scales": ("b_a", "b_g", "S_a", "S_g"), "upper": layout_for(SPEC, 39).models,
    "all": layout_for(SPEC, 42).models, "no M_g": ("b_a", "b_g", "M_a6", "S_a", "G_g"), "G only": ("G_g",),
}  # fmt: skip
MOUNT = rotation.dcm_from_rpy(np.radians([8.0, -15.0, 120.0]))


def large(seed=3, gauge="full"):
    """Errors of several percent, so that products of errors count."""
    rng = np.random.default_rng(seed)
    size = {"b_a": 0.5, "b_g": 0.02, "M_a": 0.03, "M_g": 0.03, "G_g": 5e-4}
    c = calibration(gauge=gauge)
    return replace(c, values=np.array([size[n[:3]] for n in c.names]) * rng.standard_normal(len(c.names)))


def readings(kind="rate", n=50, seed=5):
    rng = np.random.default_rng(seed)
    scale = 0.01 if kind == "increment" else 1.0
    return ImuSeries(
        0.01 * np.arange(n), scale * rng.standard_normal((n, 3)), 10.0 * scale * rng.standard_normal((n, 3)), kind
    )


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("gauge", ["full", "upper", "symmetric"])
@pytest.mark.parametrize("C_bs", [None, MOUNT])
def test_log_and_start_together_are_the_complete_calibration(name, gauge, C_bs):
    """Whatever has states: what is taken out before and what the states take out is all of it, exactly."""
    layout = layout_for(SPEC, tuple(LAYOUTS[name]))
    c = large(gauge=gauge)
    if gauge == "symmetric":
        c = replace(
            c, values=np.array([c[n][0] if n[:3] != "M_a" else c["M_a_" + "".join(sorted(n[4:]))][0] for n in c.names])
        )
    calibrated = calibration_start(c, layout, SPEC, C_bs=C_bs)
    for kind in ("rate", "increment"):
        log = readings(kind)
        body = log if C_bs is None else log.rotated(C_bs)
        result = calibrated.compensated(calibrated.corrected(body), layout)
        expected = c.apply(log).rates()
        expected = expected if C_bs is None else expected.rotated(C_bs)
        # rounding only
        assert np.abs(result.gyro - expected.gyro).max() < 1e-12
        assert np.abs(result.accel - expected.accel).max() < 1e-12


@pytest.mark.parametrize("name", LAYOUTS)
def test_errors_of_the_calibration_are_those_of_the_start(name):
    """A true sensor that differs from the calibration: what its changed log has, less the start, is J times that."""
    from schuler.navigation.start.calibrated_errors import calibrated_errors as all_errors
    from schuler.navigation.start.calibrated_errors import state_places
    from schuler.navigation.start.sensor_errors import split_errors

    layout = layout_for(SPEC, tuple(LAYOUTS[name]))
    c = large()
    kept = np.zeros(33, dtype=bool)
    kept[state_places(layout)[1]] = True
    before = all_errors(c, layout, SPEC, [])
    after, correction = split_errors(before, kept)
    rng = np.random.default_rng(8)
    omega, f = rng.standard_normal((40, 3)), 10.0 * rng.standard_normal((40, 3))
    regressors = np.column_stack((np.ones(40), f, omega))

    def effective(truth):
        """All 33 errors of the changed log of a sensor, by regression on what moved it."""
        y = imu_errors(dict(zip(LINEAR, truth, strict=True)))
        gyro, accel = omega @ (np.eye(3) + y.M_g).T + f @ y.G_g.T + y.b_g, f @ (np.eye(3) + y.M_a).T + y.b_a
        gyro, accel = correction.apply(gyro, accel)
        g, a = (np.linalg.lstsq(regressors, x, rcond=None)[0].T for x in (gyro, accel))
        assert np.abs(a[:, 4:]).max() < 1e-12
        return np.concatenate(
            (a[:, 0], (a[:, 1:4] - np.eye(3)).ravel(), g[:, 0], (g[:, 4:] - np.eye(3)).ravel(), g[:, 1:4].ravel())
        )

    assert np.abs(effective(before.values) - after.values).max() < 1e-12  # rounding
    J = np.empty((33, 33))
    for i in range(33):
        truth = before.values.copy()
        truth[i] -= 1e-3
        J[:, i] = (after.values - effective(truth)) / 1e-3
    expected = J @ before.covariance @ J.T
    scale = np.sqrt(np.maximum(np.diag(expected), 1e-30))
    assert np.abs((after.covariance - expected) / np.outer(scale, scale)).max() < 1e-6  # rounding of the differences


def test_a_mount_turns_everything():
    """Parameters in the vehicle's axes: the same readings, turned; covariance of a sum that no turn changes."""
    layout = layout_for(SPEC, 42)
    c = calibration()
    calibrated = calibration_start(c, layout, SPEC, age=SAME, C_bs=MOUNT)
    b = calibrated.values[[list(calibrated.places).index(layout["b_a"].start - 9 + i) for i in range(3)]]
    assert np.allclose(b, MOUNT @ c.errors.b_a, atol=1e-15)
    P = calibrated.put_into(blank(layout)).P
    part, own = layout["b_a"], [c.names.index(f"b_a_{a}") for a in "xyz"]
    assert np.allclose(P[part, part], MOUNT @ c.covariance[np.ix_(own, own)] @ MOUNT.T, atol=1e-18)
    # trace of M and of its covariance with the turned biases' norm direction: invariants of the turn
    t = np.zeros(layout.size)
    t[layout["S_g"]] = 1.0
    u = np.array([1.0 if n in ("M_g_xx", "M_g_yy", "M_g_zz") else 0.0 for n in c.names])
    assert t @ P @ t == pytest.approx(u @ c.covariance @ u, rel=1e-10)


def test_a_state_that_forgets_starts_at_zero():
    """A Gauss-Markov bias would pull the calibrated value to zero: the value is taken out of the log instead."""
    models = dict(layout_for(SPEC, 42).models) | {"b_g": StateModel.gauss_markov(1e-4, 100.0)}
    layout = StateLayout(models)
    c = calibration()
    calibrated = calibration_start(c, layout, SPEC, age=SAME)
    initial = calibrated.put_into(blank(layout))
    k = layout["b_g"].start
    assert initial.parameters[k - 9] == 0.0
    assert initial.P[k, k] == c["b_g_x"][1] ** 2
    assert np.allclose(calibrated.correction.t_g, -c.errors.b_g, atol=1e-16)
    assert np.array_equal(calibrated.correction.T_g, np.eye(3))


def test_gravity_puts_errors_without_a_state_into_the_biases():
    layout = layout_for(SPEC, 15)
    c = calibration()
    other = np.array(
        [3.0 if n[:3] == "M_a" and n[-1] == "z" else 1.0 for n in c.names]
    )  # gravity's column is not like the others
    c = replace(c, covariance=c.covariance * np.outer(other, other))
    calibrated = calibration_start(c, layout, SPEC, age=SAME)
    T_a = np.linalg.inv(np.eye(3) + c.errors.M_a)
    at = [c.names.index(f"b_a_{a}") for a in "xyz"]
    down = [c.names.index(f"M_a_{a}z") for a in "xyz"]
    expected = np.diag(T_a @ c.covariance[np.ix_(at, at)] @ T_a.T) + units.G0**2 * np.diag(
        T_a @ c.covariance[np.ix_(down, down)] @ T_a.T
    )
    P = calibrated.put_into(blank(layout)).P
    assert np.allclose(np.diag(P)[layout["b_a"]], expected, rtol=1e-12)
    assert any(
        "taken out of the log, with no state to improve them" in n and "the rest in no sigma" in n
        for n in calibrated.notes
    )


def test_counts_are_multiplied_first():
    c = large()
    calibrated = calibration_start(replace(c, nominal=(0.01, 0.002)), layout_for(SPEC, 42), SPEC)
    log = readings()
    still = ImuSeries(log.t, log.gyro, np.tile([0.0, 0.0, -9.8], (len(log), 1)))
    counts = replace(still, gyro=still.gyro / 0.002, accel=still.accel / 0.01)
    assert np.allclose(calibrated.in_si(counts).accel, still.accel, rtol=1e-15)
    assert np.allclose(calibrated.in_si(counts).gyro, still.gyro, rtol=1e-15)
    with pytest.raises(
        InputError, match=r"in units of 0\.01 m/s\^2 .* less biases, has a median of 0\.\d+ g; read the log"
    ):
        calibrated.in_si(still)


def test_counts_without_sign():
    """Half of 16 bits is a bias of 327 m/s^2, not another unit."""
    half = CountFactors((0.01, 0.002), np.full((2, 3), 32768.0))
    c = half.in_counts(large())
    layout = layout_for(SPEC, 42)
    calibrated = calibration_start(c, layout, SPEC)
    log = readings()
    counts = replace(log, gyro=log.gyro / 0.002 + 32768.0, accel=log.accel / 0.01 + 32768.0)
    compensated = calibrated.compensated(calibrated.corrected(calibrated.in_si(counts)), layout)
    assert np.allclose(compensated.accel, c.apply(counts).accel, rtol=0.0, atol=1e-9)
    assert np.allclose(compensated.gyro, c.apply(counts).gyro, rtol=0.0, atol=1e-9)
    with pytest.raises(InputError, match="read the log in the units"):
        calibrated.in_si(log)


def thermal(seed=2):
    """A result as calibrate_thermal leaves it: b and S against temperature, straight lines."""
    names = tuple(n for n in LINEAR if n[0] == "b" or n in ("M_a_xx", "M_a_yy", "M_a_zz"))
    c = calibration(seed, names=names, temperature=20.0)
    slope = {"b_a": 1e-3, "b_g": 1e-5, "M_a": 1e-5}
    thermal = {
        "reference_temperature": 20.0, "range": [0.0, 60.0],
        "coefficients": {n: [c[n][0], slope[n[:3]]] for n in names},
        "covariance": {n: [[c[n][1] ** 2, 0.0], [0.0, (0.1 * slope[n[:3]]) ** 2]] for n in names},
        "table": {"temperature": []},
    }  # fmt: skip
    return replace(c, method="thermal", extra={"thermal": thermal})


def test_a_thermal_calibration_is_taken_out_beforehand():
    c = thermal()
    layout = layout_for(SPEC, 21)
    log = replace(readings(), temperature=np.linspace(30.0, 50.0, 50))
    config = NavigationConfig.parse({"imu": {**SHEET, "calibration_session": "same"}, "filter": {"states": 21}})
    calibrated = configured_start(config, log, c)
    assert not calibrated.values.any()
    assert np.array_equal(calibrated.corrected(calibrated.in_si(log)).accel, c.apply(log).accel)
    P = calibrated.put_into(blank(layout)).P
    k = layout["b_g"].start
    assert P[k, k] == pytest.approx(c["b_g_x"][1] ** 2 + (0.1 * 1e-5 * 20.0) ** 2, rel=1e-12)  # at 40 degC on average
    with pytest.raises(InputError, match="it depends on temperature, and the log has none; read the log with its temp"):
        configured_start(config, readings(), c)
    with pytest.raises(InputError, match=r"calibrated from 0\.0 to 60\.0 degC, got 80\.0"):
        configured_start(config, replace(log, temperature=log.temperature + 40.0), c)
    with pytest.raises(InputError, match="needs the temperature of every sample"):
        calibrated.sample([0.0, 0.0, 0.0], [0.0, 0.0, -0.1], 0.01)


# --------------------------------------------------------------------------------------------------- runs


@pytest.fixture(scope="module")
def mission():
    return prepare_mission(MISSION)


def unit(mission, seed, gauge="full", repeatability=1.0, factor=10.0):
    """A unit with large errors: what its calibration found, the errors it has now, and a drive with it."""
    rng = np.random.default_rng([3, seed])
    large = replace(
        SPEC, gyro=replace(SPEC.gyro, turn_on_bias=factor * SPEC.gyro.turn_on_bias),
        accel=replace(SPEC.accel, turn_on_bias=factor * SPEC.accel.turn_on_bias),
    )  # fmt: skip
    then = ImuErrors.draw(large, rng, gauge=gauge)
    now = replace(
        then, b_g=then.b_g + repeatability * SPEC.gyro.turn_on_bias * rng.standard_normal(3),
        b_a=then.b_a + repeatability * SPEC.accel.turn_on_bias * rng.standard_normal(3),
    )  # fmt: skip
    drive = simulate_mission(mission, np.random.default_rng([4, seed])).recording
    drive = replace(drive, imu=simulate_imu(mission.ideal, now, rng).imu)
    result = calibration(seed, gauge)
    error = np.linalg.cholesky(result.covariance) @ rng.standard_normal(len(result.names))
    return replace(result, values=vector(then, result.names) + error), now, drive


def settings(states=42, **sections):
    data = {
        "imu": dict(SHEET),
        "gnss": {"lever_arm_m": LEVER},
        "alignment": {"sideslip_deg": 0.1, "tilt_floor_deg": 0.02},
        "filter": {"states": states, "smooth": False, "tune": False},
        "outages": {"windows_s": [OUTAGE]},
    }
    for name, section in sections.items():
        data[name] = {**data.get(name, {}), **section}
    return data


def truth_in(layout, errors):
    p = np.zeros(layout.size - 9)
    for name, value in zip(LINEAR, vector(errors), strict=True):
        block = (
            {"M_a": "S_a", "M_g": "S_g"}.get(name[:3], name[:3])
            if name[-1] == name[-2] and name[0] == "M"
            else name[:3]
        )
        if block in layout or (block == "M_a" and "M_a6" in layout):
            if block == "M_a" and "M_a" in layout and name in ("M_a_yx", "M_a_zx", "M_a_zy"):
                continue
            p[place(layout, name) - 9] = value
    return p


def true_start(mission, layout, seed):
    """Truth at the beginning, wrong by the stated uncertainty; parameters to be put in."""
    rng = np.random.default_rng([5, seed])
    T, att, v, r = mission.ideal.truth, np.array([2e-3, 2e-3, 5e-3]), 0.02, 0.05
    from schuler import frames

    C = frames.C_en(T.llh[0])
    q = rotation.quat_multiply(rotation.quat_from_rotvec(C @ (att * rng.standard_normal(3))), T.q_eb[0])
    nav = NavState(
        0.0, T.r_eb_e[0] + C @ (r * rng.standard_normal(3)), T.v_eb_e[0] + C @ (v * rng.standard_normal(3)), q
    )
    return InitialState.from_sigmas(nav, layout, attitude=att, velocity=[v] * 3, position=[r] * 3)


def at_end_of_outage(result, recording, truth):
    """Horizontal error and claimed 1-sigma when GNSS comes back [m], and NEES per state then."""
    t, dx, P = state_errors(result, recording.reference, truth)
    k = int(np.searchsorted(t, recording.start + OUTAGE[1])) - 1
    from schuler import frames

    C = frames.C_en(result.states.llh[k])
    e, p = C.T @ dx[k, 6:9], C.T @ P[k, 6:9, 6:9] @ C
    s = np.sqrt(np.diag(P[k]))
    keep = s > 0.0
    z = (dx[k] / np.where(keep, s, 1.0))[keep]
    R = (P[k] / np.outer(np.where(keep, s, 1.0), np.where(keep, s, 1.0)))[np.ix_(keep, keep)]
    return float(np.hypot(*e[:2])), float(np.sqrt(p[0, 0] + p[1, 1])), float(z @ np.linalg.solve(R, z) / keep.sum())


@pytest.mark.parametrize("runs", [8, pytest.param(16, marks=pytest.mark.campaign)])
@pytest.mark.thinned(2)
@pytest.mark.parametrize(("states", "gauge"), [(42, "full"), (39, "upper")])
def test_a_calibrated_unit_drifts_less_with_consistent_sigmas(mission, states, gauge, runs):
    """Scale factors and cross-coupling of 0.8 %: 30 s without GNSS, with turns; all states honest over the units."""
    with_it, without = [], []
    base = NavigationConfig.parse(settings(states))
    layout = state_layout(base, SPEC)
    blind = {  # the budget of a unit nobody calibrated
        "b_g": {"sigma": 10.0 * SPEC.gyro.turn_on_bias}, "b_a": {"sigma": 10.0 * SPEC.accel.turn_on_bias},
    }  # fmt: skip
    signs = set()
    for seed in range(runs):
        c, now, drive = unit(mission, seed, gauge)
        start = true_start(mission, layout, seed)
        truth = truth_in(layout, now)
        signs |= {float(np.sign(now.b_g[0])), float(np.sign(now.b_a[0]))}
        with_it.append(at_end_of_outage(navigate(drive, base, initial=start, calibration=c), drive, truth))
        if seed < 6 and states == 42:
            uncalibrated = NavigationConfig.parse(settings(states, filter={"models": blind}))
            begin = true_start(mission, state_layout(uncalibrated, SPEC), seed)
            without.append(at_end_of_outage(navigate(drive, uncalibrated, initial=begin), drive, truth))
    assert signs == {-1.0, 1.0}
    errors, sigma, nees = np.array(with_it).T
    low, high = chi_square_band(layout.size, runs, 0.999)  # statistical
    assert low < nees.mean() < high
    # statistical: of 8 units with two axes +- 0.18, of 16 +- 0.13
    assert 0.6 < np.sqrt(np.mean(errors**2)) / np.sqrt(np.mean(sigma**2)) < 1.4
    if without:
        other, claimed, honest = np.array(without).T
        assert np.sqrt(np.mean(other**2)) > 3.0 * np.sqrt(np.mean(errors[:6] ** 2))
        assert claimed.mean() > 3.0 * sigma.mean()
        assert honest.mean() < 1.5


def test_a_calibration_that_is_too_sure_shows(mission):
    base = NavigationConfig.parse(settings(42, imu={"gyro_repeatability_deg_hr": 0.0, "accel_repeatability_mg": 0.0}))
    layout = state_layout(base, SPEC)
    seen = []
    for factor in (1.0, 0.1):
        nees = []
        for seed in range(4):
            c, now, drive = unit(mission, seed, repeatability=0.0)
            c = replace(c, covariance=factor**2 * c.covariance)
            result = navigate(drive, base, initial=true_start(mission, layout, seed), calibration=c)
            nees.append(at_end_of_outage(result, drive, truth_in(layout, now))[2])
        seen.append(np.mean(nees))
    low, high = chi_square_band(layout.size, 4, 0.999)
    assert low < seen[0] < high
    assert seen[1] > 10.0


def test_fewer_states_are_honest_too(mission):
    """15 states: the rest is taken out of the log, and no sigma has what turns make of its uncertainty.

    Over 60 units the NEES of the nine navigation states is 1.26 +- 0.08; with 42 states 1.02 +- 0.03 of all.
    """
    base = NavigationConfig.parse(settings(15))
    layout = state_layout(base, SPEC)
    result = []
    for seed in range(8):
        c, _, drive = unit(mission, seed)
        result.append(
            at_end_of_outage(
                navigate(drive, base, initial=true_start(mission, layout, seed), calibration=c), drive, None
            )
        )
    errors, sigma, nees = np.array(result).T
    low, high = chi_square_band(9, 8, 0.999)
    assert low < nees.mean() < high
    assert np.sqrt(np.mean(errors**2)) < 2.0 * sigma.mean()


@pytest.mark.parametrize("runs", [8, pytest.param(16, marks=pytest.mark.campaign)])
@pytest.mark.thinned(2)
@pytest.mark.parametrize("states", [42, 15])
def test_alignment_error_is_correlated_with_sensor_errors(mission, states, runs):
    """Attitude from the compensated log at rest, correlated with all parameters: tilt and biases together honest."""
    data = settings(states, alignment={"tilt_floor_deg": 0.0, "sideslip_deg": 0.1})
    nees = []
    for seed in range(runs):
        c, now, drive = unit(mission, seed)
        result = navigate(drive, data, calibration=c)
        assert any("deg/s off what was known before" in n for n in result.notes)
        truth = truth_in(result.layout, now) if states == 42 else None
        _, dx, P = state_errors(result, drive.reference, truth)
        s = np.sqrt(np.diag(P[0]))
        z = dx[0] / s
        nees.append(z @ np.linalg.solve(P[0] / np.outer(s, s), z) / len(z))
    low, high = chi_square_band(42 if states == 42 else 9, runs, 0.999)
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("states", [9, 15, 39, 42])
def test_levelled_axes_carry_no_horizontal_force(states):
    """However wrong the accelerometers, levelling with them leaves no horizontal force: the tilt is their error."""
    layout = layout_for(SPEC, states)
    calibrated = calibration_start(large(gauge="upper"), layout, SPEC)
    rpy = np.array([0.1, -0.2, 0.7])
    f_b = -9.8 * rotation.dcm_from_rpy(rpy)[2]
    result = levelling(f_b, sigma_bias=calibrated.sigma_accel).with_heading(0.7, 0.02, "given")
    start = calibrated.aligned(blank(layout), result, layout)
    C = result.C_nb
    rows = np.zeros((3, layout.size))
    rows[:, :3] = -rotation.skew(C @ f_b)
    rows[:, 9:] = parameter_columns(layout, C, np.zeros(3), f_b, start.parameters)[1]
    left, tilt = np.diag(rows @ start.P @ rows.T)[:2], np.diag(start.P)[:2]
    if states == 9:
        assert tilt == pytest.approx((calibrated.sigma_accel / 9.8) ** 2, rel=1e-6)
        return
    # Earth rate and the gravity of the place against the 9.8 here: 1e-4 of scale factors that are 1e-2 of the tilt
    assert np.sqrt(left.max()) < 1e-3 * 9.8 * np.sqrt(tilt.min())
    assert np.sqrt(tilt).min() > 0.9 * SPEC.accel.turn_on_bias / 9.8
    assert start.P[2, 2] == pytest.approx(0.02**2, rel=1e-12)


def test_first_compensated_and_seeded_without_uncertainty_are_one(mission):
    """The same trajectory whether the log is compensated before or the states start, and stay, at the values."""
    c, _, drive = unit(mission, 2)
    exact = replace(c, covariance=np.zeros_like(c.covariance))
    layout = layout_for(SPEC, 42)
    start = true_start(mission, layout, 2)
    none = {name: {"sigma": 0.0} for name in STATES[42]}
    still = {"gyro_repeatability_deg_hr": 0.0, "accel_repeatability_mg": 0.0}
    before = navigate(
        replace(drive, imu=c.apply(drive.imu)), settings(42, filter={"models": none}),
        initial=replace(start, P=np.pad(start.P[:9, :9], ((0, 33), (0, 33)))),
    )  # fmt: skip
    seeded = navigate(drive, settings(42, imu=still), initial=start, calibration=exact)
    # rounding: over two minutes, half a minute of it without GNSS
    assert np.abs(before.trajectory.r_eb_e - seeded.trajectory.r_eb_e).max() < 1e-5
    assert np.array_equal(seeded.parameters, np.tile(seeded.parameters[0], (len(seeded.t), 1)))
    # with biases that the filter estimates: linearisation, sigmas decide nothing
    walk = {"b_g": {"sigma": 1e-4, "noise": 1e-6}, "b_a": {"sigma": 1e-2, "noise": 1e-4}}
    free = {"gyro_repeatability_deg_hr": 1e-4 / units.DEG_PER_HR, "accel_repeatability_mg": 1e-2 / units.MG}
    P = np.zeros_like(start.P)
    P[:9, :9], P[9:12, 9:12], P[12:15, 12:15] = start.P[:9, :9], 1e-4 * np.eye(3), 1e-8 * np.eye(3)
    before = navigate(
        replace(drive, imu=c.apply(drive.imu)), settings(42, filter={"models": none | walk}),
        initial=replace(start, P=P),
    )  # fmt: skip
    seeded = navigate(drive, settings(42, imu=free, filter={"models": walk}), initial=start, calibration=exact)
    apart = np.linalg.norm(before.trajectory.r_eb_e - seeded.trajectory.r_eb_e, axis=1)
    assert apart.max() < 0.02 * seeded.sigma("dr").max()  # M, 1 %, of corrections of a sigma


def test_live_gives_the_same(mission):
    c, _, drive = unit(mission, 1)
    layout = layout_for(SPEC, 21)
    calibrated = calibration_start(replace(c, nominal=(1.0, 1.0)), layout, SPEC)
    log = drive.imu.between(0.0, 5.0)
    initial = calibrated.put_into(true_start(mission, layout, 1))
    psd = np.full(3, SPEC.gyro.random_walk**2), np.full(3, SPEC.accel.random_walk**2)
    batch = run(
        calibrated.corrected(log).increments(), MeasurementSchedule.empty(), initial, layout, *psd, FilterOptions()
    )
    live = Navigator(initial, layout, *psd, interval_s=log.interval)
    for t, dt, dtheta, dv in zip(log.t, np.diff(log.t, prepend=0.0), log.gyro, log.accel, strict=True):
        live.imu(t, *calibrated.sample(dtheta, dv, dt))
    assert np.abs(live.state.r_eb_e - batch.r[-1]).max() < 1e-8


# ------------------------------------------------------------------------------------------ entries and errors


@pytest.mark.campaign
def test_configuration_command_and_argument_are_one(mission, tmp_path):
    from schuler.cli.navigate import navigate as command
    from schuler.recording.io import write

    c, _, drive = unit(mission, 1)
    (tmp_path / "sub").mkdir()
    path = c.to_yaml(tmp_path / "sub" / "unit.yaml")
    data = settings(15)
    given = navigate(drive, data, calibration=c)
    by_path = navigate(drive, data, calibration=path)
    toml = tmp_path / "drive.toml"
    text = "\n".join(
        f"[{name}]\n" + "\n".join(f"{k} = {_toml(v)}" for k, v in section.items()) for name, section in data.items()
    )
    toml.write_text(text.replace("[imu]\n", '[imu]\ncalibration = "sub/unit.yaml"\n'))
    configured = navigate(drive, toml)
    for other in (by_path, configured):
        assert np.array_equal(other.trajectory.r_eb_e, given.trajectory.r_eb_e)
        assert other.provenance["calibration"]["sha256"] == files.sha256(path)
    assert given.provenance["calibration"]["sha256"] == files.sha256(path)  # the same text, if it had been written
    assert given.provenance["calibration"]["states"] == ["b_a", "b_g"]
    assert (
        "calibration unit.yaml (multiposition, status ok): values and covariance of b_a, b_g at the start"
        in configured.summary()
    )
    # what prepares a log from the configuration alone prepares it the same way
    config = NavigationConfig.load(toml)
    calibrated = configured_start(config, drive.imu)
    assert np.array_equal(prepared_imu(drive.imu, config, []).gyro, calibrated.corrected(drive.imu).gyro)
    toml.write_text(text)
    log = tmp_path / "log.parquet"
    write(drive, log)
    code = command(log, config=toml, calibration=path, out=tmp_path / "out", report=False)
    assert code == 0
    _, kept = read_solution(tmp_path / "out" / "solution.parquet")
    assert kept["provenance"]["calibration"]["sha256"] == files.sha256(path)


def _toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + "}"
    return json.dumps([list(v) if isinstance(v, tuple) else v for v in value] if isinstance(value, list) else value)


def test_faults_of_a_calibration_are_refused(mission, tmp_path):
    c, _, drive = unit(mission, 1)
    with pytest.raises(InputError, match=r"got a refused one: Too few poses\. Repeat it, or take an earlier one"):
        navigate(drive, settings(15), calibration=replace(c, status="refused", verdicts=("Too few poses.",)))
    with pytest.raises(FileFormatError, match="no such file; expected a calibration"):
        navigate(drive, settings(15), calibration=tmp_path / "none.yaml")
    with pytest.raises(ConfigError, match=r"imu\.calibration: .*none\.yaml: no such file; expected a calibration"):
        navigate(drive, settings(15, imu={"calibration": str(tmp_path / "none.yaml")}))
    mirrored = replace(c, values=np.where([n == "M_a_xx" for n in c.names], -2.0, c.values))
    with pytest.raises(InputError, match="expected a right-handed response I \\+ M_a"):
        navigate(drive, settings(39), calibration=mirrored)
    with pytest.raises(ConfigError, match="calibration_session"):
        NavigationConfig.parse(settings(15, imu={"calibration_session": "now"}))
    calibrated = calibration_start(c, layout_for(SPEC, 42), SPEC)
    with pytest.raises(InputError, match="expected the states of the calibration's layout, at least 42, got 15"):
        calibrated.put_into(blank(layout_for(SPEC, 15)))
    warned = navigate(drive, settings(15), calibration=replace(c, status="warning", verdicts=("Residuals are large.",)))
    assert any("the calibration says: Residuals are large." in note for note in warned.notes)
