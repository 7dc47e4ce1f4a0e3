"""Shape and value checks: what is accepted, and what the messages say about what is not."""

import tracemalloc

import numpy as np
import pytest

from schuler.arrays import as_floats, as_vector3, readonly
from schuler.exceptions import FileFormatError, InputError, MissingExtraError, SchulerError, UnitError


@pytest.mark.parametrize(
    "value",
    [[1, 2, 3], (1.0, 2.0, 3.0), np.array([1, 2, 3]), np.array([1, 2, 3], dtype=np.float32), range(1, 4),
     np.array([9.0, 1.0, 9.0, 2.0, 9.0, 3.0])[1::2], np.array([3.0, 2.0, 1.0])[::-1],
     np.array([1, 2, 3], dtype=np.uint8)],
)  # fmt: skip
def test_numbers_become_contiguous_float64(value):
    array = as_floats(value, "x", (3,))
    assert array.dtype == np.float64
    assert array.flags.c_contiguous
    np.testing.assert_array_equal(array, [1.0, 2.0, 3.0])


def test_fortran_order_becomes_c_order():
    value = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    array = as_floats(value, "x")
    assert array.flags.c_contiguous
    np.testing.assert_array_equal(array, value)


@pytest.mark.parametrize(
    ("shape", "wanted"),
    [
        ((5, 3), (None, 3)),
        ((0, 3), (None, 3)),
        ((3,), (3,)),
        ((7,), (None,)),
        ((2, 3, 4), (2, None, 4)),
        ((4, 4), None),
    ],
)
def test_shapes_that_fit(shape, wanted):
    assert as_floats(np.ones(shape), "x", wanted).shape == shape


