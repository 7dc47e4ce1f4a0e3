"""Damage that knows the structure of what it damages, drawn from a seed: the same numbers on every machine.

Text is changed by fields, decimal points, separators, columns and lines; binary logs by numbers, counts and frames
whose lengths and checksums are made right again (:mod:`tests.fuzz.framing`). A part of all damage is that of
``tests/support/mutations.py``, which knows nothing.
"""

import functools
import gzip
import math
import random
import re
import struct
from collections.abc import Callable

import mutations
from tests.fuzz.framing import FRAMINGS, Framing

WORDS = (
    "", "nan", "inf", "-inf", "-nan", "1e999", "1e308", "-1e300", "1e-320", "-0", "1e15", "-9.8e15", "9.8e18", "1000",
    "-1000", "100000", "1e9", "-1e9", "1e12", "1e24", "4294967295", "2147483648", "-1", "0", "1e5", "90.0001", "360.5",
    "0.0037_1", "1_0", "0x1p3", "0x10", "1,5", "--1", "+-1", "1e", "1e+", ".", "-", "e5", "1d3", "1D+03", "²", "٣",
    "1.2.3", "1 2", '"', '"1"', "NaN(1)", "TRUE", "None", "NULL", "#N/A", "*", "********", "\x00", "\u2212" + "1",
    "9" * 30,
    "9" * 400, "0." + "0" * 400 + "1", "2025-13-45", "99:99:99", "24:00:60", "A", "é", "%s", "{}", "=1+1", "[", "{",
)  # fmt: skip
FLOATS = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e300, -1e300, 1e-310, 1e15, -9.8e15, 1e24, 1e12, 1e9, -1e9, 1000.0,
    -1000.0, 1e5, 4294967295.0, 91.0, -1.0, 3.4e38, 1e-30,
)  # fmt: skip
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eEdD][-+]?\d+)?")
SEPARATORS = (",", ";", "\t", " ", "|", ", ", "  ", ":", "/")
LINES = (
    "", " ", "#", "# x", ",", "\x00", "1", "\t", "%", "END OF HEADER", "0 0 0 0 0 0 0", "nan nan nan nan nan nan nan",
    "t,ax,ay,az,gx,gy,gz", "{", "}", "\x1a", "\ufeff", "$GPGGA", "9" * 3000,
)  # fmt: skip


def damage(name: str, good: bytes, seed: int) -> bytes:
    """A damaged log of the format of a target."""
    rng = random.Random(seed)
    draw = rng.random()
    if draw < 0.12:
        return mutations.damaged(good, seed)
    if name in PACKED:
        pack = PACKED[name][1]
        return pack(_by_structure(name, unpacked(name, good), rng)) if draw < 0.9 else _by_structure(name, good, rng)
    return _by_structure(name, good, rng)


@functools.lru_cache(256)
def unpacked(name: str, good: bytes) -> bytes:
    return PACKED[name][0](good)


def _by_structure(name: str, good: bytes, rng: random.Random) -> bytes:
    for framing in FRAMINGS.get(name, ()):
        if rng.random() < 0.75:
            return by_frames(good, rng, framing)
    if is_text(good):
        return by_text(good, rng)
    return by_numbers(good, rng)


@functools.lru_cache(256)
def is_text(data: bytes) -> bool:
    return b"\x00" not in data and sum(byte > 126 or byte < 9 for byte in data[:2000]) < 20


# text


@functools.lru_cache(256)
def _text(data: bytes) -> tuple[str, tuple[str, ...], str]:
    """The text, its lines, and the separator most frequent in them."""
    text = data.decode("utf-8", "surrogateescape")
    counts = {s: text.count(s) for s in (",", ";", "\t", " ")}
    separator = max(counts, key=lambda s: counts[s] * (0.2 if s == " " else 1.0))
    return text, tuple(text.split("\n")), separator


def by_text(good: bytes, rng: random.Random) -> bytes:
    """One to three changes of fields, numbers, separators, columns or lines."""
    _, rows, separator = _text(good)
    lines = list(rows)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if lines:
            rng.choice(_TEXT)(lines, separator, rng)
    data = "\n".join(lines).encode("utf-8", "surrogateescape")
    draw = rng.random()
    if draw < 0.02:
        return data.replace(b"\n", b"\r\n")
    if draw < 0.03:
        return data.decode("utf-8", "replace").encode("utf-16")
    return data[: rng.randrange(len(data) + 1)] if draw < 0.08 else data


def _line(lines: list[str], rng: random.Random) -> int:
    """A third of the changes is made to the first lines, where the headers are."""
    return rng.randrange(min(len(lines), 8)) if rng.random() < 0.33 else rng.randrange(len(lines))


