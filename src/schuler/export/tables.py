"""Sizes, numbers and tables of one filter as C: the two generated files of an export."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from schuler.export.design import FilterDesign
from schuler.files import package_version
from schuler.filtering.limits import PLACES


def configuration_header(design: FilterDesign, pending: int) -> str:
    """``schuler_config.h``: sizes of the filter and numbers of its aids.

    Parameters
    ----------
    design : FilterDesign
    pending : int
        Measurements that may fall between two samples.
    """
    model, settings, layout = design.state.model, design.state.settings, design.layout
    at = dict(zip(PLACES, (int(i) for i in model.places), strict=True))
    names = " ".join(layout.blocks)
    fixes, antenna = design.lever_antenna is not None, design.lever_antenna or (0.0, 0.0, 0.0)
    entries: list[tuple[str, str, str]] = [
        ("N", str(layout.size), f"states: {names}"),
        ("N_SENSOR", str(layout.n_sensor), "sensor errors among them, behind the nine navigation errors"),
        ("N_ON_ATTITUDE", str(len(model.on_attitude)), "those that act on the attitude"),
        ("RESPONSE", _flag(model.response), "scale factors, misalignments or g-sensitivities are estimated"),
        ("CROSS", _flag(model.cross), "g-sensitivities are"),
        (
            "FREE_AXES",
            _flag(model.free_axes),
            "cross-couplings of both triads are: nothing says what the body axes are",
        ),
        *((f"AT_{name.upper()}", str(at[name]), "first state of the block, -1 if not estimated") for name in _BLOCKS),
        ("EVERY", str(settings.every), f"samples to a propagation of the covariance, at {1 / design.interval_s:g} Hz"),
        ("FLUSH_ANGLE", _number(settings.flush_angle), "turned angle that forces one [rad]"),
        ("OMEGA_IE", _number(model.omega), "[rad/s]"),
        ("MAX_GAP_S", _number(design.max_gap_s), "a longer step of the IMU ends the run"),
        ("GAP_S", _number(settings.gap_s), "a longer step is a pause, over which rates are unknown by"),
        ("GAP_GYRO", _number(settings.gap_gyro), "[rad/s]"),
        ("GAP_ACCEL", _number(settings.gap_accel), "[m/s^2]"),
        ("LOCKOUT", str(settings.lockout), "rejections of single numbers, less acceptances, before one is taken"),
        ("HOLD_S", _number(settings.hold_s), "longest time for which fixes that jump and stay are held off"),
        ("ADAPTIVE", _flag(settings.adaptive), "noise grows where innovations are larger than it"),
        ("PENDING", str(pending), "measurements that may wait for their sample"),
        ("HAS_POSITION", _flag(fixes), ""),
        ("HAS_VELOCITY", _flag(fixes and design.uses_velocity), ""),
        ("LEVER_ANTENNA", _triple(antenna), "from the IMU, body axes [m]"),
        ("GATE_FIX", _number(design.gate_fix), "largest normalised innovation squared that is accepted"),
        ("HAS_ZUPT", _flag(design.zupt_sigma is not None), ""),
        ("ZUPT_SIGMA", _number(design.zupt_sigma or 0.0), "what may still move at rest [m/s]"),
        ("GATE_ZUPT", _number(design.gate_zupt), ""),
        ("HAS_NON_HOLONOMIC", _flag(design.lever_axle is not None), ""),
        ("LEVER_AXLE", _triple(design.lever_axle or (0.0, 0.0, 0.0)), "to the point that does not slip [m]"),
        ("SIGMA_LATERAL", _number(design.lateral_sigma), "[m/s]"),
        ("SIGMA_VERTICAL", _number(design.vertical_sigma), "[m/s]"),
        ("MIN_SPEED", _number(design.min_speed), "slower than this nothing rolls [m/s]"),
        ("GATE_NON_HOLONOMIC", _number(design.gate_non_holonomic), ""),
        ("HAS_ODOMETER", _flag(design.lever_wheel is not None), ""),
        ("LEVER_WHEEL", _triple(design.lever_wheel or (0.0, 0.0, 0.0)), "to the odometer's wheel [m]"),
        ("GATE_ODOMETER", _number(design.gate_odometer), ""),
    ]
    lines = [f"#define SCH_{name} {value}" + (f" /* {text} */" if text else "") for name, value, text in entries]
    return "\n".join((_title("Sizes and numbers"), *_GUARD, *lines, "", "#endif", ""))


def configuration_tables(design: FilterDesign) -> str:
    """``schuler_config.c``: what the filter believes of each state behind the nine navigation errors.

    Parameters
    ----------
    design : FilterDesign
    """
    model, layout = design.state.model, design.layout
    rows = model.table[: layout.n_sensor]
    table = [f"{{{sensor}, {axis}, {source}}}" for sensor, axis, source in rows.tolist()] or ["{0, 0, 0}"]
    beta, q = (model.dynamics[:, i] for i in (0, 1))
    arrays = (
        ("sch_parameter sch_table[SCH_LEN_SENSOR]", table),
        ("int sch_on_attitude[SCH_LEN_SENSOR]", [str(i) for i in model.on_attitude] or ["0"]),
        ("sch_real sch_decay_rate[SCH_LEN_PARAMETERS]", _numbers(beta)),
        ("sch_real sch_driving[SCH_LEN_PARAMETERS]", _numbers(q)),
        ("sch_real sch_initial_variance[SCH_LEN_PARAMETERS]", _numbers(layout.initial_variances())),
        ("sch_real sch_psd[6]", _numbers(model.psd)),
    )
    lines = [f"const {name} = {{\n    {', '.join(values)}}};" for name, values in arrays]
    return "\n".join((_title("Tables"), '#include "schuler_internal.h"', "", *lines, ""))


_BLOCKS = ("lever", "mount", "odometer", "lever_v", "b_r", "b_v", "delay")
_GUARD = ("#ifndef SCHULER_CONFIG_H", "#define SCHULER_CONFIG_H", "", "#include <math.h>", "")


def _title(what: str) -> str:
    return f"/* {what} of one configuration, written by schuler {package_version()}. */"


def _flag(value: bool) -> str:
    return str(int(value))


def _number(value: float) -> str:
    """A number that C reads back to the last bit."""
    return "HUGE_VAL" if np.isposinf(value) else repr(float(value))


def _numbers(values: Iterable[float]) -> list[str]:
    return [_number(value) for value in values] or ["0.0"]


def _triple(values: Iterable[float]) -> str:
    return "{" + ", ".join(_numbers(values)) + "}"
