"""Formulas of a scenario at rest, for those who want letters beside numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.observability import symbolic
from schuler.observability.scenario import ObservabilityScenario
from schuler.observability.symbolic_model import sympy_module
from schuler.rotary.sections import axis_of

_REFUSED = (
    "formulas are for a vehicle at rest whose IMU is fixed or turns at a constant rate about an axis of the body: "
)


def scenario_model(scenario: ObservabilityScenario, *, biases: str = "navigation") -> symbolic.SymbolicModel:
    """Symbolic model of a scenario.

    Parameters
    ----------
    scenario : ObservabilityScenario
        Static; its IMU fixed, or turning at a constant rate about x, y or z.
    biases : {"navigation", "imu"}

    Notes
    -----
    Angles that are zero are zero; any other stands for a general one and is replaced by one of a Pythagorean triangle,
    so that everything stays exact.

    Raises
    ------
    InputError
        For any other scenario.
    """
    axis = _axis(scenario)
    sp: Any = sympy_module()
    general = (sp.Rational(3, 4), sp.Rational(5, 12), sp.Rational(8, 15))
    roll, pitch, azimuth = (
        sp.atan(ratio) if angle else 0 for angle, ratio in zip(scenario.motion.rpy_deg, general, strict=True)
    )
    model: symbolic.SymbolicModel = symbolic.rotary_model(
        axis, roll=roll, pitch=pitch, azimuth=azimuth, earth=scenario.motion.earth_rotation,
        biases="imu" if biases == "imu" else "navigation", axes=scenario.axes,
    )  # fmt: skip
    return model


def scenario_formulas(scenario: ObservabilityScenario) -> tuple[str, ...]:
    """Rank and combinations of a scenario as text."""
    model = scenario_model(scenario)
    texts = [str(c) for c in symbolic.observable_combinations(model)]
    return (f"rank {len(texts)} of {len(model.names)}", *texts)


def _axis(scenario: ObservabilityScenario) -> Any:
    """Letter of the platform's axis in the axes of the model, None if the IMU is fixed."""
    if scenario.motion.type != "static":
        raise InputError(f"{_REFUSED}the motion is of type {scenario.motion.type}")
    if scenario.rotary is None or scenario.rotary.schedule.type == "fixed":
        return None
    s = scenario.rotary.schedule
    if s.type != "continuous" or s.tilt_deg or any(s.mount_rpy_deg) or s.start_s or s.acceleration_deg_s2:
        raise InputError(f"{_REFUSED}the schedule is of type {s.type}, or tilted, mounted askew, or starts later")
    u = np.abs(axis_of(s.axis))
    if np.sum(u > 1e-12) != 1:
        raise InputError(f"{_REFUSED}its axis is {s.axis}")
    letters = "xyz" if scenario.axes == "ned" else "yxz"
    return letters[int(np.argmax(u))]
