"""``schuler tune``."""

from __future__ import annotations

import time
from pathlib import Path

from schuler.cli.configuration import configuration, entries, with_outages
from schuler.cli.output import File, Flag, Texts, print_json, writable
from schuler.cli.reading import Part
from schuler.exceptions import InputError

_ALL = Part()


def tune(
    log: Path,
    /,
    *,
    config: Path | None = None,
    imu: str | None = None,
    out: File = None,
    outage: Texts = (),
    outage_every: str | None = None,
    set: Texts = (),
    unchecked: Flag = False,
    dry_run: Flag = False,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Tune the noise of IMU and GNSS from a log's own fixes, and write it into the configuration.

    Parameters
    ----------
    log
        File or folder; how it is read stands in the [recording] section of the configuration.
    config
        TOML file, see docs/navigation.md. Without one it is proposed from what the log shows, as navigate does.
    imu
        Without a configuration: the IMU by its name in the catalogue, or a file of schuler allan.
    out
        File to write instead of the configuration itself; without a configuration what was proposed, tuned.
    outage
        Withhold GNSS from START:STOP, seconds from the start of the recording; may be given several times.
    outage_every
        Withhold GNSS every PERIOD seconds for LENGTH: PERIOD:LENGTH, or PERIOD:LENGTH:FIRST.
    set
        Any entry of the configuration: SECTION.KEY=VALUE in TOML's spelling; may be given several times.
    unchecked
        Go on where the checks of units, axes, signs and clocks (schuler check) find an error; the result notes it.
    dry_run
        Print only, write nothing.
    json
        Print one JSON object instead of text.
    """
    from schuler.cli.proposal import proposed
    from schuler.cli.reading import read_log
    from schuler.diagnosis.admission import checked
    from schuler.files import write_text
    from schuler.navigation.run import tune_noise
    from schuler.navigation.tuning.entries import remarks, tuned_entries
    from schuler.toml import toml_with

    began = time.perf_counter()
    if config is None:
        proposal = proposed([log], imu, entries(set), part=part)
        loaded, recording = with_outages(proposal.config, outage, outage_every), proposal.recording
        text = proposal.toml()
    elif imu is not None:
        raise InputError("--config says what the IMU is: give no --imu with it")
    else:
        loaded = configuration(config, entries(set), outage, outage_every)
        recording, text = part.of(read_log(log, config)), config.read_text(encoding="utf-8")
    recording = checked(recording, unchecked=unchecked, clock_shift_s=loaded.imu.clock_shift_s)
    file = None if dry_run else config if out is None else out
    if file is not None:
        writable(file.parent)
    result = tune_noise(recording, loaded)
    written = None
    if result.better and file is not None:
        text = toml_with(text, tuned_entries(loaded, result), remarks(loaded, result))
        written = write_text(file, text, at_once=out is None)
    if json:
        elapsed = time.perf_counter() - began
        print_json({"command": "tune", **result.to_dict(), "elapsed_s": elapsed, "file": written})
    else:
        print(result.summary())
        if written is not None:
            print(f"configuration: {written}")
    return 0
