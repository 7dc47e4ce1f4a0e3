"""Chapters 2 and 4 and the appendices: constants, gravity, classes of sensors, data sheets, the system matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.reproduce.cells import Cell, Tolerance, against, claimed, digits, transcribed
from schuler.reproduce.items import Effort, Item, Outcome


def _table_2_1(effort: Effort) -> Outcome:
    from schuler.earth import WGS84

    e = float(np.sqrt(WGS84.e2))
    return Outcome(
        (
            *transcribed(
                digits("equatorial radius", "6378137.0", WGS84.a, unit="m"),
                digits("inverse flattening", "298.257223563", 1.0 / WGS84.f, unit="-"),
                digits("rotation rate", "7.292115e-5", WGS84.omega_ie, unit="rad/s"),
                digits("gravitational constant", "3.986004418e14", WGS84.GM, unit="m^3/s^2"),
            ),
            digits("polar radius", "6356752.3142", WGS84.b, unit="m"),
            digits("eccentricity", "0.0818191908425", e, unit="-"),
            digits("eccentricity of this flattening", "0.0818191908426", e, unit="-", reference="corrected"),
        ),
        "The last digit of the eccentricity does not follow from the flattening printed beside it (sqrt(f (2 - f))).",
    )  # fmt: skip


def thesis_gravity(lat: float, h: float) -> np.ndarray:
    """Gravity as in appendix A, (A-1) to (A-6) with FIX 3, north, east, down. [m/s^2]"""
    from schuler import earth, frames, rotation

    C_ne, Omega = frames.C_en([lat, 0.0]).T, rotation.skew(earth.earth_rate_ned(lat))
    r_s, r_b = (C_ne @ frames.ecef_from_llh([lat, 0.0, height]) for height in (0.0, h))
    size = float(np.linalg.norm(r_s))
    g_0 = np.array([0.0, 0.0, float(earth.gravity_somigliana(lat))])
    return np.asarray((size / (size + h)) ** 2 * (g_0 + Omega @ Omega @ r_s) - Omega @ Omega @ r_b)


def _gravity(effort: Effort) -> Outcome:
    from schuler import earth, frames
    from schuler.units import DEG

    lat, forty = 39.92 * DEG, 40.0 * DEG
    formula = [thesis_gravity(lat, h) for h in (0.0, 1000.0)]
    field = [earth.gravity_ned(lat, h) for h in (0.0, 1000.0)]
    slope = (
        -2.0 * float(earth.gravity_somigliana(forty)) / float(np.linalg.norm(frames.ecef_from_llh([forty, 0.0, 0.0])))
    )
    exact = (float(earth.gravity_ned(forty, 10.0)[2]) - float(earth.gravity_ned(forty, -10.0)[2])) / 20.0
    printed = (("0 m", "9.801626"), ("1000 m", "9.798539"))
    cells = [
        digits(f"down, 39.92 deg, {at}, its formula", text, float(g[2]), unit="m/s^2", reference="corrected")
        for (at, text), g in zip(printed, formula, strict=True)
    ]
    cells += [
        against(
            f"down, 39.92 deg, {at}, exact field", float(text), float(g[2]), absolute=2e-6, unit="m/s^2",
            tolerance="band", reference="corrected",
        )
        for (at, text), g in zip(printed, field, strict=True)
    ]  # fmt: skip
    cells += [
        digits("north over height", "-7.9e-9", float(formula[1][0]) / 1000.0, unit="1/s^2", reference="corrected"),
        digits("down over height at 40 deg, (2-89)", "-3.078e-6", slope, unit="1/s^2", reference="corrected"),
        digits("down over height at 40 deg, exact", "-3.086e-6", exact, unit="1/s^2", reference="corrected"),
    ]
    return Outcome(
        tuple(cells),
        "The position in (A-6) lacks the height (FIX 3); numbers are those of the corrected equations. The thesis "
        "lets gravitation fall as that of a sphere; the field of the ellipsoid, which this package uses, is 1.2e-6 "
        "m/s^2 larger at 1000 m and 0.3 % steeper.",
    )


#: Printed limits: gyroscope [deg/h], accelerometer [mg]; the upper end of a range.
_CLASSES = {
    "military": ("0.005", "0.030"), "navigation": ("0.01", "0.050"), "tactical": ("1", "1"), "ahrs": ("10", "1"),
    "control-system": ("1000", "10"),
}  # fmt: skip
#: Gyroscope types: bias [deg/h] and g-dependent bias [deg/h/g], upper ends, bandwidth [Hz].
_GYROS = {
    "rig": ("10", "10", "60"), "dtg": ("10", "10", "100"), "flex": ("50", "10", "100"),
    "vibratory": ("1800", "180", "500"), "rlg": ("10", "0", "200"), "fog": ("50", "1", "100"),
}  # fmt: skip


def _table_2_2(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue

    def upper(printed: object) -> float:
        return float(np.max(np.asarray(printed, dtype=np.float64)))

    cells: list[Cell] = []
    for name, (gyro, accel) in _CLASSES.items():
        e = catalogue.entry(f"yaman-class-{name}").printed
        bias = upper(e["accel_bias_mg"]) if "accel_bias_mg" in e else upper(e["accel_bias_ug"]) / 1000.0
        cells.append(digits(f"{name}: gyroscope bias", gyro, upper(e["gyro_bias_deg_hr"]), unit="deg/h"))
        cells.append(digits(f"{name}: accelerometer bias", accel, bias, unit="mg"))
    keys = ("gyro_bias_deg_hr", "gyro_g_sensitivity_deg_hr_g", "gyro_bandwidth_hz")
    for name, numbers in _GYROS.items():
        e = catalogue.entry(f"yaman-gyro-{name}").printed
        for key, number, unit in zip(keys, numbers, ("deg/h", "deg/h/g", "Hz"), strict=True):
            stated = [v for k, v in e.items() if k.startswith(key)]
            cells.append(
                digits(f"{name}: {key.split('_', 1)[1].rsplit('_deg', 1)[0]}", number, upper(stated[0]), unit=unit)
            )
    return Outcome(transcribed(*cells))


#: Noise densities in SI of the sheets in appendix E: gyroscope [deg/s/sqrt(Hz)], accelerometer [mg/sqrt(Hz)].
_SHEETS = {
    "MPU-6000": {"N_g": "0.005", "N_a": "0.400", "b_g": "20", "S_g": "3", "G_g": "0.1", "b_a": "80", "S_a": "3"},
    "VN-200": {"N_g": "0.0035", "N_a": "0.14"},
    "MTi-G-710": {"N_g": "0.01", "N_a": "0.080", "b_g": "0.2", "G_g": "0.003", "b_a": "3.06"},
}


def _appendix_e(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue
    from schuler.units import DEG, G0, MG, PERCENT

    cells = []
    for name, printed in _SHEETS.items():
        s = catalogue.spec(name)
        ours = {
            "N_g": (s.gyro.random_walk / DEG, "deg/s/sqrt(Hz)"), "N_a": (s.accel.random_walk / MG, "mg/sqrt(Hz)"),
            "b_g": (s.gyro.turn_on_bias / DEG, "deg/s"), "S_g": (s.gyro.scale_factor / PERCENT, "%"),
            "G_g": (s.gyro.g_sensitivity * G0 / DEG, "deg/s/g"), "b_a": (s.accel.turn_on_bias / MG, "mg"),
            "S_a": (s.accel.scale_factor / PERCENT, "%"),
        }  # fmt: skip
        cells += [digits(f"{name}: {key}", text, ours[key][0], unit=ours[key][1]) for key, text in printed.items()]
    return Outcome(
        transcribed(*cells),
        "The bias of the MTi-G-710 is printed as 0.03 m/s^2. Of the MPU-6000's biases the larger, of its z axis.",
    )


def _system_matrix(effort: Effort) -> Outcome:
    from schuler import earth, rotation
    from schuler.filtering.error_model import system_matrix_ned
    from schuler.filtering.states import StateLayout

    rng = np.random.default_rng(effort.seed)
    lat, h = rng.uniform(0.3, 1.0), rng.uniform(0.0, 9000.0)
    v = rng.uniform(20.0, 120.0, 3)
    C = rotation.dcm_from_rpy(rng.uniform(-1.0, 1.0, 3))
    f, omega = rng.normal([0.0, 0.0, -9.8]), rng.normal(size=3)
    F = system_matrix_ned(StateLayout({}), C, v, np.array([lat, 0.0, h]), omega, f, position="radians")
    R_N, R_E = earth.radii_of_curvature(lat)
    rn, re, Om, s, c, t = R_N + h, R_E + h, earth.WGS84.omega_ie, np.sin(lat), np.cos(lat), np.tan(lat)
    with_latitude = float(np.diff(earth.gravity_ned(np.array([lat - 1e-4, lat + 1e-4]), h)[:, 2])[0]) / 2e-4
    with_height = float(np.diff(earth.gravity_ned(lat, np.array([h - 10.0, h + 10.0]))[:, 0])[0]) / 20.0
    # ours has attitude, velocity, position; name: element of ours, as printed, corrected
    elements = {
        "FIX 4: F_VP(1,3)": (
            F[3, 8] - with_height, (v[1] ** 2 * t - v[0] * v[2]) / re**2, v[1] ** 2 * t / re**2 - v[0] * v[2] / rn**2,
        ),
        "FIX 5: F_VP(3,1)": (F[5, 6] - with_latitude, -2.0 * v[1] * Om * s, 2.0 * v[1] * Om * s),
        "FIX 6: F_VV(2,3)": (F[4, 5], -v[1] / re - 2.0 * Om * c, v[1] / re + 2.0 * Om * c),
        "FIX 7: F_PsiP(1,3)": (F[0, 8], v[1] / rn**2, v[1] / re**2),
    }  # fmt: skip
    cells: list[Cell] = []
    for name, (ours, printed, mended) in elements.items():
        # the engine keeps what the thesis drops, the radii's change with latitude: 3 e^2 of a rate squared; gravity's
        # change is taken off by differences, which are good to 1e-16 g over their step
        dropped = name.startswith("FIX 5")
        band = 1e-9 * abs(mended) + (0.02 * float(v @ v) / re if dropped else 0.0) + (1e-16 if "FIX 4" in name else 0.0)
        kind: Tolerance = "band" if dropped else "rounding"
        cells.append(against(name, float(printed), float(ours), absolute=band, tolerance=kind))
        cells.append(
            against(
                f"{name}, corrected", float(mended), float(ours), absolute=band, tolerance=kind, reference="corrected"
            )
        )
    return Outcome(
        tuple(cells),
        "Source errors in four elements of (2-106), (2-107) and (2-109): a radius of curvature of the other "
        "direction, or a sign. Corrected elements agree with finite differences of the mechanization.",
    )


def _limits(effort: Effort) -> Outcome:
    """Limits that white noise and P2 set on Tables 5.3 and 5.4."""
    from schuler.calibration.field.options import FieldOptions
    from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, simulated_unit
    from schuler.reproduce.yaman.study.tables import DURATION_S, GRADES, PRINTED_CAMPAIGNS, noise_limit
    from schuler.sensors import catalogue
    from schuler.units import DEG_PER_HR, DEG_PER_HR_PER_G, UG

    auto, tactical = (catalogue.spec(grade) for grade in GRADES)

    def limit(spec: object, name: str, unit: float) -> float:
        return float(noise_limit(spec, name, DURATION_S) or np.nan) / unit  # type: ignore[arg-type]

    allowed = limit(tactical, "b_g_x", DEG_PER_HR)
    cells = [
        digits(
            "gyroscope bias, automotive", "1.29", limit(auto, "b_g_x", DEG_PER_HR), unit="deg/h", reference="corrected"
        ),
        digits("gyroscope bias, tactical", "0.307", allowed, unit="deg/h", reference="corrected"),
        digits("accelerometer bias, automotive", "36", limit(auto, "b_a_x", UG), unit="ug", reference="corrected"),
        digits("accelerometer bias, tactical", "1.45", limit(tactical, "b_a_x", UG), unit="ug", reference="corrected"),
    ]  # fmt: skip
    for name in ("b_g_x", "b_g_z"):
        left = PRINTED_CAMPAIGNS["yaman-tactical"][name][3]
        cells.append(
            claimed(f"smallest {name} that noise allows, tactical", f"{left:g} left", allowed, high=left, unit="deg/h")
        )
    options = replace(FieldOptions.thesis(), earth_rate="off")
    job = FieldJob(auto, options=options, rests="given")
    (imu, _), _, heading = simulated_unit(job, np.random.SeedSequence(effort.seed))
    c = calibrated(job, imu, heading).calibration
    diagonal = [c[f"G_g_{a}{a}"][1] / DEG_PER_HR_PER_G for a in "xyz"]
    margin = 2.0 / np.sqrt(2.0 * 60.0)  # two standard errors of a scatter of 60
    cells += [
        claimed(
            f"G_g_{a}{a} without P2, 1 sigma", "52 to 56, scatter of 60 runs of another filter", sigma,
            low=52.0 * (1.0 - margin), high=56.0 * (1.0 + margin), unit="deg/h/g", tolerance="statistical",
            reference="corrected",
        )
        for a, sigma in zip("xyz", diagonal, strict=True)
    ]  # fmt: skip
    return Outcome(
        tuple(cells),
        "Source error: its tactical gyroscope biases are known better than the stated noise allows in 540 s, "
        "N / sqrt(T) beside the prior; it seems to have drawn noise of N sqrt(rate / 2).",
    )


CHAPTER_2 = (
    Item("table-2.1", "Constants of the ellipsoid", "exact", _table_2_1),
    Item("eq-2.106", "Elements of the system matrix that are misprinted", "exact", _system_matrix),
    Item("table-2.2", "Classes of IMUs and gyroscopes", "exact", _table_2_2),
)
LIMITS = (Item("text-5.4", "What noise and the Earth's rate allow to be known", "exact", _limits),)
APPENDIX_A = (Item("text-A", "Gravity of the ellipsoid with height", "exact", _gravity),)
APPENDIX_E = (Item("text-E", "Data sheets of the three units", "exact", _appendix_e, also=("fig-E.1",)),)
