"""Figures of rotating filters: curves are the numbers of their results, and all of them can be drawn."""

from functools import cache

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.du.study import filter_figures as figures
from schuler.reproduce.du.study.imus import NAV440
from schuler.reproduce.du.study.integrated import IntegratedDrive
from schuler.reproduce.du.study.outages import rotary_comparison
from schuler.reproduce.du.study.zupt import TableCase, zupt_study
from schuler.reproduce.du.study.zupt_runs import zupt_emulation
from schuler.units import DEG


@cache
def comparison():
    drive = IntegratedDrive(NAV440, length_s=180.0, outages=((100.0, 160.0),))
    return rotary_comparison(NAV440, 12, drive=drive)


@cache
def emulation():
    return zupt_emulation([("NAV440", "Z", None), ("NAV440", "Z", 30.0)], runs=8)


@cache
def study():
    return zupt_study(["NAV440"], [TableCase(duration_s=60.0), TableCase("Z", 30.0, 60.0)])


def labelled(panel, label):
    (item,) = [i for i in panel.items if getattr(i, "label", "") == label]
    return item


def test_growth_shows_the_curves_and_the_floor():
    figure = figures.growth(comparison())
    age, rms = comparison().rotary.curve("horizontal_m")
    np.testing.assert_allclose(labelled(figure.panels[0], "rotary").y, rms)
    floor = labelled(figure.panels[0], "gyroscope noise alone").y
    # N g sqrt(t^5 / 10) for two axes
    assert floor[-1] == pytest.approx(NAV440.spec.gyro.random_walk * 9.80665 * np.sqrt(age[-1] ** 5 / 10.0))
    assert floor[-1] < labelled(figure.panels[0], "conventional").y[-1]
    assert "95 %" in figure.caption


def test_sigmas_and_outages():
    figure = figures.sigma_histories(comparison())
    assert len(figure.panels) == 9
    azimuth = labelled(figure.panels[2], "rotary")
    np.testing.assert_allclose(azimuth.y, comparison().rotary.sigmas("dpsi")[:, 2] / DEG)
    one = figures.outage_errors(comparison(), run=3)
    assert len(one.panels) == 4
    assert labelled(one.panels[2], "conventional").y.shape == (60,)


def test_zupt_figures():
    figure = figures.zupt_runs(emulation(), "NAV440", "Z", run=2)
    assert len(figure.panels) == 9
    assert list(figure.legend()) == ["conventional", "Z, tilt 30"]
    last = labelled(figure.panels[0], "Z, tilt 30").y[-1]
    assert last == pytest.approx(0.112, abs=0.01)  # the bias of the thesis
    with pytest.raises(InputError, match="no runs"):
        figures.zupt_runs(emulation(), "NAV440", "Y")
    sigmas = figures.zupt_sigmas(study(), "NAV440")
    assert sigmas.panels[0].log
    with pytest.raises(InputError, match="imu"):
        figures.zupt_sigmas(study(), "MTi-G")
