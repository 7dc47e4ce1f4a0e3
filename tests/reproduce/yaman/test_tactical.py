"""Monte Carlo of the field calibration, tactical grade; and rests that are found in the log, as in the field."""

import numpy as np
import pytest

from schuler.reproduce.yaman.study.campaign import field_campaign
from schuler.reproduce.yaman.study.statistics import FieldCampaign
from schuler.reproduce.yaman.study.tables import noise_limit, published
from schuler.units import DEG_PER_HR

#: Below what noise and this routine allow; Table 5.4 lists the gyroscope biases.
NOT_TO_BE_REACHED = {"M_a_xy", "b_g_x", "b_g_z"}


@pytest.fixture(scope="module")
def result() -> FieldCampaign:
    return field_campaign("yaman-tactical", 40, seed=7, rests="given", workers=1)


def test_claimed_uncertainty_is_true(result):
    """Statistical: all tests together fail in one of a hundred campaigns."""
    assert result.complaints() == ()
    assert set(result.status) == {"ok"}
    assert len(result.names) == 21  # no g-sensitivity


def test_scatter_beside_the_source(result):
    """Tables 5.3, 5.4: within twice the source's, but for biases below the noise limit: 0.23 deg/h is not tuned to."""
    for i, name in enumerate(result.names):
        source = published("yaman-tactical", name)
        assert source is not None
        if name not in NOT_TO_BE_REACHED:
            assert result.residual[:, i].std(ddof=1) < 2.0 * source[3], name
    for name in ("b_g_x", "b_g_z"):
        assert result.reason(name) != "above the source"
        assert published("yaman-tactical", name)[3] < noise_limit(result.job.spec, name, 540.0)
    limit = noise_limit(result.job.spec, "b_g_y", 540.0) / DEG_PER_HR
    assert limit < np.median(result.sigma[:, result.column("b_g_y")]) / DEG_PER_HR < 0.40
    for name in ("b_g_y", "M_a_xz", "M_a_yz", "M_g_yy"):
        assert result.reason(name) == "below the source", name


def test_rests_that_are_found_do_as_well():
    """Found rests lose 0.05 to 0.1 s at each edge, those given 0.1 s, and carry nothing of the turns in."""
    result = field_campaign("yaman-automotive", 12, seed=11, rests="found", workers=1)
    assert result.complaints() == ()
    given = field_campaign("yaman-automotive", 2, seed=11, rests="given", workers=1)
    longer = np.median(result.sigma, axis=0) / np.median(given.sigma, axis=0)
    # where the estimates happen to be changes columns by percents
    assert np.all(longer > 0.95)
    assert np.all(longer < 1.05)
