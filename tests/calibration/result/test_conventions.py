"""Parameters of other programs: the worked examples of the documentation, their formulas on raw samples, and back."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import result_cases as cases
import yaml
from places import ROOT

from schuler.calibration.result.conventions import (
    from_imu_tk,
    from_kalibr,
    from_psins,
    from_ros_imu_calib,
    to_imu_tk,
    to_kalibr,
    to_psins,
    to_ros_imu_calib,
)
from schuler.calibration.result.parameters import LINEAR, MATRIX_G, in_gauge, vector
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError

PAGE = ROOT / "docs" / "calibration-conventions.md"
AXES = {"FRD": np.eye(3), "FLU": np.diag([1.0, -1.0, -1.0]), "RFU": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])}


def unit(seed=1, gauge="full", nominal=(1.0, 1.0), without=()):
    """All errors held; some families left out."""
    values = {n: v for n, v in cases.calibration(seed).parameters.items() if n[:3] not in without}
    result = CalibrationResult("made up", (), np.empty(0), np.empty((0, 0)), "full", fixed=values, nominal=nominal)
    return result if gauge == "full" else result.in_gauge(gauge)


def readings(result, n=20, seed=8):
    """True f, omega and what the sensors report in units of the log, rows."""
    rng = np.random.default_rng(seed)
    f, omega, e = 9.0 * rng.standard_normal((n, 3)), rng.standard_normal((n, 3)), result.errors
    raw_f = (e.b_a + f @ (np.eye(3) + e.M_a).T) / result.nominal[0]
    raw_omega = (e.b_g + omega @ (np.eye(3) + e.M_g).T + f @ e.G_g.T) / result.nominal[1]
    return f, omega, raw_f, raw_omega


def same_up_to_a_rotation(f, omega, f_other, omega_other):
    """All lengths and scalar products agree: rounding."""
    both, other = np.concatenate((f, omega)), np.concatenate((f_other, omega_other))
    np.testing.assert_allclose(other @ other.T, both @ both.T, atol=1e-10)


def blocks():
    text = PAGE.read_text(encoding="utf-8")
    sections = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    return {s.splitlines()[0]: re.findall(r"```python\n(.*?)```", s, flags=re.DOTALL) for s in sections}


EXAMPLES = blocks()


def test_every_program_has_a_worked_example():
    assert [name for name, code in EXAMPLES.items() if code] == [
        "The example",
        "imu_tk",
        "Kalibr",
        "ROS imu_calib",
        "PSINS",
    ]
    assert all(code[0].count("assert") >= 3 for name, code in EXAMPLES.items() if code and name != "The example")


@pytest.mark.parametrize("program", ["imu_tk", "Kalibr", "ROS imu_calib", "PSINS"])
def test_documented_examples_run(program):
    """Printed digits: half of the sixth decimal. Nothing may be lost on the way there and back, but for rounding."""
    space = {}
    exec(EXAMPLES["The example"][0], space)
    f, omega = space["f"], space["omega"]
    e = space["result"].errors
    np.testing.assert_allclose(e.b_a + (np.eye(3) + e.M_a) @ f, space["raw_f"], atol=1e-12)
    np.testing.assert_allclose(e.b_g + (np.eye(3) + e.M_g) @ omega + e.G_g @ f, space["raw_omega"], atol=1e-12)
    exec(EXAMPLES[program][0], space)
    again, result = space["again"], space["result"]
    families = {"imu_tk": ("b_a", "M_a", "b_g", "M_g"), "ROS imu_calib": ("b_a", "M_a")}.get(program)
    there = [n for n in LINEAR if families is None or n[:3] in families]
    expected = vector(in_gauge(result.errors, "lower"), there)
    np.testing.assert_allclose(vector(in_gauge(again.errors, "lower"), there), expected, atol=1e-12)


@pytest.mark.parametrize("gauge", ["full", "lower", "symmetric"])
@pytest.mark.parametrize("nominal", [(1.0, 1.0), (1.0 / 415.0, 1.0 / 4778.0)])
def test_imu_tk(gauge, nominal):
    result = unit(gauge=gauge, nominal=nominal, without=("G_g",))
    f, omega, raw_f, raw_omega = readings(result)
    tk = to_imu_tk(result)
    assert tk["left_out"] == ()
    assert not np.tril(tk["T_a"], -1).any()
    np.testing.assert_allclose(np.diag(tk["T_a"]), 1.0)
    np.testing.assert_allclose(np.diag(tk["T_g"]), 1.0)
    f_tk = (raw_f - tk["B_a"]) @ (tk["T_a"] @ tk["K_a"]).T
    omega_tk = (raw_omega - tk["B_g"]) @ (tk["T_g"] @ tk["K_g"]).T
    same_up_to_a_rotation(f, omega, f_tk, omega_tk)
    back = from_imu_tk(*(tk[k] for k in ("T_a", "K_a", "B_a", "T_g", "K_g", "B_g")), nominal=nominal)
    assert back.gauge == "upper"
    np.testing.assert_allclose(vector(back.errors), vector(in_gauge(result.errors, "upper")), atol=1e-12)


def test_imu_tk_in_counts_finds_its_nominal_factors():
    K_a, B = np.array([1.0 / 414.0, 1.0 / 412.0, 1.0 / 415.0]), np.array([33124.0, 33275.0, 32364.0])
    result = from_imu_tk(np.eye(3), K_a, B)
    assert result.nominal[0] == pytest.approx(K_a.mean())
    assert result.nominal[1] == 1.0
    assert np.abs(np.diag(result.errors.M_a)).max() < 0.01
    assert not any(n in result.fixed for n in MATRIX_G)
    raw = np.array([40000.0, 30000.0, 33000.0])
    f = np.linalg.solve(np.eye(3) + result.errors.M_a, result.nominal[0] * raw - result.errors.b_a)
    np.testing.assert_allclose(f, K_a * (raw - B))
    T = np.eye(3)
    T[2, 0] = 0.01
    assert from_imu_tk(T, K_a, B).gauge == "full"


@pytest.mark.parametrize("axes", ["FRD", "FLU", "RFU"])
@pytest.mark.parametrize("gauge", ["full", "upper", "lower"])
def test_kalibr(axes, gauge):
    result = unit(gauge=gauge)
    f, omega, raw_f, raw_omega = readings(result)
    kalibr = yaml.safe_load(yaml.safe_dump(to_kalibr(result, axes)))
    assert kalibr["model"] == "scale-misalignment"
    P = AXES[axes]
    M_a, M_g, A, C = (np.array(m) for m in (
        kalibr["accelerometers"]["M"], *(kalibr["gyroscopes"][k] for k in ("M", "A", "C_gyro_i")),
    ))  # fmt: skip
    assert not np.triu(M_a, 1).any()
    assert not np.triu(M_g, 1).any()
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(C) == pytest.approx(1.0)
    # their model is solved for the truth
    f_kalibr = np.linalg.solve(M_a, (raw_f @ P.T - kalibr["accelerometers"]["bias"]).T).T
    rest = raw_omega @ P.T - kalibr["gyroscopes"]["bias"] - f_kalibr @ (A @ C).T
    same_up_to_a_rotation(f, omega, f_kalibr, np.linalg.solve(M_g @ C, rest.T).T)
    back = from_kalibr(kalibr, axes)
    np.testing.assert_allclose(vector(back.errors), vector(in_gauge(result.errors, "lower")), atol=1e-13)
    assert back.gauge == "lower"


def test_kalibr_with_places():
    places = {"r_a_xy": 0.01, "r_a_yx": -0.02, "r_a_zz": 0.03}
    result = replace(unit(gauge="lower"), fixed=unit(gauge="lower").fixed | places)
    kalibr = to_kalibr(result, "FLU")
    assert kalibr["model"] == "scale-misalignment-size-effect"
    np.testing.assert_allclose(kalibr["accelerometers"]["rx_i"], [0.0, -0.01, 0.0])
    np.testing.assert_allclose(kalibr["accelerometers"]["rz_i"], [0.0, 0.0, -0.03])
    back = from_kalibr(kalibr, "FLU")
    for name, value in places.items():
        assert back.fixed[name] == pytest.approx(value)


def test_kalibr_without_what_it_need_not_have():
    data = to_kalibr(unit())
    del data["gyroscopes"]["A"], data["gyroscopes"]["bias"], data["accelerometers"]["bias"]
    result = from_kalibr(data)
    assert not result.errors.G_g.any()
    assert not result.errors.b_a.any()


@pytest.mark.parametrize("axes", ["FRD", "FLU"])
@pytest.mark.parametrize("gauge", ["full", "lower"])
@pytest.mark.parametrize("nominal", [1.0, 0.0024])
def test_ros_imu_calib(axes, gauge, nominal):
    """No rotation here: it refers to the body axes of the result. Rounding."""
    result = unit(gauge=gauge, nominal=(nominal, 1.0))
    f, _, raw_f, _ = readings(result)
    ros = to_ros_imu_calib(result, axes)
    assert [s[:31] for s in ros["left_out"]] == [f"imu_calib has no place for {k}:" for k in ("b_g", "M_g", "G_g")]
    P, SM = AXES[axes], np.reshape(ros["SM"], (3, 3))
    np.testing.assert_allclose(raw_f @ P.T @ SM.T - ros["bias"], f @ P.T, atol=1e-11)
    del ros["left_out"]
    read = yaml.safe_load(yaml.safe_dump(ros))
    back = from_ros_imu_calib(read["SM"], read["bias"], axes, nominal=nominal)
    names = [n for n in LINEAR if n[:3] in ("b_a", "M_a")]
    np.testing.assert_allclose(vector(back.errors, names), vector(result.errors, names), atol=1e-12)


@pytest.mark.parametrize("axes", ["RFU", "FRD"])
@pytest.mark.parametrize("gauge", ["full", "lower", "upper"])
@pytest.mark.parametrize("nominal", [(1.0, 1.0), (0.0024, 0.0002)])
def test_psins(axes, gauge, nominal):
    result = unit(gauge=gauge, nominal=nominal)
    f, omega, raw_f, raw_omega = readings(result)
    clbt = to_psins(result, axes)
    P = AXES[axes]
    assert not np.triu(clbt["Ka"], 1).any()
    f1 = raw_f @ P.T * clbt["sf"][3:]
    f_psins = f1 @ clbt["Ka"].T - clbt["db"]
    omega_psins = raw_omega @ P.T * clbt["sf"][:3] @ clbt["Kg"].T - clbt["eb"] - f1 @ clbt["gSens"].T
    same_up_to_a_rotation(f, omega, f_psins, omega_psins)
    back = from_psins(clbt, axes)
    assert back.nominal == nominal
    np.testing.assert_allclose(vector(back.errors), vector(in_gauge(result.errors, "lower")), atol=1e-12)


def test_psins_other_fields_there_and_back():
    more = {"Q_a_x": 1e-5, "Q_a_y": 2e-5, "Q_a_z": -3e-5, "r_a_xx": 0.01, "r_a_yz": 0.02, "delay": 1.5e-3}
    result = replace(unit(), fixed=unit().fixed | more)
    clbt = to_psins(result)
    assert clbt["tGA"] == -1.5e-3
    np.testing.assert_allclose(
        clbt["Ka2"], [2e-5, 1e-5, 3e-5]
    )  # right, forward, up: what points the other way changes sign
    np.testing.assert_allclose(clbt["rx"], [0.0, 0.0, -0.02])  # the right accelerometer was our y
    back = from_psins(clbt)
    for name, value in more.items():
        assert back.fixed[name] == pytest.approx(value)


def test_a_quadratic_sensor_turned_over():
    """f_meas = f + Q f^2 read along -x: (-f)_meas = -f - Q f^2, so Q changes sign with its axis, as above."""
    Q, f = 1e-3, 9.0
    reading = f + Q * f**2
    flipped_reading, flipped_f = -reading, -f
    assert flipped_reading == pytest.approx(flipped_f + (-Q) * flipped_f**2)


def test_psins_defaults_are_a_perfect_sensor():
    result = from_psins({"Kg": np.diag([1.001, 1.0, 1.0])}, axes="FRD")
    assert result.errors.M_g[0, 0] == pytest.approx(1.0 / 1.001 - 1.0)
    assert not result.errors.b_a.any()
    assert not any(n.startswith("G_g") for n in result.fixed)


def test_held_values_can_be_compared_with_a_calibration():
    """Is what the other program found within our uncertainty?"""
    ours = cases.calibration(sigma=0.01)
    d = ours.compare(from_kalibr(to_kalibr(ours)))
    assert d.gauge == "lower"
    assert d.changed == ()
    assert d.freedom == 30
    assert d.chi2 < 1e-12


@pytest.mark.parametrize("convert", [to_imu_tk, to_kalibr, to_psins, to_ros_imu_calib])
def test_what_is_not_determined_is_refused(convert):
    ours = cases.calibration()
    C = ours.covariance.copy()
    i = ours.names.index("M_a_zz")
    C[i, :] = C[:, i] = 0.0
    C[i, i] = np.inf
    with pytest.raises(InputError, match="expected every parameter determined, but M_a_zz are not"):
        convert(replace(ours, covariance=C))


def test_undetermined_gyroscopes_do_not_matter_to_accelerometers():
    ours = cases.calibration()
    C = ours.covariance.copy()
    i = ours.names.index("M_g_zz")
    C[i, :] = C[:, i] = 0.0
    C[i, i] = np.inf
    assert len(to_ros_imu_calib(replace(ours, covariance=C))["SM"]) == 9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: to_kalibr(unit(nominal=(0.002, 1.0))), "expected factors 1 because Kalibr reads logs in m/s"),
        (lambda: to_kalibr(unit(), axes="FLD"), "left-handed"),
        (lambda: from_imu_tk(np.eye(3), np.ones(3), np.zeros(3), T_g=np.eye(3)), "expected all three or none"),
        (lambda: from_imu_tk(np.eye(3), np.zeros(3), np.zeros(3)), "expected a matrix that can be inverted"),
        (lambda: from_imu_tk(np.eye(2), np.ones(3), np.zeros(3)), "T_a"),
        (lambda: from_kalibr({"accelerometers": {}}), "expected accelerometers with M and gyroscopes with M, C_gyro_i"),
        (lambda: from_kalibr({"rostopic": "/imu0"}), "as Kalibr writes with --imu-models"),
        (lambda: from_ros_imu_calib(np.zeros(9), np.zeros(3)), "SM: expected a matrix that can be inverted"),
        (lambda: from_ros_imu_calib(np.zeros(8), np.zeros(3)), "SM"),
        (lambda: from_psins({"sf": [1, 1, 2, 1, 1, 1]}), "expected one sf for each triad"),
        (lambda: from_psins({"Kap": [1e-6, 0, 0]}), "no Kap"),
        (lambda: from_psins({"Ka": np.zeros((3, 3))}), "Ka: expected a matrix that can be inverted"),
    ],
)
def test_what_cannot_be_converted(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_a_matlab_file_for_psins(tmp_path):
    """Written and read as the documentation says: to the bit."""
    from scipy.io import loadmat, savemat

    result = unit(nominal=(0.0024, 0.0002))
    clbt = to_psins(result)
    savemat(tmp_path / "clbt.mat", {"clbt": clbt})
    read = loadmat(tmp_path / "clbt.mat", simplify_cells=True)["clbt"]
    assert from_psins(read).fixed == from_psins(clbt).fixed
    assert set(read) == set(clbt)


def test_a_text_file_of_imu_tk(tmp_path):
    """T, K, B one after the other with blank lines between, as imu_tk's stream operators write; printed digits."""
    tk = to_imu_tk(unit(without=("G_g",)))
    text = "\n\n".join(
        "\n".join(" ".join(f"{v:.6g}" for v in np.atleast_1d(row)) for row in tk[k]) for k in ("T_a", "K_a", "B_a")
    )
    (tmp_path / "a.calib").write_text(text)
    numbers = np.array((tmp_path / "a.calib").read_text().split(), dtype=float)
    back = from_imu_tk(numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3), numbers[18:])
    expected = from_imu_tk(tk["T_a"], tk["K_a"], tk["B_a"])
    np.testing.assert_allclose(vector(back.errors), vector(expected.errors), atol=1e-5)


@pytest.mark.realdata
def test_imu_tk_on_its_own_log(shared_data):
    """imu_tk's printed parameters leave 2 mm/s^2 rms in means of a second at rest: 8 mm/s^2 is its figure for samples.

    A wrong order, sign or unit would leave 100 mm/s^2 or more; the rms depends on what is called at rest in its
    second digit only, so the bound is 2.5 mm/s^2.
    """
    folder = shared_data / "imu_tk_xsens"
    expected = json.loads((folder / "expected.json").read_text())["acc"]
    result = from_imu_tk(expected["T"], expected["K"], expected["B"])
    raw = np.loadtxt(folder / "xsens_acc.mat")
    f = np.linalg.solve(np.eye(3) + result.errors.M_a, (result.nominal[0] * raw[:, 1:] - result.errors.b_a).T).T
    still = np.array([f[i : i + 100] for i in range(0, len(f) - 100, 100)])
    quiet = still.std(axis=1).max(axis=1) < 0.03
    assert quiet.sum() > 100
    length = np.linalg.norm(still[quiet].mean(axis=1), axis=1)
    assert np.sqrt(np.mean((length - 9.81744) ** 2)) < 0.0025
    assert np.abs(np.diag(result.errors.M_a)).max() < 0.01
