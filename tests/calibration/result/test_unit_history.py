"""History of a unit: what changed is found, what did not change is not, whatever the number of parameters."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration import calibration_history, history_of, result_from
from schuler.calibration.result.session import Session, with_session
from schuler.calibration.result.unit_history import LEVEL, holm
from schuler.cli import main
from schuler.exceptions import InputError

SIGMA = {
    **{f"b_a_{i}": 1e-3 for i in "xyz"},
    **{f"M_a_{i}{i}": 1e-4 for i in "xyz"},
    **{f"b_g_{i}": 1e-5 for i in "xyz"},
}
DATES = ("2023-01-10", "2024-01-12", "2025-03-01")


def calibration(rng, date, shift=0.0, serial="7", gauge="full"):
    values = {n: (s * rng.normal() + (shift * s if n == "b_a_y" else 0.0), s) for n, s in SIGMA.items()}
    return with_session(result_from("sixposition", values, gauge), Session(serial=serial, date=date))


def unit(seed, shift=0.0):
    rng = np.random.default_rng(seed)
    return {d: calibration(rng, d, shift if k == 2 else 0.0) for k, d in enumerate(DATES)}


def test_units_that_did_not_change_show_a_change_once_in_twenty():
    """Statistical: 150 units of nine parameters, binomial, four sigma."""
    shown = sum(bool(history_of(unit(k)).changed) for k in range(150))
    assert abs(shown - 150 * LEVEL) < 4.0 * np.sqrt(150 * LEVEL * (1.0 - LEVEL))


def test_a_step_of_eight_sigma_is_found_and_dated():
    history = history_of(unit(1, shift=8.0))
    assert history.changed == ("b_a_y",)
    sentence = next(s for s in history.sentences() if "b_a_y" in s)
    assert "between 2024-01-12 and 2025-03-01" in sentence
    assert "9 parameters" in history.correction


def test_holm_is_bonferroni_of_the_smallest_and_never_falls():
    assert holm({"a": 0.01, "b": 0.02, "c": 0.5}) == pytest.approx({"a": 0.03, "b": 0.04, "c": 0.5})
    assert holm({"a": 0.01, "b": 0.01}) == pytest.approx({"a": 0.02, "b": 0.02})


def test_other_gauges_and_nominal_factors_are_the_same_sensor():
    """Of two calibrations that agree, one in other axes: no change (law)."""
    full = dict.fromkeys(("M_a_xx", "M_a_xy", "M_a_yx", "M_a_yy", "M_a_zz"), (0.0, 0.0001)) | {"b_a_x": (0.05, 1e-3)}
    full["M_a_xy"] = full["M_a_yx"] = (2e-3, 1e-4)
    first = with_session(result_from("sixposition", full, "full"), Session(date=DATES[0]))
    second = with_session(first.in_gauge("lower"), Session(date=DATES[1]))
    assert not history_of({"a": first, "b": second}).changed


def test_folder_with_several_units_asks_for_one(tmp_path):
    rng = np.random.default_rng(5)
    for k, (date, serial) in enumerate([(DATES[0], "7"), (DATES[1], "7"), (DATES[1], "8"), ("", "7")]):
        (tmp_path / str(k)).mkdir()
        calibration(rng, date, serial=serial).to_yaml(tmp_path / str(k) / "calibration.yaml")
    (tmp_path / "other.yaml").write_text("a: 1\n")
    (tmp_path / "broken.yaml").write_text("format: schuler-calibration\nversion: 1\n")
    with pytest.raises(InputError, match="got those of 7, 8; name it"):
        calibration_history(tmp_path)
    history = calibration_history(tmp_path, serial="7")
    assert history.files == ("0/calibration.yaml", "1/calibration.yaml")
    assert set(history.left_out) == {"3/calibration.yaml", "broken.yaml"}
    with pytest.raises(InputError, match="expected two dated calibrations or more, got 1"):
        calibration_history(tmp_path, serial="8")
    with pytest.raises(InputError, match="expected calibrations of the unit 9, got those of 7, 8"):
        calibration_history(tmp_path, serial="9")


def test_command_writes_page_and_json(tmp_path, capsys):
    import json

    (tmp_path / "unit").mkdir()
    for name, result in unit(1, shift=8.0).items():
        replace(result, temperature=21.0).to_yaml(tmp_path / "unit" / f"{name}.yaml")
    arguments = ["history", str(tmp_path / "unit"), "--out", str(tmp_path / "h.html")]
    assert main([*arguments, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["changed"], data["dates"]) == (["b_a_y"], list(DATES))
    assert data["parameters"]["b_a_y"]["p_corrected"] < LEVEL
    text = (tmp_path / "h.html").read_text()
    assert text.index("Where it changed most") < text.index("Parameters over dates")
    assert main([*arguments, "--force"]) == 0
    assert "b_a_y, bias of the y accelerometer, changed" in capsys.readouterr().out
