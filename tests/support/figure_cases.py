"""One small result for every figure function of the package, and the figures it makes of it.

:func:`cases` has, by module and name below ``schuler``, what calls the function; results are made up
where numbers do not matter, and computed on the smallest case otherwise. ``run(name)`` is a fixture of ``conftest.py``.
"""

# ruff: noqa: E501 (a table of dotted names)

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from places import EXAMPLES, module

from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR

RNG = np.random.default_rng


def fixture(path: str, name: str, *arguments: Any) -> Any:
    """What a fixture of another test module makes."""
    return getattr(module(path), name).__wrapped__(*arguments)


# ------------------------------------------------------------------------------------------------------- results


@cache
def mission():
    import tomllib

    from schuler.budget import prepare_budget

    return prepare_budget(tomllib.loads((EXAMPLES / "budget_town.toml").read_text()))


@cache
def covariance():
    from schuler.budget import linear_covariance
    from schuler.sensors.catalogue import spec

    return linear_covariance(mission(), spec("MTi-G-710"))


@cache
def choice():
    from schuler.budget import choose_imu, requirement
    from schuler.sensors.catalogue import spec

    specs = [spec(n) for n in ("MTi-G-710", "LN-200", "flenniken-consumer")]
    return choose_imu(mission(), requirement("horizontal < 30 m @ 60 s outage"), specs)


@cache
def calibration():
    return module("support/result_cases.py").full()


def compared_rests():
    from schuler.calibration.result.application import RestComparison

    t, up = 30.0 * np.arange(6.0), np.repeat([[0.0, 0.0, -9.81]], 6, axis=0)
    f = up + RNG(3).normal(0.0, 2e-3, (6, 3))
    none = np.zeros((6, 3))
    return RestComparison(t, t + 10.0, 9.81, "as stated", f + 0.04, f, none, none, np.full(6, 2e-3), none)


def double_differences():
    """What the figure takes of a baseline: four satellites, one of which slips."""
    shape = (30, 4)
    code, carrier = RNG(4).normal(0.0, [[0.4], [0.004]], (2, shape[0] * shape[1])).reshape(2, *shape)
    slipped = np.zeros(shape, dtype=bool)
    slipped[12, 2] = True
    return SimpleNamespace(
        t=np.arange(30.0), sat=np.array([1, 5, 7, 201]), residual_code=code, residual_carrier=carrier,
        sigma_code=np.full(shape, 0.4), slipped=slipped, n_ambiguities=np.full(30, 3), n_fixed=np.full(30, 3),
    )  # fmt: skip


@cache
def single_points(with_truth: bool):
    """A minute of single points, of which some epochs have a fault and some too few satellites."""
    from schuler.frames import C_en, ecef_from_llh
    from schuler.gnss import PointEvaluation, RangeErrors, nominal_orbits, solve_points, synthetic_ranges

    t, llh = np.arange(60.0), np.array([0.84, 0.2, 400.0])
    v_e = np.tile(C_en(llh) @ (8.0, 3.0, 0.0), (60, 1))
    r_e = ecef_from_llh(llh) + v_e * t[:, None]
    few = np.where((t > 30.0) & (t < 36.0), np.where(t > 33.0, 3, 5), 99)
    made = synthetic_ranges(
        t, r_e, v_e, nominal_orbits("GE"), RNG(6), RangeErrors(noise=0.5), max_satellites=few
    ).ranges
    late = (made.sat == made.sat[0]) & (made.t > 10.0) & (made.t < 20.0)
    ranges = replace(made, pseudorange=made.pseudorange + 60.0 * late)
    return PointEvaluation(solve_points(ranges), ranges, r_e if with_truth else None)


def looked_at():
    """A log of a page, at rest."""
    from schuler.recording.recording import Metadata, Recording
    from schuler.recording.series import ImuSeries

    t, noise = np.arange(0.0, 60.0, 0.05), RNG(5).normal(0.0, 1e-3, (2, 1200, 3))
    return SimpleNamespace(recording=Recording(imu=ImuSeries(t, noise[0], noise[1]), metadata=Metadata("rest")))


@cache
def thermal():
    from schuler.calibration.thermal.calibrate import calibrate_thermal

    cases = module("calibration/thermal/test_thermal.py")
    return calibrate_thermal(cases.soak_of([-20.0, 5.0, 30.0, 55.0, 30.0, 5.0], noise=1e-3, gap=0.005))


@cache
def field():
    """A field calibration with its truth, and its log."""
    path = "calibration/report/test_field_figures.py"
    errors = fixture(path, "errors")
    imu = fixture(path, "imu", errors)
    return fixture(path, "solution", imu), errors


@cache
def campaign():
    return module("reproduce/yaman/test_campaign_figures.py").campaign()


