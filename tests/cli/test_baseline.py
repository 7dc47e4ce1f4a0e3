"""``schuler baseline``: a pair of RINEX files that are written here, its numbers, its files, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from command import answer, refusal, run
from receiver_pairs import HOME_LLH, pair

import schuler
from schuler.frames import C_en, ecef_from_llh
from schuler.recording import Recording
from schuler.recording.io import write
from schuler.recording.recording import Metadata
from schuler.timebase import TimeBase

PLACE = f"{np.degrees(HOME_LLH[0])},{np.degrees(HOME_LLH[1])},{HOME_LLH[2]}"


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Exact measurements of a rover 50 m away; every log has its messages."""
    p = pair(np.random.default_rng(4), lambda _: (40.0, 30.0, -2.0), np.arange(4.0), each=12)
    folder = tmp_path_factory.mktemp("pair")

    def save(name, o):
        about = Metadata(name, TimeBase("gps", o.epoch_gps_s))
        write(Recording(observations=o, ephemerides=p.ephemerides, metadata=about), folder / f"{name}.parquet")
        return folder / f"{name}.parquet"

    return save, save("rover", p.rover), save("base", p.base), p


def test_baseline_and_its_files(logs, tmp_path, capsys):
    _, rover, base, p = logs
    data = answer(capsys, "baseline", rover, base, "--base-position", PLACE, "--out", tmp_path / "out", "--json")
    assert (data["epochs"], data["fixed"], data["slips"], data["verdict"]["status"]) == (4, 4, 0, "ok")
    np.testing.assert_allclose(data["last_baseline_ned_m"], p.baseline_n[-1], atol=3e-4)  # see tests/gnss
    assert data["rms_carrier_m"] < 1e-3
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(word in page for word in ("verdict: OK", "carrier residual", "cycle slips", "G11"))
    fixes = schuler.read(tmp_path / "out" / "rover.pos").gnss
    assert fixes.quality.tolist() == [1, 1, 1, 1]
    assert len((tmp_path / "out" / "baseline.csv").read_text(encoding="utf-8").splitlines()) == 5


def test_a_base_without_a_position_is_where_its_points_are(logs, tmp_path, capsys):
    _, rover, base, _ = logs
    code, out, err = run(capsys, "baseline", rover, base, "--static", "--no-report", "--out", tmp_path / "out")
    assert code == 0
    assert out.startswith("verdict: OK")
    assert "static, 100.0 % fixed; last baseline 40.0" in out
    assert "mean of its single points" in err


def test_what_reading_left_out_of_either_log_is_said(logs, tmp_path, capsys):
    _, rover, _, p = logs
    base = tmp_path / "odd.parquet"
    about = Metadata("odd", TimeBase("gps", p.base.epoch_gps_s), notes=("3 rows were left out.",))
    write(Recording(observations=p.base, metadata=about), base)
    data = answer(capsys, "baseline", rover, base, "--no-report", "--json", "--out", tmp_path / "out")
    assert "base: 3 rows were left out." in data["notes"]
    assert not any(note.startswith("rover: 3") for note in data["notes"])


def test_marks_and_the_header_of_the_base(logs, tmp_path, capsys):
    """The header's position is the mark's: with the height it is the antenna's, with --marks both ends are marks."""
    save, _, _, p = logs
    mark_e = ecef_from_llh(HOME_LLH) - C_en(HOME_LLH) @ (0.0, 0.0, -2.0)
    low = save("low", replace(p.rover, eccentricity_n=(0.0, 0.0, -0.5), antenna="A NONE"))
    high = save("high", replace(p.base, eccentricity_n=(0.0, 0.0, -2.0), position_e=tuple(mark_e), antenna="B NONE"))
    options = ("--base-position", "header", "--no-report", "--json", "--out", tmp_path / "out")
    data = answer(capsys, "baseline", low, high, *options)
    np.testing.assert_allclose(data["last_baseline_ned_m"], p.baseline_n[-1], atol=3e-4)  # see tests/gnss
    assert any("antennas differ, A NONE and B NONE" in note for note in data["notes"])
    data = answer(capsys, "baseline", low, high, "--marks", *options)
    np.testing.assert_allclose(data["last_baseline_ned_m"], p.baseline_n[-1] + (0.0, 0.0, -1.5), atol=3e-4)
    assert any("base: antenna 2.0000 m above its mark" in note for note in data["notes"])


def test_what_cannot_be_used_is_refused(logs, tmp_path, capsys):
    save, rover, base, p = logs

    def refused(*arguments):
        return refusal(capsys, "baseline", *arguments, "--out", tmp_path / "out")

    metres = p.base.carrier * np.where(p.base.signal == p.base.signals.index("1C"), 0.1903, 0.2442)
    assert "carriers in metres" in refused(rover, save("metres", replace(p.base, carrier=metres)))
    swapped = save(
        "swapped", replace(p.base, carrier=p.base.carrier * np.where(p.base.signal == 0, 0.2442 / 0.1903, 1.0))
    )
    assert "carriers of another band" in refused(rover, swapped)
    sign = save("sign", replace(p.rover, carrier=-p.rover.carrier))
    assert "rover: the carrier of" in refused(sign, base)
    week = save("week", replace(p.base, epoch_gps_s=p.base.epoch_gps_s + 604_800.0))
    assert "base: no ephemeris for any of its satellites" in refused(rover, week)
    hour = save("hour", replace(p.base, epoch_gps_s=p.base.epoch_gps_s - 3600.0))
    assert "expected stamps in GPS time, messages of that day" in refused(rover, hour)
    assert "m from where the base's own ranges" in refused(rover, base, "--base-position", "10,20,30")
    assert "file states none" in refused(rover, base, "--base-position", "header")
    assert "--base-position: expected latitude" in refused(rover, base, "--base-position", "10,20")
    assert "the rover's log does not state its antenna's height" in refused(rover, base, "--marks")
    assert "give an ANTEX file" in refused(rover, base, "--rover-antenna", "TRM59800.00")
    fixes = tmp_path / "fixes.csv"
    fixes.write_text("t,lat,lon,height\n" + "".join(f"{k},47.0,8.0,400\n" for k in range(9)), encoding="utf-8")
    code, _, err = run(capsys, "baseline", fixes, base, "--out", tmp_path / "out")
    assert code == 2
    assert "fixes.csv" in err
    assert not (tmp_path / "out").exists()
