"""Section 5.2 and appendix D: histograms of the Monte Carlo, and what the gravity model may do."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import against, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.reproduce.yaman.campaigns import AUTOMOTIVE, TACTICAL, campaign, single_run
from schuler.reproduce.yaman.multi import STANDARD_ERRORS

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure

_PRINTED_FIRST = ("b_a_x", "b_g_x", "M_a_xx", "M_g_xx")


def _histograms(grade: str, chosen: Callable[[str], bool]) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        from schuler.reproduce.yaman.study.tables import PRINTED_CAMPAIGNS

        result = campaign(effort, grade, "ours")
        names = [name for name in PRINTED_CAMPAIGNS[grade] if chosen(name)]
        at = [result.column(name) for name in names]
        before = result.modelled[:, at] / result.prior_sigma[at]
        most = _kolmogorov(len(result))
        inside = float(np.mean(np.abs(result.normalised[:, at]) < 1.0))
        width = [float(np.ptp(result.residual[:, i]) / np.ptp(result.modelled[:, i])) for i in at]
        cells = (
            claimed(
                "put in: largest distance from the normal distribution of Table 5.2",
                "normally distributed",
                _distance(before),
                high=most,
                unit="-",
                tolerance="statistical",
            ),
            claimed(
                "left: largest distance from the normal distribution that is claimed",
                "claims are true",
                _distance(result.normalised[:, at]),
                high=most,
                unit="-",
                tolerance="statistical",
                reference="corrected",
            ),
            shown("left: share of runs within their 1 sigma", inside, unit="-"),
            shown("width of what is left over width of what was put in, largest", max(width), unit="-"),
        )

        def figure(which: str) -> Callable[[], Figure]:
            def make() -> Figure:
                from schuler.reproduce.yaman.study.campaign_figures import histograms

                return histograms(result, which, names)

            return make

        return Outcome(
            cells, "The histograms' numbers are those of Tables 5.3 and 5.4; here their shape.",
            (figure("modelled"), figure("residual")),
        )  # fmt: skip

    return run


def _distance(x: np.ndarray) -> float:
    """Largest Kolmogorov distance of the columns from the standard normal distribution."""
    from scipy.stats import kstest

    return float(max(kstest(column, "norm").statistic for column in x.T))


def _kolmogorov(n: int) -> float:
    """Distance beyond which a column of normal numbers is as seldom as beyond STANDARD_ERRORS sigma."""
    from scipy.stats import kstwo, norm

    return float(kstwo.isf(2.0 * norm.sf(STANDARD_ERRORS), n))


# ------------------------------------------------------------------------------------------- gravity


def _fig_5_15(effort: Effort) -> Outcome:
    from schuler import earth
    from schuler.calibration.field.calibration import calibrate_field
    from schuler.reproduce.yaman.study.runs import FieldJob
    from schuler.sensors import catalogue
    from schuler.standstill.rests import given_rests
    from schuler.units import MG, MGAL, PPM

    own = single_run(effort, "ours")
    job = FieldJob(catalogue.spec(AUTOMOTIVE))
    g = float(np.linalg.norm(earth.gravity_ned(job.place[0], job.place[2])))
    deflections = []
    for local in (g, g + 100.0 * MGAL):
        rests = given_rests(own.imu, job.routine.rests + np.array([0.1, -0.1]))
        deflections.append(
            calibrate_field(
                own.imu, job.spec, latitude=job.place[0], height=job.place[2], gravity=local,
                heading=(float(job.routine.rpy_nb[2]), job.heading_sigma), rests=rests, halves=False,
            ).calibration
        )  # fmt: skip
    moved = [deflections[1][f"M_a_{a}{a}"][0] - deflections[0][f"M_a_{a}{a}"][0] for a in "xyz"]
    expected = -100.0 * MGAL / g
    cells = [
        digits("100 mgal", "0.1", 100.0 * MGAL / MG, unit="mg"),
        *(
            against(
                f"S_a_{a} by gravity told 100 mgal too large", expected / PPM, m / PPM, relative=0.02, unit="ppm",
                tolerance="discretisation", reference="corrected",
            )
            for a, m in zip("xyz", moved, strict=True)
        ),
        *(
            claimed(
                f"of the errors put in, {grade.removeprefix('yaman-')}", "highly accurate for low-cost sensors",
                abs(expected) / catalogue.spec(grade).accel.scale_factor, high=limit, unit="-",
                reference="thesis" if grade == AUTOMOTIVE else "corrected",
            )
            for grade, limit in ((AUTOMOTIVE, 0.1), (TACTICAL, 1.0))
        ),
    ]  # fmt: skip

    def figure() -> Figure:
        from schuler.reproduce.yaman.study.campaign_figures import family_figure

        return family_figure(own.fit, ("M_a_xx", "M_a_yy", "M_a_zz"), own.truth, "Scale factors with true gravity")

    return Outcome(
        tuple(cells),
        "The figure is other people's survey of gravity along tracks. Its number, 100 mgal, goes into the calibration "
        "here: scale factors take it, 102 ppm, a hundredth of an automotive unit's and a third of a tactical one's.",
        (figure,),
    )


ITEMS = (
    Item("fig-5.11", "Histograms of four automotive parameters", "statistical",
         _histograms(AUTOMOTIVE, lambda name: name in _PRINTED_FIRST), also=("fig-5.12", "fig-5.13", "fig-5.14")),
    Item("fig-5.15", "Gravity beside that of the ellipsoid", "hardware", _fig_5_15),
)  # fmt: skip
APPENDIX_D = (
    Item("fig-D.1", "Histograms of the other automotive parameters", "statistical",
         _histograms(AUTOMOTIVE, lambda name: name not in _PRINTED_FIRST),
         also=tuple(f"fig-D.{k}" for k in range(2, 27))),
    Item("fig-D.27", "Histograms of all tactical parameters", "statistical", _histograms(TACTICAL, lambda name: True),
         also=tuple(f"fig-D.{k}" for k in range(28, 48))),
)  # fmt: skip
