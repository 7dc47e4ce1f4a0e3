"""Two receivers under the small sky: code and carrier with integers that are known."""

from dataclasses import dataclass, replace

import numpy as np
from sky import EPOCH, HOME, ephemerides, observe

from schuler.frames import C_en, llh_from_ecef
from schuler.gnss.ephemerides import Ephemerides
from schuler.gnss.observations import Observations
from schuler.gnss.signals import wavelengths
from schuler.gnss.troposphere import saastamoinen
from schuler.gnss.weighting import noise_scale

HOME_LLH = llh_from_ecef(HOME)


@dataclass(frozen=True)
class Pair:
    """Exact measurements of rover and base, and the rover's path from the base. (k,), (k, 3)"""

    rover: Observations
    base: Observations
    ephemerides: Ephemerides
    t: np.ndarray
    baseline_n: np.ndarray

    def noisy(self, rng, sigma_code=0.3, sigma_carrier=0.003) -> "Pair":
        """The same with noise as :func:`schuler.gnss.baseline.solve_baseline` expects it."""
        return replace(self, **{n: _noisy(getattr(self, n), rng, sigma_code, sigma_carrier) for n in ("rover", "base")})


def pair(rng, baseline_n, t, bands=("1C", "2W"), systems="GEC", each=18) -> Pair:
    """Rover at ``baseline_n(t)`` from the base, clocks 0.5 ms apart and drifting, ambiguities at random."""
    eph = ephemerides(rng, systems, each)
    axes = C_en(HOME_LLH)

    def path(t):
        return HOME + axes @ np.asarray(baseline_n(t), dtype=float)

    def delay_at(position):
        def delay_m(sat, f, elevation, azimuth, t):
            times, place = np.unique(t, return_inverse=True)
            llh = llh_from_ecef(np.stack([position(x) for x in times]))[place]
            return saastamoinen(llh, np.maximum(elevation, 0.05), EPOCH + t)

        return {"bands": bands, "delay_m": delay_m, "lowest": 0.2}

    base = observe(eph, t, lambda _: HOME, lambda t: 3e-4 + 1e-7 * t, **delay_at(lambda _: HOME))
    rover = observe(eph, t, path, lambda t: -2e-4 - 2e-7 * t, **delay_at(path))
    truth = np.stack([np.asarray(baseline_n(x), dtype=float) for x in t])
    return Pair(_with_carriers(rover, rng), _with_carriers(base, rng), eph, np.asarray(t, dtype=float), truth)


def _with_carriers(o: Observations, rng) -> Observations:
    carrier = o.pseudorange / cycles_of(o)
    for sat in np.unique(o.sat):
        for signal in range(len(o.signals)):
            carrier[(o.sat == sat) & (o.signal == signal)] += rng.integers(-1000, 1000)
    return replace(o, carrier=carrier)


def cycles_of(o: Observations) -> np.ndarray:
    """Wavelength of each row. Shape (n,). [m]"""
    out = np.full(len(o), np.nan)
    for k, name in enumerate(o.signals):
        for system in np.unique(o.sat[o.signal == k] // 100):
            m = (o.signal == k) & (o.sat // 100 == system)
            out[m] = wavelengths(o.sat[m], name)
    return out


def _noisy(o: Observations, rng, sigma_code: float, sigma_carrier: float) -> Observations:
    elevation = np.arcsin(np.clip((o.cn0 - 30.0) / 20.0, 0.0, 1.0))
    scale = noise_scale(elevation, o.cn0, "elevation+cn0")
    code, carrier = rng.standard_normal((2, len(o))) * scale
    return replace(
        o,
        pseudorange=o.pseudorange + sigma_code * code,
        carrier=o.carrier + sigma_carrier * carrier / cycles_of(o),
    )
