"""RTCM 3 messages bit by bit from RTCM 10403.3's tables: frames, 1005, MSM4 and MSM7, ephemerides of three systems."""

from __future__ import annotations

from typing import Any

import numpy as np

SPEED_OF_LIGHT, WEEK_S = 299_792_458.0, 604_800.0
SYSTEMS = "GREC"  # hundreds of a satellite's number
BANDS = {
    ("G", "1"): 1575.42e6, ("G", "2"): 1227.60e6, ("G", "5"): 1176.45e6, ("E", "1"): 1575.42e6, ("E", "5"): 1176.45e6,
    ("E", "7"): 1207.14e6, ("C", "2"): 1561.098e6, ("C", "6"): 1268.52e6, ("C", "7"): 1207.14e6,
}  # fmt: skip
MS = 1e-3 * SPEED_OF_LIGHT
SIGNALS = {"G": {"1C": 2, "2W": 10, "5Q": 23}, "E": {"1C": 2, "5Q": 23, "7Q": 15}, "C": {"2I": 2, "6I": 8, "7I": 14}}
FIRST = {"G": 107, "E": 109, "C": 112}


class Bits:
    """Bits put one behind the other."""

    def __init__(self) -> None:
        self.text = ""

    def put(self, value: float, bits: int, scale: float = 1.0) -> Bits:
        number = round(value / scale)
        assert -(1 << (bits - 1)) <= number < 1 << bits, (value, bits, scale)
        self.text += format(number & ((1 << bits) - 1), f"0{bits}b")
        return self

    def frame(self) -> bytes:
        text = self.text + "0" * (-len(self.text) % 8)
        return framed(int(text, 2).to_bytes(len(text) // 8, "big"))


def framed(payload: bytes) -> bytes:
    """Preamble, length and checksum around a payload; the checksum by polynomial division."""
    body = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    remainder = int.from_bytes(body, "big") << 24
    for bit in range(remainder.bit_length() - 1, 23, -1):
        if remainder >> bit & 1:
            remainder ^= 0x1864CFB << (bit - 24)
    return body + remainder.to_bytes(3, "big")


def station(r_e: np.ndarray) -> bytes:
    """1005: antenna reference point."""
    b = Bits().put(1005, 12).put(7, 12).put(0, 6).put(7, 4).put(r_e[0], 38, 1e-4).put(0, 2)
    return b.put(r_e[1], 38, 1e-4).put(0, 2).put(r_e[2], 38, 1e-4).frame()


def mounted(r_e: np.ndarray, height: float, antenna: str) -> list[bytes]:
    """1006: antenna reference point and its height; 1033: type of the antenna, without what else it has."""
    b = Bits().put(1006, 12).put(7, 12).put(0, 6).put(7, 4).put(r_e[0], 38, 1e-4).put(0, 2)
    b.put(r_e[1], 38, 1e-4).put(0, 2).put(r_e[2], 38, 1e-4).put(height, 16, 1e-4)
    name = Bits().put(1033, 12).put(7, 12).put(len(antenna), 8)
    for letter in antenna:
        name.put(ord(letter), 8)
    return [b.frame(), name.put(0, 8).put(0, 8).put(0, 8).put(0, 8).put(0, 8).frame()]


def msm(log: Any, letter: str, t: float, kind: int = 7, lock: int = 600, last: bool = True) -> bytes:
    """Multi-signal message of one system at one epoch; ``lock`` is the indicator of every carrier."""
    rows = np.flatnonzero((log.t == t) & (log.sat // 100 == SYSTEMS.index(letter)))
    ids = SIGNALS[letter]
    sats = sorted({int(s) for s in log.sat[rows]})
    signals = sorted({ids[log.signals[k]] for k in log.signal[rows]})
    cell = {(int(log.sat[k]), ids[log.signals[log.signal[k]]]): k for k in rows}
    tow = (log.epoch_gps_s + t - (14.0 if letter == "C" else 0.0)) % WEEK_S
    b = Bits().put(10 * FIRST[letter] + kind, 12).put(7, 12).put(tow, 30, 1e-3).put(not last, 1).put(0, 3 + 7 + 2 + 2)
    b.put(0, 1).put(0, 3)
    b.put(sum(1 << (64 - s % 100) for s in sats), 64).put(sum(1 << (32 - s) for s in signals), 32)
    for s in sats:
        for g in signals:
            b.put((s, g) in cell, 1)
    first = {s: next(k for (x, _), k in cell.items() if x == s) for s in sats}
    rough = {s: round(log.pseudorange[k] / MS * 1024) / 1024 for s, k in first.items()}
    speed = {s: round(log.range_rate[k]) for s, k in first.items()}
    for s in sats:
        b.put(int(rough[s]), 8)
    if kind == 7:
        b.put(0, 4 * len(sats))
    for s in sats:
        b.put(rough[s] % 1.0, 10, 2.0**-10)
    if kind == 7:
        for s in sats:
            b.put(speed[s], 14)
    order = [(s, g, cell[s, g]) for s in sats for g in signals if (s, g) in cell]
    code, phase = ((20, 2.0**-29), (24, 2.0**-31)) if kind == 7 else ((15, 2.0**-24), (22, 2.0**-29))
    for s, _, k in order:
        b.put(log.pseudorange[k] / MS - rough[s], *code)
    for s, _, k in order:
        cycle = SPEED_OF_LIGHT / BANDS[(letter, log.signals[log.signal[k]][:1])]
        b.put(log.carrier[k] * cycle / MS - rough[s], *phase)
    for _ in order:
        b.put(lock, 10 if kind == 7 else 4)
    for _, _, k in order:
        b.put(bool(log.lock[k] & 2), 1)
    for _, _, k in order:
        b.put(log.cn0[k], *((10, 2.0**-4) if kind == 7 else (6, 1.0)))
    if kind == 7:
        for s, _, k in order:
            b.put(log.range_rate[k] - speed[s], 15, 1e-4)
    return b.frame()


#: Fields of ephemerides in order of transmission: name, bits, scale; names of one letter are none of a record.
EPHEMERIS = {
    "1019": (
        ("sat", 6, 1), ("week", 10, 1), ("ura", 4, 1), ("x", 2, 1), ("idot", 14, 2.0**-43), ("issue", 8, 1),
        ("toc", 16, 16), ("af2", 8, 2.0**-55), ("af1", 16, 2.0**-43), ("af0", 22, 2.0**-31), ("x", 10, 1),
        ("crs", 16, 2.0**-5), ("delta_n", 16, 2.0**-43), ("m0", 32, 2.0**-31), ("cuc", 16, 2.0**-29),
        ("e", 32, 2.0**-33), ("cus", 16, 2.0**-29), ("sqrt_a", 32, 2.0**-19), ("toe", 16, 16), ("cic", 16, 2.0**-29),
        ("omega0", 32, 2.0**-31), ("cis", 16, 2.0**-29), ("i0", 32, 2.0**-31), ("crc", 16, 2.0**-5),
        ("omega", 32, 2.0**-31), ("omega_dot", 24, 2.0**-43), ("delay_1", 8, 2.0**-31), ("health", 6, 1), ("x", 1, 1),
        ("x", 1, 1),
    ),
    "1042": (
        ("sat", 6, 1), ("week", 13, 1), ("ura", 4, 1), ("idot", 14, 2.0**-43), ("issue", 5, 1), ("toc", 17, 8),
        ("af2", 11, 2.0**-66), ("af1", 22, 2.0**-50), ("af0", 24, 2.0**-33), ("x", 5, 1), ("crs", 18, 2.0**-6),
        ("delta_n", 16, 2.0**-43), ("m0", 32, 2.0**-31), ("cuc", 18, 2.0**-31), ("e", 32, 2.0**-33),
        ("cus", 18, 2.0**-31), ("sqrt_a", 32, 2.0**-19), ("toe", 17, 8), ("cic", 18, 2.0**-31),
        ("omega0", 32, 2.0**-31), ("cis", 18, 2.0**-31), ("i0", 32, 2.0**-31), ("crc", 18, 2.0**-6),
        ("omega", 32, 2.0**-31), ("omega_dot", 24, 2.0**-43), ("delay_1", 10, 1e-10), ("delay_2", 10, 1e-10),
        ("health", 1, 1),
    ),
    "1046": (
        ("sat", 6, 1), ("week", 12, 1), ("issue", 10, 1), ("ura", 8, 1), ("idot", 14, 2.0**-43), ("toc", 14, 60),
        ("af2", 6, 2.0**-59), ("af1", 21, 2.0**-46), ("af0", 31, 2.0**-34), ("crs", 16, 2.0**-5),
        ("delta_n", 16, 2.0**-43), ("m0", 32, 2.0**-31), ("cuc", 16, 2.0**-29), ("e", 32, 2.0**-33),
        ("cus", 16, 2.0**-29), ("sqrt_a", 32, 2.0**-19), ("toe", 14, 60), ("cic", 16, 2.0**-29),
        ("omega0", 32, 2.0**-31), ("cis", 16, 2.0**-29), ("i0", 32, 2.0**-31), ("crc", 16, 2.0**-5),
        ("omega", 32, 2.0**-31), ("omega_dot", 24, 2.0**-43), ("delay_1", 10, 2.0**-32), ("delay_2", 10, 2.0**-32),
        ("hs_e5b", 2, 1), ("dvs_e5b", 1, 1), ("hs_e1b", 2, 1), ("dvs_e1b", 1, 1), ("x", 2, 1),
    ),
}  # fmt: skip
EPHEMERIS["1045"] = (*EPHEMERIS["1046"][:25], ("hs_e5a", 2, 1), ("dvs_e5a", 1, 1), ("x", 7, 1))


def ephemeris(kind: str, values: dict[str, float]) -> bytes:
    """Ephemeris message of values in the units of the message (semicircles, seconds of the week)."""
    b = Bits().put(int(kind), 12)
    for name, bits, scale in EPHEMERIS[kind]:
        b.put(values.get(name, 0), bits, scale)
    return b.frame()
