"""Carriers against a base inside the filter: integers right, covariances honest, outages bridged, base errors said."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import encode_rtcm as enc
import numpy as np
import pytest
import rtk_cases as rc
from antex_text import antex_text
from receiver_pairs import HOME_LLH, pair
from sky import HOME

from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, FilterState
from schuler.filtering.measurements import CARRIER_PHASE, POSITION, MeasurementSchedule
from schuler.frames import C_en, llh_from_ecef
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import predicted_ranges
from schuler.gnss.relative import LEAST_CODE, relative_ranges
from schuler.gnss.synthetic import L1_CYCLE
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.inputs.rtk import _predicted, ranges_with_base, with_integers
from schuler.navigation.result import NavigationResult
from schuler.navigation.tuning.noise import terms_of
from schuler.recording.formats.antex import read_antex
from schuler.recording.recording import Metadata, Recording

RUNS = [2, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def drive():
    return rc.drive(60.0)


@pytest.fixture(scope="module")
def sky(drive):
    return ac.sky(drive, "GE", 12)


@pytest.fixture(scope="module")
def clean(drive, sky):
    return rc.run(drive, sky, 1)


@pytest.mark.parametrize("runs", RUNS)
def test_integers_are_right_and_errors_as_claimed(drive, sky, runs):
    """Twelve satellites but for ten seconds without any, after which integers are new.

    The fixes by themselves are chi-square with three degrees.
    """
    over = sky.where(~((sky.t > 35.0) & (sky.t < 45.0)))
    made = [rc.run(drive, over, seed) for seed in range(runs)]
    values = np.array([one.nees for one in made])
    at = values[:, [5, 25, 34, 40, 44, 50, 58]].mean(axis=0)
    low, high = chi_square_band(rc.LAYOUT.size, runs, 0.9999)
    assert np.all((at > low) & (at < high)), (low, at.round(2), high)
    nis = np.concatenate([one.fix_nis for one in made])
    assert nis.max() < 30.0  # a wrong integer of 19 cm makes hundreds
    low, high = chi_square_band(3 * len(nis), 1, 0.9999)
    assert low < nis.mean() / 3.0 < high


def test_positions_are_centimetres_once_integers_are_held(clean):
    assert clean.t_fix[0] < 30.0
    assert np.all(clean.error[clean.result.t > clean.t_fix[0] + 1.0] < 0.06)
    assert clean.fix_error.max() < 0.05


def test_a_phase_is_counted_once(clean):
    """Where a satellite's carrier is in the fix of an epoch it is not used beside it."""
    s = clean.prepared.schedule
    fixes, phases = s.t[s.kind == POSITION], s.t[s.kind == CARRIER_PHASE]
    full = fixes[np.array([np.sqrt(R.diagonal().max()) < 0.1 for R in s.R[s.kind == POSITION]])]
    assert len(full) > 30
    counts = [int(np.sum(np.abs(phases - t) < 1e-6)) for t in full[5:]]
    assert max(counts) <= 2  # a satellite that is not yet held
    assert np.sum(phases < fixes[0]) > 50


def test_integers_are_data_for_every_later_run(clean):
    """The schedule has them, so that a second run and the smoother need no base."""
    again = clean.prepared.run()
    np.testing.assert_array_equal(again.r[-1], clean.result.trajectory.r_eb_e[-1])
    assert "integers of carrier phases against the base are held at" in clean.prepared.notes[-1]


def test_tuning_leaves_positions_by_carriers_alone(clean):
    terms = terms_of(replace(clean.prepared, ranges=clean.base.ranges))
    assert "pseudorange" in terms
    assert not {"position", "height"} & set(terms)


def test_smoothed_errors_are_centimetres_throughout(drive, sky):
    """Fixes reach back to the start, over the stretch in which integers were not yet fixed."""
    one = rc.run(drive, sky, 2, smoother=True)
    smoothed: NavigationResult = one.result.smooth()
    at = one.truth.reference.at(smoothed.t)
    error = np.linalg.norm(smoothed.states.r_eb_e - at.r_eb_e, axis=1)
    assert one.error[5] > 0.1
    assert np.all(error[3:-3] < 0.06)


