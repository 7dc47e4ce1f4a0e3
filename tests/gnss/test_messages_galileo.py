"""Galileo I/NAV: pages and their check, places of the bits, putting words together, health and accuracy."""

import numpy as np
import pytest
from navigation_messages import pack, page_words

from schuler.exceptions import InputError
from schuler.gnss import messages_galileo as inav
from schuler.gnss.message_fields import SEMICIRCLE, crc24q, unpack

WEEK = 604_800.0
NOW = 2381 * WEEK + 408_640.0
WORDS = {
    1: {"issue": 45, "toe": 408_000.0, "m0": -(2**30) * 2.0**-31 * SEMICIRCLE, "e": 1_935_000 * 2.0**-33,
        "sqrt_a": 2_852_477_000 * 2.0**-19},
    2: {"issue": 45, "omega0": 123_456_789 * 2.0**-31 * SEMICIRCLE, "i0": 650_000_001 * 2.0**-31 * SEMICIRCLE,
        "omega": -987_654_321 * 2.0**-31 * SEMICIRCLE, "idot": -77 * 2.0**-43 * SEMICIRCLE},
    3: {"issue": 45, "omega_dot": -15_555 * 2.0**-43 * SEMICIRCLE, "delta_n": 8000 * 2.0**-43 * SEMICIRCLE,
        "cuc": -300 * 2.0**-29, "cus": 4000 * 2.0**-29, "crc": 150.5, "crs": -12.25, "accuracy": 107},
    4: {"issue": 45, "svid": 26, "cic": 9 * 2.0**-29, "cis": -8 * 2.0**-29, "toc": 408_000.0,
        "af0": 1_028_299 * 2.0**-34, "af1": 768 * 2.0**-46, "af2": -1 * 2.0**-59},
    5: {"ai0": 159.25, "ai1": -0.046875, "ai2": 621 * 2.0**-15, "bgd_e5a": -21 * 2.0**-32, "bgd_e5b": -24 * 2.0**-32,
        "hs_e5b": 0, "hs_e1b": 0, "dvs_e5b": 0, "dvs_e1b": 0, "week": 2381 - 1024, "tow": 408_655.0},
    6: {"leap": 18, "leap_week": 2185 % 256, "leap_day": 7, "next_leap": 18, "tow": 408_657.0},
}  # fmt: skip


def page(number: int, **changes: float) -> list[int]:
    word, length = pack(WORDS[number] | changes, inav._WORDS[number])
    assert length == 128
    return page_words(word | number << 122)


def decoded(pages, sat=226, near=NOW, signal="1B"):
    return inav.ephemerides_of_inav([sat] * len(pages), pages, [near] * len(pages), signal)


def test_elements_come_back_exactly():
    e = decoded([page(k) for k in (5, 2, 4, 6, 1, 3)])
    k = e.kepler
    assert len(k) == 1
    for part in (1, 2, 3, 4):
        for name, value in WORDS[part].items():
            if name not in ("toe", "toc", "accuracy", "svid"):
                assert getattr(k, name)[0] == value, name
    assert (k.toe[0], k.toc[0], k.sent[0]) == tuple(2381 * WEEK + s for s in (408_000.0, 408_000.0, 408_655.0))
    assert k.group_delay[0].tolist() == [-21 * 2.0**-32, -24 * 2.0**-32]
    assert k.accuracy[0] == 3.12
    assert (k.health[0], k.source[0]) == (0, 513)
    assert e.galileo_ai == (159.25, -0.046875, 621 * 2.0**-15)
    assert e.leap_seconds == 18


def test_the_page_is_that_of_the_interface_document():
    """Even part 0, nominal 0, 112 bits, tail; odd part 1, nominal 0, 16 bits, 64 others, check, 8 bits, tail."""
    word = 0x0123456789ABCDEF0123456789ABCDEF
    words = page_words(word)
    even, odd = (sum(w << 32 * (3 - i) for i, w in enumerate(half)) >> 8 for half in (words[:4], words[4:]))
    assert even >> 118 == 0b00
    assert odd >> 118 == 0b10
    assert even >> 6 & (1 << 112) - 1 == word >> 16
    assert odd >> 102 & 0xFFFF == word & 0xFFFF
    assert inav.checked_page(page_words(word)) == word


