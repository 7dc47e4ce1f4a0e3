"""Chapter 3: growth of errors over a revolution as formulas, and the simulations of figures 3.1 to 3.13."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.du.bands import period
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure
    from schuler.reproduce.du.study.analytic_tables import Scheme
    from schuler.reproduce.du.study.fixed_errors import Case, Chapter3

_RATE, _TIME_S, _LAT = 10.0 * DEG, 300.0, 45.0 * DEG
_TURN_S = 36.0
_EARTH_RADIUS = 6.37e6
_SAME = 0.1  # "almost the same"
_HALF = 0.5  # "significantly reduced"
_CURVES = (
    "The thesis prints curves only, so numbers are an independent check's, of the corrected equations without noise; "
    "the latitude and the length are its choice."
)
_GRAVITY = (
    " Its gravity does not fall with height: numbers of the vertical channel are corrected for that where the height "
    "grows steadily, and else shown only."
)


def _growth(scheme: Scheme) -> Outcome:
    """Formulas of the mean growth against integrals of the errors over three revolutions."""
    from schuler.reproduce.du.study import analytic_tables as tables
    from schuler.rotary import schemes
    from schuler.rotary.du_axes import du_axis, swap_vector
    from schuler.rotary.modulated_errors import open_loop_errors
    from schuler.rotary.rotating_imu import RotatingMotion
    from schuler.simulation.motion import StaticMotion

    # unequal errors, so that no difference of two cancels
    K = 1e-3 * np.array([[1.0, -0.7, 0.4], [0.9, -1.3, 0.6], [-0.5, 0.8, 1.7]])
    errors = tables.DuErrors(d=np.array([30.0, -20.0, 10.0]) * DEG_PER_HR, b=np.array([0.2, -0.1, 0.15]), K=K, Ka=K.T)
    schedule = schemes.fixed() if scheme == "conventional" else schemes.continuous(du_axis(scheme), _RATE)
    rest = RotatingMotion(StaticMotion(np.array([_LAT, 0.0, 0.0]), np.zeros(3), 3.0 * _TURN_S), schedule)
    cells = []
    for source in tables.SOURCES:
        run = open_loop_errors(rest, errors.only(source).imu_errors(), np.array([0.0, 3.0 * _TURN_S]))
        formula = tables.cycle_rate(source, scheme, errors, rate=_RATE, lat=_LAT)
        gyro = source.startswith("gyro")
        seen = swap_vector((run.attitude if gyro else run.velocity)[-1]) / (3.0 * _TURN_S)
        # the integral of the accelerometers' errors has gravity to 1e-9 of another formula
        scale = float(np.abs(seen).max()) if np.abs(seen).max() > 1e-12 else 1.0
        cells.append(
            claimed(f"{source}: largest departure of the formulas from an integral", "formulas E, N, U",
                 float(np.abs(seen - formula).max()) / scale, high=1e-6, tolerance="rounding")
        )  # fmt: skip
    if scheme == "Z":
        e = tables.DuErrors(K=np.diag([3e-3] * 3))
        rate = tables.cycle_rate("gyro scale factor", "Z", e, rate=_RATE, lat=0.0)[2] / DEG_PER_HR
        cells.append(against("3000 ppm at 10 deg/s: rate of azimuth", 108.0, rate, absolute=0.5, unit="deg/h",
                             tolerance="printed digits", reference="corrected", source="Kz omega"))  # fmt: skip
    text = "" if scheme == "conventional" else "Sums over whole revolutions agree as printed. "
    return Outcome(tuple(cells), text + _SLIPS[scheme])


_SLIPS: dict[str, str] = {
    "conventional": "The text before (3.1) and (3.2) has attitude and velocity interchanged, and (3.8) an error of the "
    "force in place of the force.",
    "X": "(3.12), (3.13) print the rotation matrix transposed.",
    "Y": "(3.23) lacks the factor T.",
    "Z": "",
}


def _eliminated(effort: Effort) -> Outcome:
    from schuler import earth
    from schuler.reproduce.du.study import analytic_tables as tables

    g, d = float(earth.gravity_somigliana(_LAT)), 30.0 * DEG_PER_HR
    installation = np.zeros((3, 3))
    installation[0, 2] = 0.1 * DEG

    def left(errors: tables.DuErrors, **options: bool) -> tuple[float, float]:
        attitude, velocity, _ = tables.secular_errors("Z", errors, 10.0 * _TURN_S, rate=_RATE, lat=_LAT, **options)
        return float(np.abs(attitude[:2]).max()), float(np.hypot(*velocity[:2])) * _TIME_S / (10.0 * _TURN_S)

    bias, coupling = tables.DuErrors(d=np.array([d, 0.0, 0.0])), tables.DuErrors(K=installation)
    still = 0.5 * g * d * _TIME_S**2
    tilt, velocity = left(bias)
    cells = (
        claimed("gyroscope bias across the axis, 30 deg/h: tilt after whole revolutions, over that of none",
             "eliminated after a cycle", tilt / (d * 10.0 * _TURN_S), high=1e-9, tolerance="rounding"),
        claimed("the same: velocity after 300 s, over that of none", "eliminated after a cycle", velocity / still,
             high=1e-9, tolerance="rounding"),
        against("the same: velocity after 300 s", 2.45, velocity, absolute=0.005, unit="m/s",
                tolerance="printed digits", reference="corrected", source="0; corrected g d / omega t"),
        against("installation error of 0.1 deg: velocity after 300 s", 5.13, left(coupling)[1], absolute=0.01,
                unit="m/s", tolerance="printed digits", reference="corrected", source="oscillates; corrected g K t"),
        claimed("rotation there and back: velocity by the bias", "not in the thesis", left(bias, reciprocating=True)[1],
             high=1e-9, unit="m/s", tolerance="rounding", reference="corrected"),
        against("rotation there and back: velocity by the installation error", 5.13,
                left(coupling, reciprocating=True)[1], absolute=0.01, unit="m/s", tolerance="printed digits",
                reference="corrected", source="not in the thesis"),
    )  # fmt: skip
    return Outcome(
        cells,
        "Eliminated after a whole revolution is true of the attitude only. The tilt swings about a mean that the phase "
        "of the start fixes, and gravity integrates it: velocity goes on growing by g (d / omega + K) a second.",
    )


_NAMES = {
    **{f"attitude_{c}_deg": (f"attitude {c.upper()}", "deg") for c in "enu"},
    **{f"velocity_{c}_m_s": (f"velocity {c.upper()}", "m/s") for c in "enu"},
    "horizontal_m": ("horizontal position", "m"),
    "up_m": ("height", "m"),
}


@cache
def _chapter3(case: Case) -> Chapter3:
    from schuler.reproduce.du.study.fixed_errors import chapter3

    return chapter3(case)


def _anchors(case: Case, axes: Sequence[str | None]) -> list[Cell]:
    """Ours at the end of the run beside the check's numbers, 2 % or a unit of their last digit."""
    from schuler import earth
    from schuler.reproduce.du.study.fixed_errors import allowance, anchors

    k = float(np.sqrt(2.0 * earth.gravity_somigliana(_LAT) / _EARTH_RADIUS)) * _TIME_S
    vertical = {"velocity_u_m_s": np.sinh(k) / k, "up_m": 2.0 * (np.cosh(k) - 1.0) / k**2}
    simulation = _chapter3(case)
    cells = []
    for axis in axes:
        ours = simulation.values(axis)  # type: ignore[arg-type]
        for name, printed in anchors(case, axis).items():  # type: ignore[arg-type]
            text, unit = _NAMES[name]
            text = f"{case}, {'conventional' if axis is None else f'about {axis}'}: {text}"
            if name not in vertical:
                cells.append(
                    against(text, printed, ours[name], absolute=allowance(case, name, printed), unit=unit,
                            tolerance="band", reference="corrected", source=f"check: {printed:g}")
                )  # fmt: skip
            elif axis in (None, "Z"):
                expected = printed * float(vertical[name])
                cells.append(
                    against(text, expected, ours[name], absolute=allowance(case, name, expected), unit=unit,
                            tolerance="band", reference="corrected",
                            source=f"check: {printed:g} without the gradient of gravity")
                )  # fmt: skip
            else:
                cells.append(
                    shown(
                        text,
                        ours[name],
                        unit=unit,
                        printed=f"check: {printed:g}",
                        why="depends on the gradient of gravity, which the check leaves out",
                    )
                )
    return cells


