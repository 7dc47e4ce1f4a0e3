"""The workbench: first paint of its pages, time of a zoom with long logs, memory, and the time of a minute's run.

``python -m benchmarks.studio [--samples 1e7,1e8]`` prints a table. Chromium draws at 1400 px; a zoom is from the
key that asks for it to the chart that was drawn. Six signals share the samples.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
import chromium

from schuler.diagnosis.result import Diagnosis
from schuler.recording.io import write
from schuler.simulation import simulate
from schuler.studio import jobs, server
from schuler.studio.pyramid import pyramid
from schuler.studio.signals import Channel, View, Views, window
from schuler.studio.workspace import Workspace

_EXAMPLES = Path(__file__).parents[1] / "examples"
_PAGES = ("/", "/navigate", "/noise", "/calibrate", "/coach", "/plan", "/runs")
_RATE_HZ = 200.0
_ZOOMS = 12
_AXES = ("axis_x", "axis_y", "axis_z")


def long_view(samples: int) -> View:
    """A log of six signals that has so many samples in all."""
    n = samples // 6
    t, rng = np.arange(n) / _RATE_HZ, np.random.default_rng(1)
    channels = tuple(
        Channel(panel, "xyz"[i], _AXES[i], t, pyramid(rng.standard_normal(n)))
        for panel in ("specific force [m/s²]", "angular rate [deg/s]")
        for i in range(3)
    )
    return View("long", None, Diagnosis("long", ()), channels)


def memory_mib(pid: int | str) -> float:
    """Resident memory of a process. [MiB]"""
    text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return float(text.split("VmRSS:")[1].split()[0]) / 1024.0


def server_ms(seen: View) -> float:
    """Processor time that the server takes for a window, median over windows of all lengths. [ms]"""
    start, stop = seen.span
    times = []
    for k in range(_ZOOMS):
        half = 0.5 * (stop - start) / 2**k
        began = time.thread_time()
        json.dumps(window(seen, 0.5 * (start + stop) - half, 0.5 * (start + stop) + half, 1300))
        times.append(1e3 * (time.thread_time() - began))
    return float(np.median(times))


def first_paints(page_of: dict[str, str]) -> None:
    """Print the time until something is seen of each page, the median of three visits."""
    for path, address in page_of.items():
        times = []
        for _ in range(3):
            with chromium.opened(address, 1400) as page:
                script = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
                chromium.wait_for(page, script)
                times.append(chromium.run(page, script))
        print(f"first paint {path:12} {np.median(times):6.0f} ms", flush=True)


def zooms(address: str, samples: int) -> None:
    """Print times of zooms into the middle of a long log, and memory."""
    before = memory_mib("self")
    views.kept["long"] = long_view(samples)
    with chromium.opened(address, 1400) as page:
        chart = "document.querySelector('.chart.signals')"
        chromium.wait_for(page, chart)
        chromium.run(page, f"{chart}.dataset.source = '/studio/views/long/signals'")
        chromium.wait_for(page, f"{chart}.dataset.latency", 120.0)
        times = []
        for _ in range(_ZOOMS):
            seen = chromium.run(page, f"{chart}.dataset.window")
            chromium.run(page, f"{chart}.dispatchEvent(new KeyboardEvent('keydown', {{key: '+'}}))")
            chromium.wait_for(page, f"{chart}.dataset.window !== '{seen}'", 60.0)
            times.append(float(chromium.run(page, f"{chart}.dataset.latency")))
        heap = chromium.run(page, "performance.memory.usedJSHeapSize") / 2**20
    server_mib = memory_mib("self") - before
    cost = server_ms(views.kept["long"])
    print(
        f"{samples:.0e} samples: zoom median {np.median(times):.0f} ms, largest {max(times):.0f} ms, of the server's "
        f"processor {cost:.0f} ms; server {server_mib:.0f} MiB more, {before:.0f} before; page {heap:.0f} MiB of heap",
        flush=True,
    )
    views.kept.clear()


def runs(workspace: Workspace) -> None:
    """Print the time of runs of a minute's drive with report, from the press of the button to the job that is done."""
    root, town = workspace.root, simulate(_EXAMPLES / "town.toml")
    start = town.start + 60.0
    minute = replace(town, imu=town.need_imu().between(start, start + 60.0))
    write(minute, root / "minute.parquet")
    (root / "minute.toml").write_text((_EXAMPLES / "town_navigation.toml").read_text())
    times = []
    for k in range(5):
        words = ["navigate", "minute.parquet", "--config", "minute.toml", "--out", f"run{k}", "--json"]
        began = time.perf_counter()
        key = jobs.start(workspace, words, f"run{k}").key
        while (job := jobs.job(workspace, key)) is not None and job.state == "running":
            time.sleep(0.005)
        assert job is not None
        assert job.state == "done", job
        times.append(time.perf_counter() - began)
    print(f"run of a minute: first {times[0]:.2f} s, then median {np.median(times[1:]):.2f} s", flush=True)


views = Views()


def main() -> None:
    """Serve an empty folder in this process and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", default="1e7,1e8")
    samples = [int(float(text)) for text in parser.parse_args().samples.split(",")]
    ready, addresses = threading.Event(), list[str]()

    def answer(address: str) -> None:
        addresses.append(address)
        ready.set()

    server.Views = lambda: views  # type: ignore[misc,assignment]
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(Path(folder).resolve())
        threading.Thread(target=server.serve, args=(workspace,), kwargs={"ready": answer}, daemon=True).start()
        ready.wait(60.0)
        base, _, token = addresses[0].partition("/?")
        first_paints({path: f"{base}{path}?{token}" for path in _PAGES})
        for count in samples:
            zooms(f"{base}/?{token}", count)
        runs(workspace)  # last: what it simulates stays in this process's memory
        print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
        time.sleep(0.1)
        os._exit(0)


if __name__ == "__main__":
    main()
