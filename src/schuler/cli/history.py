"""``schuler history``."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.output import File, Flag, print_json
from schuler.exceptions import InputError


def history(folder: Path, /, *, serial: str = "", out: File = None, report: bool = True, json: Flag = False) -> None:
    """Show all calibrations of a unit over their dates, and what changed beyond its uncertainty.

    Parameters
    ----------
    folder
        Calibrations of schuler calibrate with a date, anywhere in it.
    serial
        Serial number of the unit, where the folder has several.
    out
        HTML page. Default: the folder's name with -history.html.
    report
        Write the page.
    json
        Print one JSON object instead of text.
    """
    from schuler.calibration.result.unit_history import calibration_history

    try:
        unit = calibration_history(folder, serial=serial)
    except InputError as error:
        raise InputError(str(error).replace("name it (serial)", "name it (--serial)")) from None
    files = {}
    if report:
        files["report"] = unit.report(Path(f"{folder.resolve().name}-history.html") if out is None else out)
    if json:
        print_json({"command": "history", **unit.to_dict(), "files": files})
        return
    print(unit.summary())
    print("".join(f"{name}: {path}\n" for name, path in files.items()), end="")
