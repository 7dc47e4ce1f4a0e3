"""The command of a run that a page puts together: options instead of clicks, so that it can be repeated."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from schuler.budget.scenario import BudgetScenario
from schuler.exceptions import ConfigError, InputError
from schuler.files import read_toml, sha256, write_text
from schuler.navigation.config import NavigationConfig
from schuler.proposal.decision import option
from schuler.proposal.setup import nested
from schuler.studio.workspace import Workspace
from schuler.toml import merged, toml_with


def seconds(value: float) -> str:
    """Time of an outage to the millisecond, without zeros at the end."""
    return f"{value:.3f}".rstrip("0").rstrip(".")


def navigate_arguments(
    log: str,
    config: str,
    out: str,
    changes: Mapping[str, Any],
    outages: Sequence[tuple[float, float]],
) -> list[str]:
    """Arguments after ``schuler``.

    Parameters
    ----------
    log, config, out : str
        From the root of the workspace on.
    changes : mapping
        Entries that differ from the file's, by name with dots; None takes an aid out.
    outages : sequence of (start, stop)
        From the start of the recording. [s]

    Raises
    ------
    InputError
        If an entry is taken out that no option takes out.
    """
    arguments = ["navigate", log, "--config", config, "--out", out]
    for name, value in changes.items():
        if value is None and name.startswith("aiding.") and name.count(".") == 1:
            arguments += ["--without", name.partition(".")[2]]
        elif value is None:
            raise InputError(f"{name}: an option cannot take an entry out: save the configuration first")
        elif value == {}:
            arguments += ["--aid", name.partition(".")[2]]
        else:
            arguments += shlex.split(option(name, value))
    for start, stop in outages:
        arguments += ["--outage", f"{seconds(start)}:{seconds(stop)}"]
    return arguments


def allan_arguments(
    log: str, config: str, out: str, span: tuple[float, float] | None, exports: Sequence[str] = ()
) -> list[str]:
    """Arguments after ``schuler`` that identify the noise of a log.

    Parameters
    ----------
    log, out : str
        From the root of the workspace on.
    config : str
        Configuration that says how the log is read; empty if it does so itself.
    span : (start, stop) or None
        Part of the log that is used. [s]
    exports : sequence of str
        Programs that files are written for.
    """
    arguments = ["allan", log, *(["--config", config] if config else [])]
    if span is not None:
        arguments += ["--from", seconds(span[0]), "--to", seconds(span[1])]
    return [*arguments, *(word for name in exports for word in ("--export", name)), "--out", out]


def budget_arguments(scenario: str, imus: Sequence[str], out: str, changes: Mapping[str, Any]) -> list[str]:
    """Arguments after ``schuler`` for the error budget of a mission.

    Parameters
    ----------
    scenario, out : str
        From the root of the workspace on.
    imus : sequence of str
        Of the catalogue, or files; none: the catalogue is ranked.
    changes : mapping
        Entries that differ from the file's, by name with dots.

    Raises
    ------
    InputError
        If an entry is taken out, which no option does.
    """
    if removed := [name for name, value in changes.items() if value is None]:
        raise InputError(f"{', '.join(removed)}: an option cannot take an entry out: do so in {scenario}, in an editor")
    settings = [word for name, value in changes.items() for word in shlex.split(option(name, value))]
    return ["budget", scenario, *(word for imu in imus for word in ("--imu", imu)), *settings, "--out", out]


def study_arguments(kind: str, scenario: str, out: str, runs: int | None, *, search: bool = False) -> list[str]:
    """Arguments after ``schuler`` that simulate a mission many times.

    Parameters
    ----------
    kind : {"montecarlo", "rotary"}
        As :func:`schuler.studio.workspace.studies` says of the scenario.
    scenario, out : str
        From the root of the workspace on. Runs of a campaign are kept in a store beside ``out`` as they finish, and
        the same command goes on with it.
    runs : int or None
        None: as the scenario says.
    search : bool
        Whether the best schedule of a platform is looked for.

    Raises
    ------
    InputError
        If the number of runs is not one.
    """
    if runs is not None and runs < 1:
        raise InputError(f"runs: expected 1 or more, got {runs}")
    number = [] if runs is None else ["--runs", str(runs)]
    if kind == "montecarlo":
        return [kind, scenario, *number, "--store", f"{out}-store", "--resume", "--out", out]
    return [kind, scenario, *number, *(["--search"] if search else []), "--out", out]


def calibrate_arguments(
    method: str, log: str, config: str, out: str, options: Mapping[str, Any], *, report: bool = False
) -> list[str]:
    """Arguments after ``schuler`` that calibrate from a log.

    Parameters
    ----------
    method : str
        ``freepose`` or ``field``.
    log, out : str
        From the root of the workspace on.
    config : str
        Configuration that says how the log is read; empty if it does so itself.
    options : mapping
        Values by the name of the option without its hyphens; True: an option without a value; None: left out.
    report : bool
        Whether a report is written, which takes twice the time of the calibration.
    """
    arguments = ["calibrate", method, log, *(["--config", config] if config else [])]
    for name, value in options.items():
        if value is not None and value != "":
            text = f"{value:.12g}" if isinstance(value, float) else str(value)
            arguments += [f"--{name}"] if value is True else [f"--{name}", text]
    return [*arguments, *([] if report else ["--no-report"]), "--out", out]


def option_of(arguments: Sequence[str], name: str) -> str:
    """Value of an option in a command; empty if it is not there."""
    return next((value for word, value in pairwise(arguments) if word == f"--{name}"), "")


def origin_of(arguments: Sequence[str]) -> tuple[str, str, list[tuple[float, float]]]:
    """Log, configuration and outages of a command that :func:`navigate_arguments` made."""
    windows = [value.split(":") for name, value in pairwise(arguments) if name == "--outage"]
    return arguments[1], option_of(arguments, "config"), [(float(start), float(stop)) for start, stop in windows]


def shell(arguments: Sequence[str]) -> str:
    """A command as it is typed."""
    return shlex.join(["schuler", *arguments])


def checked(
    workspace: Workspace,
    config: str,
    changes: Mapping[str, Any],
    model: type[NavigationConfig | BudgetScenario] = NavigationConfig,
) -> None:
    """Refuse entries that the configuration cannot have, before anything is run.

    Raises
    ------
    ConfigError
        With every fault.
    """
    model.load(workspace.inside(config), list(changes.items()))


def saved(
    workspace: Workspace,
    config: str,
    changes: Mapping[str, Any],
    before: str,
    model: type[NavigationConfig | BudgetScenario] = NavigationConfig,
) -> str:
    """Write changed entries into a configuration; its new checksum.

    Parameters
    ----------
    workspace : Workspace
    config : str
    changes : mapping
        As of :func:`navigate_arguments`.
    before : str
        Checksum of the file that the page was made from.
    model : type
        Of the configuration.

    Raises
    ------
    InputError
        If somebody else changed the file meanwhile, or an entry cannot be taken out line by line.
    ConfigError
        If the result is no configuration.
    """
    path = workspace.inside(config)
    if sha256(path) != before:
        raise InputError(f"{config} was changed meanwhile, by another tab or an editor: load it again, then change it")
    checked(workspace, config, changes, model)
    data = read_toml(path)
    removed = [name for name, value in changes.items() if value is None]
    if removed:
        raise InputError(f"{', '.join(removed)}: remove it from {config} in an editor, so that its comments stay right")
    stated = {name: value for name, value in changes.items() if value != {}}
    switched = [name for name, value in changes.items() if value == {} and not _has(data, name)]
    text = toml_with(path.read_text(encoding="utf-8"), nested(stated)) if stated else path.read_text(encoding="utf-8")
    missing = [name for name in switched if not any(other.startswith(f"{name}.") for other in stated)]
    text += "".join(f"\n[{name}]\n" for name in missing)
    write_text(path, text, at_once=True)
    return sha256(path)


def data_of(workspace: Workspace, config: str) -> tuple[dict[str, Any], str]:
    """Entries of a configuration, and its checksum.

    Raises
    ------
    ConfigError, InputError
        If it is no TOML file.
    """
    path = workspace.inside(config)
    if path.suffix != ".toml" or not path.is_file():
        raise ConfigError(f"{config}: expected a configuration, a .toml file of the folder; Propose makes one")
    return read_toml(path), sha256(path)


def proposal_of(hints: Mapping[str, Any], imu: str) -> tuple[dict[str, Any], str | None]:
    """What is given to a proposal: how the log is read, by name with dots, and the IMU."""
    given: dict[str, Any] = {}
    for name, value in merged({}, hints).items():
        if isinstance(value, Mapping):
            given |= {f"recording.{name}.{key}": one for key, one in value.items()}
        else:
            given[f"recording.{name}"] = value
    return given, imu.strip() or None


def _has(data: Mapping[str, Any], name: str) -> bool:
    from schuler.proposal.setup import has

    return has(dict(data), name)
