"""u-blox logs: frames among garbage, raw measurements, solutions, navigation messages; and a real log against RTKLIB.

Frames are packed here with struct from the tables of the interface description, not by the library that decodes them.
"""

import struct
from pathlib import Path

import numpy as np
import pytest
from navigation_messages import lnav_words, pack

from schuler.exceptions import FileFormatError, InputError
from schuler.gnss import messages_gps
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS, satellite, satellite_name
from schuler.recording.formats import ubx
from schuler.recording.formats.ubx import find_frames, looks_like_ubx, read_ubx, read_ubx_recording
from schuler.recording.formats.ubx_messages import SIGNAL_OF_SIG_ID, satellite_of
from schuler.recording.io import ReadHints, read

pytest.importorskip("pyubx2")

WEEK = 604_800.0
L1 = SPEED_OF_LIGHT / 1575.42e6
GGA = b"$GNGGA,173021.75,4005.8014957,N,10508.8299894,W,4,12,0.62,1601.435,M,-21.387,M,0.8,0000*45\r\n"


def frame(kind: int, payload: bytes) -> bytes:
    body = struct.pack(">H", kind) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes((a, b))


def measurement(gnss=0, sv=5, sig=0, *, pr=2.2e7, cp=1.1e8, do=1000.0, freq=0, cno=45, pr_std=3, do_std=5, stat=0b111):
    return struct.pack(
        "<ddfBBBBHBBBBBB", pr, cp, do, gnss, sv, sig, freq, 64_500, cno, pr_std, 1, do_std, stat, 0
    )  # fmt: skip


def rawx(tow: float, *rows: bytes, week=2381, leap=18, status=1) -> bytes:
    head = struct.pack("<dHbBBB2x", tow, week, leap, len(rows), status, 1)
    return frame(0x0215, head + b"".join(rows))


def pvt(
    itow=408_640_000, when=(2025, 8, 28, 17, 30, 22), nano=0, valid=7, fix=3, flags=1, flags3=0, h_acc=900, v_acc=1400,
    s_acc=120, lat=400_966_916, lon=-1_051_471_665, height=1_580_048, velocity=(120, -250, 30), n=25,
) -> bytes:  # fmt: skip
    payload = struct.pack(
        "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHHIihH", itow, *when, valid, 21, nano, fix, flags, 0xE0, n, lon, lat, height,
        height + 21_000, h_acc, v_acc, *velocity, 0, 0, s_acc, 0, 114, flags3, 0, 0, 0, 0,
    )  # fmt: skip
    assert len(payload) == 92
    return frame(0x0107, payload)


def sfrbx(gnss: int, sv: int, sig: int, words: list[int], freq=0) -> bytes:
    head = struct.pack("<BBBBBBBB", gnss, sv, sig, freq, len(words), 0, 2, 0)
    return frame(0x0213, head + struct.pack(f"<{len(words)}I", *words))


@pytest.fixture
def log(tmp_path: Path):
    def write(*pieces: bytes, name: str = "rover.ubx") -> Path:
        path = tmp_path / name
        path.write_bytes(b"".join(pieces))
        return path

    return write


# ------------------------------------------------------------------------------------------------- frames


def test_frames_are_found_among_sentences_and_garbage():
    a, b, c = frame(0x0107, b"abc"), frame(0x0A04, b""), frame(0x0215, bytes(300))
    damaged = bytearray(a)
    damaged[7] ^= 1
    data = b"\x00\xb5" + a + GGA + bytes(damaged) + b + b"\xb5\x62\x01\x07\xff\xff" + c + GGA + GGA + c[:40]
    listed = find_frames(data)
    assert [(k, data[i:j]) for k, i, j in listed.spans] == [(0x0107, a), (0x0A04, b), (0x0215, c)]
    assert (listed.failed, listed.truncated, listed.sentences) == (1, True, 3)
    assert listed.strange == 2 + len(damaged) + 6
    assert find_frames(b"").spans == []
    assert not find_frames(a).truncated
    assert find_frames(a[:-1]).truncated


