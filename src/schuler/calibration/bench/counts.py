"""Logs in converter counts: the factors that make them SI, found from the log, and results in terms of counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray, as_floats
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.units import G0

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

Triad: TypeAlias = Literal["accel", "gyro"]

#: 1-sigma of scale factors relative to a factor that was found in the log instead of on a sheet, at least.
SCALE_SIGMA = 0.01
#: The middle of an unsigned range is believed if biases are below this share of it.
_NEAR = 0.25
_BITS = range(9, 32)


@dataclass(frozen=True, eq=False, repr=False)
class CountFactors(Abridged):
    """What makes a log in counts one in SI: ``s (y - m)``.

    Attributes
    ----------
    nominal : (float, float)
        s of the accelerometers [m/s^2 per count] and of the gyroscopes [rad/s per count]; 1 for a triad in SI.
    middle : ndarray, shape (2, 3)
        m of the axes of the accelerometers and of the gyroscopes, the count that stands for zero: half of the range of
        a converter without sign (minus that, where the axis was turned on reading), otherwise 0. [counts]
    """

    nominal: tuple[float, float]
    middle: FloatArray = field(default_factory=lambda: np.zeros((2, 3)))

    def __post_init__(self) -> None:
        if not all(np.isfinite(s) and s > 0.0 for s in self.nominal):
            raise InputError(f"nominal: expected two positive factors (accelerometers, gyroscopes), got {self.nominal}")
        object.__setattr__(self, "middle", as_floats(self.middle, "middle", (2, 3)))

    def to_si(self, imu: ImuSeries) -> ImuSeries:
        """A log in counts as one in SI with errors as small as the unit's."""
        (a, g), (m_a, m_g) = self.nominal, self.middle
        return replace(imu, accel=a * (imu.accel - m_a), gyro=g * (imu.gyro - m_g))

    def in_counts(self, result: CalibrationResult) -> CalibrationResult:
        """The calibration of a log made by :meth:`to_si`, as one of the log in counts.

        ``in_counts(result).apply(imu)`` is ``result.apply(to_si(imu))``: the middle becomes part of the biases, which
        is exact and leaves the covariance as it is.
        """
        if result.nominal != (1.0, 1.0):
            raise InputError(f"result: expected one of a log in SI, got one with factors {result.nominal}")
        middle = {} if not self.middle.any() else {"middle_counts": self.middle.tolist()}
        return replace(_moved(result, self.shift), nominal=self.nominal, extra=result.extra | middle)

    def in_si(self, result: CalibrationResult) -> CalibrationResult:
        """The opposite of :meth:`in_counts`."""
        if not np.allclose(result.nominal, self.nominal, rtol=1e-9, atol=0.0):
            raise InputError(f"result: expected one with factors {self.nominal}, got {result.nominal}")
        extra = {name: value for name, value in result.extra.items() if name != "middle_counts"}
        back = {name: -value for name, value in self.shift.items()}
        return replace(_moved(result, back), nominal=(1.0, 1.0), extra=extra)

    @property
    def shift(self) -> dict[str, float]:
        """What the middle adds to each bias, by name; empty without one. SI."""
        return {
            f"{family}_{axis}": s * float(m)
            for family, s, middle in zip(("b_a", "b_g"), self.nominal, self.middle, strict=True) if middle.any()
            for axis, m in zip("xyz", middle, strict=True)
        }  # fmt: skip

    def widened(self, spec: ImuSpec) -> ImuSpec:
        """A specification for a log whose factors were found: scale factors are known to :data:`SCALE_SIGMA` at best.

        A sheet's scale-factor error is relative to the sheet's factor, which nobody stated; the one that was found is
        rounded and takes no account of Earth rate and g-sensitivity.
        """
        freepose_fit = [s != 1.0 for s in self.nominal]
        accel, gyro = (
            replace(triad, scale_factor=float(np.hypot(triad.scale_factor, SCALE_SIGMA))) if there else triad
            for triad, there in zip((spec.accel, spec.gyro), freepose_fit, strict=True)
        )
        return replace(spec, accel=accel, gyro=gyro)


