"""Session of a calibration: which unit, who, where, when, at which temperature and gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import InputError
from schuler.timebase import calendar

if TYPE_CHECKING:
    from schuler.calibration.result.result import CalibrationResult
    from schuler.recording.recording import Recording

_LATEST_GPS_S = 4e9  # later stamps are no dates


@dataclass(frozen=True)
class Session:
    """Circumstances of a calibration; what is empty or None was not stated.

    Attributes
    ----------
    serial : str
        Serial number of the unit.
    operator, place : str
    date : str
        ISO 8601, YYYY-MM-DD.
    temperature_range : (float, float) or None
        Lowest and highest temperature of the sensor in the logs. [degC]
    gravity : float or None
        Local gravity that specific force was compared with. [m/s^2]
    gravity_source : str
        Origin of that number in words.
    latitude : float or None
        Geodetic, for gravity and the Earth's rate. [rad]
    rate_source : str
        What the gyroscopes were compared with, in words.
    """

    serial: str = ""
    operator: str = ""
    place: str = ""
    date: str = ""
    temperature_range: tuple[float, float] | None = None
    gravity: float | None = None
    gravity_source: str = ""
    latitude: float | None = None
    rate_source: str = ""

    def __post_init__(self) -> None:
        if self.date:
            try:
                date.fromisoformat(self.date)
            except ValueError:
                raise InputError(f"date: expected YYYY-MM-DD, such as 2025-03-31, got {self.date!r}") from None
        for name in ("serial", "operator", "place"):
            object.__setattr__(self, name, getattr(self, name).strip())


def session_of(result: CalibrationResult) -> Session:
    """Session that a calibration was made in, as its file states it; empty where it states none.

    Raises
    ------
    InputError
        If the entry was changed by hand to something that is none.
    """
    entries = result.provenance.get("session", {})
    try:
        session = Session(**entries)
        if session.temperature_range is not None:
            low, high = (float(v) for v in session.temperature_range)
            session = replace(session, temperature_range=(low, high))
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            "provenance.session: expected serial, operator, place, date, temperature_range, gravity, ..., "
            f"got {entries!r} ({error})"
        ) from None
    return session


def with_session(result: CalibrationResult, session: Session) -> CalibrationResult:
    """The same calibration made in that session, kept in its file."""
    stated = {name: value for name, value in asdict(session).items() if value not in ("", None)}
    return replace(result, provenance={**result.provenance, "session": stated})


def log_circumstances(recordings: Sequence[Recording]) -> dict[str, Any]:
    """What logs themselves say of a session: ``date`` of the first and ``temperature_range``, where they have any."""
    stated: dict[str, Any] = {}
    if recordings and (day := log_date(recordings[0])):
        stated["date"] = day
    warm = [r.imu.temperature for r in recordings if r.imu is not None and r.imu.temperature is not None]
    finite = [T[np.isfinite(T)] for T in warm]
    if any(len(T) for T in finite):
        all_of_them = np.concatenate(finite)
        stated["temperature_range"] = (float(all_of_them.min()), float(all_of_them.max()))
    return stated


def log_date(recording: Recording) -> str:
    """Day (GPS time) at which a recording starts, YYYY-MM-DD; empty if its clock is a local one."""
    time = recording.metadata.time
    if time.scale == "local":
        return ""
    seconds = time.epoch_gps_s + recording.start
    return calendar(seconds).date().isoformat() if 0.0 < seconds < _LATEST_GPS_S else ""
