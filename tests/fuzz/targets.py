"""Targets: a format, its hints, and good logs of it that are as small as the reader takes them.

The logs are made by the writers and encoders of ``tests/support/samples.py``, cut short. A target has a folder of its
own; of a log of several files one is replaced by its damaged copy and put back.
"""

import contextlib
import os
import random
import shutil
import signal
import tempfile
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import samples
from tests.fuzz import mutators, oracle

from schuler.diagnosis.run import diagnose
from schuler.exceptions import SchulerError
from schuler.recording import Recording
from schuler.recording.formats import registry
from schuler.recording.io import dispatch, read, write
from schuler.timebase import LeapSecondWarning

CORPUS = Path(__file__).with_name("corpus")
LIMIT_S = 5.0  # of processor time for a log of some kilobytes, compiled code loaded
SHORT_S = 0.5  # of the drive in the seeds

#: Samples that are shorter than their makers make them; the tests on whole files want more rows.
SHORTER = {"android": 24, "sensor_logger": 14, "oan": 14, "vectornav_lines": 14, "vectornav_csv": 20, "xsens_text": 22,
           "waypoint": 17, "kf_gins": 14}  # fmt: skip


class TooLong(BaseException):
    """A reader that does not come back within :data:`LIMIT_S`; no ``except Exception`` stops it."""


@dataclass
class Target:
    """A format with a good log of it in a folder, and which files of it are damaged."""

    name: str
    path: Path
    hints: dict[str, Any]
    members: tuple[Path, ...]
    good: tuple[bytes, ...]
    opened: int = 0
    refused: int = 0
    sentences: set[str] = field(default_factory=set)

    def case(self, seed: int) -> tuple[int, bytes, dict[str, Any]]:
        """The damaged file of a seed: its place among the members, its content, and the hints of reading."""
        rng = random.Random(f"{self.name} {seed}")
        member = rng.randrange(len(self.members))
        hints = self.hints
        draw = rng.random()
        if draw < 0.1:
            hints = {key: value for key, value in hints.items() if key != "allow"}
        elif draw < 0.13:
            hints = {}
        return member, mutators.damage(self.name, self.good[member], rng.getrandbits(48)), hints

    def open(self, member: int, data: bytes, hints: dict[str, Any], listed: bool) -> Recording | None:
        """The recording of a damaged log, ``None`` if it is refused by an error of ours; anything else is a finding."""
        path = self.members[member]
        _replace(path, data)
        try:
            if data and listed:
                registry.held_by(data[: 1 << 16], path)
                _list(data, path)
            recording = read(self.path, **hints)
        except SchulerError as error:
            self.refused += 1
            if not str(error).strip():
                raise AssertionError("an error without a sentence") from error
            return None
        finally:
            _replace(path, self.good[member])
        self.opened += 1
        return recording

    def attempt(
        self, member: int, data: bytes, hints: dict[str, Any], listed: bool | None = None, used: bool | None = None
    ) -> Recording | None:
        """The same, with the law: what opens holds no impossible number, and is described without an error.

        Its streams are ``listed``, as ``schuler info`` does, for a fifth of the logs; a fiftieth is ``used``.
        """
        used = zlib.crc32(data) % 50 == 7 if used is None else used
        recording = self.open(member, data, hints, zlib.crc32(data) % 5 == 0 if listed is None else listed)
        if recording is not None:
            assert isinstance(recording, Recording)
            wrong = oracle.impossible(recording)
            assert not wrong, f"impossible in silence: {'; '.join(wrong)}"
            recording.summary()
            if used:
                self.use(recording)
        return recording

    def use(self, recording: Recording) -> None:
        """What is done with a recording: checked by physics, written, read again; errors of ours are fine."""
        with contextlib.suppress(SchulerError):
            diagnose(recording)
        folder = self.path.parent / f"out-{self.name}"
        folder.mkdir(exist_ok=True)
        for name in ("a.parquet", "a.csv", "a.pos", "a.mcap", "a.kml"):
            with contextlib.suppress(SchulerError):
                write(recording, folder / name)
        shutil.rmtree(folder)


def _replace(path: Path, data: bytes) -> None:
    """Writes in place: h5py and SQLite find the file under the same name."""
    path.write_bytes(data)
    for beside in (path.with_name(path.name + "-journal"), path.with_name(path.name + "-wal")):
        if path.suffix == ".db3":
            beside.unlink(missing_ok=True)


def _list(data: bytes, path: Path) -> None:
    """What ``schuler info`` lists of it."""
    reader = registry.find(data[: 1 << 16], path)
    if hasattr(reader, "contents"):
        with contextlib.suppress(SchulerError):
            reader.contents(path)


def names() -> list[str]:
    """All targets: every format of the registry, every older one, and their variants."""
    return list(samples.ALL)


def make(name: str, folder: Path) -> Target:
    """A target with its good log, in an empty folder; it is read once, so that libraries and kernels are loaded."""
    folder.mkdir(parents=True, exist_ok=True)
    sample = _short_sample(name, folder)
    members = tuple(path for path in sample.damaged if path.is_file())
    target = Target(name, sample.path, dict(sample.hints), members, tuple(path.read_bytes() for path in members))
    assert isinstance(read(target.path, **target.hints), Recording)
    return target


def _short_sample(name: str, folder: Path) -> samples.Sample:
    whole = samples.run
    with pytest.MonkeyPatch.context() as patch:
        if name not in ("pos", "folder", "solution"):
            patch.setattr(samples, "run", lambda seconds=2.0, rate=50.0, kind="rate": whole(SHORT_S, rate, kind))
        if name == "mcap":  # not packed: what is in its chunks is damaged as it is
            samples.module("test_rosbag").json_mcap(folder / "log.mcap", n=12, compression="none")
            return samples.Sample(folder / "log.mcap", {"allow": "norm"})
        sample = samples.make(name, folder)
    if name in SHORTER:
        for path in sample.damaged:
            if b"\x00" not in path.read_bytes():
                samples.first_lines(path, SHORTER[name])
    return sample


@contextlib.contextmanager
def unguarded() -> Iterator[None]:
    """Readers as they are: what they do not foresee is not turned into an error of ours, and warnings are errors."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setattr(dispatch, "guarded", lambda _path: np.errstate())
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", LeapSecondWarning)
        yield


@contextlib.contextmanager
def limited(seconds: float = LIMIT_S) -> Iterator[None]:
    """Processor time that a reader may take; loops inside of libraries are seen by the process that waits."""
    if not hasattr(signal, "SIGPROF"):
        yield
        return

    def stop(*_: Any) -> None:
        raise TooLong(f"no answer within {seconds} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def scratch() -> tempfile.TemporaryDirectory[str]:
    """A folder in memory where the system has one: no disk is worn."""
    memory = Path("/dev/shm")
    return tempfile.TemporaryDirectory(prefix="schuler-fuzz-", dir=memory if os.access(memory, os.W_OK) else None)


def corpus() -> list[tuple[str, str, Path]]:
    """Target, file of its log, and path of every minimised seed: ``corpus/<target>/<what>--<file of the log>``."""
    files = sorted(path for path in CORPUS.rglob("*") if path.is_file())
    return [(path.parent.name, path.name.partition("--")[2], path) for path in files]
