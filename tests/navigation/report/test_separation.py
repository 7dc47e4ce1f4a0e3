"""Filtered against smoothed: honest where the filter is, and not where it is not; fans of a run's own outages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.navigation.report import accuracy, build, outages, verdict
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Band, Line


def subject_of(run, **over):
    return Subject(run.result, **{"smoothed": run.smoothed, "reference": run.truth, "origin": 0.0, **over})


def test_figure_has_the_difference_and_its_sigma(full):
    figure = accuracy.separation(subject_of(full))
    assert len(figure.panels) == 9
    f, s = full.result, full.smoothed
    gain = f.sigma("dr") ** 2 - s.sigma("dr") ** 2
    # the smoothed place is metres away at most, its axes are the filtered ones to 1e-6
    before = 3.0 * np.sqrt(np.where(gain > 1e-3 * f.sigma("dr") ** 2, gain, np.nan))
    for i, panel in enumerate(figure.panels[:3]):
        (band,) = (x for x in panel.items if isinstance(x, Band))
        assert np.allclose(band.high, before[:, i], rtol=1e-5, equal_nan=True)
        (line,) = (x for x in panel.items if isinstance(x, Line) and x.role == "filtered")
        ned = np.einsum("ji,kj->ki", np.eye(3), f.states.r_eb_e - s.states.r_eb_e)
        assert np.abs(line.y).max() <= np.linalg.norm(ned, axis=1).max() * (1 + 1e-9)
        assert panel.title.startswith("position, inside: ")
        assert panel.y_label.endswith("[m]")
    assert figure.panels[8].y_label == "about down [deg]"


def test_shares_of_honest_runs_are_those_of_a_normal_distribution(make_run):
    """Six runs by different draws of parameters: 95.4 and 99.7 %, with the slack that hundreds of seconds need."""
    two, three = [], []
    for states in (15, 21, 33):
        for windows in (((40.0, 55.0), (70.0, 80.0)), ()):
            run = make_run(states, outages=windows)
            subject = subject_of(run)
            for block in ("dr", "dv", "dpsi"):
                two.append(accuracy.separation_share(subject, subject.apart, block, 2.0))
                three.append(accuracy.separation_share(subject, subject.apart, block))
    # statistical: neighbouring records hang together, some twenty independent ones each
    assert 0.90 < np.mean(two) < 0.99
    assert np.mean(three) > 0.985


def test_an_optimistic_filter_is_detected_without_a_reference(full):
    """Both covariances a hundredth of what they should be, as if all noise were believed ten times smaller."""
    shy = 0.01
    proud = Subject(
        replace(full.result, covariance_e=full.result.covariance_e * shy),
        replace(full.smoothed, covariance_e=full.smoothed.covariance_e * shy),
    )
    assert accuracy.separation_share(proud, proud.apart, "dr") < 0.6
    assert "smoothing moved the position by more than three sigma" in verdict.verdict(proud)[1]
    honest = subject_of(full, reference=None)
    assert "smoothing moved" not in verdict.verdict(honest)[1]
    names = [r.name for r in verdict.key_numbers(honest)[1]]
    assert "filtered minus smoothed position, inside 3 sigma (honest: 99.7) [%]" in names


def test_separation_needs_two_solutions(full):
    assert accuracy.separation(Subject(full.result)) is None
    assert accuracy.separation(Subject(full.smoothed)) is None
    assert build.separation_figures(Subject(full.smoothed, full.smoothed)) == []


def test_unknown_covariances_are_reported_and_not_drawn(full):
    broken = np.full_like(full.smoothed.covariance_e, np.nan)
    subject = Subject(full.result, replace(full.smoothed, covariance_e=broken))
    figure = accuracy.separation(subject)
    assert figure.panels[0].title == "position, inside: not known"
    sentences = verdict.verdict(subject)
    assert "nan" not in " ".join(sentences)
    assert f"the smoothed covariance has negative or unknown variances at {len(broken)} of" in sentences[1]


def test_fan_of_a_runs_own_outages(make_run):
    windows = ((20.0, 30.0), (40.0, 50.0), (60.0, 71.0), (80.0, 83.0))
    subject = subject_of(make_run(15, outages=windows))
    s = outages.statistics(subject)
    # the one of 3 s is left out, and a record ends each
    assert s.starts.tolist() == [20.0, 40.0, 60.0]
    assert s.age.tolist() == np.arange(10.0).tolist()
    e = subject.errors["filtered"]
    assert s.error_n[1, 6] == pytest.approx(np.array([np.interp(46.0, e.t, c) for c in e.position_n.T]))
    sigma = subject.position_sigma(subject.result)
    k = np.argmin(np.abs(subject.result.t - 46.0))
    assert np.sqrt(s.cov_n[1, 6].diagonal()) == pytest.approx(sigma[k], rel=0.2)  # records are 10 ms beside
    assert [f.name for f in build.outage_figures(subject)] == ["outages", "outage_fan"]
    assert outages.outage_fan(subject_of(make_run(15, outages=windows[:2]))) is None
    assert outages.outage_fan(Subject(subject.result)) is None
