"""Multi-position calibration: many static poses, of which only the magnitude of the reference is known.

No fixture, table or level is needed for the accelerometers. Gyroscopes take Earth rate, which tells little but the bias
of good sensors, or a single-axis table turning both ways (Syed).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.bench.gauss_helmert import Start
from schuler.calibration.bench.halves import halved
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.sensor_geometry import ANGLES, PARAMETERS, triad_parameters
from schuler.calibration.bench.triad import TriadCalibration, calibrate_triad, to_model, triad_names
from schuler.calibration.bench.triad_pair import with_turn
from schuler.calibration.magnetometer.calibrate import estimates_soft_iron, with_poses
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.files import package_version
from schuler.sensors.spec import ImuSpec

GyroOrder: TypeAlias = Literal[0, 3, 6, 9, "auto"]

#: Said of every result with gyroscopes that has no rotation between the triads.
OWN_AXES = (
    "gyroscopes: magnitudes tell nothing on the rotation between the triads; M_g is in the gyroscopes' own axes (x "
    "along the x gyroscope, y in the plane of x and y), which differ from the accelerometers' by three small unknown "
    "angles"
)


@explains_arguments
def calibrate_multiposition(
    poses: Poses,
    *,
    gravity: float,
    latitude: float | None = None,
    table_rate: ArrayLike | None = None,
    accel_order: Literal[0, 3, 6, 9] = 9,
    gyro_order: GyroOrder = "auto",
    prior_spec: ImuSpec | None = None,
    use_prior: bool = False,
    fixed: CalibrationResult | Mapping[str, float] | None = None,
    between_triads: bool = False,
    start: Start = "continuation",
    halves: bool = True,
    field_strength: float | None = None,
    soft_iron: bool | None = None,
) -> CalibrationResult:
    """Bias, scale factors and non-orthogonality of both triads from magnitudes.

    Parameters
    ----------
    poses : Poses
        Means at rest, or, where ``table_rate`` says so, over whole turns of a table. Weights come from ``sigma_f`` and
        ``sigma_omega``: give :func:`schuler.calibration.bench.poses.poses_of` the noise of the sensor.
    gravity : float
        Local gravity. [m/s^2]
    latitude : float, optional
        Needed with ``table_rate`` and ``between_triads``. [rad]
    table_rate : array_like, shape () or (n,), optional
        Rate of the table about its vertical axis, positive counter-clockwise seen from above; zero for poses at rest.
        The reference is then ``|table_rate + omega_ie sin(latitude)|``. Turn both ways in each pose. For an axis that
        is not vertical, add Earth rate along it yourself and give latitude = 0. None: the reference is Earth rate.
        [rad/s]
    accel_order, gyro_order : {9, 6, 3, 0, "auto"}
        Biases, scale factors, angles; biases, scale factors; biases; nothing. Auto: as many as the readings justify.
    prior_spec : ImuSpec, optional
        Data sheet. Scale factors and angles of the gyroscopes that came out less certain than on it are handed back to
        it: value zero within its 1 sigma, and a verdict says so.
    use_prior : bool
        Add the data sheet as a prior of everything that is estimated.
    fixed : CalibrationResult or mapping of str to float, optional
        Held parameters. An earlier calibration gives its non-orthogonality, which ages least: then 6 parameters need 6
        poses. Or by name: ``theta_a_yz``, ``theta_g_zx``, ``s_a_x``, ``b_g_z``; with accel_order = 6 for instance.
    between_triads : bool
        Estimate the rotation between the triads as well, from ``f . omega = g omega_ie sin(latitude)`` at rest; all of
        M_g is then in the accelerometers' axes. Worth it for gyroscopes that see Earth rate to 1e-4. Needs latitude.
    start : {"continuation", "ellipsoid", "zeros"}
        See :func:`schuler.calibration.bench.gauss_helmert.adjust`.
    halves : bool
        Hold the claims against halves of the poses, see :mod:`schuler.calibration.bench.halves`.
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]
    soft_iron : bool, optional
        Estimate the soft iron of a magnetometer. None: with nine poses or more.

    Returns
    -------
    CalibrationResult
        Gauge "lower", M from ``I + M = diag(1 + s) T``; covariance carried over by the exact derivative. It is
        multiplied with the variance of unit weight if that is larger than noise explains (1 % test). Refused if a
        parameter that was asked for is not determined. ``extra["accel"]``, ``extra["gyro"]``: the estimates as
        (b, s, theta), and the tests of model order.

    Raises
    ------
    InputError
        If there are no poses, gravity is not plausible, both triads are left out, ``prior_spec`` is missing for
        ``use_prior``, or a name in ``fixed`` is unknown.

    Notes
    -----
    The poses that turn with a table are left out for the accelerometers if enough others exist.

    A body at rest on the Earth: gyroscopes of tactical grade see 7e-5 rad/s with an uncertainty of some 1e-6 rad/s, so
    a scale factor comes out to 2 % and says nothing. Where noise buries even Earth rate the bias is the mean reading.

    References
    ----------
    Hayal (2010), chapter 3; Shin and El-Sheimy (2002); Syed et al. (2007) for the table.
    """
    n = len(poses)
    if n == 0:
        raise InputError("poses: expected some, got none; put the unit down for some seconds in each pose")
    _check_arguments(gravity, latitude, accel_order, gyro_order, prior_spec, use_prior, between_triads)
    rate = None if table_rate is None else np.broadcast_to(as_floats(table_rate, "table_rate"), (n,))
    rho = _gyro_reference(n, latitude, rate)
    held = _held(fixed)
    at_rest = np.ones(n, dtype=bool) if rate is None else rate == 0.0
    if at_rest.sum() < max(accel_order, 1):
        at_rest = np.ones(n, dtype=bool)
    labels = [f"pose {i + 1} ({poses.start[i]:.1f}..{poses.stop[i]:.1f} s)" for i in range(n)]
    triads: dict[str, TriadCalibration] = {}
    if accel_order:
        k = np.flatnonzero(at_rest)
        triads["accel"] = calibrate_triad(
            "a", poses.f[k], poses.sigma_f[k], np.full(len(k), gravity), [labels[i] for i in k], "m/s^2", accel_order,
            spec=prior_spec.accel if prior_spec else None, use_prior=use_prior, fixed=held["a"], start=start,
        )  # fmt: skip
    if gyro_order:
        triads["gyro"] = calibrate_triad(
            "g", poses.omega, poses.sigma_omega, rho, labels, "rad/s", gyro_order,
            spec=prior_spec.gyro if prior_spec else None, use_prior=use_prior, fixed=held["g"], start=start,
        )  # fmt: skip
    result = _together(triads)
    if between_triads and latitude is not None:
        still = at_rest if rate is None else rate == 0.0
        up = WGS84.omega_ie * np.sin(latitude)
        result = with_turn(result, triads["accel"], triads["gyro"], poses, gravity, rho, up, at_rest, still)
    elif "gyro" in triads and triads["gyro"].adjustment is not None:
        result = replace(result, verdicts=(*result.verdicts, OWN_AXES))
    options = {
        "gravity": gravity, "latitude": latitude, "table_rate": None if rate is None else rate.tolist(),
        "accel_order": accel_order, "gyro_order": gyro_order, "use_prior": use_prior,
        "between_triads": between_triads, "start": start, "fixed": held,
        "prior_spec": prior_spec.to_dict() if prior_spec else None, "poses": n,
    }  # fmt: skip
    result = replace(
        result,
        temperature=None if poses.temperature is None else float(poses.temperature.mean()),
        provenance={"schuler": package_version(), "method": "multiposition", "options": options},
    )
    result = with_poses(result, poses, field_strength, soft_iron)
    if not halves:
        return result

    def part(some: Poses, k: IntArray) -> CalibrationResult:
        return calibrate_multiposition(
            some, gravity=gravity, latitude=latitude, table_rate=None if rate is None else rate[k],
            accel_order=accel_order, gyro_order=gyro_order, prior_spec=prior_spec, use_prior=use_prior, fixed=fixed,
            between_triads=between_triads, start=start, halves=False,
            field_strength=field_strength, soft_iron=estimates_soft_iron(result),
        )  # fmt: skip

    return halved(result, poses, part)


def _check_arguments(
    gravity: float, latitude: float | None, accel_order: int, gyro_order: GyroOrder, prior_spec: ImuSpec | None,
    use_prior: bool, between_triads: bool,
) -> None:  # fmt: skip
    if not 9.0 < gravity < 10.5:
        raise InputError(f"gravity: expected local gravity in m/s^2, such as 9.81, got {gravity!r}")
    if accel_order not in (0, 3, 6, 9) or gyro_order not in (0, 3, 6, 9, "auto") or accel_order == gyro_order == 0:
        raise InputError(
            f"accel_order, gyro_order: expected 9, 6, 3 or 0, not both 0, or gyro_order = 'auto', got {accel_order!r}, "
            f"{gyro_order!r}"
        )
    if use_prior and prior_spec is None:
        raise InputError("use_prior: expected a data sheet in prior_spec, got None")
    if between_triads and (latitude is None or not (accel_order and gyro_order)):
        raise InputError(
            f"between_triads: expected a latitude and both triads, got latitude = {latitude!r}, accel_order = "
            f"{accel_order}, gyro_order = {gyro_order!r}"
        )


def _gyro_reference(n: int, latitude: float | None, rate: FloatArray | None) -> FloatArray:
    if rate is None:
        return np.full(n, WGS84.omega_ie)
    if latitude is None or not abs(latitude) <= 0.5 * np.pi:
        raise InputError(
            f"latitude: expected radians, because Earth rate adds to the table's, got {latitude!r}; an error of "
            "7e-5 rad/s sin(latitude) would go into the scale factors"
        )
    return np.where(rate == 0.0, WGS84.omega_ie, np.abs(rate + WGS84.omega_ie * np.sin(latitude)))


def _held(fixed: CalibrationResult | Mapping[str, float] | None) -> dict[str, dict[str, float]]:
    """Held parameters of each triad, by the names of PARAMETERS."""
    held: dict[str, dict[str, float]] = {"a": {}, "g": {}}
    if fixed is None:
        return held
    if isinstance(fixed, CalibrationResult):
        calibrated = fixed if fixed.gauge == "lower" else fixed.in_gauge("lower")
        for which, M in (("a", calibrated.errors.M_a), ("g", calibrated.errors.M_g)):
            own = [name for name in calibrated.names if name.startswith(f"M_{which}")]
            # only what it estimated; not M_g of methods that relate the gyroscopes to the accelerometers
            if not any(name[-1] != name[-2] for name in own) or np.triu(M, 1).any():
                continue
            if not np.isfinite([calibrated[name][1] for name in own]).all():
                raise InputError("fixed: expected a calibration with all of M determined, got infinite variances")
            theta = triad_parameters(np.eye(3) + M)[1]
            held[which] = {f"theta_{a}": float(t) for a, t in zip(ANGLES, theta, strict=True)}
        return held
    for name, value in fixed.items():
        family, _, rest = name.partition("_")
        which, _, axis = rest.partition("_")
        if which not in held or f"{family}_{axis}" not in PARAMETERS:
            raise InputError(f"fixed: expected names such as theta_a_yz, theta_g_zx, s_a_x, b_g_z, got {name!r}")
        held[which][f"{family}_{axis}"] = float(value)
    return held


def _together(triads: Mapping[str, TriadCalibration]) -> CalibrationResult:
    """Both triads in one result."""
    names: list[str] = []
    values: list[float] = []
    fixed: dict[str, float] = {}
    prior: dict[str, float] = {}
    blocks: list[FloatArray] = []
    residuals: dict[str, Residuals] = {}
    extra: dict[str, Any] = {}
    verdicts: list[str] = []
    statuses: list[str] = []
    chi_square, freedom, condition = 0.0, 0, 1.0
    for key, triad in triads.items():
        keep = ~triad.held
        names += [name for name, k in zip(triad.names, keep, strict=True) if k]
        values += triad.values[keep].tolist()
        fixed |= {name: float(v) + 0.0 for name, v, k in zip(triad.names, triad.values, keep, strict=True) if not k}
        prior |= triad.prior_sigma
        blocks.append(triad.covariance[np.ix_(keep, keep)])
        verdicts += triad.verdicts
        statuses.append(triad.status)
        extra[key] = triad.extra
        if triad.residuals is not None and triad.adjustment is not None:
            residuals[key] = triad.residuals
            chi_square, freedom = chi_square + triad.adjustment.chi_square, freedom + triad.adjustment.freedom
            condition = max(condition, triad.adjustment.condition)
    covariance = np.zeros((len(names), len(names)))
    i = 0
    for block in blocks:
        covariance[i : i + len(block), i : i + len(block)] = block
        i += len(block)
    status: Literal["ok", "warning", "refused"] = "ok"
    if "refused" in statuses:
        status = "refused"
    elif "warning" in statuses:
        status = "warning"
    return CalibrationResult(
        "multiposition", tuple(names), np.array(values), covariance, "lower", fixed, status=status,
        verdicts=tuple(verdicts), condition=condition,
        prior_sigma={k: v for k, v in prior.items() if k in names},
        variance_of_unit_weight=chi_square / freedom if freedom else float("nan"), freedom=freedom, residuals=residuals,
        next_pose="; ".join(t.next_pose for t in triads.values() if t.next_pose), history=_history(triads, names),
        extra=extra,
    )  # fmt: skip


def _history(triads: Mapping[str, TriadCalibration], names: list[str]) -> FloatArray | None:
    """Parameters by iteration; the triad that ended earlier stays where it was."""
    length = max((len(t.adjustment.history) for t in triads.values() if t.adjustment), default=0)
    if length == 0:
        return None
    columns = dict.fromkeys(names, np.zeros(length))
    for which, triad in zip("ag", (triads.get("accel"), triads.get("gyro")), strict=True):
        if triad is None:
            continue
        if triad.adjustment is None:
            rows = np.tile(triad.values, (length, 1))
        else:
            rows = np.array([to_model(x)[0] for x in triad.adjustment.history])
            rows = np.vstack((rows, np.tile(rows[-1], (length - len(rows), 1))))
        columns |= dict(zip(triad_names(which), rows.T, strict=True))  # type: ignore[arg-type]
    return np.column_stack([columns[name] for name in names])
