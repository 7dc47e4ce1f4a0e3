"""``schuler allan``."""

from __future__ import annotations

import math
import time as clock
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from schuler.characterisation.result import AXES, TERMS, AxisNoise, Estimate, Finding, NoiseIdentification
from schuler.cli.output import Flag, Folder, Texts, drawable, named, print_json, progress, say, writable
from schuler.cli.reading import Reading, of_part
from schuler.diagnosis.result import as_options
from schuler.exceptions import InputError, OverwriteError
from schuler.recording.recording import Recording

if TYPE_CHECKING:
    from schuler.calibration.result.result import CalibrationResult

_READING = Reading()


def allan(
    log: Path,
    /,
    *more: Path,
    method: Literal["gmwm", "allan"] = "gmwm",
    robust: Flag = False,
    out: Folder = None,
    export: Texts = (),
    inflate: float | None = None,
    duration: float | None = None,
    report: bool = True,
    json: Flag = False,
    reading: Reading = _READING,
) -> int:
    """Identify the noise of an IMU from logs at rest and write budget, report, figures and other programs' files.

    Parameters
    ----------
    log
        File or folder with a recording at rest; or a table of an Allan curve, tau,gyro_x,... in seconds and the unit
        that --units says, which is identified without a report.
    more
        More recordings of the same IMU, identified together.
    method
        gmwm takes account of what averaging times have in common, allan is a weighted fit to the curve.
    robust
        Bound the influence of outliers.
    out
        Folder for the files. Default: the first log's name with -noise.
    export
        Also write the file of another program: kalibr, openvins, vins, gtsam, px4, ardupilot, kf-gins; several allowed.
    inflate
        Factor on the noise in exported files; budget and report are never inflated.
    duration
        Length in seconds of the log behind an Allan curve; twice its longest averaging time if left out.
    report
        Write noise.html and figures.
    json
        Print one JSON object instead of text.
    """
    from schuler.characterisation.curves import is_curve_file
    from schuler.characterisation.exports import EXPORTS
    from schuler.characterisation.identification import identify_noise

    began = clock.perf_counter()
    for name in export:
        if name not in EXPORTS:
            raise InputError(f"--export: expected one of {', '.join(EXPORTS)}, got {name!r}")
    if is_curve_file(log, reading.columns):
        if more or robust or export or inflate is not None:
            raise InputError(f"{log} is an Allan curve: --robust, --export, --inflate and more logs need readings")
        return _curves(log, reading, method, duration, json=json)
    figures = drawable(report)
    folder = writable(Path(f"{log.resolve().stem}-noise")) if out is None else out
    recordings = [of_part(reading, path).read(path) for path in (log, *more)]
    name = recordings[0].metadata.name + (f" and {len(more)} more" if more else "")
    with progress("identifying the noise") as bar:
        noise = identify_noise(
            recordings if more else recordings[0], method=method, robust=robust, progress=bar, name=name
        )
    files = write_report(folder, recordings, noise, figures=figures) if report else {}
    if not noise.axes:
        raise InputError(nothing_left(noise))
    exported, failures = write_exports(folder, noise, export, inflate)
    if (means := turn_on_means(noise)) is not None:
        exported["calibration"] = means.to_yaml(folder / "calibration.yaml")
    files = {**exported, **files}
    if json:
        print_json(
            {
                "command": "allan", **numbers(noise), "warnings": [*warnings(noise), *failures],
                "elapsed_s": clock.perf_counter() - began, "files": files,
            }
        )  # fmt: skip
    else:
        from schuler.characterisation.report.text import summary

        for recording in recordings:
            say(as_options(recording.summary()))
        print(summary(noise))
        print("\n".join(f"{what}: {path}" for what, path in files.items() if not what.startswith("figure")))
    for failure in failures:
        say(f"schuler: {failure}")
    # a file that was asked for and is not there is no success
    return 2 if failures and export else 0


def _curves(
    log: Path, reading: Reading, method: Literal["gmwm", "allan"], duration: float | None, *, json: bool
) -> int:
    """Identify the curves of a table and print what was found."""
    from schuler.characterisation.curves import identify_curve, read_curves
    from schuler.characterisation.fitting import NoFitError
    from schuler.characterisation.report.text import summary
    from schuler.recording.io.hint_texts import factor

    if reading.units is None:
        raise InputError(f"{log}: the unit of an Allan curve is not in it: say --units deg/h, or accel=mg,gyro=deg/h")
    stated = dict(part.split("=", 1) for part in reading.units.split(",")) if "=" in reading.units else {}
    tau, deviations = read_curves(log, reading.columns)
    axes: dict[str, AxisNoise] = {}
    refused: dict[str, tuple[Finding, ...]] = {}
    for k, (name, deviation) in enumerate(deviations.items()):
        triad = "accel" if name.startswith("a") and name != "adev" else "gyro"
        unit = stated.get(triad, reading.units)
        if not stated and name not in AXES:  # the unit tells what it is
            triad = "gyro" if "/" in unit and any(word in unit for word in ("rad", "deg", "arc")) else "accel"
        axis = name if name in AXES else f"{triad}_{'xyz'[k % 3]}"
        try:
            values = deviation * factor(unit, triad)
            axes[axis] = identify_curve(
                tau, values, axis=axis, duration_s=duration, rate_hz=reading.rate, method=method
            )
        except NoFitError as error:
            refused[axis] = (Finding("no_fit", f"{axis}: {error}", severity="refused"),)
    note = "Identified from a curve: of the readings behind it no fault can be seen, and there is no mean."
    noise = NoiseIdentification(log.stem, axes, refused, None, {}, notes=(note,))
    if not axes:
        raise InputError(nothing_left(noise))
    if json:
        print_json({"command": "allan", **numbers(noise), "warnings": warnings(noise), "files": {}})
    else:
        print(summary(noise))
    return 0


