"""Encoder of SBF blocks for the tests, apart from the reader: CRC bit by bit, struct instead of NumPy."""

import struct


def crc16(data: bytes) -> int:
    """CRC-CCITT, polynomial 0x1021, starts with zero."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def block(number: int, week: int, ms: int, body: bytes, revision: int = 0) -> bytes:
    body = struct.pack("<IH", ms, week) + body
    body += bytes(-(len(body) + 8) % 4)
    head = struct.pack("<HH", number | revision << 13, len(body) + 8)
    return b"$@" + struct.pack("<H", crc16(head + body)) + head + body


def pvt(week, ms, llh, v, mode=4, satellites=17, accuracy=None, error=0):
    """Radians and metres; velocity north, east, up."""
    body = struct.pack("<BBdddffffffdfBBBBHHIB".replace("ffffff", "fffff"), mode, error, *llh, 47.5, *v, 0.0, 0.1, 0.0,
                       0, 0, satellites, 0, 0, 0, 0, 0)  # fmt: skip
    if accuracy is None:
        return block(4007, week, ms, body)
    return block(4007, week, ms, body + struct.pack("<BHHHHB", 0, 0, 0, *accuracy, 0), 2)


def covariance(number, week, ms, nn, ee, uu, ne, nu, eu, mode=4):
    return block(number, week, ms, struct.pack("<BB10f", mode, 0, nn, ee, uu, 1.0, ne, nu, 0.0, eu, 0.0, 0.0))


def dilution(week, ms, horizontal, vertical):
    """In hundredths, 0 for none; position and time before, protection levels behind."""
    return block(4001, week, ms, struct.pack("<BBHHHHff", 17, 0, 150, 80, horizontal, vertical, 5.0, 8.0))


def attitude(week, ms, heading, pitch, roll, mode=2):
    return block(5938, week, ms, struct.pack("<BBHHffffff", 17, 0, mode, 0, heading, pitch, roll, 0.0, 0.0, 0.0))


def attitude_covariance(week, ms, heading):
    return block(5939, week, ms, struct.pack("<BB6f", 0, 0, heading, 1.0, 1.0, 0.0, 0.0, 0.0))


def ins(week, ms, llh, heading_pitch_roll, v_enu, parts=0b11111):
    body = struct.pack("<BBHHdddfHHBBH", 4, 0, 0, 0, *llh, 47.5, 1, 1, 0, 0, parts)
    for bit, triple in enumerate(((1, 2, 3), heading_pitch_roll, (4, 5, 6), v_enu, (7, 8, 9))):
        if parts >> bit & 1:
            body += struct.pack("<3f", *triple)
    return block(4226, week, ms, body)


def imu(week, ms, force, rate_deg, source=1, size=28):
    sets = []
    for kind, xyz in ((0, force), (1, rate_deg)):
        if xyz is not None:
            sets.append(struct.pack("<BBBBddd", source, 4, kind, 0, *xyz) + bytes(size - 28))
    sets.append(struct.pack("<BBBBh22x", source, 4, 3, 0, 2350) + bytes(size - 28))
    return block(4050, week, ms, struct.pack("<BB", len(sets), size) + b"".join(sets))
