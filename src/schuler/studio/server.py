"""The server of the workbench: bound to one address, behind a token, serving all of its own files."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from schuler.exceptions import InputError, MissingExtraError
from schuler.studio.access import Door, Guard, new_token, token_of
from schuler.studio.signals import Views
from schuler.studio.workspace import JOBS, Workspace

if TYPE_CHECKING:
    from fastapi import FastAPI

LOOPBACK = "127.0.0.1"


def serve(
    workspace: Workspace,
    *,
    first: str | None = None,
    port: int = 0,
    host: str = LOOPBACK,
    token_file: Path | None = None,
    ready: Callable[[str], None] = print,
) -> None:
    """Serve the workbench for a folder until it is interrupted.

    Parameters
    ----------
    workspace : Workspace
    first : str, optional
        Name of the log that is open at first.
    port : int
        0: any that is free.
    host : str
        Address that is listened on; another than 127.0.0.1 needs a token of the user's.
    token_file : Path, optional
        File with the token; a random one by default.
    ready : callable
        Called with the address as soon as it answers.

    Raises
    ------
    MissingExtraError
        If NiceGUI is not installed (extra ``studio``).
    InputError
        If the address cannot be listened on, or is open to others without a token file.
    """
    try:
        import fcntl  # noqa: F401 - by which jobs are found again
    except ImportError:
        raise InputError(
            "schuler studio needs locks of files as Linux and macOS have them; this system has none"
        ) from None
    if host not in (LOOPBACK, "localhost") and token_file is None:
        raise InputError(
            f"--host {host}: expected --token-file with it: whoever reaches this address and has the token reads and "
            f"writes {workspace.root}"
        )
    token = new_token() if token_file is None else token_of(token_file)
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(workspace.root / JOBS / "nicegui"))
    try:
        import uvicorn
        from fastapi import FastAPI
        from nicegui import ui
    except ImportError:
        raise MissingExtraError("nicegui", "studio", "the workbench in the browser") from None
    listening = _bound(host, port)
    number = int(listening.getsockname()[1])
    local = host in (LOOPBACK, "localhost")
    anywhere = host in ("0.0.0.0", "::")  # noqa: S104 - compared
    door = Door(token, number, None if anywhere else frozenset({LOOPBACK, "localhost", host}))

    app: FastAPI = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    views = Views()
    from schuler.studio.pages import add_pages
    from schuler.studio.routes import add_routes

    add_routes(app, workspace, views)
    add_pages(workspace, views)
    ui.run_with(
        app, title="schuler studio", dark=None, tailwind=False, show_welcome_message=False, reconnect_timeout=30.0,
        favicon="🧭",
    )  # fmt: skip
    address = door.address(LOOPBACK if local else host)
    if first is not None:
        address += f"&log={quote(first)}"
    config = uvicorn.Config(Guard(app, door), log_level="warning", ws_max_size=1 << 20, access_log=False)
    server = uvicorn.Server(config)
    listening.listen(128)  # what is asked from now on waits for the server
    ready(address)
    server.run(sockets=[listening])


def _bound(host: str, port: int) -> socket.socket:
    """Socket that is bound, not listening."""
    bound: socket.socket | None = None
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        bound = socket.socket(family, socket.SOCK_STREAM)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host, port))
    except OSError as error:
        if bound is not None:
            bound.close()
        raise InputError(
            f"{host}:{port}: expected an address and port of this machine that is free ({error}): say another --port"
        ) from None
    return bound
