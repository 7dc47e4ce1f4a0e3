"""Numbers of Du's chapters 3 to 5 as printed, and those that the digest of it computed, which ours stand beside."""

from __future__ import annotations

from schuler.exceptions import InputError

#: Rates of the thesis's sweeps. [deg/s]
RATES_DEG_S = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0)

#: Table 4.5, ppm by rate with 60 s at rest and 60 s turning; corrected: the thesis prints 14.2 for NAV440 at 60 deg/s.
CALIBRATION_PPM = {
    "MTi-G": (645.5, 322.7, 215.2, 161.4, 129.1, 107.6, 92.2, 80.7, 71.7, 64.5),
    "NAV440": (86.1, 43.0, 28.7, 21.5, 17.2, 14.3, 12.3, 10.8, 9.6, 8.6),
}
#: Section 4.1.2: 1-sigma of the gyroscope biases after 60 s. [deg/h]
BIAS_DEG_HR = {"MTi-G": 23.2, "NAV440": 3.1}

#: Chapter 3 has figures only. Anchors of the digest: no noise, 45 deg of latitude, 10 deg/s, 300 s. By case and axis of
#: rotation (Du's), None for conventional: attitude error about E, N, U [deg], velocity E, N, U [m/s], horizontal and
#: vertical position [m]; None where the digest says nothing. Of installation, largest absolute attitude errors.
CHAPTER_3: dict[tuple[str, str | None], tuple[tuple[float, ...] | None, tuple[float, ...], float, float | None]] = {
    ("bias", None): ((2.52, 2.34, 2.38), (121.8, -5.7, 60.0), 15447.0, 9022.0),
    ("bias", "X"): ((2.44, -0.13, 0.06), (55.4, -65.0, 2.9), 10855.0, 383.0),
    ("bias", "Y"): ((0.21, 2.44, -0.09), (67.1, 55.1, -0.8), 10854.0, -325.0),
    ("bias", "Z"): ((-0.04, 0.12, 2.50), (0.9, 5.3, 60.1), 721.0, 9013.0),
    ("gyro bias", None): (None, (63.3, -63.2), 8995.0, None),
    ("gyro bias", "X"): (None, (-3.2, -63.4), 6384.0, None),
    ("gyro bias", "Y"): (None, (63.4, -3.5), 6388.0, None),
    ("gyro bias", "Z"): (None, (2.5, 2.6), 530.0, None),
    ("scale factor", None): (None, (0.1, 0.0), 7.0, None),
    ("scale factor", "X"): ((8.76, -0.06, 0.08), (-3.3, -227.9), 22918.0, None),
    ("scale factor", "Y"): ((0.08, 8.76, -0.20), (228.1, -4.3), 22930.0, None),
    ("scale factor", "Z"): ((-0.07, 0.01, 8.97), (0.0, 1.2), 89.0, None),
    ("installation", None): (None, (0.0, -0.1), 9.0, None),
    ("installation", "X"): ((0.006, 0.241, 0.247), (-4.8, -0.1), 733.0, None),
    ("installation", "Y"): ((0.241, 0.007, 0.241), (0.1, -5.1), 793.0, None),
    ("installation", "Z"): ((0.241, 0.241, 0.002), (5.2, 4.7), 1076.0, None),
}

#: Tables 4.3 and 4.4, conventional over 300 s: horizontal position [m] and velocity [m/s], both of two components,
#: height [m], vertical velocity [m/s], roll, pitch, azimuth [deg]. One run each.
STATIC_CONVENTIONAL = {
    "MTi-G": (2854.9, 39.0, 173.8, 1.2, 1.32, 1.83, 2.31),
    "NAV440": (2939.5, 27.1, 1033.0, 9.0, 0.60, 0.48, 0.73),
}
#: Means over ten rates about Z, one run a rate: horizontal position [m] and velocity [m/s].
STATIC_ROTARY = {
    ("MTi-G", "I"): (1525.8, 14.6),
    ("MTi-G", "II"): (1057.2, 10.4),
    ("NAV440", "I"): (544.8, 4.9),
    ("NAV440", "II"): (213.8, 2.2),
}
#: Rates that the thesis recommends. [deg/s]
RECOMMENDED_DEG_S = {"MTi-G": 10.0, "NAV440": 20.0}

