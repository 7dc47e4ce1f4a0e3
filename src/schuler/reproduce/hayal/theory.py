"""Chapters 2 to 4.2: data sheets, six-position test, geometry, Jacobians, attitudes, Earth rate."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits, shown, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR, G0, MG, MPS_PER_RTHR, PPM

if TYPE_CHECKING:
    pass

_SHEET = (  # gyroscopes, then accelerometers: attribute, unit, size, printed HG1700 and HG1900
    ("gyro", "range", "deg/s", DEG, "1074", "1000"),
    ("gyro", "scale_factor", "ppm", PPM, "150", "150"),
    ("gyro", "turn_on_bias", "deg/h", DEG_PER_HR, "1", "17"),
    ("gyro", "bias_instability", "deg/h", DEG_PER_HR, "1", "7"),
    ("gyro", "random_walk", "deg/sqrt(h)", DEG_PER_RTHR, "0.125", "0.09"),
    ("gyro", "misalignment", "urad", 1e-6, "500", "80"),
    ("gyro", "g_sensitivity", "deg/h/g", DEG_PER_HR / G0, "", "3"),
    ("accel", "range", "g", G0, "70", "70"),
    ("accel", "scale_factor", "ppm", PPM, "300", "300"),
    ("accel", "turn_on_bias", "mg", MG, "1", "1"),
    ("accel", "bias_instability", "mg", MG, "1", "1"),
    ("accel", "misalignment", "urad", 1e-6, "100", "100"),
    ("accel", "random_walk", "(m/s)/sqrt(h)", MPS_PER_RTHR, "0.22", "0.22"),
)


def _data_sheets(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue

    cells = []
    for column, imu in enumerate(("HG1700", "HG1900")):
        spec = catalogue.spec(imu)
        for sensor, name, unit, size, *printed in _SHEET:
            if printed[column]:
                ours = getattr(getattr(spec, sensor), name) / size
                cells.append(digits(f"{imu}, {sensor}: {name}", printed[column], ours, unit=unit))
    return Outcome(transcribed(*cells))


def _sample_noise(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue

    one, other = catalogue.spec("HG1700"), catalogue.spec("HG1900")
    return Outcome(
        transcribed(
            digits("HG1700, sigma_a at 1 Hz", "3.667e-3", one.accel.random_walk, unit="m/s^2"),
            digits("HG1900, sigma_a at 1 Hz", "3.667e-3", other.accel.random_walk, unit="m/s^2"),
            digits("HG1700, sigma_omega at 1 Hz", "3.636e-5", one.gyro.random_walk, unit="rad/s"),
            digits("HG1900, sigma_omega at 1 Hz", "2.618e-5", other.gyro.random_walk, unit="rad/s"),
        )
    )


def _six_positions(effort: Effort) -> Outcome:
    """Equations (2.3) to (2.9) with a unit that is known, then with tilted axes."""
    from schuler.calibration.bench.poses import Poses
    from schuler.calibration.bench.sixposition import calibrate_sixposition
    from schuler.calibration.result.parameters import imu_errors
    from schuler.rotation import dcm_from_rotvec

    g, one, b = 9.801, np.eye(3), np.array((0.010, -0.02, 0.03))
    up = np.vstack([np.array([e, -e]) for e in one])
    t = np.linspace(0.0, 50.0, 6)

    def poses(M: np.ndarray) -> Poses:
        f = g * up @ M.T + b
        return Poses(f, np.zeros((6, 3)), np.full((6, 3), 1e-6), np.full((6, 3), 1e-6), t, t + 9.0)

    M = one + np.array(((3e-4, 1e-4, -2e-4), (-1e-4, -2e-4, 3e-4), (2e-4, 1e-4, 5e-4)))
    improved = calibrate_sixposition(poses(M), gravity=g, level_sigma=0.0, gyro="none")
    standard = calibrate_sixposition(
        poses(np.diag(np.diag(M))), gravity=g, improved=False, level_sigma=0.0, gyro="none"
    )
    Y = poses(M).f
    equation = (Y[::2] + Y[1::2]).diagonal() / 2.0  # (2.5), each axis up and down
    cells = [
        claimed(
            "(2.5), (2.6): bias",
            "b = (up + down) / 2",
            float(np.abs(standard.errors.b_a - b).max()),
            high=1e-12,
            unit="m/s^2",
            tolerance="rounding",
        ),
        claimed(
            "(2.5), (2.6): scale factor",
            "S = (up - down - 2 K) / 2 K",
            float(np.abs(np.diag(standard.errors.M_a) - np.diag(M - one)).max()),
            high=1e-12,
            tolerance="rounding",
        ),
        claimed(
            "(2.5) by hand against ours",
            "the same",
            float(np.abs(equation - improved.errors.b_a).max()),
            high=1e-12,
            unit="m/s^2",
            tolerance="rounding",
        ),
        claimed(
            "(2.8), (2.9): all twelve",
            "X = Y A' inv(A A')",
            float(max(np.abs(improved.errors.M_a - (M - one)).max(), np.abs(improved.errors.b_a - b).max())),
            high=1e-12,
            tolerance="rounding",
        ),
    ]
    for angle, loss in ((0.1, "-1.5"), (0.5, "-38"), (1.0, "-152"), (2.0, "-609")):
        turned = imu_errors({"M_a_xx": 0.0}).M_a + dcm_from_rotvec(np.array((0.0, angle * DEG, 0.0)))
        calibration = calibrate_sixposition(poses(turned), gravity=g, improved=False, gyro="none")
        name = f"scale error of an axis {angle:g} deg off"
        cells.append(digits(name, loss, calibration["M_a_xx"][0] / PPM, unit="ppm", reference="corrected"))
    return Outcome(
        tuple(cells),
        "The thesis names the effect of tilt without numbers; these are 1 - cos of the angle. It calls the diagonal "
        "of X scale factor errors; they are 1 + s.",
    )


def _earth_rate(effort: Effort) -> Outcome:
    from schuler.earth import WGS84, earth_rate_ned, gravity_somigliana
    from schuler.frames import C_en
    from schuler.reproduce.hayal.study.figures import earth_rate_figure
    from schuler.reproduce.hayal.study.multiposition import GRAVITY, LATITUDE

    rate = earth_rate_ned(LATITUDE)
    omega = WGS84.omega_ie
    turned = C_en((LATITUDE, -83.0 * DEG, 0.0)).T @ (0.0, 0.0, omega)
    cells: list[Cell] = [
        digits("Earth rate", "7.292115e-5", omega, unit="rad/s"),
        against(
            "down component as printed",
            -omega * np.sin(-83.0 * DEG),
            rate[2],
            relative=1e-12,
            tolerance="rounding",
            unit="rad/s",
            source="-omega sin(lambda)",
        ),
        against(
            "north component",
            omega * np.cos(LATITUDE),
            rate[0],
            relative=1e-12,
            tolerance="rounding",
            reference="corrected",
            unit="rad/s",
            source="omega cos(omega)",
        ),
        against(
            "down component",
            -omega * np.sin(LATITUDE),
            rate[2],
            relative=1e-12,
            tolerance="rounding",
            reference="corrected",
            unit="rad/s",
            source="-omega sin(lambda)",
        ),
        claimed(
            "(4.3) at longitude -83 deg against it",
            "independent of longitude",
            float(np.abs(turned - rate).max()),
            high=1e-18,
            unit="rad/s",
            tolerance="rounding",
        ),
        claimed(
            "height at which normal gravity is 9.801",
            "mean gravity at 40 deg",
            float((gravity_somigliana(LATITUDE) - GRAVITY) / (gravity_somigliana(LATITUDE) * 2.0 / WGS84.a)),
            low=0.0,
            high=460.0,
            unit="m",
        ),
    ]
    return Outcome(
        tuple(cells),
        "(4.2) prints cos omega and sin lambda; both are of the latitude, as its own (4.3) gives.",
        (partial(earth_rate_figure, LATITUDE),),
    )


def _rotation(effort: Effort) -> Outcome:
    from schuler.reproduce.hayal.study.attitudes import attitude_rotation

    rng = np.random.default_rng(effort.seed)
    e, x, a = rng.uniform(-3.0, 3.0, 3)

    def about(axis: int, t: float) -> np.ndarray:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R = np.eye(3)
        R[i, i] = R[j, j] = np.cos(t)
        R[i, j], R[j, i] = np.sin(t), -np.sin(t)
        return R

    product = about(2, a) @ about(1, x) @ about(0, e)
    off = float(np.abs(attitude_rotation((e, x, a)) - product).max())
    return Outcome(
        (claimed("(4.10) against R3 R2 R1", "R = R3(alpha) R2(chi) R1(eta)", off, high=1e-14, tolerance="rounding"),)
    )


def _scaled_reference(effort: Effort) -> Outcome:
    from schuler.calibration.bench.gauss_helmert import adjust
    from schuler.reproduce.hayal.study.multiposition import GRAVITY, StudyCase, simulated_readings

    case = StudyCase(sensor="accel")
    Y = simulated_readings(case, np.random.default_rng(effort.seed))
    kappa = 1e-3
    one, other = adjust(Y, case.sigma, GRAVITY), adjust(Y, case.sigma, GRAVITY * (1.0 + kappa))
    moved = np.abs(other.values - one.values)
    words = "does not change"
    return Outcome(
        (
            claimed(
                "bias, gravity wrong by 1e-3",
                words,
                float(moved[:3].max()),
                high=1e-11,
                unit="m/s^2",
                tolerance="rounding",
            ),
            claimed("angles", words, float(moved[6:].max()), high=1e-12, unit="rad", tolerance="rounding"),
            claimed(
                "1 + s",
                "divided by the factor",
                float(np.abs((1.0 + other.values[3:6]) * (1.0 + kappa) - 1.0 - one.values[3:6]).max()),
                high=1e-12,
                tolerance="rounding",
            ),
            shown("scale factor moves by", float(moved[3]) / PPM, unit="ppm"),
        )
    )


ITEMS: tuple[Item, ...] = (
    Item("table-2.1", "data sheets of HG1700 and HG1900", "exact", _data_sheets),
    Item("text-2.4.1.1", "six-position test, standard and improved, and what tilt costs it", "exact", _six_positions),
    Item("table-3.1", "noise of a sample at 1 Hz from random walks", "exact", _sample_noise),
    Item("fig-4.1", "Earth rate in north-east-down", "exact", _earth_rate),
    Item("text-4.1.2", "a wrong gravity changes scale factors only", "exact", _scaled_reference),
    Item("text-4.2", "rotation to another attitude", "exact", _rotation),
)
