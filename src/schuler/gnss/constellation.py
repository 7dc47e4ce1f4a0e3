"""Nominal constellations as circular orbits: for simulations, coverage and dilution studies.

Circular, unperturbed orbits on an Earth that turns: exact closed forms for position and velocity, and the same orbits
as broadcast ephemerides, so that readers, orbit code and everything after them can be tested on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.gnss.ephemerides import Ephemerides, GlonassRecords, KeplerRecords, no_glonass, no_kepler
from schuler.gnss.orbits import BDT_BEHIND_GPS_S, CONSTANTS
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite
from schuler.plotting.notebook import Abridged
from schuler.timebase import WEEK_S
from schuler.units import DEG

# Semi-major axis [m], inclination [deg], planes, satellites in each, phase between neighbouring planes [deg]
_FIRST = MappingProxyType({"C": 19})  # BeiDou's lower numbers are geostationary and inclined ones
_WALKER = MappingProxyType(
    {
        "E": (29_599_800.0, 56.0, 3, 8, 15.0),
        "R": (25_508_000.0, 64.8, 3, 8, 15.0),
        "C": (27_906_100.0, 55.0, 3, 8, 15.0),
    }
)
# GPS slots: right ascension of the node less Greenwich hour angle comes from the plane, argument of latitude here [deg]
_GPS_NODES = MappingProxyType({"A": 272.847, "B": 332.847, "C": 32.847, "D": 92.847, "E": 152.847, "F": 212.847})
_GPS_HOUR_ANGLE = 279.06  # 18 h 36 min 14.4 s
_GPS_SLOTS = MappingProxyType(
    {
        "A1": 268.126, "A2": 161.786, "A3": 11.676, "A4": 41.806,
        "B1": 80.956, "B2": 173.336, "B3": 309.976, "B4": 204.376,
        "C1": 111.876, "C2": 11.796, "C3": 339.666, "C4": 241.556,
        "D1": 135.226, "D2": 265.446, "D3": 35.156, "D4": 167.356,
        "E1": 197.046, "E2": 302.596, "E3": 66.066, "E4": 333.686,
        "F1": 238.886, "F2": 345.226, "F3": 105.206, "F4": 135.346,
    }
)  # fmt: skip
# Slots that split in two when 27 satellites fly: fore and aft
_GPS_EXPANDED = MappingProxyType({"B1": (94.916, 66.356), "D2": (282.676, 257.976), "F2": (0.456, 334.016)})
_GPS_AXIS, _GPS_INCLINATION = 26_559_700.0, 55.0


@dataclass(frozen=True, repr=False)
class CircularOrbits(Abridged):
    """Satellites on circular orbits.

    Attributes
    ----------
    sat : ndarray of int, shape (s,)
        See :func:`schuler.gnss.signals.satellite`.
    a : ndarray, shape (s,)
        Radius. [m]
    inclination, node, latitude_argument : ndarray, shape (s,)
        Inclination, longitude (Earth-fixed) of the ascending node at ``epoch_gps_s``, angle from it along the orbit.
        [rad]
    epoch_gps_s : float
        Seconds since 1980-01-06. [s]
    """

    sat: IntArray
    a: FloatArray
    inclination: FloatArray
    node: FloatArray
    latitude_argument: FloatArray
    epoch_gps_s: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "sat", np.asarray(self.sat, dtype=np.int64))
        for name in ("a", "inclination", "node", "latitude_argument"):
            object.__setattr__(self, name, as_floats(getattr(self, name), f"CircularOrbits.{name}", (len(self.sat),)))

    def __len__(self) -> int:
        return len(self.sat)

    def where(self, keep: ArrayLike) -> CircularOrbits:
        """Some of the satellites, by a boolean or index array."""
        k = np.asarray(keep)
        return CircularOrbits(
            self.sat[k], self.a[k], self.inclination[k], self.node[k], self.latitude_argument[k], self.epoch_gps_s
        )

    def _rates(self) -> tuple[FloatArray, FloatArray]:
        """Angular rate along the orbit, rate of the Earth. Shapes (s,). [rad/s]"""
        mu, omega = np.array([CONSTANTS[SYSTEMS[int(s) // 100]] for s in self.sat]).reshape(-1, 2).T
        return np.sqrt(mu / self.a**3), omega

    def angles(self, t: ArrayLike, *, epoch_gps_s: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Argument of latitude and longitude of the node. Times (k,) or (k, s), see :meth:`states`. (k, s). [rad]"""
        n, omega = self._rates()
        times = np.asarray(t, dtype=np.float64)
        if times.ndim not in (1, 2) or (times.ndim == 2 and times.shape[1] != len(self)):
            raise InputError(f"t: expected shape (k,) or (k, {len(self)}), got {times.shape}")
        dt = (times if times.ndim == 2 else times[:, None]) + (epoch_gps_s - self.epoch_gps_s)
        return self.latitude_argument + n * dt, self.node - omega * dt

    def states(self, t: ArrayLike, *, epoch_gps_s: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities in the Earth-fixed axes of these times.

        Parameters
        ----------
        t : array_like, shape (k,) or (k, s)
            Times, for all satellites or for each. [s]
        epoch_gps_s : float
            GPS time of ``t = 0``; a double of seconds since 1980 resolves 1 mm of the orbit. [s]

        Returns
        -------
        r_e, v_e : ndarray, shape (k, s, 3)
            [m], [m/s]
        """
        u, node = self.angles(t, epoch_gps_s=epoch_gps_s)
        n, omega = self._rates()
        su, cu, so, co = np.sin(u), np.cos(u), np.sin(node), np.cos(node)
        si, ci = np.sin(self.inclination), np.cos(self.inclination)
        a = self.a
        r = np.stack((a * (cu * co - su * ci * so), a * (cu * so + su * ci * co), a * su * si), axis=-1)
        v = np.stack((-su * co - cu * ci * so, -su * so + cu * ci * co, cu * si), axis=-1) * (a * n)[:, None]
        v[..., 0] += omega * r[..., 1]
        v[..., 1] -= omega * r[..., 0]
        return r, v

    def ephemerides(self, start_gps_s: float, stop_gps_s: float, *, interval_s: float = 7200.0) -> Ephemerides:
        """The same orbits as a receiver would have them broadcast, clocks and group delays zero.

        Parameters
        ----------
        start_gps_s, stop_gps_s : float
            Period to cover. [s]
        interval_s : float
            Between reference times of Keplerian records; GLONASS states come every half hour. [s]

        Returns
        -------
        Ephemerides
            Keplerian records are these orbits exactly (to rounding). GLONASS users integrate their states with the
            Earth's oblateness, so there circular orbits are met at the reference times only, and missed by some tens of
            metres a quarter of an hour later: take ranges from the records then, not from here.
        """
        if not stop_gps_s >= start_gps_s or interval_s <= 0.0:
            raise InputError(
                f"expected start <= stop and a positive interval, got {start_gps_s}, {stop_gps_s}, {interval_s}"
            )
        glonass = self.sat // 100 == SYSTEMS.index("R")
        return Ephemerides(
            _kepler(self.where(~glonass), _grid(start_gps_s, stop_gps_s, interval_s)),
            _glonass(self.where(glonass), _grid(start_gps_s, stop_gps_s, 1800.0)),
            notes=("simulated circular orbits",),
        )


def walker(
    system: str,
    a: float,
    inclination: float,
    planes: int,
    per_plane: int,
    phase: float,
    *,
    first: int = 1,
    epoch_gps_s: float = 0.0,
) -> CircularOrbits:
    """Walker's delta pattern: equal circular orbits, nodes and satellites evenly spread.

    Parameters
    ----------
    system : str
        RINEX letter.
    a, inclination, phase : float
        Radius [m], inclination [rad], shift along the orbit from one plane to the next [rad].
    planes, per_plane : int
    first : int
        Number of the first satellite.
    epoch_gps_s : float
        When the first satellite is over the equator at longitude zero. [s]

    References
    ----------
    Walker (1984), Satellite constellations, J. Br. Interplanet. Soc. 37, 559-571.
    """
    if planes < 1 or per_plane < 1 or first < 1 or first + planes * per_plane > 100:
        raise InputError(f"expected numbers within 1 to 99, got {planes} planes of {per_plane} from {first}")
    plane, place = np.divmod(np.arange(planes * per_plane), per_plane)
    sat = np.array([satellite(f"{system}{first + i:02d}") for i in range(planes * per_plane)])
    return CircularOrbits(
        sat,
        np.full(len(sat), float(a)),
        np.full(len(sat), float(inclination)),
        2.0 * np.pi * plane / planes,
        2.0 * np.pi * place / per_plane + phase * plane,
        epoch_gps_s,
    )


def nominal_orbits(systems: str = "GE", *, epoch_gps_s: float = 0.0, gps_expanded: bool = False) -> CircularOrbits:
    """Nominal constellations: GPS 24 (or 27), Galileo 24/3/1, GLONASS 24/3/1, BeiDou's 24/3/1 in medium orbit.

    Parameters
    ----------
    systems : str
        RINEX letters, some of G, E, R, C.
    epoch_gps_s : float
        Time at which the satellites stand as tabulated; the same geometry whatever it is. [s]
    gps_expanded : bool
        27 GPS satellites, three slots split into pairs.

    Returns
    -------
    CircularOrbits
        Orbits of all systems.

    Raises
    ------
    InputError
        For a system without a nominal constellation here.

    References
    ----------
    GPS Standard Positioning Service Performance Standard (2001), table 3-1 (epoch 1993-07-01); (2008), table 3.2-2 for
    the expanded slots. Galileo OS SDD; GLONASS ICD L1, L2; BeiDou OS ICD: Walker parameters. The nodes of the
    Walker patterns are placed evenly from longitude zero at the epoch, not as flown.
    """
    patterns = []
    for i, system in enumerate(systems):
        if system == "G":
            patterns.append(_gps(epoch_gps_s, gps_expanded))
        elif system in _WALKER:
            a, inclination, planes, per_plane, phase = _WALKER[system]
            pattern = walker(
                system, a, inclination * DEG, planes, per_plane, phase * DEG,
                first=_FIRST.get(system, 1), epoch_gps_s=epoch_gps_s,
            )  # fmt: skip
            # neighbouring systems are turned against each other, so that their planes do not coincide
            patterns.append(_turned(pattern, 0.35 * i))
        else:
            choices = ", ".join(f"{s} ({SYSTEM_NAMES[s]})" for s in ("G", *_WALKER))
            raise InputError(f"systems: expected letters among {choices}, got {system!r}")
    if not patterns:
        raise InputError("systems: expected at least one letter")
    names = ("sat", "a", "inclination", "node", "latitude_argument")
    arrays = {name: np.concatenate([getattr(f, name) for f in patterns]) for name in names}
    return CircularOrbits(**arrays, epoch_gps_s=epoch_gps_s)


def _gps(epoch_gps_s: float, expanded: bool) -> CircularOrbits:
    slots: list[tuple[str, float]] = []
    for slot, angle in _GPS_SLOTS.items():
        slots.extend((slot[0], x) for x in (_GPS_EXPANDED[slot] if expanded and slot in _GPS_EXPANDED else (angle,)))
    n = len(slots)
    return CircularOrbits(
        np.arange(1, n + 1),
        np.full(n, _GPS_AXIS),
        np.full(n, _GPS_INCLINATION * DEG),
        DEG * np.array([_GPS_NODES[p] - _GPS_HOUR_ANGLE for p, _ in slots]),
        DEG * np.array([x for _, x in slots]),
        epoch_gps_s,
    )


def _turned(o: CircularOrbits, angle: float) -> CircularOrbits:
    return CircularOrbits(o.sat, o.a, o.inclination, o.node + angle, o.latitude_argument, o.epoch_gps_s)


def _grid(start: float, stop: float, step: float) -> FloatArray:
    """Round reference times that leave no instant further than half a step away."""
    return step * np.arange(np.floor(start / step), np.ceil(stop / step) + 1.0)


def _kepler(orbits: CircularOrbits, toe: FloatArray) -> KeplerRecords:
    if len(orbits) == 0:
        return no_kepler()
    u, node = (x.ravel() for x in orbits.angles(toe))
    times, sat = np.repeat(toe, len(orbits)), np.tile(orbits.sat, len(toe))
    _, omega = orbits._rates()
    late = np.where(sat // 100 == SYSTEMS.index("C"), BDT_BEHIND_GPS_S, 0.0)
    in_week = np.mod(times - late, WEEK_S)
    zero, none = np.zeros(len(sat)), np.zeros(len(sat), dtype=np.int64)
    delays = np.zeros((len(sat), 2))
    delays[sat // 100 == SYSTEMS.index("G"), 1] = np.nan
    return KeplerRecords(
        sat=sat, toe=times, toc=times, sent=zero * np.nan, af0=zero, af1=zero, af2=zero,
        sqrt_a=np.tile(np.sqrt(orbits.a), len(toe)), e=zero, i0=np.tile(orbits.inclination, len(toe)),
        omega0=_wrapped(node + np.tile(omega, len(toe)) * in_week), omega=zero, m0=_wrapped(u), delta_n=zero, idot=zero,
        omega_dot=zero, cuc=zero, cus=zero, crc=zero, crs=zero, cic=zero, cis=zero, group_delay=delays, health=none,
        accuracy=zero + 1.0, issue=np.repeat(np.arange(len(toe)), len(orbits)) % 256, source=_source(sat),
    )  # fmt: skip


def _source(sat: IntArray) -> IntArray:
    """Galileo: I/NAV on E1-B and E5b, clock for E5b/E1 (bits 0, 2, 9)."""
    return np.where(sat // 100 == SYSTEMS.index("E"), 1 + 4 + 512, 0)


def _glonass(orbits: CircularOrbits, toe: FloatArray) -> GlonassRecords:
    if len(orbits) == 0:
        return no_glonass()
    r, v = orbits.states(toe)
    n = len(toe) * len(orbits)
    sat = np.tile(orbits.sat, len(toe))
    zero, none = np.zeros(n), np.zeros(n, dtype=np.int64)
    # antipodal satellites share a channel, as in the constellation that flies
    channel = (sat % 100 - 1) % 4 + 4 * (((sat % 100 - 1) // 8) % 3) - 6
    times = np.repeat(toe, len(orbits))
    return GlonassRecords(
        sat, times, times, r.reshape(-1, 3), v.reshape(-1, 3), np.zeros((n, 3)), zero, zero, channel, none
    )


def _wrapped(angle: FloatArray) -> FloatArray:
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
