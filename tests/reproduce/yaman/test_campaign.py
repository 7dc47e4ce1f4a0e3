"""Monte Carlo of the field calibration, automotive grade: the claims of the full campaign in standard errors.

A campaign of 60 runs here, of 1000 where marked slow; numbers of the full one are in docs/field-validation.md.
Statistical tolerances: with so many parameters looked at, 4 standard errors for each, 3 where the issue asks for them.
"""

import csv
from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.field.options import FieldOptions
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.reproduce.yaman.study.bound import information_bound
from schuler.reproduce.yaman.study.campaign import field_campaign
from schuler.reproduce.yaman.study.runs import FieldJob
from schuler.reproduce.yaman.study.statistics import FieldCampaign
from schuler.reproduce.yaman.study.tables import GRADES, noise_limit, published
from schuler.sensors import catalogue
from schuler.simulation.steps import Rest, Routine, Turn
from schuler.units import DEG, DEG_PER_HR_PER_G

DIAGONAL = ("G_g_xx", "G_g_yy", "G_g_zz")
ACCEL = ("b_a_x", "b_a_y", "b_a_z", "M_a_xx", "M_a_yy", "M_a_zz", "M_a_xy", "M_a_xz", "M_a_yz")
#: Below what noise allows, for this routine: Table 5.4 lists the first and the last two.
NOT_TO_BE_REACHED = {
    "yaman-automotive": {"M_a_xy", "M_a_yz"},
    "yaman-tactical": {"M_a_xy", "b_g_x", "b_g_z"},
}


#: Above the source although the bound allows less.
KNOWN_ABOVE: dict[str, set[str]] = {"yaman-automotive": set(), "yaman-tactical": set()}


def check_beside_the_source(result: FieldCampaign) -> None:
    """Tables 5.3, 5.4: (a) within twice the source's scatter, (c) half its improvement, with its exceptions."""
    for i, name in enumerate(result.names):
        source = published(result.job.spec.name, name)
        assert source is not None
        std = result.residual[:, i].std(ddof=1)
        if name not in NOT_TO_BE_REACHED[result.job.spec.name]:
            assert std < 2.0 * source[3], name
            assert result.modelled[:, i].std(ddof=1) / std > 0.5 * source[1] / source[3], name
        limit = noise_limit(result.job.spec, name, result.job.routine.duration)
        if limit is not None:  # 4 sampling sigmas
            assert std > limit * (1.0 - 4.0 * np.sqrt(0.5 / len(result))), name


@pytest.fixture(scope="module")
def result() -> FieldCampaign:
    return field_campaign("yaman-automotive", 60, seed=7, rests="given", workers=1)


def test_claimed_uncertainty_is_true(result):
    assert result.complaints() == ()
    assert set(result.status) == {"ok"}
    assert 2.0 <= result.passes.mean() < 5.0


def test_what_is_wrong_is_said(result):
    """Covariances a quarter too small, one mean off by a sigma, a run lost."""
    small = replace(result, covariance=0.75 * result.covariance)
    assert any("NEES" in message for message in small.complaints())
    estimate = result.estimate.copy()
    estimate[:, 3] += result.sigma[:, 3]
    biased = replace(result, estimate=estimate)
    assert any(message.startswith(f"{result.names[3]}: mean") for message in biased.complaints())
    covariance = result.covariance.copy()
    covariance[:, 4, :] *= 0.5
    covariance[:, :, 4] *= 0.5
    assert any(
        message.startswith(f"{result.names[4]}: scatter")
        for message in replace(result, covariance=covariance).complaints()
    )
    assert replace(result, failed=((3, "no rest"),)).complaints()[-1] == "1 runs failed"


def test_nees_in_closed_form(result):
    """Without correlations the mean of squares, and unchanged by a change of parameters. Rounding."""
    diagonal = replace(result, covariance=np.einsum("ki,ij->kij", result.sigma**2, np.eye(len(result.names))))
    assert diagonal.nees == pytest.approx(np.mean(result.normalised**2, axis=1), rel=1e-9)
    A = np.random.default_rng(1).standard_normal((30, 30)) / result.prior_sigma
    mixed = replace(
        result, estimate=result.residual @ A.T, modelled=0.0 * result.modelled, covariance=A @ result.covariance @ A.T
    )
    assert mixed.nees == pytest.approx(result.nees, rel=1e-5)
    assert result.nees_band(0.95) == pytest.approx(chi_square_band(30, 60))


def test_means_the_source_has_biased_are_zero(result):
    """Accelerometers by linearisation (up to 32 of its standard errors), G_g's diagonal by Earth rate: within three."""
    for name in (*ACCEL, *DIAGONAL):
        mean, error = result.mean(name)
        assert abs(mean) < 3.0 * error, name


def test_scatter_beside_the_source(result):
    check_beside_the_source(result)
    for name in ("b_a_y", "b_a_z", "M_a_xx", "M_a_yy", "M_a_zz", "b_g_x", "b_g_y", "b_g_z", "M_g_yy", *DIAGONAL):
        assert result.reason(name) == "below the source", name
    for name in NOT_TO_BE_REACHED["yaman-automotive"]:
        assert "not to be reached" in result.reason(name)


