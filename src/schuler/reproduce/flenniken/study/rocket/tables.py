"""Numbers of Flenniken's chapter 7, and of the digest's own check, which ours stand beside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.plotting.table import ResultTable
from schuler.reproduce.flenniken.study.rocket.budget import impact_budget
from schuler.reproduce.flenniken.study.rocket.errors import RocketErrors, all_angles
from schuler.reproduce.flenniken.study.rocket.influence import influence
from schuler.reproduce.flenniken.study.rocket.scatter import impact_scatter
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketTrajectory, rocket_trajectory
from schuler.units import DEG_PER_HR, G0, PPM, UG

if TYPE_CHECKING:
    from schuler.reproduce.flenniken.study.rocket.influence import Variant

_URAD = 1e-6
#: Trajectory: name, unit, what the source prints, the digest's T1-R.
FLIGHT: tuple[tuple[str, str, float, str, float | None], ...] = (
    ("burnout_north", "m/s", 1.0, "about 550", 562.5),
    ("burnout_up", "m/s", 1.0, "about 550", 681.0),
    ("apex_height", "km", 1e3, "24", 27.9),
    ("apex_time", "s", 1.0, "40", 82.0),
    ("apex_range", "km", 1e3, "-", 42.6),
    ("impact_time", "s", 1.0, "165", 157.3),
    ("impact_range", "km", 1e3, "84 and 86", 84.97),
    ("impact_up", "m/s", 1.0, "-", -739.0),
    ("impact_speed", "m/s", 1.0, "about 600", 929.0),
)
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


def flight_table(trajectory: RocketTrajectory | None = None) -> ResultTable:
    """The trajectory beside what the source and the digest print."""
    found = (trajectory or rocket_trajectory()).figures()
    rows = tuple(
        (f"{name} [{unit}]", printed, known, found[name] / scale) for name, unit, scale, printed, known in FLIGHT
    )
    return ResultTable(
        "Trajectory I",
        ("figure", "source", "digest", "ours"),
        rows,
        (
            "no flight has all of the source's numbers: 24 km of fall alone give 686 m/s, and an apex at 40 s leaves "
            "a fall of 125 s",
        ),
    )


def sensitivity_table(trajectory: RocketTrajectory | None = None) -> ResultTable:
    """Error at impact by each parameter alone, both ways of navigating, beside the digest's."""
    T = trajectory or rocket_trajectory()
    rows: list[tuple[Any, ...]] = []
    variants: tuple[Variant, ...] = ("thesis", "strapdown")
    weights = [influence(T, variant) for variant in variants]
    for (name, size, unit, scale), known in SENSITIVITIES.items():
        for w, published in zip(weights, known, strict=True):
            ours = w.effect(RocketErrors.of({name: size * scale}))
            rows.append((name, f"{size:g} {unit}", w.variant, *published, *(round(float(x), 9) + 0.0 for x in ours)))
    columns = ("parameter", "size", "variant", "north_digest_m", "up_digest_m", "east_digest_m")
    return ResultTable(
        "Position error at impact, one parameter at a time", (*columns, "north_m", "up_m", "east_m"), tuple(rows)
    )


def scatter_table(
    *, runs: int = 200, seed: int = 0, rate_hz: float = 20.0, angle: float = 500.0 * _URAD
) -> ResultTable:
    """Scatter of the simple and the advanced model beside the source's, 200 runs as there."""
    from schuler.sensors.catalogue import spec

    T = rocket_trajectory(rate_hz=rate_hz)
    simple = RocketErrors.simple(spec("flenniken-tactical-printed"))
    cases: list[tuple[str, RocketErrors, Variant, tuple[float, ...]]] = [
        ("simple", simple, "thesis", (0.0, 0.0, 50.0, 50.0)),
        ("angles, (6.7) as printed", with_angles(simple, angle, printed=True), "thesis", (-86.0, 450.0, 50.0, 50.0)),
        ("angles, (6.7) corrected", with_angles(simple, angle), "thesis", (-86.0, 450.0, 50.0, 50.0)),
        ("simple", simple, "strapdown", (0.0, 0.0, 50.0, 50.0)),
        ("angles", with_angles(simple, angle), "strapdown", (-86.0, 450.0, 50.0, 50.0)),
    ]
    rows: list[tuple[Any, ...]] = []
    for name, errors, variant, printed in cases:
        s = impact_scatter(T, errors, runs=runs, seed=seed, variant=variant, name=name)
        ours = np.concatenate((s.mean, s.sigma)).tolist()
        rows.append((name, variant, *(x for pair in zip(printed, ours, strict=True) for x in pair), s.ellipse.cep))
    shown = ("mean_downrange", "mean_crossrange", "sigma_downrange", "sigma_crossrange")
    columns = tuple(f"{name}_{who}m" for name in shown for who in ("source_", ""))
    return ResultTable(
        f"Impact scatter, {runs} runs", ("model", "variant", *columns, "cep_m"), tuple(rows),
        (
            f"tactical grade with accelerometers as printed, stationary biases; all angles {angle / _URAD:g} urad, an "
            "inference, as the source does not print its values",
        ),
    )  # fmt: skip


def ranking_table(angle: float = 500.0 * _URAD) -> ResultTable:
    """Ranking of the twelve angles, equal in size, by both ways of navigating."""
    T = rocket_trajectory()
    variants: tuple[Variant, ...] = ("thesis", "strapdown")
    found = [impact_budget(influence(T, v), all_angles(angle)) for v in variants]
    rows = tuple(
        (i + 1, *(x for b in found for x in (b.names[i], round(float(b.contribution[i]), 9))))
        for i in range(len(found[0].names))
    )
    return ResultTable(
        f"Angles of {angle / _URAD:g} urad by their effect at impact",
        ("rank", "thesis", "thesis_m", "strapdown", "strapdown_m"),
        rows,
        ("the source ranks gyroscope misalignment about y first, accelerometer misalignment about y second",),
    )


def with_angles(errors: RocketErrors, angle: float, *, printed: bool = False) -> RocketErrors:
    """Errors with all twelve angles of the triads alike, beside what they hold. [rad]"""
    angles = {k: v for k, v in all_angles(angle).parameters().items() if v != 0.0 and "_tau_" not in k}
    values = errors.parameters() | angles
    return RocketErrors.of(values, start=errors.gyro.start, printed=printed)
