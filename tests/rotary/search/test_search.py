"""Search for schemes: never worse than the literature, within limits, the same for the same seed, and interruptible."""

import _thread
import itertools
import threading
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from places import ROOT

from schuler.budget.covariance import quantity_sigma, true_covariance
from schuler.budget.linearisation import linearise
from schuler.exceptions import ConfigError, InputError
from schuler.recording.series import Increments
from schuler.rotary.platform_usage import PlatformLimits, usage, within
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu
from schuler.rotary.search import evolution
from schuler.rotary.search.evolution import SearchSettings, search_schemes
from schuler.rotary.search.families import SchemeSpace, families, place_of, schedule_of
from schuler.rotary.search.named_schemes import named_schemes
from schuler.rotary.search.scenario import load_rotary
from schuler.rotary.search.search_result import pareto_front
from schuler.units import DEG

BASE = {
    "name": "a minute at rest",
    "imu": {"name": "NAV440-emulated", "gyro_instability_deg_h": 0.0, "gyro_bias_deg_h": 20.0, "gyro_scale_ppm": 500.0},
    "motion": {"type": "static", "lat_deg": 45.0, "lon_deg": 0.0, "duration_s": 60.0},
    "start": {"attitude_deg": (0.01, 0.01, 0.1)},
    "rotary": {
        "schedule": {"type": "continuous", "axis": "z", "rate_deg_s": 10.0},
        "limits": {"rate_deg_s": 60.0, "acceleration_deg_s2": 120.0, "axes": 2},
    },
    "objective": {"quantity": "position"},
}


@cache
def prepared(cable: bool = False):
    limits = {**BASE["rotary"]["limits"], **({"angle_deg": 200.0} if cable else {})}
    scenario = load_rotary({**BASE, "rotary": {**BASE["rotary"], "limits": limits}})
    return scenario.scheme_objective(), scenario.space(), scenario


@cache
def searched(cable: bool = False):
    objective, space, scenario = prepared(cable)
    return search_schemes(objective, space, scenario.settings(evaluations=150 if cable else 400, seed=3))


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_front_against_all_pairs(columns):
    costs = np.random.default_rng(columns).integers(0, 12, (300, columns)).astype(float)
    costs[5] = np.inf
    front = set(pareto_front(costs).tolist())
    for k, row in enumerate(costs):
        beaten = any(np.all(c <= row) and np.any(c < row) for c in costs)
        twin = any(np.array_equal(costs[j], row) for j in front)
        assert (k in front or twin) == (not beaten and bool(np.isfinite(row).all()))
    assert np.all(np.diff(costs[sorted(front, key=lambda k: costs[k, 0])][:, 0]) >= 0.0)


def test_front_of_no_table():
    with pytest.raises(InputError, match="one row"):
        pareto_front([1.0, 2.0])


def random_place(family, rng):
    return np.array([float(rng.integers(w)) if w else rng.random() for w in family.whole])


@pytest.mark.parametrize("tilt", [0.0, 30.0 * DEG])
@pytest.mark.parametrize("angle", [np.inf, 400.0 * DEG])
def test_every_place_is_a_schedule_of_the_family(tilt, angle):
    limits = PlatformLimits(rate=50.0 * DEG, acceleration=80.0 * DEG, angle=angle, axes=2)
    space = SchemeSpace(limits, 300.0, tilt=tilt)
    rng = np.random.default_rng(1)
    todo = families(space, 2)
    assert ("continuous" in {f.name for f in todo}) == np.isinf(angle)
    for family in todo:
        for _ in range(20):
            entries = family.entries(space, random_place(family, rng))
            schedule = schedule_of(entries)
            assert len(schedule.axes) == family.axes
            used = usage(schedule, 300.0)
            slack = 1.0 + 1e-9  # rounding
            assert used.largest_rate.max() <= limits.rate * slack
            assert used.largest_acceleration.max() <= limits.acceleration * slack
            if family.name == "sequence" and np.isfinite(angle):
                # it comes back: no cable is wound up over many cycles
                assert abs(sum(m["turn_deg"] for m in entries["moves"])) < 1e-9
            if family.name in ("carousel", "reciprocating"):
                assert used.largest_angle.max() <= limits.angle * slack
            if family.axes == 1 and tilt:
                named = np.abs(schedule.axes[0]).max()
                assert named >= np.cos(tilt) - 1e-9


def test_named_schemes_have_places_and_places_give_them_back():
    """Rounding; values beyond a family's range (Levinson's 660 s in five minutes) become the nearest."""
    space = SchemeSpace(PlatformLimits(rate=50.0 * DEG, acceleration=80.0 * DEG, axes=2), 300.0)
    by_name = {f.name: f for f in families(space, 2)}
    seen = set()
    for scheme in named_schemes(space, 2):
        if scheme.name == "conventional":
            assert place_of(space, scheme.entries) is None
            continue
        family, place = place_of(space, scheme.entries)
        seen.add(family)
        again = by_name[family].entries(space, np.array(place))
        if "660 s" in scheme.name:
            assert again["dwell_s"] == pytest.approx(150.0)
            continue
        t = np.linspace(0.0, 300.0, 997)
        np.testing.assert_allclose(schedule_of(again).C_bs(t), schedule_of(scheme.entries).C_bs(t), atol=1e-9)
    assert seen == {"continuous", "reciprocating", "dwell", "dual_axis"}