def test_a_wrong_length_loses_only_its_own_frame():
    good = [frame(0x0107, bytes([k]) * 92) for k in range(5)]
    broken = bytearray(good[1])
    broken[5] = 0x7F  # claims 32 kB
    listed = find_frames(good[0] + bytes(broken) + b"".join(good[2:]))
    assert len(listed.spans) == 4
    broken[4:6] = b"\xc0\x00"  # claims the two frames behind it as well
    listed = find_frames(good[0] + bytes(broken) + b"".join(good[2:]))
    assert (len(listed.spans), listed.failed) == (4, 1)


# ------------------------------------------------------------------------------------------- measurements


def test_measurements_flags_and_signs(log):
    rows = [
        measurement(0, 5, 0, pr=2.1e7, cp=1.1e8, do=1000.0, pr_std=3, do_std=5),
        measurement(0, 5, 7, do=-500.0, stat=0b010),  # no pseudorange, half a cycle open
        measurement(2, 33, 1, stat=0b001),  # no carrier
        measurement(6, 9, 0, do=100.0, freq=3),  # channel -4
        measurement(3, 21, 7),
        measurement(1, 133, 0),
    ]
    r = read_ubx(log(rawx(408_639.748, *rows)))
    o = r.observations
    assert [satellite_name(s) for s in o.sat] == ["G05", "G05", "E33", "R09", "C21", "S33"]
    assert [o.signals[k] for k in o.signal] == ["1C", "5Q", "1B", "1C", "5P", "1C"]
    assert o.t.tolist() == [408_639.748] * 6
    assert o.epoch_gps_s == r.time.epoch_gps_s == 2381 * WEEK
    # positive Doppler: approaching, so the range shrinks
    assert o.range_rate[0] == -1000.0 * L1
    assert o.range_rate[1] == pytest.approx(500.0 * SPEED_OF_LIGHT / 1176.45e6, rel=1e-15)  # rounding
    assert o.range_rate[3] == pytest.approx(-100.0 * SPEED_OF_LIGHT / (1602e6 - 4 * 562_500.0), rel=1e-15)  # rounding
    assert np.isnan(o.pseudorange).tolist() == [False, True, False, False, False, False]
    assert np.isnan(o.carrier).tolist() == [False, False, True, False, False, False]
    assert (o.pseudorange[0], o.carrier[0], o.cn0[0]) == (2.1e7, 1.1e8, 45.0)
    assert o.glonass_channels == {satellite("R09"): -4}
    assert r.sigma_range[0] == 0.08
    assert r.sigma_rate[0] == pytest.approx(0.064 * L1, rel=1e-15)  # rounding
    assert r.leap_seconds == 18
    assert any(note.startswith("1 measurements come without a valid pseudorange") for note in r.notes)
    assert any(note.startswith("1 carrier phases may be half a cycle off") for note in r.notes)


def test_epochs_without_time_or_out_of_order_are_counted(log):
    m = measurement()
    path = log(
        rawx(10.0, m, week=0), rawx(604_799.75, m, status=0), rawx(0.25, m, week=2382, leap=0, status=2), rawx(0.25, m),
        rawx(0.25, m, week=2382), rawx(0.5, week=2382), rawx(0.75, m, m[:20] + b"\x00\x06" + m[22:], week=2382),
    )  # fmt: skip
    r = read_ubx(path)
    assert r.observations.t.tolist() == [604_799.75, 604_800.25, 604_800.75, 604_800.75]  # through the end of the week
    assert r.leap_seconds == 18
    notes = " ".join(r.notes)
    assert "2 epochs without measurements or before the receiver knew the time" in notes
    assert "2 epochs not later than the one before" in notes
    assert "1 times the receiver's clock was reset" in notes


