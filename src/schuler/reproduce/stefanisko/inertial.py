"""Sections 4.1, 4.5 and appendix B: the board at rest, emulated with the data sheet of its sensors."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.cells import Cell, against, claimed, digits, shown, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG

if TYPE_CHECKING:
    pass

HARDWARE = "Recorded by the board; ours is a unit with the noise of its sensors' data sheet at the same place. "


def _samples(effort: Effort) -> Outcome:
    from schuler.earth import gravity_ned
    from schuler.reproduce.stefanisko.study.bias_removal import resting_log
    from schuler.reproduce.stefanisko.study.experiment import ACCEL_NOISE, ESIEE, GYRO_NOISE, IMU_INTERVAL_S
    from schuler.reproduce.stefanisko.study.figures import samples_figure

    log = resting_log(np.random.default_rng(effort.seed), round(10.0 / IMU_INTERVAL_S))
    root = np.sqrt(IMU_INTERVAL_S)
    g = float(gravity_ned(ESIEE[0], ESIEE[2])[2])
    mean = log.accel.mean(axis=0)
    n = len(log)
    cells: list[Cell] = [
        claimed(
            "offset of z over that of x and y",
            "much bigger: gravity",
            abs(mean[2]) / float(np.abs(mean[:2]).max()),
            low=5.0,
        ),
        claimed(
            "gyroscopes: largest mean",
            "no gravity",
            float(np.abs(log.gyro.mean(axis=0)).max()) / DEG,
            high=0.5,
            unit="deg/s",
        ),
        digits(
            "data sheet: accelerometer, a sample", "0.0506", ACCEL_NOISE / root, unit="m/s^2", reference="corrected"
        ),
        # 0.06455 rounded up
        against(
            "data sheet: gyroscope, a sample",
            0.0646,
            GYRO_NOISE / root / DEG,
            unit="deg/s",
            absolute=1e-4,
            reference="corrected",
            tolerance="printed digits",
        ),
        shown("z less gravity and its bias", mean[2] + g, unit="m/s^2"),
    ]
    for k, axis in enumerate("xyz"):
        for x, s, what in ((log.accel, ACCEL_NOISE, "accelerometer"), (log.gyro, GYRO_NOISE, "gyroscope")):
            cells.append(
                against(
                    f"{what} {axis}: scatter over that of the data sheet",
                    1.0,
                    x[:, k].std() / s * root,
                    absolute=4.0 / np.sqrt(2.0 * n),
                    reference="corrected",
                    source="",
                )
            )
    figure = partial(samples_figure, log.t, log.accel, log.gyro, (ACCEL_NOISE / root, GYRO_NOISE / root))
    return Outcome(
        tuple(cells),
        HARDWARE + "He takes zero for what an accelerometer at rest should read; it reads the reaction to gravity.",
        (figure,),
    )


@cache
def _fixes(effort: Effort) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ten minutes of a receiver at rest: times, positions about their mean, velocities, north-east-down."""
    from schuler.frames import ecef_from_llh, ned_from_ecef
    from schuler.reproduce.stefanisko.study.experiment import ESIEE, SIGMA_POSITION, SIGMA_VELOCITY
    from schuler.simulation.gnss import GnssModel, simulate_gnss
    from schuler.simulation.motion import StaticMotion

    model = GnssModel(rate_hz=10.0, sigma_position=SIGMA_POSITION, sigma_velocity=SIGMA_VELOCITY)
    gnss = simulate_gnss(StaticMotion(ESIEE, np.zeros(3), 600.0), model, np.random.default_rng((effort.seed, 45)))
    r = ned_from_ecef(ecef_from_llh(gnss.llh), ESIEE)
    return gnss.t, r - r.mean(axis=0), gnss.need_velocity()[0]


def _receiver(effort: Effort) -> Outcome:
    from schuler.reproduce.stefanisko.study.experiment import SIGMA_POSITION, SIGMA_VELOCITY
    from schuler.reproduce.stefanisko.study.figures import gnss_figure

    t, r, v = _fixes(effort)
    half = 4.0 / np.sqrt(2.0 * len(t))
    cells = []
    for x, texts, unit, what in (
        (r, (3.6852, 3.9626, 4.3475), "m", "position"),
        (v, (0.0068, 0.0047, 0.0093), "m/s", "velocity"),
    ):
        for k, printed in enumerate(texts):
            digit = 5e-5  # the last one printed
            cells.append(
                against(
                    f"{what} {'xyz'[k]}: sigma of ten minutes",
                    printed,
                    float(x[:, k].std()),
                    unit=unit,
                    relative=half,
                    absolute=digit,
                )
            )
    some = t < t[0] + 20.0
    figure = partial(gnss_figure, t[some] - t[0], r[some], v[some], (SIGMA_POSITION, SIGMA_VELOCITY))
    return Outcome(
        transcribed(*cells),
        "Recorded by the receiver; its sigmas are the input of our simulated one, whose errors are white, which real "
        "ones are not.",
        (figure,),
    )


