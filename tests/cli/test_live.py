"""``schuler live`` from the wire to the outlet: every kind of source on this machine, and a batch run's numbers."""

import json
import os
import queue
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import ExitStack, nullcontext

import numpy as np
import pytest
from command import refusal, run
from format_drives import drive
from tests.live.test_decoders import novatel_log, sbf_log, vectornav_log
from tests.recording.test_format_sbg import log_of as sbg_log

import schuler
from schuler import frames
from schuler.cli import main
from schuler.files import write_text
from schuler.live import LiveNavigator
from schuler.navigation.config import NavigationConfig

CONFIG = """
[imu]
catalogue = "MTi-G-710"

[alignment]
method = "given"  # one that is found by itself is learnt from other parts of a log than of a stream
rpy_deg = [1.146, 1.719, 28.65]
sigma_deg = [0.5, 0.5, 1.0]

[filter]
smooth = false
tune = false

[recording.imu]
file = "imu.csv"
columns = "t,ax,ay,az,gx,gy,gz"
units = "m/s^2,rad/s"
axes = "FRD"
time = "gps-tow:2300"

[recording.gnss]
file = "gnss.csv"
columns = "t,lat,lon,h,vn,ve,vd"
units = "angle=deg"
height = "ellipsoidal"
sigma = "0.5,0.5,1,0.05,0.05,0.05"
time = "gps-tow:2300"
"""
LONGEST_S = 240.0  # kernels may have to be compiled
SLICE_S = 2.0
CLOSE_M = 1e-8  # rounding: of geodetic coordinates, and of sums over blocks of other lengths


