"""Addresses of what a stream comes from or goes to: ``serial:/dev/ttyUSB0?baud=115200``, ``udp://:5000``."""

from __future__ import annotations

from dataclasses import dataclass, field
from urllib.parse import parse_qsl

from schuler.exceptions import InputError
from schuler.recording.io.columns import check_known

#: Host of an address that names none: nothing but this machine is listened to.
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Address:
    """An address taken apart.

    Attributes
    ----------
    scheme : str
        ``serial``, ``udp``, ``tcp``, ...; ``-`` alone is ``stdin``.
    host : str
        Of a network address; :data:`LOOPBACK` where none is given.
    port : int
        Of a network address, else 0.
    path : str
        File, device or topic.
    options : dict of str
        What stands behind the question mark.
    text : str
        As it was given.
    """

    scheme: str
    host: str = LOOPBACK
    port: int = 0
    path: str = ""
    options: dict[str, str] = field(default_factory=dict)
    text: str = ""

    def number(self, name: str, default: float) -> float:
        """An option that is a number, not negative.

        Raises
        ------
        InputError
            If it is something else.
        """
        text = self.options.get(name, "")
        try:
            value = float(text) if text else default
        except ValueError:
            value = -1.0
        if not 0.0 <= value < float("inf"):
            raise InputError(f"{self.text}: {name}: expected a number from 0 on, got {text!r}")
        return value


def parse_address(text: str, schemes: dict[str, tuple[str, ...]], networks: tuple[str, ...]) -> Address:
    """Take an address apart and check it.

    Parameters
    ----------
    text : str
    schemes : dict of str to tuple of str
        Schemes that have a meaning here, with the options of each.
    networks : tuple of str
        Those of them that have a host and a port: ``scheme://HOST:PORT``.

    Raises
    ------
    InputError
        For an unknown scheme or option, a missing port, device or file.
    """
    scheme, colon, rest = ("stdin:" if text == "-" else text).partition(":")
    if not colon or scheme not in schemes:
        raise InputError(
            f"{text!r}: expected an address that begins with {', '.join(f'{scheme}:' for scheme in schemes)}"
            + (f"; a log is replayed with replay:{text}" if "replay" in schemes else "")
        )
    place, mark, query = rest.rpartition("?") if "?" in rest else (rest, "", "")
    options = dict(parse_qsl(query, keep_blank_values=True))
    if mark and not options:
        raise InputError(f"{text}: expected NAME=VALUE after the question mark, such as ?baud=115200")
    for name in options:
        check_known(name, schemes[scheme], f"{text}: option")
    if scheme not in networks:
        if scheme != "stdin" and not place:
            raise InputError(f"{text}: expected {scheme}: and a file or device, got nothing behind the colon")
        return Address(scheme, path=place, options=options, text=text)
    host, port, path = _host_and_port(text, place)
    return Address(scheme, host or LOOPBACK, port, path, options, text)


def _host_and_port(text: str, place: str) -> tuple[str, int, str]:
    network, _, path = place.removeprefix("//").partition("/")
    host, colon, port = network.rpartition(":")
    if not place.startswith("//") or not colon or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise InputError(f"{text}: expected SCHEME://HOST:PORT with a port from 1 to 65535, such as udp://:5000")
    return host.strip("[]"), int(port), path
