"""The corruption suite: of every single fault and of random pairs, how many does the diagnosis name?

Targets, of the issue: 95 % of single faults, 85 % of pairs (both faults named), on a real drive and on a simulated one,
without an alarm on the clean drives. What is missed is counted, not hidden: a failure prints every miss.
"""

from __future__ import annotations

import math

import corruption_drives as drives
import corruptions as suite
import numpy as np
import pytest

from schuler import rotation
from schuler.diagnosis import CODES, diagnose_log
from schuler.diagnosis.run import diagnose

SINGLES, PAIRS = 0.95, 0.85
SEED = 9
CASES = {"single": [(fault,) for fault in suite.FAULTS], "pair": suite.pairs(40, SEED)}


@pytest.fixture(scope="module")
def simulated():
    return drives.simulated()


@pytest.fixture(scope="module")
def real(shared_data):
    return drives.real(shared_data, seconds=300.0)


def found_in(base, faults, seed, folder):
    rng = np.random.default_rng(seed)
    spoilt = suite.apply(base, faults, rng)
    if not any(fault.text for fault in faults):
        return diagnose(spoilt)
    options = suite.write_logs(spoilt, faults, folder, rng)
    return diagnose_log(folder, **options)


def score(base, cases, folder, seed=SEED):
    """Number of cases, those missed, and those with an alarm besides."""
    missed, besides = [], []
    for k, faults in enumerate(cases):
        diagnosis = found_in(base, faults, 1000 * seed + k, folder)
        name = " + ".join(fault.name for fault in faults)
        if not all(fault.named_by(diagnosis) for fault in faults):
            missed.append(f"{name}: got {diagnosis.codes()}")
        if set(diagnosis.codes()) - set().union(*(fault.codes for fault in faults)):
            besides.append(f"{name}: got {diagnosis.codes()}")
    print(f"{len(cases) - len(missed)}/{len(cases)} named, {len(besides)} with another alarm", *missed, sep="\n  ")
    return len(cases), missed, besides


def enough(base, cases, target, folder, seed=SEED):
    number, missed, besides = score(base, cases, folder, seed)
    assert number - len(missed) >= math.ceil(target * number), missed
    assert len(besides) <= 0.1 * number, besides  # measured: one of 66, one of 40 at most


def test_the_suite_is_as_large_as_it_must_be():
    assert len(suite.FAULTS) >= 40
    assert len(suite.BY_NAME) == len(suite.FAULTS)
    assert len(CASES["pair"]) == 40
    assert all(fault.codes <= set(CODES) for fault in suite.FAULTS)
    assert {fault.group for fault in suite.FAULTS} == set(suite.ORDER)
    notes = {
        "clock_unknown",
        "mount",
        "lever_arm",
        "gnss_delay",
        "unchecked",
        "refused",
        "unreadable",
        "velocity_wrong",
    }
    covered = set().union(*(fault.codes for fault in suite.FAULTS))
    assert set(CODES) - covered - notes == set()


def test_the_suite_can_fail(simulated, tmp_path, monkeypatch):
    """A diagnosis that says nothing misses everything, one that always says the same misses the others."""
    cases = CASES["single"][:6]
    silent, parrot = diagnose(simulated), diagnose(suite.apply(simulated, cases[0], None))
    for dull, misses in ((silent, 6), (parrot, 3)):  # three of the six are units of specific force
        monkeypatch.setitem(globals(), "diagnose", lambda recording, dull=dull: dull)
        assert len(score(simulated, cases, tmp_path)[1]) == misses


def test_the_clean_simulated_drive_raises_no_alarm(simulated, tmp_path):
    assert diagnose(simulated).codes() == ()
    assert diagnose_log(tmp_path, **suite.write_logs(simulated, (), tmp_path, None)).codes() == ()


KINDS = [("single", SINGLES), ("pair", PAIRS)]


@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize(("kind", "target"), KINDS)
def test_faults_of_the_simulated_drive_are_named(simulated, tmp_path, kind, target, every):
    """Measured when written: 66 of 66, 40 of 40."""
    enough(simulated, CASES[kind][::every], target, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 11, 12])
def test_other_pairs_of_the_simulated_drive_are_named(simulated, tmp_path, seed):
    """Measured when written: 40, 38 and 39 of 40."""
    enough(simulated, suite.pairs(40, seed), PAIRS, tmp_path, seed)


@pytest.mark.campaign
@pytest.mark.realdata
def test_the_clean_real_drive_raises_no_alarm(real, tmp_path):
    assert diagnose(real).codes() == ()
    assert diagnose_log(tmp_path, **suite.write_logs(real, (), tmp_path, None)).codes() == ()


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize(("kind", "target"), KINDS)
@pytest.mark.thinned(2)
def test_faults_of_the_real_drive_are_named(real, tmp_path, kind, target, every):
    """Measured when written: 66 of 66, 40 of 40."""
    enough(real, CASES[kind][::every], target, tmp_path)


@pytest.mark.realdata
@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 11, 12])
def test_other_pairs_of_the_real_drive_are_named(real, tmp_path, seed):
    """Measured when written: all of 40."""
    enough(real, suite.pairs(40, seed), PAIRS, tmp_path, seed)


@pytest.mark.realdata
@pytest.mark.slow
def test_the_whole_real_drive_raises_no_alarm(shared_data):
    assert diagnose(drives.real(shared_data)).codes() == ()


def test_mount_angles_and_clock_are_estimated_beside_what_is_named(simulated):
    """A sensor turned by 8 deg about its z axis, 0.3 s late: both numbers are told."""
    C = rotation.dcm_from_rpy(np.array([0.0, 0.0, np.radians(8.0)]))
    spoilt = suite._turned(C.T, C.T)(suite._shifted(0.3)(simulated, None), None)
    diagnosis = diagnose(spoilt)
    assert diagnosis.codes() == ("time_offset",), diagnosis.summary()
    estimates = diagnosis.estimates
    # statistical: five of its own standard errors
    assert abs(estimates["time_offset_s"] + 0.3) < 5.0 * estimates["time_offset_sigma_s"] + 0.02
    assert abs(abs(estimates["mount_deg"][2]) - 8.0) < 5.0 * estimates["mount_sigma_deg"][2]
