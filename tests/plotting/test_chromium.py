"""Every kind of report in Chromium, wide and narrow: all figures are drawn, and answer to mouse, legend and window."""

import chromium
import figure_cases as cases
import noise_cases
import numpy as np
import pytest
import result_cases
from places import EXAMPLES

from schuler.recording import ImuSeries

pytestmark = chromium.needed


def navigation(folder, request):
    run = request.getfixturevalue("full")
    return run.result.report(folder / "r.html", smoothed=run.smoothed, reference=run.truth, gnss=run.gnss)


def noise(folder, request):
    return noise_cases.identification().report(folder / "r.html")


def calibration(folder, request):
    return result_cases.full().report(folder / "r.html")


def diagnosis(folder, request):
    import schuler
    from schuler.simulation.scenario import Scenario

    scenario = Scenario.parse({
        "name": "short", "seed": 3, "imu": {"rate_hz": 50.0, "catalogue": "MPU-6000"}, "gnss": {"rate_hz": 1.0},
        "motion": {
            "type": "manoeuvres", "lat_deg": 48.0, "lon_deg": 11.0, "speed_m_s": 10.0,
            "manoeuvres": [{"duration_s": 30.0, "turn_deg": 90.0}, {"duration_s": 30.0, "turn_deg": -90.0}],
        },
    })  # fmt: skip
    return schuler.check(schuler.simulate(scenario)).report(folder / "r.html")


def command(*arguments):
    from schuler.cli import main

    assert main([str(a) for a in arguments]) == 0


def budget(folder, request):
    mission = EXAMPLES / "budget_town.toml"
    command("budget", mission, "--imu", "MPU-6000", "--time", 140, "--no-figures", "--out", folder)
    return folder / "report.html"


def observability(folder, request):
    command("observability", EXAMPLES / "observability_rotary_y.toml", "--report", "--out", folder)
    return folder / "report.html"


def rotary(folder, request):
    scenario = folder / "short.toml"
    scenario.write_text(cases.module("cli/test_rotary.py").SHORT)
    command("rotary", scenario, "--report", folder / "r.html", "--runs", 2)
    return folder / "r.html"


def montecarlo(folder, request):
    scenario = folder / "short.toml"
    scenario.write_text(cases.module("cli/test_montecarlo.py").FILE)
    command("montecarlo", scenario, "--workers", 1, "--store", folder / "store", "--out", folder / "out")
    return folder / "out" / "report.html"


def book(folder, request):
    from schuler.plotting.figure import Figure, Line, Panel
    from schuler.reproduce import Effort, Item, Outcome, Result, digits
    from schuler.reproduce.book import write_book
    from schuler.reproduce.run import Reproduction

    def figure():
        t = np.linspace(0.0, 10.0, 50)
        lines = (Line(t, t, "reference", "printed"), Line(t, 1.01 * t, "filtered", "ours"))
        return Figure("growth", "Growth", "How to read it.", (Panel("Time [s]", "Error [m]", lines),))

    item = Item("fig-1.1", "Growth", "exact", lambda effort: Outcome(()))
    result = Result(item, Outcome((digits("x", "1.0", 1.01),), "", (figure,)), 0.1)
    return write_book([Reproduction("du", (result,), Effort())], folder / "r.html")


def history(folder, request):
    from schuler.calibration import history_of

    return history_of(cases.module("calibration/result/test_unit_history.py").unit(1, shift=8.0)).report(
        folder / "r.html"
    )


KINDS = {f.__name__: f for f in (
    navigation, noise, calibration, diagnosis, budget, observability, rotary, montecarlo, book, history
)}  # fmt: skip


@pytest.fixture(scope="module", params=KINDS)
def report(request, tmp_path_factory):
    """Kind and path of a report of each kind."""
    return request.param, KINDS[request.param](tmp_path_factory.mktemp(request.param), request)


UNDRAWN = """Array.from(document.querySelectorAll('.plot')).filter(p => {
  const svg = p.querySelector('svg.main-svg'), drawn = svg && svg.getBoundingClientRect().width > 50;
  if (!drawn) p.scrollIntoView();
  return !drawn;
}).length"""

MISFITS = """Array.from(document.querySelectorAll('.plot')).filter(p => Math.abs(
  p.querySelector('svg.main-svg').getBoundingClientRect().width - p.getBoundingClientRect().width) > 2).length"""