@cache
def modes():
    cases = module("reproduce/yaman/test_mode_figures.py")
    drive = cases.drive.__wrapped__()
    return cases.solutions.__wrapped__(drive), drive


@cache
def walked():
    from schuler.navigation.foot.errors import walk_errors
    from schuler.navigation.foot.run import navigate_foot

    recording = fixture("cli/test_foot.py", "recording")
    result = navigate_foot(recording, {"filter": {"smooth": "stride"}})
    return result, walk_errors(result, recording.reference)


@cache
def noise():
    cases = module("support/noise_cases.py")
    identified, imu = cases.identification(), cases.recording()
    from schuler.characterisation.report.spectra import log_spectra

    spectra = {name: s for name, s in log_spectra(imu).items() if name in identified.axes}
    lag = np.arange(0.0, 100.0, 5.0)
    return identified, imu, spectra, {name: (lag, np.exp(-lag / 20.0)) for name in identified.axes}


@cache
def scattered():
    """Made up: sixteen runs of an honest filter."""
    from schuler.montecarlo.error_scatter import Scatter

    t = np.linspace(0.0, 100.0, 26)
    claimed = np.tile(np.sqrt(0.1 + t[:, None] / 100.0), (1, 9))
    x = claimed * RNG(3).standard_normal((16, len(t), 9))
    sigma = x.std(axis=0, ddof=1)
    names = Scatter.__dataclass_fields__
    values = {
        "t": t, "mean": x.mean(axis=0), "sigma": sigma, "low": 0.74 * sigma, "high": 1.55 * sigma,
        "rms": np.sqrt(np.mean(x**2, axis=0)), "claimed": claimed, "runs": 16, "outages": ((40.0, 60.0),),
        "horizontal": np.quantile(np.hypot(x[:, :, 6], x[:, :, 7]), [0.5, 0.68, 0.95], axis=0).T,
        "nees": SimpleNamespace(low=0.9, high=1.1, mean=np.mean(x**2 / claimed**2, axis=(0, 2)), probability=0.95),
    }  # fmt: skip
    return SimpleNamespace(**{n: v for n, v in values.items() if n in names or n in ("rms",)})


@cache
def unknown():
    from schuler.observability import scenario_observability

    return scenario_observability(EXAMPLES / "observability_rotary_z_level.toml")


@cache
def rotary():
    import tomllib

    from schuler.rotary.search.comparison import compare_rotary

    raw = tomllib.loads((EXAMPLES / "rotary_static.toml").read_text())
    raw["motion"]["duration_s"] = 60.0
    raw["rates_deg_s"] = [10.0, 40.0]
    return compare_rotary(raw, runs=1)


@cache
def searched():
    from schuler.rotary.search.evolution import search_schemes
    from schuler.rotary.search.scenario import load_rotary

    scenario = load_rotary(EXAMPLES / "rotary_static.toml")
    return search_schemes(scenario.scheme_objective(), scenario.space(), scenario.settings(evaluations=50))


@cache
def turntable():
    from schuler.reproduce.du.study.zupt import TableCase, zupt_study
    from schuler.reproduce.du.study.zupt_runs import zupt_emulation

    study = zupt_study(["NAV440"], [TableCase(duration_s=60.0), TableCase("Z", 30.0, 60.0)])
    return zupt_emulation([("NAV440", "Z", None), ("NAV440", "Z", 30.0)], runs=2), study


@cache
def driven():
    from schuler.reproduce.du.study.imus import NAV440
    from schuler.reproduce.du.study.integrated import IntegratedDrive
    from schuler.reproduce.du.study.outages import rotary_comparison

    return rotary_comparison(NAV440, 10, drive=IntegratedDrive(NAV440, length_s=150.0, outages=((100.0, 140.0),)))


@cache
def at_rest():
    from schuler.reproduce.du.study.fixed_errors import chapter3

    return chapter3("bias", axes=[None, "Z"], rate_hz=10.0, duration_s=60.0, noise=True)


@cache
def static():
    from schuler.reproduce.du.study.imus import emulation
    from schuler.reproduce.du.study.static import static_test

    unit = emulation("NAV440", rate_hz=2.0)
    return static_test(unit, rates_deg_s=(20.0, 40.0), runs=10, duration_s=60.0, workers=1)


@cache
def road():
    from schuler.reproduce.du.study.imus import emulation
    from schuler.reproduce.du.study.kinematic import kinematic_test

    return kinematic_test(emulation("NAV440", rate_hz=5.0), runs=2, workers=1)