def _ratio(name: str, claim: str, case: Case, axis: str, key: str, *, same: bool) -> Cell:
    """Size of an error about an axis of rotation over that of the conventional IMU."""
    simulation = _chapter3(case)
    ratio = abs(simulation.values(axis)[key] / simulation.values(None)[key])  # type: ignore[arg-type]
    if same:
        return claimed(name, claim, ratio, low=1.0 - _SAME, high=1.0 + _SAME)
    return claimed(name, claim, ratio, high=_HALF)


def _figures(case: Case, axes: Sequence[str | None], effort: Effort, *, reference: bool = False) -> Figure:
    from schuler.reproduce.du.study.figures import chapter3_figure
    from schuler.reproduce.du.study.fixed_errors import chapter3

    noisy = chapter3(case, axes=axes, noise=True, seed=effort.seed)  # type: ignore[arg-type]
    bias = chapter3("bias", axes=[None], noise=True, seed=effort.seed) if reference else None
    return chapter3_figure(noisy, bias=bias)


_COMPONENTS = {"attitude_e_deg": "pitch", "attitude_n_deg": "roll", "attitude_u_deg": "azimuth",
               "velocity_u_m_s": "vertical velocity", "horizontal_m": "horizontal position"}  # fmt: skip


def _bias(axis: str, reduced: Sequence[str], kept: Sequence[str], effort: Effort) -> Outcome:
    cells = [_ratio(f"{_COMPONENTS[k]}, rotating over conventional", "much smaller", "bias", axis, k, same=False)
             for k in reduced]  # fmt: skip
    cells += [_ratio(f"{_COMPONENTS[k]}, rotating over conventional", "almost the same", "bias", axis, k, same=True)
              for k in kept]  # fmt: skip
    cells += _anchors("bias", (None, axis)) + _anchors("gyro bias", (None, axis))
    return Outcome(tuple(cells), _CURVES + _GRAVITY, (lambda: _figures("bias", (None, axis), effort),))


