"""What every method of ``schuler calibrate`` writes and prints."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import units as u
from schuler.cli.calibrate_options import Output, Site
from schuler.cli.output import drawable, named, print_json, say
from schuler.diagnosis.result import as_options
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.calibration.result.result import CalibrationResult
    from schuler.calibration.result.session import Session


def finish(
    result: CalibrationResult,
    log: Path,
    recordings: Sequence[Recording],
    output: Output,
    began: float,
    *,
    field: FieldCalibration | None = None,
    truth: dict[str, float] | None = None,
    history: str = "csv",
    before: ImuSeries | None = None,
    site: Site | None = None,
) -> int:
    """Write files, print the result, return the exit code: 2 for a log that is refused.

    A field calibration also has its history (``field``, a file with the suffix ``history``), figures of the log
    (``before``, SI) before and after and, if simulated, the truth for its figures.
    """
    from schuler.calibration.result.result import CalibrationResult
    from schuler.calibration.result.session import with_session
    from schuler.diagnosis.admission import notes_of

    sources = {k: v for recording in recordings for k, v in recording.metadata.sources.items()}
    options = [recording.metadata.options for recording in recordings]
    checks = [note for recording in recordings for note in notes_of(recording)]
    about = {"sources": sources, "recording_options": options, "checks": checks}
    result = replace(result, provenance={**result.provenance, **about})
    result = with_session(result, _session(result, recordings, output, site))
    if output.gauge is not None and result.status != "refused":
        result = result.in_gauge(output.gauge)
    folder = Path(f"{log.resolve().stem}-calibration") if output.out is None else output.out
    earlier = None if output.previous is None else CalibrationResult.from_yaml(output.previous)
    difference = None if earlier is None or result.status == "refused" else result.compare(earlier)
    files: dict[str, Path] = {}
    # what was refused has no numbers to be used, but its report shows why
    if result.status != "refused":
        files["calibration"] = result.to_yaml(folder / "calibration.yaml")
        if field is not None:
            files["history"] = field.to_file(folder / f"history.{history}")
        if output.certificate is not None:
            from schuler.calibration.report.certificate import calibration_certificate

            files["certificate"] = calibration_certificate(result, output.certificate)
    if output.report:
        from schuler.calibration.report.figures import save_calibration_figures

        summary = "\n".join(recording.summary() for recording in recordings)
        files["report"] = result.report(
            folder / "calibration.html", previous=earlier, recording_summary=summary, field=field, truth=truth
        )
        draw = drawable(True)
        figures = save_calibration_figures(result, folder / "figures", field=field, truth=truth) if draw else []
        if draw and before is not None and field is not None and result.status != "refused":
            from schuler.calibration.report.output_figures import save_output_figures

            # in the axes of the log, whatever the gauge of the file
            after = field.calibration.apply(recordings[0].need_imu())
            figures += save_output_figures(before, after, folder / "figures")
        files |= named(figures)
    if output.json:
        data = numbers(result)
        if field is not None:
            data["field"] = course(field)
        if difference is not None:
            data["changed"] = list(difference.changed)
        print_json({"command": "calibrate", **data, "elapsed_s": clock.perf_counter() - began, "files": files})
    else:
        for recording in recordings:
            say(as_options(recording.summary()))
        print(result.summary())
        if field is not None:
            print(field.course())
        if difference is not None:
            print(difference.summary())
        print("\n".join(f"{what}: {path}" for what, path in files.items() if not what.startswith("figure")))
    if result.status == "refused":
        say(f"schuler: {log}: refused; {'; '.join(v.rstrip('.') for v in result.verdicts)}")
        return 2
    return 0


def _session(result: CalibrationResult, recordings: Sequence[Recording], output: Output, site: Site | None) -> Session:
    """Unit, operator, place and date as stated, what the logs say, and the gravity that was compared with."""
    from schuler.calibration.result.application import local_gravity
    from schuler.calibration.result.session import Session, log_circumstances

    stated = {n: v for n in ("serial", "operator", "place", "date") if (v := getattr(output, n).strip())}
    latitude = result.provenance.get("latitude") if site is None or site.lat is None else site.lat
    at_log = local_gravity(recordings[0]) if recordings and (site is None or site.lat is None) else None
    if site is not None and site.gravity is not None:
        gravity: tuple[float, str] = (site.g, "as stated")
    elif site is not None and site.lat is not None:
        gravity = site.g, f"normal gravity (WGS 84) at the latitude and {site.height:g} m above the ellipsoid"
    elif at_log is not None and result.method == "field":
        gravity = at_log
    else:
        gravity = u.G0, "standard gravity, no latitude being stated"
    return Session(**{**log_circumstances(recordings), **stated}, gravity=gravity[0], gravity_source=gravity[1],
                   latitude=None if latitude is None else float(latitude))  # fmt: skip


def numbers(result: CalibrationResult) -> dict[str, Any]:
    """A calibration for JSON."""
    from schuler.calibration.result.parameters import GAUGES, unit

    estimated = {
        name: {"value": float(v), "sigma": float(s), "unit": unit(name)}
        for name, v, s in zip(result.names, result.values, result.sigma, strict=True)
    }
    held = {name: {"value": v, "sigma": 0.0, "unit": unit(name), "fixed": True} for name, v in result.fixed.items()}
    return {
        "method": result.method, "status": result.status, "gauge": result.gauge, "gauge_means": GAUGES[result.gauge],
        "parameters": estimated | held,
        "undetermined": [name for name, s in zip(result.names, result.sigma, strict=True) if not np.isfinite(s)],
        "condition": result.condition, "variance_of_unit_weight": result.variance_of_unit_weight,
        "freedom": result.freedom, "residual_rms": {name: r.rms for name, r in result.residuals.items()},
        "observability": result.observability, "verdicts": list(result.verdicts), "next_pose": result.next_pose,
        "nominal": list(result.nominal), "temperature_deg_c": result.temperature, "extra": result.extra,
        "provenance": result.provenance,
    }  # fmt: skip


def course(field: FieldCalibration) -> dict[str, Any]:
    """How a field calibration came about, for JSON."""
    return {
        "passes": len(field.passes),
        "rests": [[a, b] for a, b in zip(field.rests.start.tolist(), field.rests.stop.tolist(), strict=True)],
        "rest_notes": list(field.rests.notes),
        "heading_deg": None if field.heading is None else [v / u.DEG for v in field.heading],
        "nis": {kind: {"mean": mean, "components": n} for kind, (mean, n) in field.nis.items()},
        "below_tenth_s": field.history.reached(),
    }
