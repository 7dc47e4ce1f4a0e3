"""Tightly coupled navigation on real recordings: against RTK, against a simulator's exact truth, parked, with gaps."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from places import EXAMPLES

import schuler
from schuler import frames, rotation
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.inputs.satellites import limited
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import IdealImu, ideal_imu, simulate_imu
from schuler.simulation.profiles import SplineMotion
from schuler.units import DEG

pytestmark = pytest.mark.realdata


def example(name: str, *changes) -> NavigationConfig:
    return NavigationConfig.load(EXAMPLES / name, [("filter.smooth", False), *changes])


# --- a walk against RTK -----------------------------------------------------------------------------------------------


@dataclass
class Walk:
    recording: Recording
    ranges: object

    def offsets(self, t, r_e):
        """North, east, down from RTK to positions of the antenna, at times within the RTK log."""
        ref = self.recording.reference
        k = (t >= ref.t[0]) & (t <= ref.t[-1])
        rtk = np.stack([np.interp(t[k], ref.t, ref.r_eb_e[:, i]) for i in range(3)], axis=1)
        return t[k], np.einsum("nji,nj->ni", frames.C_en(frames.llh_from_ecef(rtk)), r_e[k] - rtk)

    def run(self, *changes, ranges=None):
        recording = self.recording if ranges is None else replace(self.recording, ranges=ranges)
        result = navigate(recording, example("rtkexp_walk.toml", *changes))
        a = result.antenna()
        return result, *self.offsets(a.t, a.r_eb_e)


@pytest.fixture(scope="module")
def walk(shared_data):
    parts = example("rtkexp_walk.toml").recording
    recording = schuler.read(shared_data / "rtkexp_walk", **parts)
    return Walk(recording, prepare_ranges(recording.observations, recording.ephemerides, systems="GEC"))


@pytest.fixture(scope="module")
def whole_walk(walk):
    return walk.run()


def horizontal(e):
    return float(np.hypot(*e.std(axis=0)[:2]))


@pytest.mark.campaign
def test_walk_scatters_less_than_single_points(walk, whole_walk):
    """The base station's own position is metres off, so RTK says how a track moves, not where it is.

    Compared are scatters about each one's mean offset, over the same time: 0.34 m against 0.93 m seen. The two mean
    offsets agree, as they must if the offset is the base station's.
    """
    _, t, e = whole_walk
    p = solve_points(walk.ranges)
    t_p, e_p = walk.offsets(p.t[p.ok], p.r_e[p.ok])
    e_p = e_p[t_p >= t[0]]
    assert horizontal(e) < 0.45  # the issue: not worse than the single points' 1 m
    assert horizontal(e) < 0.5 * horizontal(e_p)
    assert e[:, 2].std() < e_p[:, 2].std()
    np.testing.assert_allclose(e.mean(axis=0)[:2], e_p.mean(axis=0)[:2], atol=0.4)  # slow errors of ranges
    # claimed sigma, of what scatters: neither much more nor much less
    result = whole_walk[0]
    ratio = horizontal(e) / np.hypot(*result.sigma("dr")[10:, :2].mean(axis=0))
    assert 0.5 < ratio < 2.0


@pytest.mark.campaign
def test_walk_smoothed_is_calmer(walk):
    smoothed = navigate(walk.recording, example("rtkexp_walk.toml", ("filter.smooth", True))).smooth().antenna()
    _, e = walk.offsets(smoothed.t, smoothed.r_eb_e)
    assert horizontal(e) < 0.45
    assert np.abs(np.diff(e, axis=0)).max() < 0.1  # no steps at all: RTK's own are the largest


CYCLE = 299_792_458.0 / 1.57542e9
CARRIERS = (("gnss.tight.carrier", "time-differenced"), ("gnss.tight.carrier_sigma_m", 0.007))


@pytest.mark.campaign
def test_walk_with_carriers_scatters_half_as_much(walk, whole_walk):
    """0.08 m north, 0.12 m east against 0.23 and 0.24 m seen; smoothed 0.03 and 0.04 m."""
    result, _, e = walk.run(*CARRIERS)
    assert horizontal(e) < 0.5 * horizontal(whole_walk[2])
    phases = result.innovations.of("carrier_phase")
    assert 0.7 < np.nanmean(phases.nis) < 1.4
    assert np.mean(phases.status == 1) > 0.98
    config = example("rtkexp_walk.toml", *CARRIERS, ("filter.smooth", True))
    smoothed = navigate(walk.recording, config).smooth().antenna()
    _, e = walk.offsets(smoothed.t, smoothed.r_eb_e)
    assert np.all(e.std(axis=0) < (0.06, 0.06, 0.1))


def test_walk_innovations_are_honest(whole_walk):
    result = whole_walk[0]
    counts = result.innovations.counts()
    assert counts["pseudorange"]["accepted"] > 7000
    assert result.innovations.rejected()["range_rate"] < 40
    assert 0.7 < np.nanmean(result.innovations.of("range_rate").nis) < 2.0  # 1.5 seen; hands have long tails
    # sigmas of ranges are those of errors that last: they do not scatter like that
    assert np.nanmean(result.innovations.of("pseudorange").nis) < 0.3
    assert any("range rates were enlarged" in note for note in result.notes)


@pytest.mark.parametrize(
    ("entry", "value", "largest"),
    [
        pytest.param(
            "gnss.tight.clock_drift_noise_m_s", 0.003, 40.0, marks=pytest.mark.campaign
        ),  # 25 m seen, 1e19 m where clocks were not enlarged
        ("gnss.gate", 0.5, 10.0),  # 4 m, 8e8 m
        pytest.param("gnss.tight.carrier_sigma_m", 1e-5, 10.0, marks=pytest.mark.campaign),
    ],
)
def test_walk_with_an_absurd_setting_says_so_and_does_not_run_away(walk, entry, value, largest):
    more = CARRIERS[:1] if "carrier" in entry else ()
    result, _, e = walk.run(*more, (entry, value))
    assert result.verdict.status != "ok"
    assert np.abs(e - np.median(e, axis=0))[:, :2].max() < largest


@pytest.mark.campaign
@pytest.mark.parametrize(("noise", "slips_seen"), [(0.3, 0), ("log", 5)])
def test_walk_with_one_satellite_finds_a_slip_of_a_cycle_by_a_clock_as_the_log_shows_it(walk, noise, slips_seen):
    """A cycle in the middle of each of five windows of 8 s; a wide clock takes it in."""
    start = walk.ranges.t[0]
    middle = start + np.arange(34.0, 99.0, 16.0)
    lone = limited(walk.ranges, 1, 1, tuple((t - 4.0, t + 4.0) for t in middle))
    slips = np.zeros(len(lone))
    for t in middle:
        sat = lone.sat[lone.used & (np.abs(lone.t - t) < 0.01)]
        slips += CYCLE * ((lone.sat == sat[0]) & (lone.t > t - 0.01))
    slipped = replace(lone, carrier_range=lone.carrier_range + slips)
    phases = walk.run(*CARRIERS, ("gnss.tight.clock_noise_m", noise), ranges=slipped)[0].innovations.of("carrier_phase")
    inside = np.abs(phases.t[:, None] - middle).min(axis=1) < 4.0
    rejected = phases.t[inside & (phases.status == 2)]
    assert len(rejected) == slips_seen
    np.testing.assert_allclose(rejected, middle[:slips_seen], atol=0.01)


@pytest.mark.campaign
@pytest.mark.parametrize("scale", [pytest.param(1e-6, marks=pytest.mark.campaign), 1e6])
def test_walk_with_range_rates_whose_sigma_is_absurd_is_judged(walk, scale):
    """Innovations that are no numbers, or count for nothing, were divided by their count: zero."""
    result, _, _ = walk.run(("gnss.tight.rate_sigma_scale", scale), ("gnss.tight.range_sigma_scale", max(scale, 1.0)))
    assert result.verdict.status != "ok"


@pytest.mark.campaign
@pytest.mark.parametrize(("most", "largest"), [(3, 3.0), (2, 5.0), (1, 15.0)])
@pytest.mark.parametrize("begin", [60.0, pytest.param(75.0, marks=pytest.mark.campaign)])
def test_walk_goes_on_with_a_subset_of_satellites(walk, whole_walk, most, largest, begin):
    """Twenty seconds with three, two, one satellite: bounded, within what is claimed, and back at once."""
    start = walk.ranges.t[0]
    window = (start + begin, start + begin + 20.0)
    result, t, e = walk.run(ranges=limited(walk.ranges, 1, most, (window,)))
    e = e - whole_walk[2].mean(axis=0)
    error = np.hypot(e[:, 0], e[:, 1])
    inside = (t >= window[0]) & (t < window[1])
    assert error[inside].max() < largest
    sigma = np.hypot(*result.sigma("dr").T[:2])
    claimed = np.interp(t, result.t, sigma)
    assert np.mean(error[inside] < 3.0 * claimed[inside]) > 0.95
    after = t > window[1] + 2.0
    assert np.sqrt(np.mean(error[after] ** 2)) < 1.3
    used = result.innovations.of("range_rate")
    within = (used.t >= window[0]) & (used.t < window[1])
    assert 0 < np.sum(within) <= 80 * most


@pytest.mark.campaign
def test_walk_with_a_subset_of_satellites_all_along(walk):
    """By the entry of the configuration: the uncertainty says what is lost."""
    sigma = {}
    for most in (12, 6, 5, 4):
        result, _, e = walk.run(("gnss.tight.max_satellites", most))
        sigma[most] = np.linalg.norm(result.sigma("dr")[-1])
        assert result.innovations.of("pseudorange").t.size <= most * 540
        if most >= 5:
            assert horizontal(e) < 2.0
    assert list(sigma.values()) == sorted(sigma.values())


@pytest.mark.campaign
def test_walk_with_other_systems_and_files(walk, shared_data):
    for systems, most in (("GE", 0.6), ("GC", 1.0), ("EC", 1.0)):
        _, _, e = walk.run(("gnss.tight.systems", systems))
        assert horizontal(e) < most, systems


# --- a simulated sky with exact truth ---------------------------------------------------------------------------------

SETS = {
    "none_tropo-none": {"ionosphere": "none", "troposphere": "none"},
    "Klob_tropo-Saast": {"ionosphere": "klobuchar", "troposphere": "saastamoinen"},
}
IMU = "HG1700-flenniken"


@dataclass
class Spirent:
    ideal: IdealImu
    truth: Trajectory
    skies: dict
    ranges: dict

    def recording(self, name: str, errors: ImuErrors, seed: int, *, noise: bool) -> Recording:
        """Ranges as they are, or with white noise of their standard deviations; an IMU with errors."""
        imu = simulate_imu(self.ideal, errors, np.random.default_rng(seed)).imu
        imu = replace(imu, t=imu.t + self.truth.t[0])
        sky = replace(self.skies[name], imu=imu, reference=self.truth)
        if not noise:
            return sky
        r, rng = self.ranges[name], np.random.default_rng(1000 + seed)
        noisy = replace(
            r,
            pseudorange=r.pseudorange + r.sigma_range * rng.standard_normal(len(r)),
            range_rate=r.range_rate + r.sigma_rate * rng.standard_normal(len(r)),
        )
        return replace(sky, ranges=noisy)

    def run(self, name: str, errors: ImuErrors, seed: int, *, noise: bool):
        changes = [(f"gnss.tight.{key}", value) for key, value in SETS[name].items()]
        recording = self.recording(name, errors, seed, noise=noise)
        result = navigate(recording, example("instinct_spirent.toml", *changes))
        d = result.states.r_eb_e - self.truth.at(result.t).r_eb_e
        return result, np.einsum("nji,nj->ni", frames.C_en(result.states.llh), d)


@pytest.fixture(scope="module")
def spirent(shared_data):
    folder = shared_data / "instinct_spirent"
    x = np.genfromtxt(folder / "Rover-dynamic_PVA_Spirent.csv", delimiter=",", skip_header=1)
    x = x[np.unique(x[:, 0], return_index=True)[1]][::5]
    motion = SplineMotion.through(x[:, 3] - x[0, 3], frames.llh_from_ecef(x[:, 4:7]), x[:, 10:13] * DEG)
    ideal = ideal_imu(motion, 50.0)
    truth = Trajectory(ideal.truth.t + x[0, 3], ideal.truth.r_eb_e, ideal.truth.v_eb_e, ideal.truth.q_eb)
    ephemerides = {"file": ["RINEX_GN_Spirent.23N", "RINEX_EN_Spirent.23L"]}
    skies = {
        name: schuler.read(
            folder, observations={"file": f"iono-{name}/Rover-dynamic_MO_Spirent.obs"}, ephemerides=ephemerides
        )
        for name in SETS
    }
    ranges = {
        name: prepare_ranges(s.observations, s.ephemerides, systems="GE", **SETS[name]) for name, s in skies.items()
    }
    return Spirent(ideal, truth, skies, ranges)


@pytest.fixture(scope="module")
def perfect(spirent):
    """Navigation with a perfect IMU under a sky by its name, once: result and errors of position. [m]"""
    return functools.cache(lambda name: spirent.run(name, ImuErrors.none(), 0, noise=False))


@pytest.mark.campaign
def test_the_spline_is_the_simulators_path(spirent, shared_data):
    """Between the nodes it was laid through, every half second: the file's own rows.

    Positions to their printed millimetre; velocities are no nearer to the slope of the positions than this.
    """
    x = np.genfromtxt(shared_data / "instinct_spirent" / "Rover-dynamic_PVA_Spirent.csv", delimiter=",", skip_header=1)
    x = x[(x[:, 3] > 36_005.0) & (x[:, 3] < 36_595.0)]
    at = spirent.truth.at(x[np.unique(x[:, 0], return_index=True)[1], 3])
    x = x[np.unique(x[:, 0], return_index=True)[1]]
    assert np.abs(at.r_eb_e - x[:, 4:7]).max() < 2e-3
    assert np.abs(at.v_eb_e - x[:, 7:10]).max() < 5e-3


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "level", "height"), [("none_tropo-none", 0.02, 0.03), ("Klob_tropo-Saast", 0.04, 0.25)]
)
@pytest.mark.thinned(2)
def test_spirent_with_a_perfect_imu(perfect, name, level, height):
    """What is left is the models': nothing without an atmosphere, its mapping with one."""
    result, e = perfect(name)
    rms = np.sqrt(np.mean(e**2, axis=0))
    assert rms[:2].max() < level  # 6 mm and 24 mm seen
    assert rms[2] < height  # 10 mm and 0.17 m seen
    assert not any(result.innovations.rejected().values())


