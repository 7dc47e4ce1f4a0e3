"""Standard atmosphere, zenith delays, mapping: known values, limits, another program's numbers."""

import numpy as np
import pytest

from schuler.earth import gravity_somigliana
from schuler.exceptions import InputError
from schuler.gnss.troposphere import niell_mapping, saastamoinen, standard_atmosphere, zenith_delays
from schuler.units import DEG

SUMMER, WINTER = 206.0 * 86_400.0, 23.0 * 86_400.0  # of the year of the GPS epoch


def test_the_standard_atmosphere():
    """ICAO tables: sea level, 1 km, 5 km, 11 km; printed to a pascal."""
    P, T, _ = standard_atmosphere([0.0, 1000.0, 5000.0, 11_000.0])
    assert np.allclose(P, [101_325.0, 89_875.0, 54_020.0, 22_632.0], atol=1.0)  # printed digits
    assert np.allclose(T, [288.15, 281.65, 255.65, 216.65], rtol=1e-12)
    e = standard_atmosphere(0.0, 1.0)[2]
    assert e == pytest.approx(1704.0, rel=0.003)  # saturation at 15 degC


def test_zenith_delays_of_the_textbooks():
    """Hydrostatic 2.3 m at sea level (0.2277 cm per hPa at 45 deg), wet about a decimetre, less above."""
    hydrostatic, wet = zenith_delays(45.0 * DEG, [0.0, 2000.0, 8000.0])
    assert hydrostatic[0] == pytest.approx(0.0022768 * 1013.25, rel=1e-6)
    assert 0.08 < wet[0] < 0.16
    assert np.all(np.diff(hydrostatic) < 0.0)
    assert np.all(np.diff(wet) < 0.0)
    assert zenith_delays(0.0, 0.0, humidity=0.0)[1] == 0.0


@pytest.mark.parametrize("lat_deg", [0.0, -20.0, 70.0, 90.0])
@pytest.mark.parametrize("height", [0.0, 3000.0])
def test_the_same_pressure_delays_less_where_gravity_is_larger(lat_deg, height):
    """Law: pressure is the weight of the air. Normal gravity of the ellipsoid; 2e-4 are what the source rounds."""
    here, there = zenith_delays([lat_deg * DEG, 45.0 * DEG], [height, 0.0])[0] / standard_atmosphere([height, 0.0])[0]
    g, g_there = gravity_somigliana([lat_deg * DEG, 45.0 * DEG], [height, 0.0])
    assert here / there == pytest.approx(g_there / g, rel=2e-4)


def test_outside_the_atmosphere_the_ends_are_held():
    assert np.array_equal(zenith_delays(0.5, 30_000.0)[0], zenith_delays(0.5, 11_000.0)[0])
    assert np.isfinite(saastamoinen([0.5, 0.0, -50_000.0], [0.3], 0.0)).all()


@pytest.mark.parametrize("lat", [-80.0, -45.0, 0.0, 15.0, 40.0, 89.0])
def test_mappings_start_at_one_and_follow_the_cosecant(lat):
    E = np.array([90.0, 60.0, 30.0, 10.0, 5.0]) * DEG
    h, w = niell_mapping(E, lat * DEG, 0.0, SUMMER)
    assert h[0] == pytest.approx(1.0, abs=1e-15)
    assert w[0] == pytest.approx(1.0, abs=1e-15)
    for m in (h, w):
        assert np.all(m[1:] < 1.0 / np.sin(E[1:]))  # the Earth is round
        assert np.allclose(m[:3], 1.0 / np.sin(E[:3]), rtol=0.006)
    # Niell (1996): about 10.15 (hydrostatic) and 10.7 (wet) at 5 deg
    assert h[-1] == pytest.approx(10.15, abs=0.08)
    assert w[-1] == pytest.approx(10.75, abs=0.08)


def test_seasons_are_opposite_in_the_hemispheres():
    E = 5.0 * DEG
    north, south = (niell_mapping(E, lat, 0.0, WINTER)[0] for lat in (0.8, -0.8))
    assert niell_mapping(E, -0.8, 0.0, WINTER + 0.5 * 365.25 * 86_400.0)[0] == pytest.approx(float(north), abs=1e-12)
    assert north > south  # cold air is shallow: the path is more nearly that through a flat layer


def test_both_mappings_agree_high_up_and_part_at_the_horizon():
    llh = [0.8, 0.0, 200.0]
    E = np.array([90.0, 45.0, 15.0, 5.0]) * DEG
    niell, cosecant = (saastamoinen(llh, E, SUMMER, mapping=m) for m in ("niell", "cosecant"))
    assert np.allclose(cosecant / niell - 1.0, [0.0, 0.0012, 0.017, 0.13], atol=[1e-12, 3e-4, 1e-3, 0.01])
    assert saastamoinen(llh, [-0.3], SUMMER)[0] == saastamoinen(llh, [2.0 * DEG], SUMMER)[0]


@pytest.mark.parametrize(
    ("options", "message"), [({"mapping": "secant"}, "niell or cosecant"), ({"humidity": 50.0}, "50 percent is 0.5")]
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        saastamoinen([0.8, 0.0, 0.0], [0.5], 0.0, **options)


@pytest.mark.realdata
def test_against_the_delays_of_another_program(shared_data):
    """Google's derived columns of a phone's drive (model and mapping not stated): within centimetres above 10 deg."""
    from schuler.frames import llh_from_ecef
    from schuler.gnss.coarse import along_track, coarse_track, directions

    path = shared_data / "gnss_nav_files" / "Pixel4XL_derived.csv"
    d = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="ascii")
    d = d[np.argsort(d["millisSinceGpsEpoch"], kind="stable")]
    t = (d["millisSinceGpsEpoch"] - d["millisSinceGpsEpoch"][0]) / 1e3
    r_sat = np.stack((d["xSatPosM"], d["ySatPosM"], d["zSatPosM"]), axis=-1)
    range_ = d["rawPrM"] + d["satClkBiasM"] - d["isrbM"] - d["ionoDelayM"] - d["tropoDelayM"]
    r = along_track(t, *coarse_track(t, range_, r_sat))
    elevation, _ = directions(r, r_sat)
    llh = llh_from_ecef(r)
    llh[:, 2] = np.median(llh[:, 2])
    difference = saastamoinen(llh, elevation, d["millisSinceGpsEpoch"] / 1e3) - d["tropoDelayM"]
    high = elevation > 10.0 * DEG
    assert np.count_nonzero(high) > 5000
    assert abs(np.mean(difference[high])) < 0.02  # seen 0.003
    assert np.std(difference[high]) < 0.03  # seen 0.009