def test_claims_are_at_the_bound_of_an_independent_recursion(result):
    """To 2 % of it with rests known to 0.1 s: blocks of a second, and linearised where estimates are, not the truth."""
    job = result.job
    bound = information_bound(job.spec, job.routine, job.place, heading_sigma=job.heading_sigma, settle_s=0.1)
    best = result.bound()
    for name, sigma in zip(result.names, np.median(result.sigma, axis=0), strict=True):
        assert 0.98 < sigma / bound[name] < 1.02, name
        assert sigma > 0.98 * best[name], name


def test_the_source_s_artefacts_are_there_in_its_form():
    """P2 as printed takes Earth rate for g-sensitivity, and one pass bends the scale factors, as in tables 5.3, 5.4."""
    printed = field_campaign("yaman-automotive", 16, seed=7, options=FieldOptions.thesis(), rests="given", workers=1)
    for name in DIAGONAL:
        mean, error = printed.mean(name)
        # estimate minus truth: plus here, minus there
        assert 7.0 < mean / DEG_PER_HR_PER_G < 12.0
        assert mean > 6.0 * error
    signs = [(name, np.sign(published("yaman-automotive", name)[2])) for name in ("M_a_xx", "M_a_yy", "M_a_zz")]
    for name, sign in signs:
        mean, error = printed.mean(name)
        assert sign * mean > 2.0 * error, name
    assert printed.nees.mean() > 3.0 * chi_square_band(30, 16)[1]


def test_grades_share_their_draws(result):
    other = field_campaign("yaman-tactical", 2, seed=7, rests="given", workers=1)
    for k, name in enumerate(other.names):
        i = result.column(name)
        ratio = result.modelled[:2, i] / other.modelled[:, k]
        assert ratio == pytest.approx(result.prior_sigma[i] / other.prior_sigma[k], rel=1e-9)


def test_run_k_is_run_k_whatever_their_number_and_processes(result):
    few = field_campaign("yaman-automotive", 3, seed=7, rests="given", workers=2)
    assert few.run.tolist() == [0, 1, 2]
    # rounding: linear algebra of another number of threads may add in another order
    assert few.estimate == pytest.approx(result.estimate[:3], rel=1e-6, abs=1e-9)
    assert few.workers == 2


def test_tables_and_files(result, tmp_path):
    table = result.table()
    assert table.column("parameter") == list(result.names)
    row = table.row(parameter="b_g_x")
    assert row["unit"] == "deg/h"
    assert row["residual_std"] < row["modelled_std"] / 50.0
    assert row["low"] < row["scatter_over_claimed"] < row["high"]
    assert "NEES" in result.summary()
    assert "Beside Yaman (2017)" in result.summary()
    assert result.to_dict()["thesis"]["rows"][0]["source_std"] == pytest.approx(0.092)
    with result.to_csv(tmp_path / "runs.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 60
    assert float(rows[5]["residual_M_g_xy"]) == pytest.approx(result.residual[5, result.column("M_g_xy")])
    histogram = result.histogram("M_a_xx", bins=10)
    assert histogram.unit == "ppm"
    assert histogram.modelled_count.sum() == histogram.residual_count.sum() == 60
    assert histogram.residual_edges[-1] < 0.1 * histogram.modelled_edges[-1]


def test_ctrl_c_keeps_what_is_finished():
    def impatient(share: float) -> None:
        if share > 0.25:
            raise KeyboardInterrupt

    short = Routine(tuple(s for _ in range(4) for s in (Rest(6.0), Turn("x", 90.0 * DEG, 2.0))))
    kept = field_campaign("yaman-automotive", 10, routine=short, rests="given", workers=1, progress=impatient)
    assert not kept.complete
    assert kept.run.tolist() == [0, 1, 2]
    assert "INTERRUPTED" in kept.summary()
    with pytest.raises(KeyboardInterrupt):  # too early: nothing to keep
        field_campaign(
            "yaman-automotive", 50, routine=short, rests="given", workers=1, progress=lambda share: impatient(1.0)
        )


def test_what_cannot_be_a_campaign_is_refused():
    with pytest.raises(InputError, match="two or more"):
        field_campaign("yaman-automotive", 1)
    with pytest.raises(InputError, match="workers"):
        field_campaign("yaman-automotive", 2, workers=0)
    with pytest.raises(InputError, match="'found' or 'given'"):
        field_campaign("yaman-automotive", 2, rests="guessed")
    with pytest.raises(InputError, match="heading_sigma"):
        FieldJob(catalogue.spec("yaman-automotive"), heading_sigma=0.0)
    with pytest.raises(InputError, match=r"0 of 2 runs could be calibrated.*no rest"):
        field_campaign("yaman-automotive", 2, routine=Routine((Turn("x", 20.0, 40.0),)), workers=1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("grade", GRADES)
def test_full_campaign(grade, capsys):
    """1000 runs a grade, rests found in the log: four to eight minutes on two processors."""
    full = field_campaign(grade, 1000, seed=1)
    with capsys.disabled():
        print("\n" + full.summary(), "\nabove the source:", full.above())
    assert full.complaints() == ()
    check_beside_the_source(full)
    assert set(full.above()) <= KNOWN_ABOVE[grade]
    low, high = full.nees_band()
    assert low < full.nees.mean() < high
    if grade == "yaman-automotive":
        test_means_the_source_has_biased_are_zero(full)
