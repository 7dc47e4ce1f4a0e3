"""Architectures by name: how GNSS is used and which other aids there are, as changes to a configuration."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import (
    BarometerSection,
    HeadingSection,
    NonHolonomicSection,
    OdometerSection,
    ZeroRateSection,
    ZeroVelocitySection,
)
from schuler.recording.recording import Recording

#: First word of a mode: value of ``gnss.coupling``.
COUPLINGS: MappingProxyType[str, str] = MappingProxyType(
    {"ins": "off", "reset": "reset", "loose": "loose", "tight": "tight"}
)

#: Further words: section of ``aiding``, and what it is if the configuration does not have it.
AIDS: MappingProxyType[str, tuple[str, Any]] = MappingProxyType(
    {
        "zupt": ("zero_velocity", ZeroVelocitySection),
        "zaru": ("zero_rate", ZeroRateSection),
        "nhc": ("non_holonomic", NonHolonomicSection),
        "odometer": ("odometer", OdometerSection),
        "heading": ("heading", HeadingSection),
        "barometer": ("barometer", BarometerSection),
        "fixes": ("fixes", None),
    }
)


@dataclass(frozen=True)
class Mode:
    """One architecture.

    Attributes
    ----------
    coupling : str
        Key of :data:`COUPLINGS`.
    aids : tuple of str
        Keys of :data:`AIDS`; all others are switched off.
    """

    coupling: str
    aids: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name for :func:`parse_mode`, such as ``loose+zupt+nhc``."""
        return "+".join((self.coupling, *self.aids))

    def configure(self, config: NavigationConfig) -> NavigationConfig:
        """The configuration with this architecture; what it says of coupling and aids is kept where it is used.

        Raises
        ------
        InputError
            If the mode has an aid without defaults that the configuration does not have.
        """
        sections: dict[str, Any] = {}
        for word, (name, default) in AIDS.items():
            present = getattr(config.aiding, name)
            if word not in self.aids:
                sections[name] = None
            elif present is None and default is None:
                raise InputError(f"mode {self.name}: aiding.{name} has no defaults; put it into the configuration")
            else:
                sections[name] = default() if present is None else present
        return config.model_copy(
            update={
                "gnss": config.gnss.model_copy(update={"coupling": COUPLINGS[self.coupling]}),
                "aiding": config.aiding.model_copy(update=sections),
            }
        )


def parse_mode(text: str) -> Mode:
    """Mode from its name: a coupling and aids, joined by plus signs.

    Raises
    ------
    InputError
        Naming the known words.

    Examples
    --------
    >>> parse_mode("loose+zupt+nhc").aids
    ('zupt', 'nhc')
    """
    coupling, *aids = [word.strip().lower() for word in text.split("+")]
    wrong = [w for w in aids if w not in AIDS]
    if coupling not in COUPLINGS or wrong or len(set(aids)) != len(aids):
        raise InputError(
            f"mode: expected one of {', '.join(COUPLINGS)}, then + and any of {', '.join(AIDS)}, each once, such as "
            f"loose+zupt+nhc; got {text!r}"
        )
    return Mode(coupling, tuple(word for word in AIDS if word in aids))


def available_modes(recording: Recording, config: NavigationConfig) -> tuple[Mode, ...]:
    """Everything that the series of a recording and the aids of a configuration allow.

    Returns
    -------
    tuple of Mode
        INS only, reset, loose, tight where there are ranges; then loose and INS only with each configured aid, and with
        all of them. An aid that is not configured is not tried: whether a log is of a wheeled vehicle is not in the
        log.
    """
    series: dict[str, Any] = {
        "odometer": recording.odometer, "heading": recording.heading, "barometer": recording.height,
    }  # fmt: skip
    aids = tuple(
        word
        for word, (name, _) in AIDS.items()
        if getattr(config.aiding, name) is not None and series.get(word, True) is not None
    )
    bases = ["ins", "reset", "loose"]
    if recording.ranges is not None or (recording.observations is not None and recording.ephemerides is not None):
        bases.append("tight")
    modes = [Mode(base) for base in bases]
    for base in [b for b in bases if b != "reset"]:
        modes += [Mode(base, (word,)) for word in aids]
        modes += [Mode(base, aids)] if len(aids) > 1 else []
    return tuple(modes)
