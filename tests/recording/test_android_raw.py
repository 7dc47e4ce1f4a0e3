"""Raw measurements of phones: a simulated sky written in GnssLogger's fields and read back; states, clocks, slips."""

from dataclasses import replace

import numpy as np
import pytest

import schuler
from schuler import frames
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss import Observations, nominal_orbits, prepare_ranges, solve_points
from schuler.gnss.carrier import begin_arcs
from schuler.gnss.signals import BANDS, SPEED_OF_LIGHT, SYSTEMS
from schuler.gnss.synthetic import EXACT, synthetic_ranges
from schuler.recording.formats.android_raw import raw_measurements
from schuler.timebase import WEEK_S

WEEK_START = 2287 * int(WEEK_S)  # GPS seconds, a Sunday of November 2023
LEAP = 18
NS = 1_000_000_000
FIELDS = [
    "Raw", "utcTimeMillis", "TimeNanos", "LeapSecond", "FullBiasNanos", "BiasNanos", "HardwareClockDiscontinuityCount",
    "Svid", "TimeOffsetNanos", "State", "ReceivedSvTimeNanos", "ReceivedSvTimeUncertaintyNanos", "Cn0DbHz",
    "PseudorangeRateMetersPerSecond", "AccumulatedDeltaRangeState", "AccumulatedDeltaRangeMeters", "CarrierFrequencyHz",
    "ConstellationType", "CodeType", "ChipsetElapsedRealtimeNanos",
]  # fmt: skip
KINDS = {"G": 1, "R": 3, "J": 4, "C": 5, "E": 6}
STATES = {"G": 16_431, "E": 16_431, "C": 16_431, "J": 16_431, "R": 32_995}
ROUNDING = 0.5e-9 * SPEED_OF_LIGHT  # whole nanoseconds of the time of transmission


def sky(systems="GEC", n=20, start=3 * 86_400.0, **errors):
    """What a phone at rest would measure, and the messages of its satellites."""
    t = start + np.arange(float(n))
    r = np.broadcast_to(frames.ecef_from_llh(np.array([0.653, -2.132, 20.0])), (n, 3))
    orbits = nominal_orbits(systems)
    offsets = tuple(15.0 * (k + 1) for k in range(len(systems) - 1))
    made = synthetic_ranges(
        t, r, np.zeros_like(r), orbits, np.random.default_rng(3), replace(EXACT, offsets=offsets, **errors),
        epoch_gps_s=float(WEEK_START),
    )  # fmt: skip
    return made.observations(), orbits.ephemerides(WEEK_START + t[0] - 3600.0, WEEK_START + t[-1] + 3600.0), r