@pytest.mark.parametrize("cycles", [1.0, -0.5, 7.0])
def test_a_slip_begins_a_new_integer(drive, sky, cycles):
    """One carrier of twelve slips, unsaid, at 40 s: found before the filter, and the fix goes on without it."""
    sat = np.unique(sky.sat)[2]
    one = rc.run(drive, sky, 4, slips=np.where((sky.sat == sat) & (sky.t > 40.0), cycles * L1_CYCLE, 0.0))
    assert np.all(one.error[one.result.t > one.t_fix[0] + 1.0] < 0.06)
    assert one.fix_nis.max() < 30.0


def test_an_outage_of_the_configuration_ends_integers(clean):
    """Integers of before it are forgotten, as those of a receiver that really lost its satellites."""
    prepared = replace(clean.prepared, windows=((45.0, 50.0),))
    s = prepared.schedule
    bare = s.where(s.kind != POSITION).outside(prepared.windows)
    again = with_integers(replace(prepared, schedule=bare), clean.base, rc.CONFIG)
    fixes = again.schedule.t[again.schedule.kind == POSITION]
    assert fixes[0] < 45.0
    assert not np.any((fixes >= 45.0) & (fixes < 51.5))  # confirmed in three epochs


def test_the_predicted_antenna_is_the_filters(drive):
    """Against a filter that propagates at every sample: 90 ms after the last propagation, 3 ms after a sample."""
    from schuler.filtering.filter_arrays import Aiding, ImuStream, NodeArrays, RecordArrays, TrajectoryArrays
    from schuler.filtering.kernels import run as k

    truth = ac.Truth(drive, rc.LAYOUT, np.random.default_rng(2))
    start, log = ac.initial(truth, rc.STATES), truth.log
    n = rc.STATES.size
    seen = []
    for rate, at in ((10.0, log.t[118] + 0.003), (None, log.t[118] + 0.003)):
        state = FilterState(start, rc.STATES, *ac.NOISE, FilterOptions(covariance_rate_hz=rate), 0.01)
        stream = ImuStream(
            *(np.ascontiguousarray(x[:119]) for x in (log.dtheta_ib_b, log.dv_ib_b, log.dt, log.t)), False
        )
        nothing = (
            TrajectoryArrays.of_size(0),
            RecordArrays.of_size(0, n),
            NodeArrays.of_size(0, 0, n, rc.STATES.n_sensor),
        )
        k.run_filter(
            stream,
            Aiding.of(MeasurementSchedule.empty()),
            state.arrays,
            state.model,
            state.settings,
            state.work,
            *nothing,
        )
        seen.append((float(state.arrays.acc[0]), *_predicted(state, rc.STATES, ac.LEVER, at)))
    (age, r, P), (_, r_now, P_now) = seen
    assert age > 0.08
    np.testing.assert_allclose(r, r_now, atol=1e-6)
    np.testing.assert_allclose(P, P_now, rtol=1e-3)


# --- the base -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two():
    """Two receivers for ten minutes at a baseline of some hundred metres, exact."""
    return pair(np.random.default_rng(3), lambda t: (100.0, -200.0, 5.0), np.arange(0.0, 600.0, 60.0), bands=("1C",))


def corrected(two, base=None, notes=None, rover=None, **entries):
    """Ranges of the rover with a base."""
    rover = two.rover if rover is None else rover
    llh = tuple(HOME_LLH * (180 / np.pi, 180 / np.pi, 1.0))
    config = NavigationConfig.parse(
        {
            "imu": {"catalogue": "HG1700-flenniken"},
            "gnss": {"coupling": "tight", "tight": {"carrier": "rtk", "base": {"llh_deg": llh, **entries}}},
        }
    )
    recording = Recording(observations=rover, ephemerides=two.ephemerides, metadata=Metadata())
    ranges = prepare_ranges(rover, two.ephemerides, systems="GEC")
    return ranges_with_base(
        recording, ranges, HOME, config, two.base if base is None else base, [] if notes is None else notes
    )


