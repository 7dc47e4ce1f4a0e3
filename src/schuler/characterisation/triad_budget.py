"""One budget of an IMU from the mean Allan variance of the axes of each triad."""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler.characterisation.fitting import Moments, NoFitError, Weights
from schuler.characterisation.result import AXES, AxisNoise
from schuler.characterisation.selection import select
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import G0

_FIELDS = {
    "Q": "quantisation", "N": "random_walk", "B": "bias_instability", "K": "rate_random_walk", "R": "rate_ramp",
    "sigma_1": "in_run_bias", "tau_1": "in_run_time",
}  # fmt: skip
#: What a TriadSpec can hold: at most one Gauss-Markov process.
_BUDGET_MODELS = ("N", "N+B", "N+K", "N+GM", "N+B+K", "N+K+GM", "N+B+GM")


def triad_budget(
    name: str, found: dict[str, AxisNoise], data: dict[str, Moments], rate_hz: float, method: Literal["gmwm", "allan"]
) -> tuple[ImuSpec | None, dict[str, dict[str, float]]]:
    """One triad budget from the mean Allan variance of its axes."""
    triads: dict[str, TriadSpec] = {}
    spread: dict[str, dict[str, float]] = {}
    for triad in ("gyro", "accel"):
        axes = [a for a in AXES if a.startswith(triad) and a in found]
        if not axes:
            return None, {}
        parts = [data[a] for a in axes]
        k = min(len(p.m) for p in parts)
        mean = Moments(
            parts[0].m[:k],
            np.mean([p.variance[:k] for p in parts], axis=0),
            parts[0].dt,
            np.concatenate([p.lengths for p in parts]),
        )
        weights: Weights = "full" if method == "gmwm" else "diagonal"
        try:
            chosen = select(mean, None, weights, default=_BUDGET_MODELS, probes=_BUDGET_MODELS)
        except NoFitError:
            return None, {}
        fit = chosen.fit
        means = np.array([found[a].mean.value for a in axes])
        if triad == "gyro":
            bias = float(np.sqrt(np.mean(means**2)))
        else:
            bias = abs(float(np.linalg.norm(means)) - G0) if len(axes) == 3 else 0.0
        kept = [i for i, n in enumerate(fit.names) if n in _FIELDS and not (n == "Q" and chosen.shortest > 1)]
        fields = {_FIELDS[fit.names[i]]: float(fit.values[i]) for i in kept}
        triads[triad] = TriadSpec(**fields, turn_on_bias=bias)
        spread[triad] = {_FIELDS[fit.names[i]]: float(fit.sigma[i]) for i in kept}
    spec = ImuSpec(name, triads["gyro"], triads["accel"], rate_hz=rate_hz, source="identified by schuler")
    return spec, spread
