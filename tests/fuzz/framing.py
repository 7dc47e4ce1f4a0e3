"""Frames of binary logs: cut apart, changed, and sealed again with the length and checksum their format asks for.

Damage of bytes is caught by checksums; what stands behind them is only reached by frames that pass.
"""

import binascii
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Framing:
    """How the frames of a format begin, where their payload is, and how they are sealed.

    ``split`` returns frames and what is between them, in order; ``seal`` a frame with its length and checksum right.
    ``length`` is the place and the code of the length field, for lies about it (sealed by ``sum_only``).
    """

    split: Callable[[bytes], list[bytes]]
    seal: Callable[[bytes], bytes]
    head: int
    tail: int
    length: tuple[int, str] | None = None
    sum_only: Callable[[bytes], bytes] = bytes


def cut(data: bytes, size: Callable[[bytes, int], int | None]) -> list[bytes]:
    """Pieces of a log, by a function that says how long the frame is that begins at a place (``None``: none does)."""
    pieces, at, loose = [], 0, 0
    while at < len(data):
        n = size(data, at)
        if n is None or n <= 0 or at + n > len(data):
            at += 1
            continue
        if loose < at:
            pieces.append(data[loose:at])
        pieces.append(data[at : at + n])
        at = loose = at + n
    return pieces + ([data[loose:]] if loose < len(data) else [])


# u-blox


def _ubx_sum(frame: bytes) -> bytes:
    a = b = 0
    for byte in frame[2:-2]:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return frame[:-2] + bytes((a, b))


def _ubx_size(data: bytes, at: int) -> int | None:
    return (
        8 + struct.unpack_from("<H", data, at + 4)[0] if data[at : at + 2] == b"\xb5b" and at + 6 <= len(data) else None
    )


def _lengthened(frame: bytes, at: int, code: str, value: int) -> bytes:
    size = struct.calcsize(code)
    return frame[:at] + struct.pack(code, value % (1 << 8 * size)) + frame[at + size :]


UBX = Framing(
    lambda data: cut(data, _ubx_size),
    lambda f: _ubx_sum(_lengthened(f, 4, "<H", len(f) - 8)), 6, 2, (4, "<H"), _ubx_sum,
)  # fmt: skip

# Septentrio


def _sbf_sum(frame: bytes) -> bytes:
    return frame[:2] + struct.pack("<H", binascii.crc_hqx(frame[4:], 0)) + frame[4:]


def _sbf_seal(frame: bytes) -> bytes:
    frame += bytes(-len(frame) % 4)
    return _sbf_sum(_lengthened(frame, 6, "<H", len(frame)))


def _sbf_size(data: bytes, at: int) -> int | None:
    return struct.unpack_from("<H", data, at + 6)[0] if data[at : at + 2] == b"$@" and at + 8 <= len(data) else None


SBF = Framing(
    lambda data: cut(data, _sbf_size), _sbf_seal, 8, 0, (6, "<H"), _sbf_sum,
)  # fmt: skip

# NovAtel: long and short headers


def _novatel_sum(frame: bytes) -> bytes:
    return frame[:-4] + struct.pack("<I", zlib.crc32(frame[:-4], 0xFFFFFFFF) ^ 0xFFFFFFFF)


def _novatel_size(data: bytes, at: int) -> int | None:
    if data[at : at + 3] == b"\xaaD\x12" and at + 10 <= len(data):
        return data[at + 3] + struct.unpack_from("<H", data, at + 8)[0] + 4
    if data[at : at + 3] == b"\xaaD\x13" and at + 4 <= len(data):
        return 12 + data[at + 3] + 4
    return None


def _novatel_seal(frame: bytes) -> bytes:
    if frame[2:3] == b"\x12":
        frame = _lengthened(frame, 8, "<H", len(frame) - 32)
    elif len(frame) > 16:
        frame = _lengthened(frame, 3, "<B", min(len(frame) - 16, 255))
    return _novatel_sum(frame)


NOVATEL = Framing(lambda data: cut(data, _novatel_size), _novatel_seal, 12, 4, (8, "<H"), _novatel_sum)

# Xsens


def _xsens_sum(frame: bytes) -> bytes:
    return frame[:-1] + bytes([-sum(frame[1:-1]) & 0xFF])


def _xsens_size(data: bytes, at: int) -> int | None:
    if data[at : at + 2] != b"\xfa\xff" or at + 6 > len(data):
        return None
    return 5 + data[at + 3] if data[at + 3] < 255 else 7 + struct.unpack_from(">H", data, at + 4)[0]


def _xsens_seal(frame: bytes) -> bytes:
    short = len(frame) > 3 and frame[3] < 255
    return _xsens_sum(_lengthened(frame, 3, ">B", min(len(frame) - 5, 254)) if short else frame)


XSENS = Framing(lambda data: cut(data, _xsens_size), _xsens_seal, 4, 1, (3, ">B"), _xsens_sum)