def test_leap_seconds_not_yet_known(log):
    assert read_ubx(log(rawx(1.0, measurement(), leap=16, status=0))).leap_seconds is None


def test_satellites_and_signals_without_a_name_are_counted(log):
    rows = [measurement(), measurement(6, 255, 0, freq=7), measurement(0, 5, 9), measurement(4, 1, 0)]
    r = read_ubx(log(rawx(1.0, *rows)))
    assert len(r.observations) == 1
    assert any("GLONASS satellite 255 (1), GPS signal 9 (1), gnssId 4 signal 0 (1)" in note for note in r.notes)


def test_a_satellite_without_a_name_does_not_spoil_a_log_of_other_bands(log):
    """Of BeiDou alone: the row that is left out has no wavelength, and needs none."""
    r = read_ubx(log(rawx(1.0, measurement(3, 20, 0), measurement(3, 255, 0), measurement(3, 20, 99))))
    assert (len(r.observations), r.observations.signals) == (1, ("2I",))
    assert any("BeiDou satellite 255 (1), BeiDou signal 99 (1)" in note for note in r.notes)


def test_the_table_of_signals():
    assert satellite_of(5, 3) == satellite("J03")
    assert satellite_of(1, 120) == satellite("S20")
    assert satellite_of(6, 255) is satellite_of(4, 1) is satellite_of(1, 87) is None
    assert {gnss for gnss, _ in SIGNAL_OF_SIG_ID} == {0, 1, 2, 3, 5, 6, 7}


# ---------------------------------------------------------------------------------------------- solutions


def test_a_solution_in_si_on_gps_time(log):
    gnss = read_ubx(log(pvt())).gnss
    assert gnss.t.tolist() == [408_640.0]
    np.testing.assert_allclose(gnss.llh[0], (*np.deg2rad((40.0966916, -105.1471665)), 1580.048), rtol=1e-15)  # rounding
    assert gnss.v_n[0].tolist() == [0.12, -0.25, 0.03]
    np.testing.assert_allclose(np.diag(gnss.cov_r_n[0]), (0.81, 0.81, 1.96), rtol=1e-14)  # rounding
    np.testing.assert_allclose(gnss.cov_v_n[0], np.eye(3) * 0.12**2, rtol=1e-14)  # rounding
    assert (gnss.quality[0], gnss.n_satellites[0]) == (5, 25)


def nav_dop(itow: int, horizontal: int, vertical: int) -> bytes:
    """In hundredths: geometric, position, time, vertical, horizontal, northing, easting (UBX-22008968, 3.15.5)."""
    return frame(0x0104, struct.pack("<I7H", itow, 321, 234, 111, vertical, horizontal, 77, 88))


def test_dilutions_of_nav_dop_go_to_the_solution_of_their_time(log):
    """In whatever order they come; without one, and where it says 99.99, they are not known."""
    seconds = [{"itow": 408_640_000 + 1000 * k, "when": (2025, 8, 28, 17, 30, 22 + k)} for k in range(4)]
    path = log(
        nav_dop(408_640_000, 85, 143), pvt(**seconds[0]), pvt(**seconds[1]), pvt(**seconds[2]),
        nav_dop(408_642_000, 9999, 151), pvt(**seconds[3]), nav_dop(408_643_000, 64, 9999), nav_dop(408_649_000, 1, 1),
        frame(0x0104, bytes(17)),
    )  # fmt: skip
    log_ = read_ubx(path)
    nan = np.nan
    np.testing.assert_allclose(log_.gnss.dop, [[0.85, 1.43], [nan, nan], [nan, 1.51], [0.64, nan]], rtol=1e-15)
    assert "1 frames were not of the length their contents call for and were left out." in log_.notes
    assert read_ubx(log(pvt())).gnss.dop is None
    with pytest.raises(FileFormatError, match="found 1 frames of other kinds"):
        read_ubx(log(nav_dop(408_640_000, 85, 143)))


