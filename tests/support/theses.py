"""Laws that hold for every thesis: complete, reasoned, bands that can be missed, figures with units."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

from places import DOCS

from schuler.plotting.drawing import draw
from schuler.reproduce import Effort, Item, Reproduction, Result


def check_ids(items: Sequence[Item], ids: Iterable[str], not_results: Mapping[str, str]) -> None:
    """Every table and figure is an item exactly once, or has a reason not to be one."""
    names = [name for item in items for name in (item.id, *item.also)]
    assert len(set(names)) == len(names)
    assert set(names) == set(ids)
    assert not set(names) & set(not_results)
    assert {item.kind for item in items} == {"exact", "statistical", "hardware"}


def check_verdicts(done: Reproduction, items: Sequence[Item]) -> None:
    """Every item has its verdict, with a reason where it needs one; every band can be missed."""
    assert done.complete
    page = (DOCS / "reproduction" / f"{done.thesis}.md").read_text(encoding="utf-8")
    assert done.headline() in " ".join(page.split())
    assert [r.item.id for r in done.results] == [item.id for item in items]
    for r in done.results:
        assert r.verdict != "shown"
        if r.verdict in ("corrected", "differs") or any(c.agrees is False for c in r.outcome.cells):
            assert len(r.outcome.reason) > 40, r.item.id
        assert r.item.kind != "hardware" or r.outcome.reason, r.item.id
        assert any(c.compared for c in r.outcome.cells), r.item.id
        for c in r.outcome.cells:
            assert math.isfinite(c.ours), (r.item.id, c.name)
            if c.compared:
                assert math.isfinite(c.low) or math.isfinite(c.high), (r.item.id, c.name)
                assert c.tolerance, (r.item.id, c.name)


def check_figures(done: Reproduction, drawn: int = 1, other: Collection[str] = ()) -> None:
    """Items that stand for a figure have one; axes have units; the first of each item are drawn.

    ``other`` items are tables where the thesis has a figure, or have words on their axes.
    """
    for r in done.results:
        if any(name.startswith("fig-") for name in (r.item.id, *r.item.also)) and r.item.id not in other:
            assert r.outcome.figures, r.item.id
        for make in r.outcome.figures[:drawn]:
            figure = make()
            for p in figure.panels:
                assert p.items, r.item.id
                named = bool(p.y_ticks) and "[" in p.x_label
                labelled = named or ("[" in p.x_label and "[" in p.y_label)
                assert p.bare or labelled or r.item.id in other, r.item.id
            assert draw(figure).axes


def verdict_of(items: Sequence[Item], name: str, seed: int) -> str:
    """Verdict of an item run by itself; campaigns are cached by seed."""
    item = next(i for i in items if name in (i.id, *i.also))
    return Result(item, item.run(Effort(seed=seed)), 0.0).verdict


def check_seeds(done: Reproduction, names: Sequence[str]) -> None:
    """Statistical items are computed: most numbers of another seed differ."""
    for name in names:
        r = next(r for r in done.results if r.item.id == name)
        pairs = [(a.ours, b.ours) for a, b in zip(r.outcome.cells, r.item.run(Effort(seed=2)).cells, strict=True)]
        assert sum(a != b for a, b in pairs) > len(pairs) / 2, name
