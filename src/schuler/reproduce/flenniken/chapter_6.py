"""Chapter 6: the advanced sensor model and errors of the start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, digits
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.initial_errors import InitialErrors
from schuler.sensors.triads import AccelerometerTriad, GyroTriad

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure

_ANGLE = 0.2  # large, so that sines are not angles [rad]


def parameters(effort: Effort) -> Outcome:
    """Table 6.1."""
    gyro, accel = GyroTriad().parameters(), AccelerometerTriad().parameters()
    cells = (
        digits("parameters of the gyroscopes", "21", float(len(gyro))),
        digits("parameters of the accelerometers", "27", float(len(accel))),
        digits("all", "48", float(len(gyro) + len(accel))),
        digits("of an accelerometer more than of a gyroscope: asymmetry and nonlinearity", "2",
               (len(accel) - len(gyro)) / 3.0),
    )  # fmt: skip
    return Outcome(
        cells, "The table prints variances of samples for white noise and ppm for ppm/g; ours are densities."
    )


def error_types(effort: Effort) -> Outcome:
    """Figures 6.1 to 6.3: readings of one axis, and where angles put the sensing axes."""
    size = 0.1
    u = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    x = np.array([size, 0.0, 0.0])

    def along(triad: AccelerometerTriad) -> tuple[float, float]:
        y = triad.respond(u)
        return float(y[0, 0]), float(y[1, 0])

    forms = {
        "scale factor": (along(AccelerometerTriad(scale_factor=x)), (1.0 + size, -1.0 - size)),
        "asymmetry": (along(AccelerometerTriad(asymmetry=x)), (1.0 + size, -1.0 + size)),
        "nonlinearity": (along(AccelerometerTriad(quadratic=x)), (1.0 + size, -1.0 + size)),
    }
    cells: list[Cell] = [
        against(f"{name} {size:g}: reading of {sign:+d}", expected, ours, absolute=1e-12, tolerance="rounding",
                source="(6.1)")
        for name, (computed, formula) in forms.items()
        for sign, ours, expected in zip((1, -1), computed, formula, strict=True)
    ]  # fmt: skip
    z = np.array([0.0, 0.0, _ANGLE])
    turned, leaning = GyroTriad(misalignment=z).matrix(), GyroTriad(non_orthogonality=z).matrix()
    pairs = {
        "misalignment: angle of the x axis, asin(m_xy)": (turned[0, 1], _ANGLE),
        "misalignment: angle of the y axis, asin(-m_yx)": (-turned[1, 0], _ANGLE),
        "non-orthogonality: angle of the x axis, asin(n_xy)": (leaning[0, 1], _ANGLE),
        "non-orthogonality: angle of the y axis, asin(n_yx)": (leaning[1, 0], _ANGLE),
    }
    cells += [
        against(name, angle, float(np.arcsin(ours)), absolute=1e-12, unit="rad", tolerance="rounding", source="(6.13)")
        for name, (ours, angle) in pairs.items()
    ]
    return Outcome(tuple(cells), "", (_types_figure,))


def roll_row(effort: Effort) -> Outcome:
    """Equation (6.7)."""
    y = np.array([0.0, _ANGLE, 0.0])

    def onto_roll(*, printed: bool, misaligned: bool) -> float:
        """Response to a pitch rate of one."""
        zero = np.zeros(3)
        triad = GyroTriad(
            printed=printed, misalignment=y if misaligned else zero, non_orthogonality=zero if misaligned else y
        )
        return float(triad.matrix()[0, 2])

    lean = onto_roll(printed=False, misaligned=False)
    cells = (
        against("roll by pitch rate, non-orthogonality about y", float(np.sin(_ANGLE)), lean, absolute=1e-12,
                tolerance="rounding", source="sin(Delta)"),
        against("misalignment about y over it, (6.7) as printed", 1.0, onto_roll(printed=True, misaligned=True) / lean,
                absolute=1e-12, tolerance="rounding", source="sin(Delta + delta)"),
        against("misalignment about y over it, ours", 1.0, onto_roll(printed=False, misaligned=True) / lean,
                absolute=1e-12, tolerance="rounding", source="sin(Delta + delta)"),
        against("misalignment about y over it, corrected as (6.1) has it", -1.0,
                onto_roll(printed=False, misaligned=True) / lean, absolute=1e-12, tolerance="rounding",
                reference="corrected", source="sin(Delta - delta) in (6.1)"),
    )  # fmt: skip
    reason = (
        "The roll row of (6.7) has both signs turned against (6.1) to (6.3), (6.8) and (6.9): misalignment about y "
        "then does what non-orthogonality about y does, and the triad is no longer a turned one."
    )
    return Outcome(cells, reason)


def start(effort: Effort) -> Outcome:
    """Table 6.2 and figure 6.4."""
    rho, attitude = np.array([3.0, -2.0, 1.0]), np.array([0.01, -0.02, 0.03])
    errors = InitialErrors.from_flenniken(rho, attitude)
    llh, rpy = np.array([0.6, 0.1, 100.0]), np.array([0.1, 0.2, 0.3])
    assumed_llh, assumed_rpy = errors.apply(llh, rpy)
    cells = (
        digits("errors of the start", "6", float(errors.dr_n.size + errors.drpy.size)),
        against("actual less assumed, north", 3.0, -float(errors.dr_n[0]), absolute=1e-12, unit="m",
                tolerance="rounding", source="rho_N"),
        against("actual less assumed, height", 1.0, float(llh[2] - assumed_llh[2]), absolute=1e-5, unit="m",
                tolerance="rounding", source="rho_U"),
        against("actual less assumed, pitch", -0.02, float(rpy[1] - assumed_rpy[1]), absolute=1e-12, unit="rad",
                tolerance="rounding", source="theta_err"),
        # his yaw turns to the left, ours to the right
        against("actual less assumed, yaw to the left", 0.03, -float(rpy[2] - assumed_rpy[2]), absolute=1e-12,
                unit="rad", tolerance="rounding", source="psi_err"),
        against("actual less assumed, east", -2.0, -float(errors.dr_n[1]), absolute=1e-12, unit="m",
                tolerance="rounding", source="rho_E"),
    )  # fmt: skip
    reason = (
        "Table 6.2 prints degrees for positions and metres for angles; (6.17) and (6.18) exchange east and up. Ours "
        "are estimate less truth, the thesis's the other way round."
    )
    return Outcome(cells, reason)


def _types_figure() -> Figure:
    from schuler.reproduce.flenniken.study.rocket.figures import error_types_figure

    return error_types_figure()


ITEMS = (
    Item("table-6.1", "Parameters of the advanced model", "exact", parameters),
    Item("fig-6.1", "Types of errors, and what the angles of a triad mean", "exact", error_types,
         ("fig-6.2", "fig-6.3")),
    Item("text-6.3", "The roll row of the gyroscopes, (6.7)", "exact", roll_row),
    Item("table-6.2", "Errors of the start", "exact", start, ("fig-6.4",)),
)  # fmt: skip
