"""Logs of receivers and units side by side: told apart, NMEA alone, the IMU of a u-blox."""

import struct

import encode_novatel
import encode_sbf
import encode_sbg
import encode_vectornav
import encode_xsens
import pytest

from schuler.recording.formats import registry
from schuler.recording.io import read


def test_no_format_claims_anothers_log(tmp_path):
    """Logs of each kind are claimed by their own format alone."""
    logs = {
        "novatel": encode_novatel.inspvas(2300, 10.0, (48.0, 8.0, 400.0), (0, 0, 0), (0, 0, 0)) * 3,
        "sbf": encode_sbf.attitude(2300, 1000, 10.0, 0.0, 0.0) * 3,
        "vectornav": encode_vectornav.packet(TimeGps=1, Ypr=(1, 2, 3)) * 3,
        "xsens": encode_xsens.message(encode_xsens.fine(1) + encode_xsens.vector(0x4020, (0, 0, 9.8))) * 3,
        "sbg": encode_sbg.imu_short(1.0, (0, 0, -9.8), (0, 0, 0)) * 3,
    }
    path = tmp_path / "log"
    for name, data in logs.items():
        path.write_bytes(data)
        claims = [format_name for format_name, _ in registry.FORMATS if registry.module(format_name).sniff(data, path)]
        assert claims == [name]


def test_nmea_alone_past_midnight(tmp_path):
    """A log of a receiver without any binary message: positions, accuracy, velocity, and a new day."""
    pytest.importorskip("pynmeagps")

    def sentence(text):
        checksum = 0
        for byte in text.encode():
            checksum ^= byte
        return f"${text}*{checksum:02X}\r\n"

    lines = []
    for k in range(6):
        day, second = (21, 57 + k) if k < 3 else (22, k - 3)
        clock = f"{23 if day == 21 else 0:02d}{59 if day == 21 else 0:02d}{second:02d}.00"
        lines.append(sentence(f"GNGGA,{clock},4800.0000,N,00800.0600,E,4,18,0.6,352.5,M,47.5,M,1.0,0001"))
        lines.append(sentence(f"GNGST,{clock},0.5,,,,0.011,0.012,0.023"))
        if k != 3:  # the first epoch of the new day has no date of its own
            lines.append(sentence(f"GNRMC,{clock},A,4800.0000,N,00800.0600,E,19.4384,90.0,{day:02d}0326,,,R"))
    path = tmp_path / "receiver.nmea"
    path.write_text("".join(lines), newline="")
    # receivers put messages of their own before; without positions in them the log is one of NMEA
    own = encode_novatel.line("#VERSIONA,COM1,0,50,UNKNOWN,0,1.0,0,0,1;1,GPSCARD,X") + encode_sbf.block(
        5914, 0, 0, bytes(8)
    )
    path.write_bytes(own + path.read_bytes())
    gnss = read(path).gnss
    assert len(gnss) == 6
    assert list((gnss.t[1:] - gnss.t[:-1]).round(9)) == [1.0] * 5
    assert gnss.llh[0, 2] == pytest.approx(400.0)
    assert gnss.v_n[0, 1] == pytest.approx(10.0, abs=1e-4)
    assert gnss.cov_r_n[0, 0, 0] == pytest.approx(0.011**2)
    assert set(gnss.quality) == {1}


def test_u_blox_imu_is_named_and_not_timed(tmp_path):
    """Frames ESF-RAW beside solutions are counted in a note: their time tags have no documented unit."""
    pytest.importorskip("pyubx2")
    from schuler.recording.formats.ubx import checksum

    def frame(kind, identifier, body):
        inner = bytes((kind, identifier)) + struct.pack("<H", len(body)) + body
        return b"\xb5\x62" + inner + checksum(inner)

    pvt = struct.pack(
        "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHH4xihH",
        345_618_000,
        2024,
        2,
        8,
        0,
        0,
        0,
        7,
        20,
        0,
        3,
        1,
        0,
        12,
        80_000_000,
        480_000_000,
        400_000,
        352_000,
        500,
        800,
        0,
        0,
        0,
        0,
        0,
        100,
        1000,
        100,
        0,
        0,
        0,
        0,
    )
    raw = struct.pack("<4xIIII", 16 << 24 | 1024, 7, 17 << 24 | 0, 7)  # fmt: skip
    path = tmp_path / "log.ubx"
    path.write_bytes(frame(0x01, 0x07, pvt) + frame(0x10, 0x03, raw) * 3)
    back = read(path)
    assert len(back.gnss) == 1
    assert any("3 frames ESF-MEAS and ESF-RAW were not read" in note for note in back.metadata.notes)