def lines(*columns):
    return "".join(",".join(repr(float(v)) for v in row) + "\n" for row in np.column_stack(columns)).encode()


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Folder with the log of a short drive as text, its configuration, and what a batch run makes of it."""
    folder = tmp_path_factory.mktemp("drive")
    made = drive(25.0)
    imu, gnss = made.imu, made.gnss
    (folder / "imu.csv").write_bytes(lines(imu.t, imu.accel, imu.gyro))
    (folder / "gnss.csv").write_bytes(lines(gnss.t, np.rad2deg(gnss.llh[:, :2]), gnss.llh[:, 2], gnss.v_n))
    config = write_text(folder / "drive.toml", CONFIG)
    recording = schuler.read(folder, **NavigationConfig.load(config).recording)
    return folder, config, schuler.navigate(recording, config).trajectory


def compare(rows, trajectory, in_time=True):
    """Solutions as JSON against the trajectory of a batch run at their times; the number compared.

    Of two streams that come each at its own pace fixes may come late: the last solution has them all.
    """
    solutions = [row for row in rows if "event" not in row]
    assert {row["health"] for row in solutions} <= {"ok", "coasting"}
    t = np.array([row["t_s"] for row in solutions])
    at = np.searchsorted(trajectory.t, t - 1e-7)
    np.testing.assert_allclose(trajectory.t[at], t, atol=1e-9)
    llh = np.array([[np.deg2rad(row["lat_deg"]), np.deg2rad(row["lon_deg"]), row["height_m"]] for row in solutions])
    off = np.linalg.norm(frames.ecef_from_llh(llh) - trajectory.r_eb_e[at], axis=1)
    assert (off.max() if in_time else off[-1]) < CLOSE_M, off
    assert off.max() < 0.5
    return len(t)


def read_lines(path):
    """Objects of the whole lines of a file that may still be written to."""
    return [json.loads(line) for line in path.read_text().split("\n")[:-1]]


def test_a_replayed_log_is_the_batch_run(log, tmp_path, capsys):
    folder, config, trajectory = log
    out, nmea = tmp_path / "live.jsonl", tmp_path / "live.nmea"
    code, printed, _ = run(
        capsys, "live", f"replay:{folder}?speed=0", "--config", config, "--output-rate", 10, "--json",
        "--out", f"json:{out}", "--out", f"nmea:{nmea}", "--record", tmp_path / "run",
    )  # fmt: skip
    assert code == 0
    numbers = json.loads(printed)
    rows = read_lines(out)
    assert numbers["solutions"] == compare(rows, trajectory) > 100
    assert [row["event"] for row in rows if "event" in row][:2] == ["start", "health"]
    table = schuler.read(tmp_path / "run" / "solution.parquet").reference
    np.testing.assert_array_equal(table.t, [row["t_s"] for row in rows if "event" not in row])
    fixes = schuler.read(nmea).gnss
    np.testing.assert_allclose(frames.ecef_from_llh(fixes.llh), table.r_eb_e, atol=1e-3)  # printed digits


@pytest.mark.campaign
def test_a_run_recorded_as_mcap_is_navigated_again(log, tmp_path, capsys):
    """Input and solution in one file: the batch run of the file is the live run."""
    pytest.importorskip("mcap")
    folder, config, _ = log
    out, path = tmp_path / "live.jsonl", tmp_path / "live.mcap"
    code, _, err = run(
        capsys, "live", f"replay:{folder}?speed=0", "--config", config, "--out", f"mcap:{path}", "--out", f"json:{out}"
    )
    assert code == 0, err
    assert "left out of mcap" not in err
    again = schuler.navigate(schuler.read(path), write_text(tmp_path / "drive.toml", CONFIG.partition("[recording")[0]))
    assert compare(read_lines(out), again.trajectory) > 100
    assert run(capsys, "live", f"replay:{folder}", "--config", config, "--out", f"mcap:{path}")[0] == 2


@pytest.mark.campaign
def test_a_second_run_into_a_folder_adds_to_it(log, tmp_path, capsys):
    for _ in range(2):
        assert run(capsys, "live", f"replay:{log[0]}?speed=0", "--config", log[1], "--record", tmp_path)[0] == 0
    first, second = (schuler.read(tmp_path / f"solution{k}.parquet").reference for k in ("", "-2"))
    np.testing.assert_array_equal(first.r_eb_e, second.r_eb_e)


@pytest.mark.campaign
def test_a_log_at_its_pace_takes_its_time(log, tmp_path, capsys):
    folder, config, trajectory = log
    began = time.monotonic()
    out = tmp_path / "live.jsonl"
    assert run(capsys, "live", f"replay:{folder}?speed=20", "--config", config, "--out", f"json:{out}")[0] == 0
    assert time.monotonic() - began > 24.9 / 20.0
    assert compare(read_lines(out), trajectory) > 100


class Sender:
    """Sends the two streams of a log slice by slice, so that neither runs ahead of the other."""

    def __init__(self, folder, send_imu, send_gnss, out):
        self.streams = [
            (send, (folder / name).read_bytes().splitlines(keepends=True))
            for send, name in ((send_gnss, "gnss.csv"), (send_imu, "imu.csv"))
        ]
        self.out = out
        self.first, self.last = (float(self.streams[1][1][k].partition(b",")[0]) for k in (0, -1))

    def run(self):
        for start in np.arange(self.first, self.last, SLICE_S):
            for send, rows in self.streams:
                for row in rows:
                    if start <= float(row.partition(b",")[0]) < start + SLICE_S:
                        send(row)
                time.sleep(0.04)
            if start > self.first + 2.0 * SLICE_S:  # aligned by then
                self.wait_for(min(start + SLICE_S, self.last) - 0.2)

    def wait_for(self, t):
        began = time.monotonic()
        while time.monotonic() - began < LONGEST_S:
            rows = [row for row in read_lines(self.out) if "event" not in row] if self.out.exists() else []
            if rows and rows[-1]["t_s"] >= t:
                return
            time.sleep(0.02)
        raise AssertionError(f"no solution at {t} s: {self.out.read_text()[-2000:]}")


@pytest.fixture
def ports():
    sockets = [socket.socket() for _ in range(2)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    numbers = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return numbers


def imu_stream(kind, port, held):
    """Address of a source for the IMU, and a function that returns one which sends to it once it is connected."""
    if kind == "serial":
        pytest.importorskip("serial")
        master, slave = os.openpty()
        held.callback(os.close, master)
        held.callback(os.close, slave)
        return f"serial:{os.ttyname(slave)}", lambda: lambda data: os.write(master, data)
    if kind == "udp":
        sender = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        return f"udp://:{port}", lambda: lambda data: sender.sendto(data, ("127.0.0.1", port))
    if kind == "ws":
        return f"ws://127.0.0.1:{port}/imu", websocket_stream(port, held)
    if kind == "mosquitto":
        return f"mqtt://127.0.0.1:{port}/imu", mosquitto_stream(port, held)
    server = held.enter_context(socket.create_server(("127.0.0.1", port)))
    if kind == "mqtt":
        pytest.importorskip("paho.mqtt")
        return f"mqtt://127.0.0.1:{port}/imu", lambda: subscribed(held.enter_context(server.accept()[0]))
    return f"tcp://:{port}", lambda: held.enter_context(server.accept()[0]).sendall


def websocket_stream(port, held):
    """Server of a WebSocket in a thread; returns a function that waits for its client."""
    serve = pytest.importorskip("websockets.sync.server").serve
    clients, ended = queue.Queue(), threading.Event()

    def handle(connection):
        clients.put(connection)
        ended.wait(LONGEST_S)

    server = serve(handle, "127.0.0.1", port)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    held.callback(thread.join, LONGEST_S)
    held.callback(server.shutdown)
    held.callback(ended.set)
    return lambda: clients.get(timeout=LONGEST_S).send


def subscribed(client):
    """A broker of MQTT 3.1.1 for one client that subscribes to one topic; returns what publishes there."""
    client.recv(1000)  # CONNECT
    client.sendall(b"\x20\x02\x00\x00")
    packet = client.recv(1000)  # SUBSCRIBE: type, length, identifier (2), length of the topic (2), topic, quality
    client.sendall(b"\x90\x03" + packet[2:4] + b"\x00")

    def publish(payload):
        body = packet[4:-1] + payload
        client.sendall(bytes((0x30, len(body) % 128 | 0x80, len(body) // 128)) + body)

    return publish


def mosquitto_stream(port, held):
    """The broker of Debian, and another client that publishes."""
    if shutil.which("mosquitto") is None:
        pytest.skip("mosquitto is not installed")
    client_module = pytest.importorskip("paho.mqtt.client")
    broker = subprocess.Popen(["mosquitto", "-p", str(port)], stderr=subprocess.DEVNULL)
    held.callback(broker.wait, LONGEST_S)
    held.callback(broker.terminate)

    def connect():
        client = client_module.Client(client_module.CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", port)
        client.loop_start()
        held.callback(client.loop_stop)
        time.sleep(2.0)  # the subscriber connects again every second
        return lambda row: client.publish("imu", row)

    return connect


@pytest.mark.parametrize("kind", ["udp", "tcp", "serial", "ws", "mqtt", "mosquitto"])
@pytest.mark.thinned(6)
def test_streams_are_the_batch_run(log, tmp_path, ports, kind):
    folder, config, trajectory = log
    out, codes, stop = tmp_path / "live.jsonl", [], threading.Event()
    with ExitStack() as held:
        source, connect = imu_stream(kind, ports[0], held)
        gnss = held.enter_context(socket.create_server(("127.0.0.1", ports[1])))
        arguments = [
            "live", f"{source}?part=imu", f"tcp://:{ports[1]}?part=gnss&retry=0", "--config", str(config), "--out",
            f"json:{out}", "--output-rate", "10", "--set", "filter.smooth=false", "--record", str(tmp_path / "run"),
        ]  # fmt: skip
        thread = threading.Thread(target=lambda: codes.append(run_with(stop, arguments)))
        thread.start()
        try:
            client = held.enter_context(gnss.accept()[0])
            Sender(folder, connect(), client.sendall, out).run()
        finally:
            stop.set()
            thread.join(LONGEST_S)
    assert codes == [0]
    assert compare(read_lines(out), trajectory, in_time=False) > 100
    kept = sorted((tmp_path / "run").glob("source-*"))
    assert [path.read_bytes().replace(b"\r", b"") for path in kept] == [
        (folder / name).read_bytes() for name in ("imu.csv", "gnss.csv")
    ]


def run_with(stop, arguments):
    """Run a command that another thread ends by an event, as a signal would."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("schuler.cli.live._stopped_by_signals", lambda: nullcontext(stop))
        return main(arguments)


