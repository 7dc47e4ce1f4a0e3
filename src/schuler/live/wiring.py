"""Sources of addresses: what each is read with, how it is decoded, and whether its IMU gives rates or increments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from threading import Event
from typing import Any, cast

from schuler.exceptions import InputError
from schuler.live.address import Address
from schuler.live.clock import SourceClock
from schuler.live.decoders.detection import decoder
from schuler.live.playback import play
from schuler.live.session import Piece, Source
from schuler.live.sources import DATAGRAMS, Notify, chunks
from schuler.recording.io.columns import check_known
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording
from schuler.recording.series import Kind

#: Hints that stand in an address, over those of the configuration.
_IN_ADDRESS = ("columns", "units", "axes", "time")


def connect(
    addresses: Sequence[Address],
    section: Mapping[str, Any],
    clock: SourceClock,
    *,
    replayed: Callable[[Path], Recording],
    kept_in: Callable[[int, Address], Callable[[bytes], None] | None],
    raw: bool = False,
) -> tuple[list[Source], Kind]:
    """Sources of a run, ready to be opened.

    Parameters
    ----------
    addresses : sequence of Address
    section : mapping
        ``[recording]`` of the configuration: of one log, or with an entry for each part. An address takes the hints of
        the part it names (``?part=imu``), and one that is alone those of the whole section.
    clock : SourceClock
    replayed : callable
        Reads a log.
    kept_in : callable
        Function that keeps the bytes of the k-th source, or None.
    raw : bool
        Raw measurements of satellites are wanted, for tight coupling, and no solutions.

    Returns
    -------
    sources : list of Source
    kind : {"rate", "increment"}
        Of the IMU.

    Raises
    ------
    InputError
        If a source is not described, or two of them hold an IMU of different kinds.
    """
    sources: list[Source] = []
    kinds: set[Kind] = set()
    for k, address in enumerate(addresses):
        if address.scheme == "replay":
            recording = replayed(Path(address.path))
            kinds.add(recording.need_imu().kind)
            sources.append(Source(address.text, _playing(recording, clock, address.number("speed", 1.0))))
            continue
        hints = hints_of(address, section, alone=len(addresses) == 1)
        decoded = decoder(
            clock, hints, format=address.options.get("format"), by_arrival=_by_arrival(address),
            whole=address.scheme in DATAGRAMS, raw=raw,
        )  # fmt: skip
        if decoded.kind is not None:
            kinds.add(decoded.kind)
        sources.append(Source(address.text, _reading(address), decoded, kept_in(k, address)))
    if len(kinds) > 1:
        raise InputError(
            "one source gives rates, another increments: a run has one IMU; leave the other source out, or its IMU "
            "(streams = 'imu=none' in the configuration)"
        )
    return sources, next(iter(kinds), "rate")


def hints_of(address: Address, section: Mapping[str, Any], *, alone: bool) -> ReadHints:
    """Hints of a source: those of the configuration for its part, and over them those in the address.

    Raises
    ------
    InputError
        If the configuration does not describe the part.
    """
    in_parts = bool(section) and all(isinstance(entry, Mapping) for entry in section.values())
    part = address.options.get("part")
    given: Mapping[str, Any] = {}
    if part is not None and in_parts:
        given = section[check_known(part, list(section), f"{address.text}: part of [recording]")]
    elif (part is not None or alone) and not in_parts:
        given = section
    elif alone and len(section) == 1:
        given = next(iter(section.values()))
    names = {field.name for field in fields(ReadHints)}
    over = {name: address.options[name] for name in _IN_ADDRESS if name in address.options}
    return ReadHints.of(**{**{name: value for name, value in given.items() if name in names}, **over})


def _by_arrival(address: Address) -> bool:
    stamp = address.options.get("stamp", "own")
    return check_known(stamp, ("own", "arrival"), f"{address.text}: stamp") == "arrival"


def _reading(address: Address) -> Callable[[Event, Notify], Iterator[Piece]]:
    return lambda stop, notify: cast(Iterator[Piece], chunks(address, stop, notify))


def _playing(recording: Recording, clock: SourceClock, speed: float) -> Callable[[Event, Notify], Iterator[Piece]]:
    return lambda stop, _: cast(Iterator[Piece], play(recording, clock, stop, speed))