def _scale(axis: str, angle: str, effort: Effort) -> Outcome:
    from schuler.units import PPM

    simulation = _chapter3("scale factor")
    ours = simulation.values(axis)  # type: ignore[arg-type]
    ramp = 3000.0 * PPM * _RATE * _TIME_S / DEG
    cells = [
        against(f"{_COMPONENTS[angle]} after 300 s", ramp, ours[angle], relative=0.03, unit="deg", tolerance="band",
                source="accumulates, K omega t"),
    ]  # fmt: skip
    if axis == "Z":
        for name in ("attitude_e_deg", "attitude_n_deg", "horizontal_m"):
            other = {"attitude_e_deg": "X", "attitude_n_deg": "Y", "horizontal_m": "X"}[name]
            ratio = abs(ours[name] / simulation.values(other)[name])  # type: ignore[arg-type]
            cells.append(claimed(f"{_COMPONENTS[name]}: about Z over about {other}", "much smaller", ratio, high=0.1))
    else:
        key = {"X": "velocity_n_m_s", "Y": "velocity_e_m_s"}[axis]
        ratio = abs(ours[key] / _chapter3("bias").values(None)[key.replace("_n_", "_e_")])
        cells.append(claimed(f"velocity {key[9]}, over that of the biases without rotation", "large", ratio, low=1.0))
    cells += _anchors("scale factor", (None, axis))
    return Outcome(tuple(cells), _CURVES, (lambda: _figures("scale factor", (None, axis), effort, reference=True),))


