"""Broadcast ephemerides as arrays: Keplerian elements (GPS, Galileo, BeiDou, QZSS) and GLONASS states."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.antennas import Antenna
from schuler.gnss.code_biases import CodeBiases
from schuler.gnss.ionosphere_maps import IonosphereMaps
from schuler.gnss.precise import PreciseClocks, PreciseOrbits
from schuler.plotting.notebook import Abridged

#: In ``KeplerRecords.source``: a message of the modernised signals.
NEWER_SOURCE = 0x1000
#: The same: BeiDou's message of B2b, B-CNAV3.
B2B_SOURCE = 0x2000


@dataclass(frozen=True, repr=False)
class KeplerRecords(Abridged):
    """Broadcast orbits and clocks, one row a message. Angles [rad], times [s], distances [m], as in the ICDs.

    Attributes
    ----------
    sat : ndarray of int, shape (n,)
    toe, toc : ndarray, shape (n,)
        Reference times of orbit and clock, **GPS time** since 1980-01-06, also for BeiDou (14 s added by the reader).
    sent : ndarray, shape (n,)
        Time of transmission of the message, GPS time; NaN if the file does not say.
    af0, af1, af2 : ndarray, shape (n,)
        Clock polynomial. [s], [1], [1/s]
    sqrt_a, e, i0, omega0, omega, m0, delta_n, idot, omega_dot : ndarray, shape (n,)
        Square root of the semi-major axis [sqrt(m)], eccentricity, inclination, longitude of the ascending node at the
        week's start, argument of perigee, mean anomaly, mean motion difference [rad/s], rates of inclination and of
        right ascension [rad/s].
    cuc, cus, crc, crs, cic, cis : ndarray, shape (n,)
        Harmonic corrections of latitude argument [rad], radius [m] and inclination [rad].
    group_delay : ndarray, shape (n, 2)
        GPS, QZSS: TGD and NaN, of newer messages TGD and the delay of L5 (TGD less its ISC); Galileo: BGD E5a/E1 and
        BGD E5b/E1; BeiDou: TGD1 (B1/B3) and TGD2 (B2/B3), of newer messages those of B1C's and B2a's pilots, of
        B-CNAV3 NaN and that of B2b. [s]
    health : ndarray of int, shape (n,)
        0 is usable; anything else as broadcast.
    accuracy : ndarray, shape (n,)
        Signal-in-space accuracy (URA, SISA) as 1-sigma. [m]
    issue : ndarray of int, shape (n,)
        IODE, IODnav, AODE.
    source : ndarray of int, shape (n,)
        Galileo's data source word (bit 0: I/NAV E1-B, bit 1: F/NAV E5a, bit 2: I/NAV E5b; bit 8: clock for E5a/E1,
        bit 9: clock for E5b/E1), 0 for the others, but :data:`NEWER_SOURCE` of GPS's and QZSS's CNAV and CNAV-2 and of
        BeiDou's B-CNAV1 and B-CNAV2, :data:`B2B_SOURCE` of B-CNAV3.
    a_dot, delta_n_dot : ndarray, shape (n,), optional
        Rates of the semi-major axis [m/s] and of the mean motion difference [rad/s^2], which newer messages have; 0.
    """

    sat: IntArray
    toe: FloatArray
    toc: FloatArray
    sent: FloatArray
    af0: FloatArray
    af1: FloatArray
    af2: FloatArray
    sqrt_a: FloatArray
    e: FloatArray
    i0: FloatArray
    omega0: FloatArray
    omega: FloatArray
    m0: FloatArray
    delta_n: FloatArray
    idot: FloatArray
    omega_dot: FloatArray
    cuc: FloatArray
    cus: FloatArray
    crc: FloatArray
    crs: FloatArray
    cic: FloatArray
    cis: FloatArray
    group_delay: FloatArray
    health: IntArray
    accuracy: FloatArray
    issue: IntArray
    source: IntArray
    a_dot: FloatArray = field(default_factory=lambda: np.zeros(0))
    delta_n_dot: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ("a_dot", "delta_n_dot"):
            if len(self.sat) and not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(len(self.sat)))
        _checked(self)

    def __len__(self) -> int:
        return len(self.sat)


@dataclass(frozen=True, repr=False)
class GlonassRecords(Abridged):
    """GLONASS states, one row a message; positions in PZ-90, which is WGS-84 to some centimetres.

    Attributes
    ----------
    sat : ndarray of int, shape (n,)
    toe, sent : ndarray, shape (n,)
        Reference time and time of transmission, GPS time since 1980-01-06 (leap seconds added by the reader). [s]
    r_e, v_e, a_e : ndarray, shape (n, 3)
        Position [m], velocity [m/s], lunisolar acceleration [m/s^2], Earth-fixed.
    clock : ndarray, shape (n,)
        ``-tau_n``: satellite clock ahead of GLONASS time, as RINEX has it. [s]
    rate : ndarray, shape (n,)
        ``+gamma_n``, relative frequency offset.
    channel : ndarray of int, shape (n,)
        Frequency channel.
    health : ndarray of int, shape (n,)
        0 is usable.
    """

    sat: IntArray
    toe: FloatArray
    sent: FloatArray
    r_e: FloatArray
    v_e: FloatArray
    a_e: FloatArray
    clock: FloatArray
    rate: FloatArray
    channel: IntArray
    health: IntArray

    def __post_init__(self) -> None:
        _checked(self)

    def __len__(self) -> int:
        return len(self.sat)


@dataclass(frozen=True, repr=False)
class Ephemerides(Abridged):
    """Everything a navigation file or the navigation messages of a log broadcast.

    Attributes
    ----------
    kepler : KeplerRecords
    glonass : GlonassRecords
    klobuchar_alpha, klobuchar_beta : tuple of float, optional
        GPS ionosphere coefficients. [s, s/semicircle, ...]
    galileo_ai : tuple of float, optional
        NeQuick-G effective ionisation coefficients.
    leap_seconds : int, optional
        GPS - UTC as broadcast. [s]
    notes : tuple of str
        Repairs and assumptions of the reader.
    precise_orbits : PreciseOrbits, optional
        Used instead of broadcast orbits and clocks; of messages only health and group delays remain.
    precise_clocks : PreciseClocks, optional
        Used instead of the clocks of ``precise_orbits``.
    antennas : tuple of Antenna
        Satellites' antennas, by which precise positions become those of phase centres; receivers' for baselines.
    ionosphere_maps : IonosphereMaps, optional
    code_biases : CodeBiases, optional
        Instead of group delays, beside precise clocks; differences of biases also relative to group delays.
    beidou_alpha, beidou_beta : tuple of float, optional
        BeiDou's eight ionosphere coefficients. [s, s/semicircle, ...]
    """

    kepler: KeplerRecords
    glonass: GlonassRecords
    klobuchar_alpha: tuple[float, float, float, float] | None = None
    klobuchar_beta: tuple[float, float, float, float] | None = None
    galileo_ai: tuple[float, float, float] | None = None
    leap_seconds: int | None = None
    notes: tuple[str, ...] = field(default=())
    precise_orbits: PreciseOrbits | None = None
    precise_clocks: PreciseClocks | None = None
    antennas: tuple[Antenna, ...] = ()
    ionosphere_maps: IonosphereMaps | None = None
    code_biases: CodeBiases | None = None
    beidou_alpha: tuple[float, float, float, float] | None = None
    beidou_beta: tuple[float, float, float, float] | None = None

    def merged_with(self, other: Ephemerides) -> Ephemerides:
        """Records of both; constants of this one, and of the other where this has none."""
        return Ephemerides(
            _joined(self.kepler, other.kepler),
            _joined(self.glonass, other.glonass),
            self.klobuchar_alpha or other.klobuchar_alpha,
            self.klobuchar_beta or other.klobuchar_beta,
            self.galileo_ai or other.galileo_ai,
            self.leap_seconds if self.leap_seconds is not None else other.leap_seconds,
            self.notes + other.notes,
            _merged(self.precise_orbits, other.precise_orbits),
            _merged(self.precise_clocks, other.precise_clocks),
            self.antennas + other.antennas,
            _merged(self.ionosphere_maps, other.ionosphere_maps),
            _merged(self.code_biases, other.code_biases),
            self.beidou_alpha or other.beidou_alpha,
            self.beidou_beta or other.beidou_beta,
        )

    def possible(self) -> tuple[Ephemerides, tuple[IntArray, IntArray]]:
        """The messages whose numbers a satellite can have, and the satellites of the others, Keplerian and GLONASS.

        Notes
        -----
        The limits are ten times what the bits of the messages hold or more (IS-GPS-200, table 20-III; Galileo OS SIS
        ICD, table 61; BeiDou B1I ICD, table 5-10), and for orbits from the Earth's surface to 100 000 km.
        """
        orbits, states = _possible(self.kepler), _possible(self.glonass)
        kept = replace(self, kepler=_where(self.kepler, orbits), glonass=_where(self.glonass, states))
        return kept, (self.kepler.sat[~orbits], self.glonass.sat[~states])

    def distinct(self, age_s: float = np.inf) -> Ephemerides:
        """Broadcast messages up to an age before the newest, each once: the one that came last. [s]"""
        newest = max(self.kepler.toe.max(initial=-np.inf), self.glonass.toe.max(initial=-np.inf))
        since = newest - age_s
        return replace(self, kepler=_distinct(self.kepler, since), glonass=_distinct(self.glonass, since))


T = TypeVar("T", KeplerRecords, GlonassRecords)
P = TypeVar("P", PreciseOrbits, PreciseClocks, IonosphereMaps, CodeBiases)

#: Least and most that a broadcast number may be, its sign apart. [SI]
_LIMITS = {
    "toe": (0.0, 1e10), "toc": (0.0, 1e10), "af0": (0.0, 1.0), "af1": (0.0, 1e-6), "af2": (0.0, 1e-9),
    "sqrt_a": (2.5e3, 1e4), "e": (0.0, 0.9), "i0": (0.0, 10.0), "omega0": (0.0, 10.0), "omega": (0.0, 10.0),
    "m0": (0.0, 10.0), "delta_n": (0.0, 1e-6), "idot": (0.0, 1e-6), "omega_dot": (0.0, 1e-4), "cuc": (0.0, 1e-2),
    "cus": (0.0, 1e-2), "cic": (0.0, 1e-2), "cis": (0.0, 1e-2), "crc": (0.0, 1e5), "crs": (0.0, 1e5),
    "accuracy": (0.0, 1e6), "a_dot": (0.0, 100.0), "delta_n_dot": (0.0, 1e-9), "clock": (0.0, 1.0), "rate": (0.0, 1e-5),
}  # fmt: skip
_MOST_COUNT = 2.0**62  # that a whole number may be
_STATES = {"r_e": (6e6, 1e8), "v_e": (0.0, 1e4), "a_e": (0.0, 1e-2)}  # lengths of the vectors

_INTEGERS = ("sat", "health", "issue", "source", "channel")
_COLUMNS = {"group_delay": 2, "r_e": 3, "v_e": 3, "a_e": 3}


def no_kepler() -> KeplerRecords:
    """No record at all."""
    return KeplerRecords(**_empty(KeplerRecords))


def no_glonass() -> GlonassRecords:
    """No record at all."""
    return GlonassRecords(**_empty(GlonassRecords))


def _merged(a: P | None, b: P | None) -> P | None:
    return a.merged_with(b) if a is not None and b is not None else a if a is not None else b


def _empty(kind: type) -> dict[str, np.ndarray]:
    return {f.name: np.zeros((0, _COLUMNS[f.name]) if f.name in _COLUMNS else 0) for f in fields(kind)}


def _possible(records: KeplerRecords | GlonassRecords) -> BoolArray:
    keep = np.ones(len(records), dtype=np.bool_)
    with np.errstate(all="ignore"):
        for name, (least, most) in {**_LIMITS, **_STATES}.items():
            values = getattr(records, name, None)
            if values is not None:
                size = np.linalg.norm(values, axis=1) if values.ndim == 2 else np.abs(values)
                unstated = np.isnan(size) if name == "accuracy" else False
                keep &= ((size >= least) & (size <= most)) | unstated
        if isinstance(records, KeplerRecords):
            keep &= records.e >= 0.0
    return keep


def _where(records: T, keep: BoolArray) -> T:
    return type(records)(**{f.name: getattr(records, f.name)[keep] for f in fields(records)})


def _distinct(records: T, since: float) -> T:
    """Messages from a reference time on, by satellite, reference times and contents of the clock, the last of each."""
    names = ("sat", "toe", "toc", "issue", "source", "af0", "health", "clock")
    keys = np.column_stack([getattr(records, name) for name in names if hasattr(records, name)])[::-1]
    _, first = np.unique(keys, axis=0, return_index=True)
    keep = np.zeros(len(records), dtype=np.bool_)
    keep[len(records) - 1 - first] = True
    return _where(records, keep & (records.toe >= since))


def _checked(records: KeplerRecords | GlonassRecords) -> None:
    n = len(records.sat)
    for f in fields(records):
        kind = np.int64 if f.name in _INTEGERS else np.float64
        given = np.asarray(getattr(records, f.name))
        if kind is np.int64 and given.dtype.kind == "f" and not np.all(np.abs(given) < _MOST_COUNT):
            wrong = given[~(np.abs(given) < _MOST_COUNT)][0]
            raise InputError(f"{type(records).__name__}.{f.name}: expected whole numbers, got {wrong}")
        value = given.astype(kind)
        shape = (n, _COLUMNS[f.name]) if f.name in _COLUMNS else (n,)
        if value.shape != shape:
            raise InputError(f"{type(records).__name__}.{f.name}: expected shape {shape}, got {value.shape}")
        object.__setattr__(records, f.name, value)


def _joined(a: T, b: T) -> T:
    return type(a)(**{f.name: np.concatenate((getattr(a, f.name), getattr(b, f.name))) for f in fields(a)})
