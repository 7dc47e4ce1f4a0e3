"""The workbench as a reader has it: a real server on 127.0.0.1, Chromium, nothing asked of any other machine."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import chromium
import numpy as np
import pytest
from workbench import Server, drag, press, type_into

from schuler.files import LISTED, read_toml

EXAMPLES = Path(__file__).parents[2] / "examples"
if find_spec("nicegui") is None:  # imported by the server alone, not by every process that collects tests
    pytest.skip("the workbench needs the extra studio", allow_module_level=True)

#: Wider than the page, narrower than the page.
WIDTHS = (1400, 390)


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """Folder with a simulated drive and its configuration."""
    from schuler.recording.io import read, write
    from schuler.simulation import simulate

    folder = tmp_path_factory.mktemp("town")
    write(simulate(EXAMPLES / "town.toml"), folder / "town.parquet")
    (folder / "drive.toml").write_text((EXAMPLES / "town_navigation.toml").read_text())
    fixes = np.degrees(read(folder / "town.parquet").gnss.llh[::10, 1::-1]).tolist()
    line = {"type": "LineString", "coordinates": fixes}
    road = {"type": "Feature", "properties": {"highway": "primary"}, "geometry": line}
    (folder / "roads.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [road]}))
    return folder


@pytest.fixture(scope="module")
def server(town):
    served = Server(town)
    yield served
    served.stop()


def navigated(page):
    """Press navigate and wait for the verdict; the command as it was shown, and the table's numbers."""
    command = chromium.run(page, "document.querySelector('.command pre').textContent")
    out = command.split("--out ")[1].split()[0]
    press(page, "navigate")
    chromium.wait_for(page, f"document.querySelector('.verdict b')?.textContent.startsWith({json.dumps(out)})", 120.0)
    cell = "(c => c.querySelector('data')?.value ?? c.textContent)"
    rows = chromium.run(page, f"[...document.querySelectorAll('tbody tr')].map(r => [...r.cells].map({cell}))")
    return command, out, rows


def words_after(command, option):
    """Value of an option in a command as it is shown."""
    words = shlex.split(command)
    return words[words.index(option) + 1]


def the_same_by_command(folder, command, out, rows):
    """The command that was shown gives the same file of numbers, and the page has them to the last digit."""
    words = command.split()
    words[words.index(out)] = f"{out}-again"
    answer = subprocess.run(
        [sys.executable, "-m", *words, "--json"], cwd=folder, capture_output=True, text=True, check=True
    )
    numbers = json.loads(answer.stdout)
    by_page = json.loads((folder / out / "metrics.json").read_text())
    assert by_page == {k: v for k, v in numbers.items() if k not in ("command", "elapsed_s", "files")}
    shown = {row[0]: row[1:] for row in rows}
    assert float(shown["rms_horizontal_m"][0]) == numbers["rms_horizontal_m"]
    assert float(shown["rms_horizontal_m"][1]) == numbers["smoothed"]["rms_horizontal_m"]
    drawn = numbers["outages"][-1]
    assert [float(cell) for cell in rows[-1][:3]] == [drawn[k] for k in ("start_s", "stop_s", "max_horizontal_m")]


def test_who_is_let_in_and_what_is_given(server, town):
    (town.parent / "secret.txt").write_text("not yours")
    assert server.ask("/", Cookie="")[0] == 403
    assert server.ask("/", Host="rebound.example")[0] == 403
    assert server.ask("/studio/uploads/x.csv", "PUT", b"1", Origin="https://example.org")[0] == 403
    assert server.ask("/")[0] == 200
    for path in (
        "../secret.txt",
        "..%2fsecret.txt",
        "%2e%2e/secret.txt",
        "x/../../secret.txt",
        "%2fetc%2fpasswd",
        ".h",
    ):
        status, body = server.ask(f"/studio/files/{path}")
        assert status in (400, 404)
        assert b"not yours" not in body
    assert server.ask("/studio/files/drive.toml") == (200, (town / "drive.toml").read_bytes())
    assert server.ask("/studio/views/none/signals")[0] == 400
    assert server.ask("/studio/assets/nothing.js")[0] == 404