def _field(lines: list[str], separator: str, rng: random.Random) -> None:
    k = _line(lines, rng)
    fields = lines[k].split(separator)
    j = rng.randrange(len(fields))
    match rng.randrange(5):
        case 0:
            del fields[j]
        case 1:
            fields.insert(j, fields[rng.randrange(len(fields))])
        case 2:
            i = rng.randrange(len(fields))
            fields[i], fields[j] = fields[j], fields[i]
        case _:
            fields[j] = rng.choice(WORDS)
    lines[k] = separator.join(fields)


def _number(lines: list[str], separator: str, rng: random.Random) -> None:
    """A number whose decimal point, sign, exponent or digits are wrong; in fixed columns it keeps its width."""
    k = _line(lines, rng)
    numbers = list(NUMBER.finditer(lines[k]))
    if not numbers:
        return
    match = rng.choice(numbers)
    old = match.group()
    match rng.randrange(8):
        case 0:
            new = old.replace(".", "", 1)
        case 1:
            digits = old.replace(".", "")
            at = rng.randrange(len(digits) + 1)
            new = digits[:at] + "." + digits[at:]
        case 2:
            new = old.replace(".", ",")
        case 3:
            new = old[1:] if old[0] in "+-" else "-" + old
        case 4:
            new = old + rng.choice(("e5", "e15", "e-300", "e300", "D+05", "00000", "0" * 12, "_1"))
        case 5:
            at = rng.randrange(len(old))
            new = old[:at] + rng.choice("0123456789.-+eE _,²") + old[at + 1 :]
        case 6:
            new = old[: rng.randrange(len(old))]
        case _:
            word = rng.choice(WORDS)
            new = word[: len(old)].rjust(len(old)) if rng.random() < 0.5 else word
    if rng.random() < 0.3:
        new = new[: len(old)].ljust(len(old))
    lines[k] = lines[k][: match.start()] + new + lines[k][match.end() :]


def _separator(lines: list[str], separator: str, rng: random.Random) -> None:
    k = _line(lines, rng)
    new = rng.choice(SEPARATORS)
    if rng.random() < 0.2:
        lines[:] = [line.replace(separator, new) for line in lines]
    elif rng.random() < 0.5:
        lines[k] = lines[k].replace(separator, new)
    else:
        parts = lines[k].split(separator)
        at = rng.randrange(len(parts))
        lines[k] = separator.join(parts[:at]) + new + separator.join(parts[at:])


