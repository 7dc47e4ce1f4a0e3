"""Whatever a file holds, readers raise errors of ours and never warn (pytest turns every warning into a failure)."""

import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schuler.exceptions import SchulerError
from schuler.recording import Recording
from schuler.recording.io import read

pytestmark = pytest.mark.usefixtures("unguarded")

HEADERS = (
    "t,ax,ay,az,gx,gy,gz",
    "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]",
    "t;lat;lon;h;sn;se;sd;q;ns",
    "# time ax ay az gx gy gz",
    "t,x,y,z,vx,vy,vz,qw,qx,qy,qz",
    "t,speed,sspeed",
    "%  GPST   latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio",
    "%  UTC   x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio",
    '# schuler {"format": "schuler/csv/1", "holds": "imu", "series": {"imu": {"rows": 1}}, "metadata": {"name": "x", '
    '"time": {"scale": "gps", "epoch_gps_s": 0}, "sources": {}, "axes": "FRD", "notes": [], "options": {}}}'
    "\nt,ax,ay,az,gx,gy,gz",
    '# schuler {"format": "schuler/csv/1"',
    "",
)
numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(-10.0, 10.0).map(repr),
    st.integers(-(10**25), 10**25).map(str),
    st.sampled_from(("", "nan", "1e999", "-0", "1e-320", "0x1p3", "1_0", "1,5", "--1", "٣", '"1"', '"', "1e30", " ")),
)
delimiters = st.sampled_from((",", ";", "\t", " ", "|", ", "))
ends = st.sampled_from(("\n", "\r\n", "\r", "\n\n", "\x0b"))


@st.composite
def tables(draw) -> bytes:
    """Rows of numbers of equal or wild length, increasing times or not, cut off or not."""
    delimiter, end = draw(delimiters), draw(ends)
    width, n = draw(st.integers(1, 16)), draw(st.integers(0, 12))
    rows = []
    for k in range(n):
        fields = draw(st.lists(numbers, min_size=width, max_size=width))
        if draw(st.booleans()):
            fields[0] = str(k)
        if draw(st.integers(0, 9)) == 0:
            fields = draw(st.lists(numbers, max_size=20))
        rows.append(delimiter.join(fields))
    text = end.join([draw(st.sampled_from(HEADERS)), *rows, draw(st.sampled_from(("", "# end", "\x1a")))])
    data = text.encode(draw(st.sampled_from(("utf-8", "utf-8-sig", "utf-16"))))
    return data[: draw(st.integers(0, len(data)))] if draw(st.integers(0, 4)) == 0 else data


@st.composite
def solutions(draw) -> bytes:
    """Lines like those of RTKLIB with some of their fields replaced."""
    row = "2025/07/08 19:34:{}.499 40.0966268 -105.1474483 1601.4740 1 21 0.01 0.02 0.03 0.01 -0.015 0.012 0.00 12.5"
    lines = [draw(st.sampled_from(HEADERS[6:8]))]
    for k in range(draw(st.integers(1, 6))):
        fields = row.format(10 + k).split()
        for _ in range(draw(st.integers(0, 2))):
            fields[draw(st.integers(0, len(fields) - 1))] = draw(numbers)
        lines.append(" ".join(fields))
    return "\n".join(lines).encode()


contents = st.one_of(
    st.binary(max_size=400), st.text(max_size=400).map(lambda s: s.encode("utf-8", "replace")), tables(), solutions()
)
hints = st.fixed_dictionaries(
    {},
    optional={
        "columns": st.sampled_from(
            (
                "t,ax,ay,az,gx,gy,gz",
                "ax,ay,az,gx,gy,gz",
                "t,ax,ay,az,gx,gy,gz,*",
                "t,lat,lon,h",
                "t=t [s],ax=ax [m/s^2]",
            )
        ),
        "units": st.sampled_from(
            ("g,deg/s", "m/s^2,rad/s,ms", "accel=mg,gyro=deg/h,t=ns", "counts,counts", "angle=rad")
        ),
        "rate": st.floats(1e-4, 1e7),
        "time": st.sampled_from(("gps-tow:2374", "gps", "unix", "gps-unix", "local")),
        "axes": st.sampled_from(("FRD", "RFU", "BLD")),
        "delimiter": st.sampled_from((",", "tab", "blanks")),
        "skip": st.integers(0, 3),
        "comment": st.sampled_from(("#", "%", "//", "t")),
        "sigma": st.sampled_from(("1,1,2", "1,1,2,0.1,0.1,0.1", "1e-200,1,1")),
        "sigma_speed": st.floats(1e-300, 1e300),
        "scale": st.sampled_from(("accel=1e15,gyro=1e-15", "2,3")),
        "rest": st.floats(1e-3, 1e9),
        "offset": st.floats(-1e10, 1e10),
        "allow": st.sets(
            st.sampled_from(("norm", "magnitude", "truncated", "no-gyro", "no-accel", "no-velocity", "height"))
        ),
        "series": st.sampled_from(("imu", "gnss", "odometer", "reference")),
    },
)