def test_times_carry_nanoseconds_and_need_no_table_of_leap_seconds(log):
    # UTC of the epoch is a little before the second; time of week is rounded
    gnss = read_ubx(log(pvt(nano=-450_000), pvt(itow=408_640_250, nano=249_550_000))).gnss
    np.testing.assert_allclose(gnss.t, (408_639.99955, 408_640.24955), rtol=0.0, atol=1e-9)  # rounding
    # the last second of a week, and a leap second (2016-12-31 23:59:60 UTC is 17 s before GPS midnight plus 17)
    end = read_ubx(log(pvt(itow=5_000, when=(2025, 8, 30, 23, 59, 47)))).gnss
    assert (
        end.t[0] + read_ubx(log(pvt(itow=5_000, when=(2025, 8, 30, 23, 59, 47)))).time.epoch_gps_s == 2382 * WEEK + 5.0
    )
    leap = read_ubx(log(pvt(itow=17_000, when=(2016, 12, 31, 23, 59, 60))))
    assert leap.time.epoch_gps_s + leap.gnss.t[0] == 1930 * WEEK + 17.0


@pytest.mark.parametrize(
    ("change", "note"),
    [
        ({"fix": 0}, "1 epochs without a fix"),
        ({"fix": 5}, "1 epochs without a fix"),
        ({"flags": 0}, "1 epochs without a fix"),
        ({"flags3": 1}, "1 epochs without a fix"),
        ({"valid": 1}, "1 epochs before the receiver knew the date"),
        ({"when": (2025, 2, 30, 17, 30, 22)}, "1 epochs before the receiver knew the date"),
        ({"itow": 12_000_000}, "1 epochs before the receiver knew the date"),  # contradicts the date
        ({"h_acc": 0}, "1 epochs without an accuracy"),
        ({"v_acc": 2**32 - 1}, "1 epochs without an accuracy"),
        ({"itow": 408_639_000, "when": (2025, 8, 28, 17, 30, 21)}, "1 epochs not later than"),
    ],
)
def test_epochs_left_out_are_counted(log, change, note):
    r = read_ubx(log(pvt(), pvt(**change)))
    assert len(r.gnss) == 1
    assert any(note in text for text in r.notes)


def test_kinds_of_fix(log):
    second = [(2025, 8, 28, 17, 30, 22 + k) for k in range(5)]
    itow = [408_640_000 + 1000 * k for k in range(5)]
    flags = [(3, 0b1), (3, 0b11), (3, 0b1000_0011), (3, 0b0100_0011), (4, 0b1)]
    r = read_ubx(log(*(pvt(i, s, fix=f, flags=g) for i, s, (f, g) in zip(itow, second, flags, strict=True))))
    assert r.gnss.quality.tolist() == [5, 4, 1, 2, 7]


def test_the_height_of_a_two_dimensional_fix_is_not_believed(log):
    r = read_ubx(log(pvt(fix=2)))
    assert np.sqrt(np.diag(r.gnss.cov_r_n[0])) == pytest.approx((0.9, 0.9, 100.0), rel=1e-14)  # rounding
    assert any("1 fixes are two-dimensional" in note for note in r.notes)


# ----------------------------------------------------------------------------------- navigation messages


def subframes() -> list[list[int]]:
    tables = {
        1: {"week": 2381 % 1024, "issue": 9, "toc": 410_400.0, "af0": 2.0**-20},
        2: {"issue": 9, "toe": 410_400.0, "sqrt_a": 5153.5, "e": 0.0078125},
        3: {"issue": 9, "crc": 100.0},
    }
    words = []
    for number, table in tables.items():
        head, _ = pack({"preamble": 0x8B, "tow": 408_630.0 + 6.0 * number, "id": number}, messages_gps._HEAD)
        message = head << 192 | pack(table, messages_gps._SUBFRAMES[number])[0]
        words.append(lnav_words([message >> 24 * k & 0xFFFFFF for k in range(9, -1, -1)]))
    return words