def test_standard_input_and_a_signal(log, tmp_path, ports):
    """A program of its own, ended by SIGTERM: its files are complete, its state is saved, its health was told."""
    folder, config, trajectory = log
    out = tmp_path / "live.jsonl"
    program = subprocess.Popen(
        [sys.executable, "-m", "schuler", "live", "stdin:?part=imu", f"udp://:{ports[0]}?part=gnss", "--config", config,
         "--out", f"json:{out}", "--record", tmp_path / "run", "--headless", "--health", f":{ports[1]}", "--state",
         tmp_path / "drive.state"],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONWARNINGS": "ignore"},
    )  # fmt: skip
    try:
        sentence = b""
        while b"listening" not in sentence:
            assert select.select([program.stderr], [], [], LONGEST_S)[0]
            sentence += os.read(program.stderr.fileno(), 1000)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:

            def send(data):
                os.write(program.stdin.fileno(), data)

            Sender(folder, send, lambda d: s.sendto(d, ("127.0.0.1", ports[0])), out).run()
        with urllib.request.urlopen(f"http://127.0.0.1:{ports[1]}", timeout=LONGEST_S) as answer:
            notice = json.load(answer)
        program.send_signal(signal.SIGTERM)
        assert program.wait(LONGEST_S) == 0
    finally:
        program.kill()
        program.communicate()
    assert compare(read_lines(out), trajectory, in_time=False) > 100
    assert len(schuler.read(tmp_path / "run" / "solution.parquet").reference.t) > 100
    saved, last = LiveNavigator.load(tmp_path / "drive.state"), read_lines(out)[-1]
    assert saved.health == notice["health"] == "ok"
    assert saved.solution().t == pytest.approx(last["t_s"], abs=0.1)  # an output's interval
    assert 0.0 < notice["sigma_horizontal_m"] < 1.0


