"""The proposal itself: files, cures, IMU, set-up and aids joined to a configuration that runs."""

from __future__ import annotations

import contextlib
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.diagnosis.gyro_unit import COUNTS_PER_DEG_S, are_counts, possible_units
from schuler.diagnosis.log import diagnose_log, read_leniently
from schuler.diagnosis.result import Diagnosis, Finding
from schuler.exceptions import InputError, SchulerError
from schuler.navigation.config import NavigationConfig
from schuler.plotting.notebook import Displayed
from schuler.proposal import arrays, cures, setup
from schuler.proposal.axes import borne_out, likely_axes_by_trial, upright_axes
from schuler.proposal.clock import SHIFT, SIGMA, uncertainty_of_shift
from schuler.proposal.damage import leave_out_garbled
from schuler.proposal.decision import Decision, UndecidedError, option
from schuler.proposal.files import SOMEWHERE, Files, files_of, hints_of
from schuler.proposal.hints import UNTIL, is_plain, rates_by_name
from schuler.proposal.imu_model import imu_entries
from schuler.proposal.reading import heads, read_files, takes
from schuler.proposal.toml import comment, section_lines
from schuler.recording.io import dispatch, packed
from schuler.recording.part import cut
from schuler.recording.recording import Recording
from schuler.standstill.unscaled import unscaled_rests
from schuler.toml import merged
from schuler.units import DEG

_ROUNDS = 8  # of cures; each judges the log anew
_WITH_SCALES = 33  # states, those of scale factors and misalignments among them
_GIVEN = "as said"
_REFUSED = ("refused", "unreadable", "missing", "duplicates", "backward_times")  # findings on rows, among others


@dataclass(frozen=True, repr=False)
class Proposal(Displayed):
    """A configuration that runs, with the recording it is for.

    Attributes
    ----------
    log : Path
        File or folder.
    recording : Recording
    config : NavigationConfig
    data : dict
        Its entries that differ from the defaults, as nested sections.
    decisions : tuple of Decision
    remarks : tuple of str
        What is worth knowing and changes nothing.
    part : (float or None, float or None)
        Seconds from the start of the log that the recording is cut to.
    """

    log: Path
    recording: Recording
    config: NavigationConfig
    data: dict[str, Any]
    decisions: tuple[Decision, ...]
    remarks: tuple[str, ...] = ()
    part: tuple[float | None, float | None] = (None, None)

    def _headline(self) -> str:
        return f"{self.log.name}: {len(self.decisions)} decisions, {len(self.remarks)} remarks"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        rows = [(d.entry, "left as it is" if d.value is None else _shown(d.value), d.evidence) for d in self.decisions]
        return ("entry", "value", "evidence"), rows

    def summary(self) -> str:
        """What was decided, on what evidence, and the option that overrides it."""
        lines = [f"{self.log.name}: decided without a configuration; --set ENTRY=VALUE overrides"]
        for d in self.decisions:
            title = f"{d.entry} left as it is" if d.value is None else f"{d.entry} = {_shown(d.value)}"
            lines += textwrap.wrap(f"{title}: {d.evidence}", 110, initial_indent="  ", subsequent_indent="      ")
            lines.append(f"      {d.option if d.value is not None else option(d.entry, None)}")
        for remark in self.remarks:
            lines += textwrap.wrap(f"note: {remark}", 110, initial_indent="  ", subsequent_indent="      ")
        return "\n".join(lines)

    def toml(self) -> str:
        """The configuration as a file, each entry with its evidence."""
        options = "".join(
            f" {name} {t:g}" for name, t in zip(("--from", "--to"), self.part, strict=True) if t is not None
        )
        lines = [
            f"# Navigation of {self.log.name}, as its own numbers propose it; every entry may be edited:",
            f"#   schuler navigate {self.log} --config drive.toml{options}",
        ]
        left = [f"{d.entry} was left at its default: {d.evidence}" for d in self.decisions if d.value is None]
        for text in (*left, *self.remarks):
            lines += comment(text)
        return "\n".join([*lines, *section_lines(self.data, "", {d.entry: d.evidence for d in self.decisions})]) + "\n"


