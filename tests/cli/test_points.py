"""``schuler points``: RINEX files that are written here, its numbers and files, folders, faults, what is refused."""

import json
from dataclasses import replace

import encode_rtcm
import numpy as np
import pytest
from command import answer, refusal, run
from receiver_pairs import pair
from sky import EPOCH, HOME, ephemerides, observe

import schuler
from schuler.frames import C_en, llh_from_ecef
from schuler.gnss.signals import satellite_name
from schuler.recording import Recording
from schuler.recording.io import write
from schuler.recording.recording import Metadata
from schuler.recording.trajectory import Trajectory
from schuler.timebase import WEEK_S, TimeBase, calendar, week_tow

BARE = ("--ionosphere", "none", "--troposphere", "none")  # the sky of the tests has no air
SPEED_N = np.array([3.0, 1.0, 0.0])
NAVIGATION = (
    "af0", "af1", "af2", "issue", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "toe", "cic", "omega0", "cis",
    "i0", "crc", "omega", "omega_dot", "idot", "source", "week", "flag", "accuracy", "health", "delay", "delay_2",
    "sent",
)  # fmt: skip


def place(t: float) -> np.ndarray:
    return HOME + C_en(llh_from_ecef(HOME)) @ SPEED_N * t


def head(*lines: str) -> str:
    return "".join(f"{content:<60}{label}\n" for content, label in (line.split("|") for line in lines))


def observation_text(o) -> str:
    """RINEX 3 of code, Doppler and C/N0 on the first band."""
    text = head(
        "     3.04           OBSERVATION DATA    M: MIXED|RINEX VERSION / TYPE",
        "G    3 C1C D1C S1C|SYS / # / OBS TYPES",
        "E    3 C1C D1C S1C|SYS / # / OBS TYPES", f"{stamp(EPOCH)}     GPS|TIME OF FIRST OBS", "|END OF HEADER",
    )  # fmt: skip
    for t in np.unique(o.t):
        k = np.flatnonzero(o.t == t)
        day = calendar(EPOCH)
        text += f"> {day:%Y %m %d %H %M}{day.second + t:11.7f}  0{len(k):3d}\n"
        doppler = -o.range_rate[k] * 1575.42e6 / 299_792_458.0
        for i, hz in zip(k, doppler, strict=True):
            text += f"{satellite_name(int(o.sat[i]))}{o.pseudorange[i]:14.3f}  {hz:14.3f}  {o.cn0[i]:14.3f}\n"
    return text


def stamp(gps_s: float) -> str:
    day = calendar(gps_s)
    return f"{day.year:6d}{day.month:6d}{day.day:6d}{day.hour:6d}{day.minute:6d}{day.second:13.7f}"


def navigation_text(messages, letters: str) -> str:
    """RINEX 3 of the Keplerian messages of some systems."""
    text = head("     3.04           N: GNSS NAV DATA    M: MIXED|RINEX VERSION / TYPE", "|END OF HEADER")
    records = messages.kepler
    for i in range(len(records)):
        name = satellite_name(int(records.sat[i]))
        if name[0] not in letters:
            continue
        week, tow = week_tow(float(records.toe[i]))
        given = {"toe": tow, "week": week, "sent": week_tow(float(records.sent[i]))[1], "flag": 0.0}
        given |= dict(zip(("delay", "delay_2"), records.group_delay[i], strict=True))
        values = [float(given.get(field, getattr(records, field, np.zeros(i + 1))[i] if field not in given else 0.0))
                  for field in NAVIGATION]  # fmt: skip
        numbers = [f"{v:19.12E}" for v in values]
        text += f"{name} {calendar(float(records.toc[i])):%Y %m %d %H %M %S}" + "".join(numbers[:3]) + "\n"
        for k in range(3, len(numbers), 4):
            text += "    " + "".join(numbers[k : k + 4]) + "\n"
    return text


@pytest.fixture(scope="module")
def sky():
    """Twenty exact epochs of a receiver that drives, and the messages of its satellites."""
    eph = ephemerides(np.random.default_rng(2), "GE", 18)
    return eph, observe(eph, np.arange(20.0), place, lambda t: 3e-4 + 1e-7 * t, lowest=0.2)


