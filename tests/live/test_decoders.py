"""Decoders of streams: fed a file in pieces of any length they give what reading the file gives, to the last bit."""

import functools
import struct

import encode_novatel as nov
import encode_sbf as sbf
import encode_vectornav as vn
import numpy as np
import pytest
from format_drives import drive
from messy_folders import nmea as nmea_lines

from schuler import read
from schuler.exceptions import InputError
from schuler.gnss.observations import joined_observations
from schuler.live.clock import SourceClock
from schuler.live.decoders.detection import decoder
from schuler.live.messages import Broadcast, Fix, Heading, ImuBlock, ImuSample, SatelliteEpoch, Speed
from schuler.live.satellites import LiveSatellites
from schuler.navigation.config import NavigationConfig
from schuler.recording.formats.novatel_frames import IMU_TYPES
from schuler.recording.io import ReadHints

GARBAGE = bytes(range(256)) * 3


def fed(decoder, data, seed=0, largest=400):
    """Messages of a stream that comes in pieces of random length."""
    rng, messages, at = np.random.default_rng(seed), [], 0
    while at < len(data):
        step = int(rng.integers(1, largest))
        messages += decoder.feed(data[at : at + step], 1.4e9)
        at += step
    return messages + decoder.finish()


def same_fixes(messages, gnss):
    assert [m.t for m in messages] == gnss.t.tolist()
    for name in ("llh", "cov_r_n", "v_n", "cov_v_n"):
        np.testing.assert_array_equal([getattr(m, name) for m in messages], getattr(gnss, name))
    assert [m.quality for m in messages] == gnss.quality.tolist()
    assert [m.n_satellites for m in messages] == gnss.n_satellites.tolist()


def imu_lines(imu, factor=(1.0, 1.0)):
    rows = np.column_stack((imu.t, imu.accel * factor[0], imu.gyro * factor[1]))
    return "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows).encode() + b"\n"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "options",
    [
        {"units": "m/s^2,rad/s", "time": "gps-tow:2300"},
        {"units": "g,deg/s,ms", "axes": "FLU", "offset": 0.25},
        {"units": "accel=g,gyro=deg/s", "axes": "RFU", "scale": "0.5,2", "time": "gps"},
        {"units": "m/s,rad", "kind": "increment", "time": "gps-unix"},
        {"units": "g,deg/s", "time": "unix"},
    ],
)
def test_lines_of_an_imu_are_the_samples_of_the_file(tmp_path, options, seed):
    imu = drive(4.0).imu
    start = {"gps": 2300 * 604_800.0, "gps-unix": 1.7e9, "unix": 1.7e9}.get(options.get("time"), 0.0)
    scale = 1e3 if "ms" in options["units"] else 1.0
    columns = "t,ax,ay,-az,-,gx,gy,gz,*"
    rows = np.column_stack((scale * (start + imu.t), imu.accel, np.full(len(imu), 7.0), imu.gyro, imu.gyro))
    data = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in rows).encode()
    (tmp_path / "imu.txt").write_bytes(data)
    hints = ReadHints.of(columns=columns, **options)
    log = read(tmp_path / "imu.txt", hints, allow="norm,magnitude")
    clock = SourceClock()
    samples = fed(decoder(clock, hints), data, seed)
    assert clock.base == log.metadata.time
    assert [s.t for s in samples] == log.imu.t.tolist()
    np.testing.assert_array_equal([s.gyro for s in samples], log.imu.gyro)
    np.testing.assert_array_equal([s.accel for s in samples], log.imu.accel)


