"""Satellite places, clocks, group delays, Doppler and atmosphere against a hardware simulator's exact truth.

The simulator (Spirent SimGEN) makes pseudoranges to 1 mm and Doppler shifts to 1 mHz from the broadcast messages and
the receiver's exact path, with a perfect receiver clock: what differs is the model.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from schuler.gnss.coarse import geometric_ranges
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.timebase import WEEK_S
from schuler.units import DEG

pytestmark = pytest.mark.realdata
WEEK = 2244
OMEGA = 7.2921151467e-5


@dataclass
class Simulation:
    ephemerides: object
    observations: dict
    t: np.ndarray  # time of week
    r_e: np.ndarray
    v_e: np.ndarray

    def prepared(self, name, **options) -> tuple[Ranges, np.ndarray, np.ndarray]:
        """Ranges, and the true place and velocity of the receiver at each."""
        o = self.observations[name]
        r = prepare_ranges(o, self.ephemerides, **options)
        tow = r.t + o.epoch_gps_s - WEEK * WEEK_S
        return r, *(
            np.stack([np.interp(tow, self.t, x[:, i]) for i in range(3)], axis=-1) for x in (self.r_e, self.v_e)
        )


@pytest.fixture(scope="module")
def simulation(shared_data):
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation
    from schuler.recording.formats.rinex_observation import read_rinex_observation

    folder = shared_data / "instinct_spirent"
    truth = np.genfromtxt(folder / "Rover-dynamic_PVA_Spirent.csv", delimiter=",", skip_header=1)
    truth = truth[np.unique(truth[:, 0], return_index=True)[1]]
    gps, galileo = (read_rinex_navigation(folder / f"RINEX_{x}_Spirent.23{y}") for x, y in (("GN", "N"), ("EN", "L")))
    observations = {
        name: read_rinex_observation(folder / f"iono-{name}" / "Rover-dynamic_MO_Spirent.obs")
        for name in ("none_tropo-none", "Klob_tropo-Saast")
    }
    return Simulation(gps.merged_with(galileo), observations, truth[:, 3], truth[:, 4:7], truth[:, 7:10])


def test_ranges_without_atmosphere(simulation):
    """The issue asks for 1 m; the model is right to the millimetre that the file prints."""
    r, true, _ = simulation.prepared("none_tropo-none", ionosphere="none", troposphere="none", elevation_mask=0.0)
    assert len(r) > 10_000
    assert r.used.all()
    assert r.groups == ("G", "E")
    error = r.pseudorange - geometric_ranges(r.r_sat_e, true)
    assert np.max(np.abs(error)) < 1.5e-3  # printed digits; seen 0.6 mm
    assert abs(np.mean(error)) < 1e-4


@pytest.mark.parametrize(
    "signals",
    [{"G": ("2X",), "E": ("5Q",)}, {"G": ("5I",), "E": ("7Q",)}],
    ids=["L2 and E5a", "L5 and E5b"],
)
def test_group_delays_of_other_signals(simulation, signals):
    r, true, _ = simulation.prepared(
        "none_tropo-none", ionosphere="none", troposphere="none", elevation_mask=0.0, signals=signals
    )
    error = r.pseudorange - geometric_ranges(r.r_sat_e, true)
    assert len(error) > 10_000
    assert np.max(np.abs(error)) < 2e-3  # printed digits


def test_the_combination_of_two_frequencies(simulation):
    options = {"ionosphere": "free", "elevation_mask": 0.0}
    r, true, _ = simulation.prepared("none_tropo-none", troposphere="none", **options)
    error = r.pseudorange - geometric_ranges(r.r_sat_e, true)
    assert np.max(np.abs(error)) < 5e-3  # printed digits times 3; seen 1.9 mm
    # with the ionosphere in the signals the combination is as good: what is left is the troposphere's
    a, true, _ = simulation.prepared("Klob_tropo-Saast", **options)
    b, _, _ = simulation.prepared("Klob_tropo-Saast", ionosphere="klobuchar", elevation_mask=0.0)
    same = np.abs(a.pseudorange - b.pseudorange)
    assert np.max(same) < 0.03  # at 4 deg, and the two rough places differ in height; seen 0.016


@pytest.mark.parametrize(("mask_deg", "largest", "rms"), [(0.0, 0.6, 0.25), (10.0, 0.3, 0.12)])
def test_ranges_with_atmosphere(simulation, mask_deg, largest, rms):
    """The issue asks for 1.5 m. What is left is the other humidity and mapping of the simulator's Saastamoinen."""
    r, true, _ = simulation.prepared("Klob_tropo-Saast", elevation_mask=mask_deg * DEG)
    error = (r.pseudorange - geometric_ranges(r.r_sat_e, true))[r.used]
    assert np.max(np.abs(error)) < largest  # seen 0.35 m at 4 deg, 0.22 m above 10 deg
    assert np.sqrt(np.mean(error**2)) < rms


def test_range_rates(simulation):
    """Rounding of the Doppler shift is 0.1 mm/s; the place of the truth between its rows adds as much."""
    r, true, v = simulation.prepared("none_tropo-none", ionosphere="none", troposphere="none", elevation_mask=0.0)
    u = r.r_sat_e - true
    u /= np.linalg.norm(u, axis=1)[:, None]
    x, w = r.r_sat_e, r.v_sat_e
    turning = OMEGA / SPEED_OF_LIGHT * (
        w[:, 0] * true[:, 1] + x[:, 0] * v[:, 1] - w[:, 1] * true[:, 0] - x[:, 1] * v[:, 0]
    )  # fmt: skip
    error = r.range_rate - np.sum(u * (w - v), axis=1) - turning
    assert np.max(np.abs(error)) < 2e-3  # seen 0.8 mm/s
    assert np.std(error) < 5e-4


def test_the_receiver_clock_is_perfect(simulation):
    """Times stay as they are, and no jump is found."""
    o = simulation.observations["none_tropo-none"]
    r, _, _ = simulation.prepared("none_tropo-none", ionosphere="none", troposphere="none", elevation_mask=0.0)
    assert np.array_equal(np.unique(r.t), o.epochs)
    assert not any("clock" in note for note in r.notes)
