"""Figure of the nine modes: rows are those of the table, with their spread and the source's."""

import numpy as np
import pytest

from schuler.plotting.figure import Line, Markers
from schuler.reproduce.yaman.study.mode_figures import modes
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, mode_name
from schuler.reproduce.yaman.study.unit_drives import FieldDrives


@pytest.fixture(scope="module")
def drives() -> FieldDrives:
    rms = np.random.default_rng(3).lognormal(2.0, 1.0, (21, len(MODES), len(QUANTITIES)))
    return FieldDrives(2, "repeatability", "full", rms, np.ones((21, 2, 2)))


def only(panel, label):
    (item,) = [i for i in panel.items if isinstance(i, Markers) and i.label == label]
    return item


def test_rows_are_those_of_the_table(drives):
    figure = modes(drives, ["position_vertical_m", "yaw_deg"])
    assert [p.x_label for p in figure.panels] == ["position vertical [m]", "yaw [deg]"]
    table = drives.table()
    for panel, name in zip(figure.panels, ("position_vertical_m", "yaw_deg"), strict=True):
        at = {word: y for y, word in panel.y_ticks}
        assert at[mode_name(*MODES[0])] == 8.0  # on top, as in the table
        k = table.columns.index(name)
        ours, theirs = only(panel, "21 units, median and 16 to 84 %"), only(panel, "Yaman (2017)")
        spread = [i for i in panel.items if isinstance(i, Line)]
        for i, row in enumerate(table.rows):
            assert ours.y[i] == at[row[0]]
            assert round(theirs.y[i]) == at[row[0]]
            drawn = (ours.x[i], spread[i].x[0], spread[i].x[1], theirs.x[i])
            assert drawn == pytest.approx(row[k : k + 4])
            assert (spread[i].y == ours.y[i]).all()
        np.testing.assert_allclose(theirs.x, np.array(PRINTED_MODES[2])[:, QUANTITIES.index(name)])
        assert panel.log_x
