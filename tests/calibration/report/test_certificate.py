"""A certificate: digits of the GUM, what is traced to what, and one or two pages of A4."""

import re

import pytest

from schuler.calibration import calibration_certificate, result_from
from schuler.calibration.report.certificate import expanded
from schuler.calibration.result.session import Session, with_session
from schuler.exceptions import InputError


@pytest.mark.parametrize(
    ("value", "sigma", "printed"),
    [
        (12.3456, 0.42, ("+12.35", "0.84")),
        (12345.6, 617.0, ("+12300", "1200")),
        (826.4, 7.05, ("+826", "14")),
        (-0.01234, 0.0498, ("-0.01", "0.10")),  # 0.0996 is 0.10, not 0.100
        (1.0, 0.499, ("+1.0", "1.0")),
        (3.0, float("inf"), ("-", "not determined")),
        (3.0, 0.0, ("+3", "held")),
    ],
)
def test_two_digits_of_the_uncertainty_and_the_value_to_the_same_place(value, sigma, printed):
    """JCGM 100, 7.2.6."""
    assert expanded(value, sigma) == printed


def result(**session):
    made = result_from(
        "sixposition", {"b_a_x": (0.0980665, 0.000980665), "M_a_xx": (1e-3, 2e-5), "b_g_x": (1e-3, 1e-5)}, "full"
    )
    return with_session(made, Session(**session))


def test_certificate_states_unit_results_and_traceability(tmp_path):
    path = calibration_certificate(
        result(
            serial="SN <7>", operator="A. M.", place="lab", date="2025-03-31", gravity=9.807,
            gravity_source="as stated",
        ),
        tmp_path / "c.html",
    )  # fmt: skip
    text = path.read_text()
    assert "SN &lt;7&gt;" in text
    assert not re.search(r"SN <7>", text)
    assert re.search(r"b_a_x</th><td class=\"n\">\+10\.00</td><td class=\"n\">0\.20</td>", text)  # mg
    assert re.search(r"M_a_xx</th><td class=\"n\">\+1000</td><td class=\"n\">40</td>", text)  # ppm
    assert "9.80700 m/s²" in text
    assert "http:" not in text
    assert "https:" not in text


def test_gravity_that_nobody_stated_is_said_to_spoil_scale_factors(tmp_path):
    path = calibration_certificate(
        result(serial="7", gravity=9.80665, gravity_source="standard gravity"), tmp_path / "c.html"
    )
    assert "2700 ppm" in path.read_text()


def test_certificate_is_of_one_unit(tmp_path):
    with pytest.raises(InputError, match="expected the serial number"):
        calibration_certificate(result(), tmp_path / "c.html")
