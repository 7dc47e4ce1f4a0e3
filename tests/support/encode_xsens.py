"""Encoder of Xsens messages for the tests, apart from the reader."""

import struct

CODES = {"single": 0, "12.20": 1, "16.32": 2, "double": 3}


def numbers(values, form="single") -> bytes:
    if form == "16.32":
        out = b""
        for v in values:
            raw = round(v * 2**32)
            out += struct.pack(">Ih", raw & 0xFFFFFFFF, raw >> 32)
        return out
    if form == "12.20":
        return b"".join(struct.pack(">i", round(v * 2**20)) for v in values)
    return struct.pack(f">{len(values)}{'f' if form == 'single' else 'd'}", *values)


def item(identifier, body) -> bytes:
    return struct.pack(">HB", identifier, len(body)) + body


def vector(identifier, values, form="single", system=0) -> bytes:
    """An item of numbers; ``system`` 0 ENU, 4 NED, 8 NWU."""
    return item(identifier | CODES[form] | system, numbers(values, form))


def fine(ticks) -> bytes:
    return item(0x1060, struct.pack(">I", ticks & 0xFFFFFFFF))


def counter(n) -> bytes:
    return item(0x1020, struct.pack(">H", n & 0xFFFF))


def utc(year, month, day, hour, minute, second, nano, flags=7) -> bytes:
    return item(0x1010, struct.pack(">IHBBBBBB", nano, year, month, day, hour, minute, second, flags))


def gnss(itow, calendar, llh, v, accuracy, fix=3, flags=1) -> bytes:
    """Degrees and metres; accuracies horizontal, vertical, of speed."""
    mm = [round(1e3 * x) for x in (llh[2], llh[2] - 47.0)]
    body = struct.pack(">IHBBBBBBIi", itow, *calendar, 7, 20, 0)
    body += struct.pack(">BBBBiiii", fix, flags, 11, 0, round(llh[1] * 1e7), round(llh[0] * 1e7), *mm)
    body += struct.pack(">IIiiiiiI", *(round(1e3 * a) for a in accuracy[:2]), *(round(1e3 * x) for x in v), 0, 0,
                        round(1e3 * accuracy[2]))  # fmt: skip
    return item(0x7010, body + bytes(94 - len(body)))


def message(payload: bytes, kind: int = 0x36) -> bytes:
    length = bytes([len(payload)]) if len(payload) < 255 else b"\xff" + struct.pack(">H", len(payload))
    body = b"\xff" + bytes([kind]) + length + payload
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])
