"""The HTML report: self-contained, valid, complete, repeatable."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from html_pages import Page

from schuler.navigation.report import document
from schuler.navigation.report.document import navigation_report


@pytest.fixture(scope="module", autouse=True)
def small_script():
    """plotly's megabyte is put in by one test only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(document, "_plotly", lambda: "/* plotly */")
        yield


@pytest.fixture(scope="module")
def how(full):
    return {
        "smoothed": full.smoothed, "reference": full.truth, "truth_parameters": full.parameters,
        "title": "A <drive> & more", "origin": 0.0, "gnss": full.gnss,
        "recording_summary": "log: 100 s\n  IMU 5000 samples < 1\n  - gyro biases start from zero",
    }  # fmt: skip


@pytest.fixture(scope="module")
def source(full, how, tmp_path_factory):
    path = navigation_report(full.result, tmp_path_factory.mktemp("report") / "deep" / "report.html", **how)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source):
    return Page(source)


def test_it_is_a_well_formed_page(page, source):
    assert source.startswith("<!DOCTYPE html>")
    assert page.open == []
    assert page.all("html")[0]["lang"] == "en"
    assert len(page.all("h1")) == 1
    assert any(m.get("name") == "viewport" for m in page.all("meta"))
    assert page.text["title"][0].startswith("A <drive> & more")
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    for link in page.all("a"):
        assert link["href"][1:] in ids


def test_sections_stand_in_order(page):
    assert page.text["h2"] == [
        "Key numbers", "Motion", "Errors", "Outages", "Filtered against smoothed", "Parameters",
        "Innovations", "The log", "Notes", "Provenance",
    ]  # fmt: skip


def test_every_plot_has_data_a_label_and_every_figure_a_caption(page):
    data = page.figures
    plots = [a for a in page.all("div") if "data-panel" in a]
    assert {(a["data-figure"], int(a["data-panel"])) for a in plots} == {
        (n, k) for n, f in data.items() for k in range(len(f))
    }
    for a in plots:
        assert a["role"] == "img"
        assert len(a["aria-label"]) > 10
        panel = data[a["data-figure"]][int(a["data-panel"])]
        assert any(v is not None for trace in panel["data"] for v in trace["y"])
    assert len(page.all("figure")) == len(page.all("figcaption")) == len(data)
    assert all(len(t) > 40 and t.strip().endswith(".") for t in page.text["figcaption"])


def test_tracks_know_time_speed_and_sigma_of_their_points(page, full):
    traces = {t["name"]: t for t in page.figures["track"][0]["data"]}
    for role, result in (("filtered", full.result), ("smoothed", full.smoothed)):
        trace, way = traces[role], result.trajectory
        assert "1-sigma" in trace["hovertemplate"]
        t, speed, sigma = np.array([at[:3] for at in trace["customdata"]]).T
        k = np.searchsorted(way.t, t).clip(0, len(way.t) - 1)
        assert np.abs(way.t[k] - t).max() < 0.02  # thinned, rounded to what can be seen
        assert speed == pytest.approx(np.linalg.norm(way.v_eb_n[k], axis=1), abs=0.2)
        assert (sigma > 0.0).all()


