"""Simulated satellites of a moving receiver: ranges obey the model, windows and faults are where they were put."""

import tomllib
from dataclasses import fields, replace

import numpy as np
import pytest
from places import EXAMPLES

from schuler.exceptions import InputError
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import predicted_ranges
from schuler.gnss.signals import SPEED_OF_LIGHT, satellite
from schuler.gnss.synthetic import EXACT, RangeErrors, Sector
from schuler.recording.io import read, write
from schuler.simulation.aid_sections import SatellitesSection
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.simulation.satellites import BlockedSky, RangeFault, SatelliteModel, SkyWindow, simulate_satellites
from schuler.simulation.scenario import prepare_mission, simulate, simulate_mission
from schuler.units import DEG

GPS_S = 2400 * 604_800.0 + 7200.0
LEVER = np.array([0.8, 0.1, -1.2])


@pytest.fixture(scope="module")
def motion():
    moves = [Manoeuvre(duration=10.0, speed=12.0), Manoeuvre(duration=50.0, turn=2.0)]
    return ManoeuvreMotion.of(moves, np.array([0.84, 0.2, 500.0]), heading=0.5)


def made(motion, seed: int = 1, **model):
    return simulate_satellites(motion, SatelliteModel(**model), np.random.default_rng(seed), epoch_gps_s=GPS_S)


def same_rows(part, whole, keep) -> None:
    for f in fields(part.ranges):
        a, b = getattr(part.ranges, f.name), getattr(whole.ranges, f.name)
        if isinstance(a, np.ndarray) and f.name not in ("carrier_range", "arc"):  # a carrier once hidden begins anew
            np.testing.assert_array_equal(a, b[keep], err_msg=f.name)


def test_ranges_are_the_model_at_the_antenna_plus_clock_and_error(motion):
    sky = made(motion, lever_arm_b=LEVER)
    r, k = sky.ranges, sky.made.epoch
    s = motion.state(sky.t)
    rho, _ = predicted_ranges(r.r_sat_e, (s.r_eb_e + s.C_eb @ LEVER)[k])
    expected = rho + sky.made.clock[k, r.group] + sky.made.error
    np.testing.assert_allclose(r.pseudorange, expected, atol=1e-7)  # rounding of 2e7 m
    np.testing.assert_array_equal(r.t, sky.t[k])


def test_exact_ranges_give_the_antenna_and_the_clock(motion):
    sky = made(motion, errors=EXACT, lever_arm_b=LEVER, clock_jumps=((30.0, 1e-3),))
    points = solve_points(sky.ranges)
    s = motion.state(sky.t)
    np.testing.assert_allclose(points.r_e, s.r_eb_e + s.C_eb @ LEVER, atol=1e-6)  # rounding of 2e7 m times dilution
    v = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, LEVER))
    np.testing.assert_allclose(points.v_e, v, atol=1e-8)
    np.testing.assert_allclose(points.clock[:, 0], np.where(sky.t >= 30.0, 1e-3 * SPEED_OF_LIGHT, 0.0), atol=1e-6)
    np.testing.assert_allclose(sky.made.clock, points.clock, atol=1e-6)


@pytest.mark.parametrize("systems", ["GE", "GR"])
def test_observations_and_messages_give_the_truth(motion, systems):
    """The whole chain, through a clock that runs and jumps by a millisecond."""
    errors = replace(EXACT, clock=3e4, drift=30.0, offsets=(12.0,))
    sky = made(motion, systems=systems, errors=errors, clock_jumps=((30.0, 1e-3),))
    back = prepare_ranges(
        sky.observations(), sky.ephemerides, systems=systems, ionosphere="none", troposphere="none",
        elevation_mask=5 * DEG, cn0_mask=0.0,
    )  # fmt: skip
    points = solve_points(back)
    assert points.ok.all()
    # the receiver stamps its epochs by its own clock: 1e-4 s early or late the orbits move by half a metre
    np.testing.assert_allclose(points.r_e, motion.state(sky.t).r_eb_e, atol=2e-3)
    # whole milliseconds are taken out again: the clock goes on as it was
    jump = np.where(sky.t >= 30.0, 1e-3 * SPEED_OF_LIGHT, 0.0)
    np.testing.assert_allclose(points.clock, sky.made.clock - jump[:, None], atol=2e-3)