@pytest.mark.campaign
def test_a_run_that_ends_goes_on_from_its_state(log, tmp_path, capsys):
    """In two parts with a state between them it is the batch run; another configuration is refused."""
    folder, config, trajectory = log
    state, out = tmp_path / "drive.state", tmp_path / "live.jsonl"
    split = float((folder / "imu.csv").read_text().partition(",")[0]) + 12.0
    for part in ("before", "after"):
        (tmp_path / part).mkdir()
        for name in ("imu.csv", "gnss.csv"):
            rows = (folder / name).read_text().splitlines(keepends=True)
            kept = [row for row in rows if (float(row.partition(",")[0]) < split) == (part == "before")]
            (tmp_path / part / name).write_text("".join(kept))
        code, _, err = run(
            capsys, "live", f"replay:{tmp_path / part}?speed=0", "--config", config, "--out", f"json:{out}", "--state",
            state,
        )  # fmt: skip
        assert code == 0, err
    assert "goes on from the state of" in err
    assert compare(read_lines(out), trajectory) > 200
    code, _, err = run(capsys, "live", f"replay:{folder}", "--config", config, "--state", state, "--lag", 5)
    assert code == 2
    assert "saved with another configuration" in err
    assert "goes on from the state of" not in err


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("format", "packets"),
    [("vectornav", vectornav_log()), ("novatel", novatel_log()), ("sbf", sbf_log()), ("sbg", None)],
)
@pytest.mark.thinned(2)
def test_a_binary_stream_is_the_batch_run_of_its_file(tmp_path, capsys, monkeypatch, format, packets):
    """IMU and fixes from one wire, rates or increments as the format has them."""
    text, hints = CONFIG.partition("[recording.imu]")[0], {}
    if packets is None:
        sbg_log(drive(25.0, 50.0), tmp_path / "unit.bin")
        text, hints = text + '[recording]\ntime = "local"\n', {"time": "local"}
    else:
        (tmp_path / "unit.bin").write_bytes(b"".join(packets))
    config = write_text(tmp_path / "drive.toml", text)
    recording = schuler.read(tmp_path / "unit.bin", **hints)
    trajectory = schuler.navigate(recording, config).trajectory
    out = tmp_path / "live.jsonl"
    with (tmp_path / "unit.bin").open("rb") as file:
        monkeypatch.setattr(sys, "stdin", file)
        code, _, err = run(capsys, "live", f"stdin:?format={format}", "--config", config, "--out", f"json:{out}")
    assert code == 0, err
    assert compare(read_lines(out), trajectory, in_time=False) > 40


def test_garbage_is_said_and_the_run_goes_on(log, tmp_path, capsys, monkeypatch):
    _, config, _ = log
    reader, writer = os.pipe()
    os.write(writer, b"\x00\xff\xfe" * 999 + b"\n1,2,3\nnan,0,0,0,0,0,0\n5,0,0,-9.81,0,0,0\n")
    os.close(writer)
    with os.fdopen(reader, "rb") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        code, _, err = run(capsys, "live", "stdin:?part=imu", "--config", config)
    assert code == 1  # there is no solution
    assert "stdin:?part=imu: 3 lines that are no rows of t,ax,ay,az,gx,gy,gz" in err
    assert "ended aligning: 1 ImuSample; 0 solutions" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected a source"),
        (["drive.csv"], "a log is replayed with replay:drive.csv"),
        (["udp://:5000?part=baro"], "part of [recording]: 'baro' is not known"),
        (["udp://:5000?format=text"], "the columns are not known"),
        (["-", "--out", "xml:-"], "expected FORMAT:PLACE"),
        (["-", "--out", "json:-", "--json"], "both print there"),
        (["-", "--output-rate", "-1"], "expected solutions in a second"),
        (["replay:nothing.parquet"], "no such file or folder"),
    ],
)
def test_what_cannot_be_run_is_refused(log, capsys, arguments, message):
    assert message in refusal(capsys, "live", *arguments, "--config", log[1])


def test_a_port_that_is_taken_ends_the_run(log, capsys, ports):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", ports[0]))
        code, _, err = run(capsys, "live", f"udp://:{ports[0]}?part=imu", "--config", log[1])
    assert code == 2
    assert "cannot listen on 127.0.0.1" in err
