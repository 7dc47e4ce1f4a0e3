"""Analytic errors of a static IMU over a revolution, conventional and turned about X, Y and Z, with what is left.

In Du's axes: east north up, right forward up, body along navigation axes, and Du's names: ``Kxy`` is the error of the
x output by the y input, ``d`` a gyroscope's bias, ``b`` an accelerometer's, ``Ka`` its matrix. Rotation is positive
about the axis named. ``Wc`` and ``Ws`` are Earth rate times cosine and sine of latitude.

References
----------
Du (2015), chapter 3, corrected: (3.12), (3.13) use ``C_s^b``; (3.23) lacks the time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from schuler import earth, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.rotary.du_axes import swap_matrix, swap_vector
from schuler.sensors.errors import ImuErrors

Scheme = Literal["conventional", "X", "Y", "Z"]
Source = Literal[
    "gyro bias", "gyro scale factor", "gyro installation", "accel bias", "accel scale factor", "accel installation"
]

SCHEMES: tuple[Scheme, ...] = ("conventional", "X", "Y", "Z")
SOURCES: tuple[Source, ...] = (
    "gyro bias", "gyro scale factor", "gyro installation", "accel bias", "accel scale factor", "accel installation",
)  # fmt: skip

#: A term of a cell: number, name of an error, factors that multiply it.
Term = tuple[float, str, str]
Cell = tuple[Term, ...]

_O: Cell = ()
_H = 0.5
#: Mean rate of error in navigation axes (east, north, up), by source and scheme.
CELLS: dict[tuple[Source, Scheme], tuple[Cell, Cell, Cell]] = {
    ("gyro bias", "conventional"): (((1.0, "dx", ""),), ((1.0, "dy", ""),), ((1.0, "dz", ""),)),
    ("gyro bias", "X"): (((1.0, "dx", ""),), _O, _O),
    ("gyro bias", "Y"): (_O, ((1.0, "dy", ""),), _O),
    ("gyro bias", "Z"): (_O, _O, ((1.0, "dz", ""),)),
    ("gyro scale factor", "conventional"): (_O, ((1.0, "Kyy", "Wc"),), ((1.0, "Kzz", "Ws"),)),
    ("gyro scale factor", "X"): (
        ((1.0, "Kxx", "w"),), ((_H, "Kyy", "Wc"), (_H, "Kzz", "Wc")), ((_H, "Kyy", "Ws"), (_H, "Kzz", "Ws")),
    ),
    ("gyro scale factor", "Y"): (_O, ((1.0, "Kyy", "w"), (1.0, "Kyy", "Wc")), ((_H, "Kxx", "Ws"), (_H, "Kzz", "Ws"))),
    ("gyro scale factor", "Z"): (_O, ((_H, "Kxx", "Wc"), (_H, "Kyy", "Wc")), ((1.0, "Kzz", "w"), (1.0, "Kzz", "Ws"))),
    ("gyro installation", "conventional"): (
        ((1.0, "Kxy", "Wc"), (1.0, "Kxz", "Ws")), ((1.0, "Kyz", "Ws"),), ((1.0, "Kzy", "Wc"),),
    ),
    ("gyro installation", "X"): (_O, ((_H, "Kyz", "Ws"), (-_H, "Kzy", "Ws")), ((_H, "Kzy", "Wc"), (-_H, "Kyz", "Wc"))),
    ("gyro installation", "Y"): (((_H, "Kxz", "Ws"), (-_H, "Kzx", "Ws")), _O, _O),
    ("gyro installation", "Z"): (((_H, "Kxy", "Wc"), (-_H, "Kyx", "Wc")), _O, _O),
    ("accel bias", "conventional"): (((1.0, "bx", ""),), ((1.0, "by", ""),), ((1.0, "bz", ""),)),
    ("accel bias", "X"): (((1.0, "bx", ""),), _O, _O),
    ("accel bias", "Y"): (_O, ((1.0, "by", ""),), _O),
    ("accel bias", "Z"): (_O, _O, ((1.0, "bz", ""),)),
    ("accel scale factor", "conventional"): (_O, _O, ((1.0, "Kazz", "g"),)),
    ("accel scale factor", "X"): (_O, _O, ((_H, "Kayy", "g"), (_H, "Kazz", "g"))),
    ("accel scale factor", "Y"): (_O, _O, ((_H, "Kaxx", "g"), (_H, "Kazz", "g"))),
    ("accel scale factor", "Z"): (_O, _O, ((1.0, "Kazz", "g"),)),
    ("accel installation", "conventional"): (((1.0, "Kaxz", "g"),), ((1.0, "Kayz", "g"),), _O),
    ("accel installation", "X"): (_O, ((_H, "Kayz", "g"), (-_H, "Kazy", "g")), _O),
    ("accel installation", "Y"): (((_H, "Kaxz", "g"), (-_H, "Kazx", "g")), _O, _O),
    ("accel installation", "Z"): (_O, _O, _O),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class DuErrors:
    """Fixed errors of an IMU in Du's axes (right, forward, up).

    Attributes
    ----------
    d, b : ndarray, shape (3,)
        Biases of gyroscopes [rad/s] and accelerometers [m/s^2].
    K, Ka : ndarray, shape (3, 3)
        Scale factor errors on the diagonal, installation errors off it: row output, column input. [-]
    """

    d: FloatArray = field(default_factory=lambda: np.zeros(3))
    b: FloatArray = field(default_factory=lambda: np.zeros(3))
    K: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    Ka: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        for name, shape in (("d", (3,)), ("b", (3,)), ("K", (3, 3)), ("Ka", (3, 3))):
            object.__setattr__(self, name, readonly(as_floats(getattr(self, name), name, shape).copy()))

    def only(self, source: Source) -> DuErrors:
        """The errors of one source, the rest zero."""
        if source not in SOURCES:
            raise InputError(f"source: expected one of {', '.join(SOURCES)}, got {source!r}")
        which, kind = source.split(" ", 1)
        gyro, bias = which == "gyro", kind == "bias"
        M = self.K if gyro else self.Ka
        M = np.diag(np.diag(M)) if kind == "scale factor" else M - np.diag(np.diag(M))
        if bias:
            return DuErrors(d=self.d) if gyro else DuErrors(b=self.b)
        return DuErrors(K=M) if gyro else DuErrors(Ka=M)

    def imu_errors(self) -> ImuErrors:
        """The same in our axes, for simulation."""
        return ImuErrors(
            b_g=swap_vector(self.d), b_a=swap_vector(self.b), M_g=swap_matrix(self.K), M_a=swap_matrix(self.Ka)
        )

    def value(self, name: str) -> float:
        """An error by the name it has in the tables."""
        index = ["xyz".index(c) for c in name if c in "xyz"]
        matrix = self.Ka if name.startswith("Ka") else self.K
        if name.startswith("K"):
            return float(matrix[index[0], index[1]])
        return float((self.d if name.startswith("d") else self.b)[index[0]])


def cycle_rate(source: Source, scheme: Scheme, errors: DuErrors, *, rate: float, lat: float) -> FloatArray:
    """Mean rate of error over whole revolutions: the table's cells with numbers.

    Parameters
    ----------
    source : str
        One of :data:`SOURCES`.
    scheme : {"conventional", "X", "Y", "Z"}
    errors : DuErrors
    rate : float
        Rate of the rotation; not used by the conventional scheme. [rad/s]
    lat : float
        [rad]

    Returns
    -------
    ndarray, shape (3,)
        East, north, up: of the attitude error for gyroscopes [rad/s], of the velocity error by the accelerometers
        themselves [m/s^2]. Exact to first order in the errors.

    Raises
    ------
    InputError
        If source or scheme are unknown.

    References
    ----------
    Du (2015), sections 3.1 and 3.2, eqs. (3.1)-(3.36) integrated over a revolution, corrected.
    """
    if (source, scheme) not in CELLS:
        raise InputError(f"no cell {source!r}, {scheme!r}: sources are {', '.join(SOURCES)}, schemes {SCHEMES}")
    factor = {
        "": 1.0,
        "w": rate,
        "Wc": earth.WGS84.omega_ie * np.cos(lat),
        "Ws": earth.WGS84.omega_ie * np.sin(lat),
        "g": _gravity(lat),
    }
    cells = CELLS[source, scheme]
    return np.array([sum(n * errors.value(name) * factor[f] for n, name, f in cell) for cell in cells])


def cell_text(cell: Cell) -> str:
    """A cell as it is printed: ``"1/2 Kyy Wc + 1/2 Kzz Wc"``, ``"0"`` if it is empty."""
    text = ""
    for number, name, factor in cell:
        sign = ("-" if number < 0.0 else "") if not text else (" - " if number < 0.0 else " + ")
        half = "1/2 " if abs(number) == _H else ""
        text += f"{sign}{half}{name}{' ' + factor if factor else ''}"
    return text or "0"


def table_text(source: Source) -> list[tuple[str, str, str, str]]:
    """Rows of scheme, east, north, up for one source, in words of :func:`cell_text`."""
    return [(s, *(cell_text(c) for c in CELLS[source, s])) for s in SCHEMES]  # type: ignore[misc]


def instantaneous_errors(
    scheme: Scheme, errors: DuErrors, angle: ArrayLike, *, rate: float, lat: float
) -> tuple[FloatArray, FloatArray]:
    """Errors of rate and specific force in navigation axes at angles of the platform.

    Parameters
    ----------
    scheme : {"conventional", "X", "Y", "Z"}
    errors : DuErrors
    angle : array_like, shape (n,)
        [rad]
    rate : float
        [rad/s]
    lat : float
        [rad]

    Returns
    -------
    d_omega_n, d_f_n : ndarray, shape (n, 3)
        East, north, up. [rad/s], [m/s^2]

    References
    ----------
    Du (2015), eqs. (2.9), (3.12)-(3.36) in one: ``C_s^n (d + K omega_is_s)`` with
    ``omega_is_s = C_n^s omega_ie + rate u``; the printed closed forms are its expansions.
    """
    u = _axis(scheme)
    angle = as_floats(angle, "angle", (None,))
    C_ns = rotation.dcm_from_rotvec(angle[:, None] * u)
    omega = earth_rate_enu(lat) @ C_ns + (rate * u if scheme != "conventional" else 0.0)
    f = np.array([0.0, 0.0, _gravity(lat)]) @ C_ns
    d_omega, d_f = errors.d + omega @ errors.K.T, errors.b + f @ errors.Ka.T
    return np.einsum("nij,nj->ni", C_ns, d_omega), np.einsum("nij,nj->ni", C_ns, d_f)


def secular_errors(
    scheme: Scheme,
    errors: DuErrors,
    t: float,
    *,
    rate: float,
    lat: float,
    start_angle: float = 0.0,
    reciprocating: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Secular errors that a rotation leaves of biases and installation errors; not in the thesis.

    Parameters
    ----------
    scheme : {"X", "Y", "Z"}
    errors : DuErrors
        Biases and the column of ``K`` along the axis count; Earth rate is neglected beside the rotation, and ``Ka``
        beside the accelerometers' biases.
    t : float
        Time, of which whole revolutions (whole periods there and back, if reciprocating) are meant. [s]
    rate : float
        [rad/s]
    lat : float
        For gravity. [rad]
    start_angle : float
        Angle of the platform at zero. [rad]
    reciprocating : bool
        A whole turn forwards and one backwards in turn: the sense changes the sign of ``K rate``.

    Returns
    -------
    attitude, velocity, position : ndarray, shape (3,)
        East, north, up, first order in the errors, flat Earth, without feedback; exact at whole revolutions, smooth
        in between. [rad], [m/s], [m]

    Notes
    -----
    With ``a = d + rate K u``, turned by the start angle, the tilt oscillates about the mean ``u x a / rate``. That is
    not zero, and gravity integrates it: about Z the velocity grows by ``g (d_h / rate + K_h) t``. The first part falls
    with the rate. The second, of installation errors, does not, and it survives a reciprocating rotation, which takes
    off the first and, of the attitude, what ``K`` adds along the axis.
    """
    if scheme == "conventional":
        raise InputError("a conventional IMU has no revolution; its errors grow by cycle_rate")
    if not (np.isfinite(rate) and rate != 0.0):
        raise InputError(f"rate: expected a rotation, got {rate!r} rad/s")
    u, f_n, T = _axis(scheme), np.array([0.0, 0.0, _gravity(lat)]), 2.0 * np.pi / abs(rate)
    C_0 = rotation.dcm_from_rotvec(start_angle * u)
    eps, v, r = _revolution(u, C_0, errors, rate, f_n)
    period = T
    if reciprocating:
        eps_2, v_2, r_2 = _revolution(u, C_0, errors, -rate, f_n)
        r = r + r_2 + v * T + 0.5 * np.cross(eps, f_n) * T**2
        v = v + v_2 + np.cross(eps, f_n) * T
        eps, period = eps + eps_2, 2.0 * T
    # n times the same: each starts with the attitude and velocity the ones before have left
    n, pull = t / period, np.cross(eps, f_n) * period
    pairs, triples = 0.5 * n * (n - 1.0), n * (n - 1.0) * (n - 2.0) / 6.0
    return (
        n * eps,
        n * v + pairs * pull,
        n * r + (pairs * v + (0.5 * pairs + triples) * pull) * period,
    )


