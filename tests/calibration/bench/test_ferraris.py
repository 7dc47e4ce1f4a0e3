"""Ferraris calibration: perfect sessions, Monte Carlo, sessions without labels, real recordings."""

import csv
import json
import re

import numpy as np
import pytest
from places import ROOT

from schuler.calibration.bench.ferraris import SECTIONS, calibrate_ferraris
from schuler.calibration.bench.turns_in_log import ferraris_sections, sections_by_label
from schuler.calibration.result.parameters import LINEAR, imu_errors, vector
from schuler.earth import earth_rate_ned
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import dcm_from_rotvec
from schuler.units import DEG

G = 9.79
EYE = np.eye(3)
POLE = np.pi / 2  # where Earth rate has no horizontal part
HZ = 100.0
NOISE = (1e-4, 1e-3)


def unit(seed=4, size=0.01, families=("b_a", "M_a", "b_g", "M_g", "G_g")):
    rng = np.random.default_rng(seed)
    size_of = {"G_g": 1e-3 * size}
    values = {n: size_of.get(n[:3], size) * rng.standard_normal() for n in LINEAR}
    return imu_errors({n: v for n, v in values.items() if n[:3] in families})


def push(angle, n):
    """Rates of a turn by hand from rest to rest: a raised cosine, whose sum is the angle exactly. [rad/s]"""
    bump = 1.0 - np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    return bump / bump.sum() * angle * HZ


def session(errors, lat=POLE, rng=None, noise=NOISE, sizes=(400, 500), angle=2.0 * np.pi):
    """A session cut into its sections: rate and specific force, with the Earth turning at headings at random."""
    draw = np.random.default_rng(0) if rng is None else rng
    north, _, down = earth_rate_ned(lat)
    omega, f, sections, at = [], [], {}, 0
    for name in SECTIONS:
        i, turning = "xyz".index(name[0]), name.endswith("rot")
        up = EYE[i] * (-1.0 if name.endswith("a") else 1.0)
        n = sizes[1] if turning else sizes[0] + 40 * (at % 3)
        rate = push(angle, n) if turning else np.zeros(n)
        heading = draw.uniform(0.0, 2.0 * np.pi) - np.cumsum(rate) / HZ
        side, other = EYE[(i + 1) % 3], np.cross(up, EYE[(i + 1) % 3])
        earth = -down * up + north * (np.cos(heading)[:, None] * side + np.sin(heading)[:, None] * other)
        omega.append(earth + rate[:, None] * up)
        f.append(np.tile(G * up, (n, 1)))
        sections[name] = (at / HZ, (at + n - 1) / HZ)
        at += n
    return as_log(errors, np.concatenate(omega), np.concatenate(f), rng, noise), sections


def as_log(errors, omega, f, rng=None, noise=NOISE):
    om = omega @ (EYE + errors.M_g).T + f @ errors.G_g.T + errors.b_g
    fm = f @ (EYE + errors.M_a).T + errors.b_a
    if rng is not None:
        om = om + noise[0] * np.sqrt(HZ) * rng.standard_normal(om.shape)
        fm = fm + noise[1] * np.sqrt(HZ) * rng.standard_normal(fm.shape)
    return ImuSeries(np.arange(len(om)) / HZ, om, fm)


@pytest.mark.parametrize("bias", ["all faces", "own axis"])
@pytest.mark.parametrize("angle", [2.0 * np.pi, -2.0 * np.pi, 0.5 * np.pi])
def test_perfect_data_come_back(bias, angle):
    """All 33 parameters; rounding of sums over 500 samples."""
    errors = unit()
    imu, sections = session(errors, angle=angle)
    result = calibrate_ferraris(imu, sections, turn_angle=angle, gravity=G, latitude=POLE, noise=NOISE, bias=bias)
    assert result.names == LINEAR
    np.testing.assert_allclose(result.values, vector(errors), atol=1e-12)
    assert (result.status, result.verdicts, result.gauge) == ("ok", (), "full")
    assert result.condition < 1e3
    assert np.triu(result.in_gauge("lower").errors.M_a, 1) == pytest.approx(0.0)
    back = result.apply(imu)
    np.testing.assert_allclose(back.accel[:400], np.tile([G, 0.0, 0.0], (400, 1)), atol=1e-11)