#: Where in the window a point of the first plot that has one is drawn, or null; the mouse shows its value there.
POINT = """(() => { for (const plot of document.querySelectorAll('.plot')) {
  const trace = plot.data.find(d => d.hoverinfo !== 'skip' && d.x && d.x.length && d.visible !== false);
  if (!trace) continue;
  plot.scrollIntoView({block: 'center', behavior: 'instant'});
  const {xaxis, yaxis} = plot._fullLayout, box = plot.getBoundingClientRect();
  const decoded = plot._fullData[plot.data.indexOf(trace)];
  for (let k = Math.floor(decoded.x.length / 2); k < decoded.x.length; k++) {
    const px = xaxis.d2p(decoded.x[k]), py = yaxis.d2p(decoded.y[k]);
    if (px > 0 && py > 0 && px < xaxis._length && py < yaxis._length)
      return [box.x + xaxis._offset + px, box.y + yaxis._offset + py];
  }
} return null; })()"""


def check_page(page):
    """Every figure is drawn, nothing is amiss, asked for, or too wide."""
    chromium.wait_for(page, f"{UNDRAWN} === 0")
    seen = chromium.seen(page)
    assert seen.errors == ()
    assert seen.requests == ()
    assert seen.overflow <= 0.0
    assert len(seen.text) > 300


def check_legend(page):
    """A click on the first word of the first legend hides what it stands for, another one shows it again."""
    name = chromium.run(page, "document.querySelector('.keys button').dataset.figure")
    plots = f"Array.from(document.querySelectorAll('.plot[data-figure=\"{name}\"]'))"
    shapes = f"{plots}.map(p => p.querySelectorAll('.trace path, .trace rect').length)"
    hidden = f"{plots}.flatMap(p => p.data).filter(d => d.visible === false).length"
    before = chromium.run(page, shapes)
    assert chromium.run(page, hidden) == 0
    chromium.click(page, ".keys button")
    chromium.wait_for(page, f"{hidden} > 0")
    assert sum(chromium.run(page, shapes)) < sum(before)
    chromium.click(page, ".keys button")
    chromium.wait_for(page, f"{hidden} === 0")
    assert chromium.run(page, shapes) == before


def check_mouse(page):
    """What is under the mouse is named."""
    assert chromium.run(page, POINT)  # scrolls there
    chromium.settle(page)
    x, y = chromium.run(page, POINT)
    for step in (6.0, 3.0, 0.0):
        chromium.mouse(page, "mouseMoved", x + step, y)
        chromium.settle(page)
    chromium.wait_for(page, "document.querySelector('.hoverlayer .hovertext')")
    assert chromium.run(page, "document.querySelector('.hoverlayer').textContent")


def check_window(page):
    """The figures take the width of a smaller window."""
    width = "document.querySelector('.plot').getBoundingClientRect().width"
    before = chromium.run(page, width)
    chromium.resize(page, 700)
    chromium.wait_for(page, f"{width} !== {before} && {MISFITS} === 0")
    assert chromium.run(page, "document.documentElement.scrollWidth") <= 700


@pytest.mark.thinned(4)
def test_report_answers_at_a_desk(report):
    kind, path = report
    with chromium.opened(path, 1280) as page:
        check_page(page)
        if kind != "observability":  # its curves are named in the plot itself, so it has neither legend nor labels
            check_legend(page)
            check_mouse(page)
        check_window(page)
        assert chromium.errors(page) == ()
        assert chromium.requests(page) == ()


@pytest.mark.campaign
def test_report_fits_a_phone(report):
    with chromium.opened(report[1], 390) as page:
        check_page(page)


OVER_TIME = "Array.from(document.querySelectorAll('.plot[data-time]'))"
RANGES = f"{OVER_TIME}.map(p => p._fullLayout.xaxis.range.map(v => Math.round(v * 1e3) / 1e3).join())"
TRACK = "document.querySelector('.plot[data-figure=track]')"
WIDTH = f"(r => r[1] - r[0])({TRACK}._fullLayout.xaxis.range)"


