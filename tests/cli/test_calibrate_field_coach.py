"""The coach in a terminal: a finished log, one that grows, lines on stdin; Ctrl-C and half a line lose nothing."""

import os
import re
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest
from workbench import write_all

from schuler import earth, rotation
from schuler.calibration.field.options import CoachOptions
from schuler.cli import calibrate_field_coach as terminal
from schuler.cli.calibrate_field_coach import run_coach
from schuler.cli.reading import Reading
from schuler.exceptions import InputError
from schuler.sensors import catalogue
from schuler.units import DEG

LAT = 39.92 * DEG
SPEC = catalogue.spec("yaman-automotive")
HEADER = "t [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]\n"
RATE = 50.0


def log_of(*steps, seed=1) -> np.ndarray:
    """Rests in seconds, and turns (axis, degrees, seconds), of a noisy sensor: t, rates, specific force."""
    rng = np.random.default_rng(seed)
    C, rows = np.eye(3), []
    for step in steps:
        u, angle, seconds = (np.zeros(3), 0.0, step) if np.isscalar(step) else (np.eye(3)[step[0]], *step[1:])
        n = round(seconds * RATE)
        x = np.arange(1, n + 1) / n
        turned = angle * DEG * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi))
        rate = angle * DEG / seconds * (1.0 - np.cos(2.0 * np.pi * x))
        now = C @ rotation.dcm_from_rotvec(turned[:, None] * u)
        rows.append(np.hstack((rate[:, None] * u, -earth.gravity_ned(LAT, 0.0) @ now)))
        C = C @ rotation.dcm_from_rotvec(angle * DEG * u)
    values = np.vstack(rows)
    values[:, :3] += SPEC.gyro.random_walk * np.sqrt(RATE) * rng.standard_normal((len(values), 3))
    values[:, 3:] += SPEC.accel.random_walk * np.sqrt(RATE) * rng.standard_normal((len(values), 3))
    return np.column_stack((np.arange(1, len(values) + 1) / RATE, values))


def text_of(rows) -> str:
    return "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows)


LOG = log_of(12.0, (0, 90.0, 2.5), 8.0, (1, 45.0, 1.5), 8.0)


@pytest.fixture
def finished(tmp_path) -> Path:
    path = tmp_path / "hand.csv"
    path.write_text(HEADER + text_of(LOG))
    os.utime(path, (0, 0))
    return path


def coached(log, **options):
    lines: list[str] = []
    recording = run_coach(log, SPEC, latitude=LAT, out=lines.append, **options)
    return recording, lines


def advice_in(lines) -> list[str]:
    return [line for line in lines if re.search(r"\d+%", line) and "to go" in line]


@pytest.mark.campaign
def test_a_finished_log(finished):
    recording, lines = coached(finished)
    assert len(recording.need_imu()) == len(LOG)
    assert recording.metadata.sources.keys() == {"hand.csv"}
    assert all("\n" not in line for line in lines)
    stated = advice_in(lines)
    assert "lay it down" in stated[0]
    assert len(stated) == 4
    assert all("turn" in line for line in stated[1:])
    assert [line.split("  ")[-1] for line in lines if "ing" in line and "%" not in line] == [
        "turning", "resting: hold it", "turning", "resting: hold it"
    ]  # fmt: skip
    times = [float(line.split()[0]) for line in lines if re.match(r" *\d+\.\d s", line)]
    assert times == sorted(times)
    assert lines[-1].startswith("not yet below the target") or lines[-1].startswith("out of reach")


def test_the_bell_rings_with_advice_only(finished):
    _, lines = coached(finished, bell=True)
    assert [line.startswith("\a") for line in lines if "turn " in line] == [True] * 3
    assert not any("\a" in line for line in lines if "turn " not in line)


def test_reading_options_are_those_of_other_commands(tmp_path):
    path = tmp_path / "raw.txt"
    rows = LOG * np.array([1e3, *[1.0 / DEG] * 3, *[1.0 / 9.80665] * 3])
    path.write_text(text_of(rows))
    os.utime(path, (0, 0))
    reading = Reading(columns="t,gx,gy,gz,ax,ay,az", units="g,deg/s,ms")
    recording, lines = coached(path, reading=reading)
    np.testing.assert_allclose(recording.need_imu().accel, LOG[:, 4:], rtol=1e-7)
    assert len(advice_in(lines)) == 4


@pytest.mark.campaign
def test_a_growing_log_is_followed(tmp_path, monkeypatch):
    """Written in pieces that end anywhere in a line; the same advice as on the finished log."""
    path = tmp_path / "growing.csv"
    text = HEADER + text_of(LOG)
    monkeypatch.setattr(terminal, "_POLL_S", 0.01)

    def write():
        with path.open("w") as file:
            for k in range(0, len(text), 7001):
                file.write(text[k : k + 7001])
                file.flush()
                time.sleep(0.05)

    writer = threading.Thread(target=write)
    writer.start()
    recording, lines = coached(path, follow=True, idle_s=1.0)
    writer.join()
    np.testing.assert_allclose(recording.need_imu().t, LOG[:, 0])
    path.with_name("finished.csv").write_text(text)
    again, others = coached(path.with_name("finished.csv"), follow=False)
    np.testing.assert_array_equal(recording.need_imu().gyro, again.need_imu().gyro)
    assert len(advice_in(lines)) == len(advice_in(others))


