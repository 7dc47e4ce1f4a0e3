"""NMEA logs: heights, accuracies, dates and midnight, checksums, velocities; and the sentences of a real log."""

from pathlib import Path

import numpy as np
import pytest

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.nmea import RANGE_ERROR, looks_like_nmea, read_nmea
from schuler.recording.io import ReadHints
from schuler.timebase import LeapSecondWarning

pytest.importorskip("pynmeagps")

WEEK = 604_800.0


def sentence(body: str) -> str:
    checksum = 0
    for character in body.encode():
        checksum ^= character
    return f"${body}*{checksum:02X}\r\n"


def gga(time="173021.75", quality=1, hdop="0.8", alt="1601.435", sep="-21.387", lat="4005.8014957", n=12):
    return sentence(f"GNGGA,{time},{lat},N,10508.8299894,W,{quality},{n:02d},{hdop},{alt},M,{sep},M,,")


def rmc(time="173021.75", date="280825", status="A", speed="10.0", course="90.0"):
    return sentence(f"GNRMC,{time},{status},4005.8014957,N,10508.8299894,W,{speed},{course},{date},,,A,V")


def gst(time="173021.75", lat="1.2", lon="0.9", alt="2.5"):
    return sentence(f"GNGST,{time},5.0,1.3,0.8,45.0,{lat},{lon},{alt}")


def vtg(course="90.0", speed="18.52"):
    return sentence(f"GNVTG,{course},T,,M,10.0,N,{speed},K,A")


def gsa(vdop="1.9"):
    return sentence(f"GNGSA,A,3,10,18,23,27,32,,,,,,,,2.1,0.8,{vdop},1")


@pytest.fixture
def log(tmp_path: Path):
    def write(*pieces: str | bytes) -> Path:
        path = tmp_path / "rover.nmea"
        path.write_bytes(b"".join(p.encode() if isinstance(p, str) else p for p in pieces))
        return path

    return write


def sigmas(recording):
    return np.sqrt(np.einsum("nii->ni", recording.gnss.cov_r_n))


def test_a_position_in_si_with_an_ellipsoidal_height(log):
    r = read_nmea(log(rmc(), gga()))
    expected = np.deg2rad((40 + 5.8014957 / 60, -(105 + 8.8299894 / 60)))
    np.testing.assert_allclose(r.gnss.llh[0, :2], expected, rtol=0, atol=2e-11)  # the library's 10 decimals of a degree
    assert r.gnss.llh[0, 2] == 1601.435 - 21.387
    # 17:30:21.75 UTC of a Thursday, 18 leap seconds
    assert r.metadata.time.epoch_gps_s == 2381 * WEEK
    assert r.gnss.t[0] == pytest.approx(4 * 86_400 + 17 * 3600 + 30 * 60 + 21.75 + 18.0, abs=1e-9)  # rounding
    assert (r.gnss.quality[0], r.gnss.n_satellites[0]) == (5, 12)
    np.testing.assert_allclose(r.gnss.v_n[0], (0.0, 10.0 * units.KNOT, 0.0), atol=1e-15)  # rounding of the course


def test_accuracies_come_from_gst(log):
    r = read_nmea(log(rmc(), gga(), gst()))
    np.testing.assert_allclose(sigmas(r), [[1.2, 0.9, 2.5]], rtol=1e-15)  # rounding
    assert not any("rule of thumb" in note for note in r.metadata.notes)


def test_without_gst_they_are_a_rule_of_thumb_and_say_so(log):
    r = read_nmea(log(rmc(), gga(hdop="0.8"), gsa("1.9")))
    h = RANGE_ERROR[1] * 0.8 / np.sqrt(2.0)
    np.testing.assert_allclose(sigmas(r), [[h, h, RANGE_ERROR[1] * 1.9]], rtol=1e-14)  # rounding
    assert any("1 epochs have no GST" in note and "rule of thumb" in note for note in r.metadata.notes)
    no_gsa = read_nmea(log(rmc(), gga(quality=4)))
    np.testing.assert_allclose(sigmas(no_gsa)[0, 2], RANGE_ERROR[4] * 0.8 * 1.5, rtol=1e-14)
    # a GST of zero says nothing
    np.testing.assert_allclose(sigmas(read_nmea(log(rmc(), gga(), gst(lat="0.0"))))[0, 0], h, rtol=1e-14)