@explains_arguments
def propose(
    paths: Path | str | Sequence[Path | str],
    *,
    imu: str | None = None,
    given: Mapping[str, Any] | None = None,
    trials: bool = True,
    part: tuple[float | None, float | None] = (None, None),
) -> Proposal:
    """Propose a configuration for files as they are.

    Parameters
    ----------
    paths : path, or sequence of paths
        A folder, a file, the files of one run, or its folder and files that lie elsewhere; these come first.
    imu : str, optional
        Name of the catalogue or file of ``schuler allan``.
    given : mapping, optional
        Entries of the configuration by name with dots, ``{"recording.imu.axes": "FLU"}``; they stand, whatever the log
        says.
    trials : bool
        Also what takes trial runs of the filter: clock, lever arm, aids. Otherwise these keep their defaults.
    part : (float or None, float or None)
        Propose for what lies between these times from the start of the log. Units, axes and clocks are still judged by
        all of it. [s]

    Returns
    -------
    Proposal

    Raises
    ------
    UndecidedError
        If something has to be known that the log does not tell.
    InputError, FileFormatError
        If there is nothing to navigate, or it cannot be read.

    Examples
    --------
    >>> proposal = schuler.propose("town.parquet", imu="MTi-G-710", trials=False)
    >>> proposal.config.imu.catalogue
    'MTi-G-710'
    """
    listed = [Path(p) for p in ([paths] if isinstance(paths, (str, Path)) else paths)]
    fixed = setup.nested(dict(given or {}))
    stated = hints_of(listed, fixed.get("recording", {}))
    files = files_of(listed, stated)
    diagnosis = _cured(files, stated)
    recording = cut(read_files(files), *part)
    if recording.gnss is None and recording.ranges is None and recording.observations is None and not _starts(fixed):
        raise _without_fixes(files, recording)
    data: dict[str, Any] = {"recording": files.entries} if files.entries else {}
    decisions = list(files.decisions)
    sections = {name: section for name, section in fixed.items() if name != "recording"}
    data = merged(data, sections)
    off = [name for name, value in (given or {}).items() if value is None]
    decisions += [
        Decision(name, value, _GIVEN)
        for name, value in (given or {}).items()
        if name.split(".")[0] in sections and value is not None
    ]
    if not any(name in data.get("imu", {}) for name in ("catalogue", "spec", "gyro")):
        rests = unscaled_rests(recording.need_imu().rates())
        entries, why = imu_entries(imu, recording.need_imu(), rests, heads(files))
        data = merged(data, {"imu": entries})
        decisions.append(why)
    for d in setup.certain(recording, diagnosis):
        if not setup.has(data, d.entry):
            data = merged(data, setup.nested({d.entry: d.value}))
            decisions.append(d)
    scaled = next((d for d in decisions if d.entry.endswith(".scale") and "gyro=" in str(d.value)), None)
    if scaled is not None and not setup.has(data, "filter.states"):
        data = merged(data, {"filter": {"states": _WITH_SCALES}})
        evidence = (
            "the scale of the gyroscopes is known from motion only: errors of scale factors and axes are estimated"
        )
        decisions.append(Decision("filter.states", _WITH_SCALES, evidence))
    if not setup.has(data, "filter.tune"):
        data = merged(data, {"filter": {"tune": "auto"}})
    if trials:
        data, more = setup.tried(recording, diagnosis, data)
        decisions += more
    shifted = any(d.entry == SHIFT and d.value is not None and d.evidence != _GIVEN for d in decisions)
    if shifted and not setup.has(data, SIGMA):
        uncertainty = uncertainty_of_shift(recording, diagnosis, data)
        if uncertainty is not None:
            data = merged(data, setup.nested({uncertainty.entry: uncertainty.value}))
            decisions.append(uncertainty)
    data = _without(data, off)
    config = NavigationConfig.parse(data, "the proposed configuration")
    remarks = _remarks(files, diagnosis)
    return Proposal(files.log, recording, config, data, tuple(decisions), tuple(remarks), part)


def propose_reading(
    log: Path, entries: Mapping[str, Any], stated: Mapping[str, Any] | None = None, *, complete: bool = True
) -> tuple[dict[str, Any], list[Decision]]:
    """Propose how a log is read: hints with every sure cure in them, and the decisions.

    Parameters
    ----------
    log : Path
    entries : mapping
        Hints so far, right or wrong; for a folder without any its files are recognised.
    stated : mapping, optional
        Those of them that stand, whatever the log says.
    complete : bool
        Files that the hints name are all there are; otherwise the others of a folder are looked for.

    Raises
    ------
    UndecidedError, InputError
        As :func:`propose` does.
    """
    files = files_of([log], entries, complete=complete)
    _cured(files, stated or {})
    return files.entries, files.decisions


