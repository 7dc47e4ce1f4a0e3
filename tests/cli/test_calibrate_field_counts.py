"""``schuler calibrate field`` of raw counts: factors and middle found, results in terms of counts, what is refused."""

import csv
from pathlib import Path

import numpy as np
import pytest
from command import run

from schuler import earth
from schuler.calibration.field.calibration import calibrate_field
from schuler.calibration.result.comparison import with_nominal
from schuler.calibration.result.parameters import vector
from schuler.calibration.result.result import CalibrationResult
from schuler.cli import main
from schuler.filtering.states import layout_for
from schuler.navigation.start.calibration import calibration_start
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.sensors.spec_file import write_spec
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.units import DEG, G0

LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
SPEC = catalogue.spec("yaman-automotive")
PLACE = ("--latitude", 39.92, "--height", 1000.0)
#: An MPU-6000's: 16384 counts a g, 131 a degree per second.
LSB = (G0 / 16384.0, DEG / 131.0)
COUNTED = ("--units", "counts,counts", "--imu", "yaman-automotive", *PLACE, "--heading", "0,1", "--no-report", "--json")


@pytest.fixture(scope="module")
def turned():
    """A log of the short routine at 50 Hz in SI, and the errors in it."""
    rng = np.random.default_rng(3)
    errors = ImuErrors.draw(SPEC, rng, gauge="upper")
    motion = RoutineMotion(thesis_routine(dwell_s=5.0, repeats=1), LLH)
    return simulate_imu(ideal_imu(motion, 50.0, kind="rate"), errors, rng).imu, errors


@pytest.fixture(scope="module")
def in_counts(turned, tmp_path_factory):
    """The log as text in counts without sign, as 16 bits give them; its errors."""
    imu, errors = turned
    y = np.column_stack((np.round(imu.accel / LSB[0] + 32768.0), np.round(imu.gyro / LSB[1] + 32768.0)))
    lines = [f"{t:.3f},{','.join(f'{v:.0f}' for v in row)}" for t, row in zip(imu.t, y, strict=True)]
    path = tmp_path_factory.mktemp("counts") / "counts.csv"
    path.write_text("\n".join(["t,ax,ay,az,gx,gy,gz", *lines]), encoding="utf-8")
    return path, errors


@pytest.fixture(scope="module")
def calibrated(in_counts, tmp_path_factory):
    """Its calibration by command: the JSON."""
    folder = tmp_path_factory.mktemp("calibrated")
    with pytest.MonkeyPatch.context() as patch:
        printed = []
        patch.setattr("schuler.cli.calibrate_output.print_json", printed.append)
        code = main([str(a) for a in ("calibrate", "field", in_counts[0], *COUNTED, "--out", folder)])
    assert code == 0
    return printed[0]


@pytest.fixture(scope="module")
def in_si(turned, tmp_path_factory):
    """The log in SI, and a calibration of it."""
    folder = tmp_path_factory.mktemp("si")
    io.write(Recording(imu=turned[0], metadata=Metadata(name="turned")), folder / "turned.parquet")
    result = calibrate_field(turned[0], SPEC, latitude=LLH[0], height=LLH[2], heading=(0.0, DEG)).calibration
    return folder / "turned.parquet", result.to_yaml(folder / "calibration.yaml")


def true_of_counts(errors, nominal, middle):
    """Errors of the log in counts times the nominal factors: s y = s / lsb (b + (I + M) f) + s m, exactly."""
    a, g = (s / lsb for s, lsb in zip(nominal, LSB, strict=True))
    eye = np.eye(3)
    return ImuErrors(
        b_a=a * errors.b_a + nominal[0] * middle, M_a=a * (eye + errors.M_a) - eye,
        b_g=g * errors.b_g + nominal[1] * middle, M_g=g * (eye + errors.M_g) - eye, G_g=g * errors.G_g,
    )  # fmt: skip


def test_raw_counts_by_command(calibrated, in_counts):
    """Factors and the middle of the range are found; the result compensates counts. Statistical: 30, 4 sigma."""
    log, errors = in_counts
    assert calibrated["status"] == "ok", calibrated["verdicts"]
    for outcome, lsb, M in zip(calibrated["nominal"], LSB, (errors.M_a, errors.M_g), strict=True):
        assert outcome == pytest.approx(lsb / np.cbrt(np.linalg.det(np.eye(3) + M)), rel=1e-3)
    result = CalibrationResult.from_yaml(calibrated["files"]["calibration"])
    assert result.extra["middle_counts"] == [[32768.0] * 3] * 2
    off = (result.values - vector(true_of_counts(errors, result.nominal, 32768.0), result.names)) / result.sigma
    assert len(off) == 30
    assert np.abs(off).max() < 4.0
    # scale factors of a sheet are of no use for a factor that is not the sheet's
    assert result.prior_sigma["M_a_xx"] == pytest.approx(np.hypot(0.01, 0.01))
    assert result.prior_sigma["b_a_x"] == pytest.approx(SPEC.accel.turn_on_bias)
    # the history ends at the result here too
    rows = list(csv.DictReader(Path(calibrated["files"]["history"]).read_text(encoding="utf-8").splitlines()))
    assert float(rows[-1]["b_a_x [m/s^2]"]) == pytest.approx(result["b_a_x"][0], rel=1e-12)
    # gravity at the first rest: statistical, noise of four seconds and what the calibration leaves are 1 mm/s^2
    first = result.apply(io.read(log, units="counts,counts").need_imu()).between(0.5, 4.5).accel.mean(axis=0)
    g = float(np.linalg.norm(earth.gravity_ned(LLH[0], LLH[2])))
    assert np.linalg.norm(first) == pytest.approx(g, abs=SPEC.accel.random_walk * 4.0 / np.sqrt(4.0) + 2e-3)


