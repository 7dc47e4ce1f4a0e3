"""Compiled reading of tables of numbers: the digits of a text to the nearest double, as Python's ``float`` gives it.

Three steps, each exact where it decides and silent where it cannot. Up to 19 digits make a whole number w and a power
of ten q. (1) w up to 2^53 and abs(q) up to 22: both are doubles, so one multiplication or division rounds once
(W. D. Clinger, How to read floating point numbers accurately, PLDI 1990). (2) Else w times the leading 64 bits of
10^q, which are short by less than one unit: the product is known but for its last bit or two, and unless these lie at
the middle between two doubles the rounding is decided; if they do, with 128 bits of 10^q (after D. Lemire, Number
parsing at a gigabyte per second, Software: Practice and Experience 51(8), 2021, section 5; his proof that nothing is
left over is not needed). (3) What is left, exact ties among it, is marked, and the caller asks ``float``.
"""

from __future__ import annotations

import numpy as np

from schuler.jit import inlined, kernel, prepare

#: Powers of ten and of two in the tables that the caller makes: 10^(k + LEAST), 2^(k + LEAST_TWO).
LEAST, MOST = -307, 288
LEAST_TWO = -1100
#: Classes of characters; NUMBER is what numbers are made of, OTHER may stand in columns that are not read.
NUMBER, OTHER, BLANK, DELIMITER, RETURN, END, COMMENT, BAD = 0, 1, 2, 3, 4, 5, 6, 7
#: Targets of columns that are no row of the doubles: one not read, one read as whole multiples of a power of ten.
SKIPPED, WHOLE = -1, -2

_U0, _U1, _U10, _U11, _U32 = np.uint64(0), np.uint64(1), np.uint64(10), np.uint64(11), np.uint64(32)
_LOW = np.uint64(0xFFFFFFFF)
_TOP = np.uint64(1 << 63)
_TAIL, _BELOW, _MIDDLE = np.uint64(0x7FF), np.uint64(0x3FE), np.uint64(0x400)
_ALL_BUT = np.uint64(0xFFFFFFFFFFFFFFFD)
_EXACT = np.uint64(1 << 53)
_LARGEST = np.uint64(4_000_000_000_000_000_000)
_DIGITS = 19  # that always fit into 64 bits


@inlined
def _product(a, b):
    """The 128 bits of a product of two 64-bit numbers, high and low."""
    a1, a0, b1, b0 = a >> _U32, a & _LOW, b >> _U32, b & _LOW
    low, mid, other, high = a0 * b0, a1 * b0, a0 * b1, a1 * b1
    carry = (low >> _U32) + (mid & _LOW) + (other & _LOW)
    return high + (mid >> _U32) + (other >> _U32) + (carry >> _U32), (carry << _U32) | (low & _LOW)


@inlined
def _zeros(w):
    """Number of zero bits before the first one of ``w``, which is not zero."""
    n = 0
    if w < np.uint64(1 << 32):
        w, n = w << np.uint64(32), 32
    if w < np.uint64(1 << 48):
        w, n = w << np.uint64(16), n + 16
    if w < np.uint64(1 << 56):
        w, n = w << np.uint64(8), n + 8
    if w < np.uint64(1 << 60):
        w, n = w << np.uint64(4), n + 4
    if w < np.uint64(1 << 62):
        w, n = w << np.uint64(2), n + 2
    if w < np.uint64(1 << 63):
        n += 1
    return n


@inlined
def nearest(w, q, tens, twos, small):
    """The double nearest to w 10^q, and whether that is decided."""
    if w == _U0:
        return 0.0, True
    if w <= _EXACT and -22 <= q <= 22:
        value = float(np.int64(w))
        return (value * small[q] if q >= 0 else value / small[-q]), True
    if q < LEAST or q > MOST:
        return 0.0, False
    shift = _zeros(w)
    w <<= np.uint64(shift)
    k = q - LEAST
    high, low = _product(w, tens[k, 0])
    normal = high >= _TOP
    h = high if normal else (high << _U1) | (low >> np.uint64(63))
    tail = h & _TAIL
    if _BELOW <= tail <= _MIDDLE:
        # too near to the middle between two doubles: 64 more bits of the power of ten
        more, _ = _product(w, tens[k, 1])
        low += more
        if low < more:
            high += _U1
        normal = high >= _TOP
        h = high if normal else (high << _U1) | (low >> np.uint64(63))
        rest = low if normal else low << _U1
        tail = h & _TAIL
        if (tail == _MIDDLE and rest < np.uint64(2)) or (tail == _MIDDLE - _U1 and rest >= _ALL_BUT):
            return 0.0, False
    # 2^(floor(log2 10^q) - 63) is the unit of the table, by 217706 / 2^16 = log2(10) for all q of the table
    unit = ((217706 * q) >> 16) - 63
    mantissa = np.int64(h >> _U11) + (1 if tail >= _MIDDLE else 0)
    return float(mantissa) * twos[unit + 75 - shift - (0 if normal else 1) - LEAST_TWO], True


