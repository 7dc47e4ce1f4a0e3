"""Numbers and sentences on a noise model: units by hand, laws between the numbers, digits that mean something."""

import math
from dataclasses import replace

import noise_cases as cases
import numpy as np
import pytest

from schuler import units as u
from schuler.characterisation.report import terms as noise_terms
from schuler.characterisation.report import text as noise_text
from schuler.characterisation.result import AXES, NoiseIdentification
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, White, gauss_markov
from schuler.sensors.spec import ImuSpec


@pytest.fixture(scope="module")
def identified() -> NoiseIdentification:
    return cases.identification()


def test_units_are_those_of_the_data_sheet_constructors():
    """One of each in the unit of the table is what the constructor of the budget makes of a one."""
    sheet = {"N": "arw_deg_rthr", "B": "bias_instability_deg_hr", "K": "rrw_deg_hr_rthr", "R": "ramp_deg_hr_hr",
             "Q": "quantisation_arcsec"}  # fmt: skip
    field = {letter: name for name, letter in noise_terms.FIELDS.items()}
    from schuler.sensors.sheets import AccelerometerSheet, GyroSheet, sheet_keys

    for letter, key in sheet.items():
        name, factor = sheet_keys(GyroSheet)[key]
        assert name == field[letter]
        assert noise_terms.quantities("gyro")[letter].factor == pytest.approx(factor, rel=1e-15)  # rounding
    sheet = {"N": "vrw_m_s_rthr", "B": "bias_instability_ug", "K": "rrw_ug_rthr", "R": "ramp_ug_hr",
             "Q": "quantisation_m_s"}  # fmt: skip
    for letter, key in sheet.items():
        _, factor = sheet_keys(AccelerometerSheet)[key]
        assert noise_terms.quantities("accel")[letter].factor == pytest.approx(factor, rel=1e-15)  # rounding


@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_si_units_have_the_dimension_of_the_data_sheet_unit(triad):
    for letter, q in noise_terms.quantities(triad).items():
        si, sheet = u.parse_unit(q.si), u.parse_unit(q.sheet)
        assert si.dimension == sheet.dimension, letter
        assert sheet.factor / si.factor == pytest.approx(q.factor, rel=1e-12), letter  # rounding


def test_terms_add_up_to_the_model(identified):
    """All of N, K, R and Gauss-Markov exactly; B only where 1/f noise and its simulated sum agree, to 3 %."""
    tau = np.geomspace(0.01, 2000.0, 30)
    accel = identified.axes["accel_x"]
    total = sum(noise_terms.term_variances(accel, tau).values())
    np.testing.assert_allclose(total, accel.model.allan_variance(tau), rtol=1e-12)  # rounding
    gyro = identified.axes["gyro_x"]
    tau = np.geomspace(10.0, 2000.0, 30)
    total = sum(noise_terms.term_variances(gyro, tau).values())
    np.testing.assert_allclose(np.sqrt(total), gyro.fitted(tau), rtol=0.03)  # discretisation: one process a decade


def test_closed_forms_of_terms_at_their_customary_places(identified):
    gyro = identified.axes["gyro_x"]
    at = {label: float(np.sqrt(v[0])) for label, v in noise_terms.term_variances(gyro, [1.0]).items()}
    assert at["N"] == pytest.approx(cases.GYRO["N"], rel=1e-15)  # rounding
    assert at["B"] == pytest.approx(math.sqrt(2.0 * math.log(2.0) / math.pi) * cases.GYRO["B"], rel=1e-15)
    assert np.sqrt(noise_terms.term_variances(gyro, [3.0])["K"][0]) == pytest.approx(cases.GYRO["K"], rel=1e-15)
    other = noise_terms.term_variances(identified.axes["gyro_y"], [math.sqrt(3.0)])
    assert np.sqrt(other["Q"][0]) == pytest.approx(1e-7, rel=1e-15)
    assert np.sqrt(noise_terms.term_variances(identified.axes["gyro_y"], [math.sqrt(2.0)])["R"][0]) == pytest.approx(
        1e-9
    )