def test_figures_of_counts_are_of_the_log_in_si(in_counts, tmp_path, capsys):
    """Before: the log times its factors, less the middle, not 80 m/s^2 beside what it is after."""
    drawn = {}

    def keep(before, after, folder):
        drawn.update(before=before, after=after)
        return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("schuler.calibration.report.output_figures.save_output_figures", keep)
        # the others take their time and are of the result alone
        patch.setattr("schuler.calibration.report.figures.save_calibration_figures", lambda *_, **__: [])
        patch.setattr(CalibrationResult, "report", lambda _, path, **__: path)
        arguments = [a for a in COUNTED if a != "--no-report"]
        code, _, err = run(capsys, "calibrate", "field", in_counts[0], *arguments, "--out", tmp_path)
    assert code == 0, err
    assert len(drawn["before"]) == len(drawn["after"]) == 7501
    assert np.abs(drawn["before"].accel - drawn["after"].accel).max() < 3.0
    assert np.abs(drawn["before"].gyro - drawn["after"].gyro).max() < 3.0 * DEG


def test_the_filter_that_navigates_takes_it(calibrated, in_counts):
    """States from the calibration and the log times the factors give what ``apply`` gives. Rounding."""
    result = CalibrationResult.from_yaml(calibrated["files"]["calibration"])
    layout = layout_for(SPEC, 39)
    start = calibration_start(result, layout, SPEC)
    counts = io.read(in_counts[0], units="counts,counts").need_imu()
    there = start.compensated(start.corrected(start.in_si(counts)), layout)
    np.testing.assert_allclose(there.accel, result.apply(counts).accel, atol=1e-9)
    np.testing.assert_allclose(there.gyro, result.apply(counts).gyro, atol=1e-9)


def test_an_earlier_calibration_brings_its_factors(calibrated, in_counts, tmp_path, capsys):
    first = CalibrationResult.from_yaml(calibrated["files"]["calibration"])
    code, _, err = run(
        capsys, "calibrate", "field", in_counts[0], *COUNTED, "--out", tmp_path, "--prior",
        calibrated["files"]["calibration"],
    )  # fmt: skip
    assert code == 0, err
    second = CalibrationResult.from_yaml(tmp_path / "calibration.yaml")
    assert second.nominal == first.nominal
    assert second.extra["middle_counts"] == first.extra["middle_counts"]
    assert np.abs((second.values - first.values) / first.sigma).max() < 1.0  # the same log again
    assert second["b_a_x"][1] < 0.85 * first["b_a_x"][1]


def test_what_does_not_go_together(calibrated, in_counts, in_si, capsys):
    counts = (in_counts[0], *COUNTED)
    si = (in_si[0], "--imu", "yaman-automotive", *PLACE)
    for arguments, message in (
        ((*counts, "--prior", in_si[1]), "--prior: expected a calibration of a log in counts"),
        ((*si, "--prior", calibrated["files"]["calibration"]), "expected a specific force of about 9.8"),
        ((*si, "--prior", calibrated["files"]["calibration"], "--coach"), "of a log in SI with --coach"),
        ((*counts, "--coach"), "--coach: expected a log in known units, got raw counts"),
        ((*counts, "--to", "17"), "state what a count is"),
    ):
        code, out, err = run(capsys, "calibrate", "field", *arguments)
        assert (code, out) == (2, ""), err
        assert err.startswith("schuler: ")
        assert err.count("\n") == 1
        assert message in err


@pytest.mark.campaign
@pytest.mark.realdata
def test_a_real_log_in_counts_agrees_with_the_bench_method(shared_data, tmp_path, capsys):
    """imu_tk's Xsens MTi, by two commands that are told nothing on its counts: within 3 combined sigma, all 30."""
    folder = shared_data / "imu_tk_xsens"
    config = tmp_path / "read.toml"
    config.write_text(
        "".join(
            f'[recording.{name}]\nfile = "xsens_{file}.mat"\ncolumns = "t,{axes}"\nunits = "{name}=counts"\n'
            for name, file, axes in (("accel", "acc", "ax,ay,az"), ("gyro", "gyro", "gx,gy,gz"))
        ),
        encoding="utf-8",
    )
    spec = ImuSpec(  # what one would say of a MEMS unit before; noise from the log's first 50 s
        name="MTi",
        gyro=TriadSpec(random_walk=5.6e-4, turn_on_bias=0.1, scale_factor=0.02, misalignment=0.05, g_sensitivity=2e-4),
        accel=TriadSpec(random_walk=7.7e-4, turn_on_bias=1.0, scale_factor=0.02, misalignment=0.03),
        rate_hz=100.0,
    )
    write_spec(tmp_path / "mti.toml", spec)
    for method, more in (
        ("field", ("--imu", tmp_path / "mti.toml", "--latitude", "45.4")),
        ("freepose", ("--initial-rest", "50", "--g-sensitivity")),
    ):
        code, _, err = run(
            capsys, "calibrate", method, folder, "--config", config, "--gravity", "9.81744", "--out", tmp_path / method,
            "--no-report", "--json", *more,
        )  # fmt: skip
        assert code == 0, err
    results = [CalibrationResult.from_yaml(tmp_path / method / "calibration.yaml") for method in ("field", "freepose")]
    for result in results:  # four digits, of fits that differ
        assert result.nominal == pytest.approx((0.002417, 0.0002095), rel=1e-3)
    a, b = results[0], with_nominal(results[1], results[0].nominal)
    names = [name for name in a.names if name in b.names]
    assert len(names) == 30
    off = {name: (a[name][0] - b[name][0]) / np.hypot(a[name][1], b[name][1]) for name in names}
    assert max(map(abs, off.values())) < 3.0, off