def test_windows_keep_the_highest(motion):
    whole = made(motion)
    part = made(motion, windows=(SkyWindow(20.0, 30.0, 3), SkyWindow(40.0, 45.0, 0)))
    r = whole.ranges
    keep = np.ones(len(r), dtype=bool)
    for t in np.unique(r.t):
        rows = np.flatnonzero(r.t == t)
        highest = rows[np.argsort(-r.elevation[rows])]
        if 20.0 <= t < 30.0:
            keep[highest[3:]] = False
        if 40.0 <= t < 45.0:
            keep[rows] = False
    same_rows(part, whole, keep)
    np.testing.assert_array_equal(part.made.error, whole.made.error[keep])
    assert len(part.t) == len(whole.t)  # clocks run on


def test_blocked_sky_and_outages(motion):
    whole = made(motion)
    sector = Sector(300 * DEG, 60 * DEG, 50 * DEG)
    part = made(motion, blocked=(BlockedSky(sector, 10.0, 40.0),), outages=((50.0, 55.0),))
    r = whole.ranges
    azimuth, elevation = r.azimuth / DEG, r.elevation / DEG
    hidden = ((azimuth >= 300) | (azimuth <= 60)) & (elevation <= 50) & (r.t >= 10.0) & (r.t < 40.0)
    assert hidden.any()
    same_rows(part, whole, ~hidden & ~((r.t >= 50.0) & (r.t < 55.0)))


def test_a_window_counts_what_the_blocked_sky_leaves(motion):
    sector = Sector(0.0, 180 * DEG)
    part = made(motion, blocked=(BlockedSky(sector),), windows=(SkyWindow(0.0, 99.0, 2),))
    assert np.all(part.ranges.azimuth > np.pi)
    assert np.all(np.bincount(part.made.epoch) == 2)


def test_faults_are_on_their_satellite_alone(motion):
    whole = made(motion)
    now = whole.ranges.t == 20.0
    top = whole.ranges.sat[now][np.argmax(whole.ranges.elevation[now])]
    part = made(motion, faults=(RangeFault("highest", 20.0, 30.0, step=40.0),))
    r = part.ranges
    rows = (r.sat == top) & (r.t >= 20.0) & (r.t < 30.0)
    np.testing.assert_array_equal(part.faulty, rows)
    step = np.where(rows, 40.0, 0.0)
    np.testing.assert_allclose(r.pseudorange - whole.ranges.pseudorange, step, atol=1e-7)  # rounding of 2e7 m
    np.testing.assert_allclose(part.made.error - whole.made.error, step, atol=1e-12)
    np.testing.assert_array_equal(r.range_rate, whole.ranges.range_rate)


def test_a_ramp_is_in_range_and_rate(motion):
    whole = made(motion)
    name = f"G{whole.ranges.sat[whole.ranges.sat < 100][0]:02d}"
    part = made(motion, faults=(RangeFault(name, 20.0, 30.0, step=5.0, ramp=2.0),))
    rows, r = part.faulty, part.ranges
    assert set(r.sat[rows]) == {satellite(name)}
    step = (r.pseudorange - whole.ranges.pseudorange)[rows]
    np.testing.assert_allclose(step, 5.0 + 2.0 * (r.t[rows] - 20.0), atol=1e-7)  # rounding of 2e7 m
    np.testing.assert_allclose((r.range_rate - whole.ranges.range_rate)[rows], 2.0, atol=1e-12)


