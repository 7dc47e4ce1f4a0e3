"""Items of every thesis that take milliseconds, with their verdicts; all items run with ``pytest -m reproduce``."""

import math

import pytest

from schuler.reproduce import reproduce

VERDICTS = {
    "yaman": {
        "differs": ("table-2.1", "table-5.2"), "transcribed": ("table-2.2", "fig-6.6", "text-E"),
        "corrected": ("text-A",),
    },
    "du": {
        "differs": ("text-3.3",), "corrected": ("text-2.5", "text-3.4.1"),
        "agrees": ("text-2.5-platform", "table-4.5"), "transcribed": ("fig-4.27", "fig-6.2"),
        "pattern only": ("text-3.1", "text-3.2.1", "text-3.2.2", "text-3.2.3"),
    },
    "hayal": {
        "differs": ("text-3.2", "fig-4.1"), "transcribed": ("table-2.1", "table-3.1", "table-4.1"),
        "pattern only": ("text-3.4.3", "text-4.1.2"), "weak": ("text-4.2",),
    },
    "flenniken": {
        "differs": ("table-2.1", "fig-4.2", "text-6.3", "fig-7.1", "fig-7.2", "fig-D.1"),
        "agrees": ("fig-4.7", "table-6.1", "fig-6.1", "table-6.2", "table-A.1"), "weak": ("fig-4.1",),
        "transcribed": ("table-2.2", "table-2.3", "table-2.4", "text-2.8"),
    },
    "stefanisko": {
        "differs": ("table-1.1", "text-1.4.4", "text-1.5", "fig-4.5"), "agrees": ("fig-4.7",),
        "pattern only": ("text-1.3", "text-4.3"),
    },
}  # fmt: skip


@pytest.mark.parametrize("thesis", VERDICTS)
def test_quick_items_have_their_verdicts_and_reasons(thesis):
    expected = {name: verdict for verdict, names in VERDICTS[thesis].items() for name in names}
    done = reproduce(thesis, list(expected), seed=1)
    assert done.complete
    assert {r.item.id: r.verdict for r in done.results} == expected
    for r in done.results:
        assert r.verdict not in ("differs", "corrected", "shown") or len(r.outcome.reason) > 40, r.item.id
        for cell in r.outcome.cells:
            assert math.isfinite(cell.ours), (r.item.id, cell.name)
            assert not cell.compared or math.isfinite(cell.low) or math.isfinite(cell.high), (r.item.id, cell.name)