def test_all_schemes_of_the_thesis_are_named():
    space = SchemeSpace(PlatformLimits(rate=50.0 * DEG), 3600.0, axes=("z",))
    text = "; ".join(f"{n.name}: {n.source}" for n in named_schemes(SchemeSpace(space.limits, 3600.0), 2))
    for word in ("Geller", "Levinson", "Giovanni", "Yuan", "Sun 2011", "Sun 2009", "Ishibashi", "conventional", "660 s",
                 "16 positions", "dual axis 8 positions", "dual axis 16 positions", "+-360"):  # fmt: skip
        assert word in text
    assert all(n.axes == 1 for n in named_schemes(space, 1))
    for scheme in named_schemes(space, 1):
        assert within(schedule_of(scheme.entries), replace(space.limits, axes=1), 3600.0) == []


def test_spaces_and_families_that_make_no_sense():
    with pytest.raises(InputError, match="largest rate"):
        SchemeSpace(PlatformLimits(), 300.0)
    space = SchemeSpace(PlatformLimits(rate=1.0), 300.0)
    with pytest.raises(InputError, match="got 'spiral'"):
        families(space, 1, ("spiral",))
    with pytest.raises(InputError, match="50 evaluations"):
        SearchSettings(evaluations=10)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("cable", [True, False])
def test_no_named_scheme_is_better_than_the_best(cable):
    result, (_, space, _) = searched(cable), prepared(cable)
    for axes in (1, 2):
        wanted = named_schemes(space, axes)
        there = {c.name: c for c in result.named()}
        assert {n.name for n in wanted} <= set(there)
        for scheme in wanted:
            looked = there[scheme.name]
            # evaluated, or beyond the platform and said so
            assert np.isfinite(looked.error) != bool(looked.refused)
            if looked.axes <= axes:
                assert result.best(axes).error <= looked.error
    assert any("angle" in text for c in result.named() for text in c.refused) == cable


@pytest.mark.campaign
@pytest.mark.parametrize("cable", [False, True])
def test_two_axes_are_better_than_one_and_one_than_none(cable):
    result = searched(cable)
    assert result.best(2).axes == 2
    assert result.best(2).error < 0.7 * result.best(1).error
    assert result.gain(1) > 1.3
    # and the search itself found something
    assert result.best(2).error < min(c.error for c in result.named())


@pytest.mark.parametrize("cable", [pytest.param(False, marks=pytest.mark.campaign), True])
def test_everything_kept_is_within_the_limits(cable):
    result, (_, space, _) = searched(cable), prepared(cable)
    kept = [c for c in result.candidates if np.isfinite(c.error)]
    assert len(kept) == result.evaluations
    for c in kept[::5]:
        assert within(c.schedule, replace(space.limits, axes=2), space.duration) == []
        used = usage(c.schedule, space.duration)
        assert c.travel == pytest.approx(used.travel.sum())
        assert c.reversals == used.reversals.sum()


@pytest.mark.campaign
def test_front_goes_from_the_best_to_no_motion():
    result = searched()
    for by in ("travel", "reversals"):
        front = result.front(by)
        assert front[0].error == result.best().error
        errors, costs = np.array([(c.error, getattr(c, by)) for c in front]).T
        assert np.all(np.diff(errors) > 0.0)
        assert np.all(np.diff(costs) < 0.0)
        assert costs[-1] == 0.0
    assert "conventional" in {c.name for c in result.front()}
    assert {c.name for c in result.front("travel", 1)} != {c.name for c in result.front("travel", 2)}
    # the front is filled: something between a tenth and a third of the travel of the best
    share = np.array([c.travel for c in result.front()]) / result.best().travel
    assert np.any((share > 0.1) & (share < 0.35))
    with pytest.raises(InputError, match="travel"):
        result.front("wear")


@pytest.mark.campaign
def test_best_scheme_evaluated_by_linearising_the_turning_imu_itself():
    """The replay that the search believes in against the engine along the motion of the IMU."""
    result, (objective, _, scenario) = searched(), prepared()
    schedule = result.best().schedule
    motion = scenario.motion.build()
    ideal = ideal_rotating_imu(RotatingMotion(motion, schedule), 100.0)
    increments = Increments(ideal.t[1:], np.diff(ideal.t), ideal.gyro, ideal.accel)
    fixed = objective.turning.fixed
    run = linearise(increments, scenario_measurements(scenario), ideal.truth, rate_hz=20.0)
    P = true_covariance(replace(fixed, run=run), objective.spec)
    # discretisation, and records a twentieth of a second early
    assert result.best().error == pytest.approx(objective.value(quantity_sigma(P, "position")), rel=0.02)