@inlined
def scan(text, p):
    """Digits of a number at ``p``: its end, whether it is one, its sign, w, q, and whether digits were cut off."""
    negative = text[p] == 45
    if negative or text[p] == 43:
        p += 1
    first = p
    while text[p] == 48:
        p += 1
    begin = p  # of the digits that count
    w = _U0
    while True:
        d = np.int64(text[p]) - 48
        if d < 0 or d > 9:
            break
        w = w * _U10 + np.uint64(d)
        p += 1
    digits, n_digits, point, q = p - begin, p - first, p, 0
    if text[p] == 46:
        p += 1
        fraction = p
        if digits == 0:
            while text[p] == 48:
                p += 1
            begin = p
        counted = p
        while True:
            d = np.int64(text[p]) - 48
            if d < 0 or d > 9:
                break
            w = w * _U10 + np.uint64(d)
            p += 1
        digits += p - counted
        n_digits += p - fraction
        q = fraction - p
    good = n_digits > 0
    cut = False
    if digits > _DIGITS:  # w has overflowed: again, without the last digits
        w = _U0
        left = _DIGITS
        for k in range(begin, p):
            if k == point:
                continue
            if left > 0:
                w = w * _U10 + np.uint64(np.int64(text[k]) - 48)
                left -= 1
            else:
                cut |= text[k] != 48
        q += digits - _DIGITS
    if good and (text[p] == 101 or text[p] == 69):
        p += 1
        less = text[p] == 45
        if less or text[p] == 43:
            p += 1
        mark, power = p, 0
        while True:
            d = np.int64(text[p]) - 48
            if d < 0 or d > 9:
                break
            power = min(power * 10 + d, 100_000)
            p += 1
        good = p > mark
        q += -power if less else power
    return p, good, negative, w, q, cut


@inlined
def _is_word(text, p, small, capital):
    """Whether letters at ``p`` are those of a word, in whatever case."""
    for k in range(len(small)):
        c = text[p + k]
        if c != small[k] and c != capital[k]:
            return False  # at the latest at the end of the line
    return True


_NAN, _NAN_CAPITAL = np.frombuffer(b"nan", dtype=np.uint8), np.frombuffer(b"NAN", dtype=np.uint8)
_INF, _INF_CAPITAL = np.frombuffer(b"infinity", dtype=np.uint8), np.frombuffer(b"INFINITY", dtype=np.uint8)


@inlined
def _not_finite(text, p):
    """End of NaN or infinity at ``p`` (``p`` if there is neither), and its value."""
    sign = -1.0 if text[p] == 45 else 1.0
    q = p + 1 if text[p] == 45 or text[p] == 43 else p
    if _is_word(text, q, _NAN, _NAN_CAPITAL):
        return q + 3, np.nan
    if _is_word(text, q, _INF, _INF_CAPITAL):
        return q + 8, sign * np.inf
    if _is_word(text, q, _INF[:3], _INF_CAPITAL[:3]):
        return q + 3, sign * np.inf
    return p, 0.0


@inlined
def whole(w, q, rounded, powers):
    """The whole number w 10^q, the nearest (of two the even one) if it may be ``rounded``; whether there is one."""
    if q >= 0:
        if w == _U0:
            return np.int64(0), True
        if q > 18 or w > _LARGEST // powers[q]:
            return np.int64(0), False
        return np.int64(w * powers[q]), True
    if q < -18:
        return np.int64(0), False
    unit = powers[-q]
    value = w // unit
    rest = w - value * unit
    if rest != _U0:
        if not rounded:
            return np.int64(0), False
        half = unit // np.uint64(2)  # of an even number
        if rest > half or (rest == half and value & _U1 != _U0):
            value += _U1
    return np.int64(value), value <= _LARGEST


@inlined
def _line_end(text, p):
    """Start of the line behind a line feed or a carriage return and one at ``p``; -1 if there is neither."""
    if text[p] == 10:
        return p + 1
    if text[p] == 13 and text[p + 1] == 10:
        return p + 2
    return -1


