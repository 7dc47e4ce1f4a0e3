"""Text logs without options: columns, units and clock proposed for allan, calibrate and foot, and asked once."""

import json
import re
import shlex
import tomllib

import numpy as np
import pytest
from command import answer, refusal, run

from schuler import units
from schuler.calibration.freepose.simulation import hand_log
from schuler.cli import proposal
from schuler.cli.reading import Reading
from schuler.diagnosis.result import as_entries
from schuler.sensors import ImuErrors, catalogue
from schuler.simulation.gait import walk
from schuler.simulation.motion import ideal_rates

NS = 1_707_350_382_000_000_000


def save(path, header, scale_gyro=1.0 / units.DEG, n=4000):
    """A board at rest, millig and Unix milliseconds at 100 Hz: time, gyroscope, accelerometer."""
    rng = np.random.default_rng(3)
    f = 1000.0 * (np.array([0.0, 0.0, -1.0]) + 2e-3 * rng.standard_normal((n, 3)))
    w = scale_gyro * 2e-3 * rng.standard_normal((n, 3))
    rows = (f"{NS // 10**6 + 10 * k},{','.join(f'{x:.6f}' for x in (*w[k], *f[k]))}" for k in range(n))
    path.write_text("\n".join((*header, *rows)) + "\n")
    return f * 1e-3 * units.G0, w / scale_gyro


def test_header_and_physics_are_enough(tmp_path, capsys):
    """The header states deg/s and no unit of specific force: its norm does."""
    path = tmp_path / "rest.csv"
    f, w = save(path, ["time,gx (deg/s),gy (deg/s),gz (deg/s),ax,ay,az"])
    recording = Reading().read(path)
    np.testing.assert_allclose(recording.imu.accel, f, atol=1e-6)
    np.testing.assert_allclose(recording.imu.gyro, w, atol=1e-6)
    assert recording.imu.interval == pytest.approx(0.01)
    assert "--units" in capsys.readouterr().err


@pytest.mark.campaign
def test_allan_takes_a_log_without_options(tmp_path, capsys):
    save(tmp_path / "rest.csv", ["time,gx (deg/s),gy (deg/s),gz (deg/s),ax,ay,az"], n=6000)
    numbers = answer(capsys, "allan", tmp_path / "rest.csv", "--no-report", "--out", tmp_path / "out", "--json")
    assert numbers["command"] == "allan"


def test_what_nothing_tells_is_one_question_in_options_of_the_command(tmp_path, capsys, monkeypatch):
    """At rest no motion tells deg/s from rad/s: on a terminal it is asked."""
    path = tmp_path / "rest.csv"
    _, w = save(path, [])
    message = refusal(capsys, "allan", path, "--no-report")
    assert "--units" in message
    assert "gyro=deg/s" in message
    assert "--set" not in message
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(proposal.sys, "stderr", type("Terminal", (), {"isatty": lambda _: True, "write": lambda *_: 0,
                                                                     "flush": lambda _: None})())  # fmt: skip
    monkeypatch.setattr("builtins.input", lambda _: "1")
    recording = Reading().read(path)
    np.testing.assert_allclose(recording.imu.gyro, w, atol=1e-6)


def test_options_of_the_command_line_stay_as_a_shell_takes_them(tmp_path, capsys):
    """`navigate` asks in --set, quoted once for the shell and once for TOML; entries of [recording] are spelt anew."""
    save(tmp_path / "rest.csv", [])
    message = refusal(capsys, "navigate", tmp_path / "rest.csv")
    for unit, option in zip(("deg/s", "rad/s"), re.findall(r"--set recording\.units=('\S+')", message), strict=True):
        assert f"gyro={unit}" in tomllib.loads(f"units = {shlex.split(option)[0]}")["units"]
    text = "--set recording.units='\"g,deg/s\"' or units='g,deg/s'"
    assert as_entries(text) == '--set recording.units=\'"g,deg/s"\' or units = "g,deg/s"'


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("recording.imu.colums=t,ax", r"--set recording\.imu\.colums: .*did you mean 'columns'\?"),
        ("recording.inu.axes=FLU", r"--set recording\.inu\.axes: .*did you mean 'imu'\?"),
        ("recording.imu=log.csv", r"such as recording\.imu\.file=log\.csv"),
        ("recording.imu.axes=FLX", r"--set recording\.imu\.axes=FLX: expected three letters"),
        ("recording.axis=FLU", "did you mean 'axes'"),
        ("filter.stats=21", r"--set: filter\.stats: unknown entry; did you mean states"),
        ("flter.states=21", "did you mean filter"),
        ("imu.catalogue=MPU-60000", "did you mean MPU-6000"),
    ],
)
def test_an_entry_that_there_is_not_is_refused_before_a_file_is_read(tmp_path, capsys, entry, expected):
    """In the spelling of the command line, with the nearest one that there is; nothing is read or asked before."""
    for command in ("init", "navigate"):
        message = refusal(capsys, command, tmp_path / "none.csv", "--set", entry)
        assert re.search(expected, message), message
        assert "no such file" not in message


