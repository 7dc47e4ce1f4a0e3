"""Measurements of the filter from blocks of readings: primary and secondary field calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    EARTH_RATE,
    EARTH_RATE_MAGNITUDE,
    FIX,
    GRAVITY,
    GRAVITY_VECTOR,
    ZERO_RATE,
    ZERO_VELOCITY,
    MeasurementSchedule,
    merged,
)

EarthRate: TypeAlias = Literal["vector", "vertical", "magnitude", "off"]
Secondary: TypeAlias = Literal["full", "reduced", "off"]

#: 1-sigma with which position and velocity are held; see :data:`FREE_ACCEL`. [m], [m/s]
PLACE_SIGMA, VELOCITY_SIGMA = 1.0, 0.1
#: Noise of the accelerometers in the filter's velocity, so large that velocities carry no information on the sensors:
#: gravity measurements use the same readings with their own noise, and nothing is used twice. [m/s^2/sqrt(Hz)]
FREE_ACCEL = 100.0


@dataclass(frozen=True)
class BlockNoise:
    """1-sigma of the mean over one second at rest, axis by axis: specific force [m/s^2], rate [rad/s]. Shapes (3,)."""

    f: FloatArray
    omega: FloatArray


def rest_schedule(
    blocks: Blocks,
    noise: BlockNoise,
    llh: FloatArray,
    *,
    gravity: float = 0.0,
    primary: bool = True,
    earth_rate: EarthRate = "vector",
    secondary: Secondary = "full",
    secondary_from: float = -np.inf,
) -> MeasurementSchedule:
    """Measurements of an IMU that rests in between turns.

    Parameters
    ----------
    blocks : Blocks
    noise : BlockNoise
        Noise of a mean over one second.
    llh : ndarray, shape (3,)
        Place of the calibration. [rad, rad, m]
    gravity : float
        0 takes that of the ellipsoid. [m/s^2]
    primary : bool
        Magnitude of gravity (P1). Where a full secondary measurement uses the same block it is left out: the vector has
        the magnitude in it, and used twice it would make the filter over-confident.
    earth_rate : {"vector", "vertical", "magnitude", "off"}
        The unit does not turn at rest: all three rates are the Earth's, for a log whose rests are cut out (see
        :mod:`schuler.calibration.field.held_rests`). Earth rate along the measured vertical only, the attitude carried
        on by the gyroscopes: where a hand sways. Its magnitude as printed (P2), whose Earth rate and noise bias the
        g-sensitivity. Or none.
    secondary : {"full", "reduced", "off"}
        Gravity vector against the attitude the gyroscopes have carried on; reduced (Yaman's choice after the primary
        calibration) takes the accelerometers for perfect.
    secondary_from : float
        Time from which the secondary measurement is used. [s]

    References
    ----------
    Yaman (2017), eqs. (4-44) to (4-64), corrected: see docs/field-calibration.md.
    """
    n = len(blocks)
    f, omega = blocks.f, blocks.omega
    z = np.zeros((n, 8))
    z[:, :3], z[:, 3:6], z[:, 6] = f, omega, gravity
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    var_f = np.sum((up * noise.f) ** 2, axis=1) / blocks.length
    var_w = np.sum((up * noise.omega) ** 2, axis=1) / blocks.length
    late = blocks.t >= secondary_from
    at_rest = blocks.rest >= 0
    parts = []
    if secondary != "off" and late.any():
        vector = z.copy()
        vector[:, 7] = 1.0 if secondary == "reduced" else 0.0
        # noise is given in body axes and the attitude is not estimated yet: the mean over the axes
        R = np.mean(noise.f**2) / blocks.length
        parts.append(_measurements(GRAVITY_VECTOR, blocks, vector, R, late))
    if primary:
        alone = at_rest & ~(late & (secondary == "full"))
        parts.append(_measurements(GRAVITY, blocks, z, var_f, alone))
    if earth_rate == "vector":
        R = np.zeros((n, 3, 3))
        R[:, range(3), range(3)] = noise.omega**2 / blocks.length[:, None]
        parts.append(MeasurementSchedule.of(ZERO_RATE, blocks.t[at_rest], omega[at_rest], R[at_rest]))
    elif earth_rate == "vertical":
        parts.append(_measurements(EARTH_RATE, blocks, z, var_w, at_rest))
    elif earth_rate == "magnitude":
        parts.append(_measurements(EARTH_RATE_MAGNITUDE, blocks, z, np.mean(noise.omega**2) / blocks.length, at_rest))
    elif earth_rate != "off":
        raise InputError(f"earth_rate: expected 'vector', 'vertical', 'magnitude' or 'off', got {earth_rate!r}")
    here = np.tile(frames.ecef_from_llh(llh), (n, 1))
    parts.append(MeasurementSchedule.of(FIX, blocks.t[at_rest], here[at_rest], PLACE_SIGMA**2))
    parts.append(
        MeasurementSchedule.of(ZERO_VELOCITY, blocks.t[at_rest], np.zeros((int(at_rest.sum()), 3)), VELOCITY_SIGMA**2)
    )
    return merged(*parts)


def _measurements(
    kind: int, blocks: Blocks, z: FloatArray, variance: FloatArray, keep: np.ndarray
) -> MeasurementSchedule:
    return MeasurementSchedule.of(kind, blocks.t[keep], z[keep], np.broadcast_to(variance, len(blocks))[keep])