@pytest.mark.parametrize("seed", range(3))
def test_lines_of_fixes_and_speeds_are_those_of_the_file(tmp_path, seed):
    gnss = drive().gnss
    rows = np.column_stack((gnss.t, np.rad2deg(gnss.llh[:, :2]), gnss.llh[:, 2], gnss.v_n))
    data = "\n".join(",".join(f"{v:.17g}" for v in row) for row in rows).encode()
    (tmp_path / "fixes.csv").write_bytes(data)
    hints = ReadHints.of(
        columns="t,lat,lon,h,vn,ve,vd", units="angle=deg,t=s", sigma="1,1,2,0.1,0.1,0.2", time="gps-tow:2300",
        height="ellipsoidal",
    )  # fmt: skip
    log = read(tmp_path / "fixes.csv", hints)
    messages = fed(decoder(SourceClock(), hints), data, seed)
    assert [m.t for m in messages] == log.gnss.t.tolist()
    for name in ("llh", "cov_r_n", "v_n", "cov_v_n"):
        np.testing.assert_array_equal([getattr(m, name) for m in messages], getattr(log.gnss, name))
    hints = ReadHints.of(columns="t,speed,sspeed", units="velocity=km/h")
    (tmp_path / "odometer.csv").write_bytes(b"1.5,36,0.36\n2.5,72,0.72\n")
    log = read(tmp_path / "odometer.csv", hints)
    made = fed(decoder(SourceClock(), hints), (tmp_path / "odometer.csv").read_bytes(), seed, 5)
    np.testing.assert_array_equal(
        [(m.t, m.speed, m.sigma) for m in made],
        np.column_stack((log.odometer.t, log.odometer.speed, log.odometer.sigma)),
    )
    assert all(isinstance(m, Speed) for m in made)


@pytest.mark.parametrize("seed", range(3))
def test_nmea_in_pieces_is_the_nmea_of_the_file(tmp_path, seed):
    pytest.importorskip("pynmeagps")
    lines = nmea_lines(drive())
    data = GARBAGE + (lines if isinstance(lines, bytes) else "".join(lines).encode())
    (tmp_path / "rover.nmea").write_bytes(data[len(GARBAGE) :])
    log, clock = read(tmp_path / "rover.nmea"), SourceClock()
    same_fixes(fed(decoder(clock, ReadHints()), data, seed), log.gnss)
    assert clock.base == log.metadata.time


def test_a_pause_completes_an_epoch_of_nmea():
    pytest.importorskip("pynmeagps")
    lines = nmea_lines(drive(8.0))
    data = lines if isinstance(lines, bytes) else "".join(lines).encode()
    bursts = [b"$" + part for part in data.split(b"$")[1:]]
    at_once, stream = decoder(SourceClock(), ReadHints()), []
    for gga, rmc in zip(bursts[::2], bursts[1::2], strict=True):
        assert at_once.feed(gga + rmc, 0.0) == []
        stream += at_once.pause()
        assert at_once.pause() == []
    whole = fed(decoder(SourceClock(), ReadHints()), data)
    assert [m.t for m in stream] == [m.t for m in whole]


@pytest.mark.parametrize("seed", range(3))
def test_ubx_in_pieces_is_the_ubx_of_the_file(tmp_path, seed):
    pytest.importorskip("pyubx2")
    from tests.recording.test_ubx import GGA, pvt

    frames = [pvt(itow=408_640_000 + 200 * k, when=(2025, 8, 28, 17, 30, 22), nano=200_000_000 * k) for k in range(5)]
    frames.insert(2, pvt(fix=0))
    data = (
        GGA.join(frames) + GARBAGE + b"\xb5\x62\x01\x07\xff\xff" + pvt(itow=408_642_000, when=(2025, 8, 28, 17, 30, 24))
    )
    (tmp_path / "rover.ubx").write_bytes(data)
    log, clock = read(tmp_path / "rover.ubx"), SourceClock()
    stream = decoder(clock, ReadHints())
    same_fixes(fed(stream, data, seed), log.gnss)
    assert clock.base == log.metadata.time
    assert stream.left_out["epochs without a fix were left out"] == 1
    assert stream.left_out["bytes that belong to no frame and no NMEA sentence"] == len(GARBAGE) + 6