def test_the_closed_form_of_the_source():
    """Exact without Earth rate and with poses of the same length; with others its bias takes up g-sensitivity."""
    errors = unit()
    imu, sections = session(errors)
    options = {"gravity": G, "latitude": POLE, "noise": NOISE}
    closed = calibrate_ferraris(imu, sections, **options, estimator="ferraris")
    np.testing.assert_allclose(
        closed.errors.G_g, errors.G_g, atol=1e-10
    )  # Earth rate times M times the error of the bias
    assert 1e-7 < np.abs(closed.errors.b_g - errors.b_g).max() < 2e-5
    spans = {k: (a, a + 3.99) if not k.endswith("rot") else (a, b) for k, (a, b) in sections.items()}
    closed = calibrate_ferraris(imu, spans, **options, estimator="ferraris", bias="own axis")
    np.testing.assert_allclose(closed.values, vector(errors), atol=1e-12)
    best = calibrate_ferraris(imu, spans, **options)
    assert (closed.sigma >= best.sigma - 1e-15).all()


def test_counts():
    """A log in counts by the nominal factors; rounding."""
    errors = unit()
    imu, sections = session(errors)
    counts = ImuSeries(imu.t, imu.gyro / 3e-4, imu.accel / 5e-3)
    result = calibrate_ferraris(counts, sections, gravity=G, latitude=POLE, noise=NOISE, nominal=(5e-3, 3e-4))
    np.testing.assert_allclose(result.values, vector(errors), atol=1e-12)
    np.testing.assert_allclose(result.apply(counts).accel[:400, 0], G, atol=1e-11)


def test_increments_are_taken():
    errors = unit()
    imu, sections = session(errors)
    dv = ImuSeries(imu.t, imu.gyro / HZ, imu.accel / HZ, kind="increment")
    result = calibrate_ferraris(dv, sections, gravity=G, latitude=POLE, noise=NOISE)
    np.testing.assert_allclose(result.values, vector(errors), atol=1e-11)


@pytest.mark.parametrize("runs", [40, pytest.param(120, marks=pytest.mark.campaign)])
@pytest.mark.thinned(8)
@pytest.mark.parametrize(
    "options",
    [
        {"latitude": POLE},
        {"latitude": 0.7},
        {"latitude": None},
        {"latitude": POLE, "estimator": "ferraris"},
        {"latitude": POLE, "angle_sigma": 0.003, "axis_sigma": 0.002},
        {"latitude": POLE, "bias": "own axis", "g_sensitivity": False},
    ],
    ids=lambda o: " ".join(f"{k}={v}" for k, v in o.items()),
)
def test_predicted_covariance_is_the_scatter(options, rng, runs):
    """Statistical: chi-square sum within 4 sigma; mean square and mean of each parameter over sigma within 4.5."""
    free = options.get("g_sensitivity", True)
    errors = unit(size=0.003, families=("b_a", "M_a", "b_g", "M_g", *(("G_g",) if free else ())))
    noise = (2e-5, 1e-3)
    # the closed form is unbiased for poses of one length only
    sizes = (400, 500)
    d, z, total = [], [], 0.0
    for _ in range(runs):
        lat = np.arcsin(rng.uniform(-1.0, 1.0)) if options["latitude"] is None else options["latitude"]
        imu, sections = session(errors, lat, rng, noise, sizes)
        if options.get("estimator"):
            sections = {k: (a, a + 3.99) if not k.endswith("rot") else (a, b) for k, (a, b) in sections.items()}
        if "angle_sigma" in options:
            gyro = imu.gyro.copy()
            for k in SECTIONS[6:]:
                inside = (imu.t >= sections[k][0] - 1e-9) & (imu.t <= sections[k][1] + 1e-9)
                wrong = options["angle_sigma"] * rng.standard_normal()
                tilt = options["axis_sigma"] * rng.standard_normal(3)
                u = EYE["xyz".index(k[0])]
                extra = (EYE + errors.M_g) @ (wrong * u + 2.0 * np.pi * np.cross(tilt, u))
                gyro[inside] += extra / (inside.sum() / HZ)
            imu = ImuSeries(imu.t, gyro, imu.accel)
        r = calibrate_ferraris(imu, sections, gravity=G, noise=noise, level_sigma=0.0, **options)
        d.append(r.values - vector(errors, r.names))
        z.append(d[-1] / r.sigma)
        total += d[-1] @ np.linalg.solve(r.covariance, d[-1])
    d, z = np.array(d), np.array(z)
    assert d.shape[1] == (33 if free else 24)
    assert abs(total - d.size) < 4.0 * np.sqrt(2.0 * d.size)
    assert np.abs((z**2).mean(axis=0) - 1.0).max() < 4.5 * np.sqrt(2.0 / len(z))
    assert np.abs(z.mean(axis=0)).max() < 4.5 / np.sqrt(len(z))


