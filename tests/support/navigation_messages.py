"""Navigation messages made of their fields: the opposites of what ``schuler.gnss`` decodes."""

from collections.abc import Mapping, Sequence

from schuler.gnss import messages_beidou as beidou
from schuler.gnss import messages_glonass as glonass
from schuler.gnss.message_fields import Field, crc24q
from schuler.gnss.messages_gps import parity


def pack(values: Mapping[str, float], layout: Sequence[Field]) -> tuple[int, int]:
    """Message and its length, absent fields zero; the opposite of ``message_fields.unpack``."""
    message = length = 0
    for name, bits, _, scale in layout:
        number = round(values.get(name, 0.0) / scale) & ((1 << bits) - 1)
        message, length = message << bits | number, length + bits
    return message, length


def lnav_words(data: Sequence[int]) -> list[int]:
    """Ten words of 30 bits with parity of ten times 24 source bits; the opposite of ``messages_gps.checked_words``.

    The last two source bits of words 2 and 10 are chosen so that their parity ends in zeros, as the satellites do.
    """
    words, before = [], 0
    for k, source in enumerate(data):
        source = int(source)
        if k in (1, 9):
            source = next(d for d in range(source & ~3, (source & ~3) + 4) if parity(d, before) & 3 == 0)
        bits = parity(source, before)
        words.append(source << 6 | (bits ^ 0x3F if before & 1 else bits))
        before = bits & 3
    return words


def d1_words(message: int) -> list[int]:
    """Ten words of 30 bits with parity of 224 information bits; the opposite of ``checked_message`` of BeiDou."""
    head = message >> (beidou._BITS - 26)
    words = [head << 4 | beidou.bch_remainder((head & 0x7FF) << 4)]
    for k in range(8, -1, -1):
        info = message >> 22 * k & 0x3FFFFF
        words.append(info << 8 | beidou.bch_remainder(info >> 11 << 4) << 4 | beidou.bch_remainder((info & 0x7FF) << 4))
    return words


def page_words(word: int) -> list[int]:
    """Eight words of 32 bits that carry a word of 128 bits in a nominal page; the opposite of ``checked_page``."""
    first, second = word >> 16, (0b10 << 16 | word & 0xFFFF) << 64  # reserved, search and rescue and spare are zero
    odd = (second << 24 | crc24q(first << 82 | second, 196)) << 14
    both = first << 14 << 128 | odd << 8
    return [both >> 32 * k & 0xFFFFFFFF for k in range(7, -1, -1)]


def glonass_string(payload: int) -> int:
    """A string of 85 bits with check sums of its 77 first bits; the opposite of checking."""
    message = payload << 8
    message |= glonass._syndrome(message)
    return message | (message.bit_count() % 2) << 7
