"""Encoder of sbgECom frames for the tests, apart from the reader: CRC bit by bit, struct instead of NumPy."""

import struct


def crc16(data: bytes) -> int:
    """Polynomial 0x8408, lowest bit first, from zero."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def frame(number: int, body: bytes, group: int = 0) -> bytes:
    inner = struct.pack("<BBH", number, group, len(body)) + body
    return b"\xff\x5a" + inner + struct.pack("<HB", crc16(inner), 0x33)


def us(t):
    return round(t * 1e6) & 0xFFFFFFFF


def imu_short(t, force, rate, temperature=21.5, high=False):
    scale = 12304174 if high else 67108864
    counts = [round(x * 1048576) for x in force] + [round(x * scale) for x in rate]
    return frame(44, struct.pack("<IH6ih", us(t), 0x3FF | high << 10, *counts, round(temperature * 256)))


def imu_data(t, force, rate, temperature=21.5):
    return frame(3, struct.pack("<IH3f3ff6f", us(t), 0x3FF, *force, *rate, temperature, *(0.0,) * 6))


def utc(t, calendar, nano, tow_ms, valid=2):
    return frame(2, struct.pack("<IHHBBBBBII3f", us(t), valid << 6 | 7, *calendar, nano, tow_ms, 0.0, 0.0, 0.0))


def gps_pos(t, tow_ms, llh, undulation, sigma, kind=7, status=0, number=14):
    """Degrees and height above sea level."""
    body = struct.pack("<III3d4fBHH", us(t), status | kind << 6, tow_ms, *llh, undulation, *sigma, 19, 1, 100)
    return frame(number, body)


def gps_vel(t, tow_ms, v, sigma, status=0, number=13):
    return frame(number, struct.pack("<III3f3f2f", us(t), status | 2 << 6, tow_ms, *v, *sigma, 0.0, 1.0))


def ekf_nav(t, v, llh, undulation, mode=4):
    return frame(8, struct.pack("<I6f3d4fI", us(t), *v, 0.1, 0.1, 0.1, *llh, undulation, 0.3, 0.4, 0.6, mode | 0xF0))


def ekf_euler(t, rpy, mode=4):
    return frame(6, struct.pack("<I6fI", us(t), *rpy, 0.01, 0.01, 0.02, mode | 0xF0))


def ekf_quat(t, q, mode=4):
    return frame(7, struct.pack("<I4f3fI2f", us(t), *q, 0.01, 0.01, 0.02, mode | 0xF0, 0.0, 0.0))