def _zero_velocity(effort: Effort) -> Outcome:
    """Fig. B.1: biases of a board that rests, from zero velocities."""
    from schuler.navigation.foot.run import navigate_foot
    from schuler.recording.series import ImuSeries
    from schuler.reproduce.stefanisko.study.bias_removal import expected_at_rest
    from schuler.reproduce.stefanisko.study.experiment import ACCEL_NOISE, ESIEE, GYRO_NOISE, IMU_INTERVAL_S
    from schuler.reproduce.stefanisko.study.figures import zupt_figure

    sigma = np.repeat((0.1, 0.05 * DEG), 3)  # larger ones turn the heading by degrees: no longer linear
    config = {
        "place": {"lat_deg": ESIEE[0] / DEG, "lon_deg": ESIEE[1] / DEG, "height_m": ESIEE[2]},
        "sensor": {
            "accel_noise_m_s2_rthz": ACCEL_NOISE,
            "gyro_noise_deg_s_rthz": GYRO_NOISE / DEG,
            "accel_bias_m_s2": sigma[0],
            "gyro_bias_deg_s": sigma[3] / DEG,
        },
        "detector": {"threshold": "noise"},
        "zupt": {"pivot": False, "sigma_m_s": 0.01, "roll_m": 0.0},
        "alignment": {"tilt_sigma_deg": 0.5},
        "filter": {"smooth": "none", "record_s": 0.2},
    }
    omega, f = expected_at_rest(ESIEE)
    n, root = round(20.0 / IMU_INTERVAL_S), np.sqrt(IMU_INTERVAL_S)
    z, shares, kept = [], [], None
    for child in np.random.SeedSequence((effort.seed, 21)).spawn(effort.runs(30, 200)):
        rng = np.random.default_rng(child)
        bias = sigma * rng.standard_normal(6)
        gyro = omega + bias[3:] + GYRO_NOISE / root * rng.standard_normal((n, 3))
        accel = f + bias[:3] + ACCEL_NOISE / root * rng.standard_normal((n, 3))
        result = navigate_foot(ImuSeries(IMU_INTERVAL_S * np.arange(1.0, n + 1.0), gyro, accel), config)
        run = result.navigation
        claimed_sigma = np.sqrt(np.einsum("kii->ki", run.covariance))[:, 9:15]
        z.append((run.parameters[-1, :6] - bias) / claimed_sigma[-1])
        shares.append(float(result.rests.mask.mean()))
        if kept is None:
            kept = (run.t, run.parameters[:, :6], claimed_sigma, bias)
    assert kept is not None
    left = kept[2][-1] / sigma
    normal = np.array(z)
    mean_square = float(np.mean(normal**2))
    half = 4.0 * np.sqrt(2.0 / normal.size)
    words = "estimated"
    return Outcome(
        (
            claimed("share of the log found at rest", "zero velocities", min(shares), low=0.95),
            claimed("accelerometer z: sigma left", words, float(left[2]), high=0.5),
            claimed("gyroscopes x, y: sigma left", words, float(left[3:5].max()), high=0.5),
            claimed("accelerometers x, y: sigma left", words, float(left[:2].min()), high=0.5),
            claimed("gyroscope z: sigma left", words, float(left[5]), high=0.5),
            against("errors over claim, squared", 1.0, mean_square, absolute=half, source="", reference="corrected"),
        ),
        HARDWARE + "At rest zero velocities show the vertical accelerometer and the horizontal gyroscopes. Horizontal "
        "accelerometers cannot be told from tilt nor the vertical gyroscope from heading, whatever a curve shows.",
        (partial(zupt_figure, *kept),),
    )


ITEMS: tuple[Item, ...] = (
    Item("fig-4.1", "samples of the IMU at rest", "hardware", _samples, ("fig-4.2",)),
    Item("fig-4.10", "receiver at rest", "hardware", _receiver, ("fig-4.11", "text-4.5")),
    Item("fig-B.1", "biases from zero velocities", "hardware", _zero_velocity),
)
