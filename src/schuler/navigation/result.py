"""Result of a filter run: trajectory, covariance, parameters, innovations, provenance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.engine import ForwardRun, unpack_symmetric
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import SmootherNodes
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    ACCEPTED,
    ARC_START,
    DIMENSIONS,
    FORCED,
    GATED,
    KINDS,
    REJECTED,
    STATUS,
    UNUSED,
)
from schuler.filtering.node_parts import NodeParts
from schuler.filtering.states import BLOCK_TEXT, StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.navigation.inputs.imu_axes import claimed_attitude
from schuler.plotting.notebook import Displayed
from schuler.recording.trajectory import FullTrajectory, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.gnss.point_result import PointSolution
    from schuler.gnss.ranges import Ranges
    from schuler.navigation.evaluation.errors import TrajectoryErrors
    from schuler.verdict import Verdict


@dataclass(frozen=True, repr=False)
class Innovations(Displayed):
    """Innovations and outcomes of all measurements offered to the filter.

    Attributes
    ----------
    t : ndarray, shape (m,)
        [s]
    kind, status : ndarray of int, shape (m,)
        Keys of :data:`~schuler.filtering.measurements.KINDS` and ``STATUS``.
    nis : ndarray, shape (m,)
        Normalised innovation squared, with the degrees of freedom of :attr:`freedom`; NaN where unused.
    innovation, sigma : ndarray, shape (m, 3)
        Measured minus predicted, and its predicted 1-sigma: north, east, down for vectors, in the first column for
        single numbers. [unit of the measurement]
    """

    t: FloatArray
    kind: IntArray
    status: IntArray
    nis: FloatArray
    innovation: FloatArray
    sigma: FloatArray

    def __len__(self) -> int:
        return len(self.t)

    def _headline(self) -> str:
        return f"{len(self)} measurements" + "".join(f", {n} {sum(c.values())}" for n, c in self.counts().items())

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        rows = [(name, *(str(count[s]) for s in STATUS.values())) for name, count in self.counts().items()]
        return ("measurement", *STATUS.values()), rows

    @property
    def freedom(self) -> IntArray:
        """Components of each measurement. Shape (m,)."""
        table = np.zeros(max(DIMENSIONS) + 1, dtype=np.int64)
        for kind, size in DIMENSIONS.items():
            table[kind] = size
        return np.asarray(table[self.kind])

    def where(self, keep: ArrayLike) -> Innovations:
        """The entries selected by a boolean or index array."""
        k = np.asarray(keep)
        return Innovations(self.t[k], self.kind[k], self.status[k], self.nis[k], self.innovation[k], self.sigma[k])

    def of(self, kind: str) -> Innovations:
        """The entries of one kind, by name."""
        codes = [code for code, name in KINDS.items() if name == kind]
        if not codes:
            raise InputError(f"unknown measurement kind {kind!r}; known are {', '.join(KINDS.values())}")
        return self.where(self.kind == codes[0])

    def counts(self) -> dict[str, dict[str, int]]:
        """Number of measurements by kind and status, kinds that occur only."""
        return {
            name: {STATUS[s]: int(np.sum((self.kind == code) & (self.status == s))) for s in STATUS}
            for code, name in KINDS.items()
            if np.any(self.kind == code)
        }

    def rejected(self) -> dict[str, int]:
        """Number of rejected measurements by kind."""
        return {name: count[STATUS[REJECTED]] for name, count in self.counts().items()}

    def mean_nis(self) -> float:
        """Mean of the normalised innovations squared per degree of freedom, over what was used or gated."""
        tested = np.isfinite(self.nis)
        return float(self.nis[tested].sum() / self.freedom[tested].sum()) if tested.any() else float("nan")


@dataclass(frozen=True, repr=False)
class NavigationResult(Displayed):
    """A navigation solution with its uncertainty.

    Attributes
    ----------
    trajectory : FullTrajectory
        Position, velocity and attitude of the IMU; where no lever arm is known, position of the antenna (``point``).
    t : ndarray, shape (k,)
        Times of the records below. [s]
    states : FullTrajectory
        Navigation states at the records.
    parameters : ndarray, shape (k, m)
        Parameter estimates at the records, order of the layout.
    covariance_e : ndarray, shape (k, n, n)
        Covariance at the records, navigation errors in Earth-fixed axes. The attitude is claimed no better than
        ``axes_covariance_b`` allows; :meth:`filter_covariance_e` is without that.
    innovations : Innovations
    layout : StateLayout
    smoothed : bool
        Whether this is the smoothed solution.
    complete : bool
        False if the run was interrupted.
    outages : tuple of (start, stop)
        Windows in which GNSS was withheld. [s]
    lever_arm_b : ndarray, shape (3,)
        Lever arm from the IMU to the antenna. [m]
    provenance : dict
        Package version, options, input hashes.
    notes : tuple of str
        What was assumed, repaired or left out.
    axes_covariance_b : ndarray, shape (3, 3)
        Covariance of the rotation between body and sensors' axes that no state stands for, body axes, see
        :func:`~schuler.navigation.inputs.imu_axes.axes_covariance`. [rad^2]
    ranges : Ranges, optional
        Ranges of a tightly coupled run, with the reason of each that was not used. Not in files.
    points : PointSolution, optional
        Single-point solutions of a tightly coupled run. Not in files.
    """

    trajectory: FullTrajectory
    t: FloatArray
    states: FullTrajectory
    parameters: FloatArray
    covariance_e: FloatArray
    innovations: Innovations
    layout: StateLayout
    epochs: int
    propagations: int
    smoothed: bool = False
    complete: bool = True
    outages: tuple[tuple[float, float], ...] = ()
    lever_arm_b: FloatArray = field(default_factory=lambda: np.zeros(3))
    provenance: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    axes_covariance_b: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), repr=False)
    ranges: Ranges | None = field(default=None, repr=False, compare=False)
    points: PointSolution | None = field(default=None, repr=False, compare=False)
    _nodes: SmootherNodes | NodeParts | None = field(default=None, repr=False, compare=False)
    _attitude_e: FloatArray | None = field(default=None, repr=False, compare=False)  # the filter's, where claims differ

    @classmethod
    def from_run(
        cls, forward: ForwardRun, schedule_t: FloatArray, kinds: IntArray, layout: StateLayout, **rest: Any
    ) -> NavigationResult:
        """Result object of a forward run, without what satellites' channels need; ``rest`` are further fields."""
        rec, shown, given = forward.rec_nav, layout.visible, kinds != ARC_START
        n = shown.size
        with np.errstate(invalid="ignore"):  # of a covariance that broke down; the verdict says so
            sigma = np.sqrt(forward.variance)
        return cls(
            trajectory=FullTrajectory(forward.t, forward.r, forward.v, forward.q),
            t=forward.rec_t,
            states=FullTrajectory(forward.rec_t, rec[:, 7:10], rec[:, 4:7], rec[:, 0:4]),
            parameters=forward.rec_est[:, : n - 9],
            covariance_e=unpack_symmetric(forward.rec_P[:, : n * (n + 1) // 2], n),
            innovations=Innovations(schedule_t, kinds, forward.status, forward.nis, forward.innovation, sigma).where(
                given
            ),
            layout=shown,
            epochs=forward.epochs,
            propagations=forward.propagations,
            complete=forward.complete,
            _nodes=forward.nodes,
            **rest,
        )._claimed()

    def _claimed(self) -> NavigationResult:
        """The same, with the attitude claimed as its axes are known: ``covariance_e``, the filter's, is changed."""
        if not self.axes_covariance_b.any():
            return self
        P = self.covariance_e[:, :3, :3]
        own = P.copy()
        P[:] = claimed_attitude(own, rotation.dcm_from_quat(self.states.q_eb), self.axes_covariance_b)
        return replace(self, _attitude_e=own)

    def filter_covariance_e(self, records: ArrayLike | slice = slice(None)) -> FloatArray:
        """Covariance of filter or smoother alone at records: the attitude is that of the sensors' axes.

        What a run goes on with, and what a point of the body is known to that measurements place.

        Parameters
        ----------
        records : slice or array_like
            Index of the records; default all.

        Returns
        -------
        ndarray, shape (k, n, n)
            Navigation errors in Earth-fixed axes.
        """
        at: Any = records
        P: FloatArray = self.covariance_e[at]
        if self._attitude_e is not None:
            P = P.copy()
            P[..., :3, :3] = self._attitude_e[at]
        return P

    @property
    def covariance(self) -> FloatArray:
        """Covariance at the records with navigation errors in north-east-down axes. Shape (k, n, n)."""
        return self._in_ned(self.covariance_e)

    def _in_ned(self, P_e: FloatArray, records: slice = slice(None)) -> FloatArray:
        T = ecef_from_ned_states(self.states.llh[records], self.layout.size)
        rotated: FloatArray = np.swapaxes(T, -1, -2) @ P_e @ T
        return rotated

    def sigma(self, block: str) -> FloatArray:
        """1-sigma of a block at the records: ``dpsi``, ``dv``, ``dr`` in north-east-down axes, or a parameter block.

        Returns
        -------
        ndarray, shape (k, block size)
            [rad], [m/s], [m] or the unit of the parameter.
        """
        part = self.layout[block]
        if part.stop > 9:
            variance: FloatArray = np.einsum("kii->ki", self.covariance_e[:, part, part])
        else:
            C = frames.C_en(self.states.llh)
            variance = np.einsum("kji,kjl,kli->ki", C, self.covariance_e[:, part, part], C)
        with np.errstate(invalid="ignore"):  # of a covariance that broke down; the verdict says so
            return np.sqrt(variance)

    def parameter(self, block: str) -> FloatArray:
        """Estimates of a parameter block at the records. Shape (k, block size)."""
        part = self.layout[block]
        if part.stop <= 9:
            raise InputError(f"{block} is a navigation block; parameters are {', '.join(self.layout.models)}")
        return self.parameters[:, part.start - 9 : part.stop - 9]

    def state_at(self, record: int) -> InitialState:
        """Navigation state, the filter's covariance (north-east-down) and parameters of one record, to start from."""
        s, at = self.states, slice(record, record + 1 or None)
        nav = NavState(float(s.t[record]), s.r_eb_e[record], s.v_eb_e[record], s.q_eb[record])
        return InitialState(nav, self._in_ned(self.filter_covariance_e(at), at)[0], self.parameters[record])

    @property
    def can_smooth(self) -> bool:
        """Whether the run is complete, without resets, and kept the data for :meth:`smooth`."""
        return self.smoothed or self._nodes is not None

    def antenna(self) -> Trajectory:
        """Trajectory of the antenna instead of the IMU (position and attitude), with the lever arm as estimated."""
        arm = self.lever_arm_b
        if "lever" in self.layout:
            more = self.parameter("lever")
            arm = arm + np.column_stack([np.interp(self.trajectory.t, self.t, more[:, i]) for i in range(3)])
        return self.trajectory.moved_by(arm)

    @property
    def point(self) -> str:
        """Point of the vehicle that positions are of: ``imu``, or ``antenna`` where no lever arm is known."""
        return str(self.provenance.get("point", "imu"))

    @property
    def fixes_later_s(self) -> float:
        """Time by which GNSS fixes are later than their stamps, as estimated at the end; zero if it is not. [s]"""
        return float(self.parameter("delay")[-1, 0]) if "delay" in self.layout and len(self.t) else 0.0

    @property
    def fixes_moved_s(self) -> float:
        """The part of that by which their times were moved before the run: those of the innovations are. [s]"""
        return float(self.provenance.get("fixes_moved_s", 0.0))

    def smooth(self, *, keep: bool = True) -> NavigationResult:
        """The fixed-interval smoothed solution: every state uses all measurements, later ones too.

        Parameters
        ----------
        keep : bool
            False to forget in this result what only its smoother needs, a quarter of a long run's memory.

        Returns
        -------
        NavigationResult
            Same times, smaller uncertainty.

        Raises
        ------
        InputError
            If the run did not keep what the smoother needs (option ``smoother``), or was interrupted.

        References
        ----------
        Gelb (1974), section 5.2 (Rauch-Tung-Striebel); Bierman (1973) for the form without inverses.
        """
        if self.smoothed:
            return self
        if self._nodes is None:
            raise InputError(
                "this run kept nothing to smooth: navigate with smoother=True"
                if self.complete
                else "an interrupted run cannot be smoothed; navigate the shorter log instead"
            )
        from schuler.navigation.smoother import smooth_run

        trajectory, states, parameters, covariance_e = smooth_run(self, keep=keep)
        return replace(
            self, trajectory=trajectory, states=states, parameters=parameters, covariance_e=covariance_e,
            smoothed=True, _nodes=None, _attitude_e=None,
        )._claimed()  # fmt: skip

    def errors(self, reference: Trajectory, *, at_antenna: bool = False) -> TrajectoryErrors:
        """Errors against a reference, see :func:`schuler.navigation.evaluation.errors.trajectory_errors`.

        Parameters
        ----------
        reference : Trajectory
            Truth or a better solution.
        at_antenna : bool
            The reference is the antenna's, not the IMU's.
        """
        from schuler.navigation.evaluation.errors import trajectory_errors

        key = (id(reference), at_antenna)
        if key in self._errors:
            return self._errors[key][1]
        errors = trajectory_errors(self.antenna() if at_antenna else self.trajectory, reference)
        self._errors.clear()  # the last is asked for again: numbers first, then figures
        self._errors[key] = reference, errors
        return errors

    @cached_property
    def _errors(self) -> dict[tuple[int, bool], tuple[Trajectory, TrajectoryErrors]]:
        return {}  # with the reference itself: as long as it is held, its id is no other's

    def nees(self, reference: Trajectory, parameters: ArrayLike | None = None) -> FloatArray:
        """Normalised estimation error squared at the records, see
        :func:`schuler.navigation.evaluation.consistency.nees`.
        """
        from schuler.navigation.evaluation.consistency import nees

        return nees(self, reference, parameters)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the run can be believed, see :func:`schuler.navigation.evaluation.verdict.verdict`."""
        from schuler.navigation.evaluation.verdict import verdict

        return verdict(self)

    def _headline(self) -> str:
        T = self.trajectory
        span = f"{T.t[-1] - T.t[0]:.1f} s, " if len(T) else ""
        ended = "" if self.complete else ", INTERRUPTED"
        return (
            f"{'smoothed' if self.smoothed else 'filtered'} solution, {span}{self.epochs} IMU epochs, "
            f"{self.layout.size} states{ended}"
        )

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        if not len(self.t):
            return (), ()
        rows = []
        names = (("dr", "position", "m", 1.0), ("dv", "velocity", "m/s", 1.0), ("dpsi", "attitude", "deg", units.DEG))
        for block, name, unit, scale in names:
            sigma = self.sigma(block) / scale
            rows.append((f"{name}, 1-sigma [{unit}]", *(f"{v:.3g}" for v in (*sigma[-1], np.nanmax(sigma)))))
        for name, count in self.innovations.counts().items():
            used, rejected = count[STATUS[ACCEPTED]] + count[STATUS[FORCED]], count[STATUS[REJECTED]]
            rows.append((f"{name}: {used} used, {rejected} rejected", "", "", "", ""))
        rows.append((f"verdict: {self.verdict.status}", "", "", "", ""))
        return ("at the end", "north", "east", "down", "largest of the run"), rows

    def plot(self, **options: Any) -> Figure:
        """Overview figure (matplotlib), see :func:`schuler.navigation.report.figures.overview`."""
        from schuler.navigation.report.figures import overview

        return overview(self, **options)

    def report(self, path: Path | str, **options: Any) -> Path:
        """Write one self-contained HTML page, see :func:`schuler.navigation.report.document.navigation_report`."""
        from schuler.navigation.report.document import navigation_report

        return navigation_report(self, path, **options)

    def summary(self) -> str:
        """The run in a few lines of text."""
        sigma_r, sigma_psi = self.sigma("dr")[-1], self.sigma("dpsi")[-1] / units.DEG
        kind = "smoothed" if self.smoothed else "filtered"
        lines = [
            f"{kind} solution: {self.epochs} IMU epochs, {self.trajectory.t[0]:.3f}..{self.trajectory.t[-1]:.3f} s, "
            f"{self.layout.size} states ({', '.join(self.layout.blocks)})" + ("" if self.complete else "; INTERRUPTED"),
            f"  at the end, 1-sigma: position {sigma_r[0]:.3f} {sigma_r[1]:.3f} {sigma_r[2]:.3f} m (NED), "
            f"attitude {sigma_psi[0]:.4f} {sigma_psi[1]:.4f} {sigma_psi[2]:.4f} deg (NED)",
        ]
        for name, count in self.innovations.counts().items():
            forced = count[STATUS[FORCED]]
            lines.append(
                f"  {name}: {count[STATUS[ACCEPTED]] + forced} used, {count[STATUS[REJECTED]]} rejected, "
                f"{count[STATUS[UNUSED]]} unused"
                + (f", {count[STATUS[GATED]]} without their condition" if count[STATUS[GATED]] else "")
                + (f", {forced} after lock-out" if forced else "")
            )
        if len(self.innovations):
            lines.append(
                f"  mean normalised innovation squared per degree of freedom: {self.innovations.mean_nis():.3f}"
            )
        for block in self.layout.models:
            value, spread = self.parameter(block)[-1], self.sigma(block)[-1]
            text = "  ".join(f"{v:+.3e} +- {s:.1e}" for v, s in zip(value, spread, strict=True))
            lines.append(f"  {block} [{BLOCK_TEXT[block][1]}]: {text}")
        lines += [f"  - {note}" for note in self.notes]
        return "\n".join(lines)

    def to_parquet(self, path: Path | str) -> Path:
        """Write the solution: trajectory with sigmas interpolated to it, covariance records and provenance.

        Parameters
        ----------
        path : Path or str
            One Parquet file; columns carry SI units in their names. Read back with any Parquet reader or
            :func:`schuler.navigation.solution_tables.read_solution`.
        """
        from schuler.navigation.solution_tables import write_solution

        return write_solution(self, path)
