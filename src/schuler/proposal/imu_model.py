"""Error budget of an IMU: as named, as the log's header names it, or of the class that its rests show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.exceptions import InputError
from schuler.proposal.decision import Decision
from schuler.recording.series import ImuSeries
from schuler.sensors import catalogue
from schuler.standstill.unscaled import UnscaledRests

# White noise of the gyroscope and mean rate at rest up to which an IMU is of tactical grade. What is better still is
# navigated as tactical too: noise is tuned from the log, and biases that start wider converge.
_TACTICAL = (0.3 * units.DEG_PER_RTHR, 30.0 * units.DEG_PER_HR)
_LEAST_REST_S = 20.0
_PART = re.compile(r"[A-Z]{2,5}-?\d{2,5}[A-Z]{0,4}\d?")


def imu_entries(
    name: str | None, imu: ImuSeries, rests: UnscaledRests | None, heads: Sequence[str]
) -> tuple[dict[str, Any], Decision]:
    """Entries of the section ``[imu]`` that name the error budget, and why.

    Parameters
    ----------
    name : str, optional
        Name of the catalogue, or a file of ``schuler allan``, as the user said.
    imu : ImuSeries
        In SI.
    rests : UnscaledRests, optional
    heads : sequence of str
        First lines of the files read.

    Raises
    ------
    InputError
        If there is no such IMU; the message proposes similar names.
    """
    if name is not None:
        if name.endswith(".toml") or Path(name).is_file():
            path = str(Path(name).resolve())
            return {"spec": path}, Decision("imu.spec", path, "as said")
        entry = catalogue.entry(name)
        catalogue.spec(name)
        by_grade = entry.kind == "grade" and catalogue.plain(name) != catalogue.plain(entry.name)
        part = catalogue.plain(name) if by_grade else entry.name  # "consumer" says more of biases than a thesis's set
        return {"catalogue": part}, Decision("imu.catalogue", part, "as said")
    for word in dict.fromkeys(word for head in heads for word in _PART.findall(head)):
        try:
            part = catalogue.entry(word).name
            catalogue.spec(part)
        except InputError:
            continue
        return {"catalogue": part}, Decision("imu.catalogue", part, f"the log's header names {word}")
    return _by_class(imu, rests)


def _by_class(imu: ImuSeries, rests: UnscaledRests | None) -> tuple[dict[str, Any], Decision]:
    """Grade by noise and bias of the longest rest; consumer grade where there is none, which no IMU is worse than."""
    if rests is None or not len(rests) or float((rests.t[:, 1] - rests.t[:, 0]).max()) < _LEAST_REST_S:
        why = "no rest is long enough to show how good the IMU is; the widest class is taken"
        return {"catalogue": "consumer"}, Decision("imu.catalogue", "consumer", why)
    longest = int(np.argmax(rests.t[:, 1] - rests.t[:, 0]))
    rates = imu.rates()
    gyro = rates.gyro[rests.first[longest] : rests.last[longest]]
    d = np.diff(gyro, n=2, axis=0)
    noise = float(np.sqrt(np.mean(d**2, axis=0).max() / 6.0 * imu.interval))
    bias = float(np.linalg.norm(gyro.mean(axis=0)))
    tactical = noise < _TACTICAL[0] and bias < _TACTICAL[1]
    grade = "tactical" if tactical else "consumer"
    at_rest = f"at rest the gyroscopes show {noise / units.DEG_PER_RTHR:.2g} deg/sqrt(h) and a mean of "
    shown = f"{bias / units.DEG_PER_HR:.3g} deg/h" if tactical else f"{bias / units.DEG:.2g} deg/s"
    return {"catalogue": grade}, Decision("imu.catalogue", grade, at_rest + shown)