@pytest.mark.campaign
@pytest.mark.parametrize("name", list(SETS))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_spirent_finds_injected_biases(spirent, name, sign):
    """Biases of both signs, an order above the budget's; ranges without noise, so the estimate is within a sigma."""
    spec = catalogue.spec(IMU)
    b_g = sign * 10.0 * spec.gyro.bias_instability * np.array([1.0, -1.0, 1.0])
    b_a = sign * 2.0 * spec.accel.bias_instability * np.array([-1.0, 1.0, 1.0])
    errors = ImuErrors(b_g=b_g, b_a=b_a)
    config = example(
        "instinct_spirent.toml",
        *[(f"gnss.tight.{key}", value) for key, value in SETS[name].items()],
        ("filter.models", {"b_g": {"sigma": 2e-4, "noise": 1e-7}, "b_a": {"sigma": 2e-3, "noise": 1e-6}}),
    )
    result = navigate(spirent.recording(name, errors, 1, noise=False), config)
    for block, true in (("b_g", b_g), ("b_a", b_a)):
        error, sigma = result.parameter(block)[-1] - true, result.sigma(block)[-1]
        assert np.all(np.abs(error) < 1.5 * sigma), (block, error / sigma)
        observable = sigma < 0.5 * result.sigma(block)[0]
        assert observable.any()
        assert np.all(np.sign(result.parameter(block)[-1][observable]) == np.sign(true[observable]))
    d = result.states.r_eb_e - spirent.truth.at(result.t).r_eb_e
    assert np.linalg.norm(d, axis=1)[60:].max() < 0.6


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [6, pytest.param(40, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", list(SETS))
@pytest.mark.thinned(2)
def test_spirent_nees_is_in_band(spirent, name, runs):
    """NEES of position, velocity and attitude with the catalogue's errors and white noise as the budget has it.

    The budget of ranges holds errors that last; as white noise they are what the filter believes, so the test is of the
    whole chain. Neighbouring records are alike: the band is that of records a minute apart.
    """
    spec, values = catalogue.spec(IMU), []
    for seed in range(runs):
        errors = ImuErrors.draw(spec, np.random.default_rng(seed))
        result, _ = spirent.run(name, errors, seed, noise=True)
        values.append(result.nees(spirent.truth)[: int(595.0)])
    nees = np.array(values)
    low, high = chi_square_band(9, runs * 10, 1.0 - 1e-5)
    assert low < nees.mean() < high, nees.mean()  # 1.02 and 0.99 seen with eight
    assert np.all(nees < 8.0)


@pytest.mark.campaign
def test_spirent_satellites_rise_and_set_without_a_jump(spirent, perfect):
    """G13 stops at 10:05, G08 at 10:07:28, G17 begins at 10:03; the reference time of the messages stays one."""
    _, e = perfect("none_tropo-none")
    step = np.abs(np.diff(e, axis=0))
    assert step.max() < 0.01
    r = spirent.ranges["none_tropo-none"]
    count = np.unique(r.t[r.used], return_counts=True)[1]
    assert len(set(count)) > 1


# --- a vehicle with a good IMU, without truth -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def vehicle(shared_data):
    return schuler.read(shared_data / "psins_tc" / "insgpseo_tc.mat")


def test_vehicle_agrees_with_its_single_points(vehicle):
    result = navigate(vehicle, example("psins_tc.toml"))
    p = solve_points(prepare_ranges(vehicle.observations, vehicle.ephemerides, systems="G"))
    a = result.antenna()
    k = p.ok & (p.t >= a.t[0]) & (p.t <= a.t[-1])
    assert k.sum() > 55
    d = np.stack([np.interp(p.t[k], a.t, a.r_eb_e[:, i]) for i in range(3)], axis=1) - p.r_e[k]
    ned = np.einsum("nji,nj->ni", frames.C_en(p.llh[k]), d)
    assert np.abs(ned.mean(axis=0)).max() < 0.3
    assert ned.std(axis=0).max() < 0.6
    counts = result.innovations.counts()
    assert counts["pseudorange"]["accepted"] == 435
    assert counts["range_rate"]["accepted"] >= 431  # four at two epochs are rejected
    ranges = result.innovations.of("pseudorange")
    assert np.sqrt(np.nanmean(ranges.innovation[:, 0] ** 2)) < 0.6  # 0.36 m, of predictions; its points leave 0.25 m
    assert 0.5 < np.nanmean(result.innovations.of("range_rate").nis) < 2.5
    course = np.arctan2(*(result.trajectory.v_eb_n[-1, [1, 0]]))
    heading = rotation.rpy_from_dcm(frames.C_en(a.llh[-1]).T @ rotation.dcm_from_quat(a.q_eb[-1]))[2]
    assert abs(np.arctan2(np.sin(heading - course), np.cos(heading - course))) < 3.0 * DEG


def test_a_vehicle_in_wrong_axes_starts_from_accelerations(vehicle):
    """The file's axes as its toolbox states them, a quarter turn off: said, and navigated all the same."""
    result = navigate(vehicle, example("psins_tc.toml", ("imu.mount_rpy_deg", (0.0, 0.0, 0.0))))
    assert any("the course is 87 deg off it" in note for note in result.notes)
    assert 0.5 < result.innovations.mean_nis() < 1.5
    assert sum(result.innovations.rejected().values()) < 10


# --- parked on a roof, with gaps and without Doppler ------------------------------------------------------------------


@pytest.mark.campaign
@pytest.mark.parametrize("variant", ["", "_noDoppler", "_psrGaps"])
@pytest.mark.parametrize("systems", ["GREC", "GE"])
@pytest.mark.thinned(6)
def test_a_roof_stays_put(shared_data, variant, systems):
    """33 s of IMU within 61 s of ranges, a pause of 0.29 s in the IMU log, heading unknown.

    The one epoch without pseudoranges in the file with gaps comes before the IMU log begins.
    """
    name = "reach-m2-01_raw_202306291111"
    recording = schuler.read(
        shared_data / "instinct_tckf",
        imu={"file": "vn310-imu.csv"},
        observations={"file": f"{name}{variant}.23O"},
        ephemerides={"file": f"{name}.nav"},
    )
    assert recording.imu.t[0] > recording.observations.t[0] + 10.0
    config = {
        "imu": {"catalogue": "VN-200"},
        "gnss": {"coupling": "tight", "tight": {"systems": systems}},
        "alignment": {"method": "given", "rpy_deg": (3.9, -1.8, 0.0), "sigma_deg": (1.0, 1.0, 60.0)},
        "filter": {"smooth": False},
    }
    result = navigate(recording, NavigationConfig.parse(config))
    a = result.trajectory
    ned = (a.r_eb_e - a.r_eb_e[-1]) @ frames.C_en(a.llh[-1])
    assert np.abs(ned).max(axis=0)[:2].max() < (2.5 if variant else 1.0)
    assert np.abs(ned[a.t > a.t[0] + 15.0]).max() < 1.2
    rates = result.innovations.of("range_rate")
    assert (len(rates) == 0) == (variant == "_noDoppler")
    assert sum(result.innovations.rejected().values()) <= 1e-3 * len(result.innovations)  # beyond the gate by chance
    assert any("pauses of the IMU log bridged, the longest 0.285 s" in note for note in result.notes)
    if variant != "_noDoppler":
        assert np.linalg.norm(a.v_eb_e, axis=1).max() < 0.1
    # the unit's own fixes beside it, on the same roof
    own = schuler.read(shared_data / "instinct_tckf" / "vn310-gnss.csv").gnss
    away = frames.ecef_from_llh(own.llh).mean(axis=0) - a.r_eb_e[-1]
    assert np.linalg.norm(away) < 12.0  # its own sigmas are 3 and 4 m, ours leave the slow errors out


@pytest.mark.campaign
def test_a_roof_by_carriers_against_a_base(shared_data):
    """VN310 with Reach M2 as its base; both share an antenna, so that the truth is where the base is stated to be."""
    folder, name = shared_data / "instinct_tckf", "reach-m2-01_raw_202306291111"
    recording = schuler.read(
        folder,
        imu={"file": "vn310-imu.csv"},
        observations={"file": "vn310-gnss.csv"},
        ephemerides={"file": f"{name}.nav"},
    )
    points = solve_points(
        prepare_ranges(schuler.read(folder / f"{name}.23O").observations, recording.ephemerides, systems="GEC")
    )
    base_e = points.r_e[points.ok].mean(axis=0)
    llh = frames.llh_from_ecef(base_e)
    base = {"observations": str(folder / f"{name}.23O"), "llh_deg": (llh[0] / DEG, llh[1] / DEG, llh[2])}
    config = {
        "imu": {"catalogue": "VN-200"},
        "gnss": {"coupling": "tight", "tight": {"carrier": "rtk", "base": base}},
        "alignment": {"method": "given", "rpy_deg": (3.9, -1.8, 0.0), "sigma_deg": (1.0, 1.0, 60.0)},
        "filter": {"smooth": True, "tune": False},
    }
    result = navigate(recording, NavigationConfig.parse(config))
    fixes = result.innovations.of("position")
    assert np.sum(fixes.status == 1) >= 0.95 * 164  # epochs; seen 161
    a = result.trajectory
    away = (a.r_eb_e - base_e) @ frames.C_en(llh)
    late = a.t > a.t[-1] - 15.0
    assert np.abs(away[late]).max() < 0.01  # seen: mean -0.4, 0.0, 0.8 mm, scatter 0.4, 0.3, 0.4 mm
    smoothed = result.smooth().trajectory
    assert np.abs((smoothed.r_eb_e - base_e) @ frames.C_en(llh)).max() < 0.01  # seen: 0.9, 0.6, 2.0 mm


def test_an_overconfident_start_does_not_lose_the_rates(walk):
    """A noise that claims too much, and the narrow gate: 3522 of 5300 rates were rejected for good."""
    changes = [
        ("gnss.tight.systems", "GE"), ("alignment.min_speed_m_s", 0.7), ("alignment.sideslip_deg", 5.0),
        ("gnss.gate", 0.9999), ("imu.gyro.noise_deg_s_rthz", 0.01), ("imu.accel.noise_ug_rthz", 300.0),
    ]  # fmt: skip
    result = navigate(walk.recording, example("rtkexp_walk.toml", *changes))
    counts = result.innovations.counts()["range_rate"]
    assert counts["rejected"] < 0.5 * (counts["accepted"] + counts["rejected"])


def test_corrections_of_position_are_no_velocities(walk, whole_walk):
    """A filter's corrections are steps; the derivative of a curve through them once made 103 m/s of a walk."""
    velocity = whole_walk[0].errors(walk.recording.reference).velocity_n
    assert np.abs(velocity).max() < 2.0
