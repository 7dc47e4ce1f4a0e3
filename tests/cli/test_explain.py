"""``schuler explain``: every term is there once, its conversions join units of one dimension."""

import math
import re

import pytest
from command import answer, refusal, run

from schuler.cli.explain import lookup
from schuler.units import parse_unit


@pytest.fixture(scope="module")
def terms():
    from pathlib import Path

    from schuler.cli import explain
    from schuler.files import read_toml

    return read_toml(Path(explain.__file__).with_name("glossary.toml"))


def test_conversions_join_units_of_one_dimension(terms):
    ratios = {"ppm", "%", "1"}
    for key, entry in terms.items():
        for first, second in entry.get("conversions", ()):
            assert parse_unit(first).dimension == parse_unit(second).dimension, (key, first, second)
            assert (first in ratios) == (second in ratios)


def test_every_term_has_two_sentences_and_words_of_its_own(terms):
    assert len(terms) >= 40
    words = [(w.lower(), key) for key, e in terms.items() for w in {key, e["name"], *e.get("aliases", ())}]
    assert len({w for w, _ in words}) == len(words)
    for key, entry in terms.items():
        assert set(entry) <= {"name", "aliases", "text", "conversions", "relation"}, key
        assert entry["text"].endswith("."), key
        sentences = re.findall(r"[.;](?= [A-Z0-9]|$)", entry["text"])
        assert 2 <= len(sentences) <= 3, key
    for word, key in words:
        assert lookup(terms, word.upper()) == key


def test_angle_random_walk(capsys):
    data = answer(capsys, "explain", "arw", "--json")
    assert (data["term"], data["name"]) == ("ARW", "angle random walk")
    factors = {(c["from"], c["to"]): c["factor"] for c in data["conversions"]}
    # by hand: a degree in radians over the root of 3600 s; and 60 of them an hour's root; rounding
    assert factors["deg/sqrt(h)", "rad/s/sqrt(Hz)"] == pytest.approx(math.pi / 180.0 / 60.0, rel=1e-14)
    assert factors["deg/s/sqrt(Hz)", "deg/sqrt(h)"] == pytest.approx(60.0, rel=1e-14)
    code, out, _ = run(capsys, "explain", "angle-random walk")
    assert code == 0
    assert out.startswith("ARW: angle random walk\n")
    assert "1 deg/s/sqrt(Hz) = 60 deg/sqrt(h)" in out


def test_all_terms_are_listed(capsys, terms):
    assert list(answer(capsys, "explain", "--json")["terms"]) == list(terms)
    code, out, _ = run(capsys, "explain")
    assert (code, len(out.splitlines())) == (0, len(terms))


def test_an_unknown_term_offers_the_nearest(capsys):
    assert "did you mean NEES?" in refusal(capsys, "explain", "neees")
    assert "lever arm" in refusal(capsys, "explain", "leverarms")
    assert "schuler explain lists what there is" in refusal(capsys, "explain", "zzzzzz")
