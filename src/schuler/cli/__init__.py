"""Command line: read, make one library call, say what came of it, write files.

Results go to stdout (with ``--json`` one JSON object), progress and prose to stderr. Exit codes: 0 success, 1 a defect
of ours or an interrupted run, 2 input that cannot be used, with one line that says why.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the return value is the exit code."""
    import cyclopts

    from schuler.cli.app import app
    from schuler.exceptions import SchulerError

    try:
        result = app(
            list(sys.argv[1:] if arguments is None else arguments), exit_on_error=False, print_error=False,
            result_action="return_value",
        )  # fmt: skip
    except cyclopts.CycloptsError as error:
        print(f"schuler: {' '.join(str(error).split())}  (see schuler --help)", file=sys.stderr)
        return 2
    except SchulerError as error:
        print(f"schuler: {error}", file=sys.stderr)
        return 2
    except (FileExistsError, IsADirectoryError, NotADirectoryError, PermissionError) as error:
        if error.filename is None:
            raise
        print(
            f"schuler: {error.filename}: expected a path to read or write as asked, got: {error.strerror}; "
            "give another one",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt:
        print("schuler: interrupted", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1
    return result if isinstance(result, int) else 0