def _without(data: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Entries without those that were taken out."""
    for name in names:
        sections, _, last = name.rpartition(".")
        at: Any = data
        for section in sections.split("."):
            at = at.get(section, {})
        at.pop(last, None)
    return data


def _cured(files: Files, given: Mapping[str, Any]) -> Diagnosis:
    """Diagnosis of the log with every sure cure in its hints."""
    for _ in range(_ROUNDS):
        diagnosis = diagnose_log(files.log, quick=True, **files.entries)
        refused = any(f.code in _REFUSED for f in diagnosis.findings)
        if (refused and leave_out_garbled(files, given)) or _step(files, diagnosis.findings, given):
            continue
        if not likely_axes_by_trial(files, diagnosis, given) and not upright_axes(files, diagnosis, given):
            break
    if question := _question(files, diagnosis):
        raise question
    _rate_unit(files, diagnosis, given)
    arrays.forget()  # nobody asks for columns any more: a day's log would stay beside the recording
    return diagnosis


def _rate_unit(files: Files, diagnosis: Diagnosis, given: Mapping[str, Any]) -> None:
    """Take the unit of angular rate that sizes leave where no header and no turn tells it; ask where several are left.

    Raises
    ------
    UndecidedError
        If several are left.
    """
    entry = files.entry("imu")
    [label, *others] = files.names_of("imu", "units")
    stated = given.get("imu", {}) if files.by_part else given
    assumed = any(d.entry == label and d.evidence.endswith(UNTIL) for d in files.decisions)
    if (
        entry is None
        or not assumed
        or others
        or "units" in stated
        or any(c.startswith("unit of angular") for c in diagnosis.checked)
    ):
        return
    recording = next((r for r in read_leniently(files.log, **files.entries)[:2] if r is not None and r.imu), None)
    if recording is None:
        return  # reading says what is missing
    imu = recording.need_imu()
    left, why = possible_units(imu.rates())
    words = {unit: {label: str(entry["units"]).replace("gyro=rad/s", f"gyro={unit}")} for unit in left}
    counted = "accel=" in str(entry.get("scale"))  # no usual unit explains its size
    if "gyro" not in str(entry.get("scale")) and imu.kind == "rate" and are_counts(imu.gyro, beside_counts=counted):
        name = files.names_of("imu", "scale")[0]
        for lsb in COUNTS_PER_DEG_S:
            scale = ",".join(filter(None, (entry.get("scale"), f"gyro={DEG / lsb:.6g}")))
            words[f"counts, {lsb:g} in a deg/s"] = {label: entry["units"], name: scale}
    if len(words) == 1 and len(left) == 1:
        files.put("imu", {"units": words[left[0]][label]})
        files.decisions = [d for d in files.decisions if d.entry != label]
        files.decisions.append(Decision(label, words[left[0]][label], why))
        return
    if best := borne_out(files, words):
        for at, value in words[best[0]].items():
            files.put("imu", {at.rpartition(".")[2]: value})
            files.decisions = [d for d in files.decisions if d.entry != at]
            files.decisions.append(Decision(at, value, f"no header states the unit of angular rate; {best[1]}"))
        return
    raise UndecidedError(
        f"{files.log}: no header states the unit of angular rate, and no turn beside fixes or between rests tells it"
        + (f" ({why})" if why else ""),
        list(words.items()),
    )


def _step(files: Files, findings: Sequence[Finding], given: Mapping[str, Any]) -> bool:
    """Put the cures of the first step that has any into the hints; whether there were any."""
    for codes in cures.STEPS:
        done = False
        for f in findings:
            entry = files.entry(f.part)
            if f.code not in codes or entry is None:
                continue
            new = cures.mended(f, entry)
            stated = given.get(f.part, {}) if files.by_part else given
            if new is None or any(name in stated for name in new) or all(entry.get(k) == v for k, v in new.items()):
                continue
            if "axes" in new and (exchanged := _rates_by_name(files, str(new["axes"]))):
                new["columns"] = exchanged
            files.put(f.part, new)
            for label, value in ((at, v) for name, v in new.items() for at in files.names_of(f.part, name)):
                files.decisions = [d for d in files.decisions if d.entry != label]
                why = (
                    "roll and pitch are rates about the axes along and across" if label.endswith("columns") else f.text
                )
                files.decisions.append(Decision(label, value, why))
            done = True
        if done:
            return True
    return False


def _rates_by_name(files: Files, axes: str) -> str | None:
    """Columns of an IMU's table whose rates are called after the vehicle's axes, which the accelerometer's are not."""
    entry = files.entry("imu") or {}
    if files.by_part and "file" not in entry:
        return None
    path = packed.resolved(files.log / str(entry["file"])) if files.by_part else files.log
    return rates_by_name(path, entry.get("columns"), axes) if path.is_file() and is_plain(path) else None


def _question(files: Files, diagnosis: Diagnosis) -> SchulerError | None:
    """What is left open that makes results garbage, as a question; an error where nothing is to choose."""
    for f in diagnosis.findings:
        if f.consequence != "garbage" and f.code != "axes":
            continue
        if f.code == "axes" and (f.confidence >= cures.SURE or f.severity == "note"):
            continue
        if f.code == "time_offset" and f.confidence >= cures.SURE:
            continue  # the run shifts the clock by it
        entry = files.entry(f.part)
        if f.code == "unreadable" or entry is None:
            if f.confidence >= cures.SURE:
                return InputError(f"{diagnosis.name}: {f.text}" + (f" -> {f.fix}" if f.fix else ""))
            continue
        new = cures.proposed(f, entry)
        if new is None:
            if f.confidence >= cures.SURE:
                return InputError(f"{diagnosis.name}: {f.code}: {f.text}" + (f" -> {f.fix}" if f.fix else ""))
            continue
        if f.code == "axes" and not _one_axes(f.fix):
            continue
        words = {at: value for name, value in new.items() for at in files.names_of(f.part, name)}
        stays = {name: entry.get(name.rpartition(".")[2], _DEFAULTS.get(name.rpartition(".")[2])) for name in words}
        if all(value is not None for value in stays.values()) and all(d.entry not in words for d in files.decisions):
            if not takes(files, words):
                continue  # a format that states it is believed: an answer would be refused
            return UndecidedError(
                f"{f.text} ({100.0 * f.confidence:.0f} % likely)", [("so it is", words), ("as it was read", stays)]
            )
    return None


def _remarks(files: Files, diagnosis: Diagnosis) -> list[str]:
    """What is neither cured nor asked about and yet to be known: axes of which several are possible, among others."""
    remarks = [f.text for f in diagnosis.findings if f.code in ("height_level", "mount", "unchecked", "gyro_axes")]
    remarks += [
        f"{f.text} ({100.0 * f.confidence:.0f} % likely); it is read as it stands, "
        f"--set {files.names_of(f.part, 'axes')[0]}=... says otherwise"
        for f in diagnosis.findings
        if f.code == "axes" and f.severity == "warning"
    ]
    if files.ignored:
        remarks.append(f"files that were not read: {', '.join(dict.fromkeys(files.ignored))}")
    return remarks


_DEFAULTS = {
    "axes": "FRD", "units": "accel=m/s^2,gyro=rad/s", "kind": "rate", "offset": 0.0, "height": "ellipsoidal",
    "scale": "accel=1,gyro=1",
}  # fmt: skip


def _one_axes(fix: str) -> bool:
    return re.fullmatch(r"axes='[FBRLUD]{3}'", fix) is not None


def _without_fixes(files: Files, recording: Recording) -> UndecidedError:
    """Question what a log without fixes is navigated from; the truth, if it has one, is taken only as the user says."""
    nothing = f"{files.log}: there are no fixes and no satellite measurements"
    label = "recording.reference" if files.by_part else "recording"
    place: dict[str, Any] = {}
    if recording.reference is None:
        place = {"origin": SOMEWHERE}
        with contextlib.suppress(SchulerError):
            recording = dispatch.read(files.log, **(files.entries | place))
    if recording.reference is None or files.by_part:
        ignored = ", ".join(dict.fromkeys(files.ignored))
        which = "--set recording.gnss.file=NAME --set recording.gnss.columns='\"t,lat,lon,h\"' (- skips one)"
        return UndecidedError(
            f"{nothing}{f' in what was recognised; {ignored} was not' if ignored else ''}: "
            f"{f'say which of these holds fixes and its columns, {which}, ' if ignored else ''}"
            "give the file with fixes beside the IMU's, or say in a --config how it starts "
            "(alignment.method = 'given') and where (a file with the reference)"
        )
    placed = {f"{label}.{name}": value for name, value in place.items()}
    where = " (where its local frame lies is not stated; 45 deg north will do for gravity)" if place else ""
    fixes = placed | {f"{label}.truth_fixes": "1,0.05"}
    choices = [("fixes made of the reference, one a second with noise of 5 cm: no measurements", fixes)]
    if recording.reference.q_eb is not None:
        start = recording.reference.at([np.ceil(recording.reference.t[0])])  # where the first of these fixes is
        rpy = [round(float(x), 2) for x in start.rpy_nb[0] / DEG]
        alone = fixes | {"alignment.method": "given", "alignment.rpy_deg": rpy, "gnss.coupling": "off"}
        choices.append(("by the IMU alone from the first state of the reference on, which drifts", alone))
    return UndecidedError(f"{nothing}, but a reference{where}. What is it to be navigated from", choices)


def _starts(fixed: Mapping[str, Any]) -> bool:
    return bool(fixed.get("alignment", {}).get("method") == "given")


def _shown(value: Any) -> str:
    return "on" if value == {} else str(value)
