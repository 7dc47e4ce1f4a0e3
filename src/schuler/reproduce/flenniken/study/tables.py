"""Numbers of Flenniken's chapters 3, 4, 5 and 7, and those of independent computations of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from schuler.plotting.table import ResultTable
from schuler.reproduce.flenniken.study.rocket.errors import RocketErrors, all_angles
from schuler.reproduce.flenniken.study.rocket.sensitivity import influence
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketTrajectory, rocket_trajectory
from schuler.units import DEG_PER_HR, G0, PPM, UG

if TYPE_CHECKING:
    from schuler.growth.integrals import Start
    from schuler.reproduce.flenniken.study.rocket.sensitivity import Variant


#: 1-sigma by (grade, time, start): heading [deg], velocity [m/s], position [m], with gravity velocity and position.
EXACT: dict[tuple[str, float, Start], tuple[float, ...]] = {
    ("consumer", 30.0, "stationary"): (2.964, 0.6915, 10.56, 7.675, 77.51),
    ("consumer", 30.0, "zero"): (0.7950, 0.3257, 4.385, 1.735, 16.45),
    ("consumer", 60.0, "stationary"): (5.819, 1.304, 40.03, 30.13, 607.0),
    ("consumer", 60.0, "zero"): (2.072, 0.7569, 19.38, 8.597, 152.1),
    ("automotive", 60.0, "stationary"): (2.929, 0.6465, 19.80, 15.19, 307.0),
    ("automotive", 60.0, "zero"): (1.089, 0.3688, 9.235, 4.736, 88.93),
    ("tactical-printed", 60.0, "stationary"): (0.0142, 0.2552, 7.908, 0.2683, 8.133),
    ("tactical-printed", 60.0, "zero"): (0.0135, 0.1748, 4.513, 0.1918, 4.869),
    ("tactical", 60.0, "stationary"): (0.0142, 0.02552, 0.7908, 0.0867, 2.058),
    ("tactical", 60.0, "zero"): (0.0135, 0.01748, 0.4513, 0.0810, 1.882),
    ("tactical", 300.0, "stationary"): (0.0354, 0.0837, 13.78, 1.031, 117.3),
}
#: North position the source reads off figures 3.1 and 3.4. [m]
POSITION = {("tactical", 20.0): 0.05, ("tactical", 30.0): 0.10, ("consumer", 20.0): 1.0, ("consumer", 30.0): 4.0}
#: Monte Carlo of 6000 runs of six degrees of freedom at 60 s, stationary: horizontal velocity and position with
#: gravity, vertical velocity, and horizontal velocity and position without. [m/s], [m]
SIX_DEGREES = {"consumer": (29.95, 604.0, 2.42, 1.31, 40.4), "tactical": (0.08725, 2.075, 0.0259, None, None)}


#: Times after the start of the outage at which errors are compared. [s]
AFTER_S = (30.0, 60.0, 120.0, 240.0)
#: RMS heading error [deg] after these times by (truth, filter), from an independent Monte Carlo of 4000 runs.
OUTAGE_DEG = {
    ("wandering", "constant, asleep"): (2.05, 4.04, 8.40, 18.2),
    ("wandering", "constant, walking"): (1.09, 2.55, 6.36, 15.9),
    ("wandering", "Gauss-Markov"): (1.07, 2.47, 5.93, 13.8),
    ("wandering", "both"): (1.09, 2.52, 6.23, 15.4),
    ("constant", "constant, asleep"): (0.31, 0.46, 0.72, 1.19),
    ("constant", "constant, walking"): (0.58, 1.04, 1.95, 3.76),
    ("constant", "Gauss-Markov"): (2.41, 7.33, 24.1, 79.7),
    ("constant", "both"): (0.56, 0.98, 1.75, 3.13),
    ("constant and wandering", "constant, asleep"): (2.04, 4.06, 8.5, 18.6),
    ("constant and wandering", "constant, walking"): (1.14, 2.63, 6.4, 15.9),
    ("constant and wandering", "Gauss-Markov"): (2.63, 7.74, 24.8, 80.9),
    ("constant and wandering", "both"): (1.13, 2.61, 6.3, 15.6),
}
#: 1-sigma of the filters themselves 240 s into the outage. [deg]
SIGMA_240_DEG = {"constant, asleep": 1.2, "constant, walking": 18.5, "Gauss-Markov": 13.9, "both": 15.6}
#: Steady bound of the Gauss-Markov filter with fixes of 0.2 deg each second: source's range, then after and before an
#: update as checked. [deg]
BOUND_DEG = {"consumer": ((0.1, 0.2), 0.112, 0.135), "tactical": ((0.015, 0.02), 0.0197, None)}


_URAD = 1e-6
_Vector = tuple[float, float, float]
#: Parameter, its size and its unit in SI to (as in the thesis, strapdown): north, up, east at impact. [m]
SENSITIVITIES: dict[tuple[str, float, str, float], tuple[_Vector, _Vector]] = {
    ("gyro_misalignment_y", 100.0, "urad", _URAD): ((0.0, 0.0, -23.1), (0.0, 0.0, 0.0)),
    ("gyro_non_orthogonality_y", 100.0, "urad", _URAD): ((0.0, 0.0, 23.1), (0.0, 0.0, 0.0)),
    ("accel_misalignment_y", 100.0, "urad", _URAD): ((0.0, 0.0, 21.95), (0.0, 0.0, 14.81)),
    ("accel_non_orthogonality_y", 100.0, "urad", _URAD): ((0.0, 0.0, 21.95), (0.0, 0.0, 14.81)),
    ("accel_misalignment_z", 100.0, "urad", _URAD): ((0.0, -8.50, 0.0), (12.14, -8.50, 0.0)),
    ("accel_non_orthogonality_z", 100.0, "urad", _URAD): ((-3.69, 7.56, 0.0), (-12.14, 8.50, 0.0)),
    ("accel_misalignment_x", 100.0, "urad", _URAD): ((0.0, 0.0, 2.83), (0.0, 0.0, 0.0)),
    ("accel_non_orthogonality_x", 100.0, "urad", _URAD): ((0.0, 0.0, -2.83), (0.0, 0.0, 0.0)),
    ("gyro_scale_factor_z", 100.0, "ppm", PPM): ((-23.1, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ("accel_scale_factor_x", 100.0, "ppm", PPM): ((8.03, 1.85, 0.0), (8.50, 12.14, 0.0)),
    ("accel_asymmetry_x", 100.0, "ppm", PPM): ((8.59, 2.26, 0.0), (8.50, 12.14, 0.0)),
    ("accel_quadratic_x", 10.0, "ppm/g", PPM / G0): ((5.55, 6.96, 0.0), (6.80, 9.71, 0.0)),
    ("accel_scale_factor_y", 100.0, "ppm", PPM): ((0.47, -1.85, 0.0), (0.0, 0.0, 0.0)),
    ("accel_asymmetry_y", 100.0, "ppm", PPM): ((-0.47, 1.85, 0.0), (0.0, 0.0, 0.0)),
    ("accel_bias_x", 100.0, "ug", UG): ((2.83, -7.14, 0.0), (2.83, -7.14, 0.0)),
    ("accel_bias_y", 100.0, "ug", UG): ((7.14, 2.83, 0.0), (7.14, 2.83, 0.0)),
    ("accel_bias_z", 100.0, "ug", UG): ((0.0, 0.0, 12.14), (0.0, 0.0, 12.14)),
    ("gyro_bias_x", 1.0, "deg/h", DEG_PER_HR): ((0.0, 0.0, -27.2), (0.0, 0.0, 0.0)),
    ("gyro_bias_y", 1.0, "deg/h", DEG_PER_HR): ((0.0, 0.0, -2.54), (0.0, 0.0, -4.42)),
    ("gyro_bias_z", 1.0, "deg/h", DEG_PER_HR): ((27.2, 2.54, 0.0), (-3.62, 2.54, 0.0)),
}


def sensitivity_table(trajectory: RocketTrajectory | None = None) -> ResultTable:
    """Error at impact by each parameter alone, both ways of navigating, beside an independent simulation."""
    T = trajectory or rocket_trajectory()
    rows: list[tuple[Any, ...]] = []
    variants: tuple[Variant, ...] = ("thesis", "strapdown")
    weights = [influence(T, variant) for variant in variants]
    for (name, size, unit, scale), reference in SENSITIVITIES.items():
        for w, published in zip(weights, reference, strict=True):
            ours = w.effect(RocketErrors.of({name: size * scale}))
            rows.append((name, f"{size:g} {unit}", w.variant, *published, *(round(float(x), 9) + 0.0 for x in ours)))
    columns = ("parameter", "size", "variant", "north_check_m", "up_check_m", "east_check_m")
    return ResultTable(
        "Position error at impact, one parameter at a time", (*columns, "north_m", "up_m", "east_m"), tuple(rows)
    )


def with_angles(errors: RocketErrors, angle: float, *, printed: bool = False) -> RocketErrors:
    """Errors with all twelve angles of the triads alike, beside what they hold. [rad]"""
    angles = {k: v for k, v in all_angles(angle).parameters().items() if v != 0.0 and "_tau_" not in k}
    values = errors.parameters() | angles
    return RocketErrors.of(values, start=errors.gyro.start, printed=printed)
