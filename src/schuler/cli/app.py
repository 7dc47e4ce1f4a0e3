"""The commands, each loaded only when it is called."""

from __future__ import annotations

from importlib.metadata import version

from cyclopts import App

app = App(
    name="schuler",
    help="Inertial navigation workbench: from an IMU log to position, velocity, attitude and honest uncertainty.",
    help_format="plaintext",
    version=lambda: version("schuler"),
    suppress_keyboard_interrupt=False,  # the command line says so itself, and ends with its own code
)

#: Option of every command that writes; the command line takes it before the command sees its own (:func:`.main`).
FORCE = "--force"
#: Option of every command: no prose and no progress on stderr.
QUIET = "--quiet"
_KEPT = f"Files that exist are kept unless {FORCE} is given; what was read is never written over."
_SILENT = f"{QUIET}: only results and errors, no prose and no progress."

#: Name, where it is, the line that ``schuler --help`` shows, and an example. Here, so that help loads no command.
COMMANDS = {
    "demo": (
        "schuler.cli.demo:demo",
        "Simulate a drive with a GNSS outage, navigate it, write a report. Needs no file.",
        "schuler demo --out demo",
    ),
    "info": (
        "schuler.cli.info:info",
        "Say what is in a log.",
        "schuler info drive.csv --columns t,ax,ay,az,gx,gy,gz --units g,deg/s --axes FLU",
    ),
    "check": (
        "schuler.cli.check:check",
        "Find what is wrong with a log by physics: units, axes, signs, clocks; with the option that mends it.",
        "schuler check drive --imu imu.csv --gnss rover.pos --units g,deg/s --axes FLU --time gps-tow:2374",
    ),
    "convert": (
        "schuler.cli.convert:convert",
        "Convert any readable log to Parquet, CSV, .pos, KML, GeoJSON, MCAP, ROS 2 bag, ...",
        "schuler convert drive.csv drive.parquet --columns ax,ay,az,gx,gy,gz,t --units g,deg/s,ms --axes FLU",
    ),
    "allan": (
        "schuler.cli.allan:allan",
        "Identify the noise of an IMU from a log at rest: Allan deviation, model, report, other tools' files.",
        "schuler allan rest.csv --columns t,ax,ay,az,gx,gy,gz --units g,deg/s --axes FLU --export kalibr",
    ),
    "calibrate": (
        "",
        "Calibrate an IMU on a bench or in the field; one method each, see schuler calibrate --help.",
        "schuler calibrate freepose hand.csv --columns t,ax,ay,az,gx,gy,gz --units g,deg/s --axes FLU",
    ),
    "apply": (
        "schuler.cli.apply:apply",
        "Take the errors of a calibration out of a log: corrected log, page before and after.",
        "schuler apply calibration.yaml drive.csv --out corrected.parquet --units g,deg/s --axes FLU",
    ),
    "history": (
        "schuler.cli.history:history",
        "Show all calibrations of a unit over their dates, and what changed beyond its uncertainty.",
        "schuler history calibrations --serial SN-0417",
    ),
    "simulate": (
        "schuler.cli.simulate:simulate",
        "Truth, IMU and GNSS of a scenario in a TOML file.",
        "schuler simulate examples/town.toml --out town.parquet --seed 7",
    ),
    "budget": (
        "schuler.cli.budget:budget",
        "How uncertain a mission will be, which error is to blame, which IMU is good enough. No data needed.",
        'schuler budget examples/budget_town.toml --require "horizontal < 10 m @ 60 s outage"',
    ),
    "observability": (
        "schuler.cli.observability:observability",
        "What a filter can know: ranks, observable states and combinations, over time; any motion, rotating IMUs too.",
        "schuler observability examples/observability_rotary_z_tilted.toml --report",
    ),
    "rotary": (
        "schuler.cli.rotary:rotary",
        "What turning an IMU on a platform brings, and which schedule is best: simulation, figures, search.",
        "schuler rotary examples/rotary_static.toml --search --out rotary",
    ),
    "montecarlo": (
        "schuler.cli.montecarlo:montecarlo",
        "Simulate and navigate a mission many times: scatter, honesty of the filter, on all processors or a cluster.",
        "schuler montecarlo examples/montecarlo_town.toml --runs 200 --store town-runs",
    ),
    "reproduce": (
        "schuler.cli.reproduce:reproduce",
        "Tables and figures of five theses beside ours: printed number, ours, verdict, and why they differ.",
        "schuler reproduce flenniken fig-4.5 --quick",
    ),
    "foot": (
        "schuler.cli.foot:foot",
        "Navigate an IMU on a shoe: rests, strides, the walk and its uncertainty.",
        "schuler foot walk.mat --config examples/foot_mounted.toml",
    ),
    "navigate": (
        "schuler.cli.navigate:navigate",
        "Navigate a log: INS, INS/GNSS, outages, smoothing, report. Without --config it is proposed from the log.",
        "schuler navigate drive.parquet --config drive.toml --outage 120:150",
    ),
    "baseline": (
        "schuler.cli.baseline:baseline",
        "Baseline between two receivers by carrier phases: rover to centimetres, fixed or float, with report.",
        "schuler baseline rover.obs base.obs --nav brdc.nav --base-position 47.4,8.5,440.0",
    ),
    "points": (
        "schuler.cli.points:points",
        "Positions of a satellite receiver by itself, with protection levels; no IMU, no base. RINEX, u-blox, phones.",
        "schuler points rover.obs --nav rover.nav",
    ),
    "live": (
        "schuler.cli.live:live",
        "Navigate streams as they come: serial lines, UDP, TCP, WebSockets, MQTT, stdin, or a log at its pace.",
        "schuler live replay:drive.parquet?speed=10 --config drive.toml --out nmea:udp://:10110",
    ),
    "rerun": (
        "schuler.cli.rerun:rerun",
        "Navigate again what a run folder was made from, and say whether the numbers are the same.",
        "schuler rerun drive-solution",
    ),
    "init": (
        "schuler.cli.init:init",
        "Propose a configuration for a folder of logs and write it, each entry with its evidence.",
        "schuler init drive --imu MPU-6000",
    ),
    "tune": (
        "schuler.cli.tune:tune",
        "Tune the noise of IMU and GNSS from a log's own fixes; write it into the configuration.",
        "schuler tune drive.parquet --config drive.toml",
    ),
    "export": (
        "schuler.cli.export:export",
        "Write the filter of a configuration as C99 for a vehicle's computer, with a test vector.",
        "schuler export c drive.parquet --config drive.toml --out nav",
    ),
    "compare": (
        "schuler.cli.compare:compare",
        "Compare runs of this or other programs; or navigate a log with several architectures: one table.",
        "schuler compare drive-solution rtklib.pos --reference truth.csv --max horizontal_rms_m=1.0",
    ),
    "studio": (
        "schuler.cli.studio:studio",
        "Open the workbench in the browser: look at logs, navigate, plan, compare; on this machine alone, offline.",
        "schuler studio drives",
    ),
    "catalogue": (
        "schuler.cli.catalogue:catalogue",
        "List the IMUs of the catalogue, or show one: each value with unit and page, unknown where unstated.",
        "schuler catalogue MPU-6000",
    ),
    "fetch": (
        "schuler.cli.fetch:fetch",
        "List public recordings with their licences, or fetch one: real data for those who have none.",
        "schuler fetch phone-drive",
    ),
    "explain": (
        "schuler.cli.explain:explain",
        "Explain a term of the field (ARW, NEES, lever arm, ...) with its conversions.",
        "schuler explain ARW",
    ),
    "doctor": (
        "schuler.cli.doctor:doctor",
        "Say whether this installation works: versions, extras, kernels on disk, a short simulated run.",
        "schuler doctor --warm",
    ),
    "config": (
        "schuler.cli.config:config",
        "Write the JSON schema of a navigation configuration, by which editors complete and check.",
        "schuler config schema --out schuler.schema.json",
    ),
    "completion": (
        "schuler.cli.completion:completion",
        "Print the script that completes commands and options in bash, zsh or fish.",
        "schuler completion bash > ~/.local/share/bash-completion/completions/schuler",
    ),
}