def _revolution(
    u: FloatArray, C_0: FloatArray, errors: DuErrors, rate: float, f_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors of attitude, velocity and position after one whole turn from zero errors, navigation axes."""
    T = 2.0 * np.pi / abs(rate)
    a, b = C_0 @ (errors.d + rate * errors.K @ u), C_0 @ errors.b
    along, b_along = u * (u @ a), u * (u @ b)
    across, b_across = a - along, b - b_along
    growth = b_along + np.cross(np.cross(u, across) / rate, f_n)
    pull = np.cross(along, f_n)
    carried = np.cross(u, b_across) / rate + np.cross(across, f_n) / rate**2
    return along * T, growth * T + 0.5 * pull * T**2, carried * T + 0.5 * growth * T**2 + pull * T**3 / 6.0


def earth_rate_enu(lat: float) -> FloatArray:
    """Earth rate east, north, up. Shape (3,). [rad/s]"""
    return earth.WGS84.omega_ie * np.array([0.0, np.cos(lat), np.sin(lat)])


def _axis(scheme: Scheme) -> FloatArray:
    if scheme not in SCHEMES:
        raise InputError(f"scheme: expected one of {', '.join(SCHEMES)}, got {scheme!r}")
    return np.zeros(3) if scheme == "conventional" else np.eye(3)["XYZ".index(scheme)]


def _gravity(lat: float) -> float:
    return float(earth.gravity_somigliana(lat))
