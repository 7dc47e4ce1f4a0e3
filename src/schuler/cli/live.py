"""``schuler live``."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from schuler.cli.configuration import entries
from schuler.cli.live_output import open_outlets, status_line, stride_sender
from schuler.cli.output import File, Flag, Folder, Texts, print_json, say
from schuler.exceptions import InputError
from schuler.files import check_not_read

if TYPE_CHECKING:
    from schuler.live.clock import SourceClock
    from schuler.live.messages import Event, Solution
    from schuler.live.navigator import LiveNavigator
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.foot.config import FootConfig
    from schuler.recording.series import Kind


def live(
    *source: Annotated[str, Parameter(allow_leading_hyphen=True)],
    config: Path | None = None,
    foot: Flag = False,
    out: Texts = (),
    record: Folder = None,
    output_rate: float = 10.0,
    lag: float = 10.0,
    smoother_lag: float | None = None,
    calibration: Path | None = None,
    state: File = None,
    state_every: float = 60.0,
    stood_still: Flag = False,
    geoid_separation: float = 0.0,
    set: Texts = (),
    headless: Flag = False,
    health: str | None = None,
    json: Flag = False,
) -> int:
    """Navigate streams as they come: serial lines, UDP, TCP, WebSockets, MQTT, stdin, or a log at its pace.

    It ends when all sources have ended, or with Ctrl-C or SIGTERM; what is recorded is complete then.

    Parameters
    ----------
    source
        serial:/dev/ttyUSB0?baud=115200, udp://:PORT, tcp://HOST:PORT, ws://HOST:PORT/PATH, mqtt://HOST:PORT/TOPIC,
        stdin: (or -), or replay:LOG?speed=10 (0: as fast as it goes). Several are navigated together. What may stand
        behind the question mark, such as part=imu, is in docs/live.md.
    config
        TOML file, as of schuler navigate; its [recording] section describes lines of text. Needed, but for --foot.
    foot
        The IMU is on a shoe: the walk, as of schuler foot with filter.smooth = "stride", and by its configuration. The
        solution smoothed by stride goes beside the newest one into lines of json, and into smoothed.parquet of the
        record.
    out
        Where solutions go: FORMAT:PLACE with json or nmea and - (stdout), a file (new or of such lines; it is
        appended to), udp://HOST:PORT, or tcp://HOST:PORT or ws://HOST:PORT for clients to connect to; with all input,
        too: mcap:FILE, or foxglove:ws://HOST:PORT for Foxglove to connect to; mavlink:udp://HOST:PORT for autopilots.
        May be given several times.
    record
        Folder for solution.parquet (then solution-2.parquet, ...) and the bytes of each source as they came.
    output_rate
        Solutions in a second; 0 gives one after every sample.
    lag
        How late a measurement may come, in seconds.
    smoother_lag
        Give the smoothed solution of so many seconds ago, up to 60, beside the newest one: in lines of json, and as
        smoothed.parquet of the record.
    calibration
        File of a calibration of this unit, instead of imu.calibration of the configuration.
    state
        File to go on from, if there is one, and in which the run is saved now and then and at its end.
    state_every
        Seconds between two savings of the state: as much is lost at most when the program is killed.
    stood_still
        The vehicle has not moved since the state was saved, and its IMU stayed on: go on at its place and attitude
        after a pause of up to an hour. Without this the run aligns anew then, with the biases of before.
    geoid_separation
        Height of the geoid above the ellipsoid in metres, for the heights of NMEA and MAVLink.
    set
        Any entry of the configuration: SECTION.KEY=VALUE; may be given several times.
    headless
        Without a status line, for services.
    health
        HOST:PORT (:PORT is of 127.0.0.1) at which HTTP answers with the health of the run as JSON: 200, or 503 after a
        failure or ten seconds without a sample.
    json
        Print one JSON object instead of text.
    """
    from schuler.live.clock import SourceClock
    from schuler.live.endpoint import HealthEndpoint, HealthReport, Watchdog
    from schuler.live.foot import LiveFoot
    from schuler.live.navigator import LiveNavigator
    from schuler.live.session import run_session
    from schuler.live.sources import parse_source
    from schuler.live.wiring import connect
    from schuler.navigation.config import NavigationConfig

    _check_options(source, out, output_rate, state_every, json=json)
    if foot and (state is not None or calibration is not None or smoother_lag is not None):
        raise InputError("--foot has no --state, --calibration or --smoother-lag: a walk is smoothed stride by stride")
    addresses = [parse_source(text) for text in source]
    loaded = _configured(config, entries(set), foot)
    clock, began = SourceClock(), time.monotonic()
    with ExitStack() as held:
        outlets = open_outlets(out, record, clock, geoid_separation, foot or smoother_lag is not None, held)
        sources, outlets.kind = connect(
            addresses, loaded.recording, clock, replayed=lambda log: _read(log, config), kept_in=outlets.keeper(held),
            raw=isinstance(loaded, NavigationConfig) and loaded.gnss.coupling == "tight",
        )  # fmt: skip
        for text in out:
            check_not_read(Path(text.partition(":")[2]))
        stop = held.enter_context(_stopped_by_signals())
        status = held.enter_context(status_line(not headless))
        outlets.sinks.append(status)
        navigator: LiveFoot | LiveNavigator
        if isinstance(loaded, NavigationConfig):
            navigator = _restored(
                state, loaded, outlets.kind, (lag, smoother_lag), calibration, stood_still, clock, outlets.event
            ) or LiveNavigator.from_config(
                loaded, calibration=calibration, lag_s=lag, smoother_lag_s=smoother_lag, kind=outlets.kind,
                on_event=outlets.event,
            )  # fmt: skip
        else:
            send = stride_sender(outlets.smoothed, output_rate)
            navigator = LiveFoot(loaded, kind=outlets.kind, on_event=outlets.event, on_stride=send)

        def save() -> None:
            if state is not None and isinstance(navigator, LiveNavigator):
                navigator.time = clock.base
                navigator.save(state)

        report = HealthReport(lambda: navigator.health)
        if health is not None:
            held.callback(HealthEndpoint(health, report).close)
        outlets.sinks.append(report)
        watchdog = Watchdog()

        def idle(solution: Solution | None) -> None:
            status.draw(solution, navigator.health)
            watchdog.alive()

        summary = run_session(
            sources, navigator, clock, outlets.sinks, smoothed_sinks=() if foot else outlets.smoothed, stop=stop,
            rate_hz=output_rate, every_s=state_every, on_interval=save, on_idle=idle,
            on_message=[*(publisher.message for publisher in outlets.publishers), report.message],
        )  # fmt: skip
        watchdog.notify("STOPPING=1")
        if isinstance(navigator, LiveFoot):
            navigator.finish()
        last = navigator.solution()
        files = outlets.close_tables()
    if json:
        print_json(
            {
                "command": "live", "health": navigator.health, "messages": dict(summary.messages),
                "solutions": summary.solutions, "left_out": dict(summary.left_out),
                "elapsed_s": time.monotonic() - began, "files": files,
            }
        )  # fmt: skip
    else:
        counts = ", ".join(f"{count} {name}" for name, count in summary.messages.items()) or "no messages"
        say(f"ended {navigator.health}: {counts}; {summary.solutions} solutions")
        for name, path in files.items():
            say(f"{name}: {path}")
    return 0 if last is not None and navigator.health != "failed" else 1


def _check_options(
    source: Sequence[str], out: Sequence[str], output_rate: float, state_every: float, *, json: bool
) -> None:
    """Raise InputError for options that are out of range or do not go together."""
    if not source:
        raise InputError("live: expected a source, such as serial:/dev/ttyUSB0 or replay:drive.parquet, got none")
    if not 0.0 <= output_rate <= 10_000.0:
        raise InputError(f"--output-rate: expected solutions in a second from 0 to 10000, got {output_rate:g}")
    if not 0.1 <= state_every <= 86_400.0:
        raise InputError(f"--state-every: expected seconds from 0.1 to 86400, got {state_every:g}")
    if json and any(text.endswith(":-") for text in out):
        raise InputError("--json and --out to stdout: both print there; leave one of them out")


def _restored(
    state: Path | None,
    config: NavigationConfig,
    kind: Kind,
    lags: tuple[float, float | None],
    calibration: Path | None,
    stood_still: bool,
    clock: SourceClock,
    publish: Callable[[Event], None],
) -> LiveNavigator | None:
    """The run of a state file, if there is one; refused if it is of another configuration."""
    from schuler.live.navigator import LiveNavigator

    if state is None or not state.is_file():
        return None
    navigator = LiveNavigator.load(state, calibration=calibration, stood_still=stood_still)
    if (navigator.config, navigator.kind, navigator.lag_s, navigator.smoother_lag_s) != (config, kind, *lags):
        raise InputError(
            f"{state}: the run was saved with another configuration, --lag, --smoother-lag or kind of IMU: give those, "
            "or remove the file to begin anew"
        )
    clock.base, navigator.on_event = navigator.time, publish
    for event in navigator.events:
        publish(event)
    return navigator


def _configured(config: Path | None, changes: Sequence[tuple[str, Any]], foot: bool) -> NavigationConfig | FootConfig:
    """The configuration of a vehicle, or that of a walk, which may be left out."""
    from schuler.files import read_toml
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.foot.config import FootConfig
    from schuler.navigation.sections import change_entry

    if not foot:
        if config is None:
            raise InputError(
                "live: expected --config FILE as schuler navigate has it (schuler init writes one), got none"
            )
        return NavigationConfig.load(config, changes, "--set")
    data = {} if config is None else read_toml(config)
    for key, value in changes:
        change_entry(data, key, value)
    return FootConfig.parse(data, "--set" if config is None else str(config))


def _read(log: Path, config: Path | None) -> Any:
    from schuler.cli.reading import read_log

    return read_log(log, config)


@contextmanager
def _stopped_by_signals() -> Iterator[threading.Event]:
    """Event that Ctrl-C and SIGTERM set, instead of ending the program."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    kept = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
