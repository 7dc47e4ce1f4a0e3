"""Charts of single logs, and Monte Carlo bounds beside closed forms: what is in them, and that they can be drawn."""

import numpy as np

from schuler.characterisation import allan_deviation, autocorrelation
from schuler.growth import growth, planar_bounds
from schuler.growth.figures import beside_figure, difference_figure
from schuler.plotting.figure import Band, Figure, Line
from schuler.reproduce.flenniken.study import figures as charts
from schuler.reproduce.flenniken.study.grade_comparison import overlay
from schuler.reproduce.flenniken.study.heading import heading_outages
from schuler.reproduce.flenniken.study.heading.figures import outage_figure
from schuler.sensors.catalogue import spec
from schuler.sensors.noise import GaussMarkov, White

MODEL = White(0.1) + GaussMarkov(0.05, 20.0)
X = MODEL.sample(2000, 0.5, np.random.default_rng(1))


def items(figure: Figure, kind: type) -> list:
    return [item for panel in figure.panels for item in panel.items if isinstance(item, kind)]


def test_allan_chart_is_in_its_unit_with_bounds():
    curve = allan_deviation(X, 2.0)
    figure = charts.allan_figure({"log": curve}, [(curve.tau, curve.tau), (curve.tau, curve.tau)], "mdeg/s", scale=1e-3)
    log, *models = items(figure, Line)
    np.testing.assert_allclose(log.y, curve.deviation / 1e-3)
    np.testing.assert_allclose(items(figure, Band)[0].high, curve.high / 1e-3)
    assert [m.label for m in models] == ["model", ""]  # one entry of the legend for all
    assert figure.panels[0].y_label == "Allan deviation [mdeg/s]"


def test_correlation_has_two_standard_deviations():
    r = autocorrelation(X, 2.0)
    figure = charts.correlation_figure({"log": r}, {"model": (r.lag, np.exp(-r.lag / 20.0))})
    (band,) = items(figure, Band)
    np.testing.assert_allclose(band.high - band.low, np.interp(band.x, r.lag, 4.0 * r.sigma / r.value[0]))


def test_overlay_has_two_panels_for_each_model():
    o = overlay(MODEL, X, 2.0, np.random.default_rng(2))
    figure = charts.overlay_figure({"one": o, "two": o}, "deg/s", 2.0)
    assert len(figure.panels) == 4
    np.testing.assert_allclose(items(figure, Band)[0].low, o.allan.low / 2.0)
    np.testing.assert_allclose(items(figure, Band)[1].low, o.correlation.low)


def test_sweep_has_bars_of_two_standard_errors():
    wanted = np.array([1.0, 10.0])
    figure = charts.sweep_figure(wanted, {"runs": (wanted, 0.1 * wanted)}, "wanted [-]", "found [-]", "title")
    bars = items(figure, Line)[1:]
    np.testing.assert_allclose([bar.y for bar in bars], [[0.8, 1.2], [8.0, 12.0]])


def test_bounds_are_shown_with_their_uncertainty():
    imu = spec("flenniken-consumer")
    b = planar_bounds(imu, 5.0, runs=50)
    exact = growth(imu, b.t, gravity=0.0, start="zero").total("heading")
    figure = beside_figure({"runs": b}, ("heading", "velocity_north"), {"closed": {"heading": exact}}, "title")
    (heading, velocity) = items(figure, Band)
    np.testing.assert_allclose((heading.high - heading.low) / (heading.high + heading.low), 2.0 * b.uncertainty)
    np.testing.assert_allclose(velocity.low, b.sigma["velocity_north"] * (1.0 - 2.0 * b.uncertainty))
    assert len(items(figure, Line)) == 1
    added = difference_figure(b.t, {"heading": exact}, {"heading": 0.1 * exact})
    assert len(items(added, Band)) == 1


def test_outages_are_shown_with_their_uncertainty():
    result = heading_outages(spec("flenniken-consumer"), runs=20, start_s=20.0, outage_s=20.0)
    figure = outage_figure(result, ("Gauss-Markov",))
    assert len(items(figure, Band)) == 12
    assert len(items(figure, Line)) == 15