EXAMPLES = pytest.mark.parametrize("examples", [60, pytest.param(1000, marks=pytest.mark.fuzz)])


@EXAMPLES
def test_malformed_text_raises_only_errors_of_ours(examples):
    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(data=contents, options=hints, name=st.sampled_from(("log.csv", "log.txt", "log.pos", "log")))
    def law(data, options, name):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(data)
            with suppress(SchulerError):
                recording = read(path, **options)
                assert isinstance(recording, Recording)
                assert recording.metadata.sources

    law()


IMU_ROWS = [f"{k / 100},{0.1 + 0.001 * (k % 3)},-0.2,-9.79,0.001,{0.001 * (k % 2)},0" for k in range(120)]
GOOD = (
    ("\n".join(IMU_ROWS), {"columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s"}),
    ("\n".join([HEADERS[1], *IMU_ROWS]), {}),
    ("\n".join([HEADERS[8], *IMU_ROWS]), {}),
    ("\n".join([HEADERS[6], *(f"2374 {k} 40.1 -105.1 1600 1 9 0.01 0.02 0.03 0.01 0 0 0 9" for k in range(9))]), {}),
    ("\n".join(["t,lat,lon,h,sn,se,sd,q", *(f"{k},48.{k},9.2,300,1,1,2,5" for k in range(9))]), {}),
    ("\n".join(["t,speed [km/h],sspeed [m/s]", *(f"{k},{3 * k},0.1" for k in range(9))]), {}),
)


@st.composite
def spoilt(draw) -> tuple[bytes, dict]:
    """A good log with up to three bytes, fields or lines changed: most of it is read before the fault is met."""
    text, options = draw(st.sampled_from(GOOD))
    lines = text.split("\n")
    for _ in range(draw(st.integers(0, 3))):
        k = draw(st.integers(0, len(lines) - 1))
        match draw(st.integers(0, 4)):
            case 0:
                lines[k] = lines[draw(st.integers(0, len(lines) - 1))]
            case 1:
                lines.insert(k, draw(st.sampled_from(("", " ", "#", "# x", ",", "t,ax", "\x00", "1", "\t"))))
            case 2:
                separator = "," if "," in lines[k] else " "
                fields = lines[k].split(separator)
                fields[draw(st.integers(0, len(fields) - 1))] = draw(numbers)
                lines[k] = separator.join(fields)
            case 3:
                del lines[k:]
                lines.append(draw(st.sampled_from(("", "0"))))
            case _:
                at = draw(st.integers(0, len(lines[k])))
                lines[k] = lines[k][:at] + draw(st.characters()) + lines[k][at + 1 :]
    return draw(st.sampled_from(("\n", "\r\n"))).join(lines).encode("utf-8", "replace"), options


@EXAMPLES
def test_spoilt_logs_raise_only_errors_of_ours(examples):
    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(log=spoilt(), more=st.one_of(st.just({}), hints))
    def law(log, more):
        data, options = log
        with tempfile.TemporaryDirectory() as folder, suppress(SchulerError):
            path = Path(folder) / "log.csv"
            path.write_bytes(data)
            assert isinstance(read(path, **{**more, **options}), Recording)

    law()


@settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    data=st.binary(max_size=300),
    options=hints,
    start=st.sampled_from((b"PAR1", b"MATLAB 5.0 MAT-file", b"\x93NUMPY", b"PK\x03\x04")),
)
def test_malformed_binary_files_raise_only_errors_of_ours(data, options, start):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.bin"
        path.write_bytes(start + data)
        with pytest.raises(SchulerError):
            read(path, **options)
