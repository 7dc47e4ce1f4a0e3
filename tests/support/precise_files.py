"""Texts of SP3 and RINEX clock files of circular orbits, whose positions are closed forms."""

import numpy as np

from schuler.gnss.signals import satellite_name
from schuler.timebase import calendar


def clock_of(sat, t):
    """Clock of a satellite that a straight line describes [s]."""
    return 1e-5 * (sat % 7 - 3) + 1e-11 * (sat % 5 - 2) * t


def sp3_text(orbits, t, *, scale="GPS", shift=0.0, km=1e-3):
    """SP3-d of satellites at GPS times ``t``, stamped ``shift`` later in another scale."""
    r, _ = orbits.states(t)
    names = [satellite_name(int(s)) for s in orbits.sat]
    rows = [f"#dP{date(t[0] + shift)} {len(t):7d} ORBIT IGS20 FIT TEST", "## 2155 259200.0 900.0 59332 0.0"]
    listed, starts = (names + ["  0"] * 85)[:85], range(0, 85, 17)
    rows += [f"+  {len(names) if k == 0 else '':>4}  " + "".join(listed[k : k + 17]) for k in starts]
    rows += ["++       " + "".join(f"{5 * (n < len(names)):3d}" for n in range(k, k + 17)) for k in starts]
    rows += [f"%c M  cc {scale} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc", "/* written by a test"]
    for i, when in enumerate(t):
        rows.append(f"*  {date(when + shift)}")
        for j, name in enumerate(names):
            x, y, z = km * r[i, j]
            rows.append(f"P{name}{x:14.6f}{y:14.6f}{z:14.6f}{1e6 * clock_of(int(orbits.sat[j]), when - t[0]):14.6f}")
    return "\n".join([*rows, "EOF", ""])


def clk_text(sats, t, t0, version="3.00"):
    """RINEX clocks every so often; 3.04 has longer names and its labels five columns further right."""
    wide = version == "3.04"
    label = 65 if wide else 60
    kind = f"{version:>9}" + (" " * 12 if wide else " " * 11) + "C"
    rows = [f"{kind:<{label}}RINEX VERSION / TYPE", f"{'   GPS':<{label}}TIME SYSTEM ID", f"{'':<{label}}END OF HEADER"]
    for when in t:
        rows.append(f"AR ZIMM {date(when)}  1    1.0E-07")
        for sat in sats:
            name = satellite_name(int(sat)) + ("      " if wide else " ")
            rows.append(f"AS {name}{date(when)}  2   {clock_of(int(sat), when - t0):19.12E}    1.0E-11")
    return "\n".join([*rows, ""])


def date(gps_s):
    d = calendar(float(np.round(gps_s)))
    return f"{d.year:4d} {d.month:2d} {d.day:2d} {d.hour:2d} {d.minute:2d} {0.0 + d.second:11.8f}"