def test_garbage_is_counted_and_the_stream_goes_on():
    hints = ReadHints.of(columns="t,ax,ay,az,gx,gy,gz", units="g,deg/s")
    stream = decoder(SourceClock(), hints)
    rng = np.random.default_rng(1)
    messages = []
    for k in range(50):
        messages += stream.feed(rng.bytes(2000).replace(b"\n", b" ") + b"\n" * (k % 2), 0.0)
        messages += stream.feed(
            b"\n%d,0,0,-1,0,0,0\n" % k + b"%d,nan,0,0,0,0,0\n1e3,1e99,0,0,0,0,0\n%d,0,\n" % (k, k), 0.0
        )
    assert [m.t for m in messages] == list(range(50))
    assert sum(stream.left_out.values()) >= 150
    assert len(stream.left_out) <= 3


@pytest.mark.campaign
@pytest.mark.realdata
def test_raw_measurements_of_ubx_in_pieces_are_those_of_the_file(shared_data, tmp_path):
    """The beginning of a walk: every epoch to the last bit, and every ephemeris that the log has by then."""
    pytest.importorskip("pyubx2")
    data = (shared_data / "rtkexp_walk" / "gnss_1730.ubx").read_bytes()[:300_000]
    (tmp_path / "walk.ubx").write_bytes(data)
    log, clock = read(tmp_path / "walk.ubx"), SourceClock()
    made = fed(decoder(clock, ReadHints(), format="ubx", raw=True), data, 3)
    epochs = [m.measured for m in made if isinstance(m, SatelliteEpoch)]
    o = joined_observations(epochs)
    assert clock.base == log.metadata.time
    assert len(epochs) == len(log.observations.epochs)
    np.testing.assert_array_equal([o.signals[k] for k in o.signal],
                                  [log.observations.signals[k] for k in log.observations.signal])  # fmt: skip
    for name in ("t", "sat", "pseudorange", "range_rate", "carrier", "cn0"):
        np.testing.assert_array_equal(getattr(o, name), getattr(log.observations, name))
    satellites = LiveSatellites(NavigationConfig.checked({"imu": {"catalogue": "MTi-G-710"}}))
    for message in made:
        if isinstance(message, Broadcast):
            satellites.learn(message.ephemerides)
    for name in ("kepler", "glonass"):
        mine, whole = getattr(satellites.ephemerides, name), getattr(log.ephemerides, name)
        missing = set(whole.sat.tolist()) - set(mine.sat.tolist())
        assert set(mine.sat.tolist()) <= set(whole.sat.tolist())
        assert len(missing) <= 2  # whose last subframe came within the last six seconds
        for k, sat in enumerate(mine.sat):
            assert np.any((whole.sat == sat) & (whole.toe == mine.toe[k]))


@pytest.mark.parametrize("kind", ["nmea", "ubx"])
def test_damaged_streams_raise_nothing(kind):
    """Bytes changed, lost and repeated; checksums are made right again in every other sentence of NMEA."""
    pytest.importorskip("pynmeagps" if kind == "nmea" else "pyubx2")
    from tests.recording.test_nmea import sentence
    from tests.recording.test_ubx import frame, pvt

    rng = np.random.default_rng(5)
    lines = nmea_lines(drive(10.0))
    pieces = (lines if isinstance(lines, bytes) else "".join(lines).encode()).splitlines(keepends=True)
    for _ in range(100):
        stream = decoder(SourceClock(), ReadHints(), format=kind)
        for k, piece in enumerate(pieces):
            body = bytearray(piece if kind == "nmea" else pvt(itow=408_640_000 + 250 * k)[6:-2])
            for at in rng.integers(0, len(body), rng.integers(0, 4)):
                body[at] = rng.integers(32, 127) if kind == "nmea" else rng.integers(0, 256)
            del body[int(rng.integers(0, 2 * len(body))) :]
            data = bytes(body) if kind == "nmea" else frame(0x0107, bytes(body))
            if kind == "nmea" and k % 2:
                data = sentence(data.partition(b"*")[0].decode().lstrip("$")).encode()
            stream.feed(data, 0.0)
        stream.finish()


