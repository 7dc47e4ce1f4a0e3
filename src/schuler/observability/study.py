"""A whole look at one system: ranks, states seen and not seen, combinations, and how all of it grows with time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.observability.axes import in_du_axes, in_navigation_axes
from schuler.observability.combinations import Combination, seen, unseen
from schuler.observability.degree import Degree, degree_of_observability
from schuler.observability.ranks import Spectrum, spectrum
from schuler.observability.scenario import ObservabilityScenario, scenario_motion, scenario_system
from schuler.observability.system import LinearSystem
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import ResultTable
from schuler.simulation.motion import Motion, inertial_quantities

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Observability(Displayed):
    """What the measurements of a system tell about its errors.

    Attributes
    ----------
    system : LinearSystem
        Biases in the IMU's axes.
    spectrum : Spectrum
        Spectrum of all measurements, in those states.
    along : Spectrum
        The same with biases in navigation axes at the start, which the combinations are written in.
    degree : Degree
        Over time.
    constants : dict of str to float
        Values that factors of combinations are recognised as.
    """

    system: LinearSystem
    spectrum: Spectrum
    along: Spectrum
    degree: Degree
    constants: dict[str, float]

    def seen(self, which: str | None = None) -> list[Combination]:
        """Combinations that are determined; by default those known better than before."""
        return seen(self.along, self.constants, which=which or self._which)

    def unseen(self, which: str | None = None) -> list[Combination]:
        """Errors that leave no trace; by default none that is known better than before."""
        return unseen(self.along, self.constants, which=which or self._which)

    @property
    def _which(self) -> str:
        return "formal" if self.spectrum.formal == self.spectrum.useful else "useful"

    def table(self) -> ResultTable:
        """One row a state: seen by itself or not, and its 1-sigma at the end in units of the prior."""
        formal, useful = self.spectrum.observable("formal"), self.spectrum.observable("useful")
        rows = []
        for i, name in enumerate(self.system.names):
            word = "yes" if useful[i] else "weakly" if formal[i] else "no"
            rows.append((name, word, float(self.degree.ratio[-1, i]), float(self.degree.sigma[-1, i])))
        return ResultTable(
            f"{self.system.name}: states one by one",
            ("state", "seen", "sigma_of_prior", "sigma_SI"),
            tuple(rows),
            ("seen: yes, known better than before; weakly, formally; no, only in combinations",),
        )

    def ranks(self) -> ResultTable:
        """Ranks by three rules and the singular values."""
        spectrum = self.spectrum
        return ResultTable(
            f"{self.system.name}: ranks of {self.system.n} states",
            ("rule", "rank"),
            (
                ("formal: above rounding and discretisation", spectrum.formal),
                ("of the Gramian in double precision", spectrum.rank),
                ("useful: known better than before", spectrum.useful),
            ),
            ("singular values in units of the prior: " + ", ".join(f"{v:.2g}" for v in spectrum.values),),
        )

    def summary(self) -> str:
        """Everything in words."""
        lines = [self.ranks().summary(), "", self.table().summary(), "", "Determined:"]
        lines += [f"  {c.text}" for c in self.seen()]
        hidden = self.unseen()
        lines += ["Not determined:", *(f"  {c.text}" for c in hidden)] if hidden else ["Everything is determined."]
        if self._which == "useful":
            lines.append("Combinations leave out what is seen only weakly; parts below a hundredth of a prior are cut.")
        lines += [f"Note: {note}" for note in self.system.notes]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        s, d = self.spectrum, self.degree
        names = self.along.names
        return {
            "name": self.system.name, "states": list(self.system.names), "axes": self.system.axes,
            "rank_formal": s.formal, "rank": s.rank, "rank_useful": s.useful,
            "singular_values": s.values.tolist(), "doubt": s.doubt, "prior": self.system.sigma.tolist(),
            "observable": [n for n, o in zip(s.names, s.observable(), strict=True) if o],
            "observable_useful": [n for n, o in zip(s.names, s.observable("useful"), strict=True) if o],
            "combinations": [
                {"text": c.text, "factors": _factors(c, names), "observable": determined}
                for determined, combinations in ((True, self.seen()), (False, self.unseen()))
                for c in combinations
            ],
            "degree": {n: float(d.ratio[-1, i]) for i, n in enumerate(d.names)},
            "seen": [{"text": c.text, "factors": _factors(c, names)} for c in self.seen()],
            "unseen": [{"text": c.text, "factors": _factors(c, names)} for c in self.unseen()],
            "t_s": d.t.tolist(),
            "sigma_of_prior": {n: d.ratio[:, i].tolist() for i, n in enumerate(d.names)},
        }  # fmt: skip

    def plot(self) -> Figure:
        """Heat map over time with the singular values (matplotlib)."""
        from schuler.observability.report import observability_figure
        from schuler.plotting.drawing import draw

        return draw(observability_figure(self))

    def report(self, path: Path | str) -> Path:
        """One self-contained HTML page."""
        from schuler.observability.report import observability_report

        return observability_report(self, path)


def _factors(c: Combination, names: tuple[str, ...]) -> dict[str, float]:
    return {names[i]: float(c.coefficients[i]) for i in np.flatnonzero(c.coefficients)}


def observability(
    system: LinearSystem, *, axes: str = "ned", constants: dict[str, float] | None = None, every_s: float = 1.0
) -> Observability:
    """Look at a system.

    Parameters
    ----------
    system : LinearSystem
        North-east-down, biases in the IMU's axes.
    axes : {"ned", "enu"}
        Axes, names and signs of the answer: ours, or Du's.
    constants : dict of str to float, optional
        Values that factors may be made of, such as ``g``.
    every_s : float
        Spacing of the history. [s]
    """
    if axes not in ("ned", "enu"):
        raise InputError(f"axes: expected 'ned' or 'enu', got {axes!r}")
    used = in_du_axes(system) if axes == "enu" else system
    begin, end = float(used.t[0]), float(used.t[-1])
    times = np.append(np.arange(begin + every_s, end - 1e-6, every_s), end)
    total = spectrum(used)
    along = spectrum(in_navigation_axes(used))
    return Observability(used, total, along, degree_of_observability(used, times), constants or {})


@explains_arguments
def scenario_observability(scenario: ObservabilityScenario | dict[str, Any] | Path | str) -> Observability:
    """Look at the filter of a scenario: an object, nested dictionaries, or the path of a TOML file."""
    if not isinstance(scenario, ObservabilityScenario):
        parse, load = ObservabilityScenario.parse, ObservabilityScenario.load
        scenario = parse(scenario) if isinstance(scenario, dict) else load(scenario)
    _, imu, schedule = scenario_motion(scenario)
    rate = None
    if schedule is not None:
        speed = np.linalg.norm(schedule.omega_bs_s(np.linspace(0.0, imu.duration, 101)), axis=1)
        # a rate only names factors where it is one number
        rate = float(speed[0]) if np.ptp(speed) < 1e-9 and speed[0] > 0.0 else None
    return observability(
        scenario_system(scenario), axes=scenario.axes, every_s=scenario.every_s,
        constants=named_constants(imu, rate=rate, earth_rotation=scenario.motion.earth_rotation),
    )  # fmt: skip


def named_constants(motion: Motion, *, rate: float | None = None, earth_rotation: bool = True) -> dict[str, float]:
    """Constants of the start of a motion that factors are recognised as.

    Parameters
    ----------
    motion : Motion
    rate : float, optional
        Rate of the platform, called ``w``. [rad/s]
    earth_rotation : bool
        Whether Earth rate ``W`` times sine and cosine of the latitude are among them.

    Returns
    -------
    dict of str to float
        ``g`` (size of the specific force at the start) and so on. SI
    """
    state = motion.state(np.zeros(1))
    _, f = inertial_quantities(state, earth_rotation=earth_rotation)
    constants = {"g": float(np.linalg.norm(f[0]))}
    if rate is not None:
        constants["w"] = rate
    if earth_rotation:
        lat: FloatArray = state.llh[0, 0]
        constants["W cos(lat)"] = float(abs(WGS84.omega_ie * np.cos(lat)))
        constants["W sin(lat)"] = float(abs(WGS84.omega_ie * np.sin(lat)))
    return constants
