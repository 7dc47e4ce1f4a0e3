"""The commands, each loaded only when it is called."""

from __future__ import annotations

from importlib.metadata import version

from cyclopts import App

app = App(
    name="schuler",
    help="Inertial navigation workbench: from an IMU log to position, velocity, attitude and honest uncertainty.",
    help_format="plaintext",
    version=lambda: version("schuler"),
)

#: Name, where it is, and the line that ``schuler --help`` shows.
COMMANDS = {
    "demo": (
        "schuler.cli.demo:demo",
        "Simulate a drive with a GNSS outage, navigate it, write a report. Needs no file.",
    ),
    "info": ("schuler.cli.convert:info", "Say what is in a log."),
    "convert": ("schuler.cli.convert:convert", "Convert any readable log to Parquet, CSV, .pos, KML or GeoJSON."),
    "simulate": ("schuler.cli.simulate:simulate", "Truth, IMU and GNSS of a scenario in a TOML file."),
    "navigate": ("schuler.cli.navigate:navigate", "Navigate a log: INS, INS/GNSS, outages, smoothing, report."),
}

for _name, (_where, _text) in COMMANDS.items():
    app.command(_where, name=_name, help=_text)