def test_rows_by_arrival_are_on_gps_time():
    hints = ReadHints.of(columns="-,ax,ay,az,gx,gy,gz", units="g,deg/s")
    clock = SourceClock()
    (sample,) = decoder(clock, hints, by_arrival=True, whole=True).feed(b"99,0,0,-1,0,0,0", 2300 * 604_800.0 + 12.25)
    assert isinstance(sample, ImuSample)
    assert sample.t == 12.25
    assert clock.base.epoch_gps_s == 2300 * 604_800.0


def test_two_clocks_are_not_mixed():
    hints = ReadHints.of(columns="t,ax,ay,az,gx,gy,gz", units="g,deg/s")
    clock = SourceClock()
    decoder(clock, hints).feed(b"5,0,0,-1,0,0,0\n", 0.0)
    fixes = ReadHints.of(
        columns="t,lat,lon,h", units="angle=deg", sigma="1,1,2", height="ellipsoidal", time="gps-tow:2300"
    )
    with pytest.raises(InputError, match="an earlier one counts on a clock of its own"):
        decoder(clock, fixes).feed(b"5,48,11,500\n", 0.0)


def test_weeks_of_a_stream_are_counted_on():
    hints = ReadHints.of(
        columns="t,lat,lon,h", units="angle=deg", sigma="1,1,2", height="ellipsoidal", time="gps-tow:2300"
    )
    stream = decoder(SourceClock(), hints)
    messages = stream.feed(b"604799,48,11,500\n0,48,11,500\n1,48,11,500\n", 0.0)
    assert [m.t for m in messages] == [604_799.0, 604_800.0, 604_801.0]
    assert all(isinstance(m, Fix) for m in messages)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "format of a stream: 'rinex' is not known"),
        ({"columns": "t,ax,ay,az,gx,gy,gz"}, "the unit of ax is not known"),
        ({"columns": "ax,ay,az,gx,gy,gz", "units": "g,deg/s"}, "there is no time"),
        ({"columns": "t,ax,ay,az", "units": "g,deg/s"}, "gx, gy, gz missing"),
        ({"columns": "t=Stamp,ax=X,ay=Y,az=Z,gx=A,gy=B,gz=C", "units": "g,deg/s"}, "a stream has no header"),
    ],
)
def test_what_is_not_described_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        decoder(SourceClock(), ReadHints.of(**options), format=None if options else "rinex")


def same_samples(messages, imu):
    for name in ("t", "gyro", "accel"):
        np.testing.assert_array_equal(np.concatenate([getattr(m, name) for m in messages]), getattr(imu, name))


@functools.cache
def vectornav_log(*, delta=False):
    """Packets of a drive: an IMU with the fix that is repeated until the next, and an INS of another kind."""
    run, made = drive(8.0), []
    week_ns, g = 2300 * 604_800 * 10**9, run.gnss
    for k, t in enumerate(run.imu.t):
        fix = int(np.searchsorted(g.t, t + 1e-6)) - 1
        rates = {"UncompAccel": tuple(run.imu.accel[k]), "UncompGyro": tuple(run.imu.gyro[k]), "Temp": 20.0 + k}
        deltas = {"DeltaTheta": (0.02, *(1.0 * run.imu.gyro[k])), "DeltaVel": tuple(0.02 * run.imu.accel[k])}
        made.append(vn.packet(
            TimeGps=week_ns + round(t * 1e9), FixTow=round(g.t[fix] * 1e9), FixWeek=2300, NumSats=14,
            Fix=0 if fix == 3 else 8, FixLla=(*np.rad2deg(g.llh[fix, :2]), g.llh[fix, 2]), FixVel=tuple(g.v_n[fix]),
            FixPosU=tuple(np.sqrt(np.diag(g.cov_r_n[fix]))), FixVelU=0.05, **(deltas if delta else rates),
        ))  # fmt: skip
        made.append(vn.packet(TimeGps=week_ns + round(t * 1e9), Ypr=(1.0, 2.0, 3.0)))
    return made


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("options", [{}, {"streams": "imu=delta"}, {"axes": "FLU", "offset": 0.25}])
def test_vectornav_in_pieces_is_the_vectornav_of_the_file(tmp_path, options, seed):
    packets = vectornav_log(delta="streams" in options)
    data = GARBAGE + b"".join(packets[:100]) + packets[100][:40] + b"\xfa\x29" + b"".join(packets[101:])
    (tmp_path / "vn.bin").write_bytes(data)
    hints = ReadHints.of(**options)
    log, clock = read(tmp_path / "vn.bin", hints, allow="norm"), SourceClock()
    stream = decoder(clock, hints, format="vectornav" if "streams" in options else None)
    messages = fed(stream, data, seed, 2000)
    assert clock.base == log.metadata.time
    same_fixes([m for m in messages if isinstance(m, Fix)], log.gnss)
    blocks = [m for m in messages if isinstance(m, ImuBlock)]
    same_samples(blocks, log.imu)
    if log.imu.temperature is not None:
        np.testing.assert_array_equal(np.concatenate([m.temperature for m in blocks]), log.imu.temperature)
    assert stream.left_out["epochs without a fix"] == 1
    assert stream.left_out["bytes that belong to no message with a right checksum"] == len(GARBAGE) + 42


