"""Du's chapter 3: every anchor of an independent check, and what the thesis says in words of each rotation."""

from typing import get_args

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler import earth
from schuler.exceptions import InputError
from schuler.reproduce.du.study.fixed_errors import Case, agrees, case_errors, chapter3
from schuler.units import DEG, DEG_PER_HR


@pytest.mark.parametrize("case", get_args(Case))
def test_every_anchor_is_met(case):
    """2 % or a unit of the last printed digit (100 numbers in all); the vertical channel differs for a known reason."""
    table = chapter3(case).table()
    off = [row for row in table.rows if row[-1] != "-"]
    assert all(row[1] in ("up_m", "velocity_u_m_s") and "fall with height" in row[-1] for row in off)
    assert len(off) < len(table) / 3


def test_the_vertical_difference_is_gravity_falling_with_height():
    """2 g / R times the height, integrated twice over a t^2 / 2: b t^4 / 12 g / R; 10 % of it (second order)."""
    simulation = chapter3("bias", axes=["Z"]).values("Z")
    g = float(earth.gravity_ned(0.25 * np.pi)[2])
    expected = 0.2 * 300.0**4 / 12.0 * g / 6.37e6
    assert simulation["up_m"] - 9013.0 == pytest.approx(expected, rel=0.10)


def test_a_constant_bias_is_modulated_across_the_axis_only():
    """Words of the thesis: about Z roll, pitch, V_E, V_N shrink, azimuth and V_U stay; about X and Y likewise."""
    simulation = chapter3("bias", rate_hz=50.0)
    conventional = np.abs([simulation.values(None)[f"attitude_{c}_deg"] for c in "enu"])
    for axis, kept in (("X", 0), ("Y", 1), ("Z", 2)):
        turned = np.abs([simulation.values(axis)[f"attitude_{c}_deg"] for c in "enu"])
        for k in range(3):
            if k == kept:
                assert_allclose(turned[k], conventional[k], rtol=0.1)
            else:
                assert turned[k] < 0.12 * conventional[k]
    assert abs(simulation.values("Z")["velocity_u_m_s"]) > 50.0


def test_closed_forms_of_a_rotation_about_z():
    """Secular velocity g d / omega t of a bias, 2.45 m/s, g K t of installation, 5.13; 6 % (Schuler, Coriolis)."""
    g, t = 9.806, 300.0
    bias = chapter3("gyro bias", axes=["Z"]).values("Z")
    expected = g * 30.0 * DEG_PER_HR / (10.0 * DEG) * t
    assert_allclose([bias["velocity_e_m_s"], bias["velocity_n_m_s"]], expected, rtol=0.06)
    installation = chapter3("installation", axes=["Z"])
    expected = g * 0.1 * DEG * t
    ours = installation.values("Z")
    assert_allclose([ours["velocity_e_m_s"], ours["velocity_n_m_s"]], expected, rtol=0.10)
    # largest tilt K (1 + sqrt(2)); the Earth's rate adds 0.3 %
    assert ours["attitude_e_deg"] == pytest.approx(0.1 * (1.0 + np.sqrt(2.0)), rel=0.005)


def test_a_scale_factor_ramps_about_the_axis():
    """K omega t about the axis of rotation: 9 deg in 300 s; the other angles stay below a quarter of a degree."""
    simulation = chapter3("scale factor", rate_hz=50.0)
    for axis, k in (("X", "e"), ("Y", "n"), ("Z", "u")):
        values = simulation.values(axis)
        assert values[f"attitude_{k}_deg"] == pytest.approx(9.0, rel=0.03)
        assert all(abs(values[f"attitude_{o}_deg"]) < 0.25 for o in "enu" if o != k)


def test_noise_is_added_and_shared_by_the_schemes():
    """With noise the runs scatter about those without: attitude by 0.2 deg/sqrt(h) sqrt(300 s) = 0.058 deg, 4 sigma."""
    clean = chapter3("bias", axes=[None, "Z"], rate_hz=20.0)
    noisy = chapter3("bias", axes=[None, "Z"], rate_hz=20.0, noise=True, seed=5)
    for axis in (None, "Z"):
        off = [noisy.values(axis)[f"attitude_{c}_deg"] - clean.values(axis)[f"attitude_{c}_deg"] for c in "enu"]
        assert 1e-4 < np.abs(off).max() < 4.0 * 0.2 * np.sqrt(300.0 / 3600.0)
    again = chapter3("bias", axes=["Z"], rate_hz=20.0, noise=True, seed=5)
    assert again.values("Z") == noisy.values("Z")


def test_errors_are_those_of_the_tables():
    """Tables 3.1 to 3.3 in SI, our axes: equal on Du's axes means a sign on ours."""
    bias = case_errors("bias")
    assert_allclose(bias.b_g, 30.0 * DEG_PER_HR * np.array([1.0, 1.0, -1.0]))
    assert_allclose(bias.b_a, [0.2, 0.2, -0.2])
    assert_allclose(case_errors("scale factor").M_g, 3e-3 * np.eye(3))
    installation = case_errors("installation").M_g
    assert_allclose(np.abs(installation), 0.1 * DEG * (1.0 - np.eye(3)))
    with pytest.raises(InputError, match="case"):
        case_errors("vibration")


def test_agreement_can_fail():
    assert agrees("bias", "velocity_e_m_s", 121.9, 121.8)
    assert not agrees("bias", "velocity_e_m_s", 125.0, 121.8)
    assert not agrees("installation", "attitude_e_deg", 0.25, 0.241)


def test_table_and_figure():
    simulation = chapter3("bias", axes=[None, "Z"], rate_hz=10.0, duration_s=300.0)
    assert "Chapter 3, bias" in simulation.summary()
    assert len(simulation.plot().axes) == 6
    with pytest.raises(InputError, match="no run"):
        simulation.values("X")