def test_corrected_ranges_hold_only_geometry_and_clocks(two):
    """Of both receivers' exact measurements nothing is left but a clock, and whole cycles of carriers. Rounding."""
    both = corrected(two)
    c, r = both.carriers, both.ranges
    place = HOME + C_en(HOME_LLH) @ (100.0, -200.0, 5.0)
    left = r.pseudorange[c.row] - predicted_ranges(r.r_sat_e[c.row], place)[0]
    cycles = (c.carrier - predicted_ranges(r.r_sat_e[c.row], place)[0]) / c.wavelength
    for t in np.unique(r.t[c.row]):
        for kind in np.unique(c.kind):
            mine = np.flatnonzero((r.t[c.row] == t) & (c.kind == kind))
            np.testing.assert_allclose(left[mine], left[mine[0]], atol=0.003)  # atmosphere at two places
            between = cycles[mine] - cycles[mine[0]]
            np.testing.assert_allclose(between, np.round(between), atol=0.02)


@pytest.fixture(scope="module")
def two_bands():
    """The same two receivers on two bands, at 1 Hz."""
    t, bands = np.arange(0.0, 12.0), ("1C", "2W", "5Q")
    return pair(np.random.default_rng(3), lambda t: (100.0, -200.0, 5.0), t, bands=bands, systems="GE")


def test_a_second_band_is_searched_beside_the_first(two_bands):
    """Whole cycles of its own wavelength, kinds of their own, on rows of the first; the first as it was."""
    notes = []
    both = corrected(two_bands, notes=notes)
    first_only = replace(two_bands, base=l1_of(two_bands.base), rover=l1_of(two_bands.rover))
    one = corrected(first_only)
    assert "integers of two bands are searched together: beside the ranges' own G 2; E 5" in notes
    c = both.carriers
    second = c.kind > one.carriers.kind.max()
    np.testing.assert_array_equal(c.carrier[~second], one.carriers.carrier)
    np.testing.assert_array_equal(np.sort(c.row[second]), one.carriers.row)
    assert np.all(np.diff(c.row) >= 0)
    np.testing.assert_allclose(np.unique(c.wavelength[second].round(4)), [0.2442, 0.2548])
    place = HOME + C_en(HOME_LLH) @ (100.0, -200.0, 5.0)
    cycles = (c.carrier - predicted_ranges(both.ranges.r_sat_e[c.row], place)[0]) / c.wavelength
    for t in np.unique(both.ranges.t[c.row]):
        for kind in np.unique(c.kind):
            mine = np.flatnonzero((both.ranges.t[c.row] == t) & (c.kind == kind))
            between = cycles[mine] - cycles[mine[0]]
            np.testing.assert_allclose(between, np.round(between), atol=0.02)
    for kind in np.unique(c.kind):  # no slip: one arc a satellite
        mine = c.kind == kind
        assert len(np.unique(c.arc[mine] * 1000 + both.ranges.sat[c.row[mine]])) == len(
            np.unique(both.ranges.sat[c.row[mine]])
        )


@pytest.mark.parametrize("cycles", [0.5, -1.0])
def test_a_slip_of_either_band_ends_the_arc_of_the_second(two_bands, cycles):
    """The difference of the bands does not tell which; the first's own slips are found among its satellites, before."""
    o = two_bands.rover
    sat = int(np.unique(o.sat)[1])
    for band in ("2W", "1C"):
        late = (o.sat == sat) & (o.signal == o.signals.index(band)) & (o.t > 5.5)
        both = corrected(two_bands, rover=replace(o, carrier=o.carrier + cycles * late))
        c = both.carriers
        mine = both.ranges.sat[c.row] == sat
        kinds = np.unique(c.kind[mine])
        assert [len(np.unique(c.arc[mine & (c.kind == kind)])) for kind in kinds] == [1, 2]


def l1_of(o):
    return o.where(o.signal == o.signals.index("1C"))


