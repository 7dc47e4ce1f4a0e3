"""Calibration on the page: a rest rejected by hand on a real log, and the coach on a log that grows."""

import json
import os
import shlex
import subprocess
import sys
import time
import tty
from importlib.util import find_spec

import chromium
import numpy as np
import pytest
from workbench import Server, drag, press, type_into, write_all

from schuler.studio import jobs
from schuler.studio.workspace import Workspace

if find_spec("nicegui") is None:  # imported by the server alone, not by every process that collects tests
    pytest.skip("the workbench needs the extra studio", allow_module_level=True)

READING = """\
[recording.accel]
file = "xsens_acc.mat"
columns = "t,ax,ay,az"
units = "accel=counts"
[recording.gyro]
file = "xsens_gyro.mat"
columns = "t,gx,gy,gz"
units = "gyro=counts"
"""
COMMAND = "document.querySelector('.command pre')?.textContent"


def calibrated(folder, page, seen=()):
    """Wait for a calibration that was not seen before; its job and what it printed."""
    until = time.monotonic() + 120.0
    while (job := jobs.latest(folder, "calibrate")) is None or job.key in seen or job.state != "done":
        assert time.monotonic() < until
        chromium.settle(page)
    chromium.wait_for(page, f"document.querySelector('[data-source*=\"{job.key}\"]')", 60.0)
    return job, jobs.answer(folder, job.key)


def certified(folder, page, seen):
    """Type a serial number and press for a certificate: linked on the page, with the number and the results in it."""
    type_into(page, "serial number", "XS-0042")
    press(page, "report and certificate")
    job, _ = calibrated(folder, page, seen)
    assert job.command[job.command.index("--serial") + 1] == "XS-0042"
    text = (folder.root / job.out / "certificate.html").read_text()
    assert "XS-0042" in text
    links = chromium.run(page, "[...document.querySelectorAll('a')].map(a => a.textContent)")
    assert {"certificate.html", "calibration.html"} <= set(links)


def the_sphere_turns(page, rests):
    """Dragged to the right and turned by a key; a rest that is pointed at says what is left of it."""
    sphere = "document.querySelector('.chart.sphere')"
    chromium.wait_for(page, f"{sphere}.dataset.view", 60.0)
    marks = f"{sphere}.querySelectorAll('circle[r=\"4\"]')"
    assert chromium.run(page, f"{marks}.length") == rests
    view = f"{sphere}.dataset.view.split(',').map(Number)"
    yaw, pitch = chromium.run(page, view)
    x, y = chromium.centre(page, ".chart.sphere svg")
    radius = chromium.run(page, f"{sphere}.querySelector('svg').getBoundingClientRect().width") * 130 / 320
    chromium.mouse(page, "mouseMoved", x, y)
    chromium.mouse(page, "mousePressed", x, y, button="left", clickCount=1)
    chromium.mouse(page, "mouseMoved", x + 60.0, y, button="left", buttons=1)
    chromium.mouse(page, "mouseReleased", x + 60.0, y, button="left", clickCount=1)
    assert chromium.run(page, view) == pytest.approx([yaw - 60.0 / radius, pitch], abs=2e-4)  # printed digits
    key = "new KeyboardEvent('keydown', {key: 'ArrowUp', bubbles: true})"
    chromium.run(page, f"{sphere}.querySelector('svg').dispatchEvent({key})")
    assert chromium.run(page, view)[1] == pytest.approx(pitch - 0.1, abs=2e-4)
    chromium.run(page, f"[...{marks}].at(-1).setAttribute('id', 'nearest')")  # drawn last
    chromium.hover(page, "#nearest")
    assert " sigma" in chromium.run(page, f"{sphere}.querySelector('output').value")


@chromium.needed
@pytest.mark.campaign
@pytest.mark.realdata
def test_a_rest_rejected_by_hand_is_that_of_the_command(shared_data, tmp_path):
    from schuler.studio.rests import read_rests

    (tmp_path / "xsens").mkdir()
    for name in ("xsens_acc.mat", "xsens_gyro.mat"):
        (tmp_path / "xsens" / name).write_bytes((shared_data / "imu_tk_xsens" / name).read_bytes())
    (tmp_path / "xsens.toml").write_text(READING)
    folder, served = Workspace(tmp_path.resolve()), Server(tmp_path)
    try:
        with chromium.opened(served.page("/calibrate", log="xsens", config="xsens.toml"), 1400) as page:
            chromium.wait_for(page, "document.querySelector('.timeline').dataset.latency", 90.0)
            press(page, "calibrate")
            first, calibration = calibrated(folder, page)
            spans = (
                np.array(calibration["extra"]["intervals"]) - calibration["extra"]["intervals"][0][0]
            )  # the first begins the log
            drawn = "JSON.parse(document.querySelector('.timeline').dataset.windows)"
            windows = chromium.run(page, drawn)
            assert np.allclose([w[:2] for w in windows], spans, rtol=0.0, atol=1e-9)  # rounding
            the_sphere_turns(page, len(spans))
            drag(page, *[spans[13].mean()] * 2)
            second, _ = calibrated(folder, page, {first.key})
            assert chromium.run(page, drawn)[13][2] == "unused"
            drag(page, spans[0, 1] - 0.3, spans[0, 1] - 20.0)  # its last 20 s are left out
            third, by_page = calibrated(folder, page, {first.key, second.key})
            command = chromium.run(page, COMMAND)
            certified(folder, page, {first.key, second.key, third.key})
            row = "[...document.querySelectorAll('tbody tr')].find(r => r.cells[0].textContent === '14').textContent"
            assert "rejected" in chromium.run(page, row)
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
        with chromium.opened(served.page("/calibrate", log="xsens"), 390) as page:  # a browser that was closed
            calibrated(folder, page)
            assert chromium.run(page, drawn)[13][2] == "unused"
            assert chromium.overflow(page) <= 0.0
    finally:
        served.stop()
    words = shlex.split(command)
    rests = read_rests(tmp_path / words[words.index("--intervals") + 1])
    assert [rest.accepted for rest in rests] == [k != 13 for k in range(len(spans))]
    assert rests[0].stop == pytest.approx(spans[0, 1] - 20.0, abs=1.5)  # a pixel is 0.5 s
    words[words.index("--out") + 1] = "again"
    run = [sys.executable, "-m", *words, "--json"]
    answer = json.loads(subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout)
    differ = ("elapsed_s", "files")
    assert {k: v for k, v in by_page.items() if k not in differ} == {k: v for k, v in answer.items() if k not in differ}
    assert by_page["extra"]["poses"] == len(spans) - 1
    assert by_page["parameters"] != calibration["parameters"]


