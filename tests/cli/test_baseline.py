"""``schuler baseline``: a pair of RINEX files that are written here, its numbers, its files, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from command import answer, refusal, run
from receiver_pairs import HOME_LLH, pair

import schuler
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
    assert "m from where the base's own ranges" in refused(rover, base, "--base-position", "10,20,30")
    assert "file states none" in refused(rover, base, "--base-position", "header")
    assert "--base-position: expected latitude" in refused(rover, base, "--base-position", "10,20")
    assert "give an ANTEX file" in refused(rover, base, "--rover-antenna", "TRM59800.00")
    fixes = tmp_path / "fixes.csv"
    fixes.write_text("t,lat,lon,height\n" + "".join(f"{k},47.0,8.0,400\n" for k in range(9)), encoding="utf-8")
    code, _, err = run(capsys, "baseline", fixes, base, "--out", tmp_path / "out")
    assert code == 2
    assert "fixes.csv" in err
    assert not (tmp_path / "out").exists()
