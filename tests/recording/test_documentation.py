"""The page on reading data names every hint, column, format and allowance there is, and no other hint."""

import ast
import re
from dataclasses import fields

import pytest
from places import ROOT

from schuler.recording.io import ReadHints
from schuler.recording.io.columns import CROSS, GROUP, GROUP_QUANTITY, QUATERNION, VELOCITY_CROSS
from schuler.recording.io.dispatch import WRITERS
from schuler.recording.io.folder import PARTS
from schuler.recording.io.hint_texts import ALLOWANCES

PAGE = ROOT / "docs" / "reading-data.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def words(page: str) -> set[str]:
    return set(re.findall(r"[a-z_-]+", " ".join(re.findall(r"`+[^`]+`+", page))))


def test_every_hint_is_documented(page):
    assert {f.name for f in fields(ReadHints)} <= words(page)


def test_every_column_group_and_allowance_is_documented(page):
    own = {*CROSS, *VELOCITY_CROSS, *QUATERNION}  # only in files we write
    assert set(GROUP) - own <= words(page)
    assert set(GROUP_QUANTITY) <= words(page)
    assert set(ALLOWANCES) <= words(page)
    assert set(PARTS) <= words(page)


def test_every_format_written_is_documented(page):
    for name in {"csv", "parquet", "pos"} & set(WRITERS.values()):
        assert f".{name}" in page
    assert "KML" in page
    assert "GeoJSON" in page


def test_examples_use_hints_that_exist_and_can_be_read(page):
    examples = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(examples) == 3
    calls = [node for code in examples for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    reads = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "read"]
    assert len(reads) == 3
    for call in reads:
        options = {keyword.arg: ast.literal_eval(keyword.value) for keyword in call.keywords}
        for part in [options] if "imu" not in options else options.values():
            ReadHints.of(**{name: value for name, value in part.items() if name != "file"})