def scenario_measurements(scenario):
    from schuler.budget.scenario import BudgetScenario, true_schedule

    return true_schedule(scenario.motion.build(), BudgetScenario(motion=scenario.motion))


@pytest.mark.campaign
def test_the_best_scheme_runs_from_its_own_lines():
    result = searched()
    objective, *_ = prepared()
    for axes in (1, 2):
        best = result.best(axes)
        entries = tomllib.loads(best.toml())["rotary"]["schedule"]
        assert objective.of(schedule_of(entries)) == pytest.approx(best.error, rel=1e-12)


@pytest.mark.campaign
def test_same_seed_same_result_for_any_number_of_threads():
    objective, space, scenario = prepared()
    settings = scenario.settings(evaluations=60, families=("continuous", "dual_axis"))
    one, three = (search_schemes(objective, space, replace(settings, threads=n)) for n in (1, 3))
    assert [(c.name, c.entries, c.error) for c in one.candidates] == [
        (c.name, c.entries, c.error) for c in three.candidates
    ]


def test_interrupted_it_keeps_the_best_so_far():
    objective, space, scenario = prepared()
    calls = []

    def stop(fraction):
        calls.append(fraction)
        if len(calls) == 60:
            _thread.interrupt_main()  # what Ctrl-C does, while threads work

    result = search_schemes(objective, space, scenario.settings(evaluations=200), progress=stop)
    assert not result.complete
    assert 50 <= result.evaluations < 200
    assert result.best().error <= min(c.error for c in result.named())
    assert "INTERRUPTED" in result.summary()
    assert calls == sorted(calls)


def test_a_scheme_at_which_two_threads_meet_counts_once():
    _, space, _ = prepared()
    both = threading.Barrier(2, timeout=20.0)  # neither goes on before the other has begun

    class Slow:
        def of(self, schedule):
            both.wait()
            return 1.0

    archive = evolution._Archive(Slow(), space, 2, 100, None)
    scheme = named_schemes(space, 1)[1]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: archive.named(scheme.name, scheme.entries, scheme.source), range(2)))
    assert archive.count == len(archive.ordered()) == 1


@pytest.mark.campaign
def test_nothing_to_turn_for_is_found_out():
    """Scale factors alone: any turn makes them worse, so the best is not to turn."""
    nothing = {"name": "NAV440-emulated", "gyro_bias_deg_h": 0.0, "accel_bias_m_s2": 0.0, "gyro_misalignment_mrad": 0.0,
               "gyro_instability_deg_h": 0.0, "gyro_scale_ppm": 3000.0}  # fmt: skip
    scenario = load_rotary({**BASE, "imu": nothing, "objective": {"quantity": "heading", "statistic": "end"}})
    result = search_schemes(scenario.scheme_objective(), scenario.space(), scenario.settings(evaluations=60))
    assert result.best().travel < 1e-3 or result.best().error > 0.99 * next(
        c.error for c in result.named() if c.name == "conventional"
    )


def test_texts():
    result = searched(True)
    text = result.summary()
    assert "best of 1 axis" in text
    assert "best of 2 axes" in text
    assert "not possible" in result.table().summary()
    data = result.to_dict()
    assert data["best"]["2"]["objective"] <= data["best"]["1"]["objective"]
    assert len(data["named"]) == len(result.named())
    table = result.front_table(worth=0.05)
    assert 3 <= len(table) < len(result.front("travel"))
    errors = table.column("objective_m")
    assert all(b > 1.0001 * a for a, b in itertools.pairwise(errors))
    assert errors[-1] == pytest.approx(next(c.error for c in result.named() if c.name == "conventional"))


def test_a_platform_of_three_axes():
    scenario = load_rotary({**BASE, "rotary": {**BASE["rotary"], "limits": {"axes": 3}}})
    with pytest.raises(ConfigError, match="give 1 or 2"):
        scenario.settings()


@pytest.mark.campaign
def test_the_documented_program_runs(monkeypatch, capsys):
    text = (ROOT / "docs" / "rotary-search.md").read_text(encoding="utf-8")
    monkeypatch.chdir(ROOT)
    exec(text.partition("```python\n")[2].partition("```")[0], {})
    printed = capsys.readouterr().out
    assert "best of 2 axes" in printed
    assert printed.rstrip().splitlines()[-1].startswith(("rate_deg_s", "acceleration_deg_s2"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rotary_static", "rotary_outage", "rotary_marine"])
def test_examples_searched_in_full(name):
    scenario = load_rotary(ROOT / "examples" / f"{name}.toml")
    result = search_schemes(scenario.scheme_objective(), scenario.space(), scenario.settings())
    assert result.best(1).error <= min(c.error for c in result.named() if c.axes == 1)
    assert result.gain(1) > 1.5
    if result.axes == 2:
        assert result.best(2).error < 0.7 * result.best(1).error