def count_factors(
    imu: ImuSeries,
    triads: Sequence[Triad] = ("accel", "gyro"),
    *,
    gravity: float = G0,
    intervals: Sequence[tuple[float, float]] | None = None,
) -> CountFactors:
    """Find the factors of a log in counts that was turned by hand between rests.

    Parameters
    ----------
    imu : ImuSeries
        The log: rates, or increments of a converter with sign.
    triads : sequence of {"accel", "gyro"}
        Those that are in counts; the other is in SI.
    gravity : float
        [m/s^2]
    intervals : sequence of (start, stop), optional
        The rests. [s]

    Returns
    -------
    CountFactors

    Raises
    ------
    InputError
        If the log does not tell the factors (fewer than nine poses, no turns), or a triad said to be in SI is not.

    Notes
    -----
    The free-pose calibration finds them for itself: the mean factor of three axes, to four digits. Of a converter
    without sign no reading changes its sign, and biases are the middle of the range; that is taken for a power of two
    they are near to. Were it none, biases would start nearer to where they are than from zero, and no more.
    """
    small = _smaller(imu.gyro) if "gyro" in triads else 1.0
    freepose_fit = calibrate_freepose(replace(imu, gyro=small * imu.gyro), gravity=gravity, intervals=intervals)
    sigma = dict(zip(freepose_fit.names, freepose_fit.sigma.tolist(), strict=True))
    lost = [n for n in ("M_a_xx", "M_g_xx", "M_g_yy", "M_g_zz") if not np.isfinite(sigma.get(n, np.inf))]
    if freepose_fit.status == "refused" or lost:
        why = " ".join(freepose_fit.verdicts) or f"{', '.join(lost)} cannot be told"
        raise InputError(f"the factors of the counts cannot be found in this log, so state what a count is: {why}")
    for name, factor in zip(("accel", "gyro"), freepose_fit.nominal, strict=True):
        if name not in triads and factor != 1.0:
            raise InputError(
                f"{name}: expected SI, but gravity and the turns fit with a factor of {factor:.4g}; say that it is in "
                "counts, or in which unit"
            )
    factors, middle = [1.0, 1.0], np.zeros((2, 3))
    for i, (name, y, bias, by) in enumerate(
        (("accel", imu.accel, freepose_fit.errors.b_a, 1.0), ("gyro", imu.gyro, freepose_fit.errors.b_g, small))
    ):
        if name in triads:
            factors[i] = float(f"{by * freepose_fit.nominal[i]:.4g}")
            if imu.kind == "rate":
                middle[i] = _middle(bias / (by * freepose_fit.nominal[i]), y)
    return CountFactors((factors[0], factors[1]), middle)


def factors_of(result: CalibrationResult) -> CountFactors:
    """The factors an earlier calibration of a log in counts was made with."""
    middle = result.extra.get("middle_counts")
    if middle is None:  # of another method: its biases tell
        b = (result.errors.b_a, result.errors.b_g)
        middle = [_middle(x / s) if s != 1.0 else np.zeros(3) for x, s in zip(b, result.nominal, strict=True)]
    return CountFactors(result.nominal, np.array(middle))


def _smaller(gyro: FloatArray) -> float:
    """A power of two that makes turns of counts so small that nobody takes them for radians.

    Turns of 45 degrees in any unit are 45 degrees in radians as well, give or take a full turn, for one unit in
    fifteen; of turns that are all alike the free-pose calibration would not know better.
    """
    return float(2.0 ** np.floor(np.log2(1e-3 / max(float(np.abs(gyro - np.median(gyro, axis=0)).max()), 1e-300))))


def _middle(centre: FloatArray, readings: FloatArray | None = None) -> FloatArray:
    """Half the range of a converter without sign whose biases are ``centre`` (3,), or zeros. Shape (3,). [counts]"""
    sign, size = np.sign(centre), np.abs(centre)
    half = min((2.0**bits for bits in _BITS), key=lambda m: float(np.abs(size - m).max()))
    without_sign = readings is None or bool((readings * sign >= 0.0).all())
    return np.asarray(half * sign if without_sign and np.abs(size - half).max() < _NEAR * half else np.zeros(3))


def _moved(result: CalibrationResult, shift: dict[str, float]) -> CalibrationResult:
    """A result with something added to its biases, estimated, held or left out."""
    if not shift:
        return result
    step = np.array([shift.get(name, 0.0) for name in result.names])
    held = {n: result.fixed.get(n, 0.0) + shift.get(n, 0.0) for n in (*result.fixed, *shift) if n not in result.names}
    history = None if result.history is None else result.history + step
    return replace(result, values=result.values + step, fixed=held, history=history)
