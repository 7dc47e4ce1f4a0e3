"""Errors of the position and attitude with which navigation begins."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3, readonly
from schuler.earth import WGS84, Ellipsoid
from schuler.exceptions import InputError
from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class InitialErrors(Abridged):
    """Estimate minus truth of the first position and attitude.

    Attributes
    ----------
    dr_n : ndarray, shape (3,)
        Position, north, east, down. [m]
    drpy : ndarray, shape (3,)
        Roll, pitch, yaw; yaw from north towards east. [rad]

    Notes
    -----
    Flenniken's errors have the other sign, actual = assumed + error, and other axes: see :meth:`from_flenniken`. His
    Table 6.2 prints degrees for positions and metres for angles, and (6.17), (6.18) exchange east and up, since body y
    is up and z is east: ``rho_U = i_yy``, ``rho_E = i_zz``. The signs of the projections (6.19)-(6.21) hang on a
    figure; here his angles turn as his rotations (5.34)-(5.36) do, right-handed about forward, up and right.

    References
    ----------
    Flenniken (2005), eqs. (6.16)-(6.23).
    """

    dr_n: FloatArray = field(default_factory=lambda: np.zeros(3))
    drpy: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("dr_n", "drpy"):
            object.__setattr__(self, name, readonly(as_vector3(getattr(self, name), name).copy()))

    @classmethod
    def draw(cls, rng: np.random.Generator, position_sigma: ArrayLike, attitude_sigma: ArrayLike) -> InitialErrors:
        """Independent normal errors.

        Parameters
        ----------
        rng : numpy.random.Generator
            Six numbers are drawn whatever the deviations.
        position_sigma, attitude_sigma : array_like, shape () or (3,)
            Standard deviations of ``dr_n`` [m] and ``drpy`` [rad].

        Returns
        -------
        InitialErrors

        Raises
        ------
        InputError
            If a deviation is negative or has another shape.
        """
        z = rng.standard_normal((2, 3))
        return cls(_sigma(position_sigma, "position_sigma") * z[0], _sigma(attitude_sigma, "attitude_sigma") * z[1])

    @classmethod
    def from_flenniken(cls, rho_neu: ArrayLike, attitude: ArrayLike) -> InitialErrors:
        """From errors as in the thesis.

        Parameters
        ----------
        rho_neu : array_like, shape (3,)
            North, east, up; actual = assumed + rho. [m]
        attitude : array_like, shape (3,)
            Roll, pitch, yaw; actual = assumed + error, yaw from north towards west. [rad]

        Raises
        ------
        InputError
            If a shape is not (3,).
        """
        north, east, up = as_vector3(rho_neu, "rho_neu")
        roll, pitch, yaw = as_vector3(attitude, "attitude")
        return cls(np.array([-north, -east, up]), np.array([-roll, -pitch, yaw]))

    def apply(self, llh: ArrayLike, rpy_nb: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> tuple[FloatArray, FloatArray]:
        """Position and attitude that navigation begins with.

        Parameters
        ----------
        llh : array_like, shape (3,)
            True latitude, longitude [rad], height [m].
        rpy_nb : array_like, shape (3,)
            True roll, pitch, yaw. [rad]
        ellipsoid : Ellipsoid

        Returns
        -------
        llh, rpy_nb : ndarray, shape (3,)
            With the errors: the position along straight axes at the true one, the angles as a sum, as in (6.23).

        Raises
        ------
        InputError
            If a shape is not (3,).
        """
        llh = as_vector3(llh, "llh")
        r_eb_e = ecef_from_llh(llh, ellipsoid) + C_en(llh) @ self.dr_n
        return llh_from_ecef(r_eb_e, ellipsoid), as_vector3(rpy_nb, "rpy_nb") + self.drpy


def _sigma(value: ArrayLike, name: str) -> FloatArray:
    sigma = as_floats(value, name)
    if sigma.shape not in ((), (3,)) or (sigma < 0.0).any():
        raise InputError(f"{name}: expected one or three standard deviations, not negative, got {value!r}")
    return sigma