def test_turns_by_hand_are_no_truer_than_the_faces(rng):
    """Law: without a statement angle and axes are as the faces are level; level faces leave them exact."""
    imu, sections = session(unit(), rng=rng)
    options = {"gravity": G, "latitude": POLE, "noise": NOISE}
    level = calibrate_ferraris(imu, sections, **options, level_sigma=0.0)
    tilted = calibrate_ferraris(imu, sections, **options, level_sigma=0.002)
    stated = calibrate_ferraris(
        imu, sections, **options, level_sigma=0.002, angle_sigma=0.002 * np.sqrt(2.0), axis_sigma=0.002
    )
    exact = calibrate_ferraris(imu, sections, **options, level_sigma=0.002, angle_sigma=0.0, axis_sigma=0.0)
    np.testing.assert_allclose(tilted.sigma, stated.sigma, rtol=1e-12)
    k = [i for i, n in enumerate(level.names) if n[:3] == "M_g"]
    np.testing.assert_allclose(exact.sigma[k], level.sigma[k], rtol=0.2)  # G_g of another weight
    assert tilted["M_g_xx"][1] == pytest.approx(0.002 * np.sqrt(2.0) / (2.0 * np.pi), rel=0.1)
    assert tilted["M_g_xy"][1] == pytest.approx(0.002, rel=0.1)
    assert any("turns are whole to 0.16 deg" in v for v in tilted.verdicts)


def test_noise_is_taken_from_the_log(rng):
    """Uncertainties without stated noise are those with it: statistical, ten part means in each of six poses."""
    errors = unit()
    imu, sections = session(errors, rng=rng)
    stated = calibrate_ferraris(imu, sections, gravity=G, latitude=POLE, noise=NOISE)
    calibration = calibrate_ferraris(imu, sections, gravity=G, latitude=POLE)
    assert np.median(calibration.sigma / stated.sigma) == pytest.approx(1.1, abs=0.15)  # the larger of two estimates
    np.testing.assert_allclose(calibration.sigma, stated.sigma, rtol=0.8)


def unlabelled(errors, rng, faces=6, turns=3):
    """Poses on faces and turns with the unit tipped over from one to the next by hand, in two seconds."""
    stations = [EYE[i] * s for s in (1.0, -1.0) for i in range(3)][:faces] + list(np.repeat(EYE[:turns], 2, axis=0))
    omega, f = [], []
    up = stations[0]
    for k, to in enumerate(stations):
        axis = np.cross(up, to)
        turn_here = k >= faces and (k - faces) % 2 == 1
        if turn_here:
            rate = push(-2.0 * np.pi, 400)
            omega.append(rate[:, None] * to)
            f.append(np.tile(G * to, (400, 1)))
        elif k and not np.allclose(up, to):
            axis = axis if np.linalg.norm(axis) > 0.5 else np.roll(to, 1)
            over = np.arccos(np.clip(up @ to, -1.0, 1.0))
            rate = push(over, 200)
            # up in body axes turns against the body
            omega.append(-rate[:, None] * axis)
            f.append(np.array([G * dcm_from_rotvec(a * axis) @ up for a in np.cumsum(rate) / HZ]))
        omega.append(np.zeros((400, 3)))
        f.append(np.tile(G * to, (400, 1)))
        up = to
    return as_log(errors, np.concatenate(omega), np.concatenate(f), rng)


