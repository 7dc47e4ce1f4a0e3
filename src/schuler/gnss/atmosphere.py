"""Delays of ranges by ionosphere and troposphere, by the models that are chosen."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.frames import llh_from_ecef
from schuler.gnss.coarse import ReceiverPlace
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.ionosphere import klobuchar, klobuchar_beidou
from schuler.gnss.ionosphere_galileo import ntcm_g
from schuler.gnss.ionosphere_maps import map_delays
from schuler.gnss.ionosphere_nequick import check_nequick, nequick_g
from schuler.gnss.troposphere import Mapping, saastamoinen
from schuler.timebase import calendar

Ionosphere = Literal["klobuchar", "beidou", "galileo", "nequick-g", "maps", "free", "none"]
Troposphere = Literal["saastamoinen", "none"]

#: Coefficients broadcast on 2021-04-28, a quiet Sun, for messages that have none.
STAND_IN_ALPHA = (9.313e-9, 1.490e-8, -5.960e-8, -1.192e-7)
STAND_IN_BETA = (8.806e4, 4.915e4, -1.311e5, -3.277e5)


class Atmosphere(NamedTuple):
    """Delays of the code (n,), and 1-sigma of what the ionosphere's model leaves (n,). [m]"""

    ionosphere: FloatArray
    troposphere: FloatArray
    ionosphere_sigma: FloatArray
    notes: list[str]


def check_models(ionosphere: str, troposphere: str) -> None:
    """Refuse models that there are not, or whose library is not installed."""
    if ionosphere not in get_args(Ionosphere):
        raise InputError(
            f"ionosphere: expected klobuchar, beidou, galileo, nequick-g, maps, free or none, got {ionosphere!r}"
        )
    if ionosphere == "nequick-g":
        check_nequick()
    if troposphere not in ("saastamoinen", "none"):
        raise InputError(f"troposphere: expected saastamoinen or none, got {troposphere!r}")


def atmosphere(
    ephemerides: Ephemerides, place: ReceiverPlace, sat: IntArray, r_sat_e: FloatArray, gps_s: FloatArray,
    frequency_hz: FloatArray, ionosphere: Ionosphere, troposphere: Troposphere, mapping: Mapping, humidity: float,
    remains: float,
) -> Atmosphere:  # fmt: skip
    """Delays of the models, zero where the place is not known."""
    none = np.zeros(len(gps_s))
    if not place.located:
        return Atmosphere(none, none, none, [])
    llh = llh_from_ecef(place.r_e)
    delay, notes, sigma = none, list[str](), none
    if ionosphere in ("klobuchar", "beidou", "galileo"):
        delay, notes, share = _broadcast(ephemerides, llh, place, gps_s, frequency_hz, ionosphere)
        sigma = remains * share * delay
    elif ionosphere == "nequick-g":
        delay = nequick_g(_galileo(ephemerides, ionosphere), place.r_e, r_sat_e, sat, gps_s, frequency_hz)
        sigma = remains * delay
    elif ionosphere == "maps":
        delay, sigma, notes = _by_maps(ephemerides, llh, place, gps_s, frequency_hz, remains)
    wet = none
    if troposphere == "saastamoinen":
        wet = saastamoinen(llh, place.elevation, gps_s, humidity=humidity, mapping=mapping)
    return Atmosphere(delay, wet, sigma, notes)


def _broadcast(
    ephemerides: Ephemerides, llh: FloatArray, place: ReceiverPlace, gps_s: FloatArray, frequency_hz: FloatArray,
    asked: Ionosphere = "klobuchar",
) -> tuple[FloatArray, list[str], float]:  # fmt: skip
    """Delays by broadcast coefficients, those asked for, else those that there are; notes, share of 1-sigma."""
    e, at = ephemerides, (llh, place.elevation, place.azimuth, gps_s, frequency_hz)
    if asked == "beidou" and None in (e.beidou_alpha, e.beidou_beta):
        raise InputError(
            'ionosphere: "beidou" needs BeiDou\'s coefficients among the ephemerides (RINEX: BDSA and BDSB), and there '
            'are none; take "klobuchar"'
        )
    lacking = asked == "klobuchar" and None in (e.klobuchar_alpha, e.klobuchar_beta)
    if e.beidou_alpha is not None and e.beidou_beta is not None and (asked == "beidou" or lacking):
        notes = ["the messages have no Klobuchar coefficients of GPS: those of BeiDou, by its model"] if lacking else []
        return klobuchar_beidou(e.beidou_alpha, e.beidou_beta, *at), notes, 1.0
    if asked == "galileo":
        return ntcm_g(_galileo(e, asked), *at), [], 1.0
    if e.klobuchar_alpha is not None and e.klobuchar_beta is not None:
        return klobuchar(e.klobuchar_alpha, e.klobuchar_beta, *at), [], 1.0
    note = "the messages have no Klobuchar coefficients: those of 2021-04-28 stand in, at twice the usual uncertainty"
    if e.galileo_ai is not None:
        note += '; they have those of Galileo, which ionosphere "galileo" takes'
    return klobuchar(STAND_IN_ALPHA, STAND_IN_BETA, *at), [note], 2.0


def _galileo(ephemerides: Ephemerides, asked: Ionosphere) -> tuple[float, float, float]:
    if ephemerides.galileo_ai is None:
        raise InputError(
            f'ionosphere: "{asked}" needs Galileo\'s coefficients among the ephemerides (RINEX: GAL), and there are '
            'none; take "klobuchar"'
        )
    return ephemerides.galileo_ai


def _by_maps(
    ephemerides: Ephemerides, llh: FloatArray, place: ReceiverPlace, gps_s: FloatArray, frequency_hz: FloatArray,
    remains: float,
) -> tuple[FloatArray, FloatArray, list[str]]:  # fmt: skip
    """Delays by maps and their 1-sigma, by Klobuchar's model where maps have no value. (n,), (n,) [m]"""
    maps = ephemerides.ionosphere_maps
    if maps is None:
        raise InputError(
            'ionosphere: "maps" needs an IONEX file among the ephemerides, and there is none; give one of the day, or '
            'take "klobuchar"'
        )
    delay, sigma = map_delays(maps, llh, place.elevation, place.azimuth, gps_s, frequency_hz)
    outside = ~np.isfinite(delay)
    if not outside.any():
        return delay, sigma, []
    if outside.all():
        raise InputError(
            f"ionosphere: the maps are of {_date(maps.t[0])} to {_date(maps.t[-1])} GPS, or have no value there; the "
            f"observations begin at {_date(gps_s[0])}; give the IONEX file of that day"
        )
    model, notes, share = _broadcast(ephemerides, llh, place, gps_s, frequency_hz)
    notes.append(f"{int(outside.sum())} of {len(delay)} ranges are outside of the ionosphere's maps: Klobuchar's model")
    return np.where(outside, model, delay), np.where(outside, remains * share * model, sigma), notes


def _date(gps_s: float) -> str:
    return f"{calendar(float(gps_s)):%Y-%m-%d %H:%M}"