@cache
def turned():
    from schuler.rotary import schemes
    from schuler.rotary.calibration import calibrate_rotation
    from schuler.sensors.errors import ImuErrors
    from schuler.sensors.noise import NoiseModel, White

    cases = module("rotary/test_calibration.py")
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    errors = ImuErrors(b_g=cases.BIAS, M_g=cases.M_G, gyro_noise=NoiseModel((White(0.4 * DEG_PER_RTHR),)))
    return calibrate_rotation(cases.recording(schedule, errors, 140.0, rate_hz=20.0), schedule, cases.body())


@cache
def modulated():
    from schuler.rotary import schemes
    from schuler.rotary.modulated_errors import modulation, turning_vehicle
    from schuler.rotary.rotating_imu import RotatingMotion

    vehicle = turning_vehicle(np.array([0.8, 0.0, 0.0]), 5.0 * DEG, 72.0)
    motion = RotatingMotion(vehicle, schemes.continuous("z", 10.0 * DEG))
    t = np.linspace(0.0, 72.0, 73)
    return {name: modulation(motion, np.array([30.0, 20.0, 10.0]) * DEG_PER_HR, t) for name in ("a", "b", "c", "d")}


@cache
def accuracy():
    from schuler.reproduce.du.study.accuracy import calibration_trials, predicted_accuracy
    from schuler.reproduce.du.study.imus import emulation

    unit = emulation("NAV440", rate_hz=2.0)
    predicted = [predicted_accuracy(unit.gyro_random_walk, rate * DEG) for rate in (10.0, 20.0, 60.0)]
    return {"NAV440": predicted}, {"NAV440": calibration_trials(unit, runs=4, workers=1)}


@cache
def rocket():
    from schuler.reproduce.flenniken.study.rocket import rocket_trajectory
    from schuler.reproduce.flenniken.study.rocket.budget import impact_budget
    from schuler.reproduce.flenniken.study.rocket.scatter import impact_scatter
    from schuler.reproduce.flenniken.study.rocket.sensitivity import influence

    simple = module("reproduce/flenniken/rocket/test_scatter.py").SIMPLE
    T = rocket_trajectory(rate_hz=20.0)
    scatters = [impact_scatter(T, simple, runs=5, name=name) for name in ("a", "b", "c", "d")]
    return T, scatters, impact_budget(influence(T), simple.replaced(accel_bias_x=1e-3))


@cache
def heading():
    from schuler.reproduce.flenniken.study.heading import (
        constant_bias,
        heading_bound,
        heading_outages,
        recorded_outage,
        split_bias,
    )
    from schuler.reproduce.flenniken.study.heading.filters import BiasTruth
    from schuler.reproduce.flenniken.study.heading.outages import position_outage
    from schuler.sensors.catalogue import spec

    truth = BiasTruth(0.03, 0.024, 100.0, 0.1)
    two = constant_bias(1e-3, sigma_heading=1.0, sigma_bias=0.01)
    three = split_bias(1e-3, 1e-3, 100.0, sigma_heading=1.0, sigma_constant=0.01)
    bounds = [heading_bound(m, 0.01, duration=100.0) for m in (two, three)]
    outages = heading_outages(spec("flenniken-consumer"), runs=20, start_s=20.0, outage_s=20.0)
    recorded = recorded_outage(start_s=20.0, outage_s=20.0, rate_hz=2.0)
    return bounds, outages, recorded, position_outage(truth, runs=10, start_s=30.0, outage_s=10.0)


@cache
def grown():
    from schuler.growth import growth, planar_bounds
    from schuler.sensors.catalogue import spec

    imu = spec("flenniken-consumer")
    bounds = planar_bounds(imu, 5.0, runs=50)
    return growth(imu, np.arange(0.0, 60.0)), bounds


@cache
def cart():
    from schuler.reproduce.hayal.study.walk import CartWalk

    return CartWalk.of(2.0, 2.0)


@cache
def eight():
    from schuler.reproduce.stefanisko.study.campaign import figure_eight
    from schuler.reproduce.stefanisko.study.experiment import FigureEight
    from schuler.reproduce.stefanisko.study.sign_sets import sign_study

    case = FigureEight(outage_s=(10.0, 15.0), duration_s=16.0)
    return figure_eight(case, 3), sign_study(case, 2)


def fan_of(error: float = 1.0):
    from schuler.navigation.evaluation.outages import OutageStatistics

    age = np.arange(31.0)
    size = 0.1 + age**2 / 100.0
    e = error * RNG(1).standard_normal((30, 1, 3)) * size[None, :, None]
    cov = np.einsum("k,ij->kij", size**2, np.eye(3))
    return OutageStatistics(np.array([30.0]), np.arange(30.0), age, e, np.tile(cov, (30, 1, 1, 1)), "drive")