def test_a_session_without_labels(rng):
    """All sections are found; parameters within 5 sigma, residuals as noise explains."""
    errors = unit(size=0.005)
    imu = unlabelled(errors, rng)
    rest, turns, angle, notes = ferraris_sections(imu, gravity=G)
    assert len(turns) == 3
    np.testing.assert_allclose(angle, -2.0 * np.pi * EYE)
    assert "all six" in notes[0]
    assert "3 turns about -x, -y, -z" in notes[0]
    assert len(rest) == 12
    result = calibrate_ferraris(imu, gravity=G, latitude=0.0, noise=NOISE)
    truth = vector(errors)
    assert result.status == "ok"
    assert np.abs((result.values - truth) / result.sigma).max() < 5.0
    assert any("found 12 poses" in v for v in result.verdicts)


def test_a_session_that_lacks_something(rng):
    errors = unit(size=0.005)
    two = calibrate_ferraris(unlabelled(errors, rng, turns=2), gravity=G, noise=NOISE)
    assert two.status == "refused"
    assert np.isinf(two["M_g_xz"][1])
    assert np.isfinite(two["M_g_xy"][1])
    assert "turn about each of the three axes" in two.next_pose
    four = calibrate_ferraris(unlabelled(errors, rng, faces=4), gravity=G, noise=NOISE)
    assert four.status == "warning"
    assert "only 4 of the six faces: y down, z down missing" in four.verdicts
    few = calibrate_ferraris(unlabelled(errors, rng, faces=3), gravity=G, noise=NOISE)
    assert few.status == "refused"
    assert "put the unit still on all six faces" in few.verdicts
    none = calibrate_ferraris(unlabelled(errors, rng, turns=0), gravity=G, noise=NOISE)
    assert none.status == "refused"
    assert all(np.isinf(none[n][1]) for n in LINEAR if n.startswith("M_g"))


def test_what_makes_no_sense(rng):
    imu, sections = session(unit(), rng=rng)
    with pytest.raises(InputError, match="missing: z_rot"):
        calibrate_ferraris(imu, {k: v for k, v in sections.items() if k != "z_rot"})
    with pytest.raises(InputError, match="estimator: expected"):
        calibrate_ferraris(imu, sections, estimator="best")
    with pytest.raises(InputError, match="use 'weighted'"):
        calibrate_ferraris(imu, sections, estimator="ferraris", g_sensitivity=False)
    with pytest.raises(InputError, match="20 samples or more"):
        calibrate_ferraris(imu, {**sections, "x_p": (0.0, 0.1)})
    with pytest.raises(InputError, match="state the noise"):
        calibrate_ferraris(session(unit())[0], sections)
    rng = np.random.default_rng(1)
    shaking = ImuSeries(np.arange(5000) / HZ, rng.standard_normal((5000, 3)), rng.standard_normal((5000, 3)) * 10)
    with pytest.raises(InputError, match="intervals at rest before and after"):
        ferraris_sections(shaking, gravity=G)
    with pytest.raises(InputError, match="comes twice"):
        sections_by_label(["x_p", "x_p", "x_a", "x_p"], np.arange(4.0))


def example(shared_data):
    folder = shared_data / "imucal_ferraris"
    data = np.genfromtxt(folder / "example_ferraris_session.csv", delimiter=",", names=True)
    t = np.arange(len(data)) / 102.4
    imu = ImuSeries(t, *(np.stack([data[f"{s}_{a}"] for a in "xyz"], axis=1) for s in ("gyr", "acc")))
    listed = json.loads((folder / "example_ferraris_session_list.json").read_text())
    sections = {k: (float(t[v["start"]]), float(t[v["end"] - 1])) for k, v in listed.items()}
    return imu, sections, json.loads((folder / "session_expected.json").read_text())