#: The digest's emulation (200 runs): means of horizontal position [m] and velocity [m/s], by IMU, strategy and rate.
#: Of a range both ends.
EMULATED: dict[tuple[str, str, float], tuple[tuple[float, float], tuple[float, float]]] = {
    ("NAV440", "conventional", 0.0): ((2964.0, 2964.0), (25.5, 25.5)),
    ("NAV440", "I", 10.0): ((570.0, 570.0), (5.0, 5.0)),
    ("NAV440", "I", 100.0): ((576.0, 576.0), (5.4, 5.4)),
    ("NAV440", "II", 10.0): ((254.0, 254.0), (2.55, 2.55)),
    ("NAV440", "II", 20.0): ((211.0, 211.0), (2.21, 2.21)),
    ("NAV440", "II", 50.0): ((209.0, 209.0), (2.21, 2.21)),
    ("NAV440", "II", 100.0): ((204.0, 204.0), (2.15, 2.15)),
    ("MTi-G", "conventional", 0.0): ((2623.0, 2623.0), (30.0, 30.0)),
    ("MTi-G", "I", 10.0): ((1780.0, 1900.0), (18.0, 19.0)),
    ("MTi-G", "I", 100.0): ((1780.0, 1900.0), (18.0, 19.0)),
    ("MTi-G", "II", 10.0): ((1500.0, 1565.0), (16.0, 16.0)),
    ("MTi-G", "II", 20.0): ((1500.0, 1565.0), (16.0, 16.0)),
    ("MTi-G", "II", 50.0): ((1500.0, 1565.0), (16.0, 16.0)),
    ("MTi-G", "II", 100.0): ((1500.0, 1565.0), (16.0, 16.0)),
}

#: Tables 4.7 and 4.8, over about 210 s of driving: horizontal position [m] and velocity [m/s], roll, pitch, azimuth
#: [deg]; the conventional run, then six rotary ones. Corrected: mean azimuth of MTi-G is 2.99 (printed 2.94).
KINEMATIC: dict[str, tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]] = {
    "NAV440": (
        (725.0, 10.2, 0.40, 0.39, 0.67),
        (
            (206.9, 2.9, 0.12, 0.11, 1.84), (219.7, 3.8, 0.18, 0.19, 0.63), (154.8, 2.7, 0.13, 0.16, 0.26),
            (313.5, 4.3, 0.15, 0.13, 0.90), (332.3, 4.7, 0.19, 0.18, 1.45), (221.6, 2.8, 0.13, 0.16, 1.02),
        ),
    ),
    "MTi-G": (
        (1345.4, 17.6, 0.73, 0.71, 2.67),
        (
            (451.4, 7.6, 0.37, 0.40, 1.95), (634.2, 8.2, 0.53, 0.50, 3.31), (788.4, 11.7, 0.58, 0.50, 2.72),
            (640.2, 11.4, 0.64, 0.58, 3.48), (638.7, 9.3, 0.73, 0.62, 2.86), (920.6, 14.4, 0.58, 0.66, 3.62),
        ),
    ),
}  # fmt: skip
#: How many times smaller horizontal position errors are said to become by rotation, when driving.
CLAIMED = {"NAV440": (3.0, 5.0), "MTi-G": (2.0, 3.0)}

#: Gyroscope biases that the filters of table 5.5 and its twin found with the IMU rotating at 10 deg/s about Y, pitch 30
#: (the best observable case), Du's axes. [deg/h]
GYRO_BIAS_DEG_HR = {"NAV440": (-228.1, 285.5, -74.0), "MTi-G": (777.1, -1804.9, 1096.7)}

IMUS = ("NAV440", "MTi-G")


def check_imu(name: str) -> str:
    """Refuse an IMU that is not of the thesis."""
    if name not in IMUS:
        raise InputError(f"imu: expected one of {', '.join(IMUS)}, got {name!r}")
    return name
