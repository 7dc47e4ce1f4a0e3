"""Check of carrier phases and range rates against the code of their signal: unit, sign and band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, wavelengths

_PAUSE_S = 10.0  # over which a change is taken [s]
_FEWEST = 6  # changes
_ENOUGH = 300.0  # typical change times the root of their number: 5 m of noise then move the median by 1.7 % [m]
_FAR_OFF = 0.1  # of the quotient of a range rate and its code's, from one; of another band it is 22 % and more
_WITHIN = 0.03  # bands 2 and 5 differ by 4 %; noise moves the median of many changes by much less


def check_carriers(o: Observations, systems: str, name: str) -> None:
    """Refuse carriers of any signal of these systems as :func:`check_carrier_scale` does; GLONASS's are not used.

    Parameters
    ----------
    o : Observations
    systems : str
        Letters of the systems used.
    name : str
        The receiver, for the error.
    """
    for system in systems.replace("R", ""):
        for signal in o.signals:
            check_carrier_scale(o, system, signal, name)


def check_carrier_scale(o: Observations, system: str, signal: str, name: str) -> None:
    """Refuse carriers that do not change as the code of their satellite does.

    Parameters
    ----------
    o : Observations
    system : str
        Letter of :data:`schuler.gnss.signals.SYSTEMS`; not GLONASS.
    signal : str
        RINEX band and attribute.
    name : str
        The receiver, for the error.

    Raises
    ------
    InputError
        If the median change of carriers is not that of pseudoranges, to 3 %. Carriers in metres change by one over the
        wavelength too fast, those of another band by the ratio of both wavelengths. Logs with few or small changes from
        one epoch to the next pass, and those whose codes scatter too much to tell.
    """
    mine = (o.sat // 100 == SYSTEMS.index(system)) & np.isfinite(o.carrier) & np.isfinite(o.pseudorange)
    mine &= o.signal == o.signals.index(signal)
    rows = np.flatnonzero(mine)
    rows = rows[np.lexsort((o.t[rows], o.sat[rows]))]
    a, b = rows[:-1], rows[1:]
    neighbours = (o.sat[a] == o.sat[b]) & (o.t[b] - o.t[a] < _PAUSE_S)
    a, b = a[neighbours], b[neighbours]
    length = wavelengths(o.sat[a], signal)
    scale = _scale(length * (o.carrier[b] - o.carrier[a]), o.pseudorange[b] - o.pseudorange[a])
    if scale is None or abs(scale - 1.0) <= _WITHIN:
        return
    if abs(scale / length[0] - 1.0) < _WITHIN:
        cause = "carriers in metres"
    elif abs(scale + 1.0) < _WITHIN:
        cause = "carriers of the other sign"
    else:
        cause = "the carriers of another band"
    raise InputError(
        f"{name}: the carrier of {SYSTEM_NAMES[system]} {signal} changes {scale:.3f} times as much as its code; "
        f"expected 1 with cycles of {100.0 * length[0]:.1f} cm that grow with the range; these look like {cause}"
    )


def without_wrong_rates(o: Observations, systems: str) -> tuple[Observations, list[str]]:
    """Leave out range rates of signals whose codes change otherwise: Doppler shifts of the other sign, or in m/s.

    Parameters
    ----------
    o : Observations
    systems : str
        Letters of the systems used.

    Returns
    -------
    observations : Observations
        Without range rates where the median of their quotient with the pseudoranges' own rate is not 1 to a tenth.
    notes : list of str
        What was left out.
    """
    rows = np.flatnonzero(np.isfinite(o.range_rate) & np.isfinite(o.pseudorange))
    rows = rows[np.lexsort((o.t[rows], o.sat[rows], o.signal[rows]))]
    a, b = rows[:-1], rows[1:]
    code, dt = o.pseudorange[b] - o.pseudorange[a], o.t[b] - o.t[a]
    neighbours = (o.sat[a] == o.sat[b]) & (o.signal[a] == o.signal[b]) & (dt < _PAUSE_S)
    a, b, code = a[neighbours], b[neighbours], code[neighbours]
    moved = 0.5 * (o.range_rate[a] + o.range_rate[b]) * dt[neighbours]
    wrong, notes = np.zeros(len(o.t), dtype=bool), list[str]()
    system = o.sat // 100
    for letter in systems:
        for k, signal in enumerate(o.signals):
            mine = (system[a] == SYSTEMS.index(letter)) & (o.signal[a] == k)
            scale = _scale(moved[mine], code[mine])
            if scale is None or abs(scale - 1.0) <= _FAR_OFF:
                continue
            wrong |= (system == SYSTEMS.index(letter)) & (o.signal == k)
            length = float(np.median(wavelengths(o.sat[a[mine]], signal)))
            cause = (
                "of the other sign" if scale < 0.0 else "of another band" if 0.7 < scale < 1.5 else "in another unit"
            )
            cause += " and in m/s, not Hz" if abs(abs(scale) / length - 1.0) < _WITHIN and scale < 0.0 else ""
            notes.append(
                f"range rates of {SYSTEM_NAMES[letter]} {signal} are {scale:.2f} times what their pseudoranges change "
                f"by, and were left out; these look like Doppler shifts {cause} (expected in Hz, positive for a "
                "satellite that approaches)"
            )
    return (replace(o, range_rate=np.where(wrong, np.nan, o.range_rate)) if notes else o), notes


def _scale(moved: FloatArray, code: FloatArray) -> float | None:
    """Median quotient of what ranges changed by, by carriers or rates, and by codes; None if it tells nothing.

    Of the larger half of the changes by the first, which has little noise: of changes that are large by their codes
    noise made many so, and quotients would be too small. Shapes (n,). [m]
    """
    if not len(code):
        return None
    typical = np.median(np.abs(moved))
    large = np.abs(moved) >= typical
    n = int(np.sum(large))
    if n < _FEWEST or np.median(np.abs(code[large])) * np.sqrt(n) < _ENOUGH:
        return None
    if typical == 0.0:
        return 0.0
    quotient = code[large] / moved[large]
    middle = np.median(quotient)
    if np.median(np.abs(quotient - middle)) > abs(middle - 1.0):
        return None  # noise of codes alone would scatter them as far
    return float(1.0 / middle)