def test_subframes_take_the_week_of_the_message_before(log):
    words = subframes()
    r = read_ubx(
        log(sfrbx(0, 10, 0, words[0]), rawx(408_650.0, measurement()), *(sfrbx(0, 10, 0, w) for w in words[1:]))
    )
    assert r.ephemerides.kepler.sat.tolist() == [10]
    assert r.ephemerides.kepler.toe[0] == 2381 * WEEK + 410_400.0
    # a solution gives the week as well
    assert len(read_ubx(log(pvt(), *(sfrbx(0, 10, 0, w) for w in words))).ephemerides.kepler) == 1


def test_messages_of_other_kinds_are_counted(log):
    words = subframes()[0]
    r = read_ubx(
        log(
            pvt(), sfrbx(0, 10, 4, words), sfrbx(2, 3, 3, words[:8]), sfrbx(3, 3, 1, words), sfrbx(1, 133, 0, words[:8])
        )
    )
    assert len(r.ephemerides.kepler) == 0
    (note,) = (n for n in r.notes if "kinds that are not decoded" in n)
    assert note.endswith("BeiDou 2I (1), GPS 2S (1), Galileo 5I (1), SBAS 1C (1).")


def test_subframes_without_any_time_are_refused(log):
    with pytest.raises(FileFormatError, match="no message of the log says the time"):
        read_ubx(log(*(sfrbx(0, 10, 0, w) for w in subframes())))


# ------------------------------------------------------------------------------------------ wrong files


def test_what_is_no_log_of_u_blox(log):
    with pytest.raises(FileFormatError, match=r"found 0 frames of other kinds and 2 NMEA sentences.*read it as NMEA"):
        read_ubx(log(GGA, GGA))
    with pytest.raises(FileFormatError, match="found 1 frames of other kinds"):
        read_ubx(log(frame(0x0A04, b"x" * 40)))
    with pytest.raises(FileFormatError, match="empty"):
        read_ubx(log(b""))


def test_a_frame_whose_counter_contradicts_its_length_is_counted(log):
    bad = frame(0x0215, struct.pack("<dHbBBB2x", 2.0, 2381, 18, 9, 1, 1) + measurement())
    r = read_ubx(log(rawx(1.0, measurement()), bad))
    assert len(r.observations) == 1
    assert any("1 frames were not of the length" in note for note in r.notes)


def test_the_log_as_a_recording(log):
    path = log(rawx(408_639.998, measurement()), pvt())
    recording = read_ubx_recording(path, ReadHints(name="walk"))
    assert recording.metadata.name == "walk"
    assert recording.gnss.t.tolist() == [408_640.0]
    with pytest.raises(InputError, match="says this itself; leave out units"):
        read_ubx_recording(path, ReadHints(units="g,deg/s"))
    assert len(recording.observations) == 1
    assert recording.ephemerides is None
    with pytest.raises(InputError, match="leave out offset"):
        read_ubx_recording(path, ReadHints(offset=0.1))
    # a recording of raw measurements alone, and with what was broadcast
    words = [sfrbx(0, 10, 0, w) for w in subframes()]
    raw = read_ubx_recording(log(rawx(408_650.0, measurement()), *words), ReadHints())
    assert raw.gnss is None
    assert len(raw.ephemerides.kepler) == 1


def test_logs_are_recognised_by_their_first_frame():
    assert looks_like_ubx(GGA + pvt())
    assert not looks_like_ubx(GGA)


# --------------------------------------------------------------------------------------------- real log


@pytest.fixture(scope="module")
def walk(shared_data):
    return read_ubx(shared_data / "rtkexp_walk" / "gnss_1730.ubx")


