"""``schuler export``: the filter of a configuration for other computers."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from schuler.cli.configuration import configuration, entries
from schuler.cli.output import Flag, Folder, Texts, print_json, say, writable
from schuler.cli.reading import Part
from schuler.exceptions import InputError

_ALL = Part()


def export(
    what: Literal["c"],
    log: Path | None = None,
    /,
    *,
    config: Path,
    out: Folder = None,
    seconds: float = 60.0,
    rate_hz: float | None = None,
    without: Texts = (),
    set: Texts = (),
    unchecked: Flag = False,
    json: Flag = False,
    part: Part = _ALL,
) -> None:
    """Write the filter of a configuration as C99: one header, five files, tables, Makefile, and a test vector.

    Loosely coupled GNSS, zero velocity, wheels that do not slip, odometer; what else is configured is refused.

    Parameters
    ----------
    what
        The language: c.
    log
        File or folder to take sample rate and test vector from, read as the [recording] section says. Without one, a
        simulated drive of the configured IMU.
    config
        TOML file, see docs/navigation.md. Its noise is taken as it stands: run schuler tune before.
    out
        Folder for the files. Default: the configuration's name with -c.
    seconds
        Length of the test vector.
    rate_hz
        Sample rate of the IMU on the vehicle, where no log says it. Default: 100.
    without
        Switch a configured aid off; may be given several times.
    set
        Any entry of the configuration: SECTION.KEY=VALUE in TOML's spelling; may be given several times.
    unchecked
        Go on where the checks of units, axes, signs and clocks (schuler check) find an error; the result notes it.
    json
        Print one JSON object instead of text.
    """
    from schuler.export import check_exported, filter_design, simulated_run, write_filter

    changes = [*entries(set), *((f"aiding.{name}", None) for name in without)]
    loaded = configuration(config, changes, (), None)
    folder = writable(Path(f"{config.resolve().stem}-c")) if out is None else out
    check_exported(loaded)
    if log is None:
        loaded, prepared = simulated_run(loaded, 100.0 if rate_hz is None else rate_hz)
    else:
        from schuler.cli.reading import read_log
        from schuler.diagnosis.admission import checked
        from schuler.navigation.run import prepared_run

        if rate_hz is not None:
            raise InputError("--rate-hz: the log says the sample rate; give one of them")
        recording = checked(part.of(read_log(log, config)), unchecked=unchecked, clock_shift_s=loaded.imu.clock_shift_s)
        prepared = prepared_run(recording, loaded)
    files = write_filter(folder, loaded, prepared, seconds)
    design = filter_design(loaded, prepared)
    numbers = {
        "states": design.layout.size, "blocks": design.layout.blocks, "rate_hz": 1.0 / design.interval_s,
        "samples_to_a_propagation": design.state.settings.every,
    }  # fmt: skip
    if json:
        print_json({"command": "export", **numbers, "notes": prepared.notes, "files": files})
        return
    for note in prepared.notes:
        say(note)
    print(
        f"{design.layout.size} states ({' '.join(design.layout.blocks)}), IMU at {1.0 / design.interval_s:g} Hz, "
        f"covariance every {design.state.settings.every} samples"
    )
    print("\n".join(str(path) for path in files.values()))
    say(f"make -C {folder} check compiles it here and compares it with the filter of schuler")
