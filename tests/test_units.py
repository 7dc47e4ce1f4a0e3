"""Units: factors of data sheets, the reader of unit texts, and its refusals."""

import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schuler import units
from schuler.exceptions import InputError, SchulerError, UnitError
from schuler.units import factor_for, parse_unit

PI = math.pi
LAW = settings(max_examples=500, deadline=None, derandomize=True, database=None)


def dim(length=0, time=0, angle=0, temperature=0, field=0):
    return tuple(Fraction(x) for x in (length, time, angle, temperature, field))


RATE = dim(time=-1, angle=1)
FORCE = dim(length=1, time=-2)
ARW = dim(time=Fraction(-1, 2), angle=1)  # rad/sqrt(s), the same as (rad/s)/sqrt(Hz)
VRW = dim(length=1, time=Fraction(-3, 2))  # (m/s)/sqrt(s)
FIELD = dim(field=1)


@pytest.mark.parametrize(
    ("text", "printed", "dimension"),
    [
        # numbers printed in data sheets and textbooks beside their SI values
        ("deg", "1.745e-02", dim(angle=1)),
        ("arcsec", "4.848e-06", dim(angle=1)),
        ("deg/h", "4.848e-06", RATE),
        ("deg/sqrt(h)", "2.909e-04", ARW),
        ("deg/h/√Hz", "4.848e-06", ARW),
        ("deg/s/√Hz", "1.745e-02", ARW),
        ("ug", "9.807e-06", FORCE),
        ("mg", "9.807e-03", FORCE),
        ("ug/√Hz", "9.807e-06", VRW),
        ("m/s/√h", "1.667e-02", VRW),
        ("km/h", "2.778e-01", dim(length=1, time=-1)),
        ("kn", "5.144e-01", dim(length=1, time=-1)),
    ],
)
def test_factors_to_their_printed_digits(text, printed, dimension):
    unit = parse_unit(text)
    assert f"{unit.factor:.3e}" == printed
    assert unit.dimension == dimension


def test_a_line_of_a_data_sheet():
    """0.125 deg/sqrt(h) is 3.636e-5 rad/sqrt(s); 1 deg/h is 4.848e-6 rad/s; 0.008 m/s/sqrt(h) is 1.333e-4."""
    assert f"{0.125 * parse_unit('deg/√h').factor:.3e}" == "3.636e-05"
    assert f"{0.125 * units.DEG_PER_RTHR:.3e}" == "3.636e-05"
    assert f"{1.0 * parse_unit('deg/h').factor:.3e}" == "4.848e-06"
    assert f"{0.008 * parse_unit('m/s/√h').factor:.3e}" == "1.333e-04"
    assert f"{50.0 * parse_unit('ug/√Hz').factor:.3e}" == "4.903e-04"


