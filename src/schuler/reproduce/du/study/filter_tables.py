"""Numbers of Du's chapters 5 and 6, and anchors of the digest, which those of our filters stand beside. Du's axes."""

from __future__ import annotations

from typing import NamedTuple

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
    """1-sigma at 300 s of the digest's covariance runs; of a value with ``<`` in it only an upper bound.

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