def subject(run: Any, **over: Any) -> Any:
    from schuler.navigation.report.subject import Subject

    how = {
        "smoothed": run.smoothed, "reference": run.truth, "truth_parameters": run.parameters, "gnss": run.gnss,
        "ranges": run.ranges,
    }  # fmt: skip
    return Subject(run.result, **(how | over))


def _hayal() -> dict[str, Callable]:
    from schuler.reproduce.hayal.study import figures as f
    from schuler.reproduce.hayal.study.multiposition import StudyCase, sweep

    ours = {"case 1": np.array([0.5, 1.0, 2.0])[:, None] * np.ones(9)}
    cases = [(s, o, m) for o in (3, 9) for s in (1, 2, 3, 4) for m in (1.0, 3.0, 5.0)]
    grid = SimpleNamespace(total=lambda imu, seeding, length: 1.0 + length + len(seeding))
    return {
        "sigma_figure": lambda: f.sigma_figure("t", {"case 1": np.ones(9)}, ours),
        "sweep_figure": lambda: f.sweep_figure(
            sweep(StudyCase("gyro"), "rate_factor", (1.0, 10.0), 4, RNG(1)), "rate_factor"
        ),
        "outage_figure": lambda: f.outage_figure(grid, "HG1700", 10),
        "short_outage_figure": lambda: f.short_outage_figure(
            "HG1700", dict.fromkeys(cases, 0.1), dict.fromkeys(cases, 0.11), (0.1, 0.1), 0.05
        ),
        "walk_figure": lambda: f.walk_figure(cart()),
        "earth_rate_figure": lambda: f.earth_rate_figure(0.8),
    }


def _stefanisko() -> dict[str, Callable]:
    from schuler.reproduce.stefanisko.study import figures as f

    t = np.linspace(0.0, 10.0, 101)
    r = np.column_stack([t, t**2, 0.0 * t])
    x = RNG(1).standard_normal((101, 6))
    C = np.tile(np.eye(3), (101, 1, 1))
    identified = SimpleNamespace(r_n=r + 1e-3, C_nb=C)
    ones = np.ones(3)
    return {
        "samples_figure": lambda: f.samples_figure(t, x[:, :3], x[:, 3:], (1.0, 1.0)),
        "track_figure": lambda: f.track_figure(t, r, 0.1 * t, identified),
        "paths_figure": lambda: f.paths_figure(dict.fromkeys("abcd", r)),
        "drift_figure": lambda: f.drift_figure(t, np.stack([r, 1.1 * r, 0.9 * r]), "t"),
        "moving_mean_figure": lambda: f.moving_mean_figure(t, t, 0.1 * t),
        "gnss_figure": lambda: f.gnss_figure(t, x[:, :3], x[:, 3:], (ones, ones)),
        "fused_figure": lambda: [f.fused_figure(eight()[0], part, "t", ones) for part in ("position", "biases")],
        "sign_figure": lambda: f.sign_figure(eight()[1]),
        "zupt_figure": lambda: f.zupt_figure(t, x, 0.0 * x + 1.0, np.zeros(6)),
    }


def _charts() -> dict[str, Callable]:
    from schuler.characterisation import allan_deviation, autocorrelation
    from schuler.reproduce.flenniken.study import figures as f
    from schuler.reproduce.flenniken.study.grade_comparison import overlay

    cases = module("reproduce/flenniken/test_figures.py")
    x = cases.X[:500]
    t = 0.5 * np.arange(len(x))
    seven = [f"{k}" for k in range(7)]
    two = np.array([1.0, 10.0])

    def allan():  # not before a test asks for it: names are needed to collect them
        curve = allan_deviation(x, 2.0)
        return f.allan_figure(dict.fromkeys(seven, curve), [(curve.tau, curve.deviation)], "deg/s")

    def correlation():
        r = autocorrelation(x, 2.0)
        return f.correlation_figure(dict.fromkeys(seven, r), {"model": (r.lag, 0.0 * r.lag)})

    return {
        "log_figure": lambda: f.log_figure(t, x, x, "deg/s"),
        "allan_figure": allan,
        "correlation_figure": correlation,
        "overlay_figure": lambda: f.overlay_figure({"one": overlay(cases.MODEL, x, 2.0, RNG(2), runs=39)}, "deg/s"),
        "series_figure": lambda: f.series_figure(t, dict.fromkeys(seven, x), "time [s]", "rate [deg/s]", "t"),
        "sweep_figure": lambda: f.sweep_figure(two, dict.fromkeys("ab", (two, 0.1 * two)), "x [-]", "y [-]", "t"),
    }  # fmt: skip