def rinex_observations(path: Path) -> dict[tuple[float, str, str], float]:
    """Values of a RINEX 3 file by time of week, satellite and code; 14 digits and two flags each."""
    codes: dict[str, list[str]] = {}
    values = {}
    lines = iter(path.read_text().splitlines())
    for line in lines:
        if line[60:].startswith("SYS / # / OBS TYPES"):
            codes[line[0]] = line[7:58].split()
        if line[60:].startswith("END OF HEADER"):
            break
    for line in lines:
        if line.startswith(">"):
            day, hour, minute, second = int(line[10:12]), int(line[13:15]), int(line[16:18]), float(line[18:29])
            tow = ((day - 24) * 24 + hour) * 3600.0 + minute * 60.0 + second
            continue
        for k, code in enumerate(codes[line[0]]):
            text = line[3 + 16 * k : 17 + 16 * k].strip()
            if text:
                values[(round(tow, 3), line[:3], code)] = float(text)
    return values


@pytest.mark.campaign
@pytest.mark.realdata
def test_measurements_are_those_rtklib_converted(walk, shared_data):
    """RTKLIB prints 3 digits; it calls combined channels X and does not know all signals of this receiver."""
    o = walk.observations
    reference = rinex_observations(shared_data / "rtkexp_walk" / "gnss_1730.obs")
    assert len(o.epochs) == 536
    assert walk.leap_seconds == 18
    compared = 0
    worst = {"C": 0.0, "L": 0.0, "D": 0.0, "S": 0.0}
    rtklib_names = {"1C": "1C", "2L": "2X", "5Q": "5X", "6B": "6X", "5P": "5X", "6I": "6I"}
    for k in range(len(o)):
        name, signal = satellite_name(o.sat[k]), o.signals[o.signal[k]]
        code = "1X" if name[0] == "E" and signal == "1C" else rtklib_names.get(signal)
        if code is None:  # BeiDou B1C, which RTKLIB left out
            continue
        from schuler.gnss.signals import frequency_hz

        doppler = -o.range_rate[k] * frequency_hz(int(o.sat[k]), signal) / SPEED_OF_LIGHT
        for kind, value in (("C", o.pseudorange[k]), ("L", o.carrier[k]), ("D", doppler), ("S", o.cn0[k])):
            other = reference.get((round(o.t[k], 3), name, kind + code))
            if other is not None and np.isfinite(value):
                worst[kind] = max(worst[kind], abs(value - other))
                compared += 1
    assert compared > 0.99 * len(reference)
    assert worst["C"] < 6e-4  # printed digits
    assert worst["L"] < 6e-4
    assert worst["D"] < 6e-4
    assert worst["S"] == 0.0


def rinex_ephemerides(path: Path) -> list[tuple[str, list[float]]]:
    """Satellite and numbers of each GPS, Galileo and BeiDou record of a RINEX 3 file, the calendar as time of week."""
    lines = path.read_text().split("END OF HEADER")[1].splitlines()[1:]
    records = []
    k = 0
    while k < len(lines):
        name, n = lines[k][:3], 4 if lines[k][0] in "RS" else 8
        text = [lines[k][23:80]] + [line[4:80] for line in lines[k + 1 : k + n]]
        numbers = [float(t[i : i + 19].replace("D", "E") or "nan") for t in text for i in range(0, len(t.rstrip()), 19)]
        day, hour, minute, second = (int(lines[k][i : i + 2]) for i in (12, 15, 18, 21))
        if name[0] in "GEC":
            records.append((name, [((day - 24) * 24 + hour) * 3600.0 + minute * 60.0 + second, *numbers]))
        k += n
    return records