def test_uploads_arrive_once_and_a_wrong_file_does_not_end_the_server(server, town):
    assert server.ask("/studio/uploads/junk.bin", "PUT", bytes(range(256)) * 4096)[0] == 200
    assert (town / "junk.bin").stat().st_size == 1 << 20
    status, body = server.ask("/studio/uploads/junk.bin", "PUT", b"other")
    assert (status, b"is kept" in body) == (400, True)
    assert server.ask("/studio/uploads/..%2fx", "PUT", b"1")[0] in (400, 404, 405)
    assert not (town.parent / "x").exists()
    if chromium.PROGRAM is not None:
        with chromium.opened(server.page("/", log="junk.bin"), 1400) as page:
            chromium.wait_for(page, "document.querySelector('.finding.error')", 60.0)
            assert chromium.errors(page) == ()
    assert server.ask("/")[0] == 200
    (town / "junk.bin").unlink()


@chromium.needed
@pytest.mark.parametrize("path", ["/", "/navigate", "/noise", "/calibrate", "/coach", "/plan", "/runs"])
@pytest.mark.thinned(7)
def test_pages_fit_ask_nobody_else_and_say_no_error(server, path):
    for width in WIDTHS:
        with chromium.opened(server.page(path), width, dark=width == 390) as page:
            chromium.wait_for(page, "document.querySelector('header.bar a[aria-current]')", 60.0)
            seen = chromium.seen(page)
            assert (seen.errors, seen.requests) == ((), ())
            assert seen.overflow <= 0.0


@chromium.needed
def test_a_log_is_looked_at(server, town):
    from schuler.studio.signals import Views
    from schuler.studio.statistics import span_statistics

    with chromium.opened(server.page("/", log="town.parquet"), 1400) as page:
        chromium.wait_for(page, "document.querySelector('.signals').dataset.latency", 90.0)
        assert chromium.run(page, "document.querySelector('.signals').data.length") == 9
        assert "schuler check town.parquet" in chromium.run(page, "document.querySelector('.command pre').textContent")
        before = chromium.run(page, "document.querySelector('.signals').dataset.window")
        chromium.run(page, "document.querySelector('.signals').focus()")
        for kind in ("keyDown", "keyUp"):
            chromium.call(
                page.browser, "Input.dispatchKeyEvent", page.session, type=kind, key="+", text="+"[: kind == "keyDown"]
            )
        chromium.wait_for(page, f"document.querySelector('.signals').dataset.window !== {json.dumps(before)}")
        start, stop = map(float, chromium.run(page, "document.querySelector('.signals').dataset.window").split(","))
        caption = "document.querySelector('details caption')?.textContent"
        chromium.wait_for(page, f"{caption} === 'from {start:.3f} to {stop:.3f} s'")
        cells = "[...r.querySelectorAll('data')].map(d => d.value)"
        numbers = chromium.run(page, f"[...document.querySelectorAll('details tbody tr')].map(r => {cells})")
        rows = span_statistics(Views().open(town / "town.parquet", {}), start, stop)
        wanted = [[r.samples, r.mean, r.standard_deviation, r.minimum, r.maximum] for r in rows]
        assert [list(map(float, row)) for row in numbers] == wanted
        for name, panels in (("spectrum", 2), ("spectrogram", 2)):  # of what is visible, once it is unfolded
            figure = f"document.querySelector('[data-source*=\"/{name}?\"]')"
            assert not chromium.run(page, f"{figure}.dataset.drawn")
            chromium.run(page, f"{figure}.closest('details').open = true")
            chromium.wait_for(page, f"{figure}.querySelectorAll('.js-plotly-plot').length === {panels}", 60.0)
            assert f"start={start}&stop={stop}" in chromium.run(page, f"{figure}.dataset.drawn")
        assert chromium.errors(page) == ()


