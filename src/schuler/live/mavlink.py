"""Solutions for autopilots: GPS_INPUT and ODOMETRY of MAVLink 2, in datagrams.

Layouts and identifiers: MAVLink, "Serialization" and the message set "common" (mavlink.io); fields stand in order of
the size of their types, extensions behind them, zeros at the end of a payload are not sent.
"""

from __future__ import annotations

import binascii
import math
import socket
import struct
from contextlib import suppress

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.live.address import parse_address
from schuler.live.clock import SourceClock
from schuler.live.messages import Event, Solution
from schuler.recording.formats.ros_stamps import unix_ns
from schuler.timebase import WEEK_S, TimeBase

_START = 0xFD
_MIRRORED = bytes(int(f"{k:08b}"[::-1], 2) for k in range(256))
_GPS_INPUT = (232, 151, struct.Struct("<QIii9fHHBBBH"))  # identifier, seed of the checksum, layout
_ODOMETRY = (331, 91, struct.Struct("<Q3f4f3f3f21f21fBBBBb"))
_NO_DOP = 2 | 4  # flags: dilutions of precision are not given
_NO_FIX, _FIX_3D = 1, 3
_UNKNOWN = 255  # number of satellites
_LOCAL_NED, _BODY_FRD, _GPS_INS = 1, 12, 5  # frames; type of the estimator
_COMPONENT = 220  # MAV_COMP_ID_GPS


def crc(data: bytes) -> int:
    """CRC-16/MCRF4XX (polynomial 0x1021 from all ones, lowest bit first), by the routine for the highest bit first."""
    return int(f"{binascii.crc_hqx(data.translate(_MIRRORED), 0xFFFF):016b}"[::-1], 2)


def frame(kind: tuple[int, int, struct.Struct], payload: bytes, sequence: int, system: int) -> bytes:
    """A frame of MAVLink 2, not signed."""
    identifier, seed, _ = kind
    payload = payload.rstrip(b"\0") or b"\0"
    head = bytes((len(payload), 0, 0, sequence & 0xFF, system, _COMPONENT)) + identifier.to_bytes(3, "little")
    return bytes([_START]) + head + payload + crc(head + payload + bytes([seed])).to_bytes(2, "little")


def gps_input(solution: Solution, base: TimeBase | None, geoid_separation: float = 0.0) -> bytes:
    """Payload of GPS_INPUT.

    Parameters
    ----------
    solution : Solution
        Accuracies are its 1-sigmas, those of two axes and of velocity as the root of their squares.
    base : TimeBase or None
        Of its time.
    geoid_separation : float
        Height of the geoid above the ellipsoid. [m]
    """
    week, ms = 0, 0
    if base is not None and base.scale == "gps":
        week_s, ms = divmod(round((base.epoch_gps_s % WEEK_S + solution.t) * 1e3), round(WEEK_S * 1e3))
        week = int(base.epoch_gps_s // WEEK_S) + week_s
    lat, lon = (round(angle / units.DEG * 1e7) for angle in solution.llh[:2].tolist())
    yaw = round(solution.rpy_nb[2] / units.DEG * 100.0) % 36_000 or 36_000  # zero is not known
    return _GPS_INPUT[2].pack(
        _microseconds(solution.t, base), ms, lat, lon, float(solution.llh[2]) - geoid_separation, 0.0, 0.0,
        *solution.v_eb_n.tolist(), float(np.linalg.norm(solution.sigma_v_n)), math.hypot(*solution.sigma_r_n[:2]),
        float(solution.sigma_r_n[2]), _NO_DOP, week, 0, _NO_FIX if solution.health == "failed" else _FIX_3D, _UNKNOWN,
        yaw,
    )  # fmt: skip


def odometry(solution: Solution, base: TimeBase | None, origin: FloatArray) -> bytes:
    """Payload of ODOMETRY: pose north, east, down of a place, velocity forward, right, down.

    Parameters
    ----------
    solution : Solution
        Angular rates are not in it, and are not-a-number in the message; variances of attitude are about north, east
        and down.
    base : TimeBase or None
        Of its time.
    origin : ndarray, shape (3,)
        Latitude, longitude [rad], height [m] of the place.
    """
    C_on = frames.C_en(origin).T @ frames.C_en(solution.llh)
    C_nb = rotation.dcm_from_rpy(solution.rpy_nb)
    r = frames.ned_from_ecef(frames.ecef_from_llh(solution.llh[None]), origin)[0]
    pose, moves = np.zeros((2, 6, 6))
    pose[:3, :3], pose[3:, 3:] = (C_on * s**2 @ C_on.T for s in (solution.sigma_r_n, solution.sigma_psi_n))
    moves[:3, :3] = C_nb.T * solution.sigma_v_n**2 @ C_nb
    moves[3:, :] = moves[:, 3:] = np.nan
    upper = np.triu_indices(6)
    return _ODOMETRY[2].pack(
        _microseconds(solution.t, base), *r.tolist(), *rotation.quat_from_dcm(C_on @ C_nb).tolist(),
        *(C_nb.T @ solution.v_eb_n).tolist(), *(math.nan,) * 3, *pose[upper].tolist(), *moves[upper].tolist(),
        _LOCAL_NED, _BODY_FRD, 0, _GPS_INS, -1 if solution.health == "failed" else 0,
    )  # fmt: skip


class MavlinkSink:
    """Solutions as GPS_INPUT and ODOMETRY, in datagrams to ``udp://HOST:PORT``.

    Parameters
    ----------
    place : str
        With ``?system=1``, the system they are of.
    clock : SourceClock
    geoid_separation : float
        See :func:`gps_input`. [m]

    Raises
    ------
    InputError
        If the address is wrong.
    """

    def __init__(self, place: str, clock: SourceClock, geoid_separation: float = 0.0) -> None:
        address = parse_address(place, {"udp": ("system",)}, ("udp",))
        system = address.number("system", 1.0)
        if not 1.0 <= system <= 255.0 or system % 1.0:
            raise InputError(f"{place}: system: expected a whole number from 1 to 255, got {system:g}")
        self._to, self._system = (address.host, address.port), int(system)
        self._clock, self._separation, self._sequence = clock, geoid_separation, 0
        self._origin: FloatArray | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def solution(self, solution: Solution) -> None:
        """Send a solution."""
        if self._origin is None:
            self._origin = solution.llh
        base = self._clock.base
        for kind, payload in (
            (_GPS_INPUT, gps_input(solution, base, self._separation)),
            (_ODOMETRY, odometry(solution, base, self._origin)),
        ):
            with suppress(OSError):  # nobody listens, or the network is away
                self._socket.sendto(frame(kind, payload, self._sequence, self._system), self._to)
            self._sequence += 1

    def event(self, event: Event) -> None:
        """Events are not sent."""

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


def _microseconds(t: float, base: TimeBase | None) -> int:
    """Unix time, or time of the run's own clock. [us]"""
    try:
        return 0 if base is None else int(unix_ns(np.array([t]), base, "live")[0]) // 1000
    except InputError:
        return 0
