"""A calibration as ``clbt`` of PSINS, and back; for users in :mod:`schuler.calibration.result.conventions`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, as_floats
from schuler.calibration.result.foreign import (
    determined_errors,
    held,
    inverse,
    named_places,
    places_of,
    turned,
    turned_places,
)
from schuler.calibration.result.parameters import in_gauge
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.io.hint_texts import axes_matrix
from schuler.sensors.errors import ImuErrors


def to_psins(result: CalibrationResult, axes: str = "RFU") -> dict[str, Any]:
    """Parameters as PSINS' ``imuclbt`` takes them.

    Parameters
    ----------
    result : CalibrationResult
    axes : str
        Directions of x, y, z of the log PSINS shall correct; PSINS' own are RFU, ours are FRD.

    Returns
    -------
    dict
        ``sf`` (6,), ``Kg``, ``Ka``, ``gSens`` (3, 3), ``eb``, ``db``, ``Ka2``, ``rx``, ``ry``, ``rz`` (3,), ``tGA``:
        fields of ``clbt`` in SI, with ``f1 = sf raw``, ``f2 = f1 - Ka2 f1^2``, ``f = Ka f2 - db - (size effect) - tGA
        (omega x f)``, ``omega = Kg (sf raw) - eb - gSens f2``.

    Raises
    ------
    InputError
        If a parameter is not determined, or axes are impossible.

    Notes
    -----
    ``Ka = R_a^-1``, ``db = R_a^-1 b_a``; ``Kg = R_g^-1``, ``gSens = R_g^-1 G_g R_a^-1`` because PSINS takes it times
    the specific force before Ka, and ``eb = R_g^-1 b_g - gSens b_a``. These are exact; in the gauge "lower" of the
    axes asked for, which is PSINS' own. ``Ka2 = Q_a`` and rx, ry, rz = r_a to first order in M. ``tGA = -delay``:
    PSINS counts how much the accelerometers are late.

    References
    ----------
    PSINS (Yan Gongmin), imuclbt.m, imuadderr.m, imulvS.m, clbtfile.m.
    """
    P = axes_matrix(axes).T
    errors = in_gauge(turned(determined_errors(result), P), "lower")
    Ka, Kg = np.linalg.inv(np.eye(3) + errors.M_a), np.linalg.inv(np.eye(3) + errors.M_g)
    gSens = Kg @ errors.G_g @ Ka
    Q = np.array([result.parameters.get(f"Q_a_{i}", 0.0) for i in "xyz"])
    places = places_of(result)
    rx, ry, rz = np.zeros((3, 3)) if places is None else turned_places(places, P)
    accel, gyro = result.nominal
    return {
        "sf": np.array([gyro] * 3 + [accel] * 3), "Kg": Kg, "eb": Kg @ errors.b_g - gSens @ errors.b_a,
        "Ka": np.tril(Ka), "db": Ka @ errors.b_a, "Ka2": P @ Q, "rx": rx, "ry": ry, "rz": rz,
        "tGA": 0.0 - result.parameters.get("delay", 0.0), "gSens": gSens,
    }  # fmt: skip


def from_psins(clbt: Mapping[str, Any], axes: str = "RFU") -> CalibrationResult:
    """A result from PSINS' ``clbt``; see :func:`to_psins`.

    Parameters
    ----------
    clbt : mapping
        Fields in SI, as in the workspace; those that are missing are those of a perfect sensor. (Its text files have eb
        in deg/h, db in ug, rx in cm, tGA in ms.)
    axes : str
        Directions of x, y, z of the log.

    Returns
    -------
    CalibrationResult
        In the gauge "lower" (of our axes). All parameters are held.

    Raises
    ------
    InputError
        If a shape is wrong, a matrix cannot be inverted, or ``sf`` differs among the axes of a triad or ``Kap`` is not
        zero, which we have no place for.
    """

    def vector3(name: str) -> FloatArray:
        return as_floats(np.ravel(clbt.get(name, np.zeros(3))), name, (3,))

    def matrix(name: str, default: FloatArray) -> FloatArray:
        return as_floats(clbt.get(name, default), name, (3, 3))

    sf = as_floats(np.ravel(clbt.get("sf", np.ones(6))), "sf", (6,))
    if np.ptp(sf[:3]) or np.ptp(sf[3:]) or vector3("Kap").any():
        raise InputError("clbt: expected one sf for each triad and no Kap; multiply sf into Kg and Ka, leave Kap out")
    R_a, R_g = inverse(matrix("Ka", np.eye(3)), "Ka"), inverse(matrix("Kg", np.eye(3)), "Kg")
    gSens = matrix("gSens", np.zeros((3, 3)))
    G = R_g @ gSens @ R_a
    b_a = R_a @ vector3("db")
    errors = ImuErrors(
        M_a=R_a - np.eye(3), b_a=b_a, M_g=R_g - np.eye(3), b_g=R_g @ (vector3("eb") + gSens @ b_a), G_g=G
    )
    turn = axes_matrix(axes)
    families = ("b_a", "M_a", "b_g", "M_g", "G_g") if "gSens" in clbt else ("b_a", "M_a", "b_g", "M_g")
    errors = in_gauge(turned(errors, turn), "lower")
    result = held(errors, "PSINS", "lower", families, (float(sf[3]), float(sf[0])))
    more: dict[str, float] = {}
    if vector3("Ka2").any():
        more |= {f"Q_a_{i}": float(q) for i, q in zip("xyz", turn @ vector3("Ka2"), strict=True)}
    rows = np.array([vector3(name) for name in ("rx", "ry", "rz")])
    if rows.any():
        more |= named_places(turned_places(rows, turn))
    if clbt.get("tGA", 0.0):
        more["delay"] = -float(clbt["tGA"])
    return replace(result, fixed=result.fixed | more)
