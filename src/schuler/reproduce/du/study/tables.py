"""Numbers of Du's chapters 3 to 6 as printed, and those of independent computations from its corrected equations."""

from __future__ import annotations

from typing import NamedTuple

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

#: Chapter 3 has figures only. Anchors of an independent check: no noise, 45 deg of latitude, 10 deg/s, 300 s. By case
#: and axis of rotation (Du's), None for conventional: attitude error about E, N, U [deg], velocity E, N, U [m/s],
#: horizontal and vertical position [m]; None where the check has none. Attitude of installation: largest absolute.
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

#: Independent emulation (200 runs): means of horizontal position [m] and velocity [m/s], by IMU, strategy and rate.
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


Triple = tuple[float, float, float]


class Measured(NamedTuple):
    """A row of tables 5.3 to 5.14: one IMU on the turntable, 300 s, zero-velocity updates.

    Attributes
    ----------
    b_m_s2 : tuple of float
        Mean estimates of accelerometer biases x, y, z (right, forward, up).
    attitude_deg : tuple of float
        RMS of roll, pitch, azimuth.
    d_deg_hr : tuple of float
        Mean estimates of gyroscope biases.
    """

    b_m_s2: Triple
    attitude_deg: Triple
    d_deg_hr: Triple


#: By IMU, axis of the test, and how it was run: None conventional, else pitch or tilt of the rotating IMU in degrees.
#: Corrected: four tables print "roll" for what is pitch, two the unit of the gyroscopes as degrees.
MEASURED: dict[tuple[str, str, float | None], Measured] = {
    ("NAV440", "Y", None): Measured((-0.039, -0.021, 0.058), (0.87, 0.60, 3.77), (-361.7, 258.2, -98.5)),
    ("NAV440", "Y", 0.0): Measured((0.111, 0.047, 0.054), (0.03, 0.28, 0.35), (-237.1, 275.4, -75.0)),
    ("NAV440", "Y", 30.0): Measured((0.113, 0.095, 0.052), (0.03, 0.04, 0.55), (-228.1, 285.5, -74.0)),
    ("MTi-G", "Y", None): Measured((0.112, 0.223, 0.009), (0.71, 1.24, 25.91), (683.1, -1786.7, 495.9)),
    ("MTi-G", "Y", 0.0): Measured((-0.010, 0.007, 0.007), (0.07, 0.11, 0.78), (748.2, -1802.1, 1165.2)),
    ("MTi-G", "Y", 30.0): Measured((-0.011, -0.007, 0.008), (0.08, 0.08, 2.02), (777.1, -1804.9, 1096.7)),
    ("NAV440", "Z", None): Measured((-0.085, -0.027, -0.089), (1.11, 0.49, 10.11), (-308.4, -154.8, -92.3)),
    ("NAV440", "Z", 0.0): Measured((0.046, 0.011, -0.091), (0.33, 0.34, 7.97), (-22.6, 45.5, -95.2)),
    ("NAV440", "Z", 30.0): Measured((0.112, 0.052, -0.092), (0.04, 0.04, 2.36), (-213.0, -118.5, -309.3)),
    ("MTi-G", "Z", None): Measured((0.033, -0.039, 0.006), (0.39, 0.34, 59.7), (653.6, 1028.1, 538.3)),
    ("MTi-G", "Z", 0.0): Measured((0.076, 0.170, 0.011), (0.82, 0.85, 101.13), (442.9, 531.6, -243.4)),
    ("MTi-G", "Z", 30.0): Measured((-0.012, 0.008, 0.010), (0.08, 0.08, 2.96), (776.1, 1056.4, 1766.0)),
}


class Anchor(NamedTuple):
    """1-sigma at 300 s of independent covariance runs; of a value with ``<`` in it only an upper bound.

    Attributes
    ----------
    tilt_deg : tuple of float
        About east and north.
    azimuth_deg : float
    b_m_s2 : tuple of float
        Accelerometer biases x, y; negative: no more than its absolute value.
    d_deg_hr : tuple of float
        Gyroscope biases x, y, z.
    """

    tilt_deg: tuple[float, float]
    azimuth_deg: float
    b_m_s2: tuple[float, float]
    d_deg_hr: Triple


