"""The filter that a configuration describes, with every number that an exported one needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.exceptions import ConfigError
from schuler.filtering.engine import FilterOptions, FilterState
from schuler.filtering.measurements import gate_threshold
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun

#: Aids of a configuration that are not exported.
LEFT_OUT = ("zero_rate", "gravity", "earth_rate", "heading", "barometer", "fixes")
#: State blocks that nothing exported would measure.
_UNSEEN = ("clock", "clock_drift", "clock_2", "clock_3", "clock_4", "b_heading", "baro")

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class FilterDesign:
    """A filter: states, noise, rates, and the constants of its aids; an aid that is None is not used.

    Attributes
    ----------
    state : FilterState
        As the kernels are given it: model and settings.
    interval_s : float
        Nominal sample interval of the IMU. [s]
    max_gap_s : float
        Longest step from sample to sample. [s]
    lever_antenna : tuple of float, optional
        From the IMU to the antenna, body axes. [m]
    uses_velocity : bool
        Velocities of GNSS too.
    gate_fix, gate_zupt, gate_non_holonomic, gate_odometer : float
        Largest accepted normalised innovation squared; inf accepts all.
    zupt_sigma : float, optional
        1-sigma of what may still move at rest. [m/s]
    lever_axle : tuple of float, optional
        From the IMU to the point that does not slip. [m]
    lateral_sigma, vertical_sigma, min_speed : float
        Of wheels that do not slip. [m/s]
    lever_wheel : tuple of float, optional
        From the IMU to the odometer's wheel. [m]
    """

    state: FilterState
    interval_s: float
    max_gap_s: float
    lever_antenna: Triple | None = None
    uses_velocity: bool = True
    gate_fix: float = np.inf
    zupt_sigma: float | None = None
    gate_zupt: float = np.inf
    lever_axle: Triple | None = None
    lateral_sigma: float = 1.0
    vertical_sigma: float = 1.0
    min_speed: float = 0.0
    gate_non_holonomic: float = np.inf
    lever_wheel: Triple | None = None
    gate_odometer: float = np.inf

    @property
    def layout(self) -> StateLayout:
        """States of the filter."""
        return self.state.layout

    @property
    def options(self) -> FilterOptions:
        """Options of the filter; its increments are taken as they are, however long their interval."""
        return self.state.options


def filter_design(config: NavigationConfig, prepared: PreparedRun) -> FilterDesign:
    """The filter of a configuration for the IMU of a run.

    Parameters
    ----------
    config : NavigationConfig
    prepared : PreparedRun
        Run of that configuration: its sample interval, states, noise and start.

    Raises
    ------
    ConfigError
        If the configuration uses what is not exported; all of it is named.
    """
    check_exported(config, prepared.layout)
    aiding, gnss = config.aiding, config.gnss
    interval = float(np.median(prepared.increments.dt))
    state = FilterState(prepared.initial, prepared.layout, *prepared.psd, prepared.options, interval)
    zupt, slip, wheel = aiding.zero_velocity, aiding.non_holonomic, aiding.odometer
    design = FilterDesign(
        state=state,
        interval_s=interval,
        max_gap_s=max(config.imu.max_gap_s, 2.0 * interval),
        lever_antenna=gnss.lever_arm_m if gnss.coupling == "loose" else None,
        uses_velocity=gnss.velocity,
        gate_fix=_threshold(gnss.gate, 3),
    )
    entries: dict[str, object] = {}
    if zupt is not None:
        entries |= {"zupt_sigma": zupt.sigma_m_s, "gate_zupt": _threshold(zupt.gate, 3)}
    if slip is not None:
        entries |= {
            "lever_axle": slip.lever_m, "lateral_sigma": slip.lateral_sigma_m_s,
            "vertical_sigma": slip.vertical_sigma_m_s, "min_speed": slip.min_speed_m_s,
            "gate_non_holonomic": _threshold(slip.gate, 1),
        }  # fmt: skip
    if wheel is not None:
        entries |= {"lever_wheel": wheel.lever_m, "gate_odometer": _threshold(wheel.gate, 1)}
    return FilterDesign(**{**vars(design), **entries})


def check_exported(config: NavigationConfig, layout: StateLayout | None = None) -> None:
    """Raise ConfigError if a configuration, or a layout that it led to, has what is not exported.

    Parameters
    ----------
    config : NavigationConfig
    layout : StateLayout, optional
    """
    wrong = []
    if config.gnss.coupling not in ("loose", "off"):
        wrong.append(f'gnss.coupling = "{config.gnss.coupling}" (loose and off are)')
    wrong += [f"aiding.{name}" for name in LEFT_OUT if getattr(config.aiding, name) is not None]
    wrong += [f"the state block {name}" for name in _UNSEEN if layout is not None and name in layout]
    wheels = config.aiding.non_holonomic
    if wheels is not None and wheels.unaided_factor != 1.0:
        wrong.append("aiding.non_holonomic.unaided_factor")
    if config.filter.tune is True:
        wrong.append("filter.tune = true (run schuler tune, which writes the noise into the configuration)")
    if wrong:
        raise ConfigError(
            "the exported filter has GNSS solutions, zero velocity, wheels that do not slip and an odometer; it does "
            f"not have {', '.join(wrong)}: leave it out of the configuration (--set, --without), or run schuler itself"
        )


def _threshold(gate: float | str, dimension: int) -> float:
    return gate_threshold(None if isinstance(gate, str) else gate, dimension)
