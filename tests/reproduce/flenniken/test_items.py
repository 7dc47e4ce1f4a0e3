"""Flenniken's tables and figures: complete, each with a verdict, none that could not fail."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import theses
from theses import check_figures, check_ids, check_verdicts

from schuler.growth import closed_forms as forms
from schuler.reproduce import Effort, reproduce
from schuler.reproduce.flenniken import ITEMS, NOT_RESULTS, chapter_4, chapter_7
from schuler.reproduce.flenniken.study.heading.linear import LinearModel
from schuler.reproduce.flenniken.study.rocket import RocketProfile, rocket_trajectory
from schuler.sensors import catalogue, triads
from schuler.sensors.noise import terms

#: Every table and figure of the thesis by its caption, and statements of its text that are numbers.
IDS = {
    *(f"fig-2.{k}" for k in range(1, 13)), *(f"table-2.{k}" for k in range(1, 5)), "text-2.8",
    *(f"fig-3.{k}" for k in range(1, 18)), "text-3.7",
    *(f"fig-4.{k}" for k in range(1, 11)), "text-4.2", "text-4.6",
    *(f"fig-5.{k}" for k in range(2, 8)),
    *(f"fig-6.{k}" for k in range(1, 5)), "table-6.1", "table-6.2", "text-6.3",
    "fig-7.1", "fig-7.2", "fig-7.3", "fig-7.4", "fig-7.5", "text-7.4",  # the text's 7.3 is captioned 7.5
    "fig-A.1", "fig-A.2", "table-A.1", "fig-B.1", "fig-B.2", "fig-B.3",
    *(f"fig-D.{k}" for k in range(1, 5)),
}  # fmt: skip

#: What differs, and why; a new one is a defect of ours until it is explained.
DIFFERS = {
    "fig-2.3",  # two readings of one log in the source; a minimum of the chart read at half its time
    "fig-2.6",  # 1.383e-3 cut to 1.3e-3
    "fig-2.10",  # the bias adds 4 % at 1 s, which the source takes for white noise
    "table-2.1",  # 1 ug for 1 mg
    "fig-3.4",  # no printed setting gives 1 m at 20 s
    "text-3.7",  # (3.51): 1/8 is to be 1/12
    "fig-4.2",  # 700 s to settle, not reproduced by any start
    "text-4.2",  # printed process noise inconsistent in every reading
    "text-6.3",  # signs of (6.7)
    "fig-7.1", "fig-7.2",  # numbers of the flight exclude each other
    "fig-B.1",  # sqrt(2) printed as 1
    "fig-D.1",  # 180 deg for 90 deg
}  # fmt: skip

BY_ID = {item.id: item for item in ITEMS}
verdict_of = partial(theses.verdict_of, ITEMS)


@pytest.fixture(scope="module")
def done():
    return reproduce("flenniken")


def test_every_table_and_figure_is_an_item():
    check_ids(ITEMS, IDS, NOT_RESULTS)


def test_every_item_has_its_verdict(done):
    check_verdicts(done, ITEMS)
    for r in done.results:
        assert len({c.name for c in r.outcome.cells}) == len(r.outcome.cells), r.item.id  # keys of the JSON


def test_what_differs_is_known(done):
    assert {r.item.id for r in done.results if r.verdict == "differs"} == DIFFERS
    assert {r.item.id for r in done.results if r.verdict == "corrected"} == {"text-7.4"}
    # what corrected equations say is met everywhere: only the thesis's own numbers are missed
    for r in done.results:
        missed = [c.name for c in r.outcome.cells if c.agrees is False and c.reference == "corrected"]
        assert not missed, (r.item.id, missed)


def test_random_numbers_come_of_the_seed(done):
    """Every statistical or emulated item gives other numbers with another seed and the same with the same."""
    for r in done.results:
        if r.item.kind == "exact":
            continue
        again = r.item.run(Effort(seed=2))
        one, two = ([c.ours for c in outcome.cells] for outcome in (r.outcome, again))
        assert one != two, r.item.id
        assert [c.name for c in r.outcome.cells] == [c.name for c in again.cells]
    r = next(r for r in done.results if r.item.id == "fig-B.3")
    assert [c.ours for c in r.item.run(Effort()).cells] == [c.ours for c in r.outcome.cells]


def test_figures_can_be_drawn(done):
    check_figures(done, other=("table-6.2",))


def test_wrong_integrals_are_seen(monkeypatch):
    assert verdict_of("fig-3.1", 5) == "in part"  # growth from 20 to 30 s; the size was chosen
    right = forms.integral_variance
    monkeypatch.setattr(forms, "integral_variance", lambda *a, **k: 1.1 * right(*a, **k))
    assert verdict_of("fig-3.1", 5) == "differs"


def test_wrong_white_noise_is_seen(monkeypatch):
    """Ten percent too much, by what the samples are drawn with. Seeds that nothing else has cached."""
    assert verdict_of("fig-A.1", 6) == "agrees"
    right = terms.white
    monkeypatch.setattr(terms, "white", lambda N, *a: right(1.1 * N, *a))
    assert verdict_of("fig-A.1", 7) == "differs"
    assert verdict_of("fig-D.3", 7) == "differs"


def test_wrong_process_noise_is_seen(monkeypatch):
    chapter_4._bound.cache_clear()
    assert verdict_of("fig-4.1", 1) == "weak"
    assert verdict_of("fig-4.7", 1) == "agrees"
    right = LinearModel.discrete

    def louder(self, step):
        d = right(self, step)
        return replace(d, Qd=1.3 * d.Qd)

    chapter_4._bound.cache_clear()
    monkeypatch.setattr(LinearModel, "discrete", louder)
    assert verdict_of("fig-4.1", 1) == "differs"
    assert verdict_of("fig-4.7", 1) == "differs"
    chapter_4._bound.cache_clear()


def test_another_flight_is_seen(monkeypatch):
    """Half a percent more thrust: the numbers of T1-R and all sensitivities move."""
    cached = (chapter_7._flight, chapter_7._weights, chapter_7._budget)
    for function in cached:
        function.cache_clear()
    assert verdict_of("text-7.4", 1) == "corrected"
    monkeypatch.setattr(chapter_7, "rocket_trajectory",
                        partial(rocket_trajectory, RocketProfile(burn_time=12.7, turn_start=12.7)))  # fmt: skip
    for function in cached:
        function.cache_clear()
    assert verdict_of("text-7.4", 1) == "differs"
    item = BY_ID["fig-7.2"]
    assert not any(c.agrees for c in item.run(Effort()).cells if c.reference == "corrected" and "range" in c.name)
    for function in cached:
        function.cache_clear()


def test_another_table_and_another_sign_are_seen(monkeypatch):
    assert verdict_of("table-2.4", 1) == "transcribed"
    assert verdict_of("fig-6.1", 1) == "agrees"
    right = catalogue.triad
    monkeypatch.setattr(
        catalogue, "triad", lambda *a: replace(right(*a), random_walk=1.2 * right(*a).random_walk)
    )  # fmt: skip
    assert verdict_of("table-2.4", 1) == "differs"
    assert verdict_of("table-2.3", 1) == "differs"
    monkeypatch.setattr(triads, "skew", lambda v: np.zeros((3, 3)))
    assert verdict_of("fig-6.1", 1) == "differs"


def test_bands_are_narrow_enough_to_say_something(done):
    """A band around a number other than zero never holds zero; one around zero is of an error that is stated."""
    for r in done.results:
        for c in (c for c in r.outcome.cells if math.isfinite(c.low) and math.isfinite(c.high)):
            centred = math.isclose(c.low, -c.high, rel_tol=1e-9)
            assert centred or not c.low <= 0.0 <= c.high, (r.item.id, c.name, c.low, c.high)
