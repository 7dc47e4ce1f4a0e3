"""The form: every entry of the schema, values spelt as in TOML, changes that become options and files again."""

import tomllib
from itertools import pairwise

import pytest

from schuler.budget.scenario import BudgetScenario
from schuler.cli.configuration import entries
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.config import NavigationConfig
from schuler.studio import form, runner
from schuler.studio.workspace import Workspace, write_mission

TOML = """\
# a drive
[imu]
catalogue = "MPU-6000"   # as printed on it
[gnss]
lever_arm_m = [1.0, 0.0, -1.5]
[aiding.zero_velocity]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "drive.toml").write_text(TOML)
    return Workspace(tmp_path.resolve())


def test_every_entry_has_its_default_as_the_model_has_it():
    defaults = NavigationConfig.parse({"imu": {"catalogue": "MPU-6000"}}).model_dump(mode="json")
    names = [field.name for field in form.fields()]
    assert len(names) == len(set(names))
    compared = 0
    for field in form.fields():
        at = defaults
        for part in field.name.split("."):
            at = at.get(part) if isinstance(at, dict) else None
        if field.default and at is not None:
            assert tomllib.loads(f"x = {field.default}")["x"] == at
            compared += 1
    assert compared > 50


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("gnss.lever_arm_m", "m"),
        ("imu.mount_rpy_deg", "deg"),
        ("aiding.gravity.sigma_m_s2", "m/s²"),
        ("filter.tune", ""),
    ],
)
def test_units(name, unit):
    assert next(field for field in form.fields() if field.name == name).unit == unit


def test_what_is_stated_is_shown_and_changes_nothing():
    data = tomllib.loads(TOML)
    texts = {field.name: form.shown(data, field) for field in form.fields()}
    assert texts["gnss.lever_arm_m"] == "[1.0, 0.0, -1.5]"
    assert texts["aiding.zero_velocity"] == "true"
    assert form.changes(data, texts) == {}


def test_changes_are_options_that_the_command_reads_alike(folder):
    data, _ = runner.data_of(folder, "drive.toml")
    texts = {
        "gnss.lever_arm_m": "[0.5, 0.0, -1.0]", "filter.states": "21", "alignment.method": '"course"',
        "filter.smooth": "false", "aiding.zero_rate": "true", "aiding.zero_velocity": "", "imu.catalogue": "HG1700",
    }  # fmt: skip
    changes = form.changes(data, texts)
    arguments = runner.navigate_arguments("a log.csv", "drive.toml", "run-1", changes, [(120.0, 135.5)])
    assert arguments[:6] == ["navigate", "a log.csv", "--config", "drive.toml", "--out", "run-1"]
    assert arguments[-2:] == ["--outage", "120:135.5"]
    options = dict(entries(tuple(b for a, b in pairwise(arguments) if a == "--set")))
    assert options == {name: value for name, value in changes.items() if value not in ({}, None)}
    assert arguments[arguments.index("--aid") + 1] == "zero_rate"
    assert arguments[arguments.index("--without") + 1] == "zero_velocity"
    assert runner.origin_of(arguments) == ("a log.csv", "drive.toml", [(120.0, 135.5)])
    assert runner.shell(arguments).startswith("schuler navigate 'a log.csv' --config")


@pytest.mark.parametrize(
    ("name", "text"), [("filter.states", "[1"), ("filter.smooth", "perhaps"), ("gnss.lever_arm_m", "{")]
)
def test_what_is_no_value_is_refused_with_what_was_expected(name, text):
    with pytest.raises(InputError, match=f"{name}: expected"):
        form.changes({}, {name: text})


def test_saving_keeps_comments_and_is_refused_after_another_did(folder):
    data, checksum = runner.data_of(folder, "drive.toml")
    changes = form.changes(data, {"gnss.lever_arm_m": "[0.5, 0.0, -1.0]", "aiding.zero_rate": "true"})
    new = runner.saved(folder, "drive.toml", changes, checksum)
    text = (folder.root / "drive.toml").read_text()
    assert "# as printed on it" in text
    loaded = NavigationConfig.load(folder.root / "drive.toml")
    assert loaded.gnss.lever_arm_m == (0.5, 0.0, -1.0)
    assert loaded.aiding.zero_rate is not None
    with pytest.raises(InputError, match="was changed meanwhile"):
        runner.saved(folder, "drive.toml", changes, checksum)
    assert runner.saved(folder, "drive.toml", {}, new) == new


def test_wrong_values_are_refused_with_the_sentence_of_the_command(folder):
    with pytest.raises(ConfigError, match=r"gnss\.gate"):
        runner.checked(folder, "drive.toml", {"gnss.gate": 3.0})
    with pytest.raises(InputError, match="save the configuration first"):
        runner.navigate_arguments("a", "b", "c", {"gnss.lever_arm_m": None}, [])


def test_a_mission_changed_in_the_form_is_the_same_as_options_and_as_a_file(folder):
    name = write_mission(folder)
    data, checksum = runner.data_of(folder, name)
    assert {form.shown(data, f) for f in form.fields(BudgetScenario)} > {"15", '"waypoints"', "[[90.0, 150.0]]"}
    unchanged = {f.name: form.shown(data, f) for f in form.fields(BudgetScenario)}
    assert form.changes(data, unchanged, BudgetScenario) == {}
    texts = {"gnss.outages_s": "[[60, 90]]", "require": '["heading < 3 deg @ always"]', "non_holonomic": "true"}
    changes = form.changes(data, unchanged | texts, BudgetScenario)
    arguments = runner.budget_arguments(name, ["MPU-6000"], "out", changes)
    assert arguments[:4] == ["budget", name, "--imu", "MPU-6000"]
    options = tuple(value for option, value in pairwise(arguments) if option == "--set")
    by_options = BudgetScenario.load(folder.inside(name), entries(options, sections=False))
    runner.saved(folder, name, changes, checksum, BudgetScenario)
    assert BudgetScenario.load(folder.inside(name)) == by_options
    assert by_options.require == ("heading < 3 deg @ always",)
    assert by_options.non_holonomic is not None
    assert "# what specifications of accelerometers leave out" in folder.inside(name).read_text()
    with pytest.raises(InputError, match="an option cannot take an entry out"):
        runner.budget_arguments(name, [], "out", {"zero_velocity": None})
    with pytest.raises(ConfigError, match="states"):
        runner.checked(folder, name, {"states": 16}, BudgetScenario)


def test_a_table_in_a_list_is_one_entry_of_a_form(folder):
    name = write_mission(folder)
    data, _ = runner.data_of(folder, name)
    field = next(f for f in form.fields(BudgetScenario) if f.name == "motion.waypoints")
    assert form.entered(field, form.shown(data, field)) == data["motion"]["waypoints"]


@pytest.mark.parametrize(
    "value", [["b_a", "b_g"], [["a b", 'c"d']], [{"x": 1.0, "y": True}], [[60.0, 90.0]], 21, "a b", {}]
)
def test_a_value_comes_through_the_shell_as_it_was(value):
    arguments = runner.navigate_arguments("log", "drive.toml", "out", {"filter.states": value}, [])
    if value == {}:  # a section that is switched on
        assert arguments[-2:] == ["--aid", "states"]
    else:
        assert entries((arguments[arguments.index("--set") + 1],)) == [("filter.states", value)]