def test_nothing_is_fetched(page, source):
    for _, attributes in page.elements:
        for key in ("src", "href", "data", "action", "poster", "srcset"):
            value = attributes.get(key)
            assert value is None or value.startswith(("#", "data:"))
    assert not re.search(r"https?://|url\(|@import|\bfetch\(|XMLHttpRequest", source)
    policy = next(m["content"] for m in page.all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    # plotly's own row of buttons offers to send the data to a server
    assert "showSendToCloud: false" in source


def test_all_notes_and_texts_are_escaped(page, source, full):
    listed = page.text["li"]
    assert all(note in listed for note in full.result.notes)
    assert "<b>markup</b>" not in source
    assert "<i>x</i>" not in source
    assert any("<i>x</i>" in t for t in page.text["td"])
    (pre,) = page.text["pre"]
    assert "IMU 5000 samples < 1" in pre
    assert "gyro biases" not in pre


def test_provenance_has_seed_and_hashes_and_no_clock(page, full):
    cells = page.text["td"]
    assert "ab" * 32 in cells
    assert "7" in cells
    rows = page.text["th"]
    assert "config.imu.mount" in rows
    assert "sources.log.csv" in rows
    assert not any("elapsed" in r for r in rows)
    assert str(full.result.provenance["elapsed_s"]) not in " ".join(cells)


def test_same_input_same_bytes(full, how, source, tmp_path):
    again = replace(full.result, provenance={**full.result.provenance, "elapsed_s": 123.4})
    assert navigation_report(again, tmp_path / "other.html", **how).read_text(encoding="utf-8") == source


def test_no_text_says_nan_and_no_number_is_one(page):
    assert "NaN" not in page.plain
    assert not re.search(r"\bnan\b", page.plain)


def test_without_a_reference(full, tmp_path):
    page = Page(full.result.report(tmp_path / "r.html").read_text())
    assert "Uncertainty" in page.text["h2"]
    assert "Errors" not in page.text["h2"]
    assert page.text["h1"] == ["a drive"]


def test_a_claim_alone_says_what_is_not_in_it(full, everything, tmp_path):
    """Fixes that are all off alike move the solution alike, unless a state stands for that."""
    texts = [Page(run.result.report(tmp_path / "r.html").read_text()).plain for run in (full, everything)]
    assert "an error that all its fixes share for minutes is not in that" in texts[0]
    assert "b_r" in everything.result.layout
    assert "fixes share" not in texts[1]


def test_against_fixes_at_the_antenna(full, tmp_path):
    away = replace(full.result, lever_arm_b=np.array([0.5, -0.3, -1.2]))
    page = Page(away.report(tmp_path / "r.html", reference=full.truth, at_antenna=True, gnss=full.gnss).read_text())
    assert "The way of the antenna" in page.text["figcaption"][0]


def test_smoothed_alone(full, tmp_path):
    page = Page(full.smoothed.report(tmp_path / "r.html", reference=full.truth).read_text())
    assert "smoothed" in page.text["th"]
    assert "filtered" not in page.text["th"]


@pytest.mark.parametrize(
    ("states", "options"),
    [
        (9, {}),
        (9, {"gnss": False, "outages": ()}),
        (21, {"gnss": False}),
        (15, {"stop": 0.5}),
        (15, {"stop": 0.1, "outages": ()}),
    ],
)
def test_unusual_runs(make_run, states, options, tmp_path):
    run = make_run(states, **options)
    page = Page(
        run.result.report(tmp_path / "r.html", smoothed=run.smoothed, reference=run.truth, origin=-5.0).read_text()
    )
    assert page.open == []
    assert ("Parameters" in page.text["h2"]) == (states > 9)
    assert ("Innovations" in page.text["h2"]) == options.get("gnss", True)
    assert any("INTERRUPTED" in t for t in page.text["p"]) == ("stop" in options)


def test_rejections_are_in_the_page(wild, tmp_path):
    text = Page(wild.result.report(tmp_path / "r.html", reference=wild.truth).read_text()).plain
    assert "GNSS fix rejected" in text
    assert "accepted after lock-out" in text


def test_plotly_accepts_all_of_it(page):
    """plotly checks names and values of every attribute; colours are put in as the page does."""
    go = pytest.importorskip("plotly.graph_objects")

    def coloured(v):
        if isinstance(v, str):
            return "#123456" if v.startswith("--") else v
        if isinstance(v, list):
            return [coloured(x) for x in v]
        return {k: coloured(x) for k, x in v.items()} if isinstance(v, dict) else v

    data = page.figures
    for name, panels in data.items():
        for panel in panels[:1]:
            figure = go.Figure(coloured(panel))
            assert len(figure.data) == len(panel["data"]), name


def test_every_colour_of_the_data_is_defined_in_the_style_sheet(page, source):
    used = set(re.findall(r'"(--[a-z-]+)"', page.unpacked("figures")))
    used |= set(re.findall(r"var\((--[a-z-]+)\)", source))
    defined = set(re.findall(r"(--[a-z-]+):", page.text["style"][0]))
    assert used <= defined
    light, dark = (
        re.findall(r"--[a-z-]+:", part)
        for part in page.text["style"][0].split("@media (prefers-color-scheme: dark)")[:2]
    )
    assert light[: len(dark)] == dark[: len(light)]


def test_data_is_thinned_and_rounded(full, page):
    assert len(page.unpacked("figures")) < 2_000_000
    panel = page.figures["motion"][0]
    assert all(len(t["x"]) <= 2000 for t in panel["data"])
    line = next(t for t in panel["data"] if t["name"] == "filtered")
    T = full.result.trajectory
    k = np.searchsorted(T.t, np.array(line["x"]) - 1e-3)
    assert np.allclose(line["y"], T.llh[k, 2], atol=1e-4 * np.ptp(T.llh[:, 2]))


_real_plotly = document._plotly  # before the fixture above replaces it


def test_plotly_itself_is_put_in_once(full, monkeypatch, tmp_path):
    monkeypatch.setattr(document, "_plotly", _real_plotly)
    text = full.result.report(tmp_path / "r.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.plain.count("plotly.js (basic - minified) v") == 1
    assert len(text) < 1.5e6
    assert page.open == []
    assert not any("src" in a for a in page.all("script"))
    assert len(page.all("script")) == 4
