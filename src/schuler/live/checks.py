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
from schuler.recording.series import GnssSeries


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
        If the message is none.
    """
    if not math.isfinite(message.t):
        raise InputError("it has no time")
    if isinstance(message, Fix):
        return series_of([message])
    value = message.speed if isinstance(message, Speed) else message.value
    if not math.isfinite(value):
        raise InputError(f"expected a number, got {value}")
    if message.sigma is not None and not 0.0 < message.sigma < math.inf:
        raise InputError(f"expected a positive 1-sigma, got {message.sigma}")
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
    except (InputError, ValueError):
        return None
    return None if np.any(np.all(series.llh[1:] == series.llh[:-1], axis=1)) else series


def name_of(message: Fix | Speed | Heading | Height | SatelliteEpoch) -> str:
    """Kind of a message, in a sentence."""
    return "satellite epoch" if isinstance(message, SatelliteEpoch) else type(message).__name__.lower()
