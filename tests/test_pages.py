"""The pages that teach are programs: their blocks run in order, and print what the page says they print.

``sh``: every line that starts with ``schuler`` is run; one that is to be refused ends in ``# refused``. ``python``: one
namespace a page. ``toml`` whose first line is ``# NAME.toml``: written as that file. ``text`` right after one of them:
what it prints. There a line ``...`` stands for any lines, and a number may differ by one in its last digit (processors
round differently).
"""

import contextlib
import io
import re
import shlex

import pytest
from places import DOCS

from schuler.cli import main

PAGES = sorted(
    [DOCS / "tutorial.md", *DOCS.glob("howto/*.md"), *DOCS.glob("theory/*.md")], key=lambda path: path.as_posix()
)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


#: Pages that take more than three seconds; what the tutorial does is tested command by command in tests/cli, too.
LONG = ("tutorial", "filter-noise-from-allan", "rotary-ins", "hand-on-results", "bridge-an-outage", "calibration")


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "page",
    [pytest.param(p, id=p.stem, marks=[pytest.mark.campaign] if p.stem in LONG else []) for p in PAGES],
)
def test_page_runs_and_prints_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(DOCS.parent / "examples", target_is_directory=True)
    names: dict[str, object] = {"__name__": "page"}
    printed = ""
    for kind, body in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "sh":
            printed = "".join(run_command(line) for line in lines_of(body) if line.startswith("schuler "))
        elif kind == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(body, str(page), "exec"), names)
            printed = out.getvalue()
        elif kind == "toml" and (head := re.match(r"# (\S+\.toml)\n", body)):
            (tmp_path / head[1]).write_text(body, encoding="utf-8")
        elif kind == "text":
            compare(body, printed)


def lines_of(body: str) -> list[str]:
    return body.replace("\\\n", " ").splitlines()


def run_command(line: str) -> str:
    out = io.StringIO()
    refused = line.endswith("# refused")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(shlex.split(line, comments=True)[1:])
    assert code == (2 if refused else 0), f"{line}\n{err.getvalue()}"
    return err.getvalue() if refused else out.getvalue()


def compare(message: str, printed: str) -> None:
    """Every line of the page in the output, in order; without ``...`` between them, right below each other."""
    lines, at, free = [line.rstrip() for line in printed.splitlines()], 0, False
    for want in message.splitlines():
        if want.strip() == "...":
            free = True
            continue
        ahead = range(at, len(lines)) if free else range(at, min(at + 1, len(lines)))
        row = next((k for k in ahead if same(want.rstrip(), lines[k])), None)
        assert row is not None, f"the page says\n  {want}\nthe program prints\n{printed}"
        at, free = row + 1, False
    assert free or at == len(lines), f"the program prints more than the page says:\n{printed}"


def same(want: str, got: str) -> bool:
    if want == got:
        return True
    if NUMBER.sub("#", want) != NUMBER.sub("#", got):
        return False
    pairs = zip(NUMBER.findall(want), NUMBER.findall(got), strict=True)
    return all(abs(float(a) - float(b)) <= 1.01 * last_digit(a) for a, b in pairs)


def last_digit(text: str) -> float:
    mantissa, _, exponent = text.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def test_comparison_sees_a_wrong_digit():
    compare("RMS 1.009 m\n...\nend", "RMS 1.010 m\nmore\nend\n")
    for message, printed in (("RMS 1.009 m", "RMS 1.012 m\n"), ("a\nc", "a\nb\nc\n"), ("a", "a\nb\n"), ("a\nb", "a\n")):
        with pytest.raises(AssertionError):
            compare(message, printed)