#: The methods of ``schuler calibrate``.
METHODS = {
    "sixposition": ("Six faces up in turn.", "schuler calibrate sixposition faces.parquet --latitude 47.4"),
    "multiposition": ("Many poses, no fixture.", "schuler calibrate multiposition poses.parquet --imu imu.toml"),
    "freepose": ("Put down by hand in many poses.", "schuler calibrate freepose hand.csv --units g,deg/s"),
    "ratetable": ("Turned at known rates.", "schuler calibrate ratetable table.csv --rates 30,60"),
    "ferraris": ("Six faces and three turns by hand.", "schuler calibrate ferraris session.csv --units g,deg/s"),
    "poses": ("A table of mean readings, one row a pose.", "schuler calibrate poses means.csv --table-units g,deg/s"),
    "thermal": ("Heated and cooled.", "schuler calibrate thermal chamber.csv --degree 3"),
    "field": (
        "Turned by hand between rests, 39 states.",
        "schuler calibrate field turned.csv --imu MPU-6000 --latitude 39.9 --units g,deg/s",
    ),
}
#: Those that do not stand in the common file.
_ELSEWHERE = {"field": "schuler.cli.calibrate_field:field"}


#: Commands that take hints on how a log is read as options.
HINTED = ("info", "check", "convert", "allan", "calibrate", "apply", "foot", "points")
#: Commands that take hints on how a log is read as entries of a configuration.
CONFIGURED = ("navigate", "init")
#: Commands that write no file.
_READ_ONLY = ("info", "catalogue", "explain", "doctor", "completion")


def _after(name: str, example: str) -> str:
    return f"Example: {example}" + ("" if name in _READ_ONLY else f"\n\n{_KEPT}") + f"\n\n{_SILENT}"


_text, _example = COMMANDS["calibrate"][1:]
calibrate = App(name="calibrate", help=_text, help_epilogue=_after("", _example), help_format="plaintext")
for _name, (_text, _example) in METHODS.items():
    _where = _ELSEWHERE.get(_name, f"schuler.cli.calibrate:{_name}")
    calibrate.command(_where, name=_name, help=_text, help_epilogue=_after("", _example))
for _name, (_where, _text, _example) in COMMANDS.items():
    if _name == "calibrate":
        app.command(calibrate)
    else:
        app.command(_where, name=_name, help=_text, help_epilogue=_after(_name, _example))
