"""Chapter 2: modulation, errors of the INS and of the platform."""

from __future__ import annotations

from functools import partial

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.cells import against, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR, MIN

_RATE = 10.0 * DEG
_ROUNDING = 1e-9
_DROPPED = 6.7e-3  # the source takes N as constant over the latitude: the square of the eccentricity


def _modulation(effort: Effort) -> Outcome:
    from schuler.reproduce.du.study.figures import modulated_biases
    from schuler.rotary import schemes
    from schuler.rotary.du_axes import du_axis, swap_vector
    from schuler.rotary.modulated_errors import effective_rate, modulation, turning_vehicle
    from schuler.rotary.rotating_imu import RotatingMotion

    llh = np.array([45.0 * DEG, 0.0, 0.0])
    bias = np.array([30.0, 20.0, 10.0]) * DEG_PER_HR
    t = np.linspace(0.0, 72.0, 289)
    platform = schemes.continuous(du_axis("Z"), _RATE)
    # the platform turns counter-clockwise, a vehicle turning to the right works against it
    motions = {
        f"vehicle turns at {0.0 - share * 10.0:g} deg/s": RotatingMotion(
            turning_vehicle(llh, share * _RATE, 72.0), platform
        )
        for share in (0.0, 0.5, 1.0, -1.0)
    }
    modulations = {name: modulation(motion, swap_vector(bias), t) for name, motion in motions.items()}
    rest, _, back, _ = modulations.values()
    c, s = np.cos(_RATE * t), np.sin(_RATE * t)
    expected = np.stack((bias[0] * c - bias[1] * s, bias[0] * s + bias[1] * c, np.full_like(t, bias[2])), axis=1)
    size = float(np.linalg.norm(bias[:2]))
    left = np.abs(rest.mean_n[-1, :2]).max() / size
    kept = np.linalg.norm(back.mean_n[-1, :2]) / size
    cells = [
        claimed(
            "largest departure from (2.6) to (2.9)", "bias in the n-frame", high=_ROUNDING, tolerance="rounding",
            ours=float(np.abs(swap_vector(rest.bias_n) - expected).max() / size),
        ),
        claimed("horizontal mean of two revolutions", "zero", left, high=_ROUNDING, tolerance="rounding"),
        against("mean along the axis", 1.0, abs(rest.mean_n[-1, 2]) / bias[2], absolute=_ROUNDING, tolerance="rounding",
                source="not modulated"),
        against("mean with the vehicle turning back as fast", 1.0, float(kept), absolute=_ROUNDING,
                tolerance="rounding", source="no modulation"),
    ]  # fmt: skip
    for name, motion in motions.items():
        cells.append(shown(f"{name}: effective rate", float(effective_rate(motion, t).mean() / DEG), unit="deg/s"))
    return Outcome(tuple(cells), figures=(lambda: modulated_biases(modulations),))


