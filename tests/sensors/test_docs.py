"""The page on sensors: its examples run, its numbers are those of the code."""

import re

from places import ROOT

PAGE = ROOT / "docs" / "sensors.md"


def test_examples_run(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 5
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), {})
    assert "deg/sqrt(h)" in capsys.readouterr().out
