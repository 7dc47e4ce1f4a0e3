"""Where the receiver roughly is at each measurement, and in which direction it sees the satellite."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.gnss.coarse import along_track, coarse_track, directions

_ABOVE_CENTRE = 6.0e6  # [m]


@dataclass(frozen=True)
class ReceiverPlace:
    """One row for each measurement.

    Attributes
    ----------
    r_e : ndarray, shape (n, 3)
        Good to about 1 km, which changes an elevation by 10 arcsec; NaN if ``known`` is false. [m]
    elevation, azimuth : ndarray, shape (n,)
        Of the satellite; NaN where its place is unknown. [rad]
    known : bool
    notes : tuple of str
    """

    r_e: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    known: bool
    notes: tuple[str, ...] = ()


def receiver_place(
    t: FloatArray,
    pseudorange: FloatArray,
    r_sat_e: FloatArray,
    usable: BoolArray,
    *,
    position_e: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    header_position_e: tuple[float, float, float] | None = None,
) -> ReceiverPlace:
    """Positions given by the user, else found from the pseudoranges, else those of a file's header.

    Parameters
    ----------
    t : ndarray, shape (n,)
        In order. [s]
    pseudorange : ndarray, shape (n,)
        With the satellites' clocks taken out. [m]
    r_sat_e : ndarray, shape (n, 3)
        [m]
    usable : ndarray of bool, shape (n,)
        What to find a position from.
    position_e, header_position_e
        See :func:`schuler.gnss.preparation.prepare_ranges`.

    Returns
    -------
    ReceiverPlace

    Raises
    ------
    InputError
        For a position that is not Earth-fixed metres, or times that do not increase.

    Notes
    -----
    A position of its own is preferred to the header's, which stays where it is while the receiver moves and in many
    files is not filled in.
    """
    notes: list[str] = []
    if position_e is None:
        good = usable & np.isfinite(pseudorange)
        t_fix, r_fix = coarse_track(t[good], pseudorange[good], r_sat_e[good])
        if not len(t_fix) and header_position_e is not None and np.any(header_position_e):
            notes.append("no epoch has four good satellites: elevations are those at the position in the header")
            t_fix, r_fix = np.zeros(1), as_floats([header_position_e], "Observations.position_e", (1, 3))
        if not len(t_fix):
            notes.append(
                "no epoch has four good satellites and no position is known: no atmosphere taken out, no elevation mask"
            )
            nothing = np.full(len(t), np.nan)
            return ReceiverPlace(np.full((len(t), 3), np.nan), nothing, nothing, known=False, notes=tuple(notes))
    elif isinstance(position_e, tuple) and len(position_e) == 2:
        t_fix = as_floats(position_e[0], "position_e: times", (None,))
        r_fix = as_floats(position_e[1], "position_e: positions", (len(t_fix), 3))
        if not len(t_fix) or np.any(np.diff(t_fix) <= 0.0):
            raise InputError("position_e: expected at least one time, and times that increase")
    else:
        t_fix, r_fix = np.zeros(1), as_floats(position_e, "position_e", (3,))[None, :]
    if np.any(np.linalg.norm(r_fix, axis=1) < _ABOVE_CENTRE):
        raise InputError(
            f"position_e: expected Earth-fixed metres, more than 6000 km from the centre, got {r_fix[0].tolist()}; "
            "convert latitude and longitude with schuler.frames.ecef_from_llh"
        )
    r_e = along_track(t, t_fix, r_fix)
    elevation, azimuth = directions(r_e, r_sat_e)
    return ReceiverPlace(r_e, elevation, azimuth, known=True, notes=tuple(notes))