def test_shares_sum_to_one_and_the_largest_stands_first(identified):
    for axis in identified.axes.values():
        for tau in (0.01, 1.0, 100.0, 2000.0):
            s = list(noise_terms.shares(axis, tau).values())
            assert sum(s) == pytest.approx(1.0, abs=1e-14)  # rounding
            assert s == sorted(s, reverse=True)
    assert next(iter(noise_terms.shares(identified.axes["gyro_x"], 0.01))) == "N"
    assert next(iter(noise_terms.shares(identified.axes["gyro_x"], 1e4))) == "K"


def test_angle_random_walk_is_the_angle_after_an_hour(identified):
    text = noise_text.meaning(identified.axes["gyro_x"], "N")
    assert "after one hour the angle of a perfect integration is uncertain by 0.3 deg" in text
    assert "after a minute by 0.0387 deg" in text  # 0.3 / sqrt(60)
    scatter = White(cases.GYRO["N"]).variance(1.0 / cases.RATE) ** 0.5 / u.DEG
    assert f"one sample at 100 Hz scatters by {scatter:.3g} deg/s" in text


def test_velocity_random_walk_and_bias(identified):
    assert "velocity of a perfect integration is uncertain by 0.06 m/s" in noise_text.meaning(
        identified.axes["accel_x"], "N"
    )
    assert "0.664 B = 3.99 deg/h" in noise_text.meaning(identified.axes["gyro_x"], "B")
    assert "walks away by 20 deg/h" in noise_text.meaning(identified.axes["gyro_x"], "K")
    assert "changes by 0.743 deg/h in every hour" in noise_text.meaning(identified.axes["gyro_y"], "R")
    assert "0.0206 arcsec on every integrated angle" in noise_text.meaning(identified.axes["gyro_y"], "Q")


def test_what_a_gauss_markov_bias_does_in_an_hour_against_simulation(identified):
    """The closed form in the sentence against 400 integrated runs: statistical, four standard errors of a deviation."""
    sigma, tau = identified.axes["accel_x"].gauss_markov[1]
    rng = np.random.default_rng(11)
    runs = gauss_markov(sigma.value, tau.value, (3600, 400), 1.0, rng)
    text = noise_text.meaning(identified.axes["accel_x"], "GM2")
    stated = float(text.partition("uncertain by ")[2].partition(" m/s")[0])
    assert runs.sum(axis=0).std() == pytest.approx(stated, rel=4.0 / math.sqrt(2 * 400))


def test_a_gauss_markov_bias_longer_than_the_hour_is_a_constant(identified):
    """sigma T for tau much longer than T, to T / tau / 6."""
    axis = replace(
        identified.axes["accel_x"], gauss_markov=((cases.estimate(1e-4), cases.estimate(1e7)),),
        model=White(1e-3) + GaussMarkov(1e-4, 1e7),
    )  # fmt: skip
    assert "uncertain by 0.36 m/s" in noise_text.meaning(axis, "GM")
    assert noise_text.meaning(axis, "GM time").startswith("After 2.78e+03 h")


@pytest.mark.parametrize(
    ("value", "half", "expected"),
    [
        (0.3, 0.012, "0.300 (0.288 to 0.312)"),
        (20.0, 0.8, "20.00 (19.20 to 20.80)"),
        (90.0, 18.0, "90 (72 to 108)"),
        (600.0, 240.0, "600 (360 to 840)"),
        (8.7e-05, 3.5e-06, "8.70e-05 (8.35e-05 to 9.05e-05)"),
        (1.0, 1e-9, "1.00000 (1.00000 to 1.00000)"),
        (5.0, 40.0, "5.0 (-35.0 to 45.0)"),
    ],
)
def test_digits_follow_the_uncertainty(value, half, expected):
    e = cases.estimate(value)
    assert noise_text.with_interval(replace(e, low=value - half, high=value + half)) == expected


def test_intervals_without_an_end_are_said_in_words():
    e = replace(cases.estimate(0.25), low=0.0, high=math.inf)
    assert noise_text.with_interval(e) == "0.2500 (0.0000 to unbounded)"
    assert "nan" not in noise_text.with_interval(replace(e, low=math.nan))


def test_summary_has_every_number_axis_finding_and_the_budget(identified):
    text = noise_text.summary(identified)
    assert text.splitlines()[0] == "an <IMU> & more: noise of 3 axes from 3 h at 100 Hz, method gmwm"
    assert "N [deg/sqrt(h)]             0.300 (0.288 to 0.312)       0.330 (0.317 to 0.343)" in text
    assert "N [m/s/sqrt(h)]             0.0600 (0.0577 to 0.0624)" in text
    assert "GM2 time [s]                600 " in text
    assert "refused, gyro_z repeats" in text
    assert "warning, recording: The IMU warmed up" in text
    assert "angle random walk N" in text
    assert text.count("gyro_z repeats") == 1
    assert "nan" not in text.lower()


