"""``schuler reproduce``: what it prints and writes. The items themselves are tested in tests/reproduce."""

import json

import pytest
from command import refusal

from schuler.cli import main


def test_json_has_the_keys_scripts_rely_on(capsys):
    assert main(["reproduce", "flenniken", "text-3.7", "--quick", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    (item,) = data["items"]
    assert {"id", "title", "class", "printed", "ours", "verdict", "reason"} <= set(item)
    assert (item["id"], item["verdict"]) == ("text-3.7", "differs")  # 1/8 is printed for 1/12
    assert item["reason"]
    assert data["theses"][0]["thesis"] == "flenniken"


def test_text_names_what_differs_and_a_book_is_written(capsys, tmp_path):
    assert main(["reproduce", "flenniken", "text-3.7", "--out", str(tmp_path / "book.html")]) == 0
    out = capsys.readouterr().out
    assert "text-3.7" in out
    assert "1 of 1 items could have told: 1 differs" in out
    text = (tmp_path / "book.html").read_text(encoding="utf-8")
    assert '<section id="flenniken_text_3_7">' in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["groves"], "groves"),
        (["du", "table-99.1"], "no item 'table-99.1'; there are"),
        (["all", "table-5.3"], "items are of one thesis"),
    ],
)
def test_faults_say_what_to_do(capsys, arguments, message):
    assert message in refusal(capsys, "reproduce", *arguments)