G0 = 9.80665
SAME = [
    # (SI factor, dimension, habits of writing)
    (1.0, RATE, ("rad/s", "rad*Hz", "rad·s^-1")),
    (PI / 180, RATE, ("dps", "°/s", "deg/sec", "degrees/second", "DEG/S", "  deg / s  ")),
    (PI / 180 / 3600, RATE, ("dph", "deg/hr", "deg/hour", "°/h", "arcsec/s")),
    (1e-3, RATE, ("mrad/s",)),
    (1e-3 * PI / 180, RATE, ("mdps", "mdeg/s")),
    (PI / 180 / 60, dim(angle=1), ("arcmin",)),
    (2 * PI, dim(angle=1), ("rev",)),
    (1e-6, dim(angle=1), ("urad",)),
    (1e-6, RATE, ("µrad/s", "μrad/s")),
    (2 * PI / 60, RATE, ("rev/min",)),
    (G0, FORCE, ("g", "G")),
    (1e-3 * G0, FORCE, ("mg",)),
    (1e-6 * G0, FORCE, ("µg", "μg", "ug")),
    (1e-5, FORCE, ("mGal",)),
    (1e-2, FORCE, ("Gal", "cm/s²")),
    (1.0, FORCE, ("m/s^2", "m/s²", "m/s/s", "m*s^-2", "mps2", "m/s2")),
    (1e-3, FORCE, ("mm / s^2",)),
    (0.3048, FORCE, ("ft/s^2",)),
    (1 / 3.6, FORCE, ("km/h/s",)),
    (PI / 180 / 60, ARW, ("deg/√h", "deg/sqrt(h)", "deg/sqrt(hr)", "°/√hr", "deg/√(h)", "√(deg²/h)")),
    (PI / 180, ARW, ("dps/√Hz", "deg/s/sqrt(Hz)", "deg/(s*√Hz)", "(deg/s)/√(Hz)", "((deg)/(s))/(sqrt((Hz)))")),
    (PI / 180 / 3600, ARW, ("deg/hr/√Hz",)),
    (1.0, ARW, ("rad/√s",)),
    (1e-6 * G0, VRW, ("ug/√Hz", "µg/sqrt(Hz)")),
    (1e-3 * G0, VRW, ("mg/√Hz",)),
    (G0, VRW, ("g/√Hz",)),
    (1 / 60, VRW, ("m/s/√h", "m/s/sqrt(hr)", "mps/√hr", "m/√h/s")),
    (1.0, VRW, ("m/s^2/√Hz", "m/s²/√Hz")),
    (PI / 180 / 3600 / 60, dim(time=Fraction(-3, 2), angle=1), ("deg/h/√h",)),
    (PI / 180 / 3600 / G0, dim(time=1, angle=1, length=-1), ("deg/h/g",)),
    (1.0, dim(time=1), ("s", "1/Hz", "√√(s^4)")),
    (1e-3, dim(time=1), ("ms",)),
    (1e-6, dim(time=1), ("µs",)),
    (1e-9, dim(time=1), ("ns",)),
    (60.0, dim(time=1), ("min",)),
    (1 / 3.6, dim(length=1, time=-1), ("km/h", "kph")),
    (1852 / 3600, dim(length=1, time=-1), ("knots", "nmi/h")),
    (1.0, dim(length=1, time=-1), ("mps",)),
    (1e-6, dim(), ("ppm",)),
    (1e-2, dim(), ("%",)),
    (1.0, FIELD, ("T", "tesla")),
    (1e-3, FIELD, ("mT",)),
    (1e-6, FIELD, ("uT", "µT", "microtesla")),
    (1e-9, FIELD, ("nT",)),
    (1e-4, FIELD, ("gauss", "Gs")),
    (1e-7, FIELD, ("mgauss", "milligauss")),
    (1.0, dim(), ("1", "deg^0")),
    (1e-6, dim(temperature=-1), ("ppm/°C",)),
    (1e-3 * G0, dim(length=1, time=-2, temperature=-1), ("mg/degC",)),
    (1.0, dim(temperature=1), ("°C", "Celsius", "K")),
    (1.0, dim(length=1), ("m^3/m^2", "m³/m²", "meters", "m^9/m^8")),
    (1609.344, dim(length=1), ("mi",)),
    (1e-3, dim(length=1, time=-2), ("millimeters per second squared", "MillimeterPerSecondSquared")),
    (PI / 180, RATE, ("degrees per second", "((((((((deg/s))))))))")),
    (1.0, dim(length=-2), ("(m^2)^-1",)),
    (0.3048**2, dim(length=2), ("ft^2",)),
    (0.3048**4, dim(length=4), ("(ft²)²",)),
]  # fmt: skip


@pytest.mark.parametrize(("factor", "dimension", "texts"), SAME)
def test_ways_of_writing_a_unit(factor, dimension, texts):
    for text in texts:
        unit = parse_unit(text)
        assert unit.factor == pytest.approx(factor, rel=1e-15), text  # rounding
        assert unit.dimension == dimension, text
        assert unit.text == text.strip()


def test_named_factors_agree_with_the_texts():
    for name, text in {
        "DEG": "deg", "ARCSEC": "arcsec", "MIN": "min", "HR": "h", "G0": "g", "MG": "mg", "UG": "ug", "MGAL": "mGal",
        "PPM": "ppm", "PERCENT": "%", "NMI": "nmi", "KM": "km", "FT": "ft", "KNOT": "kn", "KMH": "km/h",
        "DEG_PER_HR": "deg/h", "DEG_PER_RTHR": "deg/√h", "DEG_PER_S_PER_RTHZ": "deg/s/√Hz",
        "DEG_PER_HR_PER_RTHZ": "deg/h/√Hz", "MPS_PER_RTHR": "m/s/√h", "UG_PER_RTHZ": "ug/√Hz",
        "DEG_PER_HR_PER_G": "deg/h/g",
    }.items():  # fmt: skip
        assert getattr(units, name) == pytest.approx(parse_unit(text).factor, rel=1e-15), name  # rounding