@pytest.fixture
def folder(sky, tmp_path):
    """A log, and a navigation file for each system, beside a file that is none of it."""
    eph, o = sky
    (tmp_path / "drive").mkdir()
    for name, text in {
        "rover.obs": observation_text(o), "rover.nav": navigation_text(eph, "G"), "more.nav": navigation_text(eph, "E"),
        "README.md": "A drive.\n",
    }.items():  # fmt: skip
        (tmp_path / "drive" / name).write_text(text, encoding="utf-8")
    return tmp_path / "drive"


def by_hand(folder):
    nav = [schuler.read(folder / name).ephemerides for name in ("rover.nav", "more.nav")]
    ranges = schuler.prepare_ranges(
        schuler.read(folder / "rover.obs").observations,
        nav[0].merged_with(nav[1]),
        ionosphere="none",
        troposphere="none",
    )
    return ranges, schuler.solve_points(ranges)


def table(path):
    head_line, *lines = path.read_text(encoding="utf-8").splitlines()
    return [dict(zip(head_line.split(","), line.split(","), strict=True)) for line in lines]


def test_positions_are_the_truth_and_those_of_the_library(folder, tmp_path, capsys):
    out = tmp_path / "out"
    data = answer(capsys, "points", folder, *BARE, "--out", out, "--json")
    assert (data["command"], data["epochs"], data["solved"], data["checked"]) == ("points", 20, 20, 20)
    assert data["verdict"]["status"] == "ok"
    _, points = by_hand(folder)
    rows = table(out / "points.csv")
    for name, values in (
        ("t_s", points.t), ("hpl_m", points.hpl), ("height_m", points.llh[:, 2]),
        ("lat_deg", np.degrees(points.llh[:, 0])),
    ):  # fmt: skip
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=1e-14)  # rounding
    fixes = schuler.read(out / "points.pos").gnss
    np.testing.assert_allclose(fixes.llh[:, :2], points.llh[:, :2], atol=1e-12)  # printed digits: 1e-11 deg
    np.testing.assert_allclose(fixes.llh[:, 2], points.llh[:, 2], atol=6e-7)  # printed digits
    true = np.array([place(t) for t in points.t - week_tow(EPOCH)[1]])
    assert np.abs(points.r_e - true).max() < 0.01  # printed digits: ranges to a millimetre, times a PDOP of some 1.5
    assert {p.name for p in out.glob("[!.]*")} == {"points.csv", "points.pos", "points.kml", "report.html"}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all(word in page for word in ("verdict: OK", "Protection levels", "Satellites in the sky", "Residuals"))


def test_a_folder_is_its_files(folder, tmp_path, capsys):
    nav = ("--nav", folder / "rover.nav", "--nav", folder / "more.nav")
    assert run(capsys, "points", folder, "--no-report", "--out", tmp_path / "a")[0] == 0
    assert run(capsys, "points", folder / "rover.obs", *nav, "--no-report", "--out", tmp_path / "b")[0] == 0
    for name in ("points.csv", "points.kml"):
        assert (tmp_path / "a" / name).read_text().replace("drive", "rover") == (tmp_path / "b" / name).read_text()
    # one system costs satellites, and shows in its table
    data = answer(capsys, "points", folder, "--systems", "G", *BARE, "--no-report", "--json", "--out", tmp_path / "c")
    assert {row["satellite"][0] for row in data["satellites"]} == {"G"}


def test_files_are_kept_unless_forced(folder, tmp_path, capsys):
    taken = tmp_path / "out"
    taken.mkdir()
    (taken / "points.csv").write_text("mine")
    call = ("points", folder, *BARE, "--no-report", "--out", taken)
    assert "points.csv" in refusal(capsys, *call)
    assert (taken / "points.csv").read_text() == "mine"
    assert run(capsys, *call, "--force")[0] == 0
    assert (taken / "points.csv").read_text() != "mine"


def saved(o, eph, path):
    write(Recording(observations=o, ephemerides=eph, metadata=Metadata("log", TimeBase("gps", EPOCH))), path)
    return path


