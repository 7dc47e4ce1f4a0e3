"""Tables 4.2 to 4.5 and 5.7 of Hayal (2010), the former beside the same simulation done many times.

The source has one draw of each case and does not say which attitudes it used. So its uncertainties agree within a
factor, and its errors are one draw from our distribution of errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.reproduce.hayal.study.multiposition import StudyCase, StudyResult, run_case
from schuler.units import PPM

Kind: TypeAlias = Literal["noise", "model error", "rounding"]

#: Uncertainties of the source lie within this factor of ours, to the two digits it is stated with. The largest ratio
#: is that of theta_zx in case 2 of Table 4.4, the angle that depends most on which attitudes were chosen: 1.71 to 1.74
#: in 400 runs by their seed, beyond 1.7 without rounding. The independent reimplementation that the factor
#: was set with has 7.09/4.08 = 1.74 there.
FACTOR = 1.7
#: What counts as rounding: relative to the reference.
ROUNDING = 1e-8
#: An error of one draw over its uncertainty.
SIGMAS = 3.0

_GYRO = {
    (3, 1): ((4.04e-9, 4.24e-9, 4.78e-9), (2.77e-9, 3.53e-9, 4.04e-10)),
    (3, 2): ((1.07e-6, 1.11e-6, 1.27e-6), (2.69e-7, 4.77e-7, 5.25e-7)),
    (3, 3): ((4.07e-5, 4.27e-5, 4.82e-5), (2.74e-5, 3.57e-5, 4.52e-6)),
    (6, 1): (
        (1.35e-9, 1.46e-9, 1.56e-9, 24.487, 26.514, 26.228),
        (2.68e-11, 6.83e-11, 4.19e-10, 11.547, 15.556, 28.691),
    ),
    (6, 2): (
        (1.15e-6, 1.25e-6, 1.33e-6, 20859.022, 22505.033, 22716.690),
        (5.88e-7, 1.96e-8, 2.36e-7, 7434.798, 25317.152, 4551.523),
    ),
    (6, 3): ((1.36e-5, 1.47e-5, 1.57e-5, 24.579, 26.613, 26.327), (3.77e-7, 5.94e-7, 4.04e-6, 11.012, 18.235, 28.962)),
    (9, 1): (
        (4.02e-21, 5.32e-21, 5.24e-21, 6.95e-11, 7.63e-11, 8.09e-11, 1.33e-10, 2.30e-10, 1.60e-10),
        (0.0, 0.0, 1.02e-20, 7.80e-11, 6.99e-12, 5.90e-11, 6.60e-11, 7.18e-11, 3.79e-12),
    ),
    (9, 2): (
        (1.22e-6, 1.71e-6, 1.65e-6, 21834.303, 23599.707, 25237.662, 36613.218, 70860.251, 47886.190),
        (7.37e-7, 2.92e-7, 9.46e-7, 13407.915, 26608.403, 1430.785, 32423.790, 30409.263, 74413.200),
    ),
    (9, 3): (
        (1.21e-6, 1.60e-6, 1.58e-6, 2.090, 2.296, 2.434, 4.007, 6.905, 4.821),
        (1.01e-6, 3.24e-7, 9.93e-7, 0.806, 2.725, 0.506, 2.919, 2.984, 7.945),
    ),
}  # fmt: skip
_ACCEL = {
    (9, 1): (
        (4.35e-16, 3.66e-16, 3.75e-16, 6.00e-11, 4.82e-11, 5.19e-11, 1.05e-10, 8.74e-11, 9.51e-11),
        (1.51e-16, 1.91e-16, 9.91e-16, 4.60e-11, 4.50e-11, 1.99e-12, 2.50e-11, 6.20e-11, 1.10e-11),
    ),
    (9, 2): (
        (1.32e-4, 1.11e-4, 1.14e-4, 18.201, 14.636, 15.737, 32.018, 26.538, 28.874),
        (2.97e-5, 4.69e-5, 8.97e-5, 1.585, 7.166, 0.718, 27.802, 2.237, 7.555),
    ),
}  # fmt: skip
_TABLES = {"4.2": ("gyro", 3), "4.3": ("gyro", 6), "4.4": ("gyro", 9), "4.5": ("accel", 9)}


@dataclass(frozen=True)
class TableRow:
    """One parameter of one case. SI, scale factors and angles as pure numbers.

    Attributes
    ----------
    table : str
        ``"4.2"`` to ``"4.5"``.
    case : int
        1 without noise, 2 with noise, 3 with noise and 10^4 times Earth rate.
    parameter : str
    kind : str
        What the uncertainty consists of.
    source_sigma, source_error : float
        As printed.
    sigma, rms_error : float
        Ours: mean prediction and root mean square error over the runs.
    """

    table: str
    case: int
    parameter: str
    kind: Kind
    source_sigma: float
    source_error: float
    sigma: float
    rms_error: float

    @property
    def ratio(self) -> float:
        """Uncertainty of the source over ours or ours over the source's, whichever is larger."""
        return max(self.source_sigma / self.sigma, self.sigma / self.source_sigma)

    @property
    def inside(self) -> bool:
        """Whether the source lies inside the band: see :data:`FACTOR`, :data:`SIGMAS`, :data:`ROUNDING`."""
        if self.kind == "rounding":
            return max(self.source_sigma, self.source_error, self.sigma, self.rms_error) < ROUNDING
        scatter = max(self.sigma, self.rms_error)
        return round(self.ratio, 1) <= FACTOR and self.source_error < SIGMAS * scatter