@pytest.mark.campaign
@chromium.needed
def test_a_question_that_a_log_leaves_open_is_answered_by_a_button(server, town):
    """At rest nothing tells the unit of angular rate: Look reads with the answer, Navigate asks on for fixes."""
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((6000, 6)) * np.repeat((0.02, 0.002), 3)  # m/s^2, and one unit or the other
    noise[:, 2] -= 9.81
    table = np.column_stack((np.arange(6000) / 100.0, noise))
    log = town / "rest.csv"
    np.savetxt(log, table, delimiter=",", fmt="%.6f", header="t,ax,ay,az,gx,gy,gz", comments="")
    question = "document.querySelector('.finding.warning')?.textContent.includes('unit of angular rate')"
    answers = "[...document.querySelectorAll('.finding.warning button')].map(b => b.textContent.trim())"
    try:
        with chromium.opened(server.page("/", log="rest.csv"), 1400) as page:
            chromium.wait_for(page, question, 60.0)
            assert chromium.run(page, answers) == ["deg/s", "rad/s"]
            assert not chromium.run(page, "document.querySelector('.signals').dataset.latency")
            press(page, "deg/s")
            chromium.wait_for(page, "document.querySelector('.signals').dataset.latency", 60.0)
            command = chromium.run(page, "document.querySelector('.command pre').textContent")
            rate = chromium.run(
                page, "document.querySelector('.signals').data.filter(c => c.y).map(c => Math.max(...c.y))"
            )
            assert not chromium.run(page, question)
            assert chromium.errors(page) == ()
        assert "gyro=deg/s" in command
        largest = table[:, 4].max()  # signals are drawn in deg/s
        assert np.abs(np.array(rate) - largest).min() < 1e-5 * largest  # printed: six digits
        with chromium.opened(server.page("/navigate", log="rest.csv"), 1400) as page:
            press(page, "propose")
            chromium.wait_for(page, question, 60.0)
            press(page, "rad/s")
            chromium.wait_for(page, "document.body.textContent.includes('there are no fixes')", 60.0)
            assert not chromium.run(page, "document.querySelector('.finding.warning button')")
    finally:
        log.unlink()


def choose(page, label, text):
    """Choose an entry of the menu with this label."""
    chromium.wait_for(page, f"document.querySelector('input[aria-label=\"{label}\"]')", 60.0)
    chromium.run(page, "document.querySelectorAll('details').forEach(d => d.open = true)")
    chromium.click(page, f'.q-field:has(input[aria-label="{label}"]) .q-field__control')
    item = f"[...document.querySelectorAll('.q-item')].find(i => i.innerText.trim() === {json.dumps(text)})"
    chromium.wait_for(page, item, 60.0)
    chromium.run(page, f"{item}.click()")


@chromium.needed
@pytest.mark.campaign
def test_columns_units_and_axes_are_chosen_by_menus(server, town):
    """A log whose words nobody knows, gravity up and in g: the findings follow every choice."""
    rng = np.random.default_rng(5)
    rates, force = rng.standard_normal((3000, 3)) * 0.3, rng.standard_normal((3000, 3)) * 1e-3 + (0.0, 0.0, 1.0)
    table = np.column_stack((np.arange(3000) / 100.0, rates, force))
    log, names = town / "words.csv", ("t", "gx", "gy", "gz", "ax", "ay", "az")
    np.savetxt(log, table, delimiter=",", fmt="%.6f", header="a,b,c,d,e,f,g", comments="")
    command = "document.querySelector('.command pre')?.textContent"
    try:
        with chromium.opened(server.page("/", log="words.csv"), 1400) as page:
            chromium.wait_for(page, "document.querySelector('input[aria-label=\"column 1\"]')", 60.0)
            for label, text, word in (
                *((f"column {k + 1}", name, f"{name}," if k < 6 else "ax,ay,az") for k, name in enumerate(names)),
                ("unit of accel", "g", "accel=g"),
                ("unit of gyro", "deg/s", "gyro=deg/s"),
                ("axes", "FLU", "--axes FLU"),
            ):
                choose(page, label, text)
                chromium.wait_for(page, f"{command}?.includes({json.dumps(word)})", 60.0)
            chromium.wait_for(page, "document.querySelector('.signals').dataset.latency", 60.0)
            down = "document.querySelector('.signals').data.find(c => c.name === 'z').y[9]"
            chromium.wait_for(page, f"Math.abs({down} + 9.80665) < 0.05", 60.0)
            assert chromium.overflow(page) <= 0.0
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    finally:
        log.unlink()