def test_increments_of_vectornav_are_taken_only_where_the_run_knows_it():
    """A navigator is made for rates or for increments before the first byte comes."""
    data = b"".join(vectornav_log(delta=True))
    for options, kind, taken in (({}, "rate", False), ({"streams": "imu=delta"}, "increment", True)):
        stream = decoder(SourceClock(), ReadHints.of(**options), format="vectornav")
        assert stream.kind == kind
        assert any(isinstance(m, ImuBlock) for m in fed(stream, data, largest=5000)) is taken
    stream = decoder(SourceClock(), ReadHints.of(streams="imu=delta"))
    assert not any(isinstance(m, ImuBlock) for m in fed(stream, data, largest=5000))
    assert any("format=vectornav" in phrase for phrase in stream.left_out)
    assert decoder(SourceClock(), ReadHints.of(series="gnss"), format="vectornav").kind is None


@functools.cache
def sbf_log():
    """Blocks of a drive in order of time: an IMU, partly in two blocks, fixes with covariances after them, headings."""
    run = drive(12.0)
    g, timed = run.gnss, []
    for t, f, w in zip(run.imu.t, run.imu.accel * (1, -1, -1), np.rad2deg(run.imu.gyro) * (1, -1, -1), strict=True):
        ms = round(t * 1000)
        parts = [(f, None), (None, w)] if ms % 100 == 5 else [(f, w)]
        timed += [(t, sbf.imu(2300, ms, *part)) for part in parts]
    for k, t in enumerate(g.t):
        ms, blocks = round(t * 1000), []
        blocks.append(sbf.pvt(2300, ms, g.llh[k], g.v_n[k] * (1, 1, -1), error=k == 2, accuracy=(60, 80)))
        for number, C in ((5906, g.cov_r_n[k]), (5908, g.cov_v_n[k])):
            cov = C[0, 0], C[1, 1], C[2, 2], C[0, 1], -C[0, 2], -C[1, 2]
            blocks += [sbf.covariance(number, 2300, ms, *cov)] if k % 4 != 1 or number == 5908 else []
        blocks += [sbf.attitude(2300, ms, 10.0 * k, 1.0, 0.0), sbf.attitude_covariance(2300, ms, 0.25)]
        timed += [(t + 0.03, block) for block in [*blocks, sbf.block(5914, 2300, ms, bytes(8))]]
    return [block for _, block in sorted(timed, key=lambda pair: pair[0])]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("options", [{}, {"axes": "FRD", "offset": 0.25}, {"series": "gnss"}])
