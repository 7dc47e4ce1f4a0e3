"""Encoder of VectorNav packets for the tests, apart from the reader: fields by name, checksums bit by bit."""

import struct


def crc16(data: bytes) -> int:
    """As in VectorNav's manual: swap bytes and fold."""
    crc = 0
    for byte in data:
        crc = (crc >> 8 | crc << 8) & 0xFFFF
        crc ^= byte
        crc ^= (crc & 0xFF) >> 4
        crc ^= (crc << 12) & 0xFFFF
        crc ^= (crc & 0xFF) << 5
        crc &= 0xFFFF
    return crc


# group, bit, struct format
FIELDS = {
    "TimeStartup": (0, 0, "<Q"), "TimeGps": (0, 1, "<Q"), "Ypr": (0, 3, "<3f"), "Quaternion": (0, 4, "<4f"),
    "AngularRate": (0, 5, "<3f"), "Position": (0, 6, "<3d"), "Velocity": (0, 7, "<3f"), "Accel": (0, 8, "<3f"),
    "Imu": (0, 9, "<6f"), "MagPres": (0, 10, "<5f"), "Deltas": (0, 11, "<7f"), "InsStatus": (0, 12, "<H"),
    "GpsTow": (1, 2, "<Q"), "GpsWeek": (1, 3, "<H"), "TimeStatus": (1, 9, "<B"),
    "ImuStatus": (2, 0, "<H"), "UncompAccel": (2, 2, "<3f"), "UncompGyro": (2, 3, "<3f"), "Temp": (2, 4, "<f"),
    "DeltaTheta": (2, 6, "<4f"), "DeltaVel": (2, 7, "<3f"),
    "FixTow": (3, 1, "<Q"), "FixWeek": (3, 2, "<H"), "NumSats": (3, 3, "<B"), "Fix": (3, 4, "<B"),
    "FixLla": (3, 5, "<3d"), "FixVel": (3, 7, "<3f"), "FixPosU": (3, 9, "<3f"), "FixVelU": (3, 10, "<f"),
    "VpeStatus": (4, 0, "<H"), "AttYpr": (4, 1, "<3f"), "Dcm": (4, 3, "<9f"),
    "Ins": (5, 0, "<H"), "InsLla": (5, 1, "<3d"), "InsVel": (5, 4, "<3f"), "InsPosU": (5, 9, "<f"),
    "RawMeas": (3, 15, "<12s"),
}  # fmt: skip


def packet(**values) -> bytes:
    placed = sorted((*FIELDS[name][:2], FIELDS[name][2], value) for name, value in values.items())
    groups = sorted({group for group, *_ in placed})
    head = bytes([sum(1 << group for group in groups)])
    for group in groups:
        head += struct.pack("<H", sum(1 << bit for g, bit, *_ in placed if g == group))
    body = b"".join(struct.pack(form, *(value if isinstance(value, tuple) else (value,))) for *_, form, value in placed)
    return b"\xfa" + head + body + struct.pack(">H", crc16(head + body))


def line(text: str, *, long: bool = False) -> bytes:
    """``$VN...*`` with the checksum of one byte, or of two."""
    if long:
        return f"${text}*{crc16(text.encode()):04X}\r\n".encode()
    checksum = 0
    for byte in text.encode():
        checksum ^= byte
    return f"${text}*{checksum:02X}\r\n".encode()