@pytest.mark.campaign
@chromium.needed
def test_an_outage_is_moved_and_the_cursor_is_on_the_track(server):
    at = "document.querySelector('.command pre')?.textContent.split('--outage ')[1]"
    with chromium.opened(server.page("/navigate", log="town.parquet", config="drive.toml"), 1400) as page:
        drag(page, 130.0, 145.0)
        chromium.wait_for(page, at, 60.0)
        start, stop = map(float, chromium.run(page, at).split(":"))
        drag(page, 138.0, 108.0)  # as a whole
        chromium.wait_for(page, f"{at} !== '{start:g}:{stop:g}'", 60.0)
        moved = [float(x) for x in chromium.run(page, at).split(":")]
        assert np.allclose(moved, (start - 30.0, stop - 30.0), rtol=0.0, atol=0.5)  # pixels
        drag(page, moved[1], moved[1] + 12.0)  # by its edge
        chromium.wait_for(page, f"!{at}.endsWith(':{moved[1]:g}')", 60.0)
        edges = [float(x) for x in chromium.run(page, at).split(":")]
        assert edges[0] == moved[0]
        assert edges[1] == pytest.approx(moved[1] + 12.0, abs=0.5)  # pixels
        chromium.wait_for(page, "document.querySelector('.plan').dataset.curves", 60.0)
        low, high = map(float, chromium.run(page, "document.querySelector('.timeline').dataset.window").split(","))
        width = chromium.run(page, "document.querySelector('.timeline .nsewdrag').getBoundingClientRect().width")
        t = 0.5 * (low + high) + 60.0 * (high - low) / width
        for _ in range(2):
            chromium.hover(page, ".timeline .nsewdrag", right=60.0)
        # fixes are a second apart; the mark of where the drag ended may come first
        chromium.wait_for(page, f"Math.abs(document.querySelector('.plan').dataset.marked - {t}) < 1.0", 60.0)
        assert chromium.run(page, "getComputedStyle(document.querySelector('.vehicle')).display") == "block"
        assert chromium.errors(page) == ()


@chromium.needed
@pytest.mark.campaign
def test_a_run_with_an_outage_that_is_drawn_has_the_numbers_of_the_command(server, town):
    with chromium.opened(server.page("/navigate", log="town.parquet", config="drive.toml"), 1400) as page:
        drag(page, 130.0, 145.0)
        chromium.wait_for(page, "document.querySelector('.command pre').textContent.includes('--outage 1')")
        command, out, rows = navigated(page)
        plan = "document.querySelector('.plan')"
        chromium.wait_for(page, f"{plan}.dataset.curves === 'GNSS,filtered,smoothed'")
        drawn = len(chromium.run(page, f"{plan}.data.map(c => c.name)"))
        choose(page, "map", "roads.geojson")
        chromium.wait_for(page, f"{plan}.dataset.mapped === 'roads.geojson'", 60.0)
        assert chromium.run(page, f"{plan}.data.length") == drawn + 1
        press(page, "remove")
        chromium.wait_for(page, "!document.querySelector('.command pre').textContent.includes('--outage')")
        _, second, _ = navigated(page)
        choose(page, "against run", out)
        heads = "[...document.querySelectorAll('th')].map(h => h.textContent)"
        chromium.wait_for(page, f"{heads}.includes('{out}: smoothed')", 60.0)
        row = "[...document.querySelectorAll('tbody tr')].find(r => r.cells[0].textContent === 'rms_horizontal_m')"
        values = chromium.run(page, f"[...{row}.cells].slice(1).map(c => +c.querySelector('data').value)")
        metrics = [json.loads((town / name / "metrics.json").read_text()) for name in (second, out)]
        assert values == [v for m in metrics for v in (m["rms_horizontal_m"], m["smoothed"]["rms_horizontal_m"])]
        chromium.wait_for(page, f"{plan}.dataset.curves.includes('{out}')", 60.0)
        assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    the_same_by_command(town, command, out, rows)
    with chromium.opened(server.page("/runs"), 1400) as page:
        chromium.wait_for(page, f"document.body.textContent.includes({json.dumps(out)})", 60.0)
    status, report = server.ask(f"/studio/files/{out}/report.html")
    assert status == 200
    assert b"</html>" in report


