"""Access to the server: a token, the server's own names, and its own pages; everything else is refused.

A page of another site that a user has open can send requests to 127.0.0.1 too. It knows no token, the browser names its
origin, and a name that resolves to 127.0.0.1 stands in ``Host``: each of them is refused by itself.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import parse_qsl, quote, urlencode

from schuler.exceptions import InputError

Scope: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send: TypeAlias = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

#: Shortest token of a file: what one could guess opens nothing.
LEAST_TOKEN = 16
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'self'"
)  # the templates of NiceGUI are compiled in the browser, which 'unsafe-eval' names
_HEADERS = (
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


@dataclass(frozen=True)
class Door:
    """Names under which a server is asked, and the token that opens it.

    Attributes
    ----------
    token : str
    port : int
    hosts : frozenset of str, or None
        Names in addresses, without the port; None: any.
    """

    token: str
    port: int
    hosts: frozenset[str] | None = frozenset({"127.0.0.1", "localhost"})

    @property
    def cookie(self) -> str:
        """Name of the cookie: browsers do not tell the ports of a host apart."""
        return f"schuler_studio_{self.port}"

    def address(self, host: str = "127.0.0.1") -> str:
        """Address with the token, for the first visit."""
        return f"http://{host}:{self.port}/?token={quote(self.token)}"


def new_token() -> str:
    """Token of 256 random bits."""
    return secrets.token_urlsafe(32)


def token_of(path: Path) -> str:
    """Token that a file holds, blanks around it left out.

    Raises
    ------
    InputError
        If it is missing, shorter than :data:`LEAST_TOKEN` characters, or others may read the file.
    """
    if not path.is_file():
        raise InputError(
            f"--token-file: expected a file with a token, {path} is none: write one, such as by openssl rand"
        )
    token = path.read_text(encoding="utf-8", errors="replace").strip()
    if len(token) < LEAST_TOKEN or not token.isascii() or not token.isprintable():
        raise InputError(
            f"--token-file: expected {LEAST_TOKEN} or more letters and digits in {path}, got {len(token)}: one that "
            "cannot be guessed, such as by openssl rand -hex 32"
        )
    return token


@dataclass(frozen=True)
class Guard:
    """Application that lets in who has the token, under a name of the server, from its own pages.

    Attributes
    ----------
    app : ASGI application
    door : Door
    """

    app: Application
    door: Door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or connection."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        query = parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)
        given = dict(query).get("token")
        reason = refusal(self.door, headers, given)
        if reason is not None:
            await _refuse(scope["type"], reason, receive, send)
            return
        if scope["type"] == "http" and given is not None and scope["method"] == "GET":
            remainder = urlencode([(name, value) for name, value in query if name != "token"])
            # one slash: an address that begins with two is one of another host
            place = "/" + quote(scope["path"].lstrip("/\\")) + (f"?{remainder}" if remainder else "")
            cookie = f"{self.door.cookie}={quote(self.door.token)}; Path=/; HttpOnly; SameSite=Strict"
            await _answer(303, [(b"location", place.encode()), (b"set-cookie", cookie.encode())], b"", send)
            return

        async def send_with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                names = {name.lower() for name, _ in message["headers"]}
                more = [*_HEADERS, (b"content-security-policy", _POLICY.encode())]
                message["headers"] = [*message["headers"], *(pair for pair in more if pair[0] not in names)]
            await send(message)

        await self.app(scope, receive, send_with_headers)


def refusal(door: Door, headers: dict[str, str], given: str | None) -> str | None:
    """Reason why a request is refused, None if it is not.

    Parameters
    ----------
    door : Door
    headers : dict of str to str
        By name in small letters.
    given : str or None
        Token in the address.
    """
    host = headers.get("host", "")
    if door.hosts is not None and host not in {f"{name}:{door.port}" for name in door.hosts}:
        return f"expected the server under its own name and port {door.port}, got {host[:80]!r}"
    origin = headers.get("origin")
    if origin is not None and origin != f"http://{host}" and origin != f"https://{host}":
        return "expected a request of the server's own pages, got one of another site"
    token = given if given is not None else _cookie(headers.get("cookie", ""), door.cookie)
    if token is None:
        return "expected the address with its token, got none: open the one that schuler studio printed"
    if not secrets.compare_digest(token.encode(), door.token.encode()):
        return "expected the token of this server, got another: open the address that schuler studio printed"
    return None


def _cookie(text: str, name: str) -> str | None:
    from urllib.parse import unquote

    try:
        morsel = SimpleCookie(text).get(name)
    except CookieError:
        return None
    return None if morsel is None else unquote(morsel.value)


async def _refuse(kind: str, reason: str, receive: Receive, send: Send) -> None:
    if kind == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    await _answer(403, [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS], f"{reason}\n".encode(), send)


async def _answer(status: int, headers: list[tuple[bytes, bytes]], body: bytes, send: Send) -> None:
    length = (b"content-length", str(len(body)).encode())
    await send({"type": "http.response.start", "status": status, "headers": [*headers, length]})
    await send({"type": "http.response.body", "body": body})
