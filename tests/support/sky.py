"""A small sky of four systems, and observations of it made by a forward model of its own."""

import numpy as np

from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.gnss.ephemerides import Ephemerides, GlonassRecords, KeplerRecords
from schuler.gnss.observations import Observations
from schuler.gnss.satellites import group_delays, satellite_states
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS, frequency_hz, satellite

EPOCH = 1.3e9 + 46_800.0  # GPS time of t = 0; a reference time of all messages [s]
OMEGA = 7.2921151467e-5
HOME = ecef_from_llh([0.85, 0.16, 320.0])


def ephemerides(rng, systems="GEC", each=12) -> Ephemerides:
    """Orbits at random; about a third of them in view."""
    rows = {name: [] for name in KeplerRecords.__dataclass_fields__}
    for letter in systems.replace("R", ""):
        for number in range(1, each + 1):
            values = dict.fromkeys(rows, 0.0)
            values |= {
                "sat": satellite(f"{letter}{number + 10:02d}"), "toe": EPOCH, "toc": EPOCH, "sent": EPOCH - 3600.0,
                "sqrt_a": 5153.6 + 100.0 * "GJEC".index(letter), "e": 0.01 * rng.random(), "i0": 0.96,
                "omega0": 2.0 * np.pi * rng.random(), "omega": 6.0 * rng.random(), "m0": 2.0 * np.pi * rng.random(),
                "af0": 1e-4 * rng.standard_normal(), "af1": 1e-11 * rng.standard_normal(), "accuracy": 2.0,
                "group_delay": 5e-9 * rng.standard_normal(2), "source": 0x205 if letter == "E" else 0,
            }  # fmt: skip
            for name, value in values.items():
                rows[name].append(value)
    kepler = KeplerRecords(**{name: np.array(value) for name, value in rows.items()})
    n = each if "R" in systems else 0
    m, node = 2.0 * np.pi * rng.random((2, n))
    a, speed, ci, si = 25.5e6, np.sqrt(3.986004418e14 / 25.5e6), np.cos(1.13), np.sin(1.13)

    def placed(x, y):
        h = y * ci
        return np.stack((x * np.cos(node) - h * np.sin(node), x * np.sin(node) + h * np.cos(node), y * si), axis=-1)

    r = a * placed(np.cos(m), np.sin(m))
    v = speed * placed(-np.sin(m), np.cos(m)) - np.cross([0.0, 0.0, OMEGA], r)
    glonass = GlonassRecords(
        sat=satellite("R01") + np.arange(n), toe=np.full(n, EPOCH), sent=np.full(n, EPOCH), r_e=r.reshape(n, 3),
        v_e=v.reshape(n, 3), a_e=np.zeros((n, 3)), clock=1e-5 * rng.standard_normal(n), rate=np.zeros(n),
        channel=np.arange(n) % 14 - 7, health=np.zeros(n),
    )  # fmt: skip
    return Ephemerides(kepler, glonass, (1e-8, 1e-8, -6e-8, -1e-7), (9e4, 5e4, -1.3e5, -3e5))


def observe(eph, t_true, position, clock_s, *, bands=("1C",), delay_m=None, lowest=0.0) -> Observations:
    """What a receiver at ``position(t)`` whose clock is ``clock_s(t)`` ahead would measure.

    The time of flight is found by iteration in axes that do not turn; a rate is a difference over 20 ms. ``delay_m(sat,
    f, elevation, azimuth, t)`` is added to the pseudoranges.
    """
    sats = np.concatenate((np.unique(eph.kepler.sat), np.unique(eph.glonass.sat)))
    channels = dict(zip(eph.glonass.sat.tolist(), eph.glonass.channel.tolist(), strict=True))

    def flight(sat, t):
        once = {one: position(one) for one in np.unique(t)}
        r = np.stack([once[one] for one in t])
        tau = np.full(len(t), 0.075)
        for _ in range(8):
            s = satellite_states(eph, sat, t - tau, epoch_gps_s=EPOCH)
            c, d = np.cos(OMEGA * tau), np.sin(OMEGA * tau)
            x, y, z = s.r_e.T
            turned = np.stack((c * x + d * y, -d * x + c * y, z), axis=-1)  # the Earth's axes at reception
            tau = np.linalg.norm(turned - r, axis=1) / SPEED_OF_LIGHT
        return tau, s, turned - r, r

    t_true = np.asarray(t_true, dtype=float)
    t, sat = np.repeat(t_true, len(sats)), np.tile(sats, len(t_true))
    clock, past, future = (np.array([clock_s(x + h) for x in t]) for h in (0.0, -0.01, 0.01))
    tau, s, line, r = flight(sat, t)
    n, e, down = np.einsum("nji,nj->in", C_en(llh_from_ecef(r)), line)
    elevation, azimuth = np.arctan2(-down, np.hypot(n, e)), np.arctan2(e, n)
    ahead, behind = flight(sat, t + 0.01), flight(sat, t - 0.01)
    rate = SPEED_OF_LIGHT * (ahead[0] - ahead[1].clock + future - behind[0] + behind[1].clock - past) / 0.02
    rows = []
    for name in bands:
        signal = np.array([band_of(one, name) or "" for one in sats])
        f = [frequency_hz(int(x), y, channels.get(int(x))) if y else np.nan for x, y in zip(sats, signal, strict=True)]
        band = np.tile([int(x[0]) if x else 0 for x in signal], len(t_true))
        tgd, _ = group_delays(s, sat, band)
        p = SPEED_OF_LIGHT * (tau + clock - s.clock + tgd)
        if delay_m is not None:
            p = p + delay_m(sat, np.tile(f, len(t_true)), elevation, azimuth, t)
        for i in np.flatnonzero((band > 0) & (elevation > lowest)):
            cn0 = 30.0 + 20.0 * np.sin(elevation[i])
            rows.append((t[i] + clock[i], sat[i], signal[i % len(sats)], p[i], rate[i], cn0))
    names = tuple(sorted({row[2] for row in rows}))
    order = sorted(range(len(rows)), key=lambda i: rows[i][0])
    rows = [rows[i] for i in order]
    column = [np.array(x) for x in zip(*rows, strict=True)]
    return Observations(
        column[0], column[1].astype(int), np.array([names.index(x) for x in column[2]]), names, column[3], column[4],
        np.full(len(rows), np.nan), column[5], EPOCH, channels,
    )  # fmt: skip


def band_of(sat, name):
    """The signal of this system in the place of GPS's ``name``; None if it has none."""
    place = {"1C": "1C", "2W": "2W", "5Q": "5Q"}[name]
    return {
        "G": place, "J": place, "R": {"1C": "1C", "2W": "2C"}.get(place), "E": {"1C": "1C", "5Q": "5Q"}.get(place),
        "C": {"1C": "2I", "2W": "6I"}.get(place),
    }[SYSTEMS[sat // 100]]  # fmt: skip