@pytest.mark.campaign
def test_one_zoom_and_one_time_for_all_figures_of_a_run(tmp_path, request):
    with chromium.opened(navigation(tmp_path, request), 1280) as page:
        chromium.wait_for(page, f"{UNDRAWN} === 0")
        before, wide = chromium.run(page, RANGES), chromium.run(page, WIDTH)
        heights = f"{OVER_TIME}.map(p => p._fullLayout.yaxis.range.join())"
        tall = chromium.run(page, heights)
        assert len(before) > 10
        check_mouse(page)  # on the track, which is the first figure
        shown = "Array.from(document.querySelectorAll('.cursor.{}')).filter(c => c.style.display === 'block').length"
        chromium.wait_for(page, f"{shown.format('now')} === {len(before)} && {shown.format('here')} === 1")
        chromium.run(page, f"Plotly.relayout({OVER_TIME}[3], {{'xaxis.range': [40, 60]}}) && 0")
        chromium.wait_for(page, f"{RANGES}.every(r => r === '40,60')")
        chromium.wait_for(page, f"{WIDTH} < {0.9 * wide}")
        assert sum(a != b for a, b in zip(tall, chromium.run(page, heights), strict=True)) > len(tall) / 2
        chromium.run(page, f"Plotly.relayout({OVER_TIME}[5], {{'xaxis.autorange': true}}) && 0")
        chromium.wait_for(page, f"{RANGES}.join(';') === '{';'.join(before)}'")
        chromium.wait_for(page, f"Math.abs({WIDTH} - {wide}) < 1e-6 * {wide}")
        assert chromium.errors(page) == ()


#: Words of the track that the buttons cover, as they do where the mouse is over it, and on screens that are touched.
COVERED = f"""Array.from({TRACK}.querySelectorAll('text')).filter(word => word.textContent.trim() && Array.from(
  {TRACK}.querySelectorAll('.modebar-group')).some(group => {{
    const a = word.getBoundingClientRect(), b = group.getBoundingClientRect();
    return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
  }})).map(word => word.textContent)"""


@pytest.mark.campaign
@pytest.mark.parametrize("width", [1280, 390])
def test_the_buttons_cover_no_word_of_the_track(tmp_path, request, width):
    with chromium.opened(navigation(tmp_path, request), width) as page:
        chromium.wait_for(page, f"{UNDRAWN} === 0")
        assert chromium.run(page, f"{TRACK}.querySelectorAll('.modebar-group').length") > 1
        assert chromium.run(page, f"{TRACK}.querySelectorAll('text').length") > 5
        assert chromium.run(page, COVERED) == []


LOG = "document.querySelector('.plot[data-figure=log]')"


def test_zoom_draws_the_samples_themselves_and_the_track_takes_a_colour(tmp_path, request):
    run = request.getfixturevalue("full")
    t = np.arange(*run.result.trajectory.t[[0, -1]], 0.01)
    accel = np.random.default_rng(3).normal((0.0, 0.0, -9.8), 0.1, (len(t), 3))
    path = run.result.report(
        tmp_path / "r.html", smoothed=run.smoothed, reference=run.truth, gnss=run.gnss,
        imu=ImuSeries(t, np.zeros((len(t), 3)), accel),
    )  # fmt: skip
    with chromium.opened(path, 1280) as page:
        chromium.wait_for(page, f"{UNDRAWN} === 0")
        thinned = chromium.run(page, f"{LOG}.data[0].x.length")
        assert 1000 < thinned <= 2000
        chromium.run(page, f"Plotly.relayout({OVER_TIME}[3], {{'xaxis.range': [40, 42]}}) && 0")
        chromium.wait_for(page, f"{LOG}.data[0].x.length < 250")
        x, y = (np.array(chromium.run(page, f"{LOG}.data[0].{name}")) for name in "xy")
        k = np.searchsorted(t - t[0], x - 0.005)
        assert len(x) >= 200
        assert np.array_equal(np.diff(k), np.ones(len(k) - 1))  # every one of them
        assert np.abs(y - accel[k, 0]).max() < 0.05  # rounded to half of what they change by
        assert (y[1:-1].min(), y[1:-1].max()) != pytest.approx((accel[:, 0].min(), accel[:, 0].max()), abs=0.05)
        low, high = chromium.run(page, f"{LOG}._fullLayout.yaxis.range")
        assert low < y.min() + 10.0  # its other axis shows them
        assert high > y.max()
        chromium.run(page, f"Plotly.relayout({OVER_TIME}[5], {{'xaxis.autorange': true}}) && 0")
        chromium.wait_for(page, f"{LOG}.data[0].x.length === {thinned}")
        menu = "document.querySelector('.menu select')"
        choose = "(m => {{ m.value = '{}'; m.dispatchEvent(new Event('change')); }})(" + menu + ")"
        coloured = f"{TRACK}.data.filter(d => d.mode === 'lines+markers').length"
        assert chromium.run(page, coloured) == 0
        chromium.run(page, choose.format(1))
        chromium.wait_for(page, f"{coloured} === 2")
        assert "more" in chromium.run(page, "document.querySelector('.menu .scale').textContent")
        chromium.run(page, choose.format(""))
        chromium.wait_for(page, f"{coloured} === 0")
        assert chromium.errors(page) == ()