def test_verdict_is_three_sentences(identified):
    how_large, what, believe = noise_text.verdict(identified)
    assert "0.3 to 0.33 deg/sqrt(h)" in how_large
    assert "accelerometer white noise 0.06 m/s/sqrt(h)" in how_large
    assert "(gyro_x, the worst)" in what
    assert "gyro_z was refused" in believe
    assert "1 warning" in believe
    clean = replace(
        identified, refused={}, findings=(), axes={"gyro_x": replace(identified.axes["gyro_x"], findings=())}
    )
    assert noise_text.verdict(clean)[2].endswith("nothing was found that speaks against the recording.")
    short = replace(identified, axes={"gyro_y": identified.axes["gyro_y"]})
    assert "too short to say whether longer would help" in noise_text.verdict(short)[1]


def test_read_off_values_stand_beside_the_fitted(identified):
    rows = {row[0].split()[0]: row for row in noise_text.read_off_rows(identified.axes["gyro_x"])}
    assert rows["N,"][1:3] == ("0.309", "0.3")
    assert rows["K,"][1:3] == ("24", "20")
    assert rows["K,"][3].endswith("so this reading is not K")  # at 3 s nearly all is white noise
    assert "so this" not in rows["N,"][3]
    assert rows["minimum,"][2] == "3.986"
    assert "% B" in rows["minimum,"][3]
    rows = {row[0].split()[0]: row for row in noise_text.read_off_rows(identified.axes["accel_x"])}
    assert "without a B in the model" in rows["minimum,"][3]
    assert noise_text.read_off_rows(replace(identified.axes["accel_x"], read_off={})) == []


def test_a_chance_dip_at_the_end_is_neither_bias_instability_nor_the_verdict(identified):
    axis = identified.axes["gyro_x"]
    dip = axis.curve.deviation.copy()
    dip[-1] *= 0.1
    read = {**axis.read_off, "minimum": float(dip[-1]), "minimum_tau_s": float(axis.curve.tau[-1])}
    axis = replace(axis, curve=replace(axis.curve, deviation=dip), read_off=read)
    rows = {row[0].split()[0]: row for row in noise_text.read_off_rows(axis)}
    assert "few averages are left" in rows["minimum,"][3]
    before = noise_text.verdict(replace(identified, axes={"gyro_x": identified.axes["gyro_x"]}))
    assert noise_text.verdict(replace(identified, axes={"gyro_x": axis}))[:2] == before[:2]


def test_findings_stand_in_the_order_of_their_weight(identified):
    assert [f.severity for _, f in noise_text.findings(identified)] == ["refused", "warning", "note"]


def test_agreement_counts_averaging_times(identified):
    axis = identified.axes["gyro_x"]
    assert noise_terms.agreement(axis) > 0.9
    raised = replace(axis, curve=replace(axis.curve, low=2.0 * axis.fitted(axis.curve.tau)))
    assert noise_terms.agreement(raised) == 0.0
    assert math.isnan(noise_terms.agreement(replace(axis, curve=replace(axis.curve, low=np.full(40, np.nan)))))


def test_axes_are_chosen_by_name(identified):
    assert [a.axis for a in noise_terms.chosen(identified, None)] == [a for a in AXES if a in identified.axes]
    assert [a.axis for a in noise_terms.chosen(identified, "gyro_y")] == ["gyro_y"]
    with pytest.raises(
        InputError, match=r"expected some of gyro_x, gyro_y, accel_x, got 'gyro_z'; it was refused: gyro"
    ):
        noise_terms.chosen(identified, ["gyro_z"])


def test_nothing_left_to_report(identified):
    empty = replace(identified, axes={}, spec=None, refused=dict.fromkeys(AXES, (cases.STUCK,)))
    assert "no axis could be identified" in noise_text.summary(empty)
    assert "there are no numbers" in noise_text.verdict(empty)[0]
    with pytest.raises(InputError, match="no axis was identified"):
        noise_terms.chosen(empty, None)
    assert isinstance(identified.spec, ImuSpec)