def _installation(axis: str, swinging: Sequence[int], effort: Effort) -> Outcome:
    run = _chapter3("installation").runs[axis]  # type: ignore[index]
    names = ("pitch", "roll", "azimuth")
    cells = [period(f"{names[k]}: period", _TURN_S, run.t, run.attitude[:, k]) for k in swinging]
    quiet = next(k for k in range(3) if k not in swinging)
    ratio = np.abs(run.attitude).max(axis=0)
    cells.append(
        claimed(f"{names[quiet]}: largest, over the others", "only the other two oscillate",
             float(ratio[quiet] / ratio[list(swinging)].min()), high=0.1)
    )  # fmt: skip
    if axis == "Z":
        tilt = 0.1 * (1.0 + float(np.sqrt(2.0)))
        cells.append(against("largest tilt", tilt, float(ratio[0] / DEG), relative=0.005, unit="deg", tolerance="band",
                             reference="corrected", source="K (1 + sqrt 2)"))  # fmt: skip
    cells += _anchors("installation", (None, axis))
    return Outcome(
        tuple(cells),
        _CURVES + " The thesis does not say which of the six installation errors are meant, nor their signs: all "
        "are 0.1 deg here.",
        (lambda: _figures("installation", (None, axis), effort),),
    )


ITEMS = (
    Item("text-3.1", "Growth of errors of an IMU that does not turn", "exact", lambda e: _growth("conventional")),
    Item("text-3.2.1", "Growth over a revolution about X", "exact", lambda e: _growth("X")),
    Item("text-3.2.2", "Growth over a revolution about Y", "exact", lambda e: _growth("Y")),
    Item("text-3.2.3", "Growth over a revolution about Z", "exact", lambda e: _growth("Z")),
    Item("text-3.3", "What a whole revolution is said to eliminate", "exact", _eliminated),
    Item("fig-3.1", "Biases, rotation about X: velocity and attitude", "exact",
         lambda e: _bias("X", ("attitude_n_deg", "attitude_u_deg", "velocity_u_m_s"), ("attitude_e_deg",), e),
         ("fig-3.2",)),
    Item("fig-3.3", "Biases, rotation about Y: velocity and attitude", "exact",
         lambda e: _bias("Y", ("attitude_e_deg", "attitude_u_deg", "velocity_u_m_s"), ("attitude_n_deg",), e),
         ("fig-3.4",)),
    Item("fig-3.5", "Biases, rotation about Z: velocity and attitude", "exact",
         lambda e: _bias("Z", ("attitude_e_deg", "attitude_n_deg", "horizontal_m"),
                         ("attitude_u_deg", "velocity_u_m_s"), e), ("fig-3.6",)),
    Item("fig-3.7", "Scale factors of the gyroscopes, rotation about X", "exact",
         lambda e: _scale("X", "attitude_e_deg", e)),
    Item("fig-3.8", "Scale factors of the gyroscopes, rotation about Y", "exact",
         lambda e: _scale("Y", "attitude_n_deg", e)),
    Item("fig-3.9", "Scale factors of the gyroscopes, rotation about Z", "exact",
         lambda e: _scale("Z", "attitude_u_deg", e), ("fig-3.10",)),
    Item("fig-3.11", "Installation errors of the gyroscopes, rotation about X", "exact",
         lambda e: _installation("X", (1, 2), e)),
    Item("fig-3.12", "Installation errors of the gyroscopes, rotation about Y", "exact",
         lambda e: _installation("Y", (0, 2), e)),
    Item("fig-3.13", "Installation errors of the gyroscopes, rotation about Z", "exact",
         lambda e: _installation("Z", (0, 1), e)),
)  # fmt: skip
