"""Simulations of Du's chapter 3: fixed errors of an IMU at rest, not turned and turned about X, Y or Z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from schuler.exceptions import InputError
from schuler.plotting.table import ResultTable
from schuler.reproduce.du.study.tables import CHAPTER_3
from schuler.rotary.du_axes import DuAxis, du_axis, installation_matrix, scale_matrix, swap_vector
from schuler.rotary.free_navigation import ErrorHistory, static_run
from schuler.rotary.schemes import continuous, fixed
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import noise_model
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Case = Literal["bias", "gyro bias", "scale factor", "installation"]
#: Not turned, and turned about each of Du's axes.
SCHEMES: tuple[DuAxis | None, ...] = (None, "X", "Y", "Z")
_ENTRY = {"bias": "du-bias", "gyro bias": "du-bias", "scale factor": "du-scale", "installation": "du-installation"}
#: One unit of the anchors' last printed digit. [deg], [m/s], [m]; installation has a digit of attitude more.
_DIGIT = {"attitude": 0.01, "velocity": 0.1, "position": 1.0}
_BAND = 0.02
_RATE = 10.0 * DEG  # counter-clockwise about Du's axis [rad/s]


@dataclass(frozen=True, eq=False)
class Chapter3:
    """Errors over time of one kind of sensor error.

    Attributes
    ----------
    case : str
    rate : float
        Rate of the rotations. [rad/s]
    noise : bool
        Whether the sensors had the thesis's noise as well.
    runs : dict of str or None to ErrorHistory
        By axis of rotation, Du's; None is conventional.
    """

    case: Case
    rate: float
    noise: bool
    runs: dict[DuAxis | None, ErrorHistory]

    @property
    def random_walk(self) -> float:
        """Angle random walk of the gyroscopes with the thesis's noise. [rad/sqrt(s)]"""
        return catalogue.spec(_ENTRY[self.case]).gyro.random_walk

    def values(self, axis: DuAxis | None) -> dict[str, float]:
        """Quantities of the anchors at the end of the run: attitude [deg], velocity [m/s], position [m].

        Attitude of installation errors is the largest absolute value in the run.
        """
        if axis not in self.runs:
            raise InputError(f"axis: there is no run about {axis!r}; there are {list(self.runs)}")
        run = self.runs[axis]
        angles = np.abs(run.attitude).max(axis=0) if self.case == "installation" else run.attitude[-1]
        numbers = {f"attitude_{c}_deg": float(a / DEG) for c, a in zip("enu", angles, strict=True)}
        numbers |= {f"velocity_{c}_m_s": float(v) for c, v in zip("enu", run.velocity[-1], strict=True)}
        return numbers | {"horizontal_m": float(run.horizontal[-1]), "up_m": float(run.position[-1, 2])}

    def table(self) -> ResultTable:
        """Ours at the end beside the independent check's anchors, with what explains a difference."""
        rows: list[tuple[Any, ...]] = []
        for axis in self.runs:
            ours = self.values(axis)
            for name, printed in anchors(self.case, axis).items():
                close = agrees(self.case, name, ours[name], printed)
                rows.append((axis or "-", name, printed, ours[name], "-" if close else _why(name)))
        return ResultTable(
            f"Chapter 3, {self.case}, {self.rate / DEG:g} deg/s" + (", with noise" if self.noise else ", no noise"),
            ("axis", "quantity", "check", "ours", "why"),
            tuple(rows),
            ("agreement: 2 %, or a unit of the last printed digit",),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def plot(self) -> Figure:
        """Velocity and attitude errors over time, all schemes overlaid (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.du.study.figures import chapter3_figure

        return draw(chapter3_figure(self))


def chapter3(
    case: Case,
    *,
    axes: Sequence[DuAxis | None] = SCHEMES,
    duration_s: float = 300.0,
    noise: bool = False,
    seed: int = 0,
    rate_hz: float = 100.0,
) -> Chapter3:
    """Simulate one kind of error at rest, conventional and rotating.

    Parameters
    ----------
    case : {"bias", "gyro bias", "scale factor", "installation"}
        Gyroscopes and accelerometers, 30 deg/h and 0.2 m/s^2; gyroscopes alone; 3000 ppm; 0.1 deg. Gyroscopes only for
        the last two. Equal and positive on all axes (all six elements) of Du's.
    axes : sequence of {"X", "Y", "Z", None}
    duration_s : float
        [s]
    noise : bool
        Add the thesis's noise, 0.2 deg/sqrt(h) and 0.1 m/s/sqrt(h).
    seed : int
        Seed of the noise, the same for all schemes.
    rate_hz : float

    Returns
    -------
    Chapter3

    Raises
    ------
    InputError
        If the case is unknown.

    References
    ----------
    Du (2015), section 3.3 and tables 3.1 to 3.3. The latitude (45 deg), the duration and the sampling rate are not in
    it, nor which installation errors are meant.
    """
    errors = case_errors(case, noise=noise)
    runs: dict[DuAxis | None, ErrorHistory] = {}
    for axis in axes:
        schedule = fixed() if axis is None else continuous(du_axis(axis), _RATE)
        rng = np.random.default_rng(seed)
        runs[axis] = static_run(schedule, errors, duration=duration_s, rate_hz=rate_hz, rng=rng)
    return Chapter3(case, _RATE, noise, runs)


def case_errors(case: Case, *, noise: bool = False) -> ImuErrors:
    """Errors of the IMU of one case in our axes, from the catalogue's ``du-...`` entries."""
    if case not in get_args(Case):
        raise InputError(f"case: expected one of {', '.join(get_args(Case))}, got {case!r}")
    spec = catalogue.spec(_ENTRY[case])
    ones = np.ones(3)
    if case in ("bias", "gyro bias"):
        accel = 0.0 if case == "gyro bias" else spec.accel.turn_on_bias
        errors = ImuErrors(b_g=swap_vector(spec.gyro.turn_on_bias * ones), b_a=swap_vector(accel * ones))
    elif case == "scale factor":
        errors = ImuErrors(M_g=scale_matrix(*(3 * [spec.gyro.scale_factor])))
    else:
        errors = ImuErrors(M_g=installation_matrix(*(6 * [spec.gyro.misalignment])))
    if not noise:
        return errors
    return replace(errors, gyro_noise=noise_model(spec.gyro), accel_noise=noise_model(spec.accel))


def allowance(case: Case, name: str, printed: float) -> float:
    """Tolerance of a number about its anchor: 2 %, or a unit of its last printed digit. [unit of the name]"""
    kind = "position" if name in ("horizontal_m", "up_m") else name.split("_")[0]
    digit = _DIGIT[kind] * (0.1 if (case, kind) == ("installation", "attitude") else 1.0)
    return max(_BAND * abs(printed), digit)


def agrees(case: Case, name: str, ours: float, printed: float) -> bool:
    """Whether a number meets its anchor, see :func:`allowance`."""
    return abs(ours - printed) <= allowance(case, name, printed)


def anchors(case: Case, axis: DuAxis | None) -> dict[str, float]:
    """The independent check's numbers of a case and an axis of rotation, by the names of :meth:`Chapter3.values`."""
    attitude, velocity, horizontal, up = CHAPTER_3[case, axis]
    numbers: dict[str, float] = {}
    if attitude is not None:
        numbers |= {f"attitude_{c}_deg": a for c, a in zip("enu", attitude, strict=True)}
    numbers |= {f"velocity_{c}_m_s": v for c, v in zip("enu", velocity, strict=False)}
    numbers["horizontal_m"] = horizontal
    return numbers if up is None else numbers | {"up_m": up}


def _why(name: str) -> str:
    """Explanation of a difference, for the vertical channel only."""
    if name in ("up_m", "velocity_u_m_s"):
        return "gravity of the check does not fall with height, ours does: 2 g h / R"
    return "unexplained"