def test_sbf_in_pieces_is_the_sbf_of_the_file(tmp_path, options, seed):
    blocks = sbf_log()
    data = GARBAGE + b"".join(blocks[:151]) + blocks[151][:40] + b"$@\x41" + b"".join(blocks[152:])
    (tmp_path / "log.sbf").write_bytes(data)
    hints = ReadHints.of(**options)
    log, clock = read(tmp_path / "log.sbf", hints, allow="norm"), SourceClock()
    stream = decoder(clock, hints)
    messages = fed(stream, data, seed, 2000)
    assert clock.base == log.metadata.time
    same_fixes([m for m in messages if isinstance(m, Fix)], log.gnss)
    assert stream.left_out["epochs of PVTGeodetic without a solution"] == 1
    assert stream.left_out["bytes that belong to no message with a right checksum"] == len(GARBAGE) + 43
    if "series" in options:
        assert len(messages) == len(log.gnss)
        return
    same_samples([m for m in messages if isinstance(m, ImuBlock)], log.imu)
    headings = [(m.t, m.value, m.sigma) for m in messages if isinstance(m, Heading)]
    np.testing.assert_array_equal(headings, np.column_stack((log.heading.t, log.heading.value, log.heading.sigma)))


def test_a_pause_completes_an_epoch_of_sbf():
    """Without it a fix would wait for the next one; an epoch that has all its blocks does not wait for either."""
    stream = decoder(SourceClock(), ReadHints(), format="sbf")
    for k in range(8):
        ms = 1000 * k
        first = sbf.pvt(2300, ms, (0.8, 0.1, 500.0), (0, 0, 0)) + sbf.covariance(5906, 2300, ms, 1, 1, 4, 0, 0, 0)
        last = sbf.covariance(5908, 2300, ms, 0.01, 0.01, 0.01, 0, 0, 0)
        made = stream.feed(first, 0.0) + stream.feed(last, 0.0)
        made += [] if k >= 3 else stream.pause()
        assert [m.t for m in made] == [k]
        assert stream.pause() == []


@functools.cache
def novatel_log(*, latency=0.0, config=False, lost=()):
    """Messages of a drive in order of time: counts, positions and after them velocities, some of the INS, headings."""
    run, kind = drive(12.0, 125.0, kind="increment"), IMU_TYPES[41]
    g, timed = run.gnss, [(0.0, nov.long_frame(1945, 2300, 0, struct.pack("<I", 41)))] if config else []
    axes = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    counts = np.round(np.hstack((run.imu.accel @ axes.T / kind.accel, run.imu.gyro @ axes.T / kind.gyro))).astype(int)
    for t, row in zip(run.imu.t.tolist(), counts.tolist(), strict=True):
        timed.append((t, nov.rawimu(2300, t, row) if config else nov.rawimusx(2300, t, row)))
    for k, t in enumerate(g.t.tolist()):
        lat, lon = np.rad2deg(g.llh[k, :2])
        sigma, v = np.sqrt(np.diag(g.cov_r_n[k])), g.v_n[k]
        own = nov.bestpos(2300, t, lat, lon, g.llh[k, 2], 47.0, sigma, kind=54 if k == 3 else 50, status=k == 5)
        made = [nov.heading2(2300, t, 10.0 * k, 0.5), own]
        if k not in lost:
            track = np.rad2deg(np.arctan2(v[1], v[0])) % 360.0
            made.append(nov.bestvel(2300, t, latency, np.hypot(v[0], v[1]), track, -v[2], kind=54 if k == 7 else 50))
        timed += [(t + 0.03, message) for message in made]
    return [message for _, message in sorted(timed, key=lambda pair: pair[0])]


