"""``schuler completion``."""

from __future__ import annotations

from typing import Literal


def completion(shell: Literal["bash", "zsh", "fish"], /) -> None:
    """Print the script that completes commands and options in a shell.

    Parameters
    ----------
    shell
        The shell: bash, zsh or fish.
    """
    from schuler.cli.app import app

    print(app.generate_completion(prog_name="schuler", shell=shell))