@inlined
def _comment_end(text, p, comment):
    """End of the line, if a comment starts at ``p``; -1 if none does, or a carriage return stands within it."""
    for k in range(len(comment)):
        if text[p + k] != comment[k]:
            return -1
    while text[p] != 10 and text[p] != 13:
        p += 1
    return p


@kernel
def read_lines(text, rules, comment, target, decimals, rounded, tens, twos, small, powers, values, stamps, odd):
    """Numbers of the lines of a text that ends with a line feed.

    ``text`` uint8; ``rules`` class of each of 256 characters; ``comment`` the characters that start one; ``target`` for
    each column the row of ``values`` (k, n) it goes to, ``SKIPPED`` or ``WHOLE``, which goes to ``stamps`` (n,) in
    units of 10^-decimals; ``tens`` (596, 2) the leading 128 bits of powers of ten; ``twos``, ``small``, ``powers``
    powers of two, of ten as doubles (0 to 22), of ten as whole numbers (0 to 18).

    Numbers that are not decided go to ``odd`` (m, 4): row, row of ``values``, begin, end. Returns the rows, the odd
    ones, and where the line begins that is not understood, or the length of the text if all are: what is refused here
    is for slower code to judge.
    """
    blanks = rules[32] == DELIMITER  # any run of them is one
    between = DELIMITER if blanks else BLANK
    n_columns, n_odd, row, p, size = len(target), 0, 0, 0, len(text)
    while p < size:
        begin, first_odd = p, n_odd
        while rules[text[p]] == between:
            p += 1
        rule = rules[text[p]]
        if rule == COMMENT:
            p = _comment_end(text, p, comment)
            if p < 0:
                return row, n_odd, begin
            rule = rules[text[p]]
        if rule in (RETURN, END):
            p = _line_end(text, p)
            if p < 0:
                return row, n_odd, begin
            continue
        if row == values.shape[1]:
            return row, n_odd, begin
        column = 0
        while True:
            if column == n_columns:
                return row, first_odd, begin
            k = target[column]
            if k == SKIPPED:
                while True:
                    rule = rules[text[p]]
                    if rule == COMMENT and _comment_end(text, p, comment) >= 0:
                        break
                    if rule != NUMBER and rule != OTHER and rule != COMMENT and (rule != BLANK or blanks):
                        break
                    p += 1
            else:
                at = p
                p, good, negative, w, q, cut = scan(text, p)
                if k == WHOLE:
                    value, exact = whole(w, q + decimals, rounded, powers)
                    if cut or not good or not exact:
                        return row, first_odd, begin
                    stamps[row] = -value if negative else value
                elif good:
                    number, decided = nearest(w, q, tens, twos, small)
                    if cut and decided:
                        # between w and w + 1: decided if both round to the same
                        above, decided = nearest(w + _U1, q, tens, twos, small)
                        decided = decided and above == number
                    if decided:
                        values[k, row] = -number if negative else number
                    else:
                        if n_odd == len(odd):
                            return row, first_odd, begin
                        odd[n_odd, 0], odd[n_odd, 1], odd[n_odd, 2], odd[n_odd, 3] = row, k, at, p
                        n_odd += 1
                else:
                    p, number = _not_finite(text, at)
                    if p == at:
                        return row, first_odd, begin
                    values[k, row] = number
            column += 1
            apart = p
            while rules[text[p]] == between:
                p += 1
            rule = rules[text[p]]
            if rule == DELIMITER:
                p += 1
                while rules[text[p]] == BLANK:
                    p += 1
                continue
            if rule == COMMENT:
                p = _comment_end(text, p, comment)
                if p < 0:
                    return row, first_odd, begin
                rule = rules[text[p]]
            if rule in (RETURN, END):
                p = _line_end(text, p)
                if p < 0 or column != n_columns:
                    return row, first_odd, begin
                break
            if not blanks or p == apart:
                return row, first_odd, begin
        row += 1
    return row, n_odd, size


def prepare_lines() -> None:
    """Compile or load the kernel before it is run."""
    import numba as nb

    text = nb.types.Array(nb.uint8, 1, "C", readonly=True)
    whole, wide = nb.int64[::1], nb.uint64[::1]
    tables = (nb.uint64[:, ::1], nb.float64[::1], nb.float64[::1], wide)
    outputs = (nb.float64[:, ::1], whole, nb.int64[:, ::1])
    prepare([(read_lines, (text, nb.uint8[::1], text, whole, nb.int64, nb.boolean, *tables, *outputs))])