@pytest.mark.campaign
@chromium.needed
def test_two_runs_are_compared_and_one_is_deleted_after_a_question(server, town):
    for name in ("first", "second"):
        (town / name).mkdir()
        (town / name / "metrics.json").write_text('{"rms_horizontal_m": 1.5}')
        (town / name / "run.json").write_text('{"log": "town.parquet"}')
        (town / name / LISTED).write_text('{"files": {"metrics.json": [], "run.json": []}}')
    with chromium.opened(server.page("/runs"), 1400) as page:
        for name in ("first", "second"):
            chromium.wait_for(page, f"document.querySelector('[aria-label=\"compare {name}\"]')", 60.0)
            chromium.click(page, f'[aria-label="compare {name}"]')
        chromium.wait_for(page, "document.querySelector('.command pre')?.textContent.includes('compare first second')")
        listed = "[...document.querySelectorAll('.finding b')].map(b => b.textContent).sort().join()"
        before = chromium.run(page, listed)
        type_into(page, "filter", "TOWN second")
        chromium.wait_for(page, f"{listed} === 'second'", 20.0)
        type_into(page, "filter", "second nowhere")
        chromium.wait_for(page, "document.body.innerText.includes('runs has all of these words')", 20.0)
        type_into(page, "filter", " ")
        chromium.wait_for(page, f"{listed} === {json.dumps(before)}", 20.0)
        press(page, "compare")
        chromium.wait_for(page, "document.querySelector('.hint.bad')?.textContent.startsWith('refused: first')", 60.0)
        for name, answer in (("first", 0), ("second", 1)):  # keep, delete: a dialog on its way in is no place to aim at
            chromium.click(page, f'[aria-label="delete {name}"]')
            asked = f"[...document.querySelectorAll('.q-dialog')].find(d => d.innerText.includes('Delete {name}'))"
            chromium.wait_for(page, asked, 20.0)
            chromium.run(page, f"{asked}.querySelectorAll('button')[{answer}].click()")
            chromium.wait_for(page, "!document.querySelector('.q-dialog')", 20.0)
        chromium.wait_for(page, "!document.body.innerText.includes('second town')", 20.0)
        assert chromium.errors(page) == ()
    assert [(town / name).is_dir() for name in ("first", "second")] == [True, False]


def the_allan_curve_answers(page):
    """A term is switched off, a line of slope -1/2 is shown, dragged to half of its level, and typed."""
    drawn = "document.querySelector('.chart.allan').dataset.drawn"
    chromium.wait_for(page, f"{drawn}?.split(',').includes('N')", 60.0)
    boxes = "[...document.querySelectorAll('.chart.allan label')]"
    chromium.run(page, f"{boxes}.find(l => l.textContent.trim() === 'N').click()")
    assert "N" not in chromium.run(page, drawn).split(",")
    chromium.run(page, f"{boxes}.findLast(l => l.textContent.trim() === 'N').click()")
    assert "N" in chromium.run(page, drawn).split(",")
    field = "+document.querySelector('.allan input.level[data-letter=N]').value"
    before = chromium.run(page, field)
    chromium.centre(page, ".chart.allan .nsewdrag")
    line = """(() => {
        const e = document.querySelector('.chart.allan .js-plotly-plot'), f = e._fullLayout;
        const b = e.getBoundingClientRect(), c = e.data.find(d => d.meta === 'N'), k = 80;
        const at = v => f.yaxis.l2p(Math.log10(v)) + b.top + f.yaxis._offset;
        return [f.xaxis.l2p(Math.log10(c.x[k])) + b.left + f.xaxis._offset, at(c.y[k]), at(c.y[k] / 2)];
    })()"""
    x, y, lower = chromium.run(page, line)
    chromium.mouse(page, "mouseMoved", x, y)
    chromium.mouse(page, "mousePressed", x, y, button="left", clickCount=1)
    chromium.mouse(page, "mouseMoved", x, lower, button="left", buttons=1)
    chromium.mouse(page, "mouseReleased", x, lower, button="left", clickCount=1)
    assert chromium.run(page, field) == pytest.approx(0.5 * before, rel=0.03)  # a pixel
    typed = "Object.assign(document.querySelector('.allan input.level[data-letter=N]'), {value: '0.25'})"
    chromium.run(page, f"{typed}.dispatchEvent(new Event('change'))")
    named = "document.querySelector('.chart.allan .js-plotly-plot').data.find(d => d.meta === 'N').name"
    assert chromium.run(page, named).startswith("N 0.25 ")


