"""White noise of the IMU where fixes are too few to tune it term by term: the likeliest of a few sizes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.start.heading import FITS
from schuler.navigation.tuning.likelihood import Residuals, residuals_of, trials
from schuler.navigation.tuning.search import LEAST_GAIN
from schuler.navigation.tuning.tuning import first_part, fixes_of
from schuler.toml import merged

_SIZES = (4.0, 16.0)  # factors on the 1-sigma, of which the likeliest counts
_MOST = 40  # fixes a second apart; more tune each term, or show that it is not the noise


class Rough(NamedTuple):
    """Factor on the IMU's white noise, log likelihood that it wins, and whether fixes fit it."""

    factor: float
    gain: float
    fits: bool


def rough_factor(prepared: PreparedRun, noisier: Callable[[float], PreparedRun]) -> Rough | None:
    """Factor on the IMU's white noise with which few fixes are far likelier than as the run is.

    Parameters
    ----------
    prepared : PreparedRun
        Whose noise could not be tuned.
    noisier : callable
        The run begun anew with white noise so many times as large: its start is found with that noise, too.

    Returns
    -------
    Rough or None
        None where the run fits its fixes, has many, or none of the factors makes them likelier by 8.

    Notes
    -----
    A dozen fixes do not tell seven factors on noise apart, nor prove them on fixes held back, but they tell one: fixes
    a second apart, predicted one after the other, whose joint likelihood is asked.
    """
    if prepared.ranges is not None:
        return None
    seen = _seen(prepared)
    if seen is None or len(seen.t) > _MOST * len(np.unique(seen.kind)) or _mean_square(seen) < FITS:
        return None
    best: Rough | None = None
    for factor in _SIZES:
        try:
            other = _seen(noisier(factor))
        except InputError:
            continue
        if other is None:
            continue
        gain = _gain(seen, other)
        if gain > (LEAST_GAIN if best is None else best.gain):
            best = Rough(factor, gain, _mean_square(other) < FITS)
    return best


def with_rough_noise(config: NavigationConfig, factor: float) -> NavigationConfig:
    """The configuration with the IMU's white noise in motion so many times as large, and nothing left to tune."""
    noise = config.filter.noise
    entries = {"gyro": noise.gyro * factor, "accel": [axis * factor for axis in noise.accel_axes]}
    data = config.model_dump(mode="json", exclude_unset=True)
    return NavigationConfig.parse(merged(data, {"filter": {"tune": False, "noise": entries}}))


def rough_note(chosen: Rough) -> str:
    """Sentence on noise that is larger by a factor."""
    return (
        f"fixes are too few to tune noise term by term, and do not fit it as configured: white noise of the IMU in "
        f"motion is taken {chosen.factor:.0f} times as large (log likelihood {chosen.gain:+.0f}, of the factors 1, "
        f"{' and '.join(f'{size:.0f}' for size in _SIZES)})"
    )


def _seen(prepared: PreparedRun) -> Residuals | None:
    """Innovations of fixes a second apart, all of them used; None if there are none."""
    prepared = first_part(prepared)
    fixes = fixes_of(prepared)
    tests = trials(prepared, fixes, phases=1)[:1] if fixes.any() else ()
    return residuals_of(tests)(prepared) if tests else None


def _mean_square(seen: Residuals) -> float:
    """Mean normalised innovation squared, outliers capped."""
    counted = seen.weight > 0.0
    return float((seen.influence() * seen.normalised**2)[counted].mean()) if counted.any() else 0.0


def _gain(before: Residuals, after: Residuals) -> float:
    """Log likelihood won of the fixes that both judge: the later start may have fewer."""
    keys = [list(zip(r.kind.tolist(), r.t.tolist(), strict=True)) for r in (before, after)]
    common = set(keys[0]) & set(keys[1])
    losses = [
        float(r.scores()[np.array([key in common for key in own], dtype=bool)].sum())
        for r, own in zip((before, after), keys, strict=True)
    ]
    return losses[0] - losses[1]