def _outages() -> dict[str, Callable]:
    from schuler.navigation.evaluation import figures as f

    cases = module("navigation/evaluation/test_outage_figures.py")
    t = np.arange(100.0)

    def separation():
        from schuler.navigation.evaluation.consistency import Separation

        return Separation(t, RNG(1).standard_normal((100, 9)), np.tile(np.eye(9), (100, 1, 1)), ((50.0, 60.0),))

    return {
        "fan": lambda: f.fan(fan_of()),
        "architectures": lambda: f.architectures(cases.comparison.__wrapped__()),
        "separation": lambda: f.separation(separation()),
    }


def _solutions(run: Callable[[str], Any]) -> dict[str, Callable]:
    """Figures of a navigation run, by module and name."""
    from carrier_town import slipped_town

    from schuler.gnss.point import solve_points
    from schuler.navigation.report import (
        accuracy,
        carriers,
        estimates,
        figures,
        fixes,
        innovations,
        outages,
        points,
        satellites,
        track,
    )
    from schuler.navigation.report import accuracy as a
    from schuler.recording import figures as logs

    def three():
        """A run of three outages, for a fan."""
        return run("make_run")(outages=((30.0, 38.0), (50.0, 58.0), (70.0, 78.0)))

    def kinds(name):
        s = subject(run(name))
        return [innovations.by_component(s, kind) for kind in innovations.kinds(s)]

    def blocks(name):
        s = subject(run(name))
        return [estimates.parameters(s, *group) for group in estimates.groups(s.result)]

    def ranges():
        return run("everything").ranges

    def each(figure):
        return [figure(single_points(with_truth)) for with_truth in (True, False)]

    def of_satellites():
        return [innovations.by_satellite(subject(run("everything")), kind) for kind in innovations.SATELLITE_KINDS]

    def rated_fixes():
        n = len(run("full").gnss)
        dop = np.outer(1.0 + 0.2 * np.sin(0.1 * np.arange(n)), (0.8, 1.4))
        return replace(run("full").gnss, quality=np.arange(n) % 3 + 1, n_satellites=9 + np.arange(n) % 4, dop=dop)

    full = lambda **over: subject(run("full"), **over)  # noqa: E731
    return {
        "navigation.report.accuracy.horizontal": lambda: a.horizontal(full()),
        "navigation.report.accuracy.errors": lambda: [a.errors(full(), block) for block in ("dr", "dv", "dpsi")],
        "navigation.report.accuracy.sigmas": lambda: a.sigmas(full()),
        "navigation.report.accuracy.normalised_errors": lambda: a.normalised_errors(full()),
        "navigation.report.outages.outage_figure": lambda: outages.outage_figure(full()),
        "navigation.report.innovations.by_satellite": of_satellites,
        "navigation.report.estimates.parameters": lambda: blocks("full") + blocks("everything"),
        "navigation.report.figures.overview_content": lambda: [figures.overview_content(s) for s in (full(), full(reference=None))],
        "navigation.report.innovations.by_component": lambda: kinds("wild") + kinds("everything"),
        "navigation.report.outages.outage_fan": lambda: outages.outage_fan(subject(three())),
        "navigation.report.satellites.sky": lambda: satellites.sky(ranges()),
        "navigation.report.satellites.timeline": lambda: satellites.timeline(ranges(), subject(run("everything"))),
        "navigation.report.satellites.geometry": lambda: satellites.geometry(ranges(), solve_points(ranges(), integrity=None)),
        "navigation.report.satellites.strengths": lambda: satellites.strengths(ranges()),
        "navigation.report.satellites.satellite_figures": lambda: satellites.satellite_figures(ranges()),
        "navigation.report.points.point_track": lambda: each(points.point_track),
        "navigation.report.points.position_figure": lambda: each(points.position_figure),
        "navigation.report.points.level_figure": lambda: each(points.level_figure),
        "navigation.report.points.status_figure": lambda: each(points.status_figure),
        "navigation.report.points.residual_figure": lambda: each(points.residual_figure),
        "navigation.report.carriers.carriers": lambda: carriers.carriers(slipped_town()[2]),
        "navigation.report.carriers.protection": lambda: carriers.protection(slipped_town()[2]),
        "navigation.report.accuracy.separation": lambda: accuracy.separation(full()),
        "navigation.report.fixes.stated": lambda: fixes.stated(full(gnss=rated_fixes())),
        "recording.figures.log_content": lambda: logs.log_content(short_log(), rests=((1.0, 3.0),)),
        "recording.figures.spectrogram_content": lambda: logs.spectrogram_content(short_log().imu, 0.0),
        "navigation.report.track.track": lambda: [track.track(full()), track.track(subject(run("wild")))],
        "navigation.report.track.profile": lambda: track.profile(full()),
        "navigation.report.track.motion": lambda: track.motion(full()),
    }  # fmt: skip


@cache
def short_log():
    """IMU, GNSS and wheels of a short drive."""
    return module("support/diagnosis_drives.py").drive(duration=90.0)