def test_the_check_is_the_crc_of_qualcomm():
    """CRC-24Q of 123456789 is CDE703 (catalogue of parametrised CRC algorithms, "CRC-24/LTE-A")."""
    message = int.from_bytes(b"123456789", "big")
    assert crc24q(message, 72) == 0xCDE703


def test_wrong_bits_and_alerts_are_refused_and_counted():
    good = page(1)
    rng = np.random.default_rng(2)
    for bit in rng.choice(114, 40, replace=False):
        wrong = list(good)
        wrong[bit // 32] ^= 1 << (31 - bit % 32)
        assert inav.checked_page(wrong) is None
    alert = list(good)
    alert[0] |= 1 << 30
    e = decoded([alert])
    assert any("1 pages with a wrong check or of alerts" in note for note in e.notes)


def test_fields_lie_where_the_interface_document_draws_them():
    """Galileo OS SIS ICD 2.1, tables 42 to 47: sums of the bits before a field."""
    places = {
        1: {"issue": 6, "toe": 16, "m0": 30, "e": 62, "sqrt_a": 94},
        2: {"omega0": 16, "i0": 48, "omega": 80, "idot": 112},
        3: {"omega_dot": 16, "delta_n": 40, "cuc": 56, "cus": 72, "crc": 88, "crs": 104, "accuracy": 120},
        4: {"svid": 16, "cic": 22, "cis": 38, "toc": 54, "af0": 68, "af1": 99, "af2": 120},
        5: {"ai0": 6, "ai1": 17, "ai2": 28, "bgd_e5a": 47, "bgd_e5b": 57, "hs_e5b": 67, "hs_e1b": 69, "dvs_e5b": 71,
            "dvs_e1b": 72, "week": 73, "tow": 85},
        6: {"leap": 62, "leap_week": 86, "leap_day": 94, "next_leap": 97, "tow": 105},
    }  # fmt: skip
    for number, fields in places.items():
        for name, bit in fields.items():
            values = unpack(1 << (127 - bit), 128, inav._WORDS[number])
            assert [n for n, v in values.items() if v != 0.0] == [name], name


def test_words_of_two_issues_are_not_mixed():
    pages = [page(5), page(1), page(2), page(3), page(4, issue=46), page(1, issue=46, toe=408_600.0)]
    assert len(decoded(pages).kepler) == 0
    pages += [page(2, issue=46), page(3, issue=46), page(3, issue=46)]
    assert decoded(pages).kepler.issue.tolist() == [46]


def test_health_is_put_together_as_in_rinex():
    pages = [page(k) for k in (1, 2, 3, 4)]
    assert decoded([*pages, page(5, dvs_e1b=1)]).kepler.health[0] == 1
    assert decoded([*pages, page(5, hs_e1b=1)]).kepler.health[0] == 2
    assert decoded([*pages, page(5, hs_e1b=3)]).kepler.health[0] == 6
    assert decoded([*pages, page(5, dvs_e5b=1)]).kepler.health[0] == 64
    assert decoded([*pages, page(5, hs_e5b=2)]).kepler.health[0] == 256
    assert decoded([*pages, page(5)], signal="7I").kepler.source[0] == 516


def test_accuracy():
    """Galileo OS SIS ICD 2.1, table 89."""
    assert [inav.sisa(n) for n in (0, 49, 50, 75, 100, 107, 125)] == [0.0, 0.49, 0.5, 1.0, 2.0, 3.12, 6.0]
    assert inav.sisa(126) == inav.sisa(255) == np.inf


def test_ionosphere_all_zero_is_none():
    assert decoded([page(5, ai0=0.0, ai1=0.0, ai2=0.0)]).galileo_ai is None


def test_another_week_is_refused():
    e = decoded([page(k) for k in (1, 2, 3, 4)] + [page(5, week=2380 - 1024)])
    assert len(e.kepler) == 0
    assert any("another week" in note for note in e.notes)


def test_arguments_are_checked():
    with pytest.raises(InputError, match="1B or 7I"):
        decoded([page(1)], signal="5I")
    with pytest.raises(InputError, match="n x 8 words"):
        inav.ephemerides_of_inav([226], [[0] * 10], [NOW])
