"""Phase centres of antennas of receivers and satellites, and nominal attitude of satellites."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.signals import BANDS, GLONASS_BANDS, SYSTEMS
from schuler.gnss.sun_and_moon import sun_direction

#: Bands of the two signals without ionosphere that precise clocks are of.
_PAIRS = {"G": "12", "J": "12", "E": "15", "C": "26"}


@dataclass(frozen=True)
class Antenna:
    """Phase centres of one antenna type, or of one satellite's antenna.

    Attributes
    ----------
    name : str
        Type and radome, such as ``TRM59800.00     SCIT``.
    sat : int
        Satellite, see :func:`schuler.gnss.signals.satellite`; 0 of a receiver's antenna.
    begin, end : float
        GPS time in which it holds. [s]
    offset : dict of str to ndarray, shape (3,)
        Mean phase centre by frequency (``G01``): north, east, up of the antenna's reference point; of a satellite x, y,
        z of the centre of mass, z to the Earth, y along the axis of the panels. [m]
    zenith : ndarray, shape (z,)
        Angles from the zenith, or of a satellite from its z axis. [rad]
    azimuth : ndarray, shape (a,)
        Azimuths of the variations; empty where they have none. [rad]
    variation : dict of str to ndarray, shape (z,) or (a, z)
        To be added to the range, by frequency. [m]
    """

    name: str
    sat: int
    begin: float
    end: float
    offset: dict[str, FloatArray]
    zenith: FloatArray
    azimuth: FloatArray
    variation: dict[str, FloatArray]


def receiver_antenna(antennas: tuple[Antenna, ...], name: str) -> Antenna:
    """Antenna of a receiver by type and radome, blanks and case aside; without a radome that of ``NONE``.

    Raises
    ------
    InputError
        If there is none, with names that are like it.
    """
    names = {" ".join(a.name.split()).upper(): a for a in antennas if not a.sat}
    wanted = " ".join(name.split()).upper()
    for one in (wanted, f"{wanted} NONE"):
        if one in names:
            return names[one]
    if not names:
        raise InputError(f"antenna {name!r}: no receiver's antennas are there: give an ANTEX file with the ephemerides")
    like = get_close_matches(wanted, names, 3, 0.4)
    raise InputError(
        f"antenna {name!r}: expected one of the {len(names)} receivers' antennas of the ANTEX file"
        + (f", such as {', '.join(like)}" if like else ", there is none like it")
    )


def antenna_of(
    antennas: tuple[Antenna, ...], stated: str, given: str | None, receiver: str, notes: list[str]
) -> Antenna | None:
    """Antenna of a receiver: the one that is given, else the one its log states, if an ANTEX file is there.

    Parameters
    ----------
    antennas : tuple of Antenna
        Of the ephemerides.
    stated : str
        As in :class:`schuler.gnss.observations.Observations`.
    given : str, optional
        Type and radome; ``none``: phase centres are not taken out.
    receiver : str
        ``rover`` or ``base``, for the notes.
    notes : list of str
        Gets a sentence where the two differ, or where the one stated is not in the file.

    Raises
    ------
    InputError
        As :func:`receiver_antenna`, for the one that is given.
    """
    if given is not None and given.strip().lower() == "none":
        return None
    if given is not None:
        if stated and not _alike(stated, given):
            notes.append(f"{receiver}: antenna {given} is used, although its log states {stated}")
        return receiver_antenna(antennas, given)
    if not stated or all(a.sat for a in antennas):
        return None
    try:
        return receiver_antenna(antennas, stated)
    except InputError:
        notes.append(
            f"{receiver}: antenna {stated} of its log is not in the ANTEX file: its phase centre is not taken out"
        )
        return None


def antenna_pair(
    antennas: tuple[Antenna, ...], stated: tuple[str, str], given: tuple[str | None, str | None], notes: list[str]
) -> tuple[Antenna | None, Antenna | None]:
    """Antennas of rover and base, see :func:`antenna_of`; neither where one is not known and none is given.

    A phase centre is some centimetres above its reference point: taken out at one end alone it would shift the baseline
    by as much, where antennas of one type cancel. Antennas that differ and are not corrected are noted.
    """
    rover, base = (
        antenna_of(antennas, s, g, name, notes) for s, g, name in zip(stated, given, ("rover", "base"), strict=True)
    )
    if (rover is None) != (base is None):
        if given == (None, None):
            rover, base = None, None
            notes.append("phase centres are taken out of neither receiver, since one of the antennas is not known")
        else:
            without = "rover" if rover is None else "base"
            notes.append(f"the {without}'s phase centre is not taken out: the height is off by it, some centimetres")
    if rover is None and base is None and all(stated) and not _alike(*stated):
        notes.append(
            f"antennas differ, {stated[0]} and {stated[1]}, and their phase centres are not taken out: heights are off "
            "by centimetres; give an ANTEX file that has both"
        )
    return rover, base


def _alike(a: str, b: str) -> bool:
    """Whether two names are of one antenna; no radome is ``NONE``."""
    one, other = (" ".join(name.split()).upper().removesuffix(" NONE") for name in (a, b))
    return one == other


def phase_delays(
    antenna: Antenna, sat: IntArray, band: IntArray, elevation: FloatArray, azimuth: FloatArray, notes: list[str]
) -> FloatArray:
    """Phase corrections of many satellites, zero where the band is 0. Shape (n,). [m]

    Parameters
    ----------
    antenna : Antenna
    sat, band : ndarray of int, shape (n,)
    elevation, azimuth : ndarray, shape (n,)
        [rad]
    notes : list of str
        Gets a sentence on frequencies that the antenna does not have.
    """
    out, missing = np.zeros(len(sat)), set()
    kinds = np.where(band > 0, 10 * (sat // 100) + band, -1)
    for kind in np.unique(kinds[kinds >= 0]).tolist():
        rows, system, one = kinds == kind, SYSTEMS[kind // 10], str(kind % 10)
        out[rows], own = phase_correction(antenna, system, one, elevation[rows], azimuth[rows])
        missing |= set() if own else {f"{system}0{one}"}
    if missing:
        notes.append(f"antenna {antenna.name}: GPS L1 or L2 stands in for {', '.join(sorted(missing))}")
    return out


def phase_correction(
    antenna: Antenna, system: str, band: str, elevation: FloatArray, azimuth: FloatArray
) -> tuple[FloatArray, bool]:
    """What a receiver's antenna adds to ranges from its reference point.

    Parameters
    ----------
    antenna : Antenna
    system, band : str
        RINEX letters. Where the antenna has no such frequency, GPS L1 or L2 stands in, whichever is nearer.
    elevation, azimuth : ndarray, shape (n,)
        [rad]

    Returns
    -------
    correction : ndarray, shape (n,)
        ``variation - offset . u``, u from receiver to satellite. [m]
    own : bool
        Whether the antenna has this frequency.

    Raises
    ------
    InputError
        If the antenna has none of these frequencies.

    References
    ----------
    Rothacher and Schmid (2010), ANTEX: The Antenna Exchange Format, version 1.4.
    """
    code = f"{system}0{band}"
    frequency = GLONASS_BANDS[band][0] if system == "R" and band in GLONASS_BANDS else BANDS[(system, band)]
    near = "G01" if frequency > 1.4e9 else "G02"
    key = code if code in antenna.offset else near
    if key not in antenna.offset:
        raise InputError(f"antenna {antenna.name}: neither {code} nor {near} is in the ANTEX file")
    u = np.stack((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)), axis=-1)
    table, zenith = antenna.variation[key], 0.5 * np.pi - elevation
    if table.ndim == 1:
        variation = np.interp(zenith, antenna.zenith, table)
    else:
        at = np.interp(np.mod(azimuth, 2.0 * np.pi), antenna.azimuth, np.arange(len(table)))
        k = np.minimum(at.astype(np.int64), len(table) - 2)
        by_azimuth = np.stack([np.interp(zenith, antenna.zenith, row) for row in table])
        n = np.arange(len(zenith))
        variation = by_azimuth[k, n] + (at - k) * (by_azimuth[k + 1, n] - by_azimuth[k, n])
    return np.asarray(variation - u @ antenna.offset[key]), key == code


def satellite_offsets(antennas: tuple[Antenna, ...], sat: IntArray, t: FloatArray, r_e: FloatArray) -> FloatArray:
    """Phase centres of satellites' antennas from their centres of mass, Earth-fixed, for both frequencies of a clock.

    Parameters
    ----------
    antennas : tuple of Antenna
    sat : ndarray of int, shape (n,)
    t : ndarray, shape (n,)
        GPS time. [s]
    r_e : ndarray, shape (n, 3)
        Centres of mass. [m]

    Returns
    -------
    ndarray, shape (n, 3)
        Zero for satellites whose antennas are not there. [m]

    Notes
    -----
    Nominal attitude: z to the Earth, y across z and the Sun. In the Earth's shadow satellites turn otherwise, which
    moves x and y, some decimetres at most.
    """
    body = np.zeros((len(sat), 3))
    for antenna in antennas:
        letter = SYSTEMS[antenna.sat // 100]
        if not antenna.sat or letter not in _PAIRS:
            continue
        rows = (sat == antenna.sat) & (t >= antenna.begin) & (t <= antenna.end)
        codes = [f"{letter}0{band}" for band in _PAIRS[letter]]
        if not rows.any() or not all(code in antenna.offset for code in codes):
            continue
        first, second = (BANDS[(letter, band)] ** 2 for band in _PAIRS[letter])
        a, b = (antenna.offset[code] for code in codes)
        body[rows] = (first * a - second * b) / (first - second)
    z = -r_e / np.linalg.norm(r_e, axis=1)[:, None]
    y = np.cross(z, sun_direction(t))
    y /= np.linalg.norm(y, axis=1)[:, None]
    return np.asarray(np.cross(y, z) * body[:, :1] + y * body[:, 1:2] + z * body[:, 2:])