def test_dilutions_are_those_stated_not_those_guessed(log):
    """HDOP of GGA, VDOP of GSA; an epoch without GSA has no VDOP, 99.99 and an empty field are none."""
    pieces = [rmc(), gga(hdop="0.8"), gsa("1.9"), gga("173022.00"), gga("173023.00", hdop="99.99"), gsa("99.99")]
    np.testing.assert_array_equal(read_nmea(log(*pieces)).gnss.dop, [[0.8, 1.9], [0.8, np.nan], [np.nan, np.nan]])
    assert read_nmea(log(rmc(), gga(hdop="")), ReadHints(sigma="3,3,6")).gnss.dop is None


def test_the_hint_sigma_replaces_the_rule_but_not_gst(log):
    hints = ReadHints(sigma="3,3,6,0.2,0.2,0.4")
    r = read_nmea(log(rmc(), gga(), rmc("173022.00"), gga("173022.00"), gst("173022.00")), hints)
    np.testing.assert_allclose(sigmas(r), [[3, 3, 6], [1.2, 0.9, 2.5]], rtol=1e-15)  # rounding
    np.testing.assert_allclose(np.sqrt(np.diag(r.gnss.cov_v_n[0])), (0.2, 0.2, 0.4), rtol=1e-15)


def test_an_epoch_with_no_accuracy_at_all_is_refused(log):
    with pytest.raises(FileFormatError, match=r"neither GST nor HDOP.*say sigma="):
        read_nmea(log(rmc(), gga(hdop="")))


def test_kinds_of_fix_and_epochs_without_one(log):
    pieces = [rmc()]
    for k, quality in enumerate((1, 2, 3, 4, 5, 6, 0, 7, 8)):
        pieces.append(gga(f"17302{k}.00", quality))
    r = read_nmea(log(*pieces))
    assert r.gnss.quality.tolist() == [5, 4, 5, 1, 2, 7]
    assert any("3 epochs without a fix" in note for note in r.metadata.notes)
    with pytest.raises(FileFormatError, match="none of the 1 GGA sentences has a fix"):
        read_nmea(log(rmc(), gga(quality=0)))


def test_midnight_is_crossed_by_the_nearest_date(log):
    pieces = [rmc("235958.00", "280825")] + [gga(t) for t in ("235958.00", "235959.00", "000000.00", "000001.00")]
    np.testing.assert_allclose(np.diff(read_nmea(log(*pieces)).gnss.t), 1.0, atol=1e-9)  # rounding
    # the date may also come only after midnight, or by ZDA
    pieces = [gga("235959.00"), gga("000000.00"), sentence("GNZDA,000000.00,29,08,2025,00,00")]
    r = read_nmea(log(*pieces))
    assert r.gnss.t[0] == pytest.approx(4 * 86_400 + 86_399 + 18, abs=1e-9)
    # a log of several days, with a gap
    pieces = [rmc("120000.00", "280825"), gga("120000.00"), rmc("110000.00", "300825"), gga("110000.00")]
    assert np.diff(read_nmea(log(*pieces)).gnss.t)[0] == pytest.approx(47 * 3600.0, abs=1e-9)


def test_a_log_without_a_date_is_refused(log):
    with pytest.raises(FileFormatError, match="GGA has no date: log RMC or ZDA too"):
        read_nmea(log(gga(), vtg()))


def test_heights_without_a_separation(log):
    path = log(rmc(), gga(sep=""))
    with pytest.raises(FileFormatError, match=r"without a geoid separation: say height='msl'"):
        read_nmea(path)
    r = read_nmea(path, ReadHints(height="msl", geoid_separation=-17.0))
    assert r.gnss.llh[0, 2] == 1601.435 - 17.0
    # a stated one goes before the receiver's
    assert read_nmea(log(rmc(), gga()), ReadHints(height="msl", geoid_separation=-17.0)).gnss.llh[0, 2] == 1584.435


