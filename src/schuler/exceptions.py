"""Exceptions of the package.

Every message says what was expected, what came and what to do about it. The command line turns any
:class:`SchulerError` into one line on stderr and exit code 2; anything else is a defect of ours.
"""

from __future__ import annotations

from pathlib import Path


class SchulerError(Exception):
    """Base of every error a user can cause."""


class InputError(SchulerError, ValueError):
    """A value, array or option that cannot be used as it is."""


class UnitError(InputError):
    """A unit that is unknown or measures the wrong quantity."""


class ConfigError(InputError):
    """A configuration or scenario file with missing, unknown or contradictory entries."""


class FileFormatError(InputError):
    """A file whose contents cannot be read as what they were said to be.

    Parameters
    ----------
    message : str
        What was expected, what came, what to do.
    path : Path, optional
        The file.
    line : int, optional
        One-based line of the file; the message then starts with ``file:line:``.
    """

    def __init__(self, message: str, path: Path | str | None = None, line: int | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.line = line
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + message)


class MissingExtraError(SchulerError, ImportError):
    """An optional library is needed for what was asked.

    Parameters
    ----------
    library : str
        The import name that failed.
    extra : str
        The extra of this package that installs it.
    purpose : str
        What it was needed for.
    """

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs {library}, which is not installed: pip install 'schuler[{extra}]'")