@pytest.mark.parametrize("sigma", [0.6, 1.2])
def test_code_noise_is_that_of_code_less_carrier(drive, sigma):
    """Of white noise, both receivers, six thousand differences: 4 standard errors."""
    t = drive.fixes_t
    base_e = drive.at_fixes.r_eb_e[0]
    two = [rc.base_station(t, base_e + 100.0 * k, np.random.default_rng(k), sigma / rc.CODE) for k in range(2)]
    ranges, carriers = relative_ranges(*two, base_e + 100.0, sigma_code=None, sigma_carrier=rc.PHASE)
    scale = carriers.sigma / rc.PHASE
    claimed = ranges.sigma_range[carriers.row] / scale
    np.testing.assert_allclose(claimed, sigma, rtol=4.0 / np.sqrt(2.0 * len(scale)))
    few = [r.where(r.t < 3.0) for r in two]
    ranges, carriers = relative_ranges(*few, base_e + 100.0, sigma_code=None, sigma_carrier=rc.PHASE)
    np.testing.assert_allclose(ranges.sigma_range[carriers.row], LEAST_CODE * carriers.sigma / rc.PHASE)


@pytest.mark.parametrize(
    ("spoil", "entries", "message"),
    [
        (lambda o: o.where(o.t < 290.0), {}, "no time in common: the rover's log is of .* give a base log of that"),
        (lambda o: replace(o, epoch_gps_s=o.epoch_gps_s - 604800.0), {}, "no time in common: the rover's log is of"),
        (lambda o: replace(o, carrier=np.full(len(o), np.nan)), {}, "no satellite whose carrier phase both receivers"),
        (
            lambda o: o,
            {"llh_deg": (47.0, 8.5, 400.0)},
            "m from where the base's own ranges place it; expected latitude",
        ),
    ],
)
def test_bases_that_do_not_serve_are_errors(two, spoil, entries, message):
    late = two.rover.where(two.rover.t > 290.0)
    with pytest.raises(InputError, match=message):
        corrected(two, spoil(two.base), rover=late, **entries)


def test_a_base_is_asked_for_and_its_carriers_are_checked(two):
    recording = Recording(observations=two.rover, ephemerides=two.ephemerides, metadata=Metadata())
    ranges = prepare_ranges(two.rover, two.ephemerides, systems="GEC")
    with pytest.raises(InputError, match=r"needs a base station: name its log in gnss\.tight\.base\.observations"):
        ranges_with_base(recording, ranges, HOME, rc.CONFIG, None, [])
    often = pair(np.random.default_rng(3), lambda t: (100.0, -200.0, 5.0), np.arange(0.0, 30.0, 5.0), bands=("1C",))
    metres = replace(often.base, carrier=often.base.carrier * 0.1903)
    with pytest.raises(InputError, match=r"gnss\.tight\.base: the carrier of .* look like carriers in metres"):
        corrected(often, metres)
    with pytest.raises(InputError, match="it has prepared ranges only"):
        ranges_with_base(Recording(ranges=ranges, metadata=Metadata()), ranges, HOME, rc.CONFIG, two.base, [])


def test_codes_without_the_base_are_left_out_and_a_far_base_is_said(two):
    half = two.base.where(two.base.t < 290.0)
    notes: list[str] = []
    both = corrected(two, half, notes)
    late = both.ranges.t > 299.0
    assert np.all(np.isnan(both.ranges.pseudorange[late]))
    assert np.isfinite(both.ranges.pseudorange[~late & both.ranges.used]).all()
    assert any("pseudoranges have none of the base beside them: left out" in n for n in notes)
    away: list[str] = []
    recording = Recording(observations=two.rover, ephemerides=two.ephemerides, metadata=Metadata())
    ranges = prepare_ranges(two.rover, two.ephemerides, systems="GEC")
    ranges_with_base(recording, ranges, HOME + np.array([0.0, 0.0, 3e4]), rc.CONFIG, two.base, away)
    assert any("the base is 30 km away: beyond 10 km the ionosphere" in n for n in away)
    assert any("base position: the mean of its single points" in n for n in away)