def test_shifted_stamps(motion):
    whole, late = made(motion), made(motion, clock_shift=0.2)
    np.testing.assert_allclose(late.ranges.t, whole.ranges.t + 0.2, atol=1e-12)
    np.testing.assert_array_equal(late.ranges.pseudorange, whole.ranges.pseudorange)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ({"faults": (RangeFault("R01", 0.0, 1.0),)}, "a fault of R01, but the systems simulated are GE"),
        ({"faults": (RangeFault("highest", 100.0, 101.0),)}, "satellites seen then: none"),
        ({"windows": (SkyWindow(0.0, 99.0, 0),)}, "leave no satellite at all"),
        ({"outages": ((0.0, 99.0),)}, "leave no satellite epoch at all"),
        ({"windows": (SkyWindow(5.0, 5.0, 3),)}, "start < stop"),
        ({"rate_hz": 0.0}, "rate_hz: expected a positive rate"),
    ],
)
def test_impossible_skies_are_explained(motion, model, message):
    with pytest.raises(InputError, match=message):
        made(motion, **model)


def test_the_example_navigates_tightly_and_recovers_its_truth(tmp_path):
    """Simulate, write, read, navigate: 3 and 1 satellites, a reflection of 60 m, wrong odometer, compass, barometer."""
    from schuler.navigation.run import navigate

    run = simulate_mission(prepare_mission(EXAMPLES / "town_tight.toml"))
    recording = read(write(run.recording, tmp_path / "town.parquet")[0])
    r = recording.ranges
    seen = np.bincount(np.searchsorted(np.unique(r.t), r.t))
    times = np.unique(r.t)
    assert set(seen[(times >= 60.0) & (times < 75.0)]) == {3}
    assert set(seen[(times >= 100.0) & (times < 115.0)]) == {1}
    result = navigate(recording, EXAMPLES / "town_tight_navigation.toml")
    T = recording.reference.at(result.trajectory.t)
    error = np.linalg.norm(result.trajectory.r_eb_e - T.r_eb_e, axis=1)
    assert np.sqrt(np.mean(error**2)) < 1.5  # 0.85 m, most of it multipath of half a metre times dilution
    truth = dict(recording.metadata.options["truth"])
    truth["clock"] += truth["clock_drift"] * (result.t[-1] - times[-1])  # truth is that of the last epoch
    for block in ("b_g", "odometer", "b_heading", "baro", "clock", "clock_drift", "clock_2"):
        part = result.layout[block]
        estimate = result.parameters[-1, part.start - 9 : part.stop - 9]
        sigma = np.sqrt(np.diag(result.covariance_e[-1])[part])
        assert np.all(np.abs(estimate - truth[block]) < 5 * sigma), block  # statistical


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [24, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("carrier", ["off", "time-differenced"])
def test_the_example_told_what_is_simulated_claims_its_errors(carrier, runs):
    """Without fault and other aids. 400 runs: 0.993 +- 0.014, with carriers 0.999 +- 0.015, velocity 1.050 +- 0.007.

    Statistical: four standard errors beyond 0.1 of 1; the flicker below ten seconds is not among the states.
    """
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.evaluation.consistency import state_errors
    from schuler.navigation.run import navigate

    tight = {
        "carrier": carrier, "carrier_sigma_m": 0.002, "carrier_walk_m": 0.001, "range_sigma_scale": 0.7071,
        "clock_noise_m": 0.2, "clock_drift_noise_m_s": 0.05,
    }  # fmt: skip
    slow = {"position_sigma_m": 0.5, "position_tau_s": 30.0}
    states = ("b_a", "b_g", "M_a6", "M_g", "G_g", "b_a_run", "b_g_run")
    config = NavigationConfig.checked(
        {
            "imu": {"catalogue": "MTi-G-710"},
            "gnss": {"coupling": "tight", "lever_arm_m": (0.8, 0.0, -1.2), "correlated": slow, "tight": tight},
            "filter": {"smooth": False, "tune": False, "states": states},
        }
    )
    mission = tomllib.loads((EXAMPLES / "town_tight.toml").read_text(encoding="utf-8"))
    mission = {k: v for k, v in mission.items() if k not in ("odometer", "heading", "barometer")}
    mission["satellites"] |= {"faults": []}
    values = []
    for seed in range(runs):
        log = simulate_mission(prepare_mission(mission | {"seed": 6000 + seed})).recording
        result = navigate(log, config)
        t, dx, P = state_errors(result, log.need_reference())
        squared = []
        for k in (slice(0, 9), slice(3, 6)):  # all, velocity
            late = np.flatnonzero(t > t[0] + 20.0)
            e, S = dx[late, k], P[late, k, k]
            squared.append(np.mean(np.einsum("ki,ki->k", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])) / e.shape[1])
        values.append(squared)
    mean, error = np.mean(values, axis=0), np.std(values, axis=0) / np.sqrt(runs)
    assert np.all(np.abs(mean - 1.0) < 0.1 + 4.0 * error), (mean, error)


