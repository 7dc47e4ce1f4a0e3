"""Command line: read, make one library call, say what came of it, write files.

Results go to stdout (with ``--json`` one JSON object), progress and prose to stderr. Exit codes: 0 success, 1 a defect
of ours or an interrupted run, 2 input that cannot be used, with one line that says why.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the return value is the exit code."""
    _open_closed_streams()
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    except KeyboardInterrupt:  # also while modules are loaded
        print("schuler: interrupted", file=sys.stderr)
        return 1


def _open_closed_streams() -> None:
    """Let what is printed to a stream that was closed (``>&-``) go nowhere, and no file of ours take its number."""
    import os

    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))  # noqa: SIM115 - for as long as the process lives


def _run(given: Sequence[str]) -> int:
    import cyclopts

    from schuler.cli.app import FORCE, QUIET, app
    from schuler.cli.output import complain, silenced
    from schuler.exceptions import SchulerError, printable
    from schuler.files import outputs

    try:
        with outputs(force=FORCE in given), silenced(QUIET in given):
            result = app(
                [text for text in given if text not in (FORCE, QUIET)], exit_on_error=False, print_error=False,
                result_action="return_value",
            )  # fmt: skip
        sys.stdout.flush()
    except cyclopts.UnusedCliTokensError as error:
        left = ", ".join(error.unused_tokens or ())
        complain(
            printable(
                f"unused: {left}; an option that takes several is given before each of them, as in --nav A --nav B  "
                "(see schuler --help)"
            )
        )
        return 2
    except cyclopts.CycloptsError as error:
        if given[:1] == ["calibrate"] and len(given) > 1 and Path(given[1]).exists():
            complain(
                f"calibrate: expected a method before the log, such as calibrate freepose {given[1]} (put down by hand "
                "in many poses); schuler calibrate --help lists them"
            )
            return 2
        complain(f"{' '.join(str(error).split())}  (see schuler --help)")
        return 2
    except SchulerError as error:
        complain(printable(_as_given(str(error), given)))
        return 2
    except BrokenPipeError:
        return 1
    except OSError as error:
        if error.errno is None:
            raise
        complain(printable(_of_the_system(error)))
        return 2
    except MemoryError as error:
        complain(f"expected enough memory for what was asked ({error}): take a part of it, or a lower rate")
        return 2
    return result if isinstance(result, int) else 0


def _as_given(text: str, arguments: Sequence[str]) -> str:
    """A message with hints on reading as the command takes them: options, entries of a configuration, or Python."""
    from schuler.cli.app import CONFIGURED, HINTED

    command = arguments[0] if arguments else ""
    if command not in (*HINTED, *CONFIGURED):
        return text
    from schuler.diagnosis.result import as_entries, as_options

    if command in HINTED:
        return as_options(text)
    spelt = as_entries(text)
    where = "in [recording], or in the file's own section such as [recording.imu]; on the command line --set recording."
    return text if spelt == text else f"{spelt} ({where}KEY=VALUE)"


def _of_the_system(error: OSError) -> str:
    """What the system refused, in one sentence."""
    import errno
    import os

    what = os.strerror(error.errno) if error.errno else error.strerror
    if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS):
        return f"{error.filename}: expected a path to read or write as asked, got: {what}; give another one"
    if error.filename is None:
        # stdout, whose buffer would be written again when the interpreter ends
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
    return (
        f"{error.filename or 'results'}: cannot be written: {what}; nothing was changed: make room, or write elsewhere"
    )
