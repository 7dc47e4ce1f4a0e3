"""Chapter 1: constants, gravity, attitude, settings of the board."""

from __future__ import annotations

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, G0

#: Of the samples. [s]
TAU = 0.006


def _constants(effort: Effort) -> Outcome:
    from schuler.earth import WGS84

    return Outcome(
        (
            digits("equatorial radius", "6378137", WGS84.a, unit="m"),
            digits("polar radius", "6356752.3142", WGS84.b, unit="m"),
            digits("gravitational constant", "3.986004418e14", WGS84.GM, unit="m^3/s^2"),
            digits("Earth rate", "7.292158e-5", WGS84.omega_ie, unit="rad/s"),
            digits("Earth rate of WGS 84", "7.292115e-5", WGS84.omega_ie, unit="rad/s", reference="corrected"),
            digits("1 / flattening", "298.257223563", 1.0 / WGS84.f),
            digits("eccentricity", "0.0818191908426", float(np.sqrt(WGS84.f * (2.0 - WGS84.f)))),
        ),
        "Earth rate is misprinted: 7.292158 for 7.292115 (two digits lost); his text has 7.27e-5 as well.",
    )


def _board(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue

    spec = catalogue.spec("MPU-9150")
    turn, pull = spec.gyro.range or np.nan, spec.accel.range or np.nan
    gyro, accel = 2.0 * turn / 2**16, 2.0 * pull / 2**16
    return Outcome(
        (
            digits("sample interval", "0.006", 1.0 / float(spec.rate_hz or np.nan), unit="s"),
            digits("gyroscope range", "500", turn / DEG, unit="deg/s"),
            digits("gyroscope, a bit", "0.0152", gyro / DEG, unit="deg/s"),
            digits("gyroscope, a bit: 1000 / 2^16", "0.01526", gyro / DEG, unit="deg/s", reference="corrected"),
            digits("accelerometer range", "4", pull / G0, unit="g"),
            digits("accelerometer, a bit", "122.07", accel / G0 * 1e3, unit="mg"),
            digits("accelerometer, a bit: 8 g / 2^16", "122.07", accel / G0 * 1e6, unit="ug", reference="corrected"),
            shown("accelerometer, a bit in the catalogue", (spec.accel.resolution or np.nan) / G0 * 1e6, unit="ug"),
        ),
        "The accelerometer's bit is 122.07 micro-g, printed as mg; the gyroscope's is cut off, not rounded.",
    )


def _attitude(effort: Effort) -> Outcome:
    """(1.5), (1.10), (1.11) and what the first-order update costs."""
    from schuler.earth import WGS84
    from schuler.mechanization.strapdown import NavState, mechanize
    from schuler.recording.series import Increments
    from schuler.reproduce.stefanisko.study.generator import flat_navigation
    from schuler.rotation import dcm_from_quat, dcm_from_rpy, quat_from_rpy
    from schuler.simulation.motion import StaticMotion, ideal_increments

    rng = np.random.default_rng(effort.seed)
    rpy = rng.uniform(-1.0, 1.0, 3)
    (r, p, y) = rpy
    factors = (
        ((1, 0, 0), (0, np.cos(r), np.sin(r)), (0, -np.sin(r), np.cos(r))),
        ((np.cos(p), 0, -np.sin(p)), (0, 1, 0), (np.sin(p), 0, np.cos(p))),
        ((np.cos(y), np.sin(y), 0), (-np.sin(y), np.cos(y), 0), (0, 0, 1)),
    )
    product = np.array(factors[0]) @ np.array(factors[1]) @ np.array(factors[2])
    dual = dcm_from_rpy((r + np.pi, np.pi - p, y + np.pi))
    spin = np.zeros((round(1.0 / TAU), 6))
    spin[:, 5] = 100.0 * DEG
    first = flat_navigation(spin, TAU, np.zeros(3), np.zeros(3), np.eye(3), attitude="first order").C_nb[-1]
    growth = 100.0 * (float(np.linalg.norm(first[:, 0])) ** (1.0 / (len(spin) * TAU)) - 1.0)
    cells: list[Cell] = [
        claimed(
            "(1.5) mended against our rotation",
            "C_bn, three factors",
            float(np.abs(product - dcm_from_rpy(rpy).T).max()),
            high=1e-14,
            tolerance="rounding",
            reference="corrected",
        ),
        claimed(
            "(1.11) against our quaternion",
            "C from q",
            float(np.abs(dcm_from_quat(quat_from_rpy(rpy)) - dcm_from_rpy(rpy)).max()),
            high=1e-14,
            tolerance="rounding",
        ),
        claimed(
            "dual Euler angles",
            "the same attitude",
            float(np.abs(dual - dcm_from_rpy(rpy)).max()),
            high=1e-14,
            tolerance="rounding",
        ),
        digits(
            "(1.15) at 100 deg/s and 6 ms: columns grow in a second by",
            "0.9",
            growth,
            unit="percent",
            reference="corrected",
        ),
    ]
    # at the equator the error of leaving Earth rate out of omega_eb is largest
    place = np.zeros(3)
    motion = StaticMotion(place, np.zeros(3), 41.0)
    t = np.linspace(0.0, 40.0, 2001)
    dtheta, dv = ideal_increments(motion, t)
    dtheta = dtheta + np.array((WGS84.omega_ie, 0.0, 0.0)) * 0.02
    start = NavState.from_geodetic(0.0, place, np.zeros(3), np.zeros(3))
    track = mechanize(Increments(t[1:], np.diff(t), dtheta, dv), start).r_eb_e - start.r_eb_e
    off = np.linalg.norm(track, axis=1)
    cells += [
        digits(
            f"Earth rate left out of the attitude, {s} s", text, float(off[50 * s - 1]), unit="m", reference="corrected"
        )
        for s, text in ((20, "0.95"), (40, "7.6"))
    ]
    return Outcome(
        tuple(cells),
        "(1.5) prints a wrong yaw factor and a wrong element; (1.8) does not say that omega is relative to the "
        "Earth. Costs of the first-order update and of leaving Earth rate out are of an independent check.",
    )


def _gravity(effort: Effort) -> Outcome:
    from schuler.earth import WGS84, gravitation_j2, gravity_somigliana
    from schuler.frames import C_en, ecef_from_llh
    from schuler.reproduce.stefanisko.study.experiment import ESIEE

    lat = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 1801)
    formula = 9.780327 * (1.0 + 0.0053024 * np.sin(lat) ** 2 - 0.0000058 * np.sin(2.0 * lat) ** 2)
    axial = WGS84.omega_ie**2 * ecef_from_llh(ESIEE)[2]
    here = float(gravity_somigliana(ESIEE[0], 0.0))
    r = ecef_from_llh(ESIEE)
    from_j2 = float((C_en(ESIEE).T @ (gravitation_j2(r) + WGS84.omega_ie**2 * r * (1.0, 1.0, 0.0)))[2])
    high = float(gravity_somigliana(49.0 * DEG, 1e4))
    f, a, b, mu, w = WGS84.f, WGS84.a, WGS84.b, WGS84.GM, WGS84.omega_ie
    m = w**2 * a**2 * b / mu
    zero = float(gravity_somigliana(49.0 * DEG, 0.0))
    printed = zero * (1.0 - 2.0 / a * (1.0 + f + m) * 1e4 + 3.0 / a**2 * 1e8)
    return Outcome(
        (
            claimed(
                "(1.24) against the normal gravity of WGS 84",
                "called WGS 84",
                float(np.abs(formula - gravity_somigliana(lat)).max()),
                high=2.15e-6,
                low=2.05e-6,
                unit="m/s^2",
                tolerance="printed digits",
                reference="corrected",
            ),
            digits("(1.21): axial term of the identity matrix", "0.0254", axial, unit="m/s^2", reference="corrected"),
            digits("(1.21): that makes in 20 s", "5.1", 0.5 * axial * 400.0, unit="m", reference="corrected"),
            against(
                "(1.23) as printed at 49 deg, 10 km", printed, high, absolute=1e-6, unit="m/s^2", tolerance="rounding"
            ),
            against(
                "(1.23): what - 2 f sin^2 of the latitude makes at 10 km",
                4.0 * f * np.sin(49.0 * DEG) ** 2 / a * 1e4 * zero,
                high - printed,
                relative=1e-6,
                unit="m/s^2",
                tolerance="rounding",
                reference="corrected",
            ),
            claimed(
                "J2 and centrifugal term against (1.23) mended, 48.84 deg",
                "4e-5",
                abs(from_j2 - float(gravity_somigliana(ESIEE[0], ESIEE[2]))),
                high=4.5e-5,
                unit="m/s^2",
                reference="corrected",
                tolerance="printed digits",
            ),
            shown("gravity at 48.84 deg", here, unit="m/s^2"),
        ),
        "(1.21) has the identity where the centrifugal term has no axial part, (1.23) lacks - 2 f sin^2 of the "
        "latitude, and (1.24) is the formula of 1980.",
    )


ITEMS: tuple[Item, ...] = (
    Item("table-1.1", "constants of WGS 84", "exact", _constants),
    Item("text-1.3", "rotations, and what approximations cost", "exact", _attitude),
    Item("text-1.4.4", "gravity", "exact", _gravity),
    Item("text-1.5", "settings of the board", "exact", _board),
)
