"""The notebook of the documentation: it runs, and shows pictures and tables, not walls of numbers."""

import json
import re

import pytest
from notebooks import executed, markdown
from places import ROOT

NOTEBOOK = ROOT / "docs" / "notebook.ipynb"


def programs(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def kind(output):
    """The richest form of what was put out."""
    data = output.get("data", {})
    return next((form for form in ("text/html", "image/png") if form in data), "text")


def kinds(notebook):
    """Kinds of what each program puts out."""
    return [[kind(output) for output in cell["outputs"]] for cell in programs(notebook)]


def check_outputs(notebook):
    """Every program ends in a table or a picture, and what stands there as text is short."""
    pictures = 0
    for cell, shown in zip(programs(notebook), kinds(notebook), strict=True):
        assert shown, "".join(cell["source"])
        assert shown[-1] in ("text/html", "image/png"), "".join(cell["source"])
        for output in cell["outputs"]:
            assert output["output_type"] != "error"
            data = output.get("data", {})
            for text in ("".join(output.get("text", "")), "".join(data.get("text/plain", ""))):
                assert len(text) < 300
            words = re.sub(r"<[^>]*>", " ", "".join(data.get("text/html", "")))
            assert len(words) < 3000
            assert "array(" not in words
            pictures += "image/png" in data or "data:image/png" in "".join(data.get("text/html", ""))
    assert pictures >= 6


def test_the_saved_notebook_shows_pictures_and_tables_and_is_small():
    assert NOTEBOOK.stat().st_size < 400_000
    check_outputs(json.loads(NOTEBOOK.read_text(encoding="utf-8")))


@pytest.mark.campaign
def test_the_notebook_runs_and_shows_what_was_saved():
    pytest.importorskip("nbclient", reason="the notebook is executed with the extra docs")
    again = executed(NOTEBOOK)
    check_outputs(again)
    assert kinds(again) == kinds(json.loads(NOTEBOOK.read_text(encoding="utf-8")))


def test_a_page_has_the_texts_programs_and_outputs_of_a_notebook_in_their_order():
    cells = [
        {"cell_type": "markdown", "source": ["# Title\n", "text"]},
        {"cell_type": "code", "source": "1 + 1", "outputs": [
            {"output_type": "stream", "text": ["said\n"]},
            {"output_type": "execute_result", "data": {"text/plain": "2", "text/html": ["<b>\n\n", "2</b>"]}},
        ]},
    ]  # fmt: skip
    page = markdown({"cells": cells})
    places = [page.index(part) for part in ("# Title", "```python\n1 + 1\n```", "```text\nsaid\n```", "<b>\n2</b>")]
    assert places == sorted(places)
