"""Tables of mean readings: triads, one triad, one axis; what is in them comes out, with the scatter they show."""

import numpy as np
import pytest
from command import answer

from schuler.calibration.bench.pose_table import PoseTable, calibrate_poses, read_pose_table
from schuler.exceptions import FileFormatError, InputError, UnitError
from schuler.units import DEG, G0

M_A = np.array([[0.004, 0.0, 0.0], [0.001, -0.003, 0.0], [-0.002, 0.0015, 0.002]])
B_A, B_G = np.array([0.05, -0.03, 0.02]), np.array([0.004, -0.002, 0.001])
TRUTH = {f"b_a_{a}": B_A[i] for i, a in enumerate("xyz")} | {f"b_g_{a}": B_G[i] for i, a in enumerate("xyz")}
TRUTH |= {f"M_a_{a}{b}": M_A[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}


def readings(rng, n=20):
    """Means of n poses all round, or of the six faces: noise 1e-3 m/s^2 and 1e-4 rad/s."""
    up = np.vstack((np.eye(3), -np.eye(3))) if n == 6 else rng.standard_normal((n, 3))
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    f = G0 * up @ (np.eye(3) + M_A).T + B_A + 1e-3 * rng.standard_normal((n, 3))
    return f, B_G + 1e-4 * rng.standard_normal((n, 3))


def table(f=None, omega=None):
    columns = {} if f is None else dict(zip(("ax", "ay", "az"), f.T, strict=True))
    return PoseTable(columns | ({} if omega is None else dict(zip(("gx", "gy", "gz"), omega.T, strict=True))))


@pytest.mark.campaign
@pytest.mark.parametrize("n", [6, 14, 20])
@pytest.mark.thinned(3)
def test_claims_hold_without_a_stated_noise(n):
    """Statistical: 95 % of 40 tables within 1.96 sigma, four standard errors of 12 correlated parameters below."""
    rng, inside = np.random.default_rng(3), []
    for _ in range(40):
        result = calibrate_poses(table(*readings(rng, n)))
        inside += [abs(result[name][0] - TRUTH[name]) < 1.96 * result[name][1] for name in result.names]
    assert 0.90 < np.mean(inside) <= 0.995


def test_a_triad_alone_is_the_same_as_beside_the_other(rng):
    f, omega = readings(rng)
    both, accel, gyro = (calibrate_poses(t) for t in (table(f, omega), table(f), table(None, omega)))
    assert both.names == (*accel.names, *gyro.names)
    np.testing.assert_array_equal(both.sigma, np.concatenate((accel.sigma, gyro.sigma)))


def test_one_axis(rng):
    """Closed form of a straight line through readings that lie on one, in the units of the table."""
    reference = np.array([1.0, 0.0, -1.0, 1.0, -1.0])
    noise = 1e-5 * np.array([1.0, -1.0, 1.0, -1.0, 0.0])
    result = calibrate_poses(PoseTable({"gx": (1.01 * reference + 0.02 + noise) * DEG, "reference": reference * DEG}))
    assert result.names == ("b_g_x", "M_g_xx")
    assert result["b_g_x"][0] == pytest.approx(0.02 * DEG, abs=3.0 * result["b_g_x"][1])
    assert result["M_g_xx"][0] == pytest.approx(0.01, abs=1e-4)
    A = np.column_stack((np.ones(5), reference * DEG))
    rows = (0.01 * reference + 0.02 + noise) * DEG
    left = rows - A @ np.linalg.lstsq(A, rows, rcond=None)[0]
    sigma = np.sqrt(3.0 * (left @ left / 3.0) * np.diag(np.linalg.inv(A.T @ A)))  # Student: 3 / (3 - 2)
    np.testing.assert_allclose(result.sigma, sigma, rtol=1e-5)


def test_the_command_writes_a_calibration(rng, tmp_path, capsys):
    f, omega = readings(rng)
    path = tmp_path / "means.csv"
    np.savetxt(path, np.hstack((f / G0, omega / DEG)), delimiter=",", header="ax,ay,az,gx,gy,gz", comments="")
    arguments = ("--table-units", "g,deg/s", "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, "calibrate", "poses", path, *arguments)
    assert data["method"] == "poses"
    for name, entry in data["parameters"].items():
        if not entry.get("fixed"):
            assert abs(entry["value"] - TRUTH[name]) < 5.0 * entry["sigma"], name
    assert (tmp_path / "calibration.yaml").exists()


HEADERS = [
    ("ax,ay,az,gx,gy,gz", "g,deg/s"),
    ("ax [g],ay [g],az [g],gx [deg/s],gy [deg/s],gz [deg/s]", None),
    ("acc_x (g),acc_y (g),acc_z (g),gyro_x_dps,gyro_y_dps,gyro_z_dps", None),
    ("Pose,ax [g],ay [g],az [g],wx [deg/s],wy [deg/s],wz [deg/s]", "accel=g"),
]


@pytest.mark.parametrize(("header", "units"), HEADERS)
def test_names_and_units_are_those_of_logs(rng, tmp_path, header, units):
    """Printed digits: the table holds 17 of them."""
    f, omega = readings(rng)
    rows = [",".join(repr(float(v)) for v in row) for row in np.hstack((f / G0, omega / DEG))]
    named = header.startswith("Pose")
    path = tmp_path / "means.csv"
    path.write_text("\n".join([header, *(f"no. {k}," * named + row for k, row in enumerate(rows))]), encoding="utf-8")
    held = read_pose_table(path, None, units)
    np.testing.assert_allclose(held.triad(("ax", "ay", "az")), f, rtol=1e-14)
    np.testing.assert_allclose(held.triad(("gx", "gy", "gz")), omega, rtol=1e-14)
    assert held.notes == (("Columns not used: Pose.",) if named else ())
    assert calibrate_poses(held).verdicts[-1:] == (held.notes or calibrate_poses(table(f, omega)).verdicts[-1:])


def test_two_statements_of_a_unit_must_agree(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("gx [deg/h],reference [deg/s]\n3600,1\n0,0\n-3600,-1\n")
    held = read_pose_table(path, None, "gyro=deg/h").columns
    np.testing.assert_allclose(held["gx"], held["reference"], rtol=1e-14)  # rounding
    with pytest.raises(FileFormatError, match="the first line says gx is in deg/h, --table-units says deg/s"):
        read_pose_table(path, None, "m/s2,deg/s")


@pytest.mark.parametrize(("poses", "tables"), [(12, 8), pytest.param(24, 60, marks=pytest.mark.campaign)])
def test_a_magnetometer_in_the_table(poses, tables):
    """Statistical: 95 % intervals, of the twelve numbers of a table four count as independent; four standard errors."""
    rng, inside = np.random.default_rng(5), []
    for _ in range(tables):
        f, _ = readings(rng, poses)
        up = np.linalg.solve(np.eye(3) + M_A, (f - B_A).T).T / G0
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        side = np.cross(up, rng.standard_normal((poses, 3)))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        b, M = rng.uniform(-20.0, 20.0, 3), np.diag([0.04, -0.01, -0.03])  # mean of the eigenvalues 1
        m = (-44.0 * up + 20.0 * side) @ (np.eye(3) + M).T + b + 0.2 * rng.standard_normal((poses, 3))
        columns = dict(zip(("ax", "ay", "az", "mx", "my", "mz"), np.hstack((f, 1e-6 * m)).T, strict=True))
        result = calibrate_poses(PoseTable(columns))
        truth = dict(zip(("b_m_x", "b_m_y", "b_m_z"), 1e-6 * b, strict=True))
        truth |= {f"M_m_{a}{c}": M[i, j] for i, a in enumerate("xyz") for j, c in enumerate("xyz")}
        inside += [abs(result[n][0] - truth[n]) < 1.96 * result[n][1] for n in truth]
    assert 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / (4 * tables)) < np.mean(inside)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("ax,ay\n1,2\n", InputError, "expected ax, ay, az or gx, gy, gz, or one axis beside its reference"),
        ("ax,ay,b\n1,2,3\n", InputError, "expected ax, ay, az or gx, gy, gz"),
        ("p,q,r\n1,2,3\n", FileFormatError, r"no sensor is recognised in the first line \(p, q, r\)"),
        ("ax,acc_x,az\n1,2,3\n", FileFormatError, "ax is there more than once"),
        ("ax [mg],ay [deg/s],az [mg]\n1,2,3\n", UnitError, "no unit of specific force"),
        (
            "ax [m/s2],ay,az\n" + "1000,2,3\n" * 9,
            InputError,
            "the numbers look like mg, not m/s.2.*state units in the first line",
        ),
        ("ax,ay,az\n1,2\n", FileFormatError, ":2: expected 3 entries, got 2"),
        ("ax,ay,az\n1,2,nan\n", FileFormatError, ":2: expected finite numbers"),
        ("ax,ay,az\n1,2,x\n", FileFormatError, ":2: expected numbers"),
        ("ax,ay,az\n", FileFormatError, "expected one row a pose, got none"),
        ("gx,gy,gz\n1,2,3\n", InputError, "rows: expected three poses or more"),
        ("ax,reference\n1,1\n1,1\n", InputError, "rows: expected three or more with different references"),
        ("ax,ay,reference\n1,1,1\n", InputError, "expected one axis beside its reference, got ax, ay"),
    ],
)
def test_what_is_no_table_of_poses(tmp_path, text, error, message):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(error, match=message):
        calibrate_poses(read_pose_table(path))
