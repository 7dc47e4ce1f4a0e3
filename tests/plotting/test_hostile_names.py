"""Names out of files that look like markup or a template are shown as text by every page: nothing of them is run."""

import json
from dataclasses import replace
from urllib.parse import quote

import chromium
import figure_cases as cases
import noise_cases
import pytest
import result_cases
from places import EXAMPLES
from workbench import Server

from schuler.plotting.figure import TIME, Figure, Panel, Text, line
from schuler.plotting.interactive import panel_data

pytestmark = chromium.needed

#: A comment that swallows the rest of a page, a script, an event, a style, a value of plotly's templates, an entity.
NAME = "<!--<script>window.struck=1</script><img src=x onerror=window.struck=1><b>7 %{y} &amp;"
OF_FILE = NAME.replace("/", "")


def navigation(folder, request):
    run = request.getfixturevalue("full")
    result = replace(run.result, notes=(*run.result.notes, NAME))
    return result.report(folder / "r.html", title=NAME, smoothed=run.smoothed, gnss=run.gnss)


def compare(folder, request):
    from schuler.navigation import compare_runs

    run = request.getfixturevalue("full")
    paths = [run.result.to_parquet(folder / f"{k}{OF_FILE}.parquet") for k in range(2)]
    return compare_runs(paths).report(folder / "r.html")


def noise(folder, request):
    return noise_cases.identification(name=NAME).report(folder / "r.html", title=NAME)


def calibrated():
    from schuler.calibration import Session, with_session

    return with_session(result_cases.full(), Session(NAME, NAME, NAME, "2024-05-01"))


def calibration(folder, request):
    return calibrated().report(folder / "r.html", title=NAME)


def certificate(folder, request):
    from schuler.calibration.report.certificate import calibration_certificate

    return calibration_certificate(calibrated(), folder / "r.html")


def history(folder, request):
    from schuler.calibration import Session, history_of, with_session

    unit = cases.module("calibration/result/test_unit_history.py").unit(1, shift=8.0)
    dated = [with_session(one, Session(NAME, NAME, NAME, date)) for date, one in unit.items()]
    return history_of(dict(zip(unit, dated, strict=True))).report(folder / "r.html")


def check(folder, request):
    import schuler

    log = cases.short_log()
    return schuler.check(replace(log, metadata=replace(log.metadata, name=NAME))).report(folder / "r.html")


def points(folder, request):
    from schuler.navigation.report.points import points_report

    return points_report(cases.single_points(True), folder / "r.html", title=NAME, provenance={NAME: {NAME: NAME}})


def command(*arguments):
    from schuler.cli import main

    assert main([str(a) for a in arguments]) == 0


def named(folder, example):
    """A scenario of the examples with the name in place of its own."""
    rows = (EXAMPLES / example).read_text().splitlines()
    k = next(k for k, row in enumerate(rows) if row.startswith("name = "))
    (folder / "scenario.toml").write_text("\n".join([*rows[:k], f"name = {json.dumps(NAME)}", *rows[k + 1 :]]))
    return folder / "scenario.toml"


def budget(folder, request):
    mission = named(folder, "budget_town.toml")
    command("budget", mission, "--imu", "MPU-6000", "--time", 140, "--no-figures", "--out", folder)
    return folder / "report.html"


def observability(folder, request):
    command("observability", named(folder, "observability_rotary_y.toml"), "--report", "--out", folder)
    return folder / "report.html"


def held(page, *, plots=True):
    """Nothing of the name was run or taken for markup, and it can be read."""
    if plots:
        drawn = "p => (p.scrollIntoView(), p.querySelector('svg.main-svg'))"
        chromium.wait_for(page, f"Array.from(document.querySelectorAll('.plot')).every({drawn})")
    seen = chromium.seen(page)
    assert seen.errors == ()
    assert chromium.run(page, "typeof window.struck") == "undefined"
    assert chromium.run(page, "document.querySelectorAll('img[src=x]').length") == 0
    return " ".join(chromium.run(page, "document.body.textContent").split())


KINDS = (navigation, compare, noise, calibration, certificate, history, check, points, budget, observability)


@pytest.mark.campaign
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_page_shows_a_hostile_name_as_it_is(kind, tmp_path, request):
    with chromium.opened(kind(tmp_path, request), 1280) as page:
        assert (OF_FILE if kind is compare else NAME) in held(page)
        assert chromium.run(page, "document.querySelectorAll('svg tspan[style*=bold], svg a').length") == 0


@pytest.mark.campaign
def test_the_workbench_shows_a_hostile_name_as_it_is(tmp_path):
    head = "t_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s"
    rows = [f"{0.01 * k:.2f},0.0,0.01,-9.81,0.0,0.001,0.0" for k in range(500)]
    (tmp_path / f"{OF_FILE}.csv").write_text("\n".join([head, *rows]) + "\n")
    server = Server(tmp_path)
    try:
        for path in ("/", "/navigate", "/noise", "/runs"):
            with chromium.opened(server.page(path, log=quote(f"{OF_FILE}.csv")), 1280) as page:
                shown = "document.body.innerText + [...document.querySelectorAll('input')].map(i => i.value).join(' ')"
                if path != "/runs":
                    chromium.wait_for(page, f"({shown}).includes('struck')", 60.0)
                    assert OF_FILE in chromium.run(page, shown)
                held(page, plots=False)
    finally:
        server.stop()


def test_words_of_a_figure_are_no_markup_to_plotly():
    items = (line([0.0, 1.0], [0.0, 1.0], "filtered", NAME), Text(0.0, 0.0, NAME))
    panel = Panel(TIME, NAME, items, y_ticks=((0.0, NAME),))
    data = panel_data(Figure("f", "F", "f", (panel,)), panel)
    layout = data["layout"]
    words = [layout["yaxis"]["title"]["text"], *layout["yaxis"]["ticktext"], layout["annotations"][0]["text"]]
    words.append(data["data"][0]["hovertemplate"].partition("<extra>")[2].removesuffix("</extra>"))
    for text in words:
        assert "<" not in text
        assert "%{" not in text
        assert text.replace("&lt;", "<").replace("&#123;", "{").replace("&amp;", "&") == NAME