def test_a_mark_and_phase_centres_of_the_base(two, tmp_path):
    """A base given by its mark, corrected for its antenna: the same carriers, but for what the antenna adds."""
    (tmp_path / "own.atx").write_text(
        antex_text([("HIGH NONE", "", 0.0, {"G01": ((0.0, 0.0, 80.0), lambda z, a: 0.0)})])
    )
    with_antennas = replace(two, ephemerides=replace(two.ephemerides, antennas=read_antex(tmp_path / "own.atx")))
    stated = replace(two.base, antenna="HIGH", eccentricity_n=(0.1, 0.0, -2.0))
    mark = np.array(llh_from_ecef(HOME - C_en(HOME_LLH) @ (0.1, 0.0, -2.0))) * (180 / np.pi, 180 / np.pi, 1.0)
    notes = []
    plain = corrected(two, stated)
    got = corrected(with_antennas, stated, notes, llh_deg=tuple(mark), mark=True)
    added = plain.carriers.carrier - got.carriers.carrier  # the base is 80 mm sin(elevation) farther from its point
    np.testing.assert_allclose(added, 0.08 * np.sin(plain.ranges.elevation[plain.carriers.row]), atol=1e-4)  # 300 m
    text = "; ".join(notes)
    assert "2.0000 m above the mark" in text
    assert "the rover's antenna is not known" in text
    silent = []
    corrected(with_antennas, stated, silent, antenna="none")
    assert not any("antenna" in n for n in silent)
    with pytest.raises(InputError, match="does not state its antenna's height"):
        corrected(two, mark=True)
    with pytest.raises(InputError, match="expected one of the 1 receivers' antennas"):
        corrected(with_antennas, stated, antenna="LOW")


def test_a_base_in_a_file_is_relative_to_the_configuration(tmp_path):
    text = '[imu]\ncatalogue = "HG1700-flenniken"\n[gnss]\ncoupling = "tight"\n[gnss.tight]\ncarrier = "rtk"\n'
    (tmp_path / "run.toml").write_text(text + '[gnss.tight.base]\nobservations = "base.obs"\n')
    config = NavigationConfig.load(tmp_path / "run.toml")
    assert config.gnss.tight.base.observations == str(tmp_path / "base.obs")


def test_a_base_as_a_stream_of_messages(two, tmp_path):
    """RTCM 3 says the time of week, the rover the week; the place is the station's own."""
    pytest.importorskip("pyrtcm")
    still = replace(two.base, range_rate=np.zeros(len(two.base)), cn0=np.round(two.base.cn0))
    frames = [
        enc.msm(still, s, t) for t in np.unique(still.t) for s in "GEC" if (still.sat // 100 == "GRECJ".index(s)).any()
    ]
    file = tmp_path / "base.rtcm3"
    file.write_bytes(enc.station(HOME) + b"".join(frames))
    notes = []
    config = NavigationConfig.parse(
        {
            "imu": {"catalogue": "HG1700-flenniken"},
            "gnss": {"coupling": "tight", "tight": {"carrier": "rtk", "base": {"observations": str(file)}}},
        }
    )
    ranges = prepare_ranges(two.rover, two.ephemerides, systems="GEC")
    recording = Recording(observations=two.rover, ephemerides=two.ephemerides, metadata=Metadata())
    streamed = ranges_with_base(recording, ranges, HOME, config, None, notes)
    assert "base position: as the station states it" in notes
    same = corrected(two, still)
    assert len(streamed.carriers.row) == len(same.carriers.row) > 50
    # a carrier of 2^-31 ms, and epochs in whole milliseconds at ranges that change by 800 m/s: 0.3 ms of them
    np.testing.assert_allclose(streamed.ranges.pseudorange, same.ranges.pseudorange, atol=0.3)
    assert not any("checksum" in note for note in notes)
    file.write_bytes(enc.station(HOME) + b"".join([*frames[:-1], frames[-1][:-1] + b"\0"]))
    ranges_with_base(recording, ranges, HOME, config, None, notes)
    assert "base: 1 frames with a wrong checksum were left out." in notes
    file.write_bytes(enc.station(HOME + 500.0) + b"".join(frames))
    with pytest.raises(InputError, match=r"as its messages state it: 8.. m from where the base's own ranges place it"):
        ranges_with_base(recording, ranges, HOME, config, None, [])