def table_case(table: str, case: int) -> StudyCase:
    """The simulation behind a table of the source, ``"4.2"`` to ``"4.5"``, case 1, 2 or (gyro) 3."""
    sensor, order = _TABLES[table]
    return StudyCase(
        sensor=sensor,  # type: ignore[arg-type]
        order=order,  # type: ignore[arg-type]
        noise_factor=0.0 if case == 1 else 1.0,
        rate_factor=1e4 if case == 3 else 1.0,
    )


def printed_rows(table: str) -> dict[int, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Sigma and error of each parameter as printed, by case: bias in its SI unit, then ppm and microradian."""
    sensor, order = _TABLES[table]
    return {case: rows for (m, case), rows in (_GYRO if sensor == "gyro" else _ACCEL).items() if m == order}


def table_rows(runs: int, rng: np.random.Generator, tables: Sequence[str] = tuple(_TABLES)) -> list[TableRow]:
    """Hayal's Tables 4.2 to 4.5 and ours, parameter by parameter.

    Parameters
    ----------
    runs : int
        Number for each case; 100 take some 4 s in all.
    rng : numpy.random.Generator
    tables : sequence of str

    Returns
    -------
    list of TableRow
    """
    rows = []
    for table in tables:
        sensor, order = _TABLES[table]
        printed = {k: v for k, v in (_GYRO if sensor == "gyro" else _ACCEL).items() if k[0] == order}
        for (_, case), (sigma, error) in printed.items():
            rows += _rows(table, case, np.array(sigma), np.array(error), run_case(table_case(table, case), runs, rng))
    return rows


def _rows(table: str, case: int, sigma: FloatArray, error: FloatArray, ours: StudyResult) -> list[TableRow]:
    order = len(sigma)
    unit = np.array([1.0] * 3 + [PPM] * 6)[:order]
    kind: Kind = "noise"
    if order < 9 and case != 2:
        kind = "model error"
    elif case == 1:
        kind = "rounding"
    return [
        TableRow(
            table, case, PARAMETERS[i], kind, float(sigma[i] * unit[i]), float(error[i] * unit[i]),
            float(ours.mean_sigma[i]), float(ours.rms_error[i]),
        )
        for i in range(order)
    ]  # fmt: skip


IMUS = ("HG1700", "HG1900")
SEEDINGS = ("Original", "3.0", "3.3", "3.9")
LENGTHS = (2.0, 10.0, 30.0, 60.0)
#: Table 5.7: mean and sigma of the position error by IMU, length and seeding. [m]
PUBLISHED = {
    ("HG1700", 2.0): ((0.0162, 0.2730), (0.0167, 0.2723), (0.0168, 0.2749), (0.0157, 0.2411)),
    ("HG1700", 10.0): ((0.1098, 2.9097), (0.1318, 2.7409), (0.1318, 2.7400), (0.1673, 2.8066)),
    ("HG1700", 30.0): ((1.8914, 16.2178), (2.2924, 14.8938), (2.2906, 14.8698), (2.6714, 15.5484)),
    ("HG1700", 60.0): ((26.7914, 183.4135), (24.0717, 147.1561), (23.9707, 147.8637), (28.4346, 178.1520)),
    ("HG1900", 2.0): ((0.0007, 0.2677), (0.0182, 0.2572), (0.0182, 0.2574), (0.0182, 0.2569)),
    ("HG1900", 10.0): ((0.1978, 6.7849), (0.1989, 6.8077), (0.1993, 6.8291), (0.2439, 6.8420)),
    ("HG1900", 30.0): ((2.1299, 21.2205), (2.0695, 23.0985), (2.0353, 23.1007), (2.8572, 24.6951)),
    ("HG1900", 60.0): ((17.9284, 92.3565), (13.9221, 76.5114), (13.7034, 75.9497), (18.3633, 83.7324)),
}
#: Independent prototype of this emulation (another program, 66 outages, two draws): sigma at the four lengths. [m]
PROTOTYPE = {
    ("HG1700", "Original"): (0.0315, 0.198, 1.19, 4.63), ("HG1700", "3.0"): (0.0314, 0.196, 1.17, 4.55),
    ("HG1700", "3.3"): (0.0314, 0.196, 1.15, 4.47), ("HG1700", "3.9"): (0.0311, 0.195, 1.16, 4.51),
    ("HG1900", "Original"): (0.0312, 0.188, 1.03, 3.77), ("HG1900", "3.0"): (0.0310, 0.185, 1.01, 3.70),
    ("HG1900", "3.3"): (0.0307, 0.185, 0.99, 3.62), ("HG1900", "3.9"): (0.0305, 0.184, 1.00, 3.67),
}  # fmt: skip