@chromium.needed
@pytest.mark.campaign
def test_the_coach_follows_a_log_that_grows(tmp_path):
    rng = np.random.default_rng(4)
    t = np.arange(1, 801) / 50.0
    readings = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -9.8]) + rng.standard_normal((800, 6)) * np.repeat((1e-4, 1e-3), 3)
    rows = [",".join(f"{v:.9g}" for v in row) + "\n" for row in np.column_stack((t, readings))]
    log = tmp_path / "hand.csv"
    log.write_text("t [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]\n" + "".join(rows[:300]))
    folder, served = Workspace(tmp_path.resolve()), Server(tmp_path)
    advice = "document.querySelector('.coach .next')?.textContent"
    try:
        with chromium.opened(served.page("/coach", log="hand.csv"), 390) as page:
            type_into(page, "IMU", "yaman-automotive")
            item = "[...document.querySelectorAll('.q-item')].find(i => i.textContent.includes('yaman-automotive'))"
            chromium.wait_for(page, item, 60.0)
            chromium.run(page, f"{item}.click()")
            type_into(page, "latitude", "39.9")
            chromium.wait_for(page, f"{COMMAND}?.includes('--latitude 39.9')", 60.0)
            log.touch()
            press(page, "coach me")
            chromium.wait_for(page, f"{advice}?.startsWith('lay it down')", 60.0)
            size = chromium.run(page, "parseFloat(getComputedStyle(document.querySelector('.coach .next')).fontSize)")
            assert size >= 28.0  # px on a phone
            with log.open("a") as file:
                file.writelines(rows[300:])
            chromium.wait_for(page, f"{advice}?.startsWith('turn ')", 60.0)
            assert chromium.overflow(page) <= 0.0
            press(page, "enough: calibrate")
            chromium.wait_for(page, "document.querySelector('.verdict.failed')", 90.0)  # one rest is not enough
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    finally:
        for job in jobs.jobs(folder):
            jobs.cancel(folder, job.key)
        served.stop()
    job = jobs.latest(folder, "calibrate", "field", "hand.csv")
    answer = jobs.answer(folder, job.key)
    assert (answer["method"], answer["status"]) == ("field", "refused")
    assert any("interrupted" in line for line in jobs.messages(folder, job.key))


@chromium.needed
@pytest.mark.campaign
def test_the_coach_follows_a_serial_port(tmp_path):
    """A pseudo-terminal in the place of the port: advice on a phone, and the samples kept in the folder of the run."""
    pytest.importorskip("serial")
    rng = np.random.default_rng(4)
    t = np.arange(1, 801) / 50.0
    readings = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -9.8]) + rng.standard_normal((800, 6)) * np.repeat((1e-4, 1e-3), 3)
    rows = [",".join(f"{v:.9g}" for v in row) + "\n" for row in np.column_stack((t, readings))]
    master, slave = os.openpty()
    tty.setraw(slave)
    folder, served = Workspace(tmp_path.resolve()), Server(tmp_path)
    advice = "document.querySelector('.coach .next')?.textContent"
    try:
        with chromium.opened(served.page("/coach"), 390) as page:
            type_into(page, "port", f"serial:{os.ttyname(slave)}?format=text")
            type_into(page, "IMU", "yaman-automotive")
            item = "[...document.querySelectorAll('.q-item')].find(i => i.textContent.includes('yaman-automotive'))"
            chromium.wait_for(page, item, 60.0)
            chromium.run(page, f"{item}.click()")
            type_into(page, "latitude", "39.9")
            chromium.wait_for(page, f"{COMMAND}?.includes('serial:') && {COMMAND}.includes('--latitude 39.9')", 60.0)
            press(page, "coach me")
            until = time.monotonic() + 60.0
            while not any("connected" in line for job in jobs.jobs(folder) for line in jobs.messages(folder, job.key)):
                assert time.monotonic() < until
                chromium.settle(page)
            for row in rows:
                write_all(master, row.encode())
            chromium.wait_for(page, f"{advice}?.startsWith('turn ')", 60.0)
            press(page, "enough: calibrate")
            chromium.wait_for(page, "document.querySelector('.verdict.failed')", 180.0)  # one rest is not enough
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
            assert chromium.overflow(page) <= 0.0
    finally:
        for job in jobs.jobs(folder):
            jobs.cancel(folder, job.key)
        served.stop()
        os.close(master)
        os.close(slave)
    kept = np.loadtxt(tmp_path / jobs.jobs(folder)[0].out / "field-log.txt", delimiter=",")
    assert np.array_equal(kept, np.loadtxt(rows, delimiter=","))
