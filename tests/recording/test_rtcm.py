"""RTCM 3: the frame of the standard, every field by an encoder of its own, damage counted, a base read from it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import encode_rtcm as enc
import mutations
import numpy as np
import pytest
from receiver_pairs import HOME, pair

import schuler
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.gnss.baseline import solve_baseline
from schuler.gnss.message_fields import SEMICIRCLE
from schuler.gnss.signals import satellite
from schuler.recording.formats.rtcm import crc24q, find_frames, looks_like_rtcm, read_rtcm
from schuler.recording.recording import Metadata, Recording

pytest.importorskip("pyrtcm")
# message 1005 of RTCM 10403, the standard's example: station 2003 at 1114104.5999, -4850729.7108, 3975521.4643 m
EXAMPLE = bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98")
WEEK = 604_800.0


@pytest.fixture(scope="module")
def two():
    """Rover and base for twenty seconds, 300 m apart, with Doppler shifts as of a receiver at rest."""
    stamps = np.arange(20.0)  # whole by the base's clock, as a base's are
    t = (stamps - 3e-4) / (1.0 + 1e-7)
    p = pair(np.random.default_rng(3), lambda _: (200.0, -220.0, 5.0), t, bands=("1C",), each=12)
    rate = np.zeros(len(p.base))
    order = np.lexsort((p.base.t, p.base.signal, p.base.sat))
    same = (np.diff(p.base.sat[order]) == 0) & (np.diff(p.base.signal[order]) == 0)
    change = np.diff(p.base.pseudorange[order]) / np.maximum(np.diff(p.base.t[order]), 1e-9)
    rate[order[1:]] = np.where(same, change, 0.0)
    return replace(p, base=replace(p.base, t=np.round(p.base.t, 6), range_rate=rate, cn0=np.round(p.base.cn0)))


def stream(log, kind=7, lock=600, systems="GEC"):
    frames = [enc.station(HOME)]
    for t in np.unique(log.t):
        frames += [
            enc.msm(log, s, t, kind, lock) for s in systems if (log.sat[log.t == t] // 100 == "GRECJ".index(s)).any()
        ]
    return frames


def saved(tmp_path, frames, name="base.rtcm3"):
    path = tmp_path / name
    path.write_bytes(b"".join(frames))
    return path


def read(path, log):
    return read_rtcm(path, log.epoch_gps_s + 3.0)


def matched(read_rows, log):
    """Rows of both in one order: by time, satellite and signal."""
    name = np.array(log.signals)[log.signal]
    other = np.array(read_rows.signals)[read_rows.signal]
    a, b = np.lexsort((name, log.sat, log.t)), np.lexsort((other, read_rows.sat, read_rows.t))
    assert (log.sat[a] == read_rows.sat[b]).all()
    assert (name[a] == other[b]).all()
    return a, b


def test_the_standards_frame():
    assert crc24q(EXAMPLE) == 0
    assert enc.framed(EXAMPLE[3:-3]) == EXAMPLE
    frames = find_frames(b"\xd3\x00" + EXAMPLE + b"noise\xd3" + EXAMPLE + EXAMPLE[:9])
    assert (len(frames.payloads), frames.failed, frames.truncated) == (2, 0, True)
    assert frames.strange == 2 + 6
    assert looks_like_rtcm(EXAMPLE * 2)
    assert not looks_like_rtcm(EXAMPLE)
    wrong = bytearray(EXAMPLE * 3)
    wrong[30] ^= 1
    damaged = find_frames(bytes(wrong))
    assert (len(damaged.payloads), damaged.failed >= 1, damaged.strange) == (2, True, len(EXAMPLE))


@pytest.mark.parametrize(("kind", "code", "carrier"), [(7, 3e-4, 1e-4), (4, 1e-2, 4e-4)])
def test_observations_come_back_to_half_a_digit(tmp_path, two, kind, code, carrier):
    """Printed digits: half of 2^-29 ms (0.56 mm), 2^-31 ms (0.14 mm); MSM4 2^-24 ms (18 mm), 2^-29 ms."""
    log = read(saved(tmp_path, stream(two.base, kind, 15 if kind == 4 else 600)), two.base)
    o = log.observations
    a, b = matched(o, two.base)
    np.testing.assert_allclose(o.epoch_gps_s + o.t[b], two.base.epoch_gps_s + two.base.t[a], atol=1e-6)
    np.testing.assert_allclose(o.pseudorange[b], two.base.pseudorange[a], rtol=0.0, atol=code)
    np.testing.assert_allclose(o.carrier[b] * 0.19, two.base.carrier[a] * 0.19, rtol=0.0, atol=carrier)
    np.testing.assert_allclose(o.cn0[b], two.base.cn0[a], atol=1e-9)
    if kind == 7:
        np.testing.assert_allclose(o.range_rate[b], two.base.range_rate[a], atol=6e-5)
    else:
        assert np.isnan(o.range_rate).all()
    assert not o.lock.any()
    np.testing.assert_allclose(o.station_e, HOME, atol=5.1e-5)  # half of 0.1 mm
    assert log.notes == ()
    if kind == 7:
        kept = schuler.read(schuler.write(Recording(observations=o, metadata=Metadata()), tmp_path / "base.parquet")[0])
        assert kept.observations.station_e == o.station_e


def test_the_antenna_and_its_height_are_read_and_kept(tmp_path, two):
    frames = [*enc.mounted(HOME, 1.5432, "TRM59800.00     SCIT"), *stream(two.base)[1:3]]
    o = read(saved(tmp_path, frames), two.base).observations
    assert (o.antenna, o.eccentricity_n) == ("TRM59800.00 SCIT", (0.0, 0.0, -1.5432))
    np.testing.assert_allclose(o.station_e, HOME, atol=5.1e-5)  # half of 0.1 mm
    kept = schuler.read(schuler.write(Recording(observations=o, metadata=Metadata()), tmp_path / "base.parquet")[0])
    assert (kept.observations.antenna, kept.observations.eccentricity_n) == (o.antenna, o.eccentricity_n)


def test_a_lock_time_shorter_than_the_interval_ends_an_arc(tmp_path, two):
    """DF407 of 600 is 50 s and more, of 63 only 63 ms; DF402 of 4 is 256 to 512 ms."""
    t = np.unique(two.base.t)[:4]
    frames = [enc.msm(two.base, "G", x, 7, lock) for x, lock in zip(t, (600, 600, 63, 601), strict=True)]
    o = read(saved(tmp_path, frames), two.base).observations
    lost = [set(o.lock[o.t == x]) for x in np.unique(o.t)]
    assert lost == [{0}, {0}, {1}, {0}]
    frames = [enc.msm(two.base, "G", x, 4, lock) for x, lock in zip(t, (9, 4, 5, 6), strict=True)]
    o = read(saved(tmp_path, frames), two.base).observations
    assert [set(o.lock[o.t == x]) for x in np.unique(o.t)] == [{0}, {1}, {0}, {0}]
    half = replace(two.base, lock=np.full(len(two.base), 2))
    o = read(saved(tmp_path, [enc.msm(half, "G", x) for x in t]), two.base).observations
    assert set(o.lock) == {2}


def test_damaged_frames_are_left_out_and_counted(tmp_path, two):
    frames = stream(two.base)
    whole = read(saved(tmp_path, frames), two.base).observations
    spoiled = bytearray(frames[5])
    spoiled[40] ^= 0x10
    short = enc.framed(frames[9][3:30])  # a payload that ends within its masks' cells
    unknown = enc.framed(bytes.fromhex("fa00") + bytes(10))  # 4000
    path = saved(tmp_path, [*frames[:5], bytes(spoiled), *frames[6:9], short, *frames[10:], unknown, frames[4][:50]])
    log = read(path, two.base)
    assert len(whole) - 20 <= len(log.observations) < len(whole)
    text = " ".join(log.notes)
    assert "with a wrong checksum were left out" in text
    assert "1 frames were not of the length their contents call for" in text
    assert "The last frame was cut off" in text
    assert "1 of 4000" in text
    rng = np.random.default_rng(5)
    data = b"".join(frames)
    for _ in range(30):  # whatever is wrong: observations, or an error that says what was expected
        bad = bytearray(data)
        for at in rng.integers(0, len(bad), 200):
            bad[at] = rng.integers(0, 256)
        path.write_bytes(bytes(bad))
        try:
            read(path, two.base)
        except FileFormatError as error:
            assert "expected RTCM 3 observations" in str(error)  # noqa: PT017 - most of these are read
    path.write_bytes(b"".join(frame[:-1] + bytes([frame[-1] ^ 1]) for frame in frames))
    with pytest.raises(FileFormatError, match=r"only damaged frames \(\d+\): record the stream as bytes"):
        read(path, two.base)


def wrong_contents(frames, seed):
    """Frames of right lengths and checks, some of whose bytes are any."""
    rng, made = np.random.default_rng(seed), []
    for frame in frames:
        body = bytearray(frame[:-3])
        if rng.random() < 0.3:
            for at in rng.integers(3, len(body), 4):
                body[at] = rng.integers(256)
        made.append(bytes(body) + crc24q(bytes(body)).to_bytes(3, "big"))
    return b"".join(made)


@pytest.mark.parametrize("count", [25, pytest.param(500, marks=pytest.mark.fuzz)])
def test_damaged_streams_raise_only_errors_of_ours(tmp_path, two, count):
    """Cut, inserted and changed bytes, and any contents behind right checks: read, or refused with an error of ours."""
    frames, whole = stream(two.base)[:20], 0
    for seed in range(count):
        data = wrong_contents(frames, seed) if seed % 2 else mutations.damaged(b"".join(frames), seed)
        with suppress(SchulerError):
            log = read(saved(tmp_path, [data]), two.base)
            whole += 1
            assert log.observations is None or np.isfinite(log.observations.t).all()
    assert whole > 0.5 * count


def test_the_week_is_asked_for_or_said(tmp_path, two):
    path = saved(tmp_path, stream(two.base))
    with pytest.raises(FileFormatError, match="gps-tow:WEEK"):
        schuler.read(path)
    week = int(two.base.epoch_gps_s // WEEK)
    recording = schuler.read(path, time=f"gps-tow:{week}")
    assert recording.observations.epoch_gps_s == week * WEEK
    assert recording.ephemerides is None
    message = saved(tmp_path, [*stream(two.base), enc.ephemeris("1046", drawn("1046", week - 1024))], "said.rtcm3")
    assert schuler.read(message).observations.epoch_gps_s == week * WEEK
    with pytest.raises(FileFormatError, match=r"expected RTCM 3 observations .*found 1 of 1005"):
        schuler.read(saved(tmp_path, [EXAMPLE], "station.rtcm3"))
    with pytest.raises(InputError, match="rate"):
        schuler.read(path, rate=10.0)


def drawn(kind, week, seed=1):
    """Values at random of whole last digits."""
    rng, values = np.random.default_rng(seed), {}
    for name, bits, scale in enc.EPHEMERIS[kind]:
        unsigned = name in ("e", "sqrt_a")
        low = 0 if unsigned else -(1 << (bits - 1))
        values[name] = int(rng.integers(low, 1 << (bits - 1))) * scale
    last = {"1019": 16.0, "1042": 8.0, "1045": 60.0, "1046": 60.0}[kind]
    # half a day into the week of the logs above
    return values | {
        "sat": 11, "week": week, "ura": 3, "issue": 21, "toe": 43_200.0 // last * last, "toc": 42_000.0 // last * last,
        "health": 0, "x": 0, "hs_e5b": 2, "dvs_e5b": 1, "hs_e1b": 0, "dvs_e1b": 1, "hs_e5a": 1, "dvs_e5a": 0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "sat", "first", "behind"), [("1019", "G11", 2048, 0), ("1042", "C11", 1356, 14), ("1045", "E11", 1024, 0),
                                         ("1046", "E11", 1024, 0)],
)  # fmt: skip
def test_ephemerides_come_back_exactly(tmp_path, two, kind, sat, first, behind):
    week = 2300
    values = drawn(kind, week - first)
    twice = [enc.ephemeris(kind, values)] * 2
    path = saved(tmp_path, [*twice, *stream(two.base)])
    log = read_rtcm(path)
    k = log.ephemerides.kepler
    assert k.sat.tolist() == [satellite(sat)]
    for name in ("af0", "af1", "af2", "crs", "crc", "cuc", "cus", "cic", "cis", "e", "sqrt_a"):
        assert getattr(k, name)[0] == pytest.approx(values[name], rel=1e-14), name  # rounding
    for name in ("i0", "omega0", "omega", "m0", "delta_n", "idot", "omega_dot"):
        assert getattr(k, name)[0] == pytest.approx(values[name] * SEMICIRCLE, rel=1e-14), name
    assert (k.toe[0], k.toc[0]) == (week * WEEK + values["toe"] + behind, week * WEEK + values["toc"] + behind)
    assert k.group_delay[0, 0] == pytest.approx(values["delay_1"], rel=1e-14)
    if kind in ("1042", "1046"):
        assert k.group_delay[0, 1] == pytest.approx(values["delay_2"], rel=1e-14)
    assert k.issue[0] == 21
    assert k.accuracy[0] == (0.03 if sat == "E11" else 5.7)
    assert k.health[0] == {"1045": 1 << 4, "1046": 1 | 1 << 6 | 2 << 7}.get(kind, 0)
    assert k.source[0] == {"1045": 258, "1046": 517}.get(kind, 0)
    assert log.observations.epoch_gps_s == week * WEEK
    if kind == "1019":  # ten bits of the week, the era by the time that is given
        assert read_rtcm(path, (week - 1024) * WEEK).ephemerides.kepler.toe[0] == k.toe[0] - 1024 * WEEK


def test_a_baseline_from_a_stream_is_that_from_memory(tmp_path, two):
    """Printed digits of MSM7: a tenth of a millimetre a carrier."""
    streamed = read(saved(tmp_path, stream(two.base)), two.base).observations
    llh = schuler.frames.llh_from_ecef(HOME)
    one = solve_baseline(two.rover, two.base, two.ephemerides, llh)
    other = solve_baseline(two.rover, streamed, two.ephemerides, llh)
    assert one.fixed.all()
    assert other.fixed.all()
    np.testing.assert_allclose(other.baseline_n, one.baseline_n, atol=3e-4)
    np.testing.assert_allclose(other.baseline_n, two.baseline_n, atol=1e-3)
