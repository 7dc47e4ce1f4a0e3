"""Compiled reading of tables: numbers are those of Python's ``float``, files are read as the slower code reads them."""

import math
import random
import struct
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import schuler
from schuler import frames, rotation
from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording.io import _kernels, checks, gnss_table, lines, local_frame, numbers
from schuler.recording.io.lines import TextTable
from schuler.recording.io.raw import Raw
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries, positive_definite
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase


def read_all(tmp_path, texts, **how):
    """Numbers of a file with one of the texts on each line."""
    path = tmp_path / "numbers.txt"
    path.write_text("\n".join(texts) + "\n", encoding="ascii")
    numbers_read = numbers.read_numbers(TextTable(path, 1, ","), 1, [] if how else [0], **how)
    assert numbers_read.rest == path.stat().st_size, texts[numbers_read.values.shape[1]]
    return numbers_read.stamps if how else numbers_read.values[0]


def assert_same_bits(numbers_read, texts):
    expected = np.array([float(text) for text in texts])
    wrong = np.flatnonzero(numbers_read.view(np.int64) != expected.view(np.int64))
    assert not len(wrong), [(texts[k], numbers_read[k], expected[k]) for k in wrong[:3]]


digits = st.text("0123456789", min_size=0, max_size=30)
written = st.builds(
    lambda sign, whole, part, power: f"{sign}{whole}.{part}{power}" if whole + part else f"{sign}0{power}",
    st.sampled_from(["", "-", "+"]),
    digits,
    digits,
    st.one_of(st.just(""), st.integers(-345, 345).map("e{}".format), st.integers(-30, 30).map("E{:+d}".format)),
)
doubles = st.floats(allow_nan=False, allow_infinity=False)
printed = st.builds(lambda fmt, x: fmt % x, st.sampled_from(["%r", "%.17g", "%.9f", "%.18e", "%.6g", "%.25f"]), doubles)
middles = doubles.map(lambda x: str(Decimal(x) + (Decimal(math.nextafter(x, math.inf)) - Decimal(x)) / 2))


# 100 examples of 20 texts each, and the ones below
@settings(max_examples=100, deadline=None, derandomize=True)
@given(texts=st.lists(st.one_of(written, printed, middles), min_size=20, max_size=20))
@example(texts=["9007199254740993", "9007199254740993.0", "9007199254740993" + "0" * 300, "0." + "0" * 300 + "1"])
@example(texts=["2.2250738585072011e-308", "4.9e-324", "1e400", "-1e400", "1e-400", "-0", "-0.0e99999", "1.", ".5"])
@example(texts=["1.7976931348623157e308", "1.7976931348623159e308", "0.1", "1e23", "8.5e22", "0.5", "5e-1", "1e-22"])
@example(texts=["nan", "NaN", "-inf", "+Infinity", "INF", "-nan"[1:]])
def test_numbers_are_those_of_float(tmp_path_factory, texts):
    assert_same_bits(read_all(tmp_path_factory.getbasetemp(), texts), texts)


def drawn(rng, n):
    """Texts as loggers print doubles of any size, texts of random digits, and texts near the middle of two doubles."""
    for _ in range(n):
        x = struct.unpack("<d", rng.randbytes(8))[0]
        x = x if math.isfinite(x) else rng.random()
        y = rng.uniform(-1.0, 1.0) * 10.0 ** rng.randint(-9, 9)
        kind = rng.randrange(8)
        if kind < 4:
            yield ("%.17g", "%.16g", "%.18e", "%r")[kind] % (x if rng.random() < 0.5 else y)
        elif kind == 4:
            yield f"{y:.{rng.randint(0, 25)}f}"
        elif kind == 5:
            yield f"{rng.randint(0, 10 ** rng.randint(1, 22))}e{rng.randint(-330, 300)}"
        else:
            x = math.ldexp(rng.getrandbits(53), rng.randint(-80, 80))
            middle = Decimal(x) + (Decimal(math.nextafter(x, math.inf)) - Decimal(x)) / 2
            yield str(middle) if kind == 6 else f"{middle:.{rng.randint(15, 19)}e}"


