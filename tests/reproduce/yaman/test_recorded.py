"""Nine modes on a real drive, calibrated from its own start at rest: the calibration, and orders that must hold.

Numbers are those of one log of one car (docs/field-drives.md); bounds are orderings, or a third and more from what was
seen.
"""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

from schuler import earth, rotation, units
from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.recording.io import read
from schuler.reproduce.yaman.study.recorded import COLUMNS, calibrate_at_rest, recorded_modes

EXAMPLE = ROOT / "examples" / "rtkexp_drive.toml"

pytestmark = pytest.mark.realdata


@pytest.fixture(scope="module")
def config():
    return NavigationConfig.load(EXAMPLE)


@pytest.fixture(scope="module")
def recording(shared_data):
    hints = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))["recording"]
    return read(shared_data / "rtkexp_drive", **hints)


@pytest.fixture(scope="module")
def result(recording, config):
    """As the source has it, nine states; outages of docs/driving.md."""
    return recorded_modes(recording, config)


@pytest.fixture(scope="module")
def long(recording, config):
    """One outage of the source's 63 s, at three places."""
    return recorded_modes(recording, config, first_s=(75.0, 195.0, 315.0), every_s=600.0, length_s=63.0)


@pytest.fixture(scope="module")
def estimated(recording, config):
    """The example as it is: 21 states, which find biases and scale factors themselves."""
    return recorded_modes(recording, config, states=None)


def test_the_rest_tells_gyro_biases_and_the_reading_along_gravity(result, recording, config):
    """One pose: the combination that gravity fixes is known to a thousandth, everything else as before."""
    c = result.fit.calibration
    assert c.status == "refused"  # not a calibration to keep; good for this drive
    share = c.observability
    assert all(share[f"b_g_{i}"] < 0.12 for i in "xyz")
    assert all(share[name] > 0.85 for name in ("b_a_x", "b_a_y", "M_a_xx", "M_a_yy", "M_g_xx", "M_g_yy", "M_g_zz"))
    imu = recording.imu
    end = float(result.fit.rests.stop[0])
    assert 30.0 < end - imu.t[0] < 34.0  # the car creeps from 33.8 s on
    still = imu.between(float(imu.t[0]), end).rates()
    C = rotation.dcm_from_rpy(np.array(config.imu.mount_rpy_deg) * units.DEG)
    f, w = C @ still.accel.mean(axis=0), C @ still.gyro.mean(axis=0)
    gyro, accel = c.errors.compensate_rates(w[None], f[None])
    llh = recording.gnss.llh[0]
    gravity = np.linalg.norm(earth.gravity_ned(llh[0], llh[2]))
    assert np.linalg.norm(f) - gravity == pytest.approx(0.137, abs=0.005)
    assert np.linalg.norm(accel) == pytest.approx(gravity, abs=0.002)  # noise and what tilted the car meanwhile
    # about the vertical Earth rate is left; horizontally what the tilting and 10 deg of heading leave
    up = accel[0] / np.linalg.norm(accel)
    assert up @ gyro[0] == pytest.approx(earth.WGS84.omega_ie * np.sin(llh[0]), abs=3.0 * c["b_g_z"][1])
    assert np.linalg.norm(gyro) < 0.02 * units.DEG < 0.18 * units.DEG < np.linalg.norm(w)


def test_filter_is_told_what_the_calibration_is_uncertain_by(result):
    """Less than before; not much less, since one pose leaves tilt and scale factors unknown."""
    raw, calibrated = result.stated_errors
    assert np.all(calibrated < raw)
    assert 15.0 * units.MG < calibrated[0] < raw[0] < 25.0 * units.MG
    assert raw[1] == pytest.approx(0.11 * units.DEG, rel=0.1)


@pytest.mark.parametrize("gps", ["None", "Partial"])
@pytest.mark.parametrize("aided", ["", "+NG"])
def test_calibration_helps_where_nothing_is_estimated(result, long, gps, aided):
    """Nine states, horizontal and vertical, outages of 15 and of 63 s. Seen: 1.6 to 8 and 1.05 to 20 times."""
    for modes in (result, long):
        for column in COLUMNS[:2]:
            assert modes.value(f"{gps}, INS+CIMU{aided}", column) < modes.value(f"{gps}, INS{aided}", column)