def test_the_g_of_data_sheets_is_the_standard_one():
    assert units.G0 == 9.80665


def test_random_walk_is_not_a_rate():
    """deg/√h and deg/h differ in dimension, so one can never be read as the other."""
    walk, rate = parse_unit("deg/√h"), parse_unit("deg/h")
    assert walk.dimension != rate.dimension
    assert walk.factor == pytest.approx(60.0 * rate.factor)
    with pytest.raises(UnitError, match=r"'deg/√h' is no unit of angular rate"):
        factor_for("deg/√h", "angular rate")


def test_an_angle_is_a_dimension():
    """A frequency is no angular rate, a ratio no angle, a reciprocal second no rate of turn."""
    for text in ("Hz", "1/s", "s^-1"):
        with pytest.raises(UnitError, match="no unit of angular rate"):
            factor_for(text, "angular rate")
    with pytest.raises(UnitError, match="no unit of ratio"):
        factor_for("rad", "ratio")


def test_division_reaches_to_the_next_sign_only():
    """``a/b*c`` is (a/b) c and ``a/b/c`` is a/(b c); a power binds to its own factor, a root to what follows it."""
    assert parse_unit("m/s*s").dimension == dim(length=1)
    assert parse_unit("m/(s*s)").dimension == dim(length=1, time=-2)
    assert parse_unit("m/s/s").dimension == parse_unit("m/(s*s)").dimension
    assert parse_unit("m/s^2").dimension == dim(length=1, time=-2)
    assert parse_unit("(m/s)^2").dimension == dim(length=2, time=-2)
    assert parse_unit("km/h^2").factor == pytest.approx(1000.0 / 3600.0**2)
    assert parse_unit("√Hz/s").dimension == dim(time=Fraction(-3, 2))
    assert parse_unit("√(Hz/s)").dimension == dim(time=-1)


def test_letters_that_differ_only_in_case_where_case_matters():
    assert parse_unit("mGal").factor == 1e-5
    assert parse_unit("mg").factor == pytest.approx(9.80665e-3)
    assert parse_unit("Hz").dimension == dim(time=-1)
    assert parse_unit("h").dimension == dim(time=1)
    assert parse_unit("m").dimension != parse_unit("min").dimension
    assert parse_unit("K").dimension == dim(temperature=1)
    with pytest.raises(UnitError, match=r"subtract 273\.15"):
        units.factor_for("K", "temperature")


def test_mu_in_both_code_points():
    """U+00B5 (micro sign) and U+03BC (Greek mu) look the same and mean the same."""
    for tail in ("g", "s", "rad"):
        assert parse_unit("\u00b5" + tail).factor == parse_unit("\u03bc" + tail).factor == parse_unit("u" + tail).factor


@pytest.mark.parametrize(
    ("quantity", "text", "factor"),
    [
        ("time", "ms", 1e-3),
        ("angle", "deg", PI / 180),
        ("angular rate", "deg/s", PI / 180),
        ("specific force", "g", G0),
        ("velocity", "kn", 1852 / 3600),
        ("length", "ft", 0.3048),
        ("temperature", "degC", 1.0),
        ("magnetic flux density", "mg", 1e-7),
        ("ratio", "ppm", 1e-6),
    ],
)
def test_factor_for_a_quantity(quantity, text, factor):
    assert factor_for(text, quantity) == pytest.approx(factor, rel=1e-15)
    assert factor_for(units.QUANTITIES[quantity][1], quantity) == 1.0  # the SI unit it names is read back as SI


