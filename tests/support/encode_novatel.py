"""Encoder of NovAtel messages for the tests, apart from the reader: CRC bit by bit, struct instead of NumPy."""

import struct


def crc32(data: bytes) -> int:
    """NovAtel's CRC-32: polynomial 0xEDB88320, starts with zero, not inverted at the end."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def long_frame(number: int, week: int, ms: int, body: bytes, kind: int = 0) -> bytes:
    head = struct.pack(
        "<3sBHBBHHBBHIIHH", b"\xaa\x44\x12", 28, number, kind, 32, len(body), 0, 100, 180, week, ms, 0, 0, 1
    )
    return head + body + struct.pack("<I", crc32(head + body))


def short_frame(number: int, week: int, ms: int, body: bytes) -> bytes:
    head = struct.pack("<3sBHHI", b"\xaa\x44\x13", len(body), number, week, ms)
    return head + body + struct.pack("<I", crc32(head + body))


def rawimusx(week, sow, counts, imu=41, info=0):
    """Counts: ax, ay, az, gx, gy, gz along the IMU's axes."""
    ax, ay, az, gx, gy, gz = counts
    body = struct.pack("<BBHdIiiiiii", info, imu, week, sow, 0, az, -ay, ax, gz, -gy, gx)
    return short_frame(1462, week, round(sow * 1000), body)


def rawimu(week, sow, counts):
    ax, ay, az, gx, gy, gz = counts
    return long_frame(268, week, round(sow * 1000), struct.pack("<IdIiiiiii", week, sow, 0, az, -ay, ax, gz, -gy, gx))


def bestpos(week, sow, lat, lon, msl, undulation, sigma, kind=50, status=0, number=42, source=0):
    body = struct.pack("<IIdddfIfff4sffBBBBBBBB", status, kind, lat, lon, msl, undulation, 61, *sigma, b"0042", 1.0,
                       0.0, 20, 18, 18, 18, 0, 1, 51, 51)  # fmt: skip
    return long_frame(number, week, round(sow * 1000), body, source)


def bestvel(week, sow, latency, speed, track, up, number=99, kind=50):
    body = struct.pack("<IIffdddf", 0, kind, latency, 0.0, speed, track, up, 0.0)
    return long_frame(number, week, round(sow * 1000), body)


def inspvas(week, sow, llh, v, rpy, status=3):
    body = struct.pack("<IddddddddddI", week, sow, *llh, *v, *rpy, status)
    return short_frame(508, week, round(sow * 1000), body)


def inspvax(week, sow, llh, undulation, v, rpy, sigma, status=3):
    body = struct.pack(
        "<IIdddfdddddd9fIH", status, 56, *llh[:2], llh[2] - undulation, undulation, *v, *rpy, *sigma, 0, 0
    )
    return long_frame(1465, week, round(sow * 1000), body)


def heading2(week, sow, heading, sigma):
    body = struct.pack("<IIffffff4s4sBBBBBBBB", 0, 50, 1.2, heading, 0.5, 0.0, sigma, 0.3, b"ROVR", b"BASE", 9, 9, 9,
                       9, 0, 0, 0, 0)  # fmt: skip
    return long_frame(1335, week, round(sow * 1000), body)


def line(text: str) -> bytes:
    """ASCII message with its CRC."""
    return f"{text}*{crc32(text[1:].encode()):08x}\r\n".encode()
