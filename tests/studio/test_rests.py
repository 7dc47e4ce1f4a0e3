"""Rests chosen by hand: a file that the command reads, and the rules of what may stand in it."""

import pytest

from schuler.cli.calibrate_options import spans_of
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.studio.rests import Rest, placed, read_rests, toggled, write_rests

RESTS = [Rest(0.0, 1.0 / 3.0), Rest(1.1, 2.7, accepted=False), Rest(22.0 / 7.0, 4.25)]


def test_the_command_reads_what_is_accepted_and_the_page_all_to_the_last_digit(tmp_path):
    path = tmp_path / "rests.csv"
    write_rests(path, RESTS)
    assert read_rests(path) == RESTS
    t = [0.0, 1.0]
    imu = ImuSeries(t, [[0.0] * 3] * 2, [[0.0] * 3] * 2)
    assert spans_of(path, imu) == [(0.0, 1.0 / 3.0), (22.0 / 7.0, 4.25)]
    assert read_rests(tmp_path / "none.csv") == []


def test_without_a_rest_that_is_accepted_nothing_is_written(tmp_path):
    with pytest.raises(InputError, match="expected rests that are accepted"):
        write_rests(tmp_path / "rests.csv", toggled(RESTS[:1], 0))
    assert not (tmp_path / "rests.csv").exists()
    (tmp_path / "rests.csv").write_text("0.0;1.0\n")
    with pytest.raises(InputError, match="START,STOP"):
        read_rests(tmp_path / "rests.csv")


def test_a_rest_is_moved_added_and_kept_from_others():
    assert toggled(toggled(RESTS, 1), 1) == RESTS
    assert placed(RESTS, 2, 0.5, 1.0) == [RESTS[0], Rest(0.5, 1.0), RESTS[1]]  # in order of time
    assert placed(RESTS, 1, 1.0, 2.0)[1] == Rest(1.0, 2.0, accepted=False)
    assert placed(RESTS, None, 5.0, 6.0)[-1] == Rest(5.0, 6.0)
    assert placed(RESTS, None, 2.7, 3.0)[2] == Rest(2.7, 3.0)  # ends may touch
    for k, start, stop in ((None, 3.5, 5.0), (0, 0.0, 1.2), (None, 2.0, 2.0), (1, -0.1, 1.0)):
        with pytest.raises(InputError):
            placed(RESTS, k, start, stop)