def same_fixes_with_gaps(messages, gnss):
    """A velocity that is missing is none of a message, and one of 1000 m/s 1-sigma in a series."""
    there = gnss.cov_v_n[:, 0, 0] < 1e5
    assert [m.v_n is not None for m in messages] == there.tolist()
    same = {name: [getattr(m, name) for m in messages] for name in ("t", "llh", "cov_r_n")}
    for name, values in same.items():
        np.testing.assert_array_equal(values, getattr(gnss, name))
    for name in ("v_n", "cov_v_n"):
        np.testing.assert_array_equal(
            [getattr(m, name) for m in messages if m.v_n is not None], getattr(gnss, name)[there]
        )


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("made", "options"),
    [
        ({}, {}),
        ({"latency": 0.15}, {"streams": "heading=HEADING2", "offset": 0.25}),
        ({"config": True, "lost": (4, 8)}, {"axes": "FRD"}),
        ({"latency": 0.15, "lost": (6,)}, {"series": "gnss"}),
        ({"config": True, "lost": range(12)}, {"scale": "accel=1e-6,gyro=1e-8", "streams": "gnss=BESTPOS"}),
    ],
)
def test_novatel_in_pieces_is_the_novatel_of_the_file(tmp_path, made, options, seed):
    frames = novatel_log(**made)
    data = GARBAGE + b"".join(frames[:151]) + frames[151][:30] + b"\xaa\x44\x13" + b"".join(frames[152:])
    (tmp_path / "span.gps").write_bytes(data)
    hints = ReadHints.of(**options)
    log, clock = read(tmp_path / "span.gps", hints, allow="norm,magnitude"), SourceClock()
    stream = decoder(clock, hints, format="novatel")
    messages = fed(stream, data, seed, 2000)
    assert clock.base == log.metadata.time
    fixes = [m for m in messages if isinstance(m, Fix)]
    if log.gnss.v_n is None:
        assert all(m.v_n is None for m in fixes)
        np.testing.assert_array_equal([m.llh for m in fixes], log.gnss.llh)
    else:
        same_fixes_with_gaps(fixes, log.gnss)
    assert stream.left_out["epochs of BESTPOS without a solution of GNSS alone"] == 1 + ("gnss=" not in str(options))
    assert stream.left_out["bytes that belong to no message with a right checksum"] == len(GARBAGE) + 33
    if "series" not in options:
        assert stream.kind == "increment"
        same_samples([m for m in messages if isinstance(m, ImuBlock)], log.imu)
    headings = [(m.t, m.value, m.sigma) for m in messages if isinstance(m, Heading)]
    assert len(headings) == (0 if log.heading is None else len(log.heading))
    if log.heading is not None:
        np.testing.assert_array_equal(headings, np.column_stack((log.heading.t, log.heading.value, log.heading.sigma)))


def test_the_position_of_novatel_that_is_preferred_is_taken():
    """BESTPOS of a SPAN receiver may be of its INS; BESTGNSSPOS beside it never is."""
    stream = decoder(SourceClock(), ReadHints())
    messages = []
    for k in range(4):
        both = [nov.bestpos(2300, k, 48.0, 11.0 + number / 1e4, 500.0, 47.0, (1, 1, 2), number=number)
                for number in (42, 1429)]  # fmt: skip
        messages += stream.feed(b"".join(both), 0.0) + stream.pause()
    assert [m.t for m in messages] == [0, 1, 2, 3]
    np.testing.assert_allclose([np.rad2deg(m.llh[1]) for m in messages], 11.1429, rtol=1e-15)


def test_counts_of_novatel_that_cannot_be_navigated_are_left_out():
    """Not announced, of no known IMU, and thinned out: the same reasons as for a log, and the fixes go on."""
    frames = [nov.rawimusx(2300, 0.008 * k, (0, 0, 9, 0, 0, 0)) for k in range(50)]
    decoded = decoder(SourceClock(), ReadHints())
    assert fed(decoded, b"".join(frames)) == []
    assert decoded.left_out["samples of an IMU, which are increments (say format=novatel)"] == 50
    for data, phrase in (
        (b"".join(nov.rawimu(2300, 0.008 * k, (0, 0, 9, 0, 0, 0)) for k in range(50)), "does not say which IMU"),
        (b"".join(frames[::2]), "increments in between were not logged"),
        (b"".join(nov.rawimusx(2300, 0.008 * k, (0,) * 6, imu=200) for k in range(50)), "are not in our table"),
    ):
        stream = decoder(SourceClock(), ReadHints(), format="novatel")
        assert fed(stream, data) == []
        assert any(phrase in reason for reason in stream.left_out)
    with pytest.raises(InputError, match="is no IMU whose counts are known"):
        decoder(SourceClock(), ReadHints.of(scale="STIM3000"), format="novatel")