@chromium.needed
@pytest.mark.campaign
def test_the_noise_of_a_span_is_that_of_the_command(town, tmp_path):
    """The drive stands still for its first 20 s and is too short for more than its white noise: that will do here."""
    from schuler.characterisation import identify_noise
    from schuler.cli.allan import numbers
    from schuler.cli.output import json_text
    from schuler.cli.reading import cut
    from schuler.recording.io import read
    from schuler.studio import jobs
    from schuler.studio.workspace import Workspace

    (tmp_path / "town.parquet").write_bytes((town / "town.parquet").read_bytes())
    served = Server(tmp_path)
    try:
        with chromium.opened(served.page("/noise", log="town.parquet"), 1400) as page:
            drag(page, 2.0, 18.0)
            chromium.wait_for(page, "document.querySelector('.command pre').textContent.includes('--from')")
            choose(page, "and write files for", "kalibr: Kalibr imu.yaml")
            chromium.wait_for(page, "document.querySelector('.command pre').textContent.includes('--export kalibr')")
            chromium.wait_for(page, "!document.querySelector('.q-menu')", 30.0)  # or it covers the button
            command = chromium.run(page, "document.querySelector('.command pre').textContent")
            press(page, "identify")
            chromium.wait_for(page, "document.querySelector('iframe.report')", 120.0)
            the_allan_curve_answers(page)
            links = chromium.run(page, "[...document.querySelectorAll('a[download]')].map(a => a.getAttribute('href'))")
            for link in links:
                assert served.ask(link)[0] == 200
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    finally:
        served.stop()
    folder = Workspace(tmp_path.resolve())
    by_page = jobs.answer(folder, jobs.latest(folder, "allan").key)
    assert {Path(link).name for link in links} == {Path(by_page["files"][what]).name for what in ("budget", "kalibr")}
    start, stop = (float(command.split(f"{option} ")[1].split()[0]) for option in ("--from", "--to"))
    noise = identify_noise(cut(read(town / "town.parquet"), start, stop))
    assert by_page["axes"] == json.loads(json_text(numbers(noise)))["axes"]
    assert 14.0 < by_page["duration_s"] < 18.0