@pytest.mark.campaign
@pytest.mark.realdata
def test_ephemerides_are_those_rtklib_decoded(walk, shared_data):
    """GPS 4, Galileo 7, BeiDou 8, every number to RTKLIB's 12 printed digits."""
    kepler = walk.ephemerides.kepler
    counts = {letter: int(np.sum(kepler.sat // 100 == SYSTEMS.index(letter))) for letter in "GEC"}
    assert counts == {"G": 4, "E": 7, "C": 8}
    columns = ["toc", "af0", "af1", "af2", "issue", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "toe", "cic",
               "omega0", "cis", "i0", "crc", "omega", "omega_dot", "idot"]  # fmt: skip
    records = rinex_ephemerides(shared_data / "rtkexp_walk" / "gnss_1730.nav")
    whole, orbits = [], []
    for k in range(len(kepler)):
        name = satellite_name(kepler.sat[k])
        late = 14.0 if name[0] == "C" else 0.0
        mine = [getattr(kepler, c)[k] - ((2381 * WEEK + late) if c in ("toc", "toe") else 0.0) for c in columns]
        same = [r for s, r in records if s == name and r[0] == mine[0]]
        # I/NAV and F/NAV of Galileo share the orbit but not the clock; the data source word tells them apart
        inav = [r for r in same if name[0] != "E" or int(r[21]) == kepler.source[k]]
        reference = (inav or same)[0]
        if name[0] == "C":  # RTKLIB makes an issue of its own out of toc; AODE is not in its file
            mine[4] = reference[4]
        first = 0 if inav else 4
        # printed digits: 12, of which the first may be a 1
        np.testing.assert_allclose(mine[first:], reference[first:21], rtol=6e-12, err_msg=name)
        if not inav:
            orbits.append(name)
            continue
        delays = reference[26:28] if name[0] != "G" else reference[26:27]
        np.testing.assert_allclose(kepler.group_delay[k][: len(delays)], delays, rtol=6e-12, atol=1e-22, err_msg=name)
        assert kepler.health[k] == int(reference[25]), name
        whole.append(name)
    # of two satellites RTKLIB did not put the words of I/NAV together
    assert (len(whole), orbits) == (17, ["E08", "E14"])
    # the header's ionosphere line, four digits
    np.testing.assert_allclose(walk.ephemerides.galileo_ai, (159.2, -0.04688, 0.01895), rtol=5e-4)


@pytest.mark.realdata
def test_the_log_is_whole(walk, shared_data):
    frames = find_frames((shared_data / "rtkexp_walk" / "gnss_1730.ubx").read_bytes())
    assert (frames.failed, frames.truncated, frames.strange) == (0, False, 0)
    assert frames.sentences == 4 * 536 - 134
    assert {k: len(frames.of(k)) for k in (0x0215, 0x0213, 0x0107)} == {0x0215: 536, 0x0213: 2328, 0x0107: 536}
    assert not any("wrong parity" in note or "wrong check" in note for note in walk.notes)
    # a receiver that is corrected by RTK: RTKLIB's own solution is within decimetres, heights above sea level
    assert set(walk.gnss.quality.tolist()) <= {1, 2, 4}
    assert np.all(np.diff(walk.gnss.t) == pytest.approx(0.25, abs=1e-4))


def test_a_large_file_of_something_else_is_not_read_to_its_end(tmp_path, monkeypatch):
    """Two gigabytes took 6.4 GB and a minute."""
    path = tmp_path / "x.ubx"
    path.write_bytes(np.random.default_rng(1).bytes(200_000))
    monkeypatch.setattr(ubx, "_LATEST", 100_000)
    monkeypatch.setattr(Path, "read_bytes", None)
    with pytest.raises(FileFormatError, match="found none in the first"):
        read_ubx(path)


@pytest.mark.parametrize("byte", [b"\x00", b"\xff"])
@pytest.mark.parametrize("suffix", [".ubx", ".rtcm3", ".csv", ".mat"])
def test_a_file_that_was_never_written_is_refused_by_its_beginning(tmp_path, byte, suffix):
    path = tmp_path / f"x{suffix}"
    path.write_bytes(byte * 70_000)
    with pytest.raises(FileFormatError, match="its first 64 KiB are all the byte 0x"):
        read(path)