def write_report(
    folder: Path, recordings: list[Recording], noise: NoiseIdentification, *, figures: bool
) -> dict[str, Path]:
    """Page, and figures as files; the log itself is shown if there is only one."""
    from schuler.characterisation.report.document import noise_report
    from schuler.characterisation.report.figures import save_noise_figures
    from schuler.characterisation.report.spectra import log_spectra

    imus = [recording.need_imu() for recording in recordings]
    spectra = log_spectra(max(imus, key=lambda imu: float(imu.t[-1] - imu.t[0])))
    imu = imus[0] if len(imus) == 1 else None
    described = "\n".join(recording.summary() for recording in recordings)
    files = {
        "report": noise_report(
            noise, folder / "noise.html", imu=imu, spectra=spectra, recording_summary=described
        )
    }  # fmt: skip
    if figures:
        files |= named(save_noise_figures(noise, folder / "figures", imu=imu, spectra=spectra))
    return files


def write_exports(
    folder: Path, noise: NoiseIdentification, names: tuple[str, ...], inflate: float | None
) -> tuple[dict[str, Path], list[str]]:
    """Budget file and what was asked for; files by name, and sentences on those that cannot be."""
    from schuler.characterisation.exports import EXPORTS, export

    files: dict[str, Path] = {}
    failures: list[str] = []
    for name in dict.fromkeys(("schuler", *names)):
        path = folder / ("imu.toml" if name == "schuler" else f"imu_{name}{EXPORTS[name].suffix}")
        options = {} if inflate is None or name == "schuler" else {"inflation": inflate}
        try:
            files["budget" if name == "schuler" else name] = export(noise, name, path, **options)
        except OverwriteError:
            raise
        except InputError as error:
            failures.append(f"{path.name} was not written: {error}")
    return files, failures


def turn_on_means(noise: NoiseIdentification) -> CalibrationResult | None:
    """Mean rates at rest of several switch-ons as a calibration; None with fewer.

    Earth rate is in the means and in no known direction: a third of its square is added to each variance.
    """
    from schuler.calibration.result.result import result_from
    from schuler.earth import WGS84

    of_gyro = {axis[-1]: t for axis, t in noise.turn_on.items() if axis.startswith("gyro")}
    if not of_gyro:
        return None
    biases = {
        f"b_g_{axis}": (float(t.mean[0]), math.hypot(float(t.mean_sigma[0]), WGS84.omega_ie / math.sqrt(3.0)))
        for axis, t in of_gyro.items()
    }
    return result_from("turn_on", biases, "full", provenance=noise.provenance)


def numbers(noise: NoiseIdentification) -> dict[str, Any]:
    """An identification for JSON; every axis is there, a refused one with empty curves and no terms."""
    axes = {name: _axis(axis) for name, axis in noise.axes.items()}
    for name, reasons in noise.refused.items():
        axes[name] = {
            "tau_s": [], "adev": [], "adev_low": [], "adev_high": [], "terms": {**dict.fromkeys(TERMS), "GM": []},
            "warnings": [f.text for f in reasons], "refused": True, "findings": [asdict(f) for f in reasons],
        }  # fmt: skip
    some = next(iter(noise.axes.values()), None)
    return {
        "name": noise.name, "rate_hz": None if some is None else some.rate_hz,
        "duration_s": None if some is None else some.duration_s, "method": None if some is None else some.method,
        "axes": axes, "refused": {name: [asdict(f) for f in reasons] for name, reasons in noise.refused.items()},
        "findings": [asdict(f) for f in noise.findings], "spec": None if noise.spec is None else noise.spec.to_dict(),
        "spec_sigma": noise.spec_sigma, "notes": noise.notes,
        "turn_on": {axis: asdict(t) for axis, t in noise.turn_on.items()}, "provenance": noise.provenance,
    }  # fmt: skip


def warnings(noise: NoiseIdentification) -> list[str]:
    """Sentences on what a script should not overlook."""
    from schuler.characterisation.report.text import findings, located

    return [located(where, f) for where, f in findings(noise) if f.severity != "note"]


def nothing_left(noise: NoiseIdentification) -> str:
    """Why there is no result at all, in one line."""
    from schuler.characterisation.report.text import located

    about = [located(name, f) for name, several in noise.refused.items() for f in several if f.severity == "refused"]
    about += [f.text for f in noise.findings if f.severity == "refused"]
    return f"{noise.name}: no axis could be identified; {'; '.join(dict.fromkeys(about)) or 'no reason was given'}"


def _axis(axis: AxisNoise) -> dict[str, Any]:
    c = axis.curve
    terms: dict[str, Any] = {letter: _estimate(axis.terms.get(letter)) for letter in TERMS}
    terms["GM"] = [{"sigma": _estimate(sigma), "tau": _estimate(tau)} for sigma, tau in axis.gauss_markov]
    return {
        "tau_s": c.tau, "adev": c.deviation, "adev_low": c.low, "adev_high": c.high, "adev_model": axis.fitted(c.tau),
        "terms": terms, "limits": axis.limits, "refused": False,
        "warnings": [f.text for f in axis.findings if f.severity != "note"],
        "unit": axis.unit, "mean": _estimate(axis.mean), "read_off": axis.read_off,
        "candidates": [asdict(candidate) for candidate in axis.candidates],
        "findings": [asdict(f) for f in axis.findings],
    }  # fmt: skip


def _estimate(e: Estimate | None) -> dict[str, Any] | None:
    return None if e is None else asdict(e)