@chromium.needed
@pytest.mark.campaign
def test_a_mission_with_another_imu_and_outage_is_that_of_the_command(tmp_path):
    from schuler.studio import jobs
    from schuler.studio.workspace import Workspace

    served = Server(tmp_path)
    try:
        with chromium.opened(served.page("/plan"), 1400) as page:
            press(page, "new mission")
            type_into(page, "gnss.outages_s", "[[60.0, 90.0]]")
            type_into(page, "IMU", "MTi-G-710")
            item = "[...document.querySelectorAll('.q-item')].find(i => i.textContent.includes('MTi-G-710'))"
            chromium.wait_for(page, item, 60.0)
            chromium.run(page, f"{item}.click()")
            shown = "document.querySelector('.command pre')?.textContent"
            chromium.wait_for(page, f"{shown}?.includes('MTi-G-710') && {shown}.includes('outages_s')", 60.0)
            command = chromium.run(page, shown)
            press(page, "work out the budget")
            chromium.wait_for(page, "document.querySelector('.verdict b')", 120.0)
            values = chromium.run(page, "[...document.querySelectorAll('td data')].map(d => d.value)")
            verdict = chromium.run(page, "document.querySelector('.verdict').textContent")
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    finally:
        served.stop()
    words = shlex.split(command)
    assert words[:4] == ["schuler", "budget", "mission.toml", "--imu"]
    out = words[words.index("--out") + 1]
    words[words.index(out)] = "again"
    run = [sys.executable, "-m", *words, "--json"]
    numbers = json.loads(subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout)
    folder = Workspace(tmp_path.resolve())
    by_page = jobs.answer(folder, jobs.latest(folder, "budget").key)
    differ = ("elapsed_s", "files")
    assert {k: v for k, v in by_page.items() if k not in differ} == {
        k: v for k, v in numbers.items() if k not in differ
    }
    budget = numbers["budgets"][0]["budget"]
    assert budget["time_s"] <= 90.0
    assert {budget["total"], *budget["by_group"].values()} <= set(map(float, values))
    assert all(text in verdict for text in numbers["sentences"])
    assert (tmp_path / out / "report.html").read_bytes() == (tmp_path / "again" / "report.html").read_bytes()


@chromium.needed
@pytest.mark.campaign
def test_the_platform_turns_and_the_menu_of_imus_closes(server, town):
    (town / "platform.toml").write_text((EXAMPLES / "rotary_static.toml").read_text())
    try:
        with chromium.opened(server.page("/plan"), 1400) as page:
            at = "+document.querySelector('.platform').dataset.t"
            chromium.wait_for(page, f"document.querySelector('.platform svg polygon') && {at} > 0.2", 60.0)
            press(page, "stop")
            stopped = chromium.run(page, at)
            chromium.settle(page)
            assert chromium.run(page, at) == stopped
            type_into(page, "IMU", "MTi-G-710")
            item = "[...document.querySelectorAll('.q-item')].find(i => i.textContent.includes('MTi-G-710'))"
            chromium.wait_for(page, item, 60.0)
            chromium.run(page, f"{item}.click()")
            chromium.wait_for(page, "!document.querySelector('.q-menu')", 30.0)
            assert chromium.errors(page) == ()
    finally:
        (town / "platform.toml").unlink()


@chromium.needed
@pytest.mark.campaign
def test_a_campaign_that_is_killed_goes_on_and_ends_as_the_command_does(tmp_path):
    from schuler.studio import jobs
    from schuler.studio.workspace import Workspace

    folder = Workspace(tmp_path.resolve())
    served = Server(tmp_path)
    try:
        with chromium.opened(served.page("/plan"), 1400) as page:
            press(page, "new campaign")
            type_into(page, "runs", "24")
            shown = "[...document.querySelectorAll('.command pre')].at(-1)?.textContent"
            chromium.wait_for(page, f"{shown}?.includes('--runs 24')", 60.0)
            words = shlex.split(chromium.run(page, shown))
            press(page, "simulate")
            store = tmp_path / words[words.index("--store") + 1]
            chromium.wait_for(page, "+document.querySelector('progress')?.value > 0", 120.0)
            os.kill(jobs.jobs(folder)[0].pid, signal.SIGKILL)
            chromium.wait_for(page, "document.querySelector('.bad')?.textContent.includes('runs that were')", 60.0)
            assert any(store.iterdir())
            press(page, "start again")
            chromium.wait_for(page, "document.querySelector('.verdict b')", 240.0)
            verdict = chromium.run(page, "document.querySelector('.verdict').textContent")
            assert (chromium.errors(page), chromium.requests(page)) == ((), ())
    finally:
        served.stop()
    by_page = jobs.answer(folder, jobs.latest(folder, "montecarlo").key)
    assert by_page["resumed"] > 0
    for option in ("--store", "--out"):
        words[words.index(option) + 1] = f"again{option}"
    run = [sys.executable, "-m", *words, "--json"]
    numbers = json.loads(subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout)
    assert by_page["rms"] == numbers["rms"]  # runs that were kept and those made after
    assert numbers["verdict"] in verdict


