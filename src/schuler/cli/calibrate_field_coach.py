"""The coach of ``schuler calibrate field --coach`` in a terminal: reads a log while it is written, says what to do.

What comes over a serial line or a network is decoded as ``schuler live`` does and kept as a log that grows.
"""

from __future__ import annotations

import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from schuler.cli.output import say
from schuler.cli.reading import Reading, recording_section
from schuler.exceptions import InputError, SchulerError
from schuler.recording.io.hint_texts import triads_in_counts
from schuler.recording.recording import Recording

if TYPE_CHECKING:
    from schuler.calibration.field.coaching import Coach
    from schuler.live.messages import Message
    from schuler.recording.series import ImuSeries
    from schuler.sensors.spec import ImuSpec

_COLUMNS, _UNITS = "t,gx,gy,gz,ax,ay,az", "m/s^2,rad/s"  # of lines on stdin that nothing is said about
_KEPT = Reading(columns=_COLUMNS, units=_UNITS, delimiter="comma")  # samples of a source, forward, right, down
_BINARY = (".parquet", ".npy", ".npz", ".mat", ".ubx")
_RECENT_S = 10.0  # a file that was written to so lately is still being written
_POLL_S = 0.25
_BLOCK_S = 0.5  # of samples that the coach is given at a time
_YOUNG = 200  # lines that a log may need until it can be read
_NEVER_STILL_S = 20.0
_FIRST_LOOK_S = 20.0  # of a log that grows, before it is judged

Say = Callable[[str], None]


def run_coach(
    log: Path,
    spec: ImuSpec,
    *,
    latitude: float,
    height: float = 0.0,
    gravity: float | None = None,
    heading: tuple[float, float] | None = None,
    reading: Reading | None = None,
    follow: bool | None = None,
    bell: bool = False,
    idle_s: float = 60.0,
    keep: Path | None = None,
    stdin: BinaryIO | None = None,
    out: Say = say,
    inspect: Callable[[Recording], None] | None = None,
    **more: Any,
) -> Recording:
    """Coach a person along a log, one line for each event, until there is nothing more to do.

    Parameters
    ----------
    log : Path
        A finished file or folder, a text file that grows, or ``-`` for lines on stdin: time, angular rate, specific
        force (``t gx gy gz ax ay az`` in SI, forward-right-down), or as ``reading`` says. Or the address of a source of
        :mod:`schuler.live.sources`, such as ``serial:/dev/ttyUSB0?baud=115200``, in any format that has a decoder;
        lines of numbers as those of stdin.
    spec, latitude, height, gravity, heading
        As of :class:`schuler.calibration.field.coaching.Coach`. SI, radians.
    reading : Reading, optional
        How the log is read.
    follow : bool, optional
        Wait for more lines; None: if the file was written to in the last ten seconds, and always for stdin.
    bell : bool
        Ring with each advice.
    idle_s : float
        A file that has not grown for so long is taken as finished. [s]
    keep : Path, optional
        Where lines of stdin, or samples of a source in SI, are kept while they come; a number is added if there is
        such a file. Default: ``field-log.txt``.
    stdin : binary file, optional
        In place of the process's own.
    out : callable
        Takes the lines; default: stderr.
    inspect : callable, optional
        Looks at the log once, all of a finished one or the first 20 s of one that grows, and raises if it is garbage.
    **more
        Of :class:`schuler.calibration.field.coaching.Coach`: options, coaching, prior.

    Returns
    -------
    Recording
        The log so far, all of it, to be calibrated: also after Ctrl-C, which ends the coaching.

    Raises
    ------
    InputError
        If there was nothing to read before the coaching ended.
    """
    from schuler.calibration.field.coaching import Coach

    reading, piped = reading or Reading(), is_stream(log)
    pipe: _Pipe | _Wire | None = None
    if piped:
        came, log = log, _unused(keep or Path("field-log.txt"))
        pipe = _Pipe(log, stdin) if str(came) == "-" else _Wire(str(came), log, reading, out)
        out(f"{'lines of stdin' if str(came) == '-' else 'samples'} are kept in {log}")
        reading = _of_stdin(reading) if str(came) == "-" else replace(_KEPT, allow=reading.allow)
    following = _grows(log) if follow is None and not piped else piped or bool(follow)
    source = _Source(log, reading, following)
    lines = _CoachLines(out, bell)
    coach: Coach | None = None
    fed = 0
    inspected = inspect is None
    try:
        while True:
            ended = pipe is None or pipe.ended  # asked before reading: what came until then is read below
            if isinstance(pipe, _Wire):
                pipe.check()
                source.reading = replace(source.reading, kind=pipe.kind)
            if source.newer():
                imu = source.recording().need_imu()
                if inspect is not None and not inspected and (not following or imu.t[-1] - imu.t[0] > _FIRST_LOOK_S):
                    inspect(source.recording())
                    inspected = True
                if coach is None:
                    _need_units(source.recording())
                    coach = Coach(
                        spec, latitude=latitude, height=height, gravity=gravity, heading=heading, kind=imu.kind, **more
                    )  # fmt: skip
                    lines.waiting(coach)
                fed = _feed(coach, imu, fed, lines, to_end=not following)
                if coach.advice.done:
                    break
            elif not following or (ended if piped else source.idle_s > idle_s):
                if coach is not None:
                    _feed(coach, source.recording().need_imu(), fed, lines, to_end=True)
                break
            if following:
                time.sleep(max(_POLL_S, 2.0 * source.took_s))
    except KeyboardInterrupt:
        out("interrupted: calibrating with the log so far")
    if isinstance(pipe, _Wire):
        pipe.stop()
    with suppress(KeyboardInterrupt, SchulerError):
        source.newer()  # what came in the meantime
    recording = source.recording()
    lines.end(coach, recording)
    return recording


