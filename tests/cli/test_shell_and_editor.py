"""``schuler config schema`` and ``schuler completion``: what editors and shells are given is of the program itself."""

import json
import shutil
import subprocess
import tomllib

import pytest
from command import refusal, run
from places import EXAMPLES

from schuler.cli.app import COMMANDS
from schuler.navigation.config import NavigationConfig


def test_the_schema_has_every_section_and_refuses_other_entries(capsys):
    code, out, err = run(capsys, "config", "schema")
    assert (code, err) == (0, "")
    schema = json.loads(out)
    assert set(schema["properties"]) == set(NavigationConfig.model_fields)
    assert schema["additionalProperties"] is False
    assert schema["$schema"].startswith("https://json-schema.org/")


def test_examples_have_only_entries_of_the_schema(capsys):
    schema = json.loads(run(capsys, "config", "schema")[1])

    def check(table, node, where):
        options = [node, *node.get("anyOf", ()), *node.get("oneOf", ())]
        options = [schema["$defs"][o["$ref"].rsplit("/", 1)[1]] if "$ref" in o else o for o in options]
        named = [o for o in options if "properties" in o]
        if named:
            for key, value in table.items():
                fitting = [o for o in named if key in o["properties"]]
                assert fitting, f"{where}.{key}"
                if isinstance(value, dict):
                    check(value, fitting[0]["properties"][key], f"{where}.{key}")

    check(tomllib.loads((EXAMPLES / "town_navigation.toml").read_text(encoding="utf-8")), schema, "town")
    with pytest.raises(AssertionError, match=r"town\.gnss\.leverarm_m"):
        check({"gnss": {"leverarm_m": 1}}, schema, "town")


def test_the_schema_as_a_file(tmp_path, capsys):
    path = tmp_path / "s.json"
    assert run(capsys, "config", "schema", "--out", path)[0] == 0
    assert path.read_text(encoding="utf-8") == run(capsys, "config", "schema")[1]
    mine = tmp_path / "mine" / "s.json"
    mine.parent.mkdir()
    mine.write_text("mine", encoding="utf-8")
    assert "s.json" in refusal(capsys, "config", "schema", "--out", mine)
    assert mine.read_text(encoding="utf-8") == "mine"
    assert "scheme" in refusal(capsys, "config", "scheme")


@pytest.mark.parametrize("shell", ["bash", *(pytest.param(s, marks=pytest.mark.campaign) for s in ("zsh", "fish"))])
def test_completion_has_every_command(shell, capsys):
    code, out, err = run(capsys, "completion", shell)
    assert (code, err) == (0, "")
    assert [name for name in COMMANDS if name not in out] == []
    assert "outage-every" in out
    if shutil.which(shell):
        flag = "--no-execute" if shell == "fish" else "-n"
        assert subprocess.run([shell, flag], input=out, text=True, check=False).returncode == 0


@pytest.mark.campaign
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_the_name_of_a_command(capsys):
    script = run(capsys, "completion", "bash")[1]
    function = next(line.split()[0].rstrip("()") for line in script.splitlines() if line.endswith("() {"))
    script += f"\nCOMP_WORDS=(schuler navi); COMP_CWORD=1; {function}; printf '%s\\n' \"${{COMPREPLY[@]}}\"\n"
    done = subprocess.run(["bash"], input=script, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["navigate"]


def test_another_shell_is_refused(capsys):
    assert "bash" in refusal(capsys, "completion", "tcsh")