@pytest.mark.parametrize("quantity", list(units.QUANTITIES))
def test_a_unit_of_another_quantity_is_refused_with_the_expected_one(quantity):
    wrong = "m" if quantity != "length" else "s"
    si = units.QUANTITIES[quantity][1].replace("^", r"\^")
    with pytest.raises(UnitError, match=rf"'{wrong}' is no unit of {quantity}; expected one such as {si}"):
        factor_for(wrong, quantity)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("furlong", r"unknown unit 'furlong' in 'furlong'; known are .*deg.*rad"),
        ("deg/fortnight", r"unknown unit 'fortnight' in 'deg/fortnight'"),
        ("", "expected a unit such as deg/s or m/s\\^2, got an empty text"),
        ("   ", "got an empty text"),
        ("deg/", "the unit 'deg/' ends too early"),
        ("(deg/s", r"lacks a closing bracket"),
        ("deg/s)", r"unexpected '\)'"),
        ("deg s", r"unexpected 's'"),
        ("(" * 9 + "m" + ")" * 9, r"nests brackets or roots deeper"),
        ("m^10", r"an exponent beyond \+-9"),
        ("(" * 50, r"the unit '\({40}'\.\.\. nests brackets"),
        ("deg/sqrt(h", "lacks a closing bracket"),
        ("√", "ends too early"),
        ("sqrt(", "ends too early"),
        ("()", r"unknown unit '\)'"),
        ("*deg", r"unknown unit '\*'"),
        ("^2", r"unknown unit '\^2'"),
        ("m/s^", r"cannot read the unit 'm/s\^' at '\^'; write for example deg/s"),
        ("m/s^1.5", r"at '\.5'"),
        ("m/s^x", r"at '\^x'"),
        ("deg;s", r"at ';s'"),
        ("3 deg", r"at '3 deg'"),
        ("deg\x00", "cannot read"),
        ("deg//s", "unknown unit '/'"),
    ],
)
def test_texts_that_are_no_unit_are_refused_with_a_reason(text, message):
    with pytest.raises(UnitError, match=message):
        parse_unit(text)


def test_a_unit_error_is_an_input_error_and_a_value_error():
    with pytest.raises(UnitError) as caught:
        parse_unit("nonsense")
    assert isinstance(caught.value, InputError)
    assert isinstance(caught.value, SchulerError)
    assert isinstance(caught.value, ValueError)


def parses_or_refuses(text):
    try:
        unit = parse_unit(text)
    except UnitError:
        return
    assert isinstance(unit.factor, float)
    assert math.isfinite(unit.factor)
    assert unit.factor > 0.0
    assert all(isinstance(e, Fraction) for e in unit.dimension)


@LAW
@given(st.text(max_size=30))
def test_any_text_is_a_unit_or_a_unit_error(text):
    parses_or_refuses(text)


PIECES = st.sampled_from(
    ["deg", "s", "h", "Hz", "g", "µg", "°", "°C", "m", "1", "%", "/", "*", "·", "√", "√(", "sqrt(", "(", ")", "^2",
     "^-1", "^0", "²", "³", " ", "Gal", "dps", "mps2", "s2", "^", "-", "2", "x"]
)  # fmt: skip


@LAW
@given(st.lists(PIECES, max_size=12).map("".join))
def test_any_text_made_of_pieces_of_units_is_a_unit_or_a_unit_error(text):
    parses_or_refuses(text)


@pytest.mark.parametrize(
    "text",
    ["h^999", "h^-999", "h" + "^9" * 6,
     "1/h" + "^9" * 6, "deg^999", "1/deg^999", "m^" + "9" * 5000, "s^99999999999999999999", "(" * 5000, "√" * 5000,
     "(" * 5000 + "m" + ")" * 5000],
    ids=["overflow", "underflow", "powers of powers",
         "their inverse", "zero", "division by zero", "5000 digits", "20 digits", "brackets", "roots",
         "nested brackets"],
)  # fmt: skip
def test_absurd_texts_are_a_unit_or_a_unit_error(text):
    """A header of a corrupt file may hold anything; the reader's only error is its own."""
    parses_or_refuses(text)


NAMES = st.sampled_from(["deg", "rad", "s", "h", "m", "g", "ug", "ft", "kn", "K", "ppm", "min", "mGal", "uT"])


@LAW
@given(NAMES, NAMES, NAMES)
def test_products_and_quotients_multiply_and_divide(a, b, c):
    A, B, C = (parse_unit(x) for x in (a, b, c))
    both = parse_unit(f"{a}*{b}/{c}")
    assert both.factor == pytest.approx(A.factor * B.factor / C.factor, rel=1e-14)  # rounding
    assert both.dimension == tuple(x + y - z for x, y, z in zip(A.dimension, B.dimension, C.dimension, strict=True))
    assert parse_unit(f"√({a}²)").factor == pytest.approx(A.factor, rel=1e-14)
    assert parse_unit(f"√({a}²)").dimension == A.dimension
    assert parse_unit(f"({a}/{b})/({a}/{b})").dimension == dim()
    assert parse_unit(f"{a}^-2").factor == pytest.approx(A.factor**-2, rel=1e-14)
