"""Du's error model of an IMU that turns at a constant rate, in symbols (SymPy)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from schuler.exceptions import InputError, MissingExtraError

#: A SymPy matrix or expression; SymPy is optional and is not imported with this module.
Symbolic = Any


def sympy_module() -> Any:
    """SymPy, which is optional."""
    try:
        import sympy
    except ImportError:
        raise MissingExtraError("sympy", "symbolic", "symbolic observability") from None
    return sympy


@dataclass(frozen=True)
class SymbolicModel:
    """Twelve error states of an IMU that turns at a constant rate, velocity measured.

    Attributes
    ----------
    names : tuple of str
    states : tuple of sympy.Symbol
        Named like the states, for combinations.
    derivatives : tuple of sympy.Matrix
        System matrix and its derivatives with time at the instant considered, as many as the recursion needs.
    H : sympy.Matrix
        Constant measurement matrix.
    constants : dict of str to sympy.Expr
        Symbols of the entries: ``g``, ``W`` (Earth rate), ``c``, ``s`` (cosine and sine of the latitude), ``w``
        (rate of the platform), ``M``, ``N`` (radii), and ``f_1``, ... if it manoeuvres. A constant set to zero is 0.
    scheme : str
    axes : {"enu", "ned"}
    """

    names: tuple[str, ...]
    states: tuple[Symbolic, ...]
    derivatives: tuple[Symbolic, ...]
    H: Symbolic
    constants: dict[str, Symbolic]
    scheme: str
    axes: str

    @property
    def F(self) -> Symbolic:
        """System matrix at the instant considered."""
        return self.derivatives[0]


def rotary_model(
    axis: Literal["x", "y", "z"] | None = None,
    *,
    roll: Symbolic = 0,
    pitch: Symbolic = 0,
    azimuth: Symbolic = 0,
    earth: bool = True,
    manoeuvre: bool = False,
    biases: Literal["imu", "navigation"] = "imu",
    axes: Literal["enu", "ned"] = "enu",
    order: int = 12,
) -> SymbolicModel:
    """Du's error model of a rotating IMU, in symbols.

    Parameters
    ----------
    axis : {"x", "y", "z"}, optional
        Platform axis in the vehicle: of right, forward, up with ``enu``, of forward, right, down with ``ned``; positive
        turns are right-handed. None: the IMU stands still in the vehicle.
    roll, pitch, azimuth : number or sympy expression
        Attitude of the vehicle, standard signs: nose up, right wing down, clockwise from north. [rad] An angle whose
        sine and cosine are rational, such as ``atan(3/4)``, so that everything stays exact; or a symbol ``a``, written
        with ``h_a``, the tangent of its half.
    earth : bool
        False sets the Earth's rate to zero, as low-cost gyroscopes see it.
    manoeuvre : bool
        A specific force ``f_1, f_2, f_3`` with its first two derivatives ``j_1, ...`` and ``k_1, ...`` instead of
        gravity alone.
    biases : {"imu", "navigation"}
        Biases in the axes of the IMU, where they are constant and ``F`` turns; or in those of navigation, where they
        turn and ``F`` is constant. The two are the same system.
    axes : {"enu", "ned"}
        ``enu``: Du's, biases are errors of the sensors, added. ``ned``: ours, biases are errors of estimates,
        subtracted.
    order : int
        Number of blocks the recursion will have.

    Returns
    -------
    SymbolicModel
        At the instant at which the IMU's axes are those of the vehicle; order velocity, attitude, gyroscope biases,
        accelerometer biases.

    Raises
    ------
    InputError
    MissingExtraError
        Without SymPy.

    References
    ----------
    Du (2015), eqs. (5.3)-(5.8) with the sign of (5.7) corrected, (5.9)-(5.24), and (6.3)-(6.5).
    """
    sp = sympy_module()
    if axis not in (None, "x", "y", "z") or axes not in ("enu", "ned") or biases not in ("imu", "navigation"):
        raise InputError(f"expected axis x, y, z or None, axes enu or ned, biases imu or navigation, got {axis!r}, "
                         f"{axes!r}, {biases!r}")  # fmt: skip
    g, c, s, w, M, N = sp.symbols("g c s w M N", positive=True)
    W = sp.Symbol("W", positive=True) if earth else sp.Integer(0)
    enu = axes == "enu"
    halves: dict[str, Symbolic] = {}
    C = _attitude(sp, *(_cosine_and_sine(sp, sp.sympify(a), halves) for a in (roll, pitch, azimuth)), enu=enu)
    omega = sp.Matrix([0, W * c, W * s] if enu else [W * c, 0, -W * s])
    force = [sp.Matrix([0, 0, g if enu else -g])]
    constants = {"g": g, "W": W, "c": c, "s": s, "w": w, "M": M, "N": N, **halves}
    if manoeuvre:
        force = [sp.Matrix(sp.symbols(f"{k}_1 {k}_2 {k}_3")) for k in "fjk"]
        constants |= {str(x): x for f in force for x in f}
    turn = sp.zeros(3, 1)
    if axis is not None:
        turn["xyz".index(axis)] = w
    zero, I3 = sp.zeros(3, 3), sp.eye(3)
    # what -delta omega_en does, from velocity errors
    if enu:
        transport = sp.Matrix([[0, 1 / M, 0], [-1 / N, 0, 0], [-s / c / N, 0, 0]])
    else:
        transport = sp.Matrix([[0, -1 / N, 0], [1 / M, 0, 0], [0, s / c / N, 0]])
    sign = 1 if enu else -1
    derivatives = []
    for j in range(order):
        first = j == 0
        f = force[j] if j < len(force) else sp.zeros(3, 1)
        if biases == "imu":
            K, turning = sign * C * _skew(sp, turn) ** j, zero
        else:
            K, turning = (sign * I3, _skew(sp, C * turn)) if first else (zero, zero)
        blocks = [
            [-2 * _skew(sp, omega) if first else zero, -_skew(sp, f), zero, K],
            [transport if first else zero, -_skew(sp, omega) if first else zero, K, zero],
            [zero, zero, turning, zero],
            [zero, zero, zero, turning],
        ]
        derivatives.append(sp.Matrix(sp.BlockMatrix(blocks)))
    letters = "ENU" if enu else "NED"
    inner = "xyz" if biases == "imu" else letters
    d, b = ("d", "b") if enu else ("b_g", "b_a")
    names = (
        *(f"dv_{a}" for a in letters), *(f"eps_{a}" for a in letters), *(f"{d}_{a}" for a in inner),
        *(f"{b}_{a}" for a in inner),
    )  # fmt: skip
    H = sp.Matrix(sp.BlockMatrix([[I3, zero, zero, zero]]))
    scheme = "conventional" if axis is None else f"rotation about {axis}"
    return SymbolicModel(names, tuple(sp.symbols(names)), tuple(derivatives), H, constants, scheme, axes)


def _cosine_and_sine(sp: Any, angle: Symbolic, halves: dict[str, Symbolic]) -> tuple[Symbolic, Symbolic]:
    """Cosine and sine of an angle; for a symbol, rational functions of the tangent of its half, added to ``halves``."""
    if not angle.is_Symbol:
        return sp.cos(angle), sp.sin(angle)
    h = halves.setdefault(f"h_{angle}", sp.Symbol(f"h_{angle}"))
    return (1 - h**2) / (1 + h**2), 2 * h / (1 + h**2)


def _attitude(
    sp: Any,
    roll: tuple[Symbolic, Symbolic],
    pitch: tuple[Symbolic, Symbolic],
    azimuth: tuple[Symbolic, Symbolic],
    *,
    enu: bool,
) -> Symbolic:
    """From vehicle to navigation axes, standard signs; angles as cosine and sine."""
    (cr, sr), (cp, s_p), (ca, sa) = roll, pitch, azimuth
    yaw = sp.Matrix([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    up = sp.Matrix([[cp, 0, s_p], [0, 1, 0], [-s_p, 0, cp]])
    over = sp.Matrix([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    C = yaw * up * over
    swap = sp.Matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    return swap * C * swap if enu else C


def _skew(sp: Any, v: Symbolic) -> Symbolic:
    return sp.Matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