@chromium.needed
@pytest.mark.campaign
def test_a_worker_and_a_server_that_are_killed(town):
    from schuler.studio import jobs
    from schuler.studio.workspace import Workspace

    folder = Workspace(town.resolve())
    served = Server(town)
    with chromium.opened(served.page("/navigate", log="town.parquet", config="drive.toml"), 1400) as page:
        chromium.wait_for(page, "document.querySelector('.timeline').dataset.latency", 90.0)
        press(page, "navigate")
        chromium.wait_for(page, "document.querySelector('progress')", 60.0)
        job = jobs.jobs(folder)[0]
        os.kill(job.pid, signal.SIGKILL)
        chromium.wait_for(page, "document.querySelector('.bad')?.textContent.includes('killed')", 60.0)
        assert not (town / job.out).exists()
        press(page, "start again")
        chromium.wait_for(page, "document.querySelector('progress')", 60.0)
    served.stop(signal.SIGKILL)
    again = Server(town)
    try:
        with chromium.opened(again.page("/navigate"), 1400) as page:  # finds the run, or what came of it
            chromium.wait_for(page, "document.querySelector('.verdict')", 120.0)
            assert job.out in chromium.run(page, "document.querySelector('.verdict').textContent")
    finally:
        again.stop()


@chromium.needed
@pytest.mark.campaign
@pytest.mark.realdata
def test_the_files_of_a_drive_dropped_read_navigated(shared_data, tmp_path):
    """Files dropped, two of an IMU: which is meant is asked. Clock and axes are proposed, 15 s without GNSS drawn."""
    files = [shared_data / "rtkexp_drive" / name for name in ("imu_1934.csv", "gnss_1934_sf.pos")]
    (tmp_path / "copy").mkdir()
    files.append(tmp_path / "copy" / "imu_again.csv")
    files[-1].write_bytes(files[0].read_bytes())
    served = Server(tmp_path)
    try:
        with chromium.opened(served.page("/"), 1400) as page:
            chromium.wait_for(page, "document.querySelector('.drop input')", 60.0)
            match = chromium.call(
                page.browser, "Runtime.evaluate", page.session, expression="document.querySelector('.drop input')"
            )
            chromium.call(
                page.browser, "DOM.setFileInputFiles", page.session,
                files=[str(path) for path in files], objectId=match["result"]["objectId"],
            )  # fmt: skip
            until = time.monotonic() + 60.0
            while not all((tmp_path / path.name).is_file() for path in files):
                assert time.monotonic() < until
                chromium.settle(page)
        for path in files:
            assert (tmp_path / path.name).read_bytes() == path.read_bytes()
        with chromium.opened(served.page("/", log="."), 1400) as page:
            chromium.wait_for(page, "document.querySelector('.finding.warning')", 60.0)
            press(page, "imu_1934.csv")
            chromium.wait_for(page, "document.body.textContent.includes('recording.imu.axes')", 240.0)
            text = chromium.run(page, "document.body.textContent")
            assert "recording.imu.time = gps-tow:2374" in text
            assert "recording.imu.axes = BRU" in text
        with chromium.opened(served.page("/navigate", log="."), 1400) as page:
            press(page, "propose")
            chromium.wait_for(page, "document.querySelector('.finding.warning')", 60.0)
            press(page, "imu_1934.csv")
            chromium.wait_for(page, "document.querySelector('.command pre')?.textContent.includes('--config')", 400.0)
            proposed = words_after(chromium.run(page, "document.querySelector('.command pre').textContent"), "--config")
        with chromium.opened(served.page("/navigate", log=".", config=proposed), 1400) as page:
            drag(page, 120.0, 135.0)
            chromium.wait_for(page, "document.querySelector('.command pre').textContent.includes('--outage 1')")
            command, out, rows = navigated(page)
        assert read_toml(tmp_path / words_after(command, "--config"))["recording"]["imu"]["file"] == "imu_1934.csv"
        the_same_by_command(tmp_path, command, out, rows)
    finally:
        served.stop()