def _feed(coach: Coach, imu: ImuSeries, fed: int, lines: _CoachLines, *, to_end: bool) -> int:
    """Give the coach samples in blocks that do not depend on how they came; the number of samples given so far.

    The last block waits until it is complete, unless the log has come to its end.
    """
    while fed < len(imu) and not coach.advice.done:
        stop = max(fed + 1, int(np.searchsorted(imu.t, imu.t[fed] + _BLOCK_S)))
        if stop == len(imu) and not to_end:
            break
        advice = coach.imu(imu.t[fed:stop], imu.gyro[fed:stop], imu.accel[fed:stop])
        fed = stop
        lines.tell(coach, advice is not None, float(imu.t[fed - 1] - imu.t[0]))
    return fed


class _CoachLines:
    """Lines of the coach, each event once."""

    def __init__(self, out: Say, bell: bool) -> None:
        self._out, self._bell = out, "\a" if bell else ""
        self._moving: bool | None = None
        self._since = 0.0

    def waiting(self, coach: Coach) -> None:
        self._out(coach.advice.line())

    def tell(self, coach: Coach, advised: bool, elapsed: float) -> None:
        if advised:
            self._out(self._bell + coach.advice.line())
            self._moving, self._since = False, elapsed
            return
        moving = coach.moving
        if self._moving is not None and moving != self._moving:
            self._out(f"{elapsed:6.1f} s  {'turning' if moving else 'resting: hold it'}")
            self._since = elapsed
        elif elapsed - self._since > _NEVER_STILL_S and (moving or not coach.still_s):
            self._out(f"{elapsed:6.1f} s  no rest for {_NEVER_STILL_S:.0f} s: put it down, or hold it steadier")
            self._since = elapsed
        self._moving = moving

    def end(self, coach: Coach | None, recording: Recording) -> None:
        if coach is None:
            return
        imu = recording.need_imu()
        if coach.advice.done and imu.t[-1] - coach.advice.t > _NEVER_STILL_S:
            self._out(f"the log goes on for {imu.t[-1] - coach.advice.t:.0f} s; all of it is calibrated")
        for line in coach.advice.summary().splitlines()[2:]:
            self._out(line)


class _Source:
    """A log that is read again when it has grown.

    All of it is read each time, so that units, time and axes come out as they will of the finished log; only whole
    lines are, by way of a copy.
    """

    def __init__(self, log: Path, reading: Reading, growing: bool) -> None:
        self._log, self.reading, self._growing = log, reading, growing
        self._recording: Recording | None = None
        self._size, self._grown = -1, time.monotonic()
        self._error: SchulerError | None = None
        self.took_s = 0.0

    @property
    def idle_s(self) -> float:
        return time.monotonic() - self._grown

    def recording(self) -> Recording:
        if self._recording is None:
            raise self._error or InputError(f"{self._log}: expected lines of a log, got none")
        return self._recording

    def newer(self) -> bool:
        """Read, if there is more than before."""
        if not self._growing:
            first = self._recording is None
            if first:
                self._recording = self.reading.read(self._log, uncalibrated=True)
            return first
        size = self._log.stat().st_size if self._log.exists() else 0
        if size <= max(self._size, 0):
            return False
        began = time.monotonic()
        text = self._log.read_bytes()
        text = text[: text.rfind(b"\n") + 1]
        self._size, self._grown = size, began
        lines = text.count(b"\n")
        try:
            with tempfile.TemporaryDirectory() as folder:
                copy = Path(folder) / self._log.name
                copy.write_bytes(text)
                self._recording = self.reading.read(copy, uncalibrated=True, proposing=False)
        except SchulerError as error:
            if lines > _YOUNG:
                raise
            self._error = error
            return False
        finally:
            self.took_s = time.monotonic() - began
        return True


