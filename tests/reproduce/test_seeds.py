"""Verdicts of quick runs under five seeds: what they do not agree on is listed, and nothing else."""

import pytest

from schuler.reproduce import THESES, Effort, Result
from schuler.reproduce.run import items_of
from schuler.reproduce.seeds import FLIPS, SEEDS


def test_what_flips_is_an_item():
    for thesis, name in FLIPS:
        assert name in {item.id for item in items_of(thesis)}, (thesis, name)


@pytest.mark.slow
@pytest.mark.parametrize("thesis", THESES)
def test_items_whose_verdict_is_the_seeds(thesis):
    """Fifteen minutes of a processor for all five; prints the table of :mod:`schuler.reproduce.seeds`."""
    flips = {}
    for item in items_of(thesis):
        verdicts = [Result(item, item.run(Effort(seed=seed)), 0.0).verdict for seed in SEEDS]
        if len(set(verdicts)) > 1:
            flips[thesis, item.id] = "; ".join(
                f"{verdict}: seed {', '.join(str(s) for s, v in zip(SEEDS, verdicts, strict=True) if v == verdict)}"
                for verdict in dict.fromkeys(verdicts)
            )
    print(flips)
    assert flips == {key: text for key, text in FLIPS.items() if key[0] == thesis}
