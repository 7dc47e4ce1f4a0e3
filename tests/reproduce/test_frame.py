"""The frame of the reproductions: bands, verdicts, choice of items, interruption, the page."""

import math
import re
from dataclasses import replace

import pytest

from schuler.exceptions import InputError
from schuler.reproduce import (
    Cell,
    Effort,
    Item,
    Outcome,
    Reproduction,
    Result,
    against,
    claimed,
    digits,
    over_settings,
    shown,
    transcribed,
)
from schuler.reproduce import run as runner
from schuler.reproduce.book import write_book


def test_printed_digits_are_half_a_unit_of_the_last():
    assert digits("x", "0.112", 0.1124).agrees
    assert not digits("x", "0.112", 0.1126).agrees
    assert digits("x", "3.743e-5", 3.7434e-5).agrees
    assert not digits("x", "3.743e-5", 3.7437e-5).agrees
    assert digits("x", "450", 450.5).agrees


def test_bands_of_numbers_and_claims():
    assert against("x", -10.0, -10.9, relative=0.1).agrees
    assert not against("x", -10.0, -11.1, relative=0.1).agrees
    assert claimed("x", "grows faster", 2.0, low=1.0).agrees
    assert not claimed("x", "grows faster", 0.5, low=1.0).agrees
    assert shown("x", 1.0).agrees is None


def test_numbers_are_shown_with_the_digits_that_tell_them_apart():
    cell = digits("x", "9.77891", 9.77897)
    assert len({cell.shown(), *cell.band().split(" to ")}) == 3
    assert claimed("x", "small", 2.0, high=1.3).band() == "at most 1.3"
    assert claimed("x", "large", 2.0, low=2.5).band() == "at least 2.5"
    assert shown("x", 2.0).band() == ""
    assert claimed("x", "equal", 1.0, low=1.0, high=1.0).shown() == "1"


def test_a_number_that_is_none_agrees_with_nothing():
    assert not claimed("x", "small", math.nan, high=1.0).agrees
    assert not against("x", 1.0, math.nan, relative=1.0).agrees


@pytest.mark.parametrize("make", [
    lambda: claimed("x", "anything", 1.0),  # a band without ends cannot fail
    lambda: against("x", 1.0, 1.0),
    lambda: Cell("x", 1.0, low=0.0, high=1.0),
    lambda: Cell("x", 1.0, reference="thesis"),
])  # fmt: skip
def test_a_band_that_cannot_fail_is_refused(make):
    with pytest.raises(InputError):
        make()


def result_of(*cells, reason=""):
    outcome = Outcome(cells, reason)
    return Result(Item("fig-1.1", "a figure", "exact", lambda effort: outcome), outcome, 0.0)


def test_a_band_that_can_hardly_be_missed_is_weak():
    """One end, or two that are a factor of two apart, decide nothing; a band around zero neither."""
    for cell in (
        claimed("a", "at most one", 0.3, high=1.0),
        claimed("a", "an order of magnitude", 2.0, low=1.0, high=10.0),
        against("a", 0.0, 0.01, absolute=0.1),
    ):
        assert result_of(cell).verdict == ("weak" if cell.numeric else "pattern only")
        assert result_of(cell, digits("b", "1.0", 1.0)).verdict == "agrees"
    assert claimed("a", "about", 1.0, low=0.7, high=1.35).decisive
    assert claimed("a", "about", -1.0, low=-1.35, high=-0.7).decisive


def test_printed_numbers_left_out_and_missed_are_said():
    """A fifth apart and not compared: the item agrees in part, and its line names the number."""
    good = digits("a", "1.0", 1.0)
    assert result_of(good, shown("d", 1.19, printed="1.0", why="not stated")).verdict == "agrees"
    assert result_of(good, shown("d", 1.0, printed="in words")).verdict == "agrees"
    result = result_of(good, shown("d", 18.33, printed="57.98", why="one unit"))
    assert result.verdict == "in part"
    done = Reproduction("yaman", (result,), Effort())
    line = "1 printed not compared (one unit); a fifth or more apart: d (printed 57.98, ours 18.33)"
    assert line in " ".join(done.summary().split())
    assert done.counts["in part"] == 1
    assert done.counts["agrees"] == 0


def test_a_printed_number_is_compared_or_has_a_reason():
    with pytest.raises(InputError, match=r"reason why the printed '57\.98' is not compared"):
        shown("d", 18.33, printed="57.98")
    with pytest.raises(InputError, match="expected no reason"):
        shown("d", 18.33, printed="in words", why="hardware")
    result = result_of(shown("d", 18.33, printed="57.98", why="one unit"))
    assert result.to_dict()["not_compared"] == {"d": "one unit"}


def test_what_could_not_disagree_has_verdicts_of_its_own():
    """Numbers handed back, orderings, and what seeds decide make no headline."""
    given, order = transcribed(digits("a", "1.0", 1.0)), claimed("b", "grows faster", 2.0, low=1.0)
    assert result_of(*given).verdict == "transcribed"
    assert result_of(*transcribed(digits("a", "1.0", 1.1))).verdict == "differs"
    assert result_of(order).verdict == "pattern only"
    assert result_of(*given, order).verdict == "pattern only"
    assert result_of(*given, digits("c", "1.0", 1.0)).verdict == "agrees"
    # a check that is met decides nothing of what the thesis prints
    assert result_of(order, digits("c", "1.0", 1.0, reference="corrected")).verdict == "pattern only"
    flipping = replace(result_of(digits("c", "1.0", 1.0)).item, flips="seed 2 differs")
    noisy = Result(flipping, Outcome((digits("c", "1.0", 1.0),)), 0.0)
    assert noisy.verdict == "within noise"
    done = Reproduction(
        "du", (result_of(*given), result_of(order), noisy, result_of(digits("c", "1.0", 1.1))), Effort()
    )
    assert done.headline() == (
        "1 of 4 items could have told: 1 differs; the others: 1 within noise, 1 pattern only, 1 transcribed"
    )
    assert "seed 2 differs" in done.summary()