@pytest.mark.parametrize("which", ["result", "long", "estimated"])
@pytest.mark.parametrize("calibrated", ["", "+CIMU"])
def test_wheels_and_stops_hold_what_gps_does_not(which, calibrated, request):
    """The source's conclusion: NG far better than pure inertial, with and without calibration."""
    modes = request.getfixturevalue(which)
    name = f"INS{calibrated}"
    assert modes.value(f"None, {name}+NG") < 0.1 * modes.value(f"None, {name}")
    assert modes.value(f"Partial, {name}+NG") < 0.7 * modes.value(f"Partial, {name}")


def test_every_order_of_the_source_with_outages_of_its_length(long):
    """All 29 horizontal pairs. Vertically one differs: nothing here is wrong by 100 mg, see docs/field-drives.md."""
    ratios = long.order().column("ratio")
    assert len(ratios) >= 29
    assert all(r > 1.0 for r in ratios)
    pairs = long.order("position_vertical_m")
    wrong = [(a, b) for a, b, r in pairs.rows if r <= 1.0]
    assert set(wrong) <= {("None, INS+CIMU", "Partial, INS")}


def test_with_short_outages_only_pairs_of_different_lengths_differ(result):
    """Nine minutes with wheels are worse than 15 s without; the source's outages last 63 and 101 s."""
    for column in COLUMNS[:2]:
        for better, worse, ratio in result.order(column).rows:
            assert ratio > 1.0 or (better.startswith("None") and worse.startswith("Partial"))


def test_a_filter_with_sensor_states_needs_no_calibration_in_outages(estimated, result):
    """It finds biases while there is GPS: raw and calibrated agree to 5 % (10 % vertically, with wheels)."""
    for aided in ("", "+NG"):
        raw, calibrated = (estimated.value(f"Partial, INS{x}{aided}") for x in ("", "+CIMU"))
        assert calibrated == pytest.approx(raw, rel=0.05)
    assert estimated.value("Partial, INS+NG", COLUMNS[2]) == pytest.approx(1.9, abs=0.3)  # that of docs/driving.md
    assert estimated.value("Partial, INS") < 0.5 * result.value("Partial, INS")
    # without any GPS only the rests before the start show them, as well as the calibration does (34 against 43 m)
    assert estimated.value("None, INS+CIMU+NG") == pytest.approx(estimated.value("None, INS+NG"), rel=0.5)


def test_with_gps_the_solution_is_where_the_fixes_are(result, estimated):
    assert result.value("Full, INS") < 0.03
    assert estimated.value("Full, INS") < 0.03


def test_the_table(result, tmp_path):
    table = result.table()
    assert len(result.windows) == 11  # those of docs/driving.md
    assert "11 outages, 165 s" in result.summary()
    assert len(table) == 9
    assert table.row(mode="Partial, INS+NG")["source_2_horizontal_m"] == 30.05
    assert table.row(mode="None, INS")["mean_outage_max_horizontal_m"] is None
    assert result.to_csv(tmp_path / "m.csv").read_text().count("\n") == 10
    json.dumps(result.to_dict())
    assert "hold" in result.order().notes[0]
    with pytest.raises(InputError, match="expected a mode"):
        result.value("Full, INS+NG")


def test_interruption_keeps_the_modes_that_were_finished(recording, config):
    def stop(fraction):
        raise KeyboardInterrupt

    stopped = recorded_modes(recording, config, progress=stop)
    assert np.isfinite(stopped.rms[:, 0]).tolist() == [True] + [False] * 8
    assert not stopped.complete
    assert len(stopped.table()) == 1


def test_a_start_in_motion_is_refused(recording, config):
    imu, gnss = recording.imu, recording.gnss
    late = replace(recording, imu=imu.between(imu.t[0] + 30.0, imu.t[-1]))
    with pytest.raises(InputError, match="at least 10 s at rest"):
        calibrate_at_rest(late, config)
    silent = replace(recording, gnss=replace(gnss, v_n=None, cov_v_n=None))
    with pytest.raises(InputError, match="no velocities"):
        calibrate_at_rest(silent, config)