@pytest.mark.parametrize("cases", [20_000, pytest.param(10_000_000, marks=pytest.mark.slow)])
def test_many_numbers_are_those_of_float(tmp_path, cases):
    rng = random.Random(9)
    for _ in range(max(cases // 100_000, 1)):
        texts = list(drawn(rng, min(cases, 100_000)))
        assert_same_bits(read_all(tmp_path, texts), texts)


# 100 examples of 10 texts each
@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.lists(
        st.builds(
            lambda whole, part, power: f"{whole}.{part}e{power}",
            st.integers(-999_999_999, 999_999_999),
            st.text("0123456789", max_size=9),
            st.integers(-12, 0),
        ),
        min_size=10,
        max_size=10,
    )
)
@example(["1403636579.763555527", "1.403636579763555527e+09", "0.0000000005", "0.0000000015", "-0.0000000025", "7"])
def test_stamps_are_rounded_as_decimals_are(tmp_path_factory, texts):
    numbers_read = read_all(tmp_path_factory.getbasetemp(), texts, decimals=9, rounded=True)
    assert numbers_read.tolist() == [int((Decimal(text) * 10**9).to_integral_value()) for text in texts]


def test_nanoseconds_keep_all_digits_and_halves_are_not_taken(tmp_path):
    assert read_all(tmp_path, ["1403636579758555392", "-1", "4000000000000000000"], decimals=0).tolist() == [
        1403636579758555392,
        -1,
        4000000000000000000,
    ]
    for wrong in ("0.5", "4000000000000000001", "1e19", "nan", ""):
        (tmp_path / "x").write_text(f"1\n{wrong},\n" if not wrong else f"1\n{wrong}\n")
        numbers_read = numbers.read_numbers(TextTable(tmp_path / "x"), 1, [], decimals=0)
        assert (numbers_read.stamps.tolist(), numbers_read.rest) == ([1], 2), wrong


def outcome(path, how, used, n, large, allow):
    """What reading gives: the numbers and whether a line was cut, or the error."""
    lines.MANY, before = (0 if large else 1 << 60), lines.MANY
    try:
        values, cut = lines.load(TextTable(path, *how), n, used, allow_truncated=allow)
    except FileFormatError as error:
        return str(error)
    finally:
        lines.MANY = before
    return values.shape, values.tobytes(), cut


LAYOUTS = {
    "comma": ((2, ","), [0, 1, 2, 3], b"t,a,b,c\n1,2.5,-3e-2,4\n 5 ,6, 7\t,8 # said\n\n# all\n9,10,11,12\n"),
    "blanks": ((1, " "), [3, 0], b"  1  2\t3 4 \r\n5 6 7 8\r\n\r\n 9 0 1 2#x\r\n"),
    "tab": ((1, "\t"), [0, 3], b"1\tup\t\t4.5\n2\tdown\tx y\t 5\n3\t\xe9t\xe9\t-\t6\n"),
    "semicolon": ((1, ";", "//"), [1, 2], b"a;1.0;2;x/y\nb;3;4;z // end\n// none\nc;5;6;\n"),
    "dates": ((1, " ", "%", "latin-1", "/:"), [0, 1, 2, 3], b"2025/07 1:30\n2025/08   2:31 % x\n2025/09 3:32\n"),
    "quotes": ((1, ","), [0, 1, 2, 3], b'1,2,3,4\n"5",6,"7",8\n9,1,2,3\n'),
}


@pytest.mark.thinned(6)
@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("allow", [False, True])
def test_tables_and_their_damage_are_read_as_by_the_slower_code(tmp_path, name, allow):
    """Each layout, whole and damaged in 250 ways: cut off, characters changed, lines repeated. 3000 cases in all."""
    how, used, text = LAYOUTS[name]
    rng = random.Random(f"{name}{allow}")
    path = tmp_path / "log.txt"
    refused = 0
    for case in range(250):
        damaged = bytearray(text * rng.randint(1, 3))
        for _ in range(0 if case == 0 else rng.randint(1, 2)):
            at = rng.randrange(len(damaged) or 1)
            match rng.randrange(4):
                case 0 if damaged:
                    damaged[at] = rng.choice(b'0123456789+-.eE,; \t\r\n#%/"naif\x00\x0b\xa0\xe9')
                case 1:
                    del damaged[at : at + rng.randint(1, 4)]
                case 2:
                    damaged[at:at] = rng.choice(
                        [b"  ", b"\r", b"\n\n", b"# x", b"nan", b"1e", b",", b"\t", b"99999999999999999999"]
                    )
                case _:
                    del damaged[at:]
        path.write_bytes(bytes(damaged) or b" ")
        slow, fast = (outcome(path, how, used, 4, large, allow) for large in (False, True))
        assert fast == slow, bytes(damaged)
        refused += isinstance(slow, str)
    assert 20 < refused < 240


def test_pieces_of_a_file_meet_at_any_byte(tmp_path, monkeypatch):
    rows = np.random.default_rng(0).standard_normal((300, 3))
    path = tmp_path / "log.csv"
    path.write_text("# x\n" + "".join(f"{a!r},{b!r},{c!r}\n" for a, b, c in rows.tolist()))
    for piece in (80, 97, 128, 1000):
        monkeypatch.setattr(numbers, "_PIECE", piece)
        numbers_read = numbers.read_numbers(TextTable(path, 2), 3, [2, 0])
        np.testing.assert_array_equal(numbers_read.values, rows[:, [2, 0]].T)
    monkeypatch.setattr(numbers, "_PIECE", 30)  # a line is longer: for other code
    assert numbers.read_numbers(TextTable(path, 2), 3, [2, 0]).rest < path.stat().st_size


@pytest.fixture
def large(monkeypatch):
    monkeypatch.setattr(lines, "MANY", 0)


def test_a_fault_in_a_large_file_names_its_line(tmp_path, large):
    good = "".join(f"{k * 0.01:.2f},0,0,-9.81,0,0,0\n" for k in range(3000))
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay,az,gx,gy,gz\n" + good + "30.0,0,0,-9.8l,0,0,0\n30.01,0,0,-9.81,0,0,0\n")
    with pytest.raises(FileFormatError, match=r"csv:3002: column 4: expected a number, got '-9.8l'"):
        schuler.read(path, units="m/s^2,rad/s")
    path.write_text("t,ax,ay,az,gx,gy,gz\n" + good + "30.0,0,0,-9")
    with pytest.raises(FileFormatError, match=r"csv:3002: the last line is incomplete"):
        schuler.read(path, units="m/s^2,rad/s")
    cut = schuler.read(path, units="m/s^2,rad/s", allow="truncated")
    assert len(cut.imu) == 3000
    assert "The last line was cut off and left out." in cut.metadata.notes


def drive(n=400):
    rng = np.random.default_rng(3)
    t = 200_000.0 + np.arange(n) / 100.0
    imu = ImuSeries(t, 1e-3 * rng.standard_normal((n, 3)), [0.0, 0.0, -9.81] + 0.01 * rng.standard_normal((n, 3)))
    a = np.arange(n) / n
    llh = np.column_stack((0.8 + 1e-5 * a, 0.2 + 1e-5 * np.sin(a), 500.0 + a))
    v_n = rng.standard_normal((n, 3))
    C_nb = rotation.dcm_from_rpy(np.column_stack((0.1 * a, 0.2 * a, 6.0 * a - 3.0)))
    metadata = Metadata(name="d", time=TimeBase("gps", 2374 * 604_800.0))
    return Recording(imu=imu, reference=Trajectory.from_geodetic(t, llh, v_n, C_nb), metadata=metadata)


@pytest.mark.parametrize(("format", "name"), [("euroc", "set"), ("kf_gins", "folder"), ("tum", "path.txt")])
def test_formats_are_the_same_by_either_way(tmp_path, monkeypatch, format, name):
    d = drive()
    if format == "tum":
        d = Recording(reference=d.reference, metadata=d.metadata)
    schuler.write(d, tmp_path / name, format=format)
    hints = {} if format != "kf_gins" else {"format": format}
    slow = schuler.read(tmp_path / name, **hints)
    monkeypatch.setattr(lines, "MANY", 0)
    fast = schuler.read(tmp_path / name, **hints)
    assert fast.metadata == slow.metadata
    for part in ("imu", "reference"):
        if (a := getattr(slow, part)) is not None:
            b = getattr(fast, part)
            for field in ("t", "gyro", "accel", "r_eb_e", "v_eb_e", "q_eb"):
                if getattr(a, field, None) is not None:
                    # attitudes are normalised by sums that depend on how the numbers lie in memory: rounding
                    limit = 5e-16 if field == "q_eb" else 0.0
                    np.testing.assert_allclose(getattr(b, field), getattr(a, field), rtol=0, atol=limit)


def test_a_recording_keeps_no_more_memory_than_its_numbers(tmp_path, large):
    path = tmp_path / "log.csv"
    rows = "".join(f"{k * 0.01:.2f},0.0,0.0,-9.81,0.0,0.0,0.0,25.0\n" for k in range(3000))
    path.write_text("t,ax,ay,az,gx,gy,gz,temp\n" + rows)
    imu = schuler.read(path, units="m/s^2,rad/s").imu
    for values in (imu.t, imu.accel, imu.gyro, imu.temperature):
        assert values.base is None or values.base.nbytes == values.nbytes
        assert values.flags.writeable


def test_windows_are_those_of_numpy(monkeypatch):
    rng = np.random.default_rng(1)
    accel, gyro = rng.standard_normal((25_000, 3)) + 5.0, rng.standard_normal((25_000, 3))
    compiled = checks._windows(accel, gyro, 240, 103)
    monkeypatch.setattr(checks, "_MANY", 1 << 60)
    np.testing.assert_allclose(compiled, checks._windows(accel, gyro, 240, 103), rtol=1e-11)  # rounding


@pytest.mark.parametrize("parts", ["all", "place", "no attitude"])
def test_compiled_references_are_those_of_numpy(parts):
    rng = np.random.default_rng(2)
    n = 1000
    llh = np.column_stack((rng.uniform(-1.57, 1.57, n), rng.uniform(-3.1, 3.1, n), rng.uniform(-100, 9000, n)))
    v_n = rng.standard_normal((n, 3)) * 20.0 if parts != "place" else None
    rpy = np.column_stack((rng.uniform(-3, 3, n), rng.uniform(-1.5, 1.5, n), rng.uniform(-3, 7, n)))
    rpy = rpy if parts == "all" else None
    t = np.arange(float(n))
    compiled = gnss_table._compiled(t, llh, v_n, rpy)
    twin = Trajectory.from_geodetic(t, llh, v_n, None if rpy is None else rotation.dcm_from_rpy(rpy))
    np.testing.assert_allclose(compiled.r_eb_e, twin.r_eb_e, rtol=0, atol=5e-9)  # rounding of 6.4e6 m
    for field, tolerance in (("v_eb_e", 1e-13), ("q_eb", 1e-14)):
        a, b = getattr(compiled, field), getattr(twin, field)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * max(1.0, np.abs(b).max()))  # rounding


