"""A calibration taken out of a log gives the truth back, and only to the logs it holds for."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration import CalibrationResult, apply_calibration, result_from
from schuler.calibration.result.application import APPLIED, _claimed
from schuler.calibration.result.session import Session, log_date, session_of, with_session
from schuler.exceptions import InputError
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.timebase import TimeBase
from schuler.units import G0

TRUE = {
    "b_a_x": 0.05, "b_a_y": -0.03, "b_a_z": 0.02, "M_a_xx": 0.004, "M_a_xy": 0.001, "M_a_zz": -0.003, "b_g_x": 4e-3,
    "b_g_y": -2e-3, "M_g_xx": 0.005, "M_g_yz": 0.002, "G_g_xx": 1e-5,
}  # fmt: skip
SIGMA = {"b_a": 1e-3, "M_a": 1e-4, "b_g": 1e-5, "M_g": 2e-4, "G_g": 1e-6}


def calibration(values=TRUE, **more) -> CalibrationResult:
    return result_from("ratetable", {n: (v, SIGMA[n[:3]]) for n, v in values.items()}, "full", **more)


def truth(kind: str = "rate") -> ImuSeries:
    """Six faces up, three seconds each, with a turn between them."""
    t = np.arange(0.0, 36.0, 0.02)
    face = (t // 6).astype(int)
    up = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    moving = t % 6 > 4.0
    accel = G0 * up[face] + np.where(moving[:, None], 0.5 * np.sin(7.0 * t)[:, None], 0.0)
    gyro = np.where(moving[:, None], 0.8 * np.cos(5.0 * t)[:, None] * [1.0, -0.5, 0.7], 0.0)
    h = 0.02 if kind == "increment" else 1.0
    return ImuSeries(t, gyro * h, accel * h, kind)


def log(imu: ImuSeries, **options) -> Recording:
    noise = np.random.default_rng(5).normal(0.0, 1e-3, (2, len(imu), 3))
    noisy = replace(imu, accel=imu.accel + noise[0], gyro=imu.gyro + 0.01 * noise[1])
    return Recording(imu=noisy, metadata=Metadata(name="log", options=options))


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("nominal", [(1.0, 1.0), (G0 / 4096.0, 1e-3)])
def test_the_true_errors_taken_out_give_the_truth_back(kind, nominal):
    true, exact = truth(kind), replace(calibration(), nominal=nominal)
    applied = apply_calibration(exact, Recording(imu=exact.inverse(true), metadata=Metadata(name="log")))
    after = applied.recording.need_imu()
    np.testing.assert_allclose(after.accel, true.accel, atol=1e-12)  # rounding
    np.testing.assert_allclose(after.gyro, true.gyro, atol=1e-12)
    assert after.kind == kind


def test_an_uncertain_calibration_gives_the_truth_back_within_its_sigma():
    """Drawn from the covariance: NEES of the norms at six rests and of their rates is one (statistical)."""
    rng, true, nees = np.random.default_rng(3), truth(), []
    raw = log(calibration().inverse(true))
    for _ in range(15):
        drawn = {n: v + SIGMA[n[:3]] * rng.normal() for n, v in TRUE.items()}
        rests = apply_calibration(calibration(drawn), raw).rests
        error = np.concatenate((rests.norm_errors[1] / rests.sigma_norm, (rests.omega_after / rests.sigma_omega)[:, 0]))
        nees.append(np.mean(error**2))
    assert abs(np.mean(nees) - 1.0) < 5.0 * np.std(nees) / np.sqrt(len(nees))
    assert rests.norm_errors[0].std() > 20.0 * rests.norm_errors[1].std()


S = 1e-3  # the one sigma of a calibration
DIAGONAL = [np.sqrt(0.5), np.sqrt(0.5), 0.0]


@pytest.mark.parametrize(
    ("name", "up", "norm", "omega"),
    [
        ("b_a_x", [1, 0, 0], S, [0, 0, 0]),
        ("b_a_x", [0, 1, 0], 0.0, [0, 0, 0]),
        ("b_a_x", DIAGONAL, S * np.sqrt(0.5), [0, 0, 0]),
        ("M_a_xx", [1, 0, 0], S * G0, [0, 0, 0]),
        ("M_a_xy", [0, 1, 0], 0.0, [0, 0, 0]),
        ("M_a_xy", DIAGONAL, S * G0 / 2.0, [0, 0, 0]),
        ("b_g_x", [0, 0, 1], 0.0, [S, 0, 0]),
        ("M_g_xy", [0, 0, 1], 0.0, [S * 2e-3, 0, 0]),
        ("G_g_xz", [0, 0, 1], 0.0, [S * G0, 0, 0]),
    ],
)
def test_the_claim_at_rest_is_that_of_the_one_uncertain_parameter(name, up, norm, omega):
    """Closed form, rounding: one error of 1-sigma S, gravity along ``up``, a rate of 2 mrad/s about y."""
    one = result_from("ratetable", {name: (0.0, S)}, "full")
    sigma_norm, sigma_omega = _claimed(one, G0 * np.array([up], dtype=float), np.array([[0.0, 2e-3, 0.0]]))
    np.testing.assert_allclose(sigma_norm, norm, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(sigma_omega[0], omega, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_the_corrected_file_says_what_was_applied_and_is_not_corrected_again(suffix, tmp_path):
    unit = with_session(calibration(), Session(serial="SN 7", date="2025-03-31"))
    applied = apply_calibration(unit, log(calibration().inverse(truth())), serial="SN 7")
    io.write(applied.recording, tmp_path / f"c.{suffix}")
    again = io.read(tmp_path / f"c.{suffix}")
    (entry,) = again.metadata.options[APPLIED]
    assert (entry["serial"], entry["date"], entry["parameters"]) == ("SN 7", "2025-03-31", unit.parameters)
    assert any("was applied" in note for note in again.metadata.notes)
    with pytest.raises(InputError, match="corrected already by this calibration"):
        apply_calibration(unit, again)
    with pytest.raises(InputError, match="corrected already by another calibration"):
        apply_calibration(calibration({"b_a_x": 0.1}), again)
    assert len(apply_calibration(unit, again, allow=("corrected",)).recording.metadata.options[APPLIED]) == 2
    # one made of logs corrected like this finds what was left
    second = replace(calibration({"b_a_x": 1e-3}), provenance={"recording_options": [again.metadata.options]})
    assert len(apply_calibration(second, again).recording.metadata.options[APPLIED]) == 2


def test_another_unit_is_refused():
    unit = with_session(calibration(), Session(serial="A"))
    raw = log(calibration().inverse(truth()))
    with pytest.raises(InputError, match=r"expected a log of the calibrated unit A, got one of B; .* allow serial"):
        apply_calibration(unit, raw, serial="B")
    assert "passed over (serial)" in " ".join(apply_calibration(unit, raw, serial="B", allow=("serial",)).notes)
    assert "no serial number" in " ".join(apply_calibration(unit, raw).notes)
    assert not any("serial" in n for n in apply_calibration(unit, raw, serial="A").notes)
    with pytest.raises(InputError, match="allow: expected any of serial"):
        apply_calibration(unit, raw, allow=("unit",))


def test_other_temperatures_are_refused():
    unit = with_session(calibration(), Session(temperature_range=(20.0, 25.0)))
    imu = calibration().inverse(truth())

    def at(degrees):
        return Recording(imu=replace(imu, temperature=np.full(len(imu), degrees)), metadata=Metadata(name="log"))

    assert not any("temperature" in n for n in apply_calibration(unit, at(34.0)).notes)
    for degrees in (9.0, 36.0):
        with pytest.raises(InputError, match=r"20\.0 to 25\.0 degC\), got a median of .* allow temperature"):
            apply_calibration(unit, at(degrees))
        assert apply_calibration(unit, at(degrees), allow=("temperature",))
    assert "temperature" in " ".join(apply_calibration(unit, log(imu)).notes)


@pytest.mark.parametrize("factor", [1.0 / G0, 100.0])
def test_other_units_are_refused(factor):
    imu = calibration().inverse(truth())
    with pytest.raises(InputError, match=r"units of the calibrated one \(SI\), got a specific force with a median"):
        apply_calibration(calibration(), Recording(imu=replace(imu, accel=imu.accel * factor)))


def test_session_is_kept_in_the_file(tmp_path):
    session = Session("SN 7", "A. M.", "lab", "2025-03-31", (20.0, 21.5), 9.807, "as stated", 0.8)
    path = with_session(calibration(), session).to_yaml(tmp_path / "c.yaml")
    assert session_of(CalibrationResult.from_yaml(path)) == session
    assert session_of(calibration()) == Session()
    with pytest.raises(InputError, match="date: expected YYYY-MM-DD"):
        Session(date="31.3.2025")
    with pytest.raises(InputError, match=r"provenance\.session: expected"):
        session_of(replace(calibration(), provenance={"session": {"serail": "7"}}))


def test_day_of_a_log_is_that_of_its_clock():
    imu = truth()
    dated = Recording(imu=imu, metadata=Metadata(time=TimeBase("gps", 1_234_567_890.0)))
    assert log_date(dated) == "2019-02-18"
    assert log_date(Recording(imu=imu)) == ""


def test_page_before_and_after_has_the_rests_first(tmp_path):
    applied = apply_calibration(calibration(), log(calibration().inverse(truth())))
    text = applied.report(tmp_path / "page.html").read_text()
    assert text.index("Specific force at rest against gravity") < text.index("At rest, axis by axis")
    assert "At 6 rests the norm" in text
    assert "x up" in text
