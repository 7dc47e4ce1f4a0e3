"""GLONASS strings: check sums, places of the bits, sign and magnitude, days and leap seconds."""

import numpy as np
import pytest
from navigation_messages import glonass_string

from schuler.exceptions import InputError
from schuler.gnss import messages_glonass as glo

WEEK = 604_800.0
NOW = 2381 * WEEK + 408_640.0  # Thursday 17:30:40 GPS, 17:30:22 UTC, 20:30:22 in Moscow

#: Bits of a field by the interface document: last and first place from the end of the string (table 4.6).
BITS = {
    1: {"hours": (72, 76), "minutes": (66, 71), "half": (65, 65), "v": (41, 64), "a": (36, 40), "r": (9, 35)},
    2: {"bn": (78, 80), "tb": (70, 76), "v": (41, 64), "a": (36, 40), "r": (9, 35)},
    3: {"gamma": (69, 79), "ln": (65, 65), "v": (41, 64), "a": (36, 40), "r": (9, 35)},
    4: {"tau": (59, 80), "slot": (11, 15)},
}
RAW = {
    1: {"hours": 20, "minutes": 30, "half": 0, "v": 1234, "a": 16 + 3, "r": (1 << 26) + 25_500_000},
    2: {"bn": 0, "tb": 81, "v": (1 << 23) + 4321, "a": 1, "r": 1_000_000},
    3: {"gamma": (1 << 10) + 5, "ln": 0, "v": 3_000_000, "a": 0, "r": 40_000_000},
    4: {"tau": (1 << 21) + 1000, "slot": 7},
}


def string(number: int, frame: int = 5, **changes: int) -> list[int]:
    """Four words of a string, built from places of the document and not from our layouts."""
    message = number << 80
    for name, value in (RAW[number] | changes).items():
        message |= value << (BITS[number][name][0] - 1)
    whole = glonass_string(message >> 8) << 43
    return [*(whole >> 32 * k & 0xFFFFFFFF for k in (3, 2, 1)), 0x00010000 | frame]


def decoded(words, near=NOW, leap=18):
    n = len(words)
    return glo.ephemerides_of_strings([107] * n, words, [near] * n, [-4] * n, leap)


def test_states_and_clock():
    g = decoded([string(k) for k in (1, 2, 3, 4)]).glonass
    assert len(g) == 1
    km = 1000.0
    assert g.r_e[0].tolist() == [-25_500_000 * 2.0**-11 * km, 1_000_000 * 2.0**-11 * km, 40_000_000 * 2.0**-11 * km]
    assert g.v_e[0].tolist() == [1234 * 2.0**-20 * km, -4321 * 2.0**-20 * km, 3_000_000 * 2.0**-20 * km]
    assert g.a_e[0].tolist() == [-3 * 2.0**-30 * km, 2.0**-30 * km, 0.0]
    assert g.clock[0] == 1000 * 2.0**-30  # minus tau
    assert g.rate[0] == -5 * 2.0**-40
    assert (g.channel[0], g.health[0], g.sat[0]) == (-4, 0, 107)
    # 81 quarters of an hour are 20:15 in Moscow, 17:15 UTC
    assert g.toe[0] == 2381 * WEEK + 4 * 86_400.0 + 17 * 3600.0 + 15 * 60.0 + 18.0
    assert g.sent[0] == 2381 * WEEK + 4 * 86_400.0 + 17 * 3600.0 + 30 * 60.0 + 18.0


def test_the_table_of_leap_seconds_is_the_default():
    e = decoded([string(k) for k in (1, 2, 3, 4)], leap=None)
    assert e.glonass.toe[0] % 60.0 == 18.0


def test_the_day_is_that_of_reception_also_around_midnight_in_moscow():
    midnight = 2381 * WEEK + 4 * 86_400.0 + 21 * 3600.0 + 18.0
    words = [string(1, hours=23, minutes=59), string(2, tb=0), string(3), string(4)]
    assert decoded(words, near=midnight - 20.0).glonass.toe[0] == midnight


def test_any_single_wrong_bit_is_noticed():
    good = glonass_string(int(np.random.default_rng(3).integers(0, 1 << 60)) << 10)
    assert glo.checks(good)
    assert all(not glo.checks(good ^ 1 << bit) for bit in range(85))
    # two wrong bits keep the number of ones even; the other sums see them
    assert all(not glo.checks(good ^ 1 << bit ^ 1 << 40) for bit in range(85) if bit != 40)


def test_check_sums_are_those_of_the_interface_document():
    """Table 4.13: information bits of the first sum, and the last sum over all."""
    first = [9, 10, 12, 13, 15, 17, 19, 20, 22, 24, 26, 28, 30, 32, 34, 35, 37, 39, 41, 43, 45, 47, 49, 51, 53, 55, 57,
             59, 61, 63, 65, 66, 68, 70, 72, 74, 76, 78, 80, 82, 84]  # fmt: skip
    assert [b for b in range(9, 86) if glo._PLACES[b - 1] & 1] == first
    assert glo._PLACES[7] == 0
    assert [glo._PLACES[k] for k in range(7)] == [1, 2, 4, 8, 16, 32, 64]


def test_strings_of_two_frames_are_not_mixed():
    assert len(decoded([string(1), string(2), string(3, 6), string(4, 6)]).glonass) == 0


def test_unhealthy_satellites():
    words = [string(k) for k in (1, 3, 4)]
    assert decoded([*words, string(2, bn=4)]).glonass.health[0] == 1
    assert decoded([*words, string(2, bn=3)]).glonass.health[0] == 0
    assert decoded([string(1), string(2), string(3, ln=1), string(4)]).glonass.health[0] == 1


def test_faults_are_counted():
    bad = string(1)
    bad[1] ^= 4
    assert any("1 strings with a wrong check sum" in note for note in decoded([bad]).notes)
    with pytest.raises(InputError, match="n x 4 words"):
        glo.ephemerides_of_strings([107], [[0] * 8], [NOW], [1])