def _diagnosed():
    from schuler.diagnosis.report.figures import figures
    from schuler.diagnosis.run import diagnose

    return figures(diagnose(short_log()))


def _deep() -> dict[str, Callable]:
    from schuler.reproduce.stefanisko.study.deep import figures as f
    from schuler.reproduce.stefanisko.study.deep import scene as deep_scene
    from schuler.reproduce.stefanisko.study.deep import study as deep_study

    study = cache(lambda: deep_study.deep_study(deep_scene.agile, (30.0, 20.0), runs=1, seconds=6.0, window=(1.0, 3.0)))
    return {
        "overview_content": lambda: f.overview_content(study()),
        "discriminators_content": lambda: f.discriminators_content(),
    }


def cases(run: Callable[[str], Any]) -> dict[str, Callable]:
    """All of them: by ``module.function`` what makes one figure or several."""
    import schuler.observability.report as observability_figures
    from schuler.budget import report as budget_figures
    from schuler.calibration.design.plans import attitude_plan
    from schuler.calibration.report import applied, field_figures, field_panels, pose_figure, thermal_figure
    from schuler.calibration.report import figures as calibration_figures
    from schuler.calibration.report import panels as calibration_panels
    from schuler.calibration.report.output_figures import outputs
    from schuler.characterisation.report import figures as noise_figures
    from schuler.characterisation.report import panels as noise_panels
    from schuler.characterisation.report import spectra as noise_spectra
    from schuler.gnss.baseline_report import residual_figure
    from schuler.growth import figures as growth_figures
    from schuler.montecarlo import report as montecarlo_figures
    from schuler.navigation.foot import figures as foot_figures
    from schuler.reproduce.du.study import figures as du_figures
    from schuler.reproduce.du.study import filter_figures
    from schuler.reproduce.flenniken.study.heading import figures as heading_figures
    from schuler.reproduce.flenniken.study.rocket import figures as rocket_figures
    from schuler.reproduce.yaman.study import campaign_figures, mode_figures
    from schuler.reproduce.yaman.study import figures as yaman_figures
    from schuler.rotary import report as rotary_figures
    from schuler.studio import figures as studio_figures

    b, c, fp, fo = budget_figures, calibration_panels, field_panels, foot_figures
    r, s = filter_figures, du_figures
    m, h, g = montecarlo_figures, heading_figures, growth_figures

    def budget():
        from schuler.budget import budget_of

        return budget_of(covariance(), "horizontal", 149.0)

    def drive_mode(name, *more):
        solutions, drive = modes()
        return getattr(mode_figures, name)(solutions, drive.raw.reference, *(drive.outage for _ in more))

    def output(truth):
        before, true = module("calibration/report/test_output_figures.py").logs()
        return outputs(before, true, truth=true if truth else None)

    def drives():
        return fixture("reproduce/yaman/test_unit_drives_figure.py", "drives")

    def noise_of(function, *which):
        return function(noise()[0], *(noise()[k] for k in which))

    def perfect():
        from schuler.simulation.imu import ideal_imu
        from schuler.simulation.routine import RoutineMotion, thesis_routine

        routine = thesis_routine(dwell_s=2.0, repeats=1)
        return routine, ideal_imu(RoutineMotion(routine, np.array([0.7, 0.0, 0.0])), 10.0)

    def readings():
        from schuler.recording.series import ImuSeries
        from schuler.simulation.motion import ideal_rates
        from schuler.simulation.routine import RoutineMotion

        t = np.arange(0.0, 60.0, 0.1)
        gyro, accel = ideal_rates(RoutineMotion(perfect()[0], np.array([0.7, 0.0, 0.0])), t)
        return ImuSeries(t, gyro, accel)

    def bounds_beside():
        _, identified = grown()
        closed = {name: {"heading": identified.sigma["heading"]} for name in "abcd"}
        return g.beside_figure(dict.fromkeys("abcd", identified), ("heading", "velocity_north"), closed, "t")

    def driven_motion():
        from schuler.reproduce.du.study.drives import drive

        return drive(np.array([0.8, 0.0, 0.0]), rest_s=10.0)

    def histories():
        runs = list(at_rest().runs.values())
        return s.history_figure({"conventional": runs[0], "II": runs[1]}, random_walk=1e-4)

    out = {
        "budget.report.budget_content": lambda: [b.budget_content(budget()), b.budget_content(budget(), single=True)],
        "budget.report.covariance_content": lambda: b.covariance_content(covariance(), mission()),
        "budget.report.choice_content": lambda: b.choice_content(choice()),
        "calibration.report.figures.calibration_content": lambda: calibration_figures.calibration_content(
            calibration()
        ),
        "calibration.report.applied.rests_figure": lambda: applied.rests_figure(compared_rests()),
        "calibration.report.panels.all_figures": lambda: c.all_figures(calibration()),
        "calibration.report.panels.residuals": lambda: c.residuals(calibration()),
        "calibration.report.panels.coverage": lambda: c.coverage(calibration()),
        "calibration.report.panels.before_after": lambda: c.before_after(calibration()),
        "calibration.report.panels.correlation_map": lambda: c.correlation_map(calibration()),
        "calibration.report.panels.parameters": lambda: c.parameters(calibration()),
        "diagnosis.report.figures.figures": _diagnosed,
        "reproduce.yaman.study.mode_figures.position_figure": lambda: drive_mode("position_figure", "outage"),
        "reproduce.yaman.study.mode_figures.velocity_figure": lambda: drive_mode("velocity_figure"),
        "reproduce.yaman.study.mode_figures.attitude_figure": lambda: drive_mode("attitude_figure"),
        "reproduce.yaman.study.mode_figures.outage_figure": lambda: drive_mode("outage_figure", "outage"),
        "reproduce.yaman.study.campaign_figures.campaign_content": lambda: [
            campaign_figures.campaign_content(campaign(), which) for which in ("residual", "modelled", "left")
        ],
        "reproduce.yaman.study.campaign_figures.histograms": lambda: campaign_figures.histograms(
            campaign(), "normalised", campaign().names
        ),
        "reproduce.yaman.study.campaign_figures.left": lambda: campaign_figures.left(campaign(), campaign().names),
        "reproduce.yaman.study.mode_figures.modes": lambda: mode_figures.modes(drives()),
        "reproduce.yaman.study.campaign_figures.family_figure": lambda: campaign_figures.family_figure(
            field()[0], ("b_a_x",), field()[1]
        ),
        "calibration.report.field_figures.field_content": lambda: field_figures.field_content(
            field()[0], "estimates", truth=field()[1]
        ),
        "calibration.report.output_figures.outputs": lambda: [output(k) for k in (False, True)],
        "calibration.report.field_panels.field_panels": lambda: fp.field_panels(*field()),
        "calibration.report.field_panels.convergence": lambda: fp.convergence(field()[0]),
        "calibration.report.field_panels.estimates": lambda: fp.estimates(*field()),
        "calibration.report.field_panels.rests": lambda: fp.rests(field()[0]),
        "calibration.report.field_panels.innovations": lambda: fp.innovations(field()[0]),
        "reproduce.yaman.study.figures.drift": lambda: yaman_figures.drift(
            fixture("reproduce/yaman/test_static_figures.py", "drift_test")
        ),
        "navigation.foot.figures.track": lambda: fo.track(*walked()),
        "navigation.foot.figures.heights": lambda: fo.heights(walked()[0]),
        "navigation.foot.figures.detector": lambda: fo.detector(walked()[0]),
        "navigation.foot.figures.strides": lambda: fo.strides(walked()[0]),
        "navigation.foot.figures.error_figure": lambda: fo.error_figure(*walked()),
        "navigation.foot.figures.overview_content": lambda: [
            fo.overview_content(walked()[0]),
            fo.overview_content(*walked()),
        ],
        "growth.figures.growth_figure": lambda: g.growth_figure(grown()[0]),
        "growth.figures.bounds_figure": lambda: g.bounds_figure(grown()[1]),
        "growth.figures.beside_figure": bounds_beside,
        "growth.figures.difference_figure": lambda: g.difference_figure(
            grown()[1].t, {"heading": grown()[1].sigma["heading"]}, {"heading": grown()[1].sigma["heading"]}
        ),
        "reproduce.flenniken.study.heading.figures.bound_figure": lambda: h.bound_figure(
            heading()[0][0], {"three states": heading()[0][1]}
        ),
        "reproduce.flenniken.study.heading.figures.outage_figure": lambda: h.outage_figure(
            heading()[1], ("Gauss-Markov",)
        ),
        "reproduce.flenniken.study.heading.figures.recorded_figure": lambda: h.recorded_figure(heading()[2], 20.0),
        "reproduce.flenniken.study.heading.figures.position_figure": lambda: h.position_figure(heading()[3]),
        "montecarlo.report.all_figures": lambda: m.all_figures(scattered()),
        "montecarlo.report.scatter_figure": lambda: m.scatter_figure(scattered()),
        "montecarlo.report.horizontal_figure": lambda: m.horizontal_figure(scattered()),
        "montecarlo.report.nees_figure": lambda: m.nees_figure(scattered()),
        "characterisation.report.figures.all_figures": lambda: noise_figures.all_figures(
            noise()[0], imu=noise()[1], spectra=noise()[2], correlations=noise()[3]
        ),
        "characterisation.report.panels.allan": lambda: noise_of(noise_panels.allan),
        "characterisation.report.panels.comparison": lambda: noise_of(noise_panels.comparison),
        "characterisation.report.panels.ratio": lambda: noise_of(noise_panels.ratio),
        "characterisation.report.spectra.spectrum": lambda: noise_of(noise_spectra.spectrum, 2),
        "characterisation.report.spectra.log_spectrum": lambda: noise_spectra.log_spectrum(noise()[2]),
        "characterisation.report.spectra.autocorrelation": lambda: noise_of(noise_spectra.autocorrelation, 3),
        "characterisation.report.spectra.signals": lambda: noise_of(noise_spectra.signals, 1),
        "gnss.baseline_report.residual_figure": lambda: residual_figure(double_differences()),
        "studio.figures.calibration_figure": lambda: [
            studio_figures.calibration_figure(calibration(), name) for name in ("residuals", "correlations")
        ],
        "studio.figures.span_figure": lambda: [
            studio_figures.span_figure(looked_at(), name, 0.0, 50.0) for name in ("spectrum", "spectrogram")
        ],
        "observability.report.observability_figure": lambda: observability_figures.observability_figure(unknown()),
        "calibration.report.pose_figure.plan_content": lambda: pose_figure.plan_content(attitude_plan(26), 7),
        "reproduce.flenniken.study.rocket.figures.trajectory_figure": lambda: rocket_figures.trajectory_figure(
            rocket()[0]
        ),
        "reproduce.flenniken.study.rocket.figures.scatter_figure": lambda: rocket_figures.scatter_figure(*rocket()[1]),
        "reproduce.flenniken.study.rocket.figures.ranking_figure": lambda: rocket_figures.ranking_figure(rocket()[2]),
        "reproduce.flenniken.study.rocket.figures.error_types_figure": lambda: rocket_figures.error_types_figure(),
        "rotary.report.scheme_figure": lambda: rotary_figures.scheme_figure(rotary().rotary.schedule, 60.0),
        "rotary.report.modulation_figure": lambda: rotary_figures.modulation_figure(rotary()),
        "rotary.report.errors_figure": lambda: rotary_figures.errors_figure(rotary()),
        "rotary.report.rates_figure": lambda: rotary_figures.rates_figure(rotary()),
        "rotary.report.front_figure": lambda: rotary_figures.front_figure(searched()),
        "reproduce.du.study.filter_figures.zupt_runs": lambda: r.zupt_runs(turntable()[0], "NAV440", "Z"),
        "reproduce.du.study.filter_figures.zupt_sigmas": lambda: r.zupt_sigmas(turntable()[1], "NAV440"),
        "reproduce.du.study.filter_figures.sigma_histories": lambda: r.sigma_histories(driven()),
        "reproduce.du.study.filter_figures.outage_errors": lambda: r.outage_errors(driven()),
        "reproduce.du.study.filter_figures.growth": lambda: r.growth(driven()),
        "reproduce.du.study.figures.chapter3_figure": lambda: s.chapter3_figure(at_rest(), bias=at_rest()),
        "reproduce.du.study.figures.history_figure": histories,
        "reproduce.du.study.figures.rates_figure": lambda: s.rates_figure(static()),
        "reproduce.du.study.figures.kinematic_figure": lambda: s.kinematic_figure(road()),
        "rotary.report.calibration_figure": lambda: rotary_figures.calibration_figure(turned()),
        "reproduce.du.study.figures.modulated_biases": lambda: s.modulated_biases(modulated()),
        "reproduce.du.study.figures.drive_figure": lambda: s.drive_figure(driven_motion(), "t"),
        "reproduce.du.study.figures.drive_attitude": lambda: s.drive_attitude(driven()),
        "reproduce.du.study.figures.singular_values": lambda: s.singular_values(unknown().system, "t", points=3),
        "reproduce.du.study.figures.accuracy_figure": lambda: s.accuracy_figure(*accuracy()),
        "reproduce.yaman.study.figures.readings_figure": lambda: yaman_figures.readings_figure(readings()),
        "reproduce.yaman.study.figures.poses_figure": lambda: yaman_figures.poses_figure(perfect()[0]),
        "calibration.report.thermal_figure.thermal_content": lambda: thermal_figure.thermal_content(thermal()),
    }
    for name, group in (
        ("reproduce.hayal.study.figures", _hayal()), ("reproduce.stefanisko.study.figures", _stefanisko()), ("reproduce.flenniken.study.figures", _charts()),
        ("navigation.evaluation.figures", _outages()), ("reproduce.stefanisko.study.deep.figures", _deep()),
    ):  # fmt: skip
        out |= {f"{name}.{key}": make for key, make in group.items()}
    return out | _solutions(run)