def test_hints_of_the_imu_of_a_single_file_are_the_files_own(tmp_path, capsys):
    """`recording.imu.units` of a log that is all there is reads as `recording.units`; another part has none."""
    path = tmp_path / "rest.csv"
    save(path, [])
    units_of = "=accel=mg,gyro=deg/s,t=ms"
    files = []
    for name in ("recording.units", "recording.imu.units"):
        fixes = ("--set", "alignment.method=given")  # a start: there are no fixes
        out = tmp_path / f"{name}.toml"
        run(capsys, "init", path, "--imu", "MPU-6000", "--set", f"{name}{units_of}", *fixes, "--set",
            "alignment.rpy_deg=[0,0,0]", "--no-trials", "--out", out)  # fmt: skip
        files.append(out.read_text() if out.exists() else "")
    assert files[0] == files[1] != ""
    message = refusal(capsys, "init", path, "--set", "recording.gnss.sigma=1,1,2")
    assert "say recording.sigma" in message


def test_options_stand(tmp_path):
    path = tmp_path / "rest.csv"
    _, w = save(path, [], scale_gyro=1.0)
    recording = Reading(units="accel=mg,gyro=rad/s,t=ms").read(path)
    np.testing.assert_allclose(recording.imu.gyro, w, atol=1e-6)


def test_hints_are_entries_for_commands_with_a_configuration(tmp_path, capsys):
    """Hints of a reader are spelled as the command takes them."""
    path = tmp_path / "rest.csv"
    save(path, ["a,b,c,d,e,f,g"])
    (tmp_path / "drive.toml").write_text('[imu]\ncatalogue = "MTi-3"\n')
    message = refusal(capsys, "navigate", path, "--config", tmp_path / "drive.toml")
    assert 'columns = "t,ax,ay,az,gx,gy,gz"' in message
    assert "--set recording." in message
    assert "columns='" not in message
    short = tmp_path / "short.csv"
    short.write_text("".join(path.read_text().splitlines(keepends=True)[:50]))  # too little to tell the columns
    message = refusal(capsys, "info", short)
    assert "--columns t,ax,ay,az,gx,gy,gz" in message


@pytest.mark.thinned(2)
@pytest.mark.parametrize("order", [slice(None), [3, 4, 5, 0, 1, 2]])
def test_a_biased_gyroscope_is_told_from_gravity_by_what_turns_make_of_it(tmp_path, capsys, order):
    """At rest both are constant: a log turned by hand, without a header and without times, asks for its rate alone."""
    errors = ImuErrors.draw(catalogue.spec("MPU-6050"), np.random.default_rng(4))
    imu = hand_log(errors, np.random.default_rng(5), poses=12, initial_rest_s=5.0).rates()
    path = tmp_path / "turned.txt"
    np.savetxt(path, np.column_stack((imu.accel, imu.gyro + 0.03))[:, order], fmt="%.5f")
    code, _, err = run(capsys, "info", path)
    assert code == 2
    assert "or say its rate, such as --rate=100" in err.splitlines()[-1]
    recording = Reading(rate=100.0, units="m/s^2,rad/s").read(path)
    np.testing.assert_allclose(recording.imu.accel, imu.accel, atol=1e-5)  # printed digits
    np.testing.assert_allclose(recording.imu.gyro, imu.gyro + 0.03, atol=1e-5)


def test_counts_at_rest_are_asked_for_their_scale_once(tmp_path, capsys):
    """Whole numbers: no unit of rates makes them so, and each answer that is offered reads the log."""
    rng = np.random.default_rng(3)
    f = np.round(16384.0 * (np.array([0.0, 0.0, -1.0]) + 2e-3 * rng.standard_normal((4000, 3))))
    w = np.round(65.5 * (0.5 + 0.05 * rng.standard_normal((4000, 3))))
    path = tmp_path / "rest.csv"
    np.savetxt(path, np.column_stack((np.arange(4000) * 10, f, w)), fmt="%d", delimiter=",", comments="",
               header="millis,AcX,AcY,AcZ,GyX,GyY,GyZ")  # fmt: skip
    message = refusal(capsys, "allan", path, "--no-report")
    options = re.search(r"(--units \S+ --scale \S+) \(counts, 65.5 in a deg/s\)", message)[1].split()
    recording = Reading(units=options[1], scale=options[3]).read(path)
    np.testing.assert_allclose(recording.imu.gyro, w / 65.5 * units.DEG, rtol=1e-5)  # printed digits
    np.testing.assert_allclose(recording.imu.accel, f / 16384.0 * units.G0, rtol=1e-5)


@pytest.mark.parametrize("order", [slice(None), [3, 4, 5, 0, 1, 2]])
def test_a_runner_shows_gravity_in_the_stances(tmp_path, capsys, order):
    """No header: the accelerometers' norm is gravity's in the calmest tenth of the log alone."""
    motion = walk([45.0 * units.DEG, 0.0, 0.0], strides=25, length=2.2, swing=0.45, rest=0.2, stand=0.2)
    t = np.arange(int(motion.duration * 200.0)) / 200.0
    omega, f = ideal_rates(motion, t)
    path = tmp_path / "run.txt"
    np.savetxt(path, np.column_stack((t, np.column_stack((f, omega / units.DEG))[:, order])), fmt="%.5f")
    assert np.median(np.linalg.norm(f, axis=1)) > 1.3 * units.G0
    imu = Reading().read(path).imu
    np.testing.assert_allclose(imu.accel, f, atol=1e-5)  # printed digits
    np.testing.assert_allclose(imu.gyro, omega, atol=1e-5)


