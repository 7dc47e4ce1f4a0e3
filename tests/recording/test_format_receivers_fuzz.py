"""Messages with right checksums and any contents: readers raise errors of ours or return a recording, without warnings.

Damage of bytes is caught by the checksums; what is behind them is only reached with messages that pass. Numbers are
drawn from those that break readers: not-a-number, infinities, zeros, the largest and the smallest of each kind.
"""

import struct
from contextlib import suppress

import encode_novatel as nov
import encode_sbf as sbf
import encode_sbg
import encode_vectornav as vn
import encode_xsens as xs
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schuler.exceptions import SchulerError
from schuler.recording import Recording
from schuler.recording.formats import novatel_frames, sbf_blocks, sbg, xsens_messages
from schuler.recording.io import read

pytestmark = pytest.mark.usefixtures("unguarded")

SPECIAL = [struct.pack("<d", x) for x in (0.0, -0.0, 1.0, 48.0, -2e10, 1e300, -1e300, 1e-300)]
SPECIAL += [struct.pack("<d", float(x)) for x in ("nan", "inf", "-inf")]
SPECIAL += [struct.pack("<f", float(x)) for x in ("nan", "inf", "1", "9.81", "-2e10", "3e38")]
SPECIAL += [b"\x00" * 8, b"\xff" * 8, b"\x01\x00\x00\x00", b"\x04\x00\x00\x00", b"\x7f\xff", b"\xfc\x08", b"\x00" * 4]
bodies = st.one_of(
    st.lists(st.sampled_from(SPECIAL), max_size=24).map(b"".join),
    st.binary(max_size=140),
)


def novatel(draw):
    number = draw(st.sampled_from([n for n, _ in novatel_frames.LAYOUTS.values()]))
    week, ms, body = draw(st.sampled_from((0, 2300, 65535))), draw(st.integers(0, 2**32 - 1)), draw(bodies)
    if draw(st.booleans()):
        return nov.short_frame(number, week, ms, body[:255])
    return nov.long_frame(number, week, ms, body)


def septentrio(draw):
    number = draw(st.sampled_from([n for n, _ in sbf_blocks.LAYOUTS.values()]))
    week, ms = draw(st.sampled_from((0, 2300, 65535))), draw(st.sampled_from((0, 1000, 2000, 2**32 - 1)))
    return sbf.block(number, week, ms, draw(bodies), draw(st.integers(0, 3)))


def vectornav(draw):
    names = draw(st.sets(st.sampled_from(sorted(set(vn.FIELDS) - {"RawMeas"})), min_size=1, max_size=8))
    values = {}
    for name in names:
        form = vn.FIELDS[name][2]
        size = struct.calcsize(form)
        body = (draw(bodies) + bytes(size))[:size]
        values[name] = struct.unpack(form, body)
    return vn.packet(**values)


def xsens(draw):
    payload = b""
    for _ in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from([*xsens_messages.ITEMS, *xsens_messages.WHOLE, 0xE020]))
        if kind in xsens_messages.ITEMS:
            form = draw(st.integers(0, 3))
            size = (4, 4, 6, 8)[form] * xsens_messages.ITEMS[kind][1]
            kind |= form | draw(st.sampled_from((0, 4, 8, 12)))
        else:
            size = draw(st.sampled_from((2, 4, 12, 94)))
        payload += xs.item(kind, (draw(bodies)[::-1] + bytes(size))[:size])
    return xs.message(payload)


def sbg_systems(draw):
    number = draw(st.sampled_from([n for n, _ in sbg.LAYOUTS.values()]))
    return encode_sbg.frame(number, draw(bodies) + bytes(draw(st.integers(0, 80))))


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("name", "message"),
    [("novatel", novatel), ("sbf", septentrio), ("vectornav", vectornav), ("xsens", xsens), ("sbg", sbg_systems)],
)
@pytest.mark.parametrize("logs", [15, pytest.param(60, marks=pytest.mark.fuzz)])
def test_any_contents(tmp_path, name, message, logs):
    """Logs of up to 12 messages each, some of them repeated."""
    path = tmp_path / "log"

    @settings(max_examples=logs, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(st.data())
    def run(data):
        messages = [message(data.draw) for _ in range(data.draw(st.integers(1, 12)))]
        messages += messages[: data.draw(st.integers(0, 3))]
        path.write_bytes(b"".join(messages))
        options = data.draw(st.sampled_from(({}, {"scale": "STIM300"} if name == "novatel" else {"time": "local"})))
        if name == "sbf":
            options = {}
        with suppress(SchulerError):
            assert isinstance(read(path, format=name, allow="norm", **options), Recording)

    run()