def test_what_is_not_stated_widens_a_band_by_its_range():
    """A size by its factors, a mean by its difference: in the band if one of the settings is."""
    size = over_settings(claimed("a", "10", 2.0, low=8.0, high=12.0), [1.0, 4.0], "drift of 0 to 20 deg/h")
    assert (size.low, size.high) == pytest.approx((4.0, 24.0))
    assert not size.agrees
    assert over_settings(claimed("a", "10", 2.0, low=8.0, high=12.0), [8.0], "drift").agrees
    mean = over_settings(against("a", 0.0, 3.0, absolute=1.0), [1.0, 5.0], "windows")
    assert (mean.low, mean.high) == pytest.approx((-3.0, 3.0))
    assert "3 (1 to 5 over windows)" in mean.shown()


def test_verdict_is_made_of_the_cells():
    good, bad = digits("a", "1.0", 1.0), digits("b", "1.0", 2.0)
    mended = digits("c", "1.0", 1.0, reference="corrected")
    assert result_of(good, shown("d", 1.0)).verdict == "agrees"
    assert result_of(good, bad).verdict == "differs"
    assert result_of(good, mended).verdict == "agrees"
    assert result_of(mended).verdict == "corrected"
    assert result_of(shown("d", 1.0)).verdict == "shown"
    entry = result_of(good, bad, reason="why").to_dict()
    assert {"id", "title", "class", "printed", "ours", "verdict", "reason"} <= set(entry)
    assert entry["printed"] == {"a": "1.0", "b": "1.0"}
    assert entry["ours"] == {"a": 1.0, "b": 2.0}


@pytest.fixture
def three(monkeypatch):
    def interrupted(effort):
        raise KeyboardInterrupt

    items = (
        Item("fig-1.1", "one", "exact", lambda e: Outcome((digits("a", "1", float(e.seed)),)), also=("fig-1.2",)),
        Item("table-1.1", "two", "exact", lambda e: Outcome((shown("runs", e.runs(3, 1000)),))),
        Item("table-1.2", "three", "exact", interrupted),
    )
    monkeypatch.setattr(runner, "items_of", lambda thesis: items)


def test_items_are_chosen_by_id_in_the_order_of_the_thesis(three):
    chosen = runner.reproduce("du", ["table-1.1", "fig-1.2"])
    assert [r.item.id for r in chosen.results] == ["fig-1.1", "table-1.1"]
    assert chosen.results[1].outcome.cells[0].ours == 3
    assert runner.reproduce("du", ["table-1.1"], quick=False).results[0].outcome.cells[0].ours == 1000
    with pytest.raises(InputError, match=r"no item 'fig-9.9'; there are fig-1.1"):
        runner.reproduce("du", ["fig-9.9"])


def test_interrupted_keeps_what_is_done(three):
    fractions = []
    kept = runner.reproduce("du", progress=fractions.append)
    assert not kept.complete
    assert [r.item.id for r in kept.results] == ["fig-1.1", "table-1.1"]
    assert fractions == pytest.approx([1 / 3, 2 / 3])
    assert "INTERRUPTED" in kept.summary()


def test_unknown_thesis_is_refused():
    with pytest.raises(InputError, match="expected one of yaman, du, hayal, flenniken, stefanisko"):
        runner.reproduce("groves")


def test_page_has_every_item_its_band_and_its_reason(three, tmp_path):
    kept = runner.reproduce("du", ["fig-1.1", "table-1.1"], seed=2)
    text = write_book([kept], tmp_path / "book.html").read_text(encoding="utf-8")
    assert "0.5 to 1.5" in text
    assert "printed digits" in text
    assert text.count('<section id="du_') == 2
    assert kept.counts["differs"] == 1
    assert "http" not in text.replace("http-equiv", "")


def test_the_pages_add_up():
    """Counts by verdict in docs/reproduction.md are those of the headlines of the pages, and their sums."""
    from places import DOCS

    text = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    head = next(row for row in rows if row[:2] == ["Thesis", "Items"])
    table = {row[0]: dict(zip(head[1:], map(int, row[1:]), strict=True)) for row in rows if row[1].isdigit()}
    total = table.pop("all")
    for thesis in runner.THESES:
        page = " ".join((DOCS / "reproduction" / f"{thesis}.md").read_text(encoding="utf-8").split())
        (line,) = re.findall(r"(\d+ of \d+ items could have told: [^.]*)", page)
        counts = {verdict: int(n) for n, verdict in re.findall(rf"(\d+) ({'|'.join(head[2:])})\b", line)}
        row = table[runner.THESES[thesis].split(",")[0]]
        assert counts == {v: n for v, n in row.items() if v != "Items" and n}, thesis
        assert row["Items"] == sum(counts.values()) == int(line.split()[2])
    assert total == {key: sum(row[key] for row in table.values()) for key in total}


def test_effort_is_a_key():
    assert hash(Effort(True, 1)) == hash(Effort(True, 1))
    assert Effort(True, 1) != Effort(False, 1)