def strict(text):
    """JSON without what only Python knows."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


@pytest.mark.parametrize("size", [120.0, -80.0])
def test_a_fault_is_left_out_and_named(sky, tmp_path, capsys, size):
    eph, o = sky
    ok = np.unique(o.sat[o.cn0 > 42.0])
    wrong = (o.sat == ok[0]) & (o.t > 5.0) & (o.t < 9.0)
    log = saved(replace(o, pseudorange=o.pseudorange + size * wrong), eph, tmp_path / "log.parquet")
    data = answer(capsys, "points", log, *BARE, "--out", tmp_path / "out", "--json")
    epochs = len(np.unique(o.t[wrong]))
    assert (data["epochs_with_faults"], data["ranges_left_out"]) == (epochs, epochs)
    assert f"faults at {epochs} epochs" in " ".join(data["verdict"]["remarks"])
    name = satellite_name(int(ok[0]))
    assert [row["left_out"] for row in table(tmp_path / "out" / "points.csv")].count(name) == epochs
    assert {row["satellite"]: row["at_fault"] for row in data["satellites"]}[name] == epochs
    assert "ranges at fault" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_too_few_satellites_are_a_failure_with_advice(sky, tmp_path, capsys):
    eph, o = sky
    few = np.isin(o.sat, np.unique(o.sat)[:3])
    rows = ("t", "sat", "signal", "pseudorange", "range_rate", "carrier", "cn0", "lock")
    o = replace(o, **{name: getattr(o, name)[few] for name in rows})
    log = saved(o, eph, tmp_path / "few.parquet")
    code, out, _ = run(capsys, "points", log, *BARE, "--out", tmp_path / "out", "--json")
    data = strict(out)
    assert code == 1
    assert (data["solved"], data["verdict"]["status"], data["errors"]) == (0, "failed", None)
    assert "too few satellites" in data["verdict"]["reasons"][0]
    assert data["verdict"]["causes"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "verdict: FAILED" in page
    assert not (tmp_path / "out" / "points.pos").exists()


def test_a_log_without_codes_is_told_so(sky, tmp_path, capsys):
    eph, o = sky
    log = saved(replace(o, pseudorange=np.full(len(o), np.nan)), eph, tmp_path / "rates.parquet")
    code, out, _ = run(capsys, "points", log, *BARE, "--out", tmp_path / "out", "--no-report", "--json")
    assert code == 1
    assert strict(out)["verdict"]["causes"][0].startswith("satellites without a pseudorange")


@pytest.mark.parametrize("until", [5.0, 8.5, 18.0])
def test_positions_without_a_velocity_are_not_lost(sky, tmp_path, capsys, until):
    """points.pos has every position, and every velocity that there is; rows without one end before it.

    Read again, epochs without a velocity are left out and counted; if they are more than half, the velocities are.
    """
    eph, o = sky
    rate = np.where((o.t > 5.0) & (o.t < until), np.nan, o.range_rate)
    log = saved(replace(o, range_rate=rate), eph, tmp_path / "log.parquet")
    data = answer(capsys, "points", log, *BARE, "--no-report", "--json", "--out", tmp_path / "out")
    silent = np.isin(np.unique(o.t), o.t[np.isnan(rate)])
    missing = int(silent.sum())
    assert data["with_velocity"] == 20 - missing
    rows = [x.split() for x in (tmp_path / "out" / "points.pos").read_text().splitlines() if not x.startswith("%")]
    assert [len(fields) for fields in rows] == np.where(silent, 2 + 13, 2 + 22).tolist()
    assert [row["v_north_m_s"] for row in table(tmp_path / "out" / "points.csv")].count("") == missing
    assert any(f"{missing} of 20 positions have no velocity" in note for note in data["notes"]) == (missing > 0)
    again = schuler.read(tmp_path / "out" / "points.pos")
    most = 2 * missing > 20
    assert (len(again.gnss), again.gnss.v_n is None) == (20 if most else 20 - missing, most)
    assert any(f"{missing} of 20 epochs have no velocity" in note for note in again.metadata.notes) == (missing > 0)
    velocity = [float(row["v_north_m_s"]) for row in table(tmp_path / "out" / "points.csv") if row["v_north_m_s"]]
    if again.gnss.v_n is not None:
        np.testing.assert_allclose(again.gnss.v_n[:, 0], velocity, atol=6e-4)  # printed digits of both


def test_less_risk_is_a_wider_level(folder, tmp_path, capsys):
    call = ("points", folder, *BARE, "--no-report", "--json", "--force", "--out", tmp_path / "out", "--risk")
    levels = [answer(capsys, *call, risk)["median_hpl_m"] for risk in ("1e-2", "1e-3", "1e-5")]
    assert levels == sorted(levels)
    assert levels[0] < levels[-1]


def test_errors_are_against_the_reference(folder, tmp_path, capsys):
    """A reference 3 m south and 1 m up of the truth: errors are 3 m north and 1 m down, at the epochs it covers."""
    _, points = by_hand(folder)
    axes = C_en(llh_from_ecef(HOME))
    t = np.arange(4.0, 30.0, 0.5)
    moved = Trajectory(t + 100.0, np.array([place(x) for x in t]) + axes @ (-3.0, 0.0, -1.0))
    truth = tmp_path / "truth.parquet"
    write(Recording(reference=moved, metadata=Metadata("truth", TimeBase("gps", EPOCH - 100.0))), truth)
    call = ("points", folder, *BARE, "--reference", truth, "--alert-limit", "25", "--out", tmp_path / "out")
    data = answer(capsys, *call, "--json")["errors"]
    assert data["epochs"] == int(np.sum(points.t - week_tow(EPOCH)[1] >= 4.0))
    np.testing.assert_allclose(data["mean_ned_m"], [3.0, 0.0, 1.0], atol=0.01)  # printed digits of the ranges
    assert data["beyond_hpl"] == 0
    assert table(tmp_path / "out" / "points.csv")[0]["error_north_m"] == ""
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(word in page for word in ("Stanford diagram, horizontal", "alert limit, 25 m", "inside three of their"))
    code, out, _ = run(capsys, *call, "--no-report", "--force")
    assert code == 0
    assert "horizontal p50 3.0" in out
    # nothing is compared in a pause of the reference
    pause = (t > 8.0) & (t < 13.0)
    write(Recording(reference=moved.samples(~pause), metadata=Metadata("t", TimeBase("gps", EPOCH - 100.0))), truth)
    seconds = points.t - week_tow(EPOCH)[1]
    fewer = int(np.sum((seconds > 8.0 + 1e-6) & (seconds < 13.0 - 1e-6)))
    again = answer(capsys, *call, "--no-report", "--force", "--json")["errors"]
    assert again["epochs"] == data["epochs"] - fewer < data["epochs"]


def test_ranges_that_are_ready_are_solved_as_they_are(folder, tmp_path, capsys):
    ranges, points = by_hand(folder)
    log = tmp_path / "ready.parquet"
    write(Recording(ranges=ranges, metadata=Metadata("ready", TimeBase("gps", EPOCH))), log)
    data = answer(capsys, "points", log, "--no-report", "--json", "--out", tmp_path / "out")
    assert data["solved"] == int(points.ok.sum())
    assert any("corrected already" in note for note in data["notes"])


def test_what_cannot_be_solved_is_refused(sky, folder, tmp_path, capsys):
    eph, o = sky

    def refused(*arguments):
        message = refusal(capsys, "points", *arguments, "--out", tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return message

    assert "no such file or folder" in refused(tmp_path / "nothing.obs")
    sentence = refused(folder / "rover.obs")
    assert "has no ephemerides" in sentence
    assert "rover.nav" in sentence  # lies beside it
    assert "give a RINEX navigation file of that day with --nav" in sentence
    assert "expected raw measurements of a receiver" in refused(folder / "rover.nav")
    assert "--nav" in refused(folder / "rover.obs", "--nav", folder / "rover.obs")
    assert "no such file" in refused(folder / "rover.obs", "--nav", folder / "none.nav")
    nav = ("--nav", folder / "rover.nav")
    assert "more.nav; an option that takes several" in refused(folder / "rover.obs", *nav, folder / "more.nav")
    assert "--systems: expected letters" in refused(folder / "rover.obs", *nav, "--systems", "X")
    assert "--systems R: expected some of those in" in refused(folder / "rover.obs", *nav, "--systems", "R")
    assert "--risk: expected a probability" in refused(folder / "rover.obs", *nav, "--risk", "2")
    assert "--alert-limit: expected a positive" in refused(folder / "rover.obs", *nav, "--alert-limit", "0")
    assert "--ionosphere" in refused(folder / "rover.obs", *nav, "--ionosphere", "maps")
    late = replace(o, epoch_gps_s=o.epoch_gps_s + 604_800.0)
    assert "no ephemeris for any of its satellites" in refused(saved(late, eph, tmp_path / "week.parquet"))
    (folder / "base.obs").write_text((folder / "rover.obs").read_text())
    sentence = refused(folder)
    assert "got base.obs, rover.obs" in sentence
    assert f"schuler points {folder / 'base.obs'} --nav {folder / 'more.nav'} --nav {folder / 'rover.nav'}" in sentence
    (folder / "base.obs").unlink()
    (folder / "rover.obs").rename(tmp_path / "away.obs")
    assert "expected one file of raw measurements" in refused(folder)
    fixes = tmp_path / "fixes.csv"
    fixes.write_text("t,lat,lon,height\n" + "".join(f"{k},47.0,8.0,400\n" for k in range(9)), encoding="utf-8")
    (tmp_path / "numbers.csv").write_text("".join(f"{k},{k},1,2,3\n" for k in range(9)), encoding="utf-8")
    assert "it is none of these" in refused(tmp_path / "numbers.csv")
    assert "--reference" in refused(tmp_path / "away.obs", *nav, *BARE, "--reference", fixes)


@pytest.mark.campaign
@pytest.mark.realdata
def test_a_folder_of_a_receiver_just_works(shared_data, tmp_path, capsys):
    """RINEX and u-blox of one name are one log: RINEX is taken, and it is said."""
    walk = shared_data / "rtkexp_walk"
    out = tmp_path / "out"
    data = answer(capsys, "points", walk, "--json", "--out", out, "--reference", walk / "gnss_1730_sf.pos")
    assert data["solved"] == data["epochs"] == 536
    assert any("Not read beside gnss_1730.obs" in note for note in data["notes"])
    assert data["errors"]["beyond_hpl"] == 0
    again = answer(
        capsys, "points", walk / "gnss_1730.obs", "--nav", walk / "gnss_1730.nav", "--json", "--no-report", "--out",
        tmp_path / "again",
    )  # fmt: skip
    assert again["median_hpl_m"] == data["median_hpl_m"]


def test_a_stream_needs_its_week(tmp_path, capsys):
    """RTCM 3 has the time of week: the option is asked for, and positions are those of the receiver's own log."""
    pytest.importorskip("pyrtcm")
    p = pair(np.random.default_rng(3), lambda _: (200.0, -220.0, 5.0), np.arange(6.0), bands=("1C",), each=12)
    base = replace(p.base, t=np.round(p.base.t, 6), range_rate=np.zeros(len(p.base)), cn0=np.round(p.base.cn0))
    frames = [encode_rtcm.msm(base, s, t, 7, 600) for t in np.unique(base.t) for s in "GEC"]
    (tmp_path / "base.rtcm3").write_bytes(b"".join(frames))
    messages = tmp_path / "messages.parquet"
    write(
        Recording(ephemerides=p.ephemerides, observations=base, metadata=Metadata("m", TimeBase("gps", EPOCH))),
        messages,
    )
    call = ("points", tmp_path / "base.rtcm3", "--nav", messages, "--no-report", "--out", tmp_path / "out")
    assert "--time gps-tow:WEEK" in refusal(capsys, *call)
    week = int(base.epoch_gps_s // WEEK_S)
    data = answer(capsys, *call, "--time", f"gps-tow:{week}", "--ionosphere", "none", "--json")
    assert data["solved"] == 6
    at = schuler.read(tmp_path / "out" / "points.pos").gnss.llh
    # the sky of pairs has a troposphere like ours; an MSM's stamps are whole milliseconds, 1 m of a satellite's way
    np.testing.assert_allclose(at[:, 2], llh_from_ecef(HOME)[2], atol=5.0)