@pytest.mark.thinned(6)
@pytest.mark.parametrize(("field", "distinct"), [(0.5, True), (1.0, False)])
@pytest.mark.parametrize("order", [slice(None), [*range(3, 9), *range(3), *range(9, 14)]])
def test_what_stands_beside_an_imu_is_passed_over(tmp_path, capsys, order, field, distinct):
    """A magnetometer, whose norm is constant too, a quaternion, a column that never changes: under a strange header.

    In units of the field at the place a magnetometer's norm is that of gravity in g: nothing tells the two then.
    """
    errors = ImuErrors.draw(catalogue.spec("MPU-6050"), np.random.default_rng(4))
    imu = hand_log(errors, np.random.default_rng(6), poses=12, initial_rest_s=5.0).rates()
    q = np.cumsum(np.random.default_rng(7).standard_normal((len(imu), 4)), axis=0)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    magnetic = -field * imu.accel[:, [1, 0, 2]] / np.linalg.norm(imu.accel, axis=1, keepdims=True)
    rows = np.column_stack((imu.accel, imu.gyro, magnetic, q, np.full(len(imu), 7.0)))[:, order]
    path = tmp_path / "turned.txt"
    np.savetxt(path, np.column_stack((imu.t, rows)), fmt="%.5f", header="zeit " + " ".join("abcdefghijklmn"))
    if not distinct:
        assert "--columns" in refusal(capsys, "info", path)
        return
    recording = Reading().read(path)
    assert "--columns" in capsys.readouterr().err
    np.testing.assert_allclose(recording.imu.accel, imu.accel, atol=1e-5)  # printed digits
    np.testing.assert_allclose(recording.imu.gyro, imu.gyro, atol=1e-5)


def test_a_folder_is_read_as_navigate_would_read_it(tmp_path, capsys):
    """info recognises columns of a folder's files, and names the folders in one that has no logs of its own.

    A folder that holds nothing but one is that one.
    """
    (tmp_path / "inner").mkdir()
    save(tmp_path / "inner" / "rest.csv", ["time,gx (deg/s),gy (deg/s),gz (deg/s),ax,ay,az"])
    for folder in (tmp_path / "inner", tmp_path):
        code, out, err = run(capsys, "info", folder)
        assert code == 0
        assert "4000 samples at 100 Hz" in out
        assert "recording.imu.units = accel=mg,t=ms" in err
    (tmp_path / "other").mkdir()
    assert "give one of the folders in it: inner, other" in refusal(capsys, "info", tmp_path)
    assert "give one of the folders in it: inner, other" in refusal(capsys, "navigate", tmp_path)


@pytest.mark.parametrize("given", [{}, {"units": "accel=mg,gyro=deg/s,t=ms"}])
def test_a_clock_that_no_header_names_is_told_by_its_steps(tmp_path, capsys, given):
    """A header in another language; units that are given stand, and nothing else is said of them."""
    path = tmp_path / "rest.csv"
    save(path, ["Zeit,gx (deg/s),gy (deg/s),gz (deg/s),ax,ay,az"])
    recording = Reading(**given).read(path)
    assert recording.imu.interval == pytest.approx(0.01)
    np.testing.assert_allclose(np.diff(recording.imu.t), 0.01, atol=1e-6)  # rounding
    err = capsys.readouterr().err
    assert "increases like a clock" in err
    assert ("--units" in err) != bool(given)


def test_lines_of_objects_whose_unit_is_open_are_a_log(tmp_path, capsys):
    """The question is asked; that they were settings and no samples was said."""
    rng = np.random.default_rng(3)
    rows = np.round(np.column_stack((0.01 * np.arange(3000), rng.normal([0, 0, 9.8, 0, 0, 0], 0.01, (3000, 6)))), 4)
    names = ("timestamp", "ax", "ay", "az", "gx", "gy", "gz")
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(json.dumps(dict(zip(names, row, strict=True))) for row in rows.tolist()) + "\n")
    assert "unit of angular rate" in refusal(capsys, "info", path)
    code, out, _ = run(capsys, "info", path, "--units", "accel=m/s^2,gyro=rad/s")
    assert (code, "3000 samples at 100 Hz" in out) == (0, True)


def test_columns_parted_by_strokes(tmp_path):
    path = tmp_path / "rest.txt"
    f, w = save(path, ["time|gx (deg/s)|gy (deg/s)|gz (deg/s)|ax|ay|az"])
    path.write_text(path.read_text().replace(",", "|"))
    imu = Reading().read(path).imu
    np.testing.assert_allclose(imu.accel, f, atol=1e-6)
    np.testing.assert_allclose(imu.gyro, w, atol=1e-6)
