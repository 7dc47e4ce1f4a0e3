"""Yaman's nine modes, emulated: the order of the modes is the source's, and what follows from the inputs by hand does.

The numbers of the modes are not the source's and are not meant to be: route, noise and settings are not known.
"""

import json

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation.states import imu_spec, state_layout
from schuler.reproduce.yaman.study.drive import RAW, Drive, route
from schuler.reproduce.yaman.study.modes import drive_modes, levelled_start, mode_config, rms_errors
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, agreed_order, mode_name
from schuler.units import DEG

H, V = QUANTITIES.index("position_horizontal_m"), QUANTITIES.index("position_vertical_m")
ROW = {mode_name(*mode): k for k, mode in enumerate(MODES)}


@pytest.fixture(scope="module")
def drive():
    return Drive.of(2, rate_hz=50.0)


@pytest.fixture(scope="module")
def result(drive):
    return drive_modes(drive)


def test_the_tables_are_those_printed():
    for number in (1, 2):
        assert np.array(PRINTED_MODES[number]).shape == (len(MODES), len(QUANTITIES))
    assert PRINTED_MODES[1][ROW["None, INS"]][V] == 71771.49
    assert PRINTED_MODES[2][ROW["Partial, INS+NG"]][H] == 30.05
    assert len(agreed_order()) == 29


def test_the_drive_has_rests_turns_and_hills():
    motion = route(200.0)
    state = motion.state(np.arange(0.0, 200.0, 0.5))
    speed = np.linalg.norm(state.v_eb_e, axis=1)
    assert np.count_nonzero(np.diff((speed < 1e-6).astype(int)) == 1) == 1  # one stop a lap
    assert speed.max() == pytest.approx(16.0, abs=0.1)
    assert np.ptp(state.llh[:, 2]) > 1.0
    assert motion.duration >= 200.0


def test_nine_states_and_noise_by_the_rule():
    """N = b sqrt(T) beside the white noise; and nothing that a state could take."""
    config = mode_config("Partial", False, True, (300.0, 401.0))
    spec = imu_spec(config)
    assert state_layout(config, spec).size == 9
    assert spec.accel.random_walk == pytest.approx(np.hypot(400e-6 * 9.80665, 0.080 * 9.80665 / np.sqrt(5.0)))
    assert spec.gyro.random_walk == pytest.approx(np.hypot(0.005 * DEG, 0.1 * DEG / np.sqrt(5.0)))
    assert config.aiding.non_holonomic.mount_sigma_deg == 0.0
    assert mode_config("None", True, False, (0.0, 1.0)).gnss.coupling == "off"
    assert mode_config("None", True, False, (0.0, 1.0)).outages.windows_s == ()
    assert mode_config("Full", True, False, (0.0, 1.0)).aiding.zero_velocity is None


def test_levelling_with_the_sources_formula(drive):
    """The horizontal bias becomes tilt: roll b_y / g, pitch -b_x / g (with the z error of a tenth); 2 %."""
    rpy = levelled_start(drive.raw, False).nav.rpy_nb - drive.raw.reference.at([20.0]).rpy_nb[0]
    g = 9.80 - RAW["b_a"][2]
    assert rpy[0] == pytest.approx(-RAW["b_a"][1] / g, rel=0.03)
    assert rpy[1] == pytest.approx(RAW["b_a"][0] / g, rel=0.03)


def test_every_order_on_which_both_tables_agree_is_ours(result):
    for column, k in ((H, "position_horizontal_m"), (V, "position_vertical_m")):
        pairs = agreed_order(k)
        assert len(pairs) >= 29
        wrong = [
            f"{mode_name(*MODES[a])} < {mode_name(*MODES[b])}"
            for a, b in pairs
            if result.rms[a, column] > result.rms[b, column]
        ]
        assert len(wrong) <= 1, wrong


def test_what_follows_from_the_inputs(result):
    """Vertical, uncalibrated: the recovered constant error in, the source's table out; 15 %, printed inputs."""
    for mode in ("Partial, INS", "None, INS"):
        assert result.rms[ROW[mode], V] == pytest.approx(PRINTED_MODES[2][ROW[mode]][V], rel=0.15)
    # closed form: half a t^2, RMS over the outage of 101 s
    assert result.rms[ROW["Partial, INS"], V] == pytest.approx(
        RAW["b_a"][2] * 101.0**2 / (2.0 * np.sqrt(5.0)), rel=0.05
    )


def test_aids_hold_what_gps_does_not(result):
    """A law of the source's conclusions: NG far better than pure inertial, with and without calibration."""
    for calibrated in ("INS+CIMU", "INS"):
        for gps in ("None", "Partial"):
            assert result.rms[ROW[f"{gps}, {calibrated}+NG"], H] < 0.2 * result.rms[ROW[f"{gps}, {calibrated}"], H]
    assert result.rms[ROW["Full, INS"], H] < 3.0


def test_the_table_has_both(result, tmp_path):
    table = result.table()
    assert table.column("mode")[0] == "None, INS+CIMU"
    assert table.column("source_position_horizontal_m")[4] == 1.609
    assert result.to_csv(tmp_path / "m.csv").read_text().count("\n") == 10
    json.dumps(result.to_dict())


def test_errors_over_a_window(drive):
    """A solution shifted by one metre north and three degrees of yaw; closed form."""
    truth = drive.raw.reference
    moved = type(truth)(truth.t, truth.r_eb_e, truth.v_eb_e, truth.q_eb)
    np.testing.assert_allclose(rms_errors(moved, truth, (10.0, 20.0)), np.zeros(7), atol=1e-9)
    with pytest.raises(InputError, match="no reference epoch"):
        rms_errors(moved, truth, (1e6, 1e6 + 1.0))


def test_interruption_keeps_the_modes_that_were_finished(drive):
    def stop(fraction):
        raise KeyboardInterrupt

    result = drive_modes(drive, against="truth", progress=stop)
    assert np.isfinite(result.rms[:, 0]).tolist() == [True] + [False] * 8
    assert not result.complete
    assert len(result.table()) == 1


def test_what_cannot_be_done_is_said(drive):
    with pytest.raises(InputError, match="expected 1 or 2"):
        Drive.of(3)
    with pytest.raises(InputError, match="against"):
        drive_modes(drive, against="gps")
