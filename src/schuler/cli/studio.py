"""``schuler studio``."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.output import say
from schuler.exceptions import InputError


def studio(
    *paths: Path,
    port: int = 0,
    browser: bool = True,
    host: str = "127.0.0.1",
    token_file: Path | None = None,
) -> None:
    """Open the workbench in the browser: look at logs, navigate them, compare runs.

    It answers on this machine alone, behind a token in the address, and asks nothing of any other machine. Everything
    made in it is a file of the folder and a command that can be run again.

    Parameters
    ----------
    paths
        Folder, or files of one folder. Default: the folder that the command is run in.
    port
        Port that is listened on; 0 takes any that is free.
    browser
        Open the address in a browser.
    host
        Listen on this address of the machine, for others too; needs --token-file.
    token_file
        File with the token of the address; a new random one by default.
    """
    from schuler.studio import serve
    from schuler.studio.server import LOOPBACK
    from schuler.studio.workspace import workspace_of

    if not 0 <= port < 65536:
        raise InputError(f"--port: expected 0 to 65535, got {port}")
    workspace, first = workspace_of(paths)

    def ready(address: str) -> None:
        print(address, flush=True)
        say(f"folder: {workspace.root}; stop with Ctrl-C")
        if host != LOOPBACK:
            say(f"whoever has the token reads and writes this folder, from any machine that reaches {host}", "warning")
        if browser:
            import webbrowser

            webbrowser.open(address)

    serve(workspace, first=first, port=port, host=host, token_file=token_file, ready=ready)