#: By IMU, rotation axis (None conventional), and pitch or tilt. [deg]
ANCHORS: dict[tuple[str, str | None, float], Anchor] = {
    ("MTi-G", None, 0.0): Anchor((0.51, 0.51), 197.0, (0.086, 0.086), (30.0, 17.0, 2363.0)),
    ("MTi-G", "Y", 0.0): Anchor((0.51, 0.055), 1.3, (-0.001, 0.086), (21.0, 17.0, 21.0)),
    ("MTi-G", "Y", 30.0): Anchor((0.055, 0.055), 1.4, (-0.001, -0.001), (20.0, 19.0, 20.0)),
    ("MTi-G", "Z", 0.0): Anchor((0.51, 0.51), 94.0, (0.086, 0.086), (317.0, 317.0, 1130.0)),
    ("MTi-G", "Z", 30.0): Anchor((0.055, 0.055), 2.0, (0.001, 0.001), (18.0, 18.0, 26.0)),
    ("NAV440", None, 0.0): Anchor((0.76, 0.76), 31.0, (0.13, 0.13), (7.0, 5.0, 375.0)),
    ("NAV440", "Y", 0.0): Anchor((0.76, 0.021), 1.0, (0.001, 0.13), (7.0, 5.0, 7.0)),
    ("NAV440", "Z", 0.0): Anchor((0.49, 0.49), 12.9, (0.083, 0.083), (307.0, 307.0, 156.0)),
    ("NAV440", "Z", 30.0): Anchor((0.022, 0.023), 1.0, (0.001, 0.001), (8.0, 8.0, 7.0)),
}


class Integrated(NamedTuple):
    """RMS of a row of the tables of chapter 6, over the drive or over all of its outages.

    Attributes
    ----------
    attitude_deg : tuple of float
        Roll, pitch, azimuth.
    horizontal_m, horizontal_m_s : float
        Root of the sum of squares of both components.
    """

    attitude_deg: Triple
    horizontal_m: float
    horizontal_m_s: float


#: Tables 6.1 to 6.4, GNSS all the time; one drive each.
CONTINUOUS: dict[tuple[str, str], Integrated] = {
    ("NAV440", "conventional"): Integrated((0.12, 0.12, 0.39), 0.026, 0.027),
    ("NAV440", "rotary"): Integrated((0.11, 0.12, 0.44), 0.025, 0.026),
    ("MTi-G", "conventional"): Integrated((0.22, 0.26, 1.43), 0.038, 0.046),
    ("MTi-G", "rotary"): Integrated((0.26, 0.24, 1.39), 0.038, 0.046),
}
#: Tables 6.2 and 6.4: RMS of latitude, longitude, height [cm], velocity east, north, up [cm/s].
CONTINUOUS_CM: dict[tuple[str, str], tuple[float, ...]] = {
    ("NAV440", "conventional"): (1.9, 1.8, 1.5, 1.9, 1.9, 1.3),
    ("NAV440", "rotary"): (1.9, 1.7, 1.5, 1.8, 1.9, 1.3),
    ("MTi-G", "conventional"): (2.8, 2.5, 1.7, 3.2, 3.3, 1.2),
    ("MTi-G", "rotary"): (2.8, 2.6, 1.7, 3.2, 3.3, 1.2),
}
#: Tables 6.5 and 6.6, three outages of 300 s.
OUTAGES: dict[tuple[str, str], Integrated] = {
    ("NAV440", "conventional"): Integrated((0.64, 0.50, 0.42), 1095.0, 14.4),
    ("NAV440", "rotary"): Integrated((0.13, 0.18, 0.76), 440.2, 4.8),
    ("MTi-G", "conventional"): Integrated((0.83, 0.75, 2.39), 3458.3, 31.9),
    ("MTi-G", "rotary"): Integrated((0.59, 0.57, 1.67), 1645.3, 17.3),
}