def _error_model(effort: Effort) -> Outcome:
    from schuler import earth
    from schuler.filtering.error_model import system_matrix_ned
    from schuler.filtering.states import StateLayout

    W, lat, v_n = earth.WGS84.omega_ie, 45.0 * DEG, np.array([20.0, 30.0, -1.0])
    g, llh = float(earth.gravity_somigliana(lat)), np.array([lat, 0.0, 0.0])
    M, N = (float(r) for r in earth.radii_of_curvature(lat))

    def matrix(velocity: FloatArray) -> FloatArray:
        force = np.array([0.0, 0.0, -g])
        return system_matrix_ned(StateLayout({}), np.eye(3), velocity, llh, np.zeros(3), force, position="radians")

    F, still = matrix(v_n), matrix(np.zeros(3))
    rate = v_n[1] / (N * np.cos(lat))
    schuler = [float(np.sqrt(-still[1, 3] * still[3, 1])), float(np.sqrt(-still[0, 4] * still[4, 0]))]
    mended = partial(against, reference="corrected", tolerance="rounding")
    cells = [
        mended("(2.16) height by V_U", 1.0, -F[8, 5], absolute=_ROUNDING, source="-1"),
        mended("(2.17) V_N by V_E, over -sin(lat)", 2.0 * (W + rate), -F[3, 4] / np.sin(lat), relative=_ROUNDING,
                unit="rad/s", source=f"2 W + lon rate = {2.0 * W + rate:.6g}"),
        mended("(2.17) V_U by V_E, over cos(lat)", 2.0 * (W + rate), -F[5, 4] / np.cos(lat), relative=_ROUNDING,
                unit="rad/s", source=f"2 W + lon rate = {2.0 * W + rate:.6g}"),
        mended("(2.18) eps_E by V_N, times M", 1.0, F[1, 3] * M, absolute=_ROUNDING, source="-1"),
        mended("(2.18) eps_N by V_E, times N", -1.0, F[0, 4] * N, absolute=_ROUNDING, source="1"),
        against("(2.18) eps_U by latitude, over W cos(lat) + lon rate / cos(lat)", -1.0,
                -F[2, 6] / (W * np.cos(lat) + rate / np.cos(lat)), absolute=_DROPPED, source="1",
                reference="corrected", tolerance="discretisation"),
    ]  # fmt: skip
    for name, w in zip(("north", "east"), schuler, strict=True):
        cells.append(
            against(f"Schuler period, {name}", 84.4, 2.0 * np.pi / w / MIN, absolute=0.3, unit="min", tolerance="band",
                    reference="corrected", source="with the printed signs it grows without a period")
        )  # fmt: skip
        change = 100.0 * (float(np.cos(300.0 * w)) - 1.0)
        cells.append(
            digits(f"a tilt after 300 s, {name}: change in percent", "-7", change, reference="corrected")
        )  # fmt: skip
    return Outcome(
        tuple(cells),
        "The source prints the height's derivative for a down velocity, a 2 too little before the rate of longitude in "
        "(2.17), and (2.18) with the opposite sign: both Schuler loops would be unstable, +7 % instead of -7 % after "
        "300 s. The filter has the corrected matrix, which is the Jacobian of its mechanization.",
    )


def _platform(effort: Effort) -> Outcome:
    from schuler import rotation
    from schuler.rotary import schemes
    from schuler.rotary.du_axes import du_axis
    from schuler.rotary.encoder import Encoder, platform_error, read_encoder

    t = np.linspace(0.0, 36.0, 145)
    platform = schemes.continuous(du_axis("Z"), _RATE)
    g = 9.81
    force = np.tile([0.0, 0.0, -g], (len(t), 1))
    omega = np.tile(_RATE * du_axis("Z"), (len(t), 1))
    one = DEG
    tilt = rotation.dcm_from_rpy(np.array([0.0, 30.0 * DEG, 0.0]))
    _, level = platform_error(platform, t, np.eye(3), omega, force, one, 0.0)
    C_bs = platform.C_bs(t)
    turned = np.einsum("nji,j->ni", C_bs, tilt.T @ np.array([0.0, 0.0, -g]))
    _, tilted = platform_error(platform, t, tilt, omega, turned, one, 0.0)
    d_omega, _ = platform_error(platform, t, np.eye(3), omega, force, 0.0, 1e-6)
    late = read_encoder(platform, Encoder(time_offset=5e-3), 36.0)
    inside = (t > 1.0) & (t < 35.0)
    off = np.abs(late.angles(t[inside])[:, 0] - platform.angles(t[inside])[:, 0]).mean()
    cells = (
        claimed("level, about Z: error of the force by one degree of angle error, over g", "no velocity error",
             float(np.abs(level).max() / g), high=1e-12, tolerance="rounding"),
        against("pitch 30 deg: the same", np.sin(30.0 * DEG) * one,
                float(np.linalg.norm(tilted[:, :2], axis=1).max() / g), relative=1e-9,
                tolerance="rounding", source="-C phi C f of (2.20)"),
        against("about Z: error of the rate, per error of the platform's rate", 1.0,
                float(np.abs(d_omega[:, 2]).max() / 1e-6), relative=1e-9,
                tolerance="rounding", source="+C d omega_sb of (2.21)"),
        against("encoder 5 ms late at 10 deg/s", 0.05, float(off / DEG), absolute=5e-4, unit="deg",
                tolerance="printed digits", reference="corrected", source="not in the thesis"),
    )  # fmt: skip
    return Outcome(cells)


ITEMS = (
    Item("text-2.3", "A bias of a turning IMU, and a vehicle that turns back", "exact", _modulation),
    Item("text-2.5", "Error model of the INS: signs and factors corrected", "exact", _error_model),
    Item("text-2.5-platform", "Errors of the platform's angle and rate", "exact", _platform),
)