@pytest.mark.parametrize(("name", "made"), [("vectornav", vectornav_log), ("sbf", sbf_log), ("novatel", novatel_log)])
def test_measurements_of_a_long_piece_come_before_the_sample_of_their_time(name, made):
    """Seconds of fixes before any sample would make another start than the log does."""
    stream = decoder(SourceClock(), ReadHints(), format=name)
    messages = stream.feed(b"".join(made()), 0.0) + stream.finish()
    newest, waiting = -np.inf, []
    for message in messages:
        if isinstance(message, ImuBlock):
            assert all(newest < t <= message.t[0] for t in waiting)
            newest, waiting = message.t[-1], []
        else:
            waiting.append(message.t)
    assert sum(isinstance(m, ImuBlock) for m in messages) > 5


def any_vectornav(rng):
    """A packet with right checksum and any contents: of four kinds of fields, so that kinds come again."""
    names = (
        ("TimeGps", "UncompAccel", "UncompGyro", "Temp"), ("GpsTow", "GpsWeek", "Fix", "FixLla", "FixVel", "FixPosU"),
        ("TimeGps", "Fix", "FixLla", "FixVel", "FixPosU", "FixVelU"), ("TimeGps", "DeltaTheta", "DeltaVel"),
    )[rng.integers(0, 4)]  # fmt: skip
    values = {}
    for name in names:
        size = struct.calcsize(vn.FIELDS[name][2])
        values[name] = struct.unpack(vn.FIELDS[name][2], any_bytes(rng, size))
    if rng.integers(0, 2) and "Fix" in values:
        values["Fix"] = 3
    if rng.integers(0, 2):
        values |= {"TimeGps": 2300 * 604_800 * 10**9 + int(rng.integers(0, 10**12))}
    return vn.packet(**values)


def any_sbf(rng):
    """A block with a right CRC and any contents."""
    number = int(rng.choice([4007, 5906, 5908, 5938, 5939, 4050, 4226, 5914]))
    return sbf.block(number, int(rng.choice([0, 2300, 65535])), int(rng.choice([1000, 2000, 3000, 2**32 - 1])),
                     bytes((4, 0)) * int(rng.integers(0, 2)) + any_bytes(rng, int(rng.integers(2, 140))))  # fmt: skip


def any_novatel(rng):
    """A message with a right CRC and any contents, in either header."""
    number = int(rng.choice([1462, 268, 42, 1429, 99, 1430, 1335, 1945, 508]))
    week, ms = int(rng.choice([0, 2300, 65535])), int(rng.choice([1000, 2000, 3000, 2**32 - 1]))
    body = bytes(4 * int(rng.integers(0, 3))) + any_bytes(rng, int(rng.integers(2, 140)))
    return (nov.short_frame if rng.integers(0, 2) else nov.long_frame)(number, week, ms, body)


def any_bytes(rng, size):
    """Numbers that break decoders: none, infinite, the largest, zero."""
    kinds = [struct.pack("<d", v) for v in (0.0, 1.0, np.nan, np.inf, -np.inf, 1e300, -2e10, 48.0)]
    kinds += [b"\xff" * 8, struct.pack("<ff", np.nan, 3e38), struct.pack("<ff", 1.0, -2e10), rng.bytes(8)]
    return b"".join(kinds[k] for k in rng.integers(0, len(kinds), size // 8 + 1))[:size]


@pytest.mark.parametrize(
    ("name", "message"), [("vectornav", any_vectornav), ("sbf", any_sbf), ("novatel", any_novatel)]
)
def test_messages_with_any_contents_raise_nothing(name, message):
    """Whole messages of any contents, some of them damaged, in pieces of any length."""
    rng = np.random.default_rng(11)
    for seed in range(20):
        made = [message(rng) for _ in range(60)]
        made += [m[: rng.integers(1, len(m))] for m in made[:10]] + [bytes(rng.permutation(np.frombuffer(m, "u1")))
                                                                   for m in made[10:20]]  # fmt: skip
        data = b"".join(made[k] for k in rng.permutation(len(made)))
        stream = decoder(SourceClock(), ReadHints(), format=name)
        fed(stream, data, seed)
        assert stream.left_out["bytes that belong to no message with a right checksum"] > 0
