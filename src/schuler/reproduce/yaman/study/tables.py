"""Tables of Yaman (2017) as printed: navigation by mode, Monte Carlo of the field calibration (Tables 5.3, 5.4)."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Literal

import numpy as np

from schuler.exceptions import InputError
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec
from schuler.units import DEG, DEG_PER_HR, DEG_PER_HR_PER_G, MG, PPM

Gps = Literal["None", "Full", "Partial"]
#: GPS, calibrated IMU, ZUPT and NHC: the rows of tables 6.2 and 6.3.
MODES: tuple[tuple[Gps, bool, bool], ...] = (
    ("None", True, False), ("None", True, True), ("None", False, False), ("None", False, True), ("Full", False, False),
    ("Partial", True, False), ("Partial", True, True), ("Partial", False, False), ("Partial", False, True),
)  # fmt: skip
#: Columns of the tables.
QUANTITIES = (
    "position_horizontal_m", "position_vertical_m", "velocity_horizontal_m_s", "velocity_vertical_m_s", "roll_deg",
    "pitch_deg", "yaw_deg",
)  # fmt: skip
#: Table 6.2 (drive 1) and 6.3 (drive 2), in the order of MODES.
PRINTED_MODES = {
    1: (
        (6188.15, 315.94, 37.64, 1.06, 0.49, 0.52, 2.49), (18.33, 71.94, 0.69, 0.43, 0.19, 0.30, 1.75),
        (6978.13, 71771.49, 32.21, 343.22, 0.80, 0.96, 7.73), (66.27, 101.90, 1.35, 0.61, 0.34, 1.34, 4.38),
        (1.61, 4.19, 0.37, 0.87, 0.31, 0.36, 1.06), (34.31, 10.41, 1.38, 0.19, 0.11, 0.08, 0.60),
        (27.74, 8.88, 1.11, 0.23, 0.11, 0.11, 1.13), (159.43, 803.34, 7.35, 32.82, 0.32, 0.65, 1.54),
        (19.22, 17.42, 1.05, 1.01, 0.24, 0.46, 1.44),
    ),
    2: (
        (6811.25, 1275.34, 40.08, 5.73, 0.69, 0.62, 1.33), (27.12, 16.63, 0.86, 0.08, 0.09, 0.10, 1.26),
        (8559.36, 84280.23, 70.39, 379.38, 1.08, 1.11, 10.01), (32.55, 21.41, 1.03, 0.34, 0.24, 0.40, 5.44),
        (1.609, 4.45, 0.38, 0.92, 0.31, 0.31, 2.04), (95.94, 41.34, 2.65, 0.94, 0.22, 0.16, 0.48),
        (28.73, 5.99, 0.99, 0.09, 0.08, 0.08, 0.31), (450.49, 2223.17, 11.56, 56.91, 0.95, 0.91, 2.13),
        (30.05, 19.62, 1.73, 0.81, 0.28, 0.49, 2.57),
    ),
}  # fmt: skip


def mode_name(gps: Gps, calibrated: bool, aided: bool) -> str:
    """Name of a mode as in the thesis: ``Partial, INS+CIMU+NG``."""
    return f"{gps}, INS{'+CIMU' if calibrated else ''}{'+NG' if aided else ''}"


def agreed_order(column: str = "position_horizontal_m") -> list[tuple[int, int]]:
    """Pairs of modes (better, worse) on whose order both tables of the source agree by more than a fifth."""
    k = QUANTITIES.index(column)
    first, second = (np.array(PRINTED_MODES[n])[:, k] for n in (1, 2))
    pairs = []
    for i, j in combinations(range(len(MODES)), 2):
        for a, b in ((i, j), (j, i)):
            if first[b] > 1.2 * first[a] and second[b] > 1.2 * second[a]:
                pairs.append((a, b))
    return pairs


#: Grades of table 5.2, by their name in the catalogue of sensors.
GRADES = ("yaman-automotive", "yaman-tactical")
#: Runs of the source behind every number.
RUNS = 1000
#: Length of the source's routine. [s]
DURATION_S = 540.0

#: Gyroscope bias of the source's VN-200: about 1 deg/s on its z axis (section 6.2.1.2); the sheet has no turn-on bias.
VN_200_BIAS = 1.0 * DEG

_MRAD = 1e-3
# of names[:3]; scale factors are the diagonals of M_a and M_g
_UNITS = {"b_a": ("mg", MG), "b_g": ("deg/h", DEG_PER_HR), "G_g": ("deg/h/g", DEG_PER_HR_PER_G)}

#: Modelled mean and standard deviation, residual mean and standard deviation, in the units of :func:`printed_unit`.
#: Tables 5.3 (accelerometers) and 5.4 (gyroscopes); corrected FIX 21 (M_g_yy) and FIX 22 (M_a_yz, the mrad figure).
PRINTED_CAMPAIGNS: dict[str, dict[str, tuple[float, float, float, float]]] = {
    "yaman-automotive": {
        "b_a_x": (1.1456, 50.924, 0.0233, 0.092), "b_a_y": (-2.2110, 49.186, 0.0068, 0.345),
        "b_a_z": (-2.3847, 48.944, -0.0997, 0.412),
        "M_a_xx": (-526.46, 9836.7, -101.88, 141.72), "M_a_yy": (43.70, 10003.0, 199.74, 255.85),
        "M_a_zz": (393.31, 9991.4, 283.69, 283.44),
        "M_a_xy": (0.4022, 10.019, -0.0017, 0.0553), "M_a_xz": (0.3494, 10.205, 0.0341, 0.1648),
        "M_a_yz": (0.1276, 10.107, 0.0399, 0.0914),
        "b_g_x": (-0.2201, 198.66, -4.3182, 3.787), "b_g_y": (4.8621, 195.94, 0.8005, 4.768),
        "b_g_z": (-4.3174, 201.7, -3.5579, 3.680),
        "M_g_xx": (-217.79, 9850.2, 253.19, 248.85), "M_g_yy": (-235.30, 9401.4, -43.09, 276.08),
        "M_g_zz": (-86.719, 10069.0, 219.48, 237.11),
        "M_g_xy": (0.3176, 10.123, 0.2525, 0.2262), "M_g_xz": (-0.0717, 10.143, 0.2443, 0.2659),
        "M_g_yx": (-0.6554, 9.867, -0.1323, 0.3864), "M_g_yz": (-0.2942, 9.900, 0.0272, 0.3231),
        "M_g_zx": (-0.2824, 10.503, 0.2372, 0.3022), "M_g_zy": (-0.3198, 10.126, 0.1394, 0.2313),
        "G_g_xx": (2.570, 91.388, -8.424, 5.645), "G_g_xy": (0.144, 92.356, 0.233, 3.650),
        "G_g_xz": (-4.756, 90.891, 0.695, 3.560),
        "G_g_yx": (0.083, 91.034, -0.538, 2.984), "G_g_yy": (0.747, 88.295, -6.639, 7.297),
        "G_g_yz": (-2.808, 89.164, 0.371, 4.206),
        "G_g_zx": (-4.547, 89.792, -0.443, 2.587), "G_g_zy": (-3.494, 89.372, -0.092, 3.728),
        "G_g_zz": (1.070, 90.745, -7.459, 7.732),
    },
    "yaman-tactical": {
        "b_a_x": (0.0229, 1.0185, 0.0000, 0.0036), "b_a_y": (-0.0442, 0.9837, 0.0000, 0.0038),
        "b_a_z": (-0.0477, 0.9789, -0.0001, 0.0035),
        "M_a_xx": (-15.794, 295.101, 0.0732, 4.273), "M_a_yy": (1.311, 300.091, 0.0498, 4.446),
        "M_a_zz": (11.799, 299.743, 0.7189, 4.067),
        "M_a_xy": (0.0201, 0.5010, -0.0006, 0.0076), "M_a_xz": (0.0175, 0.5102, -0.0001, 0.0122),
        "M_a_yz": (0.0064, 0.5054, -0.0001, 0.0197),
        "b_g_x": (-0.0011, 0.9933, -0.0131, 0.2329), "b_g_y": (0.0243, 0.9797, 0.0223, 0.4874),
        "b_g_z": (-0.0216, 1.0085, -0.0158, 0.2417),
        "M_g_xx": (-3.2668, 147.753, 0.6285, 17.744), "M_g_yy": (-3.5296, 141.021, -1.5150, 28.165),
        "M_g_zz": (-1.3008, 151.040, 0.7212, 18.821),
        "M_g_xy": (0.0159, 0.5062, 0.0005, 0.0205), "M_g_xz": (-0.0036, 0.5071, 0.0020, 0.0235),
        "M_g_yx": (-0.0328, 0.4934, -0.0027, 0.0382), "M_g_yz": (-0.0147, 0.4950, -0.0014, 0.0371),
        "M_g_zx": (-0.0141, 0.5251, 0.0015, 0.0250), "M_g_zy": (-0.0160, 0.5063, 0.0010, 0.0210),
    },
}  # fmt: skip


def printed_unit(name: str) -> tuple[str, float]:
    """Unit of the source's tables for a parameter, and its factor to SI.

    Examples
    --------
    >>> printed_unit("M_a_xx")[0], printed_unit("M_a_xy")[0], printed_unit("b_g_z")[0]
    ('ppm', 'mrad', 'deg/h')
    """
    if name[:3] in _UNITS:
        return _UNITS[name[:3]]
    if name[:3] in ("M_a", "M_g") and len(name) == 6:
        return ("ppm", PPM) if name[4] == name[5] else ("mrad", _MRAD)
    raise InputError(f"parameter: the source has biases, M_a, M_g and G_g, got {name!r}")


def published(grade: str, name: str) -> tuple[float, float, float, float] | None:
    """Modelled mean and std, residual mean and std of a parameter in SI; None where the source has none.

    The source's residuals are truth minus estimate as far as Tables 5.3 and 5.4 show: means have the other sign here.
    """
    row = PRINTED_CAMPAIGNS.get(grade, {}).get(name)
    if row is None:
        return None
    factor = printed_unit(name)[1]
    return row[0] * factor, row[1] * factor, -row[2] * factor, row[3] * factor


def noise_limit(spec: ImuSpec, name: str, duration_s: float) -> float | None:
    """Smallest 1-sigma that white noise leaves of a bias: ``N / sqrt(T)`` beside what was known before. [SI]

    All the log at rest or at a rate that is known otherwise, no other unknown; None for parameters other than biases.
    """
    if name[:3] not in ("b_a", "b_g"):
        return None
    triad = spec.accel if name[2] == "a" else spec.gyro
    information = duration_s / triad.random_walk**2 if triad.random_walk else np.inf
    before = 1.0 / triad.turn_on_bias**2 if triad.turn_on_bias else np.inf
    return float(1.0 / np.sqrt(information + before))


def static_spec(imu: str) -> ImuSpec:
    """Specification of a unit of the source's static tests: the catalogue's, and what the text says of it besides.

    References
    ----------
    Yaman (2017), section 6.2.1 and appendix E: MPU-6000, VN-200, MTi-G-710.
    """
    spec = catalogue.spec(imu)
    if spec.name == "VN-200":
        return replace(spec, gyro=replace(spec.gyro, turn_on_bias=VN_200_BIAS))
    return spec