def test_a_file_written_to_just_now_is_taken_to_grow(tmp_path):
    path = tmp_path / "now.csv"
    path.write_text(HEADER + text_of(LOG[:100]))
    assert terminal._grows(path)
    os.utime(path, (0, 0))
    assert not terminal._grows(path)
    assert not terminal._grows(tmp_path)
    assert not terminal._grows(tmp_path / "none.csv")


def test_it_ends_when_all_is_found(tmp_path):
    """A target that the first rests reach: the file may go on growing, the coach does not wait."""
    path = tmp_path / "hand.csv"
    path.write_text(HEADER + text_of(LOG))
    recording, lines = coached(path, follow=True, idle_s=600.0, coaching=CoachOptions(patience_s=1e-9))
    assert any("done: stop" in line for line in lines)
    assert len(recording.need_imu()) == len(LOG)


def test_ctrl_c_keeps_everything(tmp_path, monkeypatch):
    """While it waits for more, and lines that came after the last look are read too."""
    path = tmp_path / "hand.csv"
    path.write_text(HEADER + text_of(LOG[:700]))

    def interrupted(_):
        with path.open("a") as file:
            file.write(text_of(LOG[700:]) + "28.2,0.1,0")
        raise KeyboardInterrupt

    monkeypatch.setattr(terminal.time, "sleep", interrupted)
    recording, lines = coached(path, follow=True)
    np.testing.assert_allclose(recording.need_imu().t, LOG[:, 0])
    assert any("interrupted" in line for line in lines)


@pytest.mark.campaign
def test_lines_of_stdin_are_kept(tmp_path, monkeypatch):
    """Blanks between numbers, SI; a file of that name is not overwritten."""
    monkeypatch.setattr(terminal, "_POLL_S", 0.01)
    (tmp_path / "kept.txt").write_text("something of value")
    out, into = os.pipe()
    with os.fdopen(out, "rb") as stdin:

        def write():
            with os.fdopen(into, "w") as pipe:
                pipe.write(text_of(LOG).replace(",", " "))

        writer = threading.Thread(target=write)
        writer.start()
        recording, lines = coached(Path("-"), stdin=stdin, keep=tmp_path / "kept.txt")
        writer.join()
    np.testing.assert_allclose(recording.need_imu().accel, LOG[:, 4:], rtol=1e-8)
    assert (tmp_path / "kept.txt").read_text() == "something of value"
    assert (tmp_path / "kept-2.txt").read_text().count("\n") == len(LOG)
    assert "kept-2.txt" in lines[0]
    assert len(advice_in(lines)) == 4


def test_someone_who_cannot_hold_it_still_is_told(tmp_path):
    path = tmp_path / "shaky.csv"
    turns = [(k % 3, (-1) ** k * 20.0, 0.5) for k in range(60)]
    path.write_text(HEADER + text_of(log_of(12.0, *turns)))
    os.utime(path, (0, 0))
    _, lines = coached(path)
    assert any("no rest for 20 s: put it down" in line for line in lines)


def test_errors(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        coached(tmp_path / "none.csv")
    with pytest.raises(InputError, match="expected lines of a log, got none"):
        coached(tmp_path / "none.csv", follow=True, idle_s=0.1)
    path = tmp_path / "bare.csv"
    path.write_text(text_of(LOG))
    # hints are missing: that is said at once, not after waiting
    with pytest.raises(InputError, match="columns"):
        coached(path, follow=True, idle_s=600.0)
    path.write_text(text_of(LOG[:20]))
    with pytest.raises(InputError, match="columns"):
        coached(path, follow=True, idle_s=0.1)


def test_a_serial_line(tmp_path):
    """What is coached along a serial line is what is coached along a file of the same samples."""
    pytest.importorskip("serial")
    rows = LOG[::5]  # 10 Hz is enough to see who rests
    file = tmp_path / "hand.csv"
    file.write_text(HEADER + text_of(rows))
    os.utime(file, (0, 0))
    by_file, stated = coached(file)
    master, slave = os.openpty()
    tty.setraw(slave)
    lines: list[str] = []

    def send():
        while not any("connected" in line for line in lines):  # what came before it is opened is dropped
            time.sleep(0.01)
        for row in rows:
            write_all(master, text_of([row]).encode())
        time.sleep(0.5)
        os.close(slave)
        os.close(master)

    thread = threading.Thread(target=send)
    try:
        address = Path(f"serial:{os.ttyname(slave)}?retry=0&format=text")
        thread.start()
        recording = run_coach(address, SPEC, latitude=LAT, out=lines.append, keep=tmp_path / "kept.txt")
    finally:
        thread.join()
    by_wire, imu = recording.need_imu(), by_file.need_imu()
    assert np.array_equal(by_wire.t - by_wire.t[0], imu.t - imu.t[0])
    assert np.array_equal(by_wire.gyro, imu.gyro)
    assert np.array_equal(by_wire.accel, imu.accel)
    assert advice_in(lines) == advice_in(stated)
    assert (tmp_path / "kept.txt").read_text().count("\n") == len(rows)


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("serial:/dev/null?speed=1", "option"),
        ("udp://:0", "port"),
        ("serial:/dev/null?format=text&units=parsec", "units"),
    ],
)
def test_addresses_that_are_none(tmp_path, address, reason):
    with pytest.raises(InputError, match=reason):
        run_coach(Path(address), SPEC, latitude=LAT, out=lambda _: None, keep=tmp_path / "kept.txt")