def _column(lines: list[str], separator: str, rng: random.Random) -> None:
    """One column of all rows: scaled, made constant, not a number, empty or taken out."""
    j = rng.randrange(max(line.count(separator) for line in lines) + 1)
    kind, factor = rng.randrange(5), rng.choice((1e3, 1e6, 1e9, 1e15, 1e-9, -1.0, 0.0))
    word = rng.choice(WORDS)
    first = rng.choice((0, 1, 1, 2, len(lines) // 2))
    for k in range(first, len(lines)):
        fields = lines[k].split(separator)
        if j >= len(fields):
            continue
        try:
            value = float(fields[j])
        except ValueError:
            continue
        if kind == 0:
            fields[j] = repr(value * factor)
        elif kind == 1:
            fields[j] = word
        elif kind == 2:
            del fields[j]
        elif kind == 3:
            fields[j] = fields[j].replace(".", ",")
        else:
            fields[j] = repr(value + factor)
        lines[k] = separator.join(fields)


def _rows(lines: list[str], separator: str, rng: random.Random) -> None:
    k, n = _line(lines, rng), len(lines)
    match rng.randrange(9):
        case 0:
            del lines[k]
        case 1:
            lines.insert(k, lines[rng.randrange(n)])
        case 2:
            i = rng.randrange(n)
            lines[i], lines[k] = lines[k], lines[i]
        case 3:
            lines.insert(k, rng.choice(LINES))
        case 4:
            lines[k] = lines[k][: rng.randrange(len(lines[k]) + 1)]
        case 5:
            if k + 1 < n:
                lines[k : k + 2] = [lines[k] + lines[k + 1]]
        case 6:
            del lines[k : k + rng.choice((2, 10, 1000))]
        case 7:
            lines[k:k] = lines[k : k + rng.choice((2, 10))]
        case _:
            lines[k] = rng.choice(LINES)


def _character(lines: list[str], separator: str, rng: random.Random) -> None:
    k = _line(lines, rng)
    at = rng.randrange(len(lines[k]) + 1)
    new = rng.choice(
        ("", "\x00", "\udcff", '"', "'", "\\", "%", "#", "\r", "\x0b", " ", "0", "9", "-", "E", "²", "\u2028")
    )
    lines[k] = lines[k][:at] + new + lines[k][at + rng.randrange(2) :]


_TEXT: tuple[Callable[[list[str], str, random.Random], None], ...] = (
    _field, _field, _number, _number, _number, _rows, _rows, _separator, _column, _character,
)  # fmt: skip


# binary


def by_numbers(good: bytes, rng: random.Random) -> bytes:
    """Numbers of either kind replaced by those that break readers, or made a thousand times as large."""
    data = bytearray(good)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        change_number(data, 0, len(data), rng)
    draw = rng.random()
    if draw < 0.05:
        del data[rng.randrange(len(data) + 1) :]
    elif draw < 0.1:
        at = rng.randrange(len(data) + 1)
        data[at:at] = rng.randbytes(rng.choice((1, 2, 4, 8)))
    return bytes(data)


def change_number(data: bytearray, start: int, stop: int, rng: random.Random) -> None:
    """A float or a count between two places, overwritten."""
    if stop <= start:
        return
    at = start + min(rng.randrange(stop - start), rng.randrange(stop - start) if rng.random() < 0.3 else stop)
    order = "<" if rng.random() < 0.85 else ">"
    code = rng.choice("ddffBHIQ")
    size = struct.calcsize(code)
    if rng.random() < 0.6:
        at -= (at - start) % size
    if at + size > stop:
        return
    if code in "df":
        try:
            old = struct.unpack_from(order + code, data, at)[0]
            value = rng.choice(FLOATS) if rng.random() < 0.6 else old * rng.choice((1e3, 1e-3, 1e6, 1e15, -1.0, 100.0))
            struct.pack_into(order + code, data, at, value)
        except OverflowError:
            struct.pack_into(order + code, data, at, math.inf)
        return
    value = rng.choice(mutations.CLAIMS) if rng.random() < 0.7 else rng.getrandbits(64)
    struct.pack_into(order + code, data, at, value % (1 << 8 * size))


@functools.lru_cache(256)
def _pieces(good: bytes, framing: Framing) -> tuple[bytes, ...]:
    pieces = tuple(framing.split(good))
    assert b"".join(pieces) == good
    return pieces


def by_frames(good: bytes, rng: random.Random, framing: Framing) -> bytes:
    """Frames repeated, left out, swapped, cut, lengthened, or with other numbers in them; most are sealed again."""
    pieces = list(_pieces(good, framing))
    for _ in range(rng.choice((1, 1, 2, 3))):
        if not pieces:
            break
        k = rng.randrange(len(pieces))
        frame = pieces[k]
        match rng.randrange(10):
            case 0:
                del pieces[k]
            case 1:
                pieces.insert(rng.randrange(len(pieces) + 1), frame)
            case 2:
                j = rng.randrange(len(pieces))
                pieces[j], pieces[k] = frame, pieces[j]
            case 3:
                body = frame[framing.head : len(frame) - framing.tail]
                keep = rng.randrange(len(body) + 1)
                tail = frame[len(frame) - framing.tail :]
                pieces[k] = _sealed(frame[: framing.head] + body[:keep] + tail, framing, rng)
            case 4:
                at = rng.randrange(len(frame) + 1)
                pieces[k] = _sealed(frame[:at] + rng.randbytes(rng.choice((1, 2, 4, 8, 40))) + frame[at:], framing, rng)
            case 5 if framing.length is not None:
                at, code = framing.length
                size = struct.calcsize(code)
                if len(frame) >= at + size:
                    lie = rng.choice((*mutations.CLAIMS, rng.getrandbits(8 * size), len(frame), len(frame) - 1))
                    frame = frame[:at] + struct.pack(code, lie % (1 << 8 * size)) + frame[at + size :]
                    pieces[k] = framing.sum_only(frame) if len(frame) > 8 else frame
            case 6:
                # a whole column: the same number of every frame of this length
                size = len(frame)
                changed = bytearray(frame)
                change_number(changed, min(framing.head, size), max(size - framing.tail, 0), rng)
                where = [i for i in range(size) if changed[i] != frame[i]]
                for j, other in enumerate(pieces):
                    if len(other) == size and where:
                        made = bytearray(other)
                        for i in where:
                            made[i] = changed[i]
                        pieces[j] = _sealed(bytes(made), framing, rng)
            case _:
                changed = bytearray(frame)
                first = framing.head if rng.random() < 0.8 else 0
                if is_text(frame):
                    changed = bytearray(by_text(frame.rstrip(b"\r\n"), rng)) + b"\r\n"
                else:
                    change_number(changed, min(first, len(frame)), max(len(frame) - framing.tail, 0), rng)
                pieces[k] = _sealed(bytes(changed), framing, rng)
    return b"".join(pieces)


def _sealed(frame: bytes, framing: Framing, rng: random.Random) -> bytes:
    if len(frame) < framing.head + framing.tail or rng.random() < 0.05:
        return frame
    try:
        return framing.seal(frame)
    except (struct.error, IndexError):  # too short to hold what would be made right
        return frame


# packed logs: what is inside is damaged, and packed again


def _unzip(data: bytes) -> bytes:
    import io
    import zipfile

    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.read("imu.npy")


def _rezip(data: bytes) -> bytes:
    import io
    import zipfile

    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("imu.npy", data)
    return stream.getvalue()


PACKED: dict[str, tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]] = {
    "rinex_gzip": (gzip.decompress, functools.partial(gzip.compress, compresslevel=1, mtime=0)),
    "npz": (_unzip, _rezip),
}