# VectorNav: a packet has no length; it ends where its CRC comes out right


def _vectornav_size(data: bytes, at: int) -> int | None:
    if data[at] != 0xFA:
        return None
    return next(
        (n for n in range(8, 400) if at + n <= len(data) and not binascii.crc_hqx(data[at + 1 : at + n], 0)), None
    )


def _vectornav_seal(frame: bytes) -> bytes:
    return frame[:-2] + struct.pack(">H", binascii.crc_hqx(frame[1:-2], 0))


VECTORNAV = Framing(lambda data: cut(data, _vectornav_size), _vectornav_seal, 1, 2, None, _vectornav_seal)

# SBG Systems


def _sbg_crc(body: bytes) -> int:
    crc = 0
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0x8408 if crc & 1 else crc >> 1
    return crc


def _sbg_sum(frame: bytes) -> bytes:
    return frame[:-3] + struct.pack("<H", _sbg_crc(frame[2:-3])) + frame[-1:]


def _sbg_size(data: bytes, at: int) -> int | None:
    begins = data[at : at + 2] == b"\xffZ" and at + 6 <= len(data)
    return 9 + struct.unpack_from("<H", data, at + 4)[0] if begins else None


SBG = Framing(
    lambda data: cut(data, _sbg_size),
    lambda f: _sbg_sum(_lengthened(f, 4, "<H", len(f) - 9)), 6, 3, (4, "<H"), _sbg_sum,
)  # fmt: skip

# ArduPilot: no checksums, messages of the length their format message says; ULog: size and type before each


def _dataflash(data: bytes) -> list[bytes]:
    return [piece for piece in re.split(rb"(?=\xa3\x95)", data) if piece]


def _ulog(data: bytes) -> list[bytes]:
    return [
        data[:16],
        *cut(data[16:], lambda d, at: 3 + struct.unpack_from("<H", d, at)[0] if at + 3 <= len(d) else None),
    ]


def _ulog_seal(frame: bytes) -> bytes:
    return frame if frame.startswith(b"ULog") else _lengthened(frame, 0, "<H", len(frame) - 3)


DATAFLASH = Framing(_dataflash, bytes, 3, 0)
ULOG = Framing(_ulog, _ulog_seal, 3, 0, (0, "<H"))

# MCAP and bags: records with lengths before them; chunks of the seeds are not packed, their sums are zero


def _mcap(data: bytes) -> list[bytes]:
    inner = cut(data[8:-8], lambda d, at: 9 + struct.unpack_from("<Q", d, at + 1)[0] if at + 9 <= len(d) else None)
    return [data[:8], *inner, data[-8:]]


MCAP = Framing(
    _mcap, lambda f: f if f.startswith(b"\x89MCAP") else _lengthened(f, 1, "<Q", len(f) - 9), 9, 0, (1, "<Q")
)


def _bag_size(data: bytes, at: int) -> int | None:
    if at + 8 > len(data):
        return None
    head = struct.unpack_from("<I", data, at)[0]
    body = at + 4 + head
    return None if body + 4 > len(data) else 8 + head + struct.unpack_from("<I", data, body)[0]


def _bag(data: bytes) -> list[bytes]:
    start = data.find(b"\n") + 1
    return [data[:start], *cut(data[start:], _bag_size)]


BAG = Framing(_bag, bytes, 4, 0, (0, "<I"))

# Lines with a sum behind a star


def _lines(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True)


def _star(line: bytes) -> bytes:
    """NMEA's exclusive or, VectorNav's, and NovAtel's CRC of 32 bits, as the line had it."""
    body, star, rest = line.rpartition(b"*")
    if not star or not body:
        return line
    old = rest.strip()
    if body[:1] in (b"#", b"%"):
        new = b"%08x" % (zlib.crc32(body[1:], 0xFFFFFFFF) ^ 0xFFFFFFFF)
    elif len(old) == 4:
        new = b"%04X" % binascii.crc_hqx(body[1:], 0)
    else:
        total = 0
        for byte in body[1:]:
            total ^= byte
        new = b"%02X" % total
    return body + b"*" + new + rest[len(old) :]


STARRED = Framing(_lines, _star, 1, 5, None, _star)

#: Framings by format; a log may hold frames of two of them.
FRAMINGS: dict[str, tuple[Framing, ...]] = {
    "ubx": (UBX, STARRED), "sbf": (SBF,), "novatel": (NOVATEL, STARRED), "xsens": (XSENS,), "vectornav": (VECTORNAV,),
    "sbg": (SBG,), "ardupilot": (DATAFLASH,), "px4": (ULOG,), "mcap": (MCAP,), "mcap_ros2": (MCAP,), "rosbag": (BAG,),
    "nmea": (STARRED,), "vectornav_lines": (STARRED,),
}  # fmt: skip
