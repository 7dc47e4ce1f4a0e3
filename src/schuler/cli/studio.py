"""``schuler studio``."""

from __future__ import annotations

import tempfile
from pathlib import Path

from schuler.cli.output import Flag, say
from schuler.exceptions import InputError


def studio(
    *paths: Path,
    demo: Flag = False,
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
    demo
        Put the drive of schuler demo, its configuration and a mission into the folder first, which is made if it is
        missing; a new one for temporary files by default.
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
    if demo:
        paths = (_demo_folder(paths),)
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


def _demo_folder(paths: tuple[Path, ...]) -> Path:
    """Folder with the demo's drive in it: the one that was given, or a new one."""
    from schuler.cli.demo import write_demo_drive
    from schuler.studio.workspace import Workspace, write_mission

    if len(paths) > 1 or any(path.exists() and not path.is_dir() for path in paths):
        raise InputError(f"--demo: expected one folder or none, got {', '.join(map(str, paths))}")
    folder = paths[0] if paths else Path(tempfile.mkdtemp(prefix="schuler-demo-"))
    say("simulating the demo's ten minutes of driving")
    write_demo_drive(folder)
    if not (folder / "mission.toml").exists():
        write_mission(Workspace(folder.resolve()))
    return folder
