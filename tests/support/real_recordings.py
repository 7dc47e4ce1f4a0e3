"""Every recording of ../shared/data that is a good one, with the hints that its README gives."""

_SHOE = {"columns": "ax,ay,az,gx,gy,gz", "variable": "imu", "units": "m/s^2,rad/s", "rate": 200.0}
_SNU = {"columns": "t,ax,ay,az,gx,gy,gz,*", "units": "m/s^2,rad/s", "time": "unix"}
_VN = {"units": "m/s^2,rad/s", "rate": 50.0, "axes": "FRD"}
_COUNTS = {"variable": "counts", "columns": "gx,gy,gz,ax,ay,az", "scale": "lsb", "units": "g,deg/s", "rate": 100.0}
_WALKS = ("11-22-03", "11-22-46", "11-23-25", "11-25-20", "11-26-05", "11-26-46", "11-27-30", "11-28-03")
_SIDES = ("x_up", "x_down", "y_up", "y_down", "z_up", "z_down")


def _sixpos(side: str) -> dict:
    return {
        "accel": {
            "file": f"{side}_accel.mat",
            "columns": "accel=accel",
            "units": "accel=m/s^2",
            "rate": 50.0,
            "axes": "FRD",
        },
        "gyro": {
            "file": f"{side}_gyro.mat",
            "columns": "gyro=gyro",
            "units": "gyro=rad/s",
            "rate": 50.0,
            "axes": "FRD",
        },
    }


#: File or folder, hints, and codes that are so: no false alarms, with the reason beside them.
GOOD = {
    "adis16405_static/adis16405_imu1.npz": (_COUNTS, ()),
    "adis16405_static/adis16405_imu2.npz": (_COUNTS, ()),
    # its README: stamps not credible, 92 K within 4.2 s
    "imu_thermal/imu_raw_data.csv": (
        {"columns": "t,gx,gy,gz,ax,ay,az,-,temp", "delimiter": "tab", "units": "accel=m/s^2,gyro=rad/s,t=ns"},
        ("time_unit",)),
    "imu_tk_xsens": (
        {"accel": {"file": "xsens_acc.mat", "columns": "t,ax,ay,az", "units": "accel=counts"},
         "gyro": {"file": "xsens_gyro.mat", "columns": "t,gx,gy,gz", "units": "gyro=counts"}}, ()),
    # 5 % too large: that is what it was calibrated for
    "imucal_ferraris/example_ferraris_session.csv": (
        {"columns": "-,gx,gy,gz,ax,ay,az", "units": "m/s^2,deg/s", "rate": 102.4}, ("accel_scale",)),
    "imucal_ferraris/annotated_session.csv": (
        {"columns": "-,-,ax,ay,az,gx,gy,gz", "units": "counts,counts", "rate": 204.8, "skip": 1}, ()),
    "imucal_ferraris/ferraris_example.csv": (
        {"columns": "-,gx,gy,gz,ax,ay,az", "units": "m/s^2,deg/s", "rate": 102.4}, ()),
    "instinct_spirent/iono-none_tropo-none/Rover-dynamic_MO_Spirent.obs": ({}, ()),
    # a pause of 0.29 s
    "instinct_tckf": (
        {"imu": {"file": "vn310-imu.csv"}, "gnss": {"file": "vn310-gnss.csv"}}, ("gaps",)),
    "openshoe/square2.mat": (_SHOE | {"variable": "u", "rate": 250.0}, ()),
    "psins_lasergyro/lasergyro.imu": ({}, ()),
    # it goes along minus y of the axes its reader gives it
    "psins_tc/insgpseo_tc.mat": ({}, ("axes",)),
    **{f"pyshoe_vicon/2017-11-22-{walk}.mat": (_SHOE, ()) for walk in _WALKS},
    "rtkexp_drive": (
        {"imu": {"file": "imu_gpst.csv", "time": "gps-tow:2374", "axes": "BRU", "offset": -0.125},
         "gnss": {"file": "gnss_1934_sf.pos", "height": "msl", "geoid_separation": -17.0}}, ()),
    "rtkexp_walk": (
        {"imu": {"file": "imu_gpst.csv", "time": "gps-tow:2381", "axes": "LBU"},
         "gnss": {"file": "gnss_1730_sf.pos", "height": "msl", "geoid_separation": -17.0},
         "observations": {"file": "gnss_1730.obs"}, "ephemerides": {"file": "gnss_1730.nav"}}, ()),
    # its README: stamps jitter by half an interval
    **{f"snu_staticposes/imu_good{k}.txt": (_SNU, ("jitter",)) for k in (1, 2, 3)},
    "vn200_ratetable/static_z-_z+_IMU0.csv": ({"rate": 50.0}, ()),
    "vn200_ratetable/static_z-_z+_IMU1.csv": ({"rate": 50.0}, ()),
    **{f"vn200_ratetable/transfer_align/{side}.mat": (_VN, ()) for side in _SIDES},
    **{f"vn200_ratetable/unit3_sixpos_50hz#{side}": (_sixpos(side), ()) for side in _SIDES},
}  # fmt: skip