class _Pipe:
    """Lines of stdin, kept in a file as they come."""

    def __init__(self, path: Path, stdin: BinaryIO | None) -> None:
        self.ended = False
        number = 0 if stdin is None else stdin.fileno()
        self._file = path.open("ab", buffering=0)
        # reading the descriptor holds no lock that the interpreter would wait for when it ends
        threading.Thread(target=self._copy, args=(number,), daemon=True).start()

    def _copy(self, number: int) -> None:
        last = b"\n"
        with self._file as file:
            while True:
                try:
                    part = os.read(number, 1 << 16)
                except OSError:
                    part = b""
                if not part:
                    break
                file.write(part)
                last = part[-1:]
            if last != b"\n":
                file.write(b"\n")
        self.ended = True


class _Wire:
    """Samples of a source of ``schuler live``, kept in a file as lines in SI as they come."""

    def __init__(self, address: str, path: Path, reading: Reading, notify: Say) -> None:
        from schuler.live.clock import SourceClock
        from schuler.live.decoders.detection import decoder
        from schuler.live.sources import DATAGRAMS, parse_source
        from schuler.live.wiring import hints_of

        network = re.sub(r"^(udp|tcp|ws|mqtt):/(?=[^/])", r"\1://", address)  # a path has no double slash
        self._address = parse_source(network)
        form = self._address.options.get("format", reading.format)
        reading = _of_stdin(reading) if form == "text" else reading
        section = {**recording_section(reading.config), **{k: v for k, v in reading.given.items() if k != "format"}}
        self._decoder = decoder(
            SourceClock(), hints_of(self._address, section, alone=True), format=form,
            by_arrival=self._address.options.get("stamp") == "arrival", whole=self._address.scheme in DATAGRAMS,
        )  # fmt: skip
        self.ended = False
        self._error: SchulerError | None = None
        self._notify, self._stop = notify, threading.Event()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a", encoding="ascii")
        self._thread = threading.Thread(target=self._copy, daemon=True)
        self._thread.start()

    @property
    def kind(self) -> str | None:
        """Kind of the samples, once it shows."""
        return self._decoder.kind

    def check(self) -> None:
        """Raise what ended the source, such as a device that is no serial line."""
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(5.0)

    def _copy(self) -> None:
        from schuler.live.session import gps_now
        from schuler.live.sources import chunks

        try:
            with self._file:
                for piece in chunks(self._address, self._stop, self._say):
                    self._keep(self._decoder.feed(piece, gps_now()) if piece else self._decoder.pause())
                self._keep(self._decoder.finish())
        except SchulerError as error:
            self._error = error
        self.ended = True

    def _say(self, text: str) -> None:
        self._notify(f"{self._address.text}: {text}")

    def _keep(self, messages: Sequence[Message]) -> None:
        from schuler.live.messages import ImuBlock, ImuSample

        for message in messages:
            if isinstance(message, (ImuSample, ImuBlock)):
                rows = np.column_stack(
                    (np.atleast_1d(message.t), np.atleast_2d(message.gyro), np.atleast_2d(message.accel))
                )
                self._file.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())
        self._file.flush()


def is_stream(log: Path) -> bool:
    """Whether a log is no file: lines on stdin, or the address of a source of ``schuler live``."""
    from schuler.live.sources import SCHEMES

    scheme, colon, _ = str(log).partition(":")
    return str(log) == "-" or (bool(colon) and scheme in SCHEMES and scheme != "replay" and not log.exists())


def _need_units(recording: Recording) -> None:
    """Factors of counts are found from turns that are over; who is coached has none yet."""
    if triads_in_counts(recording.metadata.notes):
        raise InputError(
            "--coach: expected a log in known units, got raw counts; say what a count is with --scale, such as "
            "accel=0.0006,gyro=0.001 of the units stated with --units, or calibrate the finished log without --coach"
        )


def _of_stdin(reading: Reading) -> Reading:
    if reading.columns is None and reading.config is None:
        reading = replace(reading, columns=_COLUMNS)
    return reading if reading.units or reading.config else replace(reading, units=_UNITS)


def _grows(log: Path) -> bool:
    if not log.is_file() or log.suffix.lower() in _BINARY:
        return False
    return time.time() - log.stat().st_mtime < _RECENT_S


def _unused(path: Path) -> Path:
    number, candidate = 1, path
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate
