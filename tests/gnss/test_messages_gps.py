"""GPS LNAV: parity, places of the bits, putting subframes together, weeks and leap seconds."""

import numpy as np
import pytest
from navigation_messages import lnav_words, pack

from schuler.exceptions import InputError
from schuler.gnss import messages_gps as lnav
from schuler.gnss.message_fields import SEMICIRCLE, accuracy_of_index, nearest, unpack, weeks_off

WEEK = 604_800.0
NOW = 2381 * WEEK + 408_640.0

#: Elements in whole steps of their fields, so that they come back exactly.
ORBIT = {
    1: {"week": 2381 % 1024, "accuracy": 2, "health": 0, "tgd": -5 * 2.0**-31, "issue": 97, "toc": 410_400.0,
        "af2": 0.0, "af1": -72 * 2.0**-43, "af0": -1_108_546 * 2.0**-31},
    2: {"issue": 97, "crs": -108.5625, "delta_n": 12_345 * 2.0**-43 * SEMICIRCLE,
        "m0": -(2**30 + 7) * 2.0**-31 * SEMICIRCLE, "cuc": -3064 * 2.0**-29, "e": 89_478_485 * 2.0**-33,
        "cus": 5170 * 2.0**-29, "sqrt_a": 2_702_000_000 * 2.0**-19, "toe": 410_400.0},
    3: {"cic": -3 * 2.0**-29, "omega0": 573_000_001 * 2.0**-31 * SEMICIRCLE, "cis": -52 * 2.0**-29,
        "i0": 655_000_003 * 2.0**-31 * SEMICIRCLE, "crc": 194.34375, "omega": -694_000_005 * 2.0**-31 * SEMICIRCLE,
        "omega_dot": -21_960 * 2.0**-43 * SEMICIRCLE, "issue": 97, "idot": 582 * 2.0**-43 * SEMICIRCLE},
}  # fmt: skip
PAGE = {
    "data_id": 1, "page": 56, "alpha0": 12 * 2.0**-30, "alpha1": 3 * 2.0**-27, "alpha2": -2 * 2.0**-24,
    "alpha3": 2.0**-24, "beta0": 45 * 2.0**11, "beta1": 2 * 2.0**14, "beta2": -3 * 2.0**16,
    "beta3": 5 * 2.0**16, "leap": 18,
    "leap_week": 2185 % 256, "leap_day": 7, "next_leap": 18,
}  # fmt: skip


def words_of(number: int, values: dict[str, float], tow: float) -> list[int]:
    """Ten words of 30 bits of a subframe that begins at ``tow``."""
    head, _ = pack({"preamble": 0x8B, "tow": tow + 6.0, "id": number}, lnav._HEAD)
    body, length = pack(values, lnav._SUBFRAMES[number])
    assert length == 192
    message = head << 192 | body
    return lnav_words([message >> 24 * k & 0xFFFFFF for k in range(9, -1, -1)])


def stream(changes: dict[int, dict[str, float]] | None = None, numbers=(1, 2, 3)) -> list[list[int]]:
    tables = {k: {**v, **(changes or {}).get(k, {})} for k, v in {**ORBIT, 4: PAGE}.items()}
    return [words_of(k, tables[k], 408_630.0 + 6.0 * (k - 1)) for k in numbers]


def decoded(words, sat=10, near=NOW):
    return lnav.ephemerides_of_lnav([sat] * len(words), words, [near] * len(words))


def test_elements_come_back_exactly():
    k = decoded(stream()).kepler
    assert len(k) == 1
    for part in ORBIT.values():
        for name, value in part.items():
            if name not in ("week", "accuracy", "tgd", "toc", "toe"):
                assert getattr(k, name)[0] == value, name
    assert (k.sat[0], k.toe[0], k.toc[0]) == (10, 2381 * WEEK + 410_400.0, 2381 * WEEK + 410_400.0)
    assert k.sent[0] == 2381 * WEEK + 408_630.0
    assert k.group_delay[0, 0] == -5 * 2.0**-31
    assert np.isnan(k.group_delay[0, 1])
    assert k.accuracy[0] == 4.0
    assert k.source[0] == 0


def test_parity_is_that_of_the_interface_document():
    """IS-GPS-200 table 20-XIV, equations written out for D25 and D30; the masks are their other form."""
    rng = np.random.default_rng(1)
    enters = {
        (5, 1): (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23),  # D25 from D29*
        (1, 0): (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24),  # D29 from D30*
        (0, 1): (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24),  # D30 from D29*
    }
    for _ in range(200):
        source, before = int(rng.integers(0, 1 << 24)), int(rng.integers(0, 4))
        for (bit, star), places in enters.items():
            expected = ((before >> star) + sum(source >> (24 - i) for i in places)) & 1
            assert lnav.parity(source, before) >> bit & 1 == expected


def test_any_single_wrong_bit_is_noticed():
    words = stream()[0]
    for word in range(10):
        for bit in range(30):
            wrong = list(words)
            wrong[word] ^= 1 << bit
            assert lnav.checked_words(wrong) is None


def test_fields_lie_where_the_interface_document_draws_them():
    """IS-GPS-200 figure 20-1: place of the first bit of a field in the 300 bits of a subframe, counted from 1."""

    def at(bit: int) -> int:
        word, place = divmod(bit - 1, 30)
        return 1 << (240 - (24 * word + place + 1))

    places = {
        1: {"week": 61, "accuracy": 73, "health": 77, "tgd": 197, "issue": 211, "toc": 219, "af2": 241, "af1": 249,
            "af0": 271},
        2: {"issue": 61, "crs": 69, "delta_n": 91, "m0": 107, "cuc": 151, "e": 167, "cus": 211, "sqrt_a": 227,
            "toe": 271},
        3: {"cic": 61, "omega0": 77, "cis": 121, "i0": 137, "crc": 181, "omega": 197, "omega_dot": 241, "issue": 271,
            "idot": 279},
        4: {"page": 63, "alpha0": 69, "beta0": 107, "leap": 241, "leap_week": 249, "leap_day": 257, "next_leap": 271},
    }  # fmt: skip
    for number, fields in places.items():
        for name, bit in fields.items():
            values = unpack(at(bit), 240, lnav._SUBFRAMES[number], 48)
            assert [n for n, v in values.items() if v != 0.0] == [name], name


def test_subframes_of_two_issues_are_not_mixed():
    old, new = stream(), stream({1: {"issue": 98}, 2: {"issue": 98, "toe": 417_600.0}, 3: {"issue": 98}})
    k = decoded([old[0], old[1], new[2], new[0], new[1], old[2], old[2]]).kepler
    assert k.issue.tolist() == [98]
    assert k.toe[0] == 2381 * WEEK + 417_600.0


def test_repeated_subframes_make_one_record_and_satellites_are_kept_apart():
    words = stream() + stream()
    e = lnav.ephemerides_of_lnav([10] * 3 + [32] * 3, words, [NOW] * 6)
    assert e.kepler.sat.tolist() == [10, 32]
    assert len(decoded(words).kepler) == 1
    # a subframe of one satellite never completes another's
    assert len(lnav.ephemerides_of_lnav([10, 11, 12], stream(), [NOW] * 3).kepler) == 0


def test_the_week_is_that_of_reception_also_around_its_end():
    assert nearest(604_770.0, 2382 * WEEK + 5.0) == 2381 * WEEK + 604_770.0
    words = [
        words_of(1, ORBIT[1] | {"toc": 7200.0}, 604_770.0),
        words_of(2, ORBIT[2] | {"toe": 7200.0}, 604_776.0),
        words_of(3, ORBIT[3], 604_782.0),
    ]
    k = decoded(words, near=2381 * WEEK + 604_790.0).kepler
    assert k.toe[0] == 2382 * WEEK + 7200.0
    assert k.sent[0] == 2381 * WEEK + 604_770.0


def test_a_week_other_than_the_receivers_is_refused_and_counted():
    e = decoded(stream({1: {"week": (2381 + 1) % 1024}}))
    assert len(e.kepler) == 0
    assert any("1 subframes of another week" in note for note in e.notes)
    assert weeks_off(2381 % 1024, 10, NOW) == 0
    assert weeks_off(0, 10, 2047 * WEEK) == 1
    assert weeks_off(1023, 10, 2048 * WEEK) == -1


def test_ionosphere_and_leap_seconds():
    e = decoded(stream(numbers=(4,)))
    assert e.klobuchar_alpha == (12 * 2.0**-30, 3 * 2.0**-27, -2 * 2.0**-24, 2.0**-24)
    assert e.klobuchar_beta == (45 * 2.0**11, 2 * 2.0**14, -3 * 2.0**16, 5 * 2.0**16)
    assert e.leap_seconds == 18
    # announced for the end of this week, and then past
    soon = {4: {"leap_week": 2381 % 256, "leap_day": 7, "next_leap": 19}}
    assert decoded(stream(soon, numbers=(4,))).leap_seconds == 18
    past = {4: {"leap_week": 2380 % 256, "leap_day": 7, "next_leap": 19}}
    assert decoded(stream(past, numbers=(4,))).leap_seconds == 19
    assert decoded(stream({4: {"page": 57}}, numbers=(4,))).klobuchar_alpha is None


def test_faulty_subframes_are_counted():
    words = stream()
    words[1] = [w ^ 1 for w in words[1]]
    e = decoded(words)
    assert len(e.kepler) == 0
    assert any("1 subframes with a wrong parity" in note for note in e.notes)


def test_accuracies_of_the_index():
    """IS-GPS-200 20.3.3.3.1.3: 1, 3 and 5 are 2.8, 5.7 and 11.3 m."""
    assert [accuracy_of_index(n) for n in (0, 1, 2, 3, 5, 6, 7, 14)] == [2.0, 2.8, 4.0, 5.7, 11.3, 16.0, 32.0, 4096.0]
    assert accuracy_of_index(15) == np.inf


def test_shapes_are_checked():
    with pytest.raises(InputError, match="n x 10 words"):
        lnav.ephemerides_of_lnav([1], [[0] * 8], [NOW])
