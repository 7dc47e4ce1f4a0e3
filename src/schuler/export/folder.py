"""Folder of an exported filter: C files, Makefile, test vector."""

from __future__ import annotations

from pathlib import Path

from schuler.exceptions import InputError
from schuler.export.design import FilterDesign, filter_design
from schuler.export.replay import most_at_once, replay_lines
from schuler.export.tables import configuration_header, configuration_tables
from schuler.files import replacing, write_text
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.recording.series import Increments

_TEXT = Path(__file__).with_name("c")
#: Written as they stand here.
FIXED = (
    "schuler_nav.h", "schuler_internal.h", "mechanization.c", "covariance.c", "update.c", "axes.c",
    "gate.c", "filter.c",
    "main_test.c", "Makefile",
)  # fmt: skip
_LEAST_PENDING = 8


def write_filter(
    folder: Path | str, config: NavigationConfig, prepared: PreparedRun, seconds: float = 60.0
) -> dict[str, Path]:
    """Write the filter of a configuration as C99, with a test vector from a run.

    Parameters
    ----------
    folder : Path or str
    config : NavigationConfig
    prepared : PreparedRun
        Run of that configuration.
    seconds : float
        Length of the test vector; the run's where that is shorter. [s]

    Returns
    -------
    dict of str to Path
        Files by name.

    Raises
    ------
    ConfigError
        If the configuration uses what is not exported.
    InputError
        If ``seconds`` is not positive.
    """
    if not seconds > 0.0:
        raise InputError(f"seconds: expected a positive length of the test vector, got {seconds!r}")
    design = filter_design(config, prepared)
    start = prepared.initial.nav.t
    increments = prepared.increments.between(start - 1e-9, start + seconds + 1e-9)
    pending = most_at_once(prepared.increments, prepared.schedule)
    files = write_sources(folder, design, pending)
    files["vector.csv"] = write_vector(
        Path(folder) / "vector.csv", design, increments, prepared.schedule, prepared.initial
    )
    return files


def write_sources(folder: Path | str, design: FilterDesign, pending: int = 0) -> dict[str, Path]:
    """Write the C files and the Makefile of a filter; files by name.

    Parameters
    ----------
    folder : Path or str
    design : FilterDesign
    pending : int
        Measurements that may fall between two samples; there is room for eight at least.
    """
    texts = {name: (_TEXT / name).read_text(encoding="utf-8") for name in FIXED}
    texts["schuler_config.h"] = configuration_header(design, max(_LEAST_PENDING, pending))
    texts["schuler_config.c"] = configuration_tables(design)
    return {name: write_text(Path(folder) / name, text) for name, text in texts.items()}


def write_vector(
    path: Path | str,
    design: FilterDesign,
    increments: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
) -> Path:
    """Write a test vector, see :func:`~schuler.export.replay.replay_lines`; its path."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
        stream.writelines(replay_lines(design, increments, schedule, initial))
    return Path(path)