def assert_imucal(result, expected, nominal, digits):
    """imucal's K R, b, K_ga in the units of its log; all digits it prints, except where its file was cut."""
    e = result.errors
    K_a, K_g = (
        np.diag(np.array(expected[k]).diagonal() if np.ndim(expected[k]) == 2 else expected[k]) for k in ("K_a", "K_g")
    )
    np.testing.assert_allclose((EYE + e.M_a) / nominal[0], K_a @ expected["R_a"], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(e.b_a / nominal[0], expected["b_a"], rtol=1e-11)
    np.testing.assert_allclose(DEG * (EYE + e.M_g) / nominal[1], K_g @ expected["R_g"], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(e.b_g / nominal[1], expected["b_g"], rtol=1e-11)
    np.testing.assert_allclose(e.G_g / nominal[1], expected["K_ga"], atol=digits)


@pytest.mark.realdata
def test_imucal_example(shared_data):
    """Same model, same closed form, g = 9.81: all printed digits (K_ga printed to seven decimals)."""
    imu, sections, expected = example(shared_data)
    nominal = (1.0, DEG)
    options = {"turn_angle": -2.0 * np.pi, "gravity": 9.81, "nominal": nominal}
    result = calibrate_ferraris(imu, sections, **options, estimator="ferraris", bias="own axis", latitude=0.0)
    # imucal knows no Earth rate: at the equator its vertical part is zero
    assert_imucal(result, expected, nominal, 6e-8)
    assert result.extra["level_sigma"] == pytest.approx(0.003, abs=0.002)
    # least squares moves the bias by 0.9 mdeg/s, which is g-sensitivity that the mean over unequal poses takes up
    best = calibrate_ferraris(imu, sections, **options, latitude=0.0)
    assert 5e-4 < np.abs(best.errors.b_g - result.errors.b_g).max() / DEG < 2e-3
    assert np.abs(best.errors.M_g - result.errors.M_g).max() < 2e-5
    assert best.status == "ok"


@pytest.mark.realdata
def test_imucal_example_without_labels(shared_data):
    """Sections found in the log: gyroscope response within 2e-4 of the labelled one, which is the operator's turns."""
    imu, _, expected = example(shared_data)
    result = calibrate_ferraris(imu, gravity=9.81, nominal=(1.0, DEG), latitude=50.0 * DEG)
    assert any("(all six) and 3 turns about -x, -y, -z" in v for v in result.verdicts)
    np.testing.assert_allclose(EYE + result.errors.M_g, np.diag(expected["K_g"]) @ expected["R_g"], atol=3e-4)
    np.testing.assert_allclose(np.diag(result.errors.M_a) + 1.0, expected["K_a"], atol=6e-4)
    assert result.status == "warning"  # the x accelerometer reads 8 mm/s^2 less when it comes back to a face
    assert any("accel: the residuals are" in v for v in result.verdicts)


@pytest.mark.realdata
def test_imucal_annotated(shared_data):
    """Raw counts with labelled samples and gyroscopes wired left-handed; all printed digits."""
    folder = shared_data / "imucal_ferraris"
    with (folder / "annotated_session.csv").open() as file:
        rows = sorted(csv.DictReader(file), key=lambda row: int(row["samples"]))
    t = np.array([float(row["samples"]) for row in rows]) / 204.8
    imu = ImuSeries(t, *(np.array([[float(row[f"{s}_{a}"]) for a in "xyz"] for row in rows]) for s in ("gyr", "acc")))
    expected = json.loads((folder / "annotated_session_expected.json").read_text())
    nominal = (1.0 / 208.0, DEG / 16.4)
    result = calibrate_ferraris(
        imu, sections_by_label([row["part"] for row in rows], t), turn_angle=-2.0 * np.pi, gravity=9.81,
        nominal=nominal, estimator="ferraris", bias="own axis", latitude=0.0,
    )  # fmt: skip
    assert_imucal(result, expected, nominal, 1e-12)
    assert np.diag(result.errors.M_g) == pytest.approx(-2.0, abs=0.05)


def test_documented_example_runs():
    """docs/calibration-bench.md."""
    page = (ROOT / "docs" / "calibration-bench.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert len(blocks) == 1
    exec(blocks[0], {})
