"""Table 4.5 digit by digit, and trials that achieve what is predicted."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.du.study.accuracy import achieved, calibration_trials, table_4_5
from schuler.reproduce.du.study.imus import emulation


def test_table_4_5_is_the_printed_one():
    """All twenty numbers and both biases as printed (14.3 at 60 deg/s); rounded to the printed digit."""
    table = table_4_5()
    assert len(table) == 20
    assert table.column("formula_ppm") == table.column("thesis_ppm")
    assert table.column("bias_deg_hr") == table.column("thesis_bias_deg_hr")
    assert table.row(imu="NAV440", rate_deg_s=60.0)["formula_ppm"] == 14.3
    ratio = np.array(table.column("corrected_ppm")) / np.array(table.column("formula_ppm"))
    assert ratio == pytest.approx(np.sqrt(2.0), abs=0.01)


@pytest.mark.parametrize(("name", "rate"), [("NAV440", 20.0), ("MTi-G", -10.0)])
def test_trials_achieve_the_prediction(name, rate):
    """sigma_d, sigma_K and the rest at the rate within 4 / sqrt(2 * 3 * 300), means within 4 of their own sigmas."""
    result = calibration_trials(emulation(name, rate_hz=5.0), rate_deg_s=rate, runs=300, workers=1)
    for row in result.table().rows:
        assert row[5] == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * 3.0 * 300.0))
        assert row[6] < 4.0
    assert "achieved" in result.summary()
    assert len(achieved([result, result])) == 6


def test_wrong_questions():
    with pytest.raises(InputError, match="other than zero"):
        calibration_trials("NAV440", rate_deg_s=0.0)
    with pytest.raises(InputError, match="at least one"):
        achieved([])
