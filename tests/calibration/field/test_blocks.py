"""Blocks of raw readings: their means hold at the times they state, of rates and of increments."""

import numpy as np
import pytest

from schuler.calibration.field.blocks import Blocks, rest_blocks, turning_blocks
from schuler.recording.series import ImuSeries
from schuler.standstill.rests import given_rests
from schuler.units import DEG, G0

H, RATE = 0.01, 20.0 * DEG


def turn(kind: str, rate: float = RATE) -> ImuSeries:
    """A turn about the level forward axis at a constant rate, stamps from 0 to 20 s: gravity turns in the y-z plane.

    Increments are the exact integrals over the interval before the stamp, rates the values at it.
    """
    t = H * np.arange(2001)
    if kind == "rate":
        y, z = -G0 * np.sin(rate * t), -G0 * np.cos(rate * t)
        scale = 1.0
    else:
        y = G0 / rate * (np.cos(rate * t) - np.cos(rate * (t - H)))
        z = -G0 / rate * (np.sin(rate * t) - np.sin(rate * (t - H)))
        scale = H
    zero = np.zeros_like(t)
    return ImuSeries(t, np.stack((zero + rate * scale, zero, zero), 1), np.stack((zero, y, z), 1), kind)


def angle(blocks: Blocks) -> np.ndarray:
    """Angle turned at which the mean specific force of each block holds; that of a chord is its middle's, exactly."""
    return np.unwrap(np.arctan2(-blocks.f[:, 1], -blocks.f[:, 2]))


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_samples_of_a_turn_hold_at_the_times_they_state(kind):
    """Gravity stands where a turn of a constant rate has it at the block's time; rounding.

    An increment is the mean over the interval before its stamp and holds half a sample earlier: taken at the stamp it
    is off by ``omega h / 2``, 0.1 deg here, a false tilt of 1.7 mg.
    """
    imu = turn(kind)
    rests = given_rests(imu, [(0.0, 2.0), (18.0, 20.0)])
    blocks = turning_blocks(imu, rests, rate_hz=10.0, gravity=G0, tolerance=0.1)
    assert len(blocks) > 100
    np.testing.assert_allclose(angle(blocks), RATE * blocks.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(blocks.omega[:, 0], RATE, rtol=1e-12)
    early = 0.5 * H if kind == "increment" else 0.0  # the stamps are whole samples
    np.testing.assert_allclose((blocks.t + early) / H, np.round((blocks.t + early) / H), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("block_s", [0.5, 0.03])
def test_means_over_a_slow_turn_hold_in_the_middle_they_state(kind, block_s):
    """The same of means over blocks: by symmetry they point as gravity does in their middle; rounding."""
    imu = turn(kind, rate=0.5 * DEG)
    blocks = rest_blocks(imu, given_rests(imu, [(1.0, 4.0), (10.0, 12.0)]), block_s)
    assert len(blocks) >= 10
    np.testing.assert_allclose(angle(blocks), 0.5 * DEG * blocks.t, rtol=0.0, atol=1e-9)
