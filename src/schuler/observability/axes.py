"""Axes and names: biases in north-east-down at the start, or everything in the axes, signs and names of Du's thesis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.exceptions import InputError
from schuler.observability.system import LinearSystem

#: North-east-down to east-north-up, and forward-right-down to right-forward-up: the same matrix.
TO_DU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BIASES = ("b_a", "b_g", "b_a_run", "b_g_run")
_DU = {"b_a": "b", "b_g": "d", "b_a_run": "b_run", "b_g_run": "d_run"}


def in_navigation_axes(system: LinearSystem) -> LinearSystem:
    """Biases as they lie at the start in the axes of the names: ``b_a_N`` for ``b_a_x`` and so on.

    Parameters
    ----------
    system : LinearSystem

    Notes
    -----
    Their sum with a tilt is what levelling sees, so combinations become short. The prior of each is that of the IMU's
    axes where those are equal.
    """
    Q, names = np.eye(system.n), list(system.names)
    letters = system.axes.upper()
    for block, place in _triads(system, "xyz"):
        Q[np.ix_(place, place)] = system.to_imu
        for i, letter in zip(place, letters, strict=True):
            names[i] = f"{block}_{letter}"
    return system.transformed(Q, names)


def in_du_axes(system: LinearSystem) -> LinearSystem:
    """The system in east-north-up and right-forward-up axes, with biases of the sensor: Du's ``eps_E``, ``d_x``.

    Parameters
    ----------
    system : LinearSystem
        North-east-down, biases in the IMU's axes.

    Notes
    -----
    Attitude, velocity and position errors are estimate minus truth in both; only their axes change. Du's biases are
    measured minus true where ours are errors of the estimated biases: they are negated, so ``g eps_N - b_a_E`` here
    is ``g eps_N + b_E`` there. Other sensor states stay as they are and keep our names.

    References
    ----------
    Du (2015), sections 2.1, 2.5 and 5.2.
    """
    if system.axes != "ned" or any(name.endswith("_N") and name[:-2] in _BIASES for name in system.names):
        raise InputError("in_du_axes: expected a system in north-east-down with biases in the IMU's axes")
    Q, names = np.eye(system.n), list(system.names)
    order = list(range(system.n))
    for block, place in _triads(system, "NED"):
        Q[np.ix_(place, place)] = TO_DU
        for i, letter in zip(place, "ENU", strict=True):
            names[i] = f"{block}_{letter}"
    for block, place in _triads(system, "xyz"):
        Q[np.ix_(place, place)] = -TO_DU
        for i, letter in zip(place, "xyz", strict=True):
            names[i] = f"{_DU[block]}_{letter}"
    # his order: velocity, attitude, gyro biases, accelerometer biases
    rank = {"dr": 0, "dv": 1, "eps": 2, "d": 3, "b": 4}
    order.sort(key=lambda i: rank.get(names[i].rpartition("_")[0], 9))
    P = np.eye(system.n)[order]
    turned = system.transformed(P @ Q, [names[i] for i in order])
    return replace(turned, axes="enu", sign=1, to_imu=TO_DU @ system.to_imu @ TO_DU.T)


def _triads(system: LinearSystem, letters: str) -> list[tuple[str, list[int]]]:
    """Blocks with the three components given, and their places; of ``xyz`` only biases."""
    place = {name: i for i, name in enumerate(system.names)}
    triads = []
    for block in dict.fromkeys(name.rpartition("_")[0] for name in system.names):
        components = [f"{block}_{letter}" for letter in letters]
        is_bias = block in _BIASES or block in _DU.values()
        if all(w in place for w in components) and (is_bias if letters == "xyz" else block != ""):
            triads.append((block, [place[w] for w in components]))
    return triads
