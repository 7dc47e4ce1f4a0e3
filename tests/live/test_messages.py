"""Messages of a stream have the names and units of a recording's series."""

from dataclasses import fields

import numpy as np
import pytest

from schuler.live import Fix, Heading, Height, ImuBlock, Speed
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries


@pytest.mark.parametrize(
    ("message", "series"),
    [
        (ImuBlock, ImuSeries),
        (Fix, GnssSeries),
        (Speed, OdometerSeries),
        (Heading, ScalarSeries),
        (Height, ScalarSeries),
    ],
)
def test_a_message_is_a_row_of_a_series(message, series):
    names = {f.name for f in fields(message)}
    assert names <= {f.name for f in fields(series)}


def test_a_fix_of_sigmas_has_their_squares():
    fix = Fix.from_sigmas(1.0, (0.7, 0.1, 300.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (0.1, 0.2, 0.3), quality=1)
    np.testing.assert_array_equal(np.diag(fix.cov_r_n), (1.0, 4.0, 9.0))
    np.testing.assert_array_equal(np.diag(fix.cov_v_n), np.square((0.1, 0.2, 0.3)))
    assert fix.quality == 1
    assert Fix.from_sigmas(1.0, (0.7, 0.1, 300.0), (1.0, 2.0, 3.0)).cov_v_n is None