def test_wrong_checksums_and_foreign_bytes(log):
    broken = gga("173022.00").replace("1601", "1701")
    r = read_nmea(log(b"\xb5\x62\x01\x07\x02\x00ab\x00\x00", rmc(), gga(), broken, b"\xff$GNGGA,17", gga("173023.00")))
    assert len(r.gnss) == 2
    assert any("1 sentences with a wrong checksum" in note for note in r.metadata.notes)


def test_repeated_epochs_are_counted(log):
    r = read_nmea(log(rmc(), gga(), rmc("173022.00"), gga("173022.00"), gga("173021.75"), gga("173023.00")))
    assert len(r.gnss) == 3
    assert any("1 epochs not later" in note for note in r.metadata.notes)


def test_velocity_from_vtg_and_epochs_without_one(log):
    r = read_nmea(
        log(rmc(status="V"), gga(), vtg("180.0", "36.0"), gga("173022.00"), rmc("173022.00", speed="", course=""))
    )
    np.testing.assert_allclose(r.gnss.v_n, [[-10.0, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-14)  # rounding
    assert np.sqrt(r.gnss.cov_v_n[0, 0, 0]) == pytest.approx(0.1, rel=1e-15)
    assert np.sqrt(r.gnss.cov_v_n[0, 2, 2]) == 10.0
    assert np.sqrt(r.gnss.cov_v_n[1, 0, 0]) == 1000.0
    assert any("1 epochs have no velocity" in note for note in r.metadata.notes)
    none = read_nmea(log(sentence("GNZDA,173021.75,28,08,2025,00,00"), gga()))
    assert none.gnss.v_n is None


def test_a_receiver_at_rest_gives_no_course(log):
    r = read_nmea(log(rmc(speed="0.3", course=""), gga()))
    assert r.gnss.v_n[0].tolist() == [0.0, 0.0, 0.0]
    # the speed may be in any direction
    assert r.gnss.cov_v_n[0, 0, 0] == pytest.approx(0.1**2 + (0.3 * units.KNOT) ** 2, rel=1e-14)  # rounding


def test_needless_hints_and_wrong_files(log):
    with pytest.raises(InputError, match="says this itself; leave out units"):
        read_nmea(log(rmc(), gga()), ReadHints(units="g,deg/s"))
    with pytest.raises(FileFormatError, match="found none with a right checksum"):
        read_nmea(log("t,ax,ay\n1,2,3\n"))
    with pytest.warns(LeapSecondWarning, match="leap seconds are known to"):
        read_nmea(log(rmc(date="280845"), gga()))
    assert looks_like_nmea(gga().encode())
    assert not looks_like_nmea(b"t,ax,ay\n")


@pytest.mark.campaign
@pytest.mark.realdata
def test_sentences_agree_with_the_binary_solution_of_the_same_log(shared_data):
    from schuler.frames import ecef_from_llh, ned_from_ecef
    from schuler.recording.formats.ubx import read_ubx_recording

    path = shared_data / "rtkexp_walk" / "gnss_1730.ubx"
    text, binary = read_nmea(path), read_ubx_recording(path, ReadHints())
    assert len(text.gnss) == len(binary.gnss) == 536
    # UTC in the sentences is rounded to 10 ms; the epochs are 0.46 ms before it
    np.testing.assert_allclose(text.gnss.t, binary.gnss.t, rtol=0, atol=6e-4)
    apart = ned_from_ecef(ecef_from_llh(text.gnss.llh), binary.gnss.llh[0]) - ned_from_ecef(
        ecef_from_llh(binary.gnss.llh), binary.gnss.llh[0]
    )
    assert np.abs(apart).max() < 0.012  # printed digits: NAV-PVT has 1e-7 deg
    # printed digits where there is a course; elsewhere the 1-sigma holds the speed
    moving = np.any(text.gnss.v_n != 0.0, axis=1)
    assert moving.sum() > 300
    np.testing.assert_allclose(text.gnss.v_n[moving, :2], binary.gnss.v_n[moving, :2], rtol=0, atol=2e-3)
    rest = binary.gnss.v_n[~moving, :2] ** 2
    assert np.all(rest.sum(axis=1) <= text.gnss.cov_v_n[~moving, 0, 0])
