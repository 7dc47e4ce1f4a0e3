"""Uncertainty of a calibration before it is made, and the pose that helps most next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.design.plans import ATTITUDES, design_matrix, unit_vectors, words_of
from schuler.calibration.result.parameters import AXES
from schuler.exceptions import InputError
from schuler.sensors.noise import noise_model
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import G0

Sensor: TypeAlias = Literal["accel", "gyro"]

_NULL = 1e-9  # share of a parameter in what a set of poses cannot see, from which it is undetermined


class NextPose(NamedTuple):
    """Where to put the unit next.

    Attributes
    ----------
    direction : ndarray, shape (3,)
        Up in body axes.
    words : str
        How to place it, and why.
    gain : float
        Worst relative uncertainty before over after; 1 is no gain.
    """

    direction: FloatArray
    words: str
    gain: float


def parameter_names(parameters: int = 9, sensor: Sensor = "accel") -> tuple[str, ...]:
    """Names in the order of :func:`~schuler.calibration.design.plans.design_matrix`, gauge "lower"; 12: with known
    attitude.

    Raises
    ------
    InputError
        If the number or the sensor is unknown.
    """
    if sensor not in ("accel", "gyro"):
        raise InputError(f"sensor: expected 'accel' or 'gyro', got {sensor!r}")
    a = sensor[0]
    b = tuple(f"b_{a}_{i}" for i in AXES)
    if parameters == 12:
        return b + tuple(f"M_{a}_{i}{j}" for i in AXES for j in AXES)
    if parameters not in (3, 6, 9):
        raise InputError(f"parameters: expected 3, 6, 9, or 12 for known attitudes, got {parameters!r}")
    return (b + tuple(f"M_{a}_{i}{i}" for i in AXES) + tuple(f"M_{a}_{i}" for i in ("yx", "zx", "zy")))[:parameters]


def sigma_of_mean(triad: TriadSpec, duration_s: ArrayLike) -> FloatArray:
    """Uncertainty of a mean over a dwell, as far as it changes from pose to pose.

    Parameters
    ----------
    triad : TriadSpec
    duration_s : array_like
        [s]

    Returns
    -------
    ndarray, shape of duration_s
        Allan deviation of the budget's N, B, K, R and in-run bias at that time. [x]

    Raises
    ------
    InputError
        If a duration is not positive.

    Notes
    -----
    Half the variance of the difference of two neighbouring means. What is common to all poses is the bias that the
    calibration finds, so the deviation from it counts, not the deviation from zero. Means of different poses are taken
    as independent; slower wander than the session makes the bias move and is not seen here.
    """
    T = np.asarray(duration_s, dtype=np.float64)
    if not (np.isfinite(T).all() and (T > 0.0).all()):
        raise InputError(f"duration_s: expected positive times, got {duration_s!r}")
    return np.asarray(np.sqrt(noise_model(triad).allan_variance(T)))


def predicted_sigma(
    directions: ArrayLike,
    spec: ImuSpec | TriadSpec,
    dwell_s: ArrayLike,
    parameters: int = 9,
    *,
    sensor: Sensor = "accel",
    reference: float = G0,
) -> dict[str, float]:
    """Standard deviation of each parameter that a set of poses will give.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Up in body axes (of the reference rate, for gyroscopes).
    spec : ImuSpec or TriadSpec
        Noise of the means, see :func:`sigma_of_mean`.
    dwell_s : array_like, shape () or (n,)
        [s]
    parameters : {3, 6, 9, 12}
        From the magnitude of the reference: 3 biases, 6 with scale factors, 9 with non-orthogonality (gauge "lower").
        12: the direction of the reference is known too (a table, a machined cube); gauge "full".
    sensor : {"accel", "gyro"}
    reference : float
        Magnitude of gravity [m/s^2], or of the rate that a table or the Earth gives [rad/s].

    Returns
    -------
    dict of str to float
        By name, SI; infinite for what the poses do not determine.

    Raises
    ------
    InputError
        If shapes disagree, a number is out of range or the budget has no noise.

    References
    ----------
    ``D{xi} = sigma_0^2 N^-1``, Hayal (2010), eqs. (3.32) to (3.37), with ``N = A^T A`` of nearly perfect sensors.
    """
    names = parameter_names(parameters, sensor)
    if not reference > 0.0:
        raise InputError(f"reference: expected a positive magnitude, got {reference}")
    u = unit_vectors(directions)
    triad = spec if isinstance(spec, TriadSpec) else getattr(spec, sensor)
    sigma = np.broadcast_to(sigma_of_mean(triad, dwell_s), (len(u),))
    if len(u) and not (sigma > 0.0).all():
        raise InputError("spec: expected some noise (N or B), got a perfect sensor, whose uncertainty is zero")
    if parameters == 12:
        A = np.concatenate((np.ones((len(u), 1)), u), axis=1)
        one = _sigmas(A / sigma[:, None])
        s = np.concatenate((np.repeat(one[0], 3), np.tile(one[1:], 3) / reference))
    else:
        s = _sigmas(design_matrix(u, parameters) / sigma[:, None])
        s[3:] /= reference
    return dict(zip(names, (float(v) for v in s), strict=True))


def prior_of(spec: ImuSpec | TriadSpec, parameters: int = 9, *, sensor: Sensor = "accel") -> dict[str, float]:
    """What a data sheet says about the parameters before any calibration, 1 sigma by name.

    Raises
    ------
    InputError
        If the budget leaves turn-on bias, scale factor or misalignment out; give the numbers yourself then.
    """
    triad = spec if isinstance(spec, TriadSpec) else getattr(spec, sensor)
    out = {}
    for name in parameter_names(parameters, sensor):
        value = (
            triad.turn_on_bias if name[0] == "b" else triad.scale_factor if name[-1] == name[-2] else triad.misalignment
        )
        if not value > 0.0:
            raise InputError(f"spec: expected turn_on_bias, scale_factor and misalignment, but {name} has no prior")
        out[name] = float(value)
    return out


def relative_uncertainty(
    directions: ArrayLike, sigma: ArrayLike, prior_sigma: Mapping[str, float], *, reference: float = G0
) -> dict[str, float]:
    """Share of what was unknown that still is: 1 is nothing learnt, 0 is found out.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Up in body axes of the poses so far; none are allowed, shape (0, 3).
    sigma : array_like, shape () or (n,)
        Uncertainty of the means along up. [m/s^2]
    prior_sigma : mapping of str to float
        1 sigma known before of three, six or nine parameters, see :func:`parameter_names` and :func:`prior_of`. SI.
    reference : float
        [m/s^2]

    Returns
    -------
    dict of str to float
        Standard deviation after over before, by name.

    Raises
    ------
    InputError
        If a sigma is not positive, or the names are not those of three, six or nine parameters.
    """
    names, scale = _prior(prior_sigma, reference)
    u = unit_vectors(directions)
    N = _information(u, _of_each(sigma, len(u)), scale)
    return dict(zip(names, (float(v) for v in np.sqrt(np.diag(np.linalg.inv(N)))), strict=True))


def next_pose(
    directions_so_far: ArrayLike,
    sigma: ArrayLike,
    prior_sigma: Mapping[str, float],
    *,
    candidates: ArrayLike | None = None,
    next_sigma: float | None = None,
    reference: float = G0,
) -> NextPose:
    """The pose that lowers the worst relative uncertainty most.

    Parameters
    ----------
    directions_so_far : array_like, shape (n, 3)
        Up in body axes; n may be zero.
    sigma : array_like, shape () or (n,)
        Uncertainty of the means along up. [m/s^2]
    prior_sigma : mapping of str to float
        See :func:`relative_uncertainty`.
    candidates : array_like, shape (k, 3), optional
        None: the 26 attitudes.
    next_sigma : float, optional
        Uncertainty of the mean in the next pose; None: the median of those so far. [m/s^2]
    reference : float
        [m/s^2]

    Returns
    -------
    NextPose
        ``(direction, words, gain)``. Among poses equally good for the worst parameter, the one with the least mean
        square of all; then the earlier candidate, so that faces go before edges and corners.

    Raises
    ------
    InputError
        As :func:`relative_uncertainty`; also if there is neither a pose with its sigma nor ``next_sigma``.

    Notes
    -----
    One pose ahead only. Information adds up: ``N + a a^T`` with the row ``a`` of
    :func:`~schuler.calibration.design.plans.design_matrix`, in units of what was known before.
    """
    names, scale = _prior(prior_sigma, reference)
    u = unit_vectors(directions_so_far)
    each = _of_each(sigma, len(u))
    if next_sigma is None:
        if np.ndim(sigma) and not len(each):
            raise InputError("next_sigma: expected one, since there is no pose yet to take it from")
        next_sigma = float(np.median(each)) if len(each) else float(np.asarray(sigma))
    if not next_sigma > 0.0:
        raise InputError(f"next_sigma: expected a positive number, got {next_sigma}")
    options = ATTITUDES if candidates is None else unit_vectors(candidates, "candidates")
    if not len(options):
        raise InputError("candidates: expected one pose or more, got none")
    C = np.linalg.inv(_information(u, each, scale))
    rows = design_matrix(options, len(names)) * scale / next_sigma
    # Sherman and Morrison, diagonal only: what each candidate leaves of every variance
    Ca = rows @ C
    left = np.sqrt(np.diag(C) - Ca**2 / (1.0 + np.sum(Ca * rows, axis=1))[:, None])
    keys = [(round(float(r.max()), 9), round(float(np.mean(r**2)), 9), k) for k, r in enumerate(left)]
    _, _, k = min(keys)
    before, after = np.sqrt(np.diag(C)), left[k]
    worst, still = int(np.argmax(before)), int(np.argmax(after))
    gain = float(before.max() / after.max())
    words = f"{words_of(options[k])}: "
    if gain < 1.0005:
        helped = int(np.argmin(after / before))
        words += (
            f"no single pose helps {names[worst]} ({before[worst]:.0%} of its uncertainty before is left); this one "
            f"helps {names[helped]} most, from {before[helped]:.0%} to {after[helped]:.0%}"
        )
    else:
        words += (
            f"the worst is {names[worst]}, of whose uncertainty before {before[worst]:.0%} is left; after this pose "
            f"the worst is {names[still]} with {after[still]:.0%}"
        )
    return NextPose(options[k].copy(), words, gain)


def _sigmas(A: FloatArray) -> FloatArray:
    """Standard deviations of a least-squares fit with unit weights; infinite where A does not determine them."""
    p = A.shape[1]
    if not len(A):
        return np.full(p, np.inf)
    _, s, Vt = np.linalg.svd(A / np.abs(A).max(), full_matrices=True)
    s = np.concatenate((s, np.zeros(p - len(s)))) if len(s) < p else s
    seen = s > _NULL * s[0]
    out = np.sqrt(np.sum((Vt[seen] / s[seen, None]) ** 2, axis=0)) / np.abs(A).max()
    return np.asarray(np.where(np.sum(Vt[~seen] ** 2, axis=0) > _NULL, np.inf, out))


def _prior(prior_sigma: Mapping[str, float], reference: float) -> tuple[tuple[str, ...], FloatArray]:
    """Names in order, and prior uncertainty in the unit of the magnitude. Shape (p,)."""
    sensor: Sensor = "gyro" if any(n[2:3] == "g" for n in prior_sigma) else "accel"
    for p in (9, 6, 3):
        names = parameter_names(p, sensor)
        if set(names) == set(prior_sigma):
            break
    else:
        raise InputError(
            f"prior_sigma: expected {', '.join(parameter_names(9, sensor))}, or the first 3 or 6 of them, "
            f"got {', '.join(prior_sigma) or 'none'}"
        )
    values = as_floats([prior_sigma[n] for n in names], "prior_sigma", (p,))
    if not (values > 0.0).all():
        raise InputError(f"prior_sigma: expected positive uncertainties, got {values.tolist()}")
    values[3:] *= reference
    return names, values


def _of_each(sigma: ArrayLike, n: int) -> FloatArray:
    value = as_floats(sigma, "sigma")
    if value.shape not in ((), (n,)):
        raise InputError(f"sigma: expected one number or one for each of {n} poses, got shape {value.shape}")
    if not (value > 0.0).all():
        raise InputError("sigma: expected positive uncertainties of the means")
    return np.broadcast_to(value, (n,))


def _information(u: FloatArray, sigma: FloatArray, scale: FloatArray) -> FloatArray:
    """Normal matrix in units of the prior, prior included. Shape (p, p)."""
    A = design_matrix(u, len(scale)) * scale / sigma[:, None]
    return np.asarray(A.T @ A + np.eye(len(scale)))
