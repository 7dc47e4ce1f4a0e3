"""The minimised seeds of all that was ever found, and some damaged logs of every target: the law of readers.

An error of ours or a recording without an impossible number, within the time; no foreign exception, no warning.
The campaign (``-m fuzz``; an hour by ``python -m tests.fuzz``) is on the page docs/project/fuzzing.md.
"""

import os
import time
from collections import defaultdict

import numpy as np
import pytest
from tests.fuzz import campaign, mutators, oracle, targets

from schuler.recording.io import read

for library in ("rosbags", "pyulog", "h5netcdf", "mcap", "hatanaka"):
    pytest.importorskip(library)

SEEDS = defaultdict(list)
for _target, _file, _path in targets.corpus():
    SEEDS[_target].append((_file, _path))
LARGEST = 4096  # of a seed [byte]


def test_seeds_are_small_and_of_a_target():
    assert set(SEEDS) <= set(targets.names())
    large = [path.name for seeds in SEEDS.values() for _, path in seeds if path.stat().st_size > LARGEST]
    assert large == []


@pytest.mark.parametrize("name", sorted(SEEDS))
def test_what_was_found_stays_closed(name, tmp_path):
    """Every seed with the hints of its target and with none."""
    with targets.unguarded():
        target = targets.make(name, tmp_path)
        places = {path.name: k for k, path in enumerate(target.members)}
        for file, path in SEEDS[name]:
            member = places.get(file, 0)
            for hints in (target.hints, {}):
                with targets.limited():
                    target.attempt(member, path.read_bytes(), hints, listed=True)


@pytest.mark.thinned(6)
@pytest.mark.parametrize("name", targets.names())
def test_damage_that_knows_the_format(name, tmp_path):
    """Twenty damaged logs of each target; the campaign has hundreds of thousands."""
    with targets.unguarded():
        target = targets.make(name, tmp_path)
        for seed in range(-20, 0):
            try:
                with targets.limited():
                    target.attempt(*target.case(seed))
            except BaseException as error:
                error.add_note(f"{name}, seed {seed}")
                raise
        assert target.opened + target.refused == 20


@pytest.mark.fuzz
def test_a_campaign_finds_nothing(capsys):
    """Half a minute over all targets; ``SCHULER_FUZZ_MINUTES=60`` makes it an hour. Prints counts and findings."""
    done = campaign.run(targets.names(), minutes=float(os.environ.get("SCHULER_FUZZ_MINUTES", "0.5")), first=10**6)
    with capsys.disabled():
        print(done.table())
    assert not done.findings


# The harness: it must see what it is there to see


def test_damage_is_the_same_for_a_seed(tmp_path, monkeypatch):
    monkeypatch.setattr("time.localtime", lambda *_: time.gmtime(1e9))  # a zip keeps when it was written
    for name in ("nmea", "sbet", "npz"):
        one, other = (targets.make(name, tmp_path / folder / name) for folder in "ab")
        assert [one.case(seed) for seed in range(40)] == [other.case(seed) for seed in range(40)]
        assert len({one.case(seed)[1] for seed in range(40)}) > 30


def test_sealed_frames_pass_the_checksums(tmp_path):
    """Frames that are cut out and sealed again unchanged are the log; most damaged ones reach the reader."""
    from tests.fuzz.framing import FRAMINGS

    for name in ("ubx", "sbf", "novatel", "xsens", "vectornav", "sbg", "nmea", "px4", "mcap", "rosbag"):
        target = targets.make(name, tmp_path / name)
        framing = FRAMINGS[name][0]
        pieces = framing.split(target.good[0])
        frames = [piece for piece in pieces if len(piece) >= framing.head + framing.tail]
        if name == "ubx":
            frames = [piece for piece in frames if not mutators.is_text(piece)]  # a sentence of NMEA
        assert len(frames) > 4, name
        assert [framing.seal(frame) for frame in frames] == frames, name


@pytest.mark.parametrize(
    ("what", "spoil"),
    [
        ("imu.accel", lambda r: r.imu.accel.__setitem__((3, 0), -9.8e15)),
        ("imu.gyro", lambda r: r.imu.gyro.__setitem__((3, 0), np.nan)),
        ("gnss.llh", lambda r: r.gnss.llh.__setitem__((0, 2), 1e9)),
        ("reference.r_eb_e", lambda r: r.reference.r_eb_e.__setitem__((1, 2), np.inf)),
        ("imu: times", lambda r: r.imu.t.__setitem__(3, 0.0)),
    ],
)
def test_impossible_numbers_are_noticed(tmp_path, what, spoil):
    target = targets.make("parquet", tmp_path)
    recording = read(target.path)
    assert oracle.impossible(recording) == []
    spoil(recording)
    assert any(sentence.startswith(what) for sentence in oracle.impossible(recording))


def test_a_reader_without_an_end_is_noticed():
    def circle():
        while True:
            pass

    with targets.limited(0.1), pytest.raises(targets.TooLong):
        circle()


def test_text_is_damaged_as_text():
    good = b"t,x\n1.5,2.5\n2.5,3.5\n"
    assert mutators.is_text(good)
    assert not mutators.is_text(b"\x00\x01")
