"""The descriptions of the figures hold the right numbers."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, units
from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.report import accuracy, build, estimates, innovations, outages, track, verdict
from schuler.navigation.report.subject import WITHHELD, Subject, inside_shares
from schuler.plotting.figure import Band, Bars, Line, Markers, Span, Text
from schuler.plotting.parts import number
from schuler.recording.trajectory import Trajectory


def subject_of(run, **over) -> Subject:
    how = {"smoothed": run.smoothed, "reference": run.truth, "truth_parameters": run.parameters, "origin": 0.0, **over}
    return Subject(run.result, **how)


def items(panel, kind, role=None):
    return [i for i in panel.items if isinstance(i, kind) and (role is None or i.role == role)]


@pytest.mark.parametrize(("block", "unit"), [("dr", 1.0), ("dv", 1.0), ("dpsi", units.DEG)])
def test_error_bands_are_three_sigma(full, block, unit):
    figure = accuracy.errors(subject_of(full), block)
    sigma = full.result.sigma(block) / unit
    e = full.result.errors(full.truth)
    value = {"dr": e.position_n, "dv": e.velocity_n, "dpsi": e.attitude_n}[block] / unit
    for i, panel in enumerate(figure.panels):
        (band,) = items(panel, Band)
        assert np.allclose(band.high, 3.0 * sigma[:, i], rtol=1e-12)
        assert np.array_equal(band.low, -band.high)
        (filtered,) = items(panel, Line, "filtered")
        assert np.allclose(filtered.y, value[:, i])
        assert len(items(panel, Line, "smoothed")) == 1
        assert [(s.start, s.stop) for s in items(panel, Span)] == [(40.0, 55.0), (70.0, 80.0)]
        share = inside_shares(e.t, value, full.result.t, sigma)[i]
        assert f"filtered {100.0 * share:.1f}\N{NO-BREAK SPACE}%" in panel.title


def test_share_inside_the_band():
    t = np.arange(10.0)
    error = np.r_[np.full(7, 0.1), 4.0, -4.0, 2.9]
    lost = np.where(t < 8.0, error, np.nan)
    both = inside_shares(t, np.stack((error, lost, np.full(10, np.nan)), axis=1), t, np.ones((10, 3)))
    assert both[:2] == pytest.approx([0.8, 0.875])  # of two errors that are not known, one was outside
    assert np.isnan(both[2])
    # just before the fix that ends an outage the sigma of the outage holds
    records, sigma = np.array([1.0, 2.0]), np.array([[10.0], [0.1]])
    assert inside_shares(np.array([1.9]), np.array([[20.0]]), records, sigma) == 1.0
    assert inside_shares(np.array([2.0]), np.array([[20.0]]), records, sigma) == 0.0
    assert np.isnan(inside_shares(np.array([5.0]), np.array([[0.0]]), records, sigma))
    assert np.isnan(inside_shares(t, error[:, None], np.empty(0), np.empty((0, 1))))


def test_origin_moves_the_time_axes_and_nothing_else(full):
    panel = accuracy.horizontal(subject_of(full)).panels[0]
    moved = accuracy.horizontal(subject_of(full, origin=-1000.0)).panels[0]
    assert moved.x_limits[0] == pytest.approx(panel.x_limits[0] + 1000.0)
    a, b = items(panel, Line)[0], items(moved, Line)[0]
    assert np.allclose(b.x - a.x, 1000.0)
    assert np.array_equal(a.y, b.y)
    assert subject_of(full, origin=None).span[0] == 0.0


def test_track_is_metres_about_the_first_point(full):
    (panel,) = track.track(subject_of(full)).panels
    assert panel.equal
    T = full.result.trajectory
    ned = frames.ned_from_ecef(T.r_eb_e, T.llh[0])
    (line,) = items(panel, Line, "filtered")
    assert line.x.max() == pytest.approx(ned[:, 1].max())
    assert line.y.min() == pytest.approx(ned[:, 0].min())
    start, end = items(panel, Markers, "start")[0], items(panel, Markers, "end")[0]
    assert (start.x[0], start.y[0]) == pytest.approx((0.0, 0.0), abs=1e-6)  # rounding of ECEF metres
    assert (end.x[0], end.y[0]) == pytest.approx((ned[-1, 1], ned[-1, 0]))
    (lost,) = items(panel, Line, "outage")
    assert np.isnan(lost.x).any()
    (bar,) = items(panel, Line, "scale")
    assert f"{np.ptp(bar.x):g} m" in [w.text for w in items(panel, Text)]


def test_fixes_are_recovered_from_the_innovations(full):
    """A fix is the prediction plus the innovation: to a centimetre what the receiver said, at the IMU."""
    given = subject_of(full, gnss=full.gnss)
    t, r, status = given.fixes
    t_found, r_found, status_found = subject_of(full).fixes
    assert np.all(status_found == ACCEPTED)
    k = np.searchsorted(t, t_found)
    assert np.allclose(t[k], t_found)
    # given fixes are moved to the IMU with the attitude after the update, the others with the one before: half a degree
    assert np.abs(r[k] - r_found).max() < 0.05
    withheld = status == WITHHELD
    assert withheld.sum() == 25
    assert np.all(((t[withheld] >= 40) & (t[withheld] < 55)) | ((t[withheld] >= 70) & (t[withheld] < 80)))
    labels = {i.label for i in track.track(given).panels[0].items if isinstance(i, Markers) and i.label}
    assert labels == {"GNSS fix", "GNSS fix withheld", "start", "end"}


def test_rejected_and_forced_fixes_are_marked(wild):
    subject = subject_of(wild)
    (panel,) = track.track(subject).panels
    counts = wild.result.innovations.counts()["position"]
    assert counts["rejected"] >= 4
    assert counts["accepted after lock-out"] >= 1
    assert len(items(panel, Markers, "rejected")[0].x) == counts["rejected"]
    assert len(items(panel, Markers, "forced")[0].x) == counts["accepted after lock-out"]
    figure = innovations.by_component(subject, "position")
    for p in figure.panels:
        assert len(items(p, Markers, "rejected")[0].x) == counts["rejected"]
        assert len(items(p, Markers, "forced")[0].x) == counts["accepted after lock-out"]
    assert f"rejected {sum(wild.result.innovations.rejected().values())} of" in verdict.verdict(subject)[1]


def test_innovations_and_their_squares(full):
    inn = full.result.innovations.of("velocity")
    figure = innovations.by_component(subject_of(full), "velocity")
    for i, panel in enumerate(figure.panels[:3]):
        assert np.allclose(items(panel, Markers)[0].y, inn.innovation[:, i])
        band = items(panel, Band)[0]
        given = np.isfinite(band.high)
        assert np.allclose(band.high[given], 3.0 * inn.sigma[:, i])
        assert panel.y_label.endswith("[m/s]")
    last = figure.panels[3]
    assert last.log
    assert np.allclose(items(last, Markers)[0].y, inn.nis / 3.0)
    band = items(last, Band)[0]
    assert (band.low[0], band.high[0]) == chi_square_band(3)
    assert f"mean {np.mean(inn.nis) / 3.0:.2f}" in last.title


def test_a_few_wild_innovations_do_not_flatten_the_rest(rng):
    innovation = rng.standard_normal(1000)
    innovation[[3, 500]] = 400.0, -70.0
    limit, beyond = innovations.reach(innovation, np.full(1000, 3.0))
    assert 3.0 < limit < 5.0
    assert beyond == 2
    assert innovations.reach(np.zeros(5), np.full(5, 3.0)) == (pytest.approx(3.3), 0)
    assert innovations.reach(np.full(2, np.nan), np.full(2, np.nan)) == (1.0, 0)


def test_running_mean_is_centred():
    values = np.arange(200.0)
    mean, width = innovations.running_mean(values)
    assert width == 11
    given = np.isfinite(mean)
    assert given.sum() == 200 - width + 1
    assert np.allclose(mean[given], values[given])
    short, width = innovations.running_mean(np.ones(5))
    assert np.isnan(short).all()
    assert width > 5


def test_parameters_in_data_sheet_units(full):
    subject = subject_of(full)
    figure = estimates.parameters(subject, "b_a")
    value, sigma = full.result.parameter("b_a") / units.MG, full.result.sigma("b_a") / units.MG
    for i, panel in enumerate(figure.panels):
        assert panel.y_label == f"{'xyz'[i]} [mg]"
        assert np.allclose(items(panel, Line, "filtered")[0].y, value[:, i])
        assert np.allclose(items(panel, Band, "sigma")[0].high, value[:, i] + 3.0 * sigma[:, i])
        true = items(panel, Line, "reference")[0]
        assert np.allclose(true.y, full.parameters[:, i] / units.MG)
    assert estimates.parameter(full.result, "b_g").unit == "deg/s"
    small = replace(full.result, parameters=full.result.parameters * 1e-4)
    assert estimates.parameter(small, "b_g").unit == "deg/h"
    rows = estimates.parameter_rows(subject)
    assert len(rows) == 6
    assert rows[0][0] == "accelerometer bias x [mg]"
    estimate, spread = (float(v) for v in rows[0][1].split(" ± "))
    assert spread == pytest.approx(sigma[-1, 0], rel=0.06)
    assert estimate == pytest.approx(value[-1, 0], abs=0.06 * sigma[-1, 0])


def test_every_block_has_a_name_a_unit_and_its_elements(make_run):
    run = make_run(45, outages=())
    shown = {b: estimates.parameter(run.result, b) for b in run.result.layout.models}
    for block, p in shown.items():
        assert len(p.elements) == run.result.parameter(block).shape[1], block
        assert "," not in p.name
    assert {b: p.unit for b, p in shown.items()} == {
        "b_a": "mg", "b_g": "deg/s", "S_a": "ppm", "S_g": "ppm", "M_a6": "mrad", "M_g": "mrad",
        "G_g": "deg/h/g", "lever": "m",
    }  # fmt: skip
    assert shown["G_g"].elements[1] == "xy"
    assert len(build.parameter_figures(subject_of(run))) == 8


def test_outages_and_drift(full):
    figure = outages.outage_figure(subject_of(full))
    bars, drift = figure.panels
    e = full.result.errors(full.truth)
    expected = [e.between(a, b).max_horizontal for a, b in full.result.outages]
    assert np.allclose(items(bars, Bars, "filtered")[0].height, expected)
    assert len(items(drift, Line)) == 4
    assert items(drift, Line, "filtered")[0].x.max() <= 15.0


def test_nees_figure_needs_the_whole_truth(full):
    figure = accuracy.normalised_errors(subject_of(full))
    (panel,) = figure.panels
    assert np.allclose(items(panel, Line, "filtered")[0].y, full.result.nees(full.truth, full.parameters))
    band = items(panel, Band)[0]
    assert (band.low[0], band.high[0]) == chi_square_band(15)
    partial = Trajectory(full.truth.t, full.truth.r_eb_e)
    assert accuracy.normalised_errors(subject_of(full, reference=partial, truth_parameters=None)) is None
    assert [f.name for f in build.error_figures(subject_of(full, reference=partial))] == [
        "horizontal_error",
        "position_error",
    ]


def test_reference_made_of_the_fixes_widens_the_band_by_theirs(full):
    g = full.gnss
    fixes = Trajectory.from_geodetic(g.t, g.llh, g.v_n)
    subject = subject_of(full, reference=fixes, at_antenna=True, truth_parameters=None)
    assert subject.reference_is_fixes
    sigma = subject.position_sigma(full.result)
    own = full.result.sigma("dr")
    assert np.all(sigma > own)
    # the fixes have 0.8, 0.8, 1.5 m; the innovations a little more
    assert np.all(np.sqrt(np.median(sigma**2 - own**2, axis=0)) > [0.75, 0.75, 1.4])
    assert np.all(subject.inside_three_sigma["filtered"] > 0.97)
    assert "the GNSS fixes" in verdict.verdict(subject)[0]
    assert subject.nees is None


def test_lever_arm_uncertainty_goes_into_the_antennas_band(full):
    """Position of the antenna: dr + dpsi x (C l), checked against draws."""
    reference = full.truth.moved_by(full.result.lever_arm_b)
    subject = subject_of(full, reference=reference, at_antenna=True, truth_parameters=None)
    assert not subject.reference_is_fixes
    k = 3
    C = frames.C_en(full.result.states.llh[k])
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(9), full.result.covariance_e[k][:9, :9], 200_000)
    arm = full.result.states.at(full.result.t[[k]]).C_nb[0] @ full.result.lever_arm_b
    moved = draws[:, 6:9] @ C + np.cross(draws[:, 0:3] @ C, arm)
    assert np.allclose(subject.position_sigma(full.result)[k], moved.std(axis=0), rtol=0.01)


def test_key_numbers_are_those_of_the_analysis(full):
    heads, rows = verdict.key_numbers(subject_of(full))
    assert heads == ("filtered", "smoothed")
    table = {r.name: r.values for r in rows}
    e = full.result.errors(full.truth)
    assert table["horizontal error, RMS [m]"][0] == number(e.rms_horizontal)
    assert table["horizontal error, largest [m]"][1] == number(full.smoothed.errors(full.truth).max_horizontal)
    with_gnss = (e.t < 40) | ((e.t > 55) & (e.t < 70)) | (e.t > 80)
    expected = float(np.sqrt(np.mean(e.horizontal[with_gnss] ** 2)))
    assert table["horizontal error with GNSS, RMS [m]"][0] == number(expected)
    assert [row[0] for row in verdict.outage_rows(subject_of(full))] == ["1", "2"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.000"), (1234.5, "1234"), (12.34, "12.3"), (-1.234, "-1.23"), (0.1234, "0.123"), (4e-5, "4e-05")],
)
def test_numbers_have_three_digits(value, text):
    assert number(value) == text
    assert number(None) == number(float("nan")) == "-"


def test_verdict_tells_a_proud_filter_from_an_honest_and_a_shy_one(full):
    def words(factor: float) -> str:
        scaled = replace(full.result, covariance_e=full.result.covariance_e * factor)
        return verdict.verdict(Subject(scaled, reference=full.truth))[1]

    assert "can be believed" in words(1.0)
    assert "too sure of itself" in words(0.01)
    assert "too cautious" in words(100.0)


def test_verdict_has_four_sentences_in_every_case(full, wild, make_run):
    free = make_run(gnss=False, outages=())
    cases = [
        subject_of(full), subject_of(wild), subject_of(free), Subject(full.result), Subject(free.result),
        Subject(full.smoothed),
    ]  # fmt: skip
    for subject in cases:
        sentences = verdict.verdict(subject)
        assert len(sentences) == 4
        assert all(s.endswith(".") and s[0].isupper() and "nan" not in s for s in sentences), sentences
    assert "No GNSS position was used" in verdict.verdict(subject_of(free))[2]
    assert "never withheld" in verdict.verdict(subject_of(wild))[2]
    assert "withheld 2 times for 10 to 15 s" in verdict.verdict(subject_of(full))[2]


def test_negative_variances_are_said_and_not_drawn(full):
    broken = full.result.covariance_e.copy()
    broken[5, 6:9, 6:9] *= -1.0
    subject = Subject(replace(full.result, covariance_e=broken), reference=full.truth)
    assert "negative or unknown variances at 1 of" in verdict.verdict(subject)[1]
    assert np.isnan(items(accuracy.errors(subject, "dr").panels[0], Band)[0].high).sum() == 1


def test_heading_is_not_drawn_through_its_jump(full):
    heading = track.motion(subject_of(full)).panels[4]
    for line in items(heading, Line):
        assert np.nanmax(np.abs(np.diff(line.y))) < 180.0
        assert np.nanmin(line.y) >= 0.0
        assert np.nanmax(line.y) <= 360.0


def test_wrong_companions_are_refused(full, wild):
    other = replace(wild.smoothed, t=wild.smoothed.t[:-3])
    with pytest.raises(InputError, match="same run"):
        Subject(full.result, other)
    with pytest.raises(InputError, match=r"truth_parameters: expected shape \(6,\)"):
        Subject(full.result, truth_parameters=np.zeros(5))


def test_status_codes_are_the_ones_drawn():
    assert {ACCEPTED, REJECTED, FORCED, WITHHELD} <= set(track.FIXES)
