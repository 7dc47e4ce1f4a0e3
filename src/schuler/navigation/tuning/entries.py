"""Tuned noise as entries of a configuration."""

from __future__ import annotations

from typing import Any

from schuler.navigation.config import NavigationConfig
from schuler.navigation.tuning.noise import by_axis
from schuler.navigation.tuning.tuning import TERM_TEXT, Tuning
from schuler.toml import merged


def tuned_configuration(config: NavigationConfig, tuning: Tuning) -> NavigationConfig:
    """The configuration with tuned noise in it, and nothing left to tune; unchanged noise if that was no better."""
    data = config.model_dump(mode="json", exclude_unset=True)
    return NavigationConfig.parse(merged(data, tuned_entries(config, tuning)))


def tuned_entries(config: NavigationConfig, tuning: Tuning) -> dict[str, Any]:
    """Entries of the configuration that tuning changes, as nested dictionaries."""
    new: dict[str, Any] = {"filter": {"tune": False}}
    if not tuning.better:
        return new
    factor = tuning.factors
    noise = config.filter.noise
    if "gyro" in factor or "accel" in factor:
        new["filter"]["noise"] = {}
    if "gyro" in factor:
        new["filter"]["noise"]["gyro"] = _rounded(noise.gyro * factor["gyro"])
    if "accel" in factor:
        by = by_axis(factor, tuning.vertical)
        new["filter"]["noise"]["accel"] = [_rounded(float(a * b)) for a, b in zip(noise.accel_axes, by, strict=True)]
    if tuning.models:
        new["filter"]["models"] = tuning.models
    gnss: dict[str, Any] = {}
    for entry, least, across, down in (
        ("position_sigma_scale", "position_sigma_floor_m", "position", "height"),
        ("velocity_sigma_scale", "velocity_sigma_floor_m_s", "velocity", "climb"),
    ):
        if across in factor or down in factor:
            old = getattr(config.gnss, entry)
            by = (factor.get(across, 1.0), factor.get(across, 1.0), factor.get(down, 1.0))
            gnss[entry] = [_rounded(a * b) for a, b in zip(old, by, strict=True)]
            floor = getattr(config.gnss, least)
            if any(floor):
                gnss[least] = [_rounded(a * b) for a, b in zip(floor, by, strict=True)]
    tight = {
        entry: _rounded(getattr(config.gnss.tight, entry) * factor[name])
        for entry, name in (("range_sigma_scale", "pseudorange"), ("rate_sigma_scale", "range_rate"))
        if name in factor
    }
    if tight:
        gnss["tight"] = tight
    if tuning.slow:
        gnss["correlated"] = tuning.slow
    if gnss:
        new["gnss"] = gnss
    wheels = config.aiding.non_holonomic
    if wheels is not None and ("lateral" in factor or "vertical" in factor):
        new["aiding"] = {
            "non_holonomic": {
                f"{name}_sigma_m_s": _rounded(getattr(wheels, f"{name}_sigma_m_s") * factor[name])
                for name in ("lateral", "vertical")
                if name in factor
            }
        }
    return new


def _rounded(value: float) -> float:
    """Three digits: no interval is narrower."""
    return float(f"{value:.3g}")


def remarks(config: NavigationConfig, tuning: Tuning) -> dict[str, str]:
    """Comments for the entries of a file: the factor on what stood there and its 95 % interval."""

    def of(*terms: str) -> str:
        parts = []
        for name in terms:
            if name in tuning.factors:
                low, high = tuning.intervals[name]
                parts.append(f"{TERM_TEXT[name]} x {tuning.factors[name]:.2g} ({low:.2g} to {high:.2g})")
        return "schuler tune: " + ", ".join(parts)

    comments = {
        "filter.noise.gyro": of("gyro"),
        "filter.noise.accel": of("accel", "accel_down"),
        "filter.tune": "noise stands as schuler tune left it",
        "gnss.position_sigma_scale": of("position", "height"),
        "gnss.velocity_sigma_scale": of("velocity", "climb"),
        "gnss.tight.range_sigma_scale": of("pseudorange"),
        "gnss.tight.rate_sigma_scale": of("range_rate"),
        "gnss.correlated.position_sigma_m": "schuler tune: innovations of fixes stay on one side",
        "aiding.non_holonomic.lateral_sigma_m_s": of("lateral"),
        "aiding.non_holonomic.vertical_sigma_m_s": of("vertical"),
    }
    for block in tuning.models:
        comments[f"filter.models.{block}.noise"] = of("gyro_bias" if block.startswith("b_g") else "accel_bias")
    return comments
