"""Errors against a reference: axes, signs, interpolation, and the numbers quoted of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import attitude_difference
from schuler.navigation.evaluation.errors import DerivedErrors, TrajectoryErrors, trajectory_errors
from schuler.navigation.smoother import CorrectedTrajectory
from schuler.recording.trajectory import Trajectory

PLACE = np.array([0.8, 2.0, 300.0])


def circle(t, *, radius=100.0, period=60.0):
    """Closed form: a level circle in the tangent plane at PLACE, nose along the track."""
    w = 2.0 * np.pi / period
    C = frames.C_en(PLACE)
    zero = np.zeros_like(t)
    r_n = np.stack((radius * np.cos(w * t), radius * np.sin(w * t), zero), axis=-1)
    v_n = np.stack((-radius * w * np.sin(w * t), radius * w * np.cos(w * t), zero), axis=-1)
    yaw = np.arctan2(v_n[:, 1], v_n[:, 0])
    C_nb = rotation.dcm_from_rpy(np.stack((zero, zero, yaw), axis=-1))
    return Trajectory(t, frames.ecef_from_llh(PLACE) + r_n @ C.T, v_n @ C.T, rotation.quat_from_dcm(C @ C_nb))


def displaced(reference, d_n, dv_n, psi_n):
    """A trajectory with given errors, north, east, down at the reference."""
    C = frames.C_en(reference.llh)
    turn = rotation.quat_from_rotvec(np.einsum("nij,j->ni", C, psi_n))
    return Trajectory(
        reference.t,
        reference.r_eb_e + np.einsum("nij,j->ni", C, d_n),
        reference.v_eb_e + np.einsum("nij,j->ni", C, dv_n),
        rotation.quat_multiply(turn, reference.q_eb),
    )


def test_errors_are_estimate_minus_reference_in_north_east_down():
    reference = circle(np.arange(0.0, 60.0, 0.5))
    d, dv, psi = np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.3]), np.array([1e-3, -2e-3, 0.4])
    e = trajectory_errors(displaced(reference, d, dv, psi), reference)
    np.testing.assert_allclose(e.position_n, np.tile(d, (120, 1)), atol=5e-9)  # rounding of 6.4e6 m
    np.testing.assert_allclose(e.velocity_n, np.tile(dv, (120, 1)), atol=1e-12)  # rounding
    np.testing.assert_allclose(e.attitude_n, np.tile(psi, (120, 1)), atol=1e-12)  # rounding
    assert e.horizontal == pytest.approx(np.full(120, np.sqrt(5.0)), abs=1e-8)


def test_the_estimate_is_interpolated_to_the_reference():
    """Times that do not coincide: a circle sampled at 4 Hz stands in for itself at other times."""
    estimate, reference = circle(np.arange(0.0, 60.0, 0.25)), circle(np.arange(0.1, 59.0, 0.37))
    e = trajectory_errors(estimate, reference)
    w = 2.0 * np.pi / 60.0
    assert len(e.t) == len(reference)
    assert np.abs(e.position_n).max() < 100.0 * (w * 0.25) ** 4 / 384.0 * 1.05  # discretisation: |a''| dt^4 / 384
    assert np.abs(e.velocity_n).max() < 100.0 * w**3 * 0.25**2 / 8.0 * 1.05  # discretisation: |v''| dt^2 / 8
    assert np.abs(e.attitude_n).max() < 1e-9  # the turn is uniform, the interpolation exact but for Earth's curvature


def test_errors_are_kept_for_the_reference_they_are_against(full, monkeypatch):
    """A report asks for what the numbers asked for before it; another reference or point is another answer."""
    result, truth = full.result, full.truth
    first = result.errors(truth)
    assert result.errors(truth) is first
    east = Trajectory(truth.t, truth.r_eb_e + frames.C_en(truth.llh[0]) @ [0.0, 5.0, 0.0])
    apart = result.errors(east).position_n - first.position_n
    np.testing.assert_allclose(apart[0], [0.0, -5.0, 0.0], atol=1e-5)  # axes turn by 5 m / R
    assert result.errors(truth, at_antenna=True).velocity_n is None
    np.testing.assert_array_equal(result.errors(truth).position_n, first.position_n)


def test_errors_of_a_long_solution_are_made_anew_and_are_the_same(full, monkeypatch):
    """In blocks, of a smoothed solution that is itself made anew: equal to the last bit, and nothing is held."""
    result, truth = full.result, full.truth
    smoothed = result.smooth()
    short = [r.errors(T) for r in (result, smoothed) for T in (truth, truth.between(truth.t[7], truth.t[-9]))]
    for module in ("recording.trajectory", "navigation.evaluation.errors", "navigation.smoother"):
        monkeypatch.setattr(f"schuler.{module}.KEPT", 50)
    monkeypatch.setattr("schuler.recording.trajectory._BLOCK", 30)
    once = replace(result)
    again = once.smooth(keep=False)
    assert isinstance(again.trajectory, CorrectedTrajectory)
    long = [r.errors(T) for r in (once, again) for T in (truth, truth.between(truth.t[7], truth.t[-9]))]
    for one, other in zip(short, long, strict=True):
        assert isinstance(other, DerivedErrors)
        for name in ("t", "position_n", "velocity_n", "attitude_n", "horizontal"):
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
        assert other.statistics() == one.statistics()
        np.testing.assert_array_equal(other.between(50.0, 60.0).position_n, one.between(50.0, 60.0).position_n)
        assert not {"position_n", "horizontal"} & set(vars(other))
    for name in ("r_eb_e", "v_eb_e", "q_eb", "rpy_nb"):
        np.testing.assert_array_equal(getattr(again.trajectory, name), getattr(smoothed.trajectory, name))


def test_only_the_overlap_counts():
    e = trajectory_errors(circle(np.arange(10.0, 20.0, 0.5)), circle(np.arange(0.0, 60.0, 1.0)))
    assert e.t[0] == 10.0
    assert e.t[-1] == 19.0
    with pytest.raises(InputError, match=r"do not overlap; are they on the same clock\?"):
        trajectory_errors(circle(np.arange(0.0, 5.0, 1.0)), circle(np.arange(6.0, 9.0, 1.0)))


def test_what_one_side_lacks_is_not_compared():
    reference = circle(np.arange(0.0, 10.0, 1.0))
    positions = Trajectory(reference.t, reference.r_eb_e)
    e = trajectory_errors(reference, positions)
    assert e.velocity_n is None
    assert e.attitude_n is None
    assert "rms_heading_deg" not in e.statistics()


def test_the_lever_arm_moves_the_point_compared():
    """The antenna of a vehicle circling level with its nose along the track, 2 m ahead: radius hypot(100, 2)."""
    imu = circle(np.arange(0.0, 60.0, 0.5))
    antenna = imu.moved_by([2.0, 0.0, -1.5])
    e = trajectory_errors(Trajectory(antenna.t, antenna.r_eb_e), Trajectory(imu.t, imu.r_eb_e))
    np.testing.assert_allclose(e.horizontal, 2.0, atol=1e-4)  # the tangent plane is bent by 100 m / R at the reference
    np.testing.assert_allclose(e.position_n[:, 2], -1.5, atol=1e-4)


def test_statistics_of_given_errors():
    position = np.array([[3.0, 4.0, 1.0], [0.0, 0.0, -2.0], [6.0, 8.0, 0.0], [0.0, 1.0, 0.0]])
    e = TrajectoryErrors(np.arange(4.0), position, position * 0.1, np.tile([0.003, 0.004, -0.02], (4, 1)))
    s = e.statistics()
    assert s["rms_horizontal_m"] == pytest.approx(np.sqrt((25 + 0 + 100 + 1) / 4))
    assert s["max_horizontal_m"] == pytest.approx(10.0)
    assert s["cep50_m"] == pytest.approx(3.0)  # between 1 and 5
    assert s["rms_vertical_m"] == pytest.approx(np.sqrt(5.0 / 4.0))
    assert s["max_vertical_m"] == pytest.approx(2.0)
    assert s["rms_velocity_horizontal_m_s"] == pytest.approx(0.1 * s["rms_horizontal_m"])
    assert s["rms_tilt_deg"] == pytest.approx(np.degrees(0.005))
    assert s["rms_heading_deg"] == pytest.approx(np.degrees(0.02))
    part = e.between(1.0, 2.0)
    assert part.max_horizontal == pytest.approx(10.0)
    assert len(part.t) == 2
    with pytest.raises(InputError, match=r"no reference epoch lies within 7\.000\.\.8\.000 s"):
        e.between(7.0, 8.0)


def test_attitude_difference_is_a_rotation_vector_in_outer_axes(rng):
    """``C_hat = exp([psi x]) C`` also for large turns, where differences of Euler angles mean nothing."""
    q = rotation.quat_from_rotvec(rng.standard_normal((50, 3)))
    psi = rng.uniform(-1.0, 1.0, (50, 3)) * 1.7
    q_hat = rotation.quat_multiply(rotation.quat_from_rotvec(psi), q)
    np.testing.assert_allclose(attitude_difference(q_hat, q), psi, atol=1e-12)  # rounding