@pytest.mark.parametrize(
    ("shape", "wanted", "message"),
    [
        ((5, 2), (None, 3), r"gyro: expected shape \(n, 3\), got \(5, 2\)"),
        ((3, 5), (None, 3), r"gyro: expected shape \(n, 3\), got \(3, 5\)"),
        ((3,), (None, 3), r"gyro: expected shape \(n, 3\), got \(3,\)"),
        ((4,), (3,), r"gyro: expected shape \(3,\), got \(4,\)"),
        ((1, 3), (3,), r"gyro: expected shape \(3,\), got \(1, 3\)"),
        ((2, 3), (None,), r"gyro: expected shape \(n,\), got \(2, 3\)"),
        ((2, 2), (3, 3), r"gyro: expected shape \(3, 3\), got \(2, 2\)"),
    ],
)
def test_a_wrong_shape_is_named_with_the_wanted_one(shape, wanted, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        as_floats(np.ones(shape), "gyro", wanted)


def test_a_single_number_has_the_shape_of_a_single_number():
    """``shape=()`` asks for one number."""
    assert as_floats(3.0, "x", ()).shape == ()
    with pytest.raises(InputError, match=r"x: expected shape \(1,\), got \(\)"):
        as_floats(3.0, "x", (1,))


@pytest.mark.parametrize(
    ("value", "index"),
    [
        ([1.0, np.nan, 3.0], 1),
        ([np.inf, 1.0, np.nan], 0),
        ([1.0, 2.0, -np.inf], 2),
        ([[1.0, 2.0], [3.0, 4.0], [5.0, np.nan], [np.nan, 1.0]], 2),
        (np.nan, 0),
        (np.where(np.arange(24.0) == 13.0, np.nan, 0.0).reshape(4, 3, 2), 2),
    ],
)
def test_nan_and_infinity_are_refused_with_the_first_index(value, index):
    """The index counts along time, axis 0, whatever follows."""
    message = f"^accel: expected finite numbers, got NaN or infinity first at index {index}; cut or fill it$"
    with pytest.raises(InputError, match=message):
        as_floats(value, "accel")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("abc", "t: expected real numbers, got 'abc'"),
        (["1", "b"], r"t: expected real numbers, got \['1', 'b'\]"),
        ([[1, 2], [3]], r"t: expected real numbers, got \[\[1, 2\], \[3\]\]"),
        ({"a": 1}, r"t: expected real numbers, got \{'a': 1\}"),
        ([1.0, 2.0j], r"t: expected real numbers, got \[1\.0, 2j\]"),
        (object, "t: expected real numbers, got <class 'object'>"),
    ],
)
def test_what_is_no_number_is_shown(value, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        as_floats(value, "t")


def test_long_values_are_shortened_in_the_message():
    with pytest.raises(InputError, match=r"^t: expected real numbers, got '0{56}\.\.\.$"):
        as_floats("0" * 100 + "x", "t")


@pytest.mark.parametrize(
    "value",
    [np.array([1.0 + 0.0j, 2.0j]), np.array(["2020-01-01"], dtype="datetime64[ns]"),
     np.array([5], dtype="timedelta64[s]"), [10**400]],
    ids=["complex", "dates", "durations", "beyond float64"],
)  # fmt: skip
def test_arrays_that_numpy_would_squeeze_into_floats_are_refused(value):
    """Lists of complex numbers are refused, so are arrays of them; a date is no number of seconds by itself."""
    with pytest.raises(InputError, match=r"^t: expected"):
        as_floats(value, "t")


def test_vectors_have_three_elements():
    np.testing.assert_array_equal(as_vector3([1, 2, 3], "lever_arm"), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match=r"lever_arm: expected shape \(3,\), got \(2,\)"):
        as_vector3([1, 2], "lever_arm")
    with pytest.raises(InputError, match="lever_arm: expected finite numbers"):
        as_vector3([1, 2, np.nan], "lever_arm")


def test_readonly_is_the_same_array_with_writing_off():
    array = np.arange(3.0)
    frozen = readonly(array)
    assert frozen is array
    with pytest.raises(ValueError, match="read-only"):
        frozen[0] = 1.0


@pytest.mark.parametrize(
    ("path", "line", "message"),
    [
        (None, None, "no header"),
        ("a/log.csv", None, "a/log.csv: no header"),
        ("a/log.csv", 7, "a/log.csv:7: no header"),
    ],
)
def test_file_errors_start_with_the_place(path, line, message):
    error = FileFormatError("no header", path, line)
    assert str(error).replace("\\", "/") == message
    assert error.line == line
    assert (error.path is None) == (path is None)


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    error = MissingExtraError("pyarrow", "data", "reading Parquet")
    assert str(error) == "reading Parquet needs pyarrow, which is not installed: pip install 'schuler[data]'"
    assert isinstance(error, ImportError)


def test_every_error_of_a_user_is_a_schuler_error():
    """The command line turns these, and only these, into one line and exit code 2."""
    for kind in (InputError, UnitError, FileFormatError, MissingExtraError):
        assert issubclass(kind, SchulerError)
    assert issubclass(InputError, ValueError)


def test_a_value_of_sixty_characters_is_shown_and_a_longer_one_ends_in_dots():
    for length, shown in ((58, "'" + 58 * "x" + "'"), (59, "'" + 56 * "x" + "...")):
        with pytest.raises(InputError) as caught:
            as_floats(length * "x", "t")
        assert str(caught.value).partition("got ")[2] == shown


def test_masked_values_are_refused_and_a_mask_of_nothing_is_no_mask():
    """numpy would hand out what lies under the mask."""
    with pytest.raises(InputError, match="masked array; fill or cut"):
        as_floats(np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False]), "t")
    np.testing.assert_array_equal(as_floats(np.ma.array([1.0, 2.0, 3.0]), "t"), [1.0, 2.0, 3.0])


def test_a_long_array_is_checked_in_little_memory():
    x = np.zeros((1_500_000, 2))
    tracemalloc.start()
    assert as_floats(x, "x") is x
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.6 * x.size  # [byte]
    x[-1, -1] = np.nan
    with pytest.raises(InputError, match="first at index 1499999"):
        as_floats(x, "x")