def test_poses_of_a_local_frame_are_those_of_matrices(tmp_path):
    rng = np.random.default_rng(4)
    q = rng.standard_normal((500, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    r, v, origin = rng.standard_normal((500, 3)) * 1e3, rng.standard_normal((500, 3)), (0.8, 0.2, 400.0)
    C_bs = local_frame.FLU
    values = local_frame.earth_fixed(origin, r, q, v, C_bs, tmp_path)
    C_el = frames.C_en(np.array(origin)) @ local_frame.ENU
    q_eb = rotation.quat_from_dcm(C_el @ rotation.dcm_from_quat(q) @ C_bs.T)
    np.testing.assert_allclose(np.stack([values[k] for k in ("qw", "qx", "qy", "qz")], axis=1), q_eb, atol=1e-14)
    r_e = frames.ecef_from_llh(np.array(origin)) + r @ C_el.T
    np.testing.assert_allclose(np.stack([values[k] for k in "xyz"], axis=1), r_e, rtol=0, atol=5e-9)
    np.testing.assert_allclose(np.stack([values[f"v{k}"] for k in "xyz"], axis=1), v @ C_el.T, rtol=0, atol=1e-14)


def test_covariances_are_judged_by_their_eigenvalues():
    rng = np.random.default_rng(5)
    half = rng.standard_normal((20_000, 3, 3))
    cov = half @ np.swapaxes(half, 1, 2)
    # as rounding does: some of the cross terms grow beyond what their variances allow
    grow = rng.uniform(0.9, 1.3, (20_000, 3))
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        cov[:, i, j] = cov[:, j, i] = cov[:, i, j] * grow[:, k]
    expected = np.linalg.eigvalsh(cov).min(axis=1) > 0.0
    assert 0.2 < expected.mean() < 0.9
    np.testing.assert_array_equal(positive_definite(cov), expected)
    # accuracies of very different size: eigenvalues lose the smallest one, correlations do not
    wide = np.diag([1e-12, 1e12, 1.0])[None]
    assert positive_definite(wide).all()


def test_columns_that_lie_side_by_side_are_not_copied(tmp_path):
    whole = np.arange(12.0).reshape(4, 3).copy()
    raw = Raw(tmp_path, dict(zip("abc", whole.T, strict=True)))
    assert raw.stack(("a", "b", "c")) is whole
    for names in (("a", "c", "b"), ("a", "b"), ("b", "c")):
        stacked = raw.stack(names)
        assert not np.shares_memory(stacked, whole)
        np.testing.assert_array_equal(stacked, whole[:, ["abc".index(name) for name in names]])


def test_tables_that_the_compiled_code_does_not_cut_are_left_alone(tmp_path):
    path = tmp_path / "x.txt"
    path.write_bytes(b"head\rline\n1,2\n")
    for table in (
        TextTable(path, 2),
        TextTable(path, 1, "e"),
        TextTable(path, 1, ",", "1"),
        TextTable(path, 1, ",", ","),
    ):
        assert numbers.read_numbers(table, 2, [0, 1]) is None
    assert issubclass(FileFormatError, SchulerError)


def test_powers_of_ten_are_the_leading_bits():
    tens, twos, *_ = numbers._tables()
    assert twos[1 - _kernels.LEAST_TWO] == 2.0
    for q in range(_kernels.LEAST, _kernels.MOST + 1):
        high, low = (int(x) for x in tens[q - _kernels.LEAST])
        unit = ((217706 * q) >> 16) - 127
        bits, exact = (high << 64) + low, Decimal(10) ** q
        assert 1 << 127 <= bits < 1 << 128
        with_context = Decimal(bits) * Decimal(2) ** unit
        assert abs(with_context / exact - 1) < Decimal(2) ** -80
