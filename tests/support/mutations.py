"""Damage to files, drawn from a seed: the same numbers give the same damage on every machine."""

import struct
from collections.abc import Callable

import numpy as np

TOKENS = (
    b"nan", b"inf", b"1e999", b"-", b"", b",", b"\n", b"\x00", b"\xff" * 8, b"9" * 30, b"#", b'"', b" ", b"0x1", b"1_0",
    b"\xef\xbb\xbf", b"-1e300", b"\x7f\xf0" + bytes(6), bytes(6) + b"\xf0\x7f", bytes(6) + b"\xf8\x7f", b"\x7f" * 4,
    b"\r", b"\x1a", b"%", b"0", b"[", b"]", b";", b"\t",
)  # fmt: skip
#: Counts, lengths and offsets that break parsers: none, minus one, and two gigabytes or more.
CLAIMS = (0, 1, -1, 255, 32_767, 65_535, 2**31 - 1, -(2**31), 2**31, 2**32 - 1, 2**40, 2**63 - 1, -(2**63))


def damaged(good: bytes, seed: int) -> bytes:
    """A file with bytes replaced, removed, repeated, put in or swapped, numbers overwritten, or cut off."""
    rng = np.random.default_rng(seed)
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 5))):
        n = len(data)
        if not n:
            break
        # half of the damage is done to the beginning, where the headers are
        at = int(rng.integers(min(n, 400) if rng.random() < 0.5 else n))
        size = int(rng.choice((1, 2, 4, 8, 40)))
        match int(rng.integers(9)):
            case 0:
                data[at : at + 1] = bytes([data[at] ^ (1 << int(rng.integers(8)))])
            case 1:
                data[at : at + size] = rng.bytes(size)
            case 2:
                data[at : at + size] = TOKENS[int(rng.integers(len(TOKENS)))]
            case 3:
                del data[at : at + size]
            case 4:
                data[at:at] = data[at : at + int(rng.choice((8, 80, 136)))]
            case 5 | 6:
                width = int(rng.choice((1, 2, 4, 8)))
                value = CLAIMS[int(rng.integers(len(CLAIMS)))] % (1 << 8 * width)
                data[at : at + width] = value.to_bytes(width, "little" if rng.random() < 0.6 else "big")
            case 7:
                other = int(rng.integers(n))
                a, b = bytes(data[at : at + size]), bytes(data[other : other + size])
                if len(a) == len(b):
                    data[at : at + size], data[other : other + size] = b, a
            case _:
                if rng.random() < 0.5:
                    del data[at:]
    return bytes(data)


# Checksums made right again, so that damage reaches the reader behind them


def ubx(data: bytes) -> bytes:
    """Sums of all frames that still begin as one."""
    out, at = bytearray(data), 0
    while (at := bytes(out).find(b"\xb5\x62", at)) >= 0 and at + 8 <= len(out):
        end = at + 6 + struct.unpack_from("<H", out, at + 4)[0]
        if end + 2 > len(out):
            at += 2
            continue
        a = b = 0
        for byte in out[at + 2 : end]:
            a = (a + byte) & 0xFF
            b = (b + a) & 0xFF
        out[end : end + 2] = bytes((a, b))
        at = end + 2
    return bytes(out)


def nmea(data: bytes) -> bytes:
    """Checksums of all sentences."""
    lines = []
    for line in data.split(b"\n"):
        body, star, _ = line.partition(b"*")
        if star and body.startswith(b"$"):
            total = 0
            for byte in body[1:]:
                total ^= byte
            line = body + f"*{total:02X}\r".encode()
        lines.append(line)
    return b"\n".join(lines)


def checked(again: Callable[[bytes], bytes]) -> Callable[[bytes, int], bytes]:
    """Damage with the checksums made right in every other case."""

    def damage(good: bytes, seed: int) -> bytes:
        data = damaged(good, seed)
        return again(data) if seed % 2 else data

    return damage


def repacked(unpack: Callable[[bytes], bytes], pack: Callable[[bytes], bytes]) -> Callable[[bytes, int], bytes]:
    """Damage to what is packed, in every other case, instead of to the packed bytes."""

    def damage(good: bytes, seed: int) -> bytes:
        return pack(damaged(unpack(good), seed)) if seed % 2 else damaged(good, seed)

    return damage