def records(o, *, full_bias=-(WEEK_START * NS + 7), bias=0.25, changes=None, carrier=True):
    """Rows of GnssLogger for observations; ``changes`` of a row's fields by its number."""
    rows = []
    for k in range(len(o)):
        letter, band = SYSTEMS[o.sat[k] // 100], o.signals[o.signal[k]][0]
        own = round((o.t[k]) * NS)  # nanoseconds of the week
        time_ns = own + full_bias + WEEK_START * NS
        flight = o.pseudorange[k] / SPEED_OF_LIGHT * NS
        sent = own - round(flight + bias)
        frequency = BANDS.get((letter, band), 1602e6 + 0.5625e6 * o.glonass_channels.get(int(o.sat[k]), 0))
        if letter == "C":
            sent -= 14 * NS
        if letter == "R":
            sent = (sent + (3 * 3600 - LEAP) * NS) % (86_400 * NS)
        sent %= int(WEEK_S) * NS
        row = dict.fromkeys(FIELDS, "") | {
            "Raw": "Raw", "utcTimeMillis": "1", "TimeNanos": str(time_ns), "FullBiasNanos": str(full_bias),
            "BiasNanos": repr(bias), "HardwareClockDiscontinuityCount": "4",
            "Svid": str(o.sat[k] % 100 + (192 if letter == "J" else 0)), "State": str(STATES[letter]),
            "ReceivedSvTimeNanos": str(sent), "ReceivedSvTimeUncertaintyNanos": "12",
            "Cn0DbHz": repr(float(o.cn0[k])), "PseudorangeRateMetersPerSecond": repr(float(o.range_rate[k])),
            "AccumulatedDeltaRangeState": "1" if carrier else "16",
            "AccumulatedDeltaRangeMeters": repr(float(o.pseudorange[k] - 2.2e7)),
            "CarrierFrequencyHz": repr(frequency), "ConstellationType": str(KINDS[letter]),
            "CodeType": o.signals[o.signal[k]][1], "ChipsetElapsedRealtimeNanos": str(own - 500 * NS),
        }  # fmt: skip
        row |= (changes or {}).get(k, {})
        rows.append([row[name] for name in FIELDS])
    return rows


def read_back(o, path="log.txt", **options):
    return raw_measurements(path, FIELDS, records(o, **options)).observations


# ------------------------------------------------------------------------------------------------------ the law


@pytest.mark.parametrize("systems", ["G", "GEC"])
def test_a_sky_survives_the_phone(systems):
    """Pseudoranges to half a nanosecond, rates and C/N0 as printed, times of reception to rounding."""
    o, _, _ = sky(systems)
    back = read_back(o)
    assert len(back) == len(o)
    assert np.array_equal(back.sat, o.sat)
    assert [back.signals[k] for k in back.signal] == [o.signals[k] for k in o.signal]
    assert np.abs(back.t + back.epoch_gps_s - o.t - o.epoch_gps_s).max() < 1e-6
    assert np.abs(back.pseudorange - o.pseudorange).max() < 1.01 * ROUNDING
    assert np.array_equal(back.range_rate, o.range_rate)
    assert np.array_equal(back.cn0, o.cn0)


def test_a_position_comes_out_of_the_log(tmp_path):
    """Through the file: single points to the nanosecond that times of transmission are rounded to."""
    o, ephemerides, r = sky()
    path = tmp_path / "gnss_log.txt"
    path.write_text("# Header Description:\n# " + ",".join(FIELDS) + "\n" + "\n".join(map(",".join, records(o))) + "\n")
    log = schuler.read(path)
    assert log.observations is not None
    assert log.metadata.time.epoch_gps_s == WEEK_START
    ranges = prepare_ranges(log.observations, ephemerides, systems="GEC", ionosphere="none", troposphere="none")
    points = solve_points(ranges)
    assert points.ok.all()
    assert np.linalg.norm(points.r_e - r, axis=1).max() < 6.0 * ROUNDING  # dilution of some satellites


def test_glonass_has_time_of_day_and_its_channels():
    """Moscow time with leap seconds; channels by the frequency."""
    n, sat = 6, 100 + np.arange(1, 7)
    o = Observations(
        np.full(n, 260_000.0), sat, np.zeros(n, dtype=int), ("1C",), np.linspace(1.95e7, 2.4e7, n), np.zeros(n),
        np.zeros(n), np.full(n, 40.0), float(WEEK_START), {int(s): k - 3 for k, s in enumerate(sat)},
    )  # fmt: skip
    back = read_back(o)
    assert np.abs(back.pseudorange - o.pseudorange).max() < 1.01 * ROUNDING
    assert back.glonass_channels == o.glonass_channels


def test_carriers_are_accumulated_ranges_over_wavelengths():
    o, _, _ = sky("G")
    back = read_back(o)
    wavelength = SPEED_OF_LIGHT / 1575.42e6
    assert back.carrier * wavelength == pytest.approx(o.pseudorange - 2.2e7, abs=1e-6)
    assert np.isnan(read_back(o, carrier=False).carrier).all()


def test_over_the_end_of_the_week():
    """The week of transmission is the one before that of reception."""
    o, _, _ = sky("G", n=2, start=0.01)
    back = read_back(o)
    assert np.abs(back.pseudorange - o.pseudorange).max() < 1.01 * ROUNDING


# ---------------------------------------------------------------------------------------------- states and clocks


@pytest.mark.parametrize(
    ("state", "there"),
    [(16_431, True), (8 | 1, True), (16_384 | 1, True), (16_384, False), (1, False), (16_431 | 16, False), (0, False)],
)
def test_a_range_needs_lock_and_time(state, there):
    o, _, _ = sky("G", n=1)
    back = read_back(o, changes={0: {"State": str(state)}})
    assert np.isfinite(back.pseudorange[0]) == there
    assert np.isfinite(back.pseudorange[1:]).all()
    assert np.isfinite(back.range_rate).all()  # a Doppler shift stays one
    assert any("code not locked" in note for note in back.notes) == (not there)


def test_galileo_by_its_secondary_code():
    """Time of transmission modulo 100 ms."""
    o, _, _ = sky("E", n=1)
    rows = records(o)
    sent, state = FIELDS.index("ReceivedSvTimeNanos"), FIELDS.index("State")
    for row in rows:
        row[sent], row[state] = str(int(row[sent]) % 100_000_000), str(1024 | 2048)
    back = raw_measurements("log.txt", FIELDS, rows).observations
    assert np.abs(back.pseudorange - o.pseudorange).max() < 1.01 * ROUNDING


def test_ranges_keep_the_first_bias_until_the_clock_jumps():
    """Biases of later epochs do not move ranges; after a discontinuity the next one counts."""
    o, _, _ = sky("G", n=3)
    at = np.searchsorted(np.unique(o.t), o.t)
    full = -(WEEK_START * NS + 7)
    drift = {k: {"FullBiasNanos": str(full - 300 * int(at[k]))} for k in range(len(o))}
    assert np.abs(read_back(o, changes=drift).pseudorange - o.pseudorange).max() < 1.01 * ROUNDING
    jump = {
        k: {"FullBiasNanos": str(full - 300), "HardwareClockDiscontinuityCount": "5"} for k in np.flatnonzero(at == 2)
    }
    back = read_back(o, changes=jump)
    expected = np.where(at == 2, 300e-9 * SPEED_OF_LIGHT, 0.0)
    assert np.abs(back.pseudorange - o.pseudorange - expected).max() < 1.01 * ROUNDING
    assert any("discontinuous 1 times" in note for note in back.notes)


@pytest.mark.parametrize("count", ["4", "5"], ids=["not counted", "counted"])
def test_a_clock_that_starts_anew(count):
    """The hardware clock counts from zero again, its bias with it: ranges and stamps go on."""
    o, _, _ = sky("G", n=4)
    at = np.searchsorted(np.unique(o.t), o.t)
    rows, full = records(o), -(WEEK_START * NS + 7)
    since = 70 * NS + 12_345_678
    anew = {
        k: {
            "TimeNanos": str(int(rows[k][FIELDS.index("TimeNanos")]) - since), "FullBiasNanos": str(full - since),
            "HardwareClockDiscontinuityCount": count,
        }
        for k in np.flatnonzero(at >= 2)
    }  # fmt: skip
    back = read_back(o, changes=anew)
    assert np.abs(back.pseudorange - o.pseudorange).max() < 1.01 * ROUNDING
    assert np.abs(back.t + back.epoch_gps_s - o.t - o.epoch_gps_s).max() < 1e-6
    assert any("discontinuous 1 times" in note for note in back.notes)


@pytest.mark.parametrize("off_s", [0.7, -0.7, 604_800.0, -3600.0])
def test_a_phone_that_learns_the_time_late(off_s):
    """Two epochs by a wrong bias cost themselves at most, not the log."""
    o, _, _ = sky("G", n=8)
    at = np.searchsorted(np.unique(o.t), o.t)
    bias = {k: {"FullBiasNanos": str(-(WEEK_START * NS + 7) - round(off_s * NS))} for k in np.flatnonzero(at < 2)}
    back = read_back(o, changes=bias)
    right = np.isfinite(back.pseudorange)
    assert right.sum() == np.sum(at >= 2)
    assert np.abs(back.pseudorange[right] - o.pseudorange[at >= 2]).max() < 1.01 * ROUNDING
    assert (len(back) == right.sum()) == (abs(off_s) > 10.0)
    note_part = f"off by {abs(off_s):.0f} s against its time since boot" if abs(off_s) > 10.0 else "have no pseudorange"
    assert any(note_part in note for note in back.notes)


def test_satellites_at_36_000_km():
    """Signals of BeiDou's geostationary satellites and of QZSS take 120 to 140 ms."""
    n, sat = 4, np.array([303, 305, 401, 403])
    assert [SYSTEMS[s // 100] for s in sat] == ["C", "C", "J", "J"]
    o = Observations(
        np.full(n, 260_000.0), sat, np.array([0, 0, 1, 1]), ("2I", "1C"), np.array([3.7e7, 4.17e7, 3.3e7, 4.0e7]),
        np.zeros(n), np.zeros(n), np.full(n, 40.0), float(WEEK_START),
    )  # fmt: skip
    assert np.abs(read_back(o).pseudorange - o.pseudorange).max() < 1.01 * ROUNDING


@pytest.mark.parametrize("off_s", [14, 86_400])
def test_a_system_whose_time_the_phone_counts_otherwise_is_named(off_s):
    o, _, _ = sky("GC", n=2)
    rows, week = records(o), int(WEEK_S) * NS
    sent = FIELDS.index("ReceivedSvTimeNanos")
    beidou = {
        k: {"ReceivedSvTimeNanos": str((int(rows[k][sent]) + off_s * NS) % week)}
        for k in np.flatnonzero(o.sat // 100 == SYSTEMS.index("C"))
    }
    back = read_back(o, changes=beidou)
    assert np.array_equal(np.isfinite(back.pseudorange), o.sat // 100 == SYSTEMS.index("G"))
    assert [note for note in back.notes if note.startswith("Not one measurement of BeiDou")]
    assert not any(note.startswith("Not one") for note in read_back(o).notes)


def test_slips_end_arcs_and_half_cycles_are_said():
    o, _, _ = sky("G", n=2)
    states = {0: "3", 1: "5", 2: "17", 3: "25"}  # reset, slip, half cycle open, half cycle resolved
    back = read_back(o, changes={k: {"AccumulatedDeltaRangeState": s} for k, s in states.items()})
    assert np.isnan(back.carrier[:2]).all()
    assert np.isfinite(back.carrier[2:]).all()
    assert any("2 carriers with a reset or a cycle slip" in note for note in back.notes)
    assert any("1 carriers may be off by half a cycle" in note for note in back.notes)
    assert np.flatnonzero(back.lock).tolist() == [2]


def test_an_arc_ends_where_half_a_cycle_is_settled():
    o, _, _ = sky("G", n=4)
    mine = np.flatnonzero(o.sat == o.sat[0])
    open_, settled = {"AccumulatedDeltaRangeState": "17"}, {"AccumulatedDeltaRangeState": "25"}
    back = read_back(o, changes={k: open_ if i < 2 else settled for i, k in enumerate(mine)})
    arcs = begin_arcs(back.sat, back.carrier, back.signal, back.lock)
    assert arcs[mine].tolist() == [0, 0, 1, 1]
    assert all(len(set(arcs[back.sat == s])) == 1 for s in np.unique(back.sat[back.sat != o.sat[0]]))


def test_what_cannot_be_used_is_counted():
    o, _, _ = sky("G", n=2)
    changes = {
        0: {"FullBiasNanos": ""}, 1: {"ConstellationType": "0"}, 2: {"ReceivedSvTimeUncertaintyNanos": "900"},
        3: {"ConstellationType": "3", "Svid": "98"},
    }  # fmt: skip
    back = read_back(o, changes=changes)
    assert len(back) == len(o) - 3
    assert any("3 raw measurements without clock or slot" in note for note in back.notes)
    assert any("1 of" in note and "less certain than 500 ns" in note for note in back.notes)


def test_first_versions_have_no_frequency_and_no_code():
    o, _, _ = sky("GEC", n=2)
    keep = [k for k, name in enumerate(FIELDS) if name not in ("CarrierFrequencyHz", "CodeType")]
    rows = [[row[k] for k in keep] for row in records(o)]
    back = raw_measurements("log.txt", [FIELDS[k] for k in keep], rows).observations
    named = {(SYSTEMS[s // 100], back.signals[k]) for s, k in zip(back.sat, back.signal, strict=True)}
    assert named == {("G", "1C"), ("E", "1C"), ("C", "2I")}


def test_damage_is_refused_with_its_record():
    o, _, _ = sky("G", n=1)
    for field, text, match in (
        ("ReceivedSvTimeNanos", "12x", "record 2 of Raw: expected numbers"),
        ("Cn0DbHz", "strong", "record 2 of Raw: expected numbers"),
        ("TimeNanos", "9" * 30, "record 2 of Raw: impossible time"),
    ):
        with pytest.raises(FileFormatError, match=match):
            read_back(o, changes={1: {field: text}})
    o, _, _ = sky("G", n=40)
    back = read_back(o, changes={7: {"Cn0DbHz": "strong"}})
    assert len(back) == len(o) - 1
    assert any(f"1 of {len(o)} records Raw are damaged" in note for note in back.notes)
    with pytest.raises(FileFormatError, match="both a clock"):
        read_back(o, changes={k: {"FullBiasNanos": "0"} for k in range(len(o))})


# -------------------------------------------------------------------------------------------------- with an IMU


def test_raw_measurements_tie_the_imu_to_gps_time(tmp_path):
    """Time since boot of an IMU by the chipset's, without any fix."""
    o, _, _ = sky("G", n=20)
    head = "# " + ",".join(FIELDS) + "\n"
    lines, boot = [], round(o.t[0] * NS) - 500 * NS
    for kind, axes in (("UncalAccel", ("XMps2", "YMps2", "ZMps2")), ("UncalGyro", ("XRadPerSec",) * 3)):
        names = [f"{kind}{a}" for a in axes] if kind == "UncalAccel" else [f"{kind}{a}RadPerSec" for a in "XYZ"]
        head += f"# {kind},utcTimeMillis,elapsedRealtimeNanos," + ",".join(names) + "\n"
        values = "0.0,0.0,9.8" if kind == "UncalAccel" else "0.0,0.0,0.0"
        lines += [f"{kind},1,{boot + 20_000_000 * k},{values}" for k in range(900)]
    path = tmp_path / "gnss_log.txt"
    path.write_text(head + "\n".join([*lines, *map(",".join, records(o))]) + "\n")
    log = schuler.read(path)
    assert log.imu is not None
    assert log.observations is not None
    assert log.imu.t[0] == pytest.approx(log.observations.t[0], abs=1e-6)
    assert log.observations.epoch_gps_s == log.metadata.time.epoch_gps_s
    both = schuler.read(tmp_path, imu={"file": path.name}, observations={"file": path.name})
    assert len(both.imu) == len(log.imu)
    assert np.array_equal(both.observations.pseudorange, log.observations.pseudorange)
    assert both.imu.t[0] == pytest.approx(both.observations.t[0], abs=1e-6)
    tied = FIELDS.index("ChipsetElapsedRealtimeNanos")
    without = [",".join(row[:tied]) for row in records(o)]
    (untied := tmp_path / "untied.txt").write_text(
        head.replace(",ChipsetElapsedRealtimeNanos", "") + "\n".join([*lines, *without]) + "\n"
    )
    measured = schuler.read(untied)
    assert measured.imu is None
    assert np.array_equal(measured.observations.pseudorange, log.observations.pseudorange)
    assert any("The IMU was left out: nothing ties" in note for note in measured.metadata.notes)
    with pytest.raises(InputError, match="nothing ties"):
        schuler.read(untied, series="imu")
    alone = schuler.read(path, time="local")
    assert alone.observations is None
    assert any("time since boot was asked for" in note for note in alone.metadata.notes)


# ---------------------------------------------------------------------------------------------------- recording


@pytest.mark.realdata
def test_a_pixel(shared_data):
    """Ranges of all systems move as their Doppler shifts say, over steps of 18 s: seen 0.4 m/s."""
    o = schuler.read(shared_data / "gnss_nav_files" / "android_pixel6.txt", streams="imu=none").observations
    assert len(o.epochs) == 31
    assert set(o.signals) == {"1C", "5Q"}
    assert np.isfinite(o.pseudorange).mean() > 0.95
    assert np.nanmin(o.pseudorange) > 1.9e7
    assert np.nanmax(o.pseudorange) < 2.9e7
    off = []
    for sat in np.unique(o.sat):
        for signal in range(2):
            k = (o.sat == sat) & (o.signal == signal) & np.isfinite(o.pseudorange)
            if k.sum() > 15:
                rate = np.diff(o.pseudorange[k]) / np.diff(o.t[k])
                off.append(np.median(rate - 0.5 * (o.range_rate[k][1:] + o.range_rate[k][:-1])))
    assert len(off) >= 25
    assert np.max(np.abs(off)) < 1.0
