"""Folders of apps and loggers are navigated without a configuration, as well as by one who knows them."""

import warnings

import app_logs
import numpy as np
import pytest
from benchmarks import loggers

import schuler
from schuler.proposal import files


@pytest.mark.campaign
@pytest.mark.parametrize("write", app_logs.LAYOUTS, ids=lambda write: write.__name__)
def test_a_folder_of_an_app_is_navigated_as_one_of_known_units_and_axes(write, tmp_path):
    d = write(tmp_path)
    folder = loggers.Folder(tmp_path, d.truth, d.fixes, True, "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        proposal = schuler.propose(tmp_path, imu=loggers.IMU)
        error, _ = loggers.error_of(folder, proposal.recording, proposal.config)
    assert error < loggers.BOUND * loggers.by_hand(folder)  # statistical: 0.81 to 1.29 of 25 layouts


def test_whole_numbers_of_a_receiver_are_told_by_latitudes_that_no_place_has(tmp_path):
    rows = [f"{k}.00,{487000000 + 9 * k},{91000000 + 9 * k},{300123},{1500},{9000000}" for k in range(20)]
    (tmp_path / "gps.csv").write_text("t,lat,lon,h,speed,course\n" + "\n".join(rows) + "\n")
    head = "t (s),ax (m/s^2),ay (m/s^2),az (m/s^2),gx (rad/s),gy (rad/s),gz (rad/s)\n"
    (tmp_path / "imu.csv").write_text(head + "".join(f"{k / 10:.1f},0,0,-9.8,0,0,0\n" for k in range(200)))
    entry = files.files_of([tmp_path], {}).entries["gnss"]
    assert entry["scale"] == "lat=1e-07,lon=1e-07,h=0.001,speed=0.001,course=1e-05"
    degrees = (tmp_path / "gps.csv").read_text().replace("487000000", "48.7")
    (tmp_path / "gps.csv").write_text("\n".join([degrees.splitlines()[0], *("1,48.7,9.1,300,1,9" for _ in rows)]))
    assert "scale" not in files.files_of([tmp_path], {}).entries["gnss"]


def test_places_without_heights_are_fixes_and_those_of_another_file_with_heights_come_first(tmp_path):
    head = "time (s),gFx (g),gFy (g),gFz (g),wx (rad/s),wy (rad/s),wz (rad/s)"
    rows = [f"{k / 50:.2f},0.0,{k % 3}e-3,-1.0,1e-3,{k % 5}e-3,0.0" for k in range(1500)]
    (tmp_path / "log.csv").write_text("\n".join([head, *rows]) + "\n")
    places = [f"{k},{48.7 + 1e-5 * k:.5f},9.1" for k in range(30)]
    (tmp_path / "a.csv").write_text("\n".join(["time (s),Latitude,Longitude", *places]) + "\n")
    proposed = files.files_of([tmp_path], {})
    assert proposed.entries["gnss"]["file"] == "a.csv"
    fixes = schuler.read(tmp_path, **proposed.entries).need_gnss()
    np.testing.assert_array_equal(fixes.cov_r_n[:, 2, 2], 1e6)
    (tmp_path / "b.csv").write_text(
        "\n".join(["time (s),Latitude,Longitude,Altitude", *(f"{row},300.0" for row in places)]) + "\n"
    )
    assert files.files_of([tmp_path], {}).entries["gnss"]["file"] == "b.csv"
