"""BeiDou D1: parity, places of the bits, putting subframes together, time scale."""

import pytest
from navigation_messages import d1_words, pack

from schuler.exceptions import InputError
from schuler.gnss import messages_beidou as d1
from schuler.gnss.message_fields import SEMICIRCLE, unpack

WEEK = 604_800.0
NOW = 2381 * WEEK + 408_650.0
SOW = 408_630.0
PARTS = {
    1: {"health": 0, "aodc": 1, "accuracy": 0, "week": 2381 - 1356, "toc": 406_800.0, "tgd1": 133e-10, "tgd2": -43e-10,
        "af2": 3 * 2.0**-66, "af0": -8_275_955 * 2.0**-33, "af1": -7_709 * 2.0**-50, "issue": 1},
    2: {"delta_n": 9_999 * 2.0**-43 * SEMICIRCLE, "cuc": -287 * 2.0**-31, "m0": 605_000_001 * 2.0**-31 * SEMICIRCLE,
        "e": 4_779_000 * 2.0**-33, "cus": 14_317 * 2.0**-31, "crc": 238.25, "crs": -3.5,
        "sqrt_a": 2_769_610_000 * 2.0**-19},
    3: {"i0": 672_000_007 * 2.0**-31 * SEMICIRCLE, "cic": 97 * 2.0**-31, "omega_dot": -18_700 * 2.0**-43 * SEMICIRCLE,
        "cis": -112 * 2.0**-31, "idot": 1029 * 2.0**-43 * SEMICIRCLE, "omega0": -119_000_003 * 2.0**-31 * SEMICIRCLE,
        "omega": 40_750_009 * 2.0**-31 * SEMICIRCLE},
}  # fmt: skip
STEP = 8.0 * 2**15  # of the two highest bits of toe


def subframe(number: int, sow: float | None = None, toe: float = 406_800.0, **changes: float) -> list[int]:
    sow = SOW + 6.0 * (number - 1) if sow is None else sow
    head, _ = pack({"preamble": d1._PREAMBLE, "id": number, "sow": sow}, d1._HEAD)
    high, low = divmod(toe, STEP)
    values = PARTS[number] | {"toe_high": high * STEP, "toe_low": low} | changes
    body, length = pack(values, d1._SUBFRAMES[number])
    assert length == 186
    return d1_words(head << 186 | body)


def decoded(words, near=NOW):
    return d1.ephemerides_of_d1([321] * len(words), words, [near] * len(words))


def test_elements_come_back_exactly_on_gps_time():
    k = decoded([subframe(n) for n in (1, 2, 3)]).kepler
    assert len(k) == 1
    for part in PARTS.values():
        for name, value in part.items():
            if name not in ("week", "accuracy", "toc", "tgd1", "tgd2", "aodc"):
                assert getattr(k, name)[0] == value, name
    assert k.toe[0] == k.toc[0] == 2381 * WEEK + 406_814.0
    assert k.sent[0] == 2381 * WEEK + 408_644.0
    assert k.group_delay[0] == pytest.approx((133e-10, -43e-10), rel=1e-14)  # rounding
    assert k.accuracy[0] == 2.0


def test_the_ionosphere_comes_with_the_clock():
    alpha, beta = (
        (10 * 2.0**-30, -12 * 2.0**-27, 5 * 2.0**-24, -3 * 2.0**-24),
        (61 * 2.0**11, -4 * 2.0**14, 65536.0, 0.0),
    )
    stated = {f"alpha{k}": a for k, a in enumerate(alpha)} | {f"beta{k}": b for k, b in enumerate(beta)}
    e = decoded([subframe(1, **stated)])
    assert (e.beidou_alpha, e.beidou_beta) == (alpha, beta)
    assert decoded([subframe(1)]).beidou_alpha is None  # zeros are none


def test_the_parity_divides_by_the_generator():
    """BDS-SIS-ICD B1I 3.0, 5.1.3: g(X) = X^4 + X + 1, which itself is a code word, and so are its multiples."""
    assert d1.bch_remainder(0b10011) == 0
    assert d1.bch_remainder(0b10011 << 7 ^ 0b10011 << 2) == 0
    # a Hamming code: all 15 single errors have remainders of their own
    assert len({d1.bch_remainder(1 << k) for k in range(15)}) == 15


def test_any_single_wrong_bit_under_parity_is_noticed():
    words = subframe(2)
    for word in range(10):
        for bit in range(15 if word == 0 else 30):
            wrong = list(words)
            wrong[word] ^= 1 << bit
            assert d1.checked_message(wrong) is None


def test_fields_lie_where_the_interface_document_draws_them():
    """BDS-SIS-ICD B1I 3.0, figures 5-8 to 5-10: place of the first bit in the 300 bits of a subframe, from 1."""

    def at(bit: int) -> int:
        word, place = divmod(bit - 1, 30)
        before = place if word == 0 else 26 + 22 * (word - 1) + place
        return 1 << (223 - before)

    places = {
        1: {"health": 43, "aodc": 44, "accuracy": 49, "week": 61, "toc": 74, "tgd1": 99, "tgd2": 109, "alpha0": 127,
            "alpha1": 135, "alpha2": 151, "alpha3": 159, "beta0": 167, "beta1": 183, "beta2": 191, "beta3": 199,
            "af2": 215, "af0": 226, "af1": 258, "issue": 288},
        2: {"delta_n": 43, "cuc": 67, "m0": 93, "e": 133, "cus": 181, "crc": 199, "crs": 225, "sqrt_a": 251,
            "toe_high": 291},
        3: {"toe_low": 43, "i0": 66, "cic": 106, "omega_dot": 132, "cis": 164, "idot": 190, "omega0": 212,
            "omega": 252},
    }  # fmt: skip
    for number, fields in places.items():
        for name, bit in fields.items():
            values = unpack(at(bit), 224, d1._SUBFRAMES[number], 38)
            assert [n for n, v in values.items() if v != 0.0] == [name], name


def test_only_subframes_that_followed_each_other_are_put_together():
    later = [subframe(n, SOW + 30.0 + 6.0 * (n - 1), toe=410_400.0, toc=410_400.0) for n in (1, 2, 3)]
    assert len(decoded([subframe(1), subframe(2), later[2]]).kepler) == 0
    assert decoded([subframe(1), subframe(2), *later]).kepler.toe.tolist() == [2381 * WEEK + 410_414.0]
    assert (
        len(decoded([subframe(n) for n in (1, 2, 3)] + [subframe(n, SOW + 30 + 6 * n - 6) for n in (1, 2, 3)]).kepler)
        == 1
    )


def test_the_end_of_the_week_by_beidou_time():
    words = [subframe(n, 604_776.0 + 6.0 * (n - 1), toe=0.0, toc=0.0) for n in (1, 2, 3)]
    k = decoded(words, near=2382 * WEEK + 10.0).kepler  # BeiDou is 14 s behind: still its week 1025
    assert k.toe[0] == 2382 * WEEK + 14.0


def test_faults_are_counted():
    bad = subframe(1)
    bad[3] ^= 1
    e = decoded([bad, subframe(1, week=1000)])
    assert any("1 subframes with a wrong parity" in note for note in e.notes)
    assert any("1 subframes of another week" in note for note in e.notes)
    with pytest.raises(InputError, match="n x 10 words"):
        d1.ephemerides_of_d1([321], [[0] * 4], [NOW])
