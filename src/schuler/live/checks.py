"""Checks of what a live run is given: its configuration, and each fix and reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from schuler.exceptions import ConfigError, InputError
from schuler.live.aids import series_of
from schuler.live.messages import Fix, Heading, Height, Measurement, SatelliteEpoch, Speed
from schuler.navigation.config import NavigationConfig
from schuler.recording.io.possible import HEIGHTS, MAX_SIGMA, MAX_SIGMA_ANGLE, MAX_TIME, MAX_WHEEL_SPEED, check_fixes
from schuler.recording.series import GnssSeries

#: Value and 1-sigma of a reading
_LARGEST = {
    Speed: (MAX_WHEEL_SPEED, MAX_SIGMA),
    Heading: (MAX_SIGMA_ANGLE, MAX_SIGMA_ANGLE),
    Height: (HEIGHTS[1], MAX_SIGMA),
}


def check_live(config: NavigationConfig) -> None:
    """Check that a configuration asks for nothing that a live run has not.

    Raises
    ------
    ConfigError
        Naming the entry.
    """
    if config.gnss.coupling not in ("loose", "tight", "off"):
        raise ConfigError(
            f'gnss.coupling: expected "loose", "tight" or "off" for a live run, got "{config.gnss.coupling}"; navigate '
            "the log"
        )
    if config.gnss.coupling == "tight":
        _check_ranges(config)
    if config.filter.tune is True:
        raise ConfigError(
            "filter.tune: a live run cannot tune its noise; put what `schuler tune` finds on a log into the "
            "configuration"
        )
    if config.outages.windows_s or config.outages.every_s is not None:
        raise ConfigError("outages: a live run withholds no fixes; leave the section out, or the fixes")


def _check_ranges(config: NavigationConfig) -> None:
    """Check that tight coupling asks for nothing that a stream of ranges has not."""
    tight = config.gnss.tight
    if tight.carrier != "off":
        raise ConfigError(
            f'gnss.tight.carrier: expected "off" for a live run, got "{tight.carrier}": it takes ranges '
            "and range rates; navigate the log"
        )
    if tight.ionosphere in ("maps", "beidou"):
        raise ConfigError(
            f'gnss.tight.ionosphere: expected "klobuchar", "free" or "none" for a live run, got "{tight.ionosphere}"'
        )
    if tight.antenna is not None and tight.antenna.strip().lower() != "none":
        raise ConfigError(
            f'gnss.tight.antenna: a live run takes out no phase centres, and got "{tight.antenna}"; leave it out'
        )
    if config.gnss.correlated.position_sigma_m > 0.0:
        raise ConfigError(
            "gnss.correlated.position_sigma_m: a live run has no states of slow errors of single satellites; leave it "
            "out, and enlarge gnss.tight.range_sigma_scale"
        )


def checked(message: Fix | Speed | Heading | Height) -> GnssSeries | None:
    """A fix as a series of one, nothing of a reading.

    Raises
    ------
    InputError
        If the message is none, or no vehicle and no sensor has its numbers: the limits are those of logs.
    """
    if not math.isfinite(message.t):
        raise InputError("it has no time")
    if not abs(message.t) <= MAX_TIME:
        raise InputError(f"its time is {message.t:.6g} s, expected up to {MAX_TIME:.4g}: no clock counts more")
    if isinstance(message, Fix):
        series = series_of([message])
        check_fixes(series)
        return series
    value = message.speed if isinstance(message, Speed) else message.value
    largest, largest_sigma = _LARGEST[type(message)]
    if not abs(value) <= largest:
        raise InputError(f"expected a number up to {largest:.4g}, got {value:.6g}")
    if message.sigma is not None and not 0.0 < message.sigma <= largest_sigma:
        raise InputError(f"expected a positive 1-sigma up to {largest_sigma:.4g}, got {message.sigma:.6g}")
    return None


def checked_together(messages: Sequence[Measurement]) -> GnssSeries | None:
    """Fixes of a kind in order of time as one series, or None where each message is to be looked at by itself."""
    if len(messages) < 2 or not all(isinstance(m, Fix) for m in messages):
        return None
    fixes = cast(Sequence[Fix], messages)
    if any(
        (f.v_n is None) != (fixes[0].v_n is None) or (f.quality is None) != (fixes[0].quality is None) for f in fixes
    ):
        return None
    try:
        series = series_of(fixes)
        check_fixes(series)
    except (InputError, ValueError):
        return None
    return None if np.any(np.all(series.llh[1:] == series.llh[:-1], axis=1)) else series


def name_of(message: Fix | Speed | Heading | Height | SatelliteEpoch) -> str:
    """Kind of a message, in a sentence."""
    return "satellite epoch" if isinstance(message, SatelliteEpoch) else type(message).__name__.lower()
