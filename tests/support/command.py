"""Commands as scripts run them: exit code, stdout and stderr; and the one line of a refusal."""

import json

from schuler.cli import main


def run(capsys, *arguments):
    """Exit code, stdout and stderr of a command."""
    code = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def refusal(capsys, *arguments):
    """Message of a command that cannot be carried out: exit code 2, one line on stderr, nothing on stdout."""
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, ""), err
    assert err.startswith("schuler: ")
    assert err.count("\n") == 1
    return err


def answer(capsys, *arguments):
    """JSON of a command that succeeds."""
    code, out, err = run(capsys, *arguments)
    assert code == 0, err
    return json.loads(out)