def test_raw_observations_make_a_recording(tmp_path):
    data = {
        "motion": {"type": "static", "lat_deg": 47.0, "lon_deg": 8.0, "duration_s": 20.0},
        "imu": {"rate_hz": 20.0, "ideal": True},
        "satellites": {"give": "observations", "clock_m": 1000.0, "systems": "GE"},
    }
    recording = simulate(data)
    assert recording.ranges is None
    assert recording.observations.epoch_gps_s == recording.metadata.time.epoch_gps_s
    back = read(write(recording, tmp_path / "raw.csv")[0])
    np.testing.assert_array_equal(back.observations.pseudorange, recording.observations.pseudorange)
    np.testing.assert_array_equal(back.ephemerides.kepler.m0, recording.ephemerides.kepler.m0)
    assert back.metadata.options["truth"]["clock_start"] == 1000.0


def test_a_section_is_the_model_in_si():
    """Every entry at a number of its own, against the model written out."""
    section = SatellitesSection.model_validate(
        {
            "systems": "GR", "rate_hz": 2.0, "first_s": 0.3, "noise_m": 0.7, "rate_noise_m_s": 0.06,
            "multipath_m": 0.8, "multipath_time_s": 20.0, "atmosphere_m": 0.9, "atmosphere_time_s": 900.0,
            "clock_m": 5.0, "clock_drift_m_s": 6.0, "clock_noise_m": 0.3, "clock_drift_noise_m_s": 0.2,
            "offsets_m": [7.0], "elevation_mask_deg": 12.0, "lever_arm_m": [1.0, 2.0, 3.0],
            "blocked": [{"azimuth_deg": [350.0, 10.0], "below_deg": 30.0, "stop_s": 5.0}],
            "windows": [{"start_s": 1.0, "stop_s": 2.0, "satellites": 3}], "outages_s": [[8.0, 9.0]],
            "faults": [{"satellite": "G05", "start_s": 3.0, "stop_s": 4.0, "step_m": 5.0, "ramp_m_s": 6.0}],
            "clock_jumps_s": [[10.0, 1e-3]], "clock_shift_s": 0.05,
        }
    )  # fmt: skip
    model = section.model()
    assert model.errors == RangeErrors(
        noise=0.7, rate_noise=0.06, multipath=0.8, multipath_tau=20.0, atmosphere=0.9, atmosphere_tau=900.0, clock=5.0,
        drift=6.0, clock_psd=0.3**2, drift_psd=0.2**2, offsets=(7.0,),
    )  # fmt: skip
    assert model.blocked == (BlockedSky(Sector(350 * DEG, 10 * DEG, 30 * DEG), -np.inf, 5.0),)
    assert model.windows == (SkyWindow(1.0, 2.0, 3),)
    assert model.faults == (RangeFault("G05", 3.0, 4.0, 5.0, 6.0),)
    assert (model.outages, model.clock_jumps, model.clock_shift) == (((8.0, 9.0),), ((10.0, 1e-3),), 0.05)
    assert (model.systems, model.rate_hz, model.first_s, model.elevation_mask) == ("GR", 2.0, 0.3, 12 * DEG)
    np.testing.assert_array_equal(model.lever_arm_b, (1.0, 2.0, 3.0))
