"""The workbench for tests: a server in its process, and what a person does on its pages in Chromium."""

import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import chromium
import numpy as np


class Server:
    """A server in its process, and the cookie of a visitor."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        command = [sys.executable, "-m", "schuler", "studio", str(folder), "--no-browser", "--quiet"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder)
        self.address = self.process.stdout.readline().strip()
        self.base, self.token = self.address.split("/?token=")
        self.port = int(self.base.rpartition(":")[2])

    def page(self, path: str, **query: str) -> str:
        words = "&".join([f"token={self.token}", *(f"{name}={value}" for name, value in query.items())])
        return f"{self.base}{path}?{words}"

    def ask(self, path, method="GET", data=None, **headers):
        """Status and body of a request with the cookie."""
        cookie = {"Cookie": f"schuler_studio_{self.port}={self.token}"}
        request = urllib.request.Request(self.base + path, data, cookie | headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60.0) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()

    def stop(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        self.process.wait(30.0)
        self.process.stdout.close()


def press(page, text):
    """Click the button with this text."""
    mark = f"[...document.querySelectorAll('button')].find(b => b.textContent.trim() === {json.dumps(text)})"
    chromium.wait_for(page, mark, 60.0)
    chromium.run(page, f"{mark}.setAttribute('data-press', '1')")
    chromium.click(page, "[data-press]")
    chromium.run(page, "document.querySelector('[data-press]')?.removeAttribute('data-press')")


def drag(page, start, stop):
    """Drag over the timeline from one time to another, or press it where both are the same. [s]"""
    chromium.wait_for(page, "document.querySelector('.timeline').dataset.latency", 90.0)
    chromium.centre(page, ".timeline")
    box = "document.querySelector('.timeline .nsewdrag').getBoundingClientRect()"
    left, top, width, height = chromium.run(page, f"(r => [r.x, r.y, r.width, r.height])({box})")
    low, high = map(float, chromium.run(page, "document.querySelector('.timeline').dataset.window").split(","))
    xs = [left + (t - low) / (high - low) * width for t in np.linspace(start, stop, 12)]
    y = top + 0.5 * height
    chromium.mouse(page, "mouseMoved", xs[0], y)
    chromium.mouse(page, "mousePressed", xs[0], y, button="left", clickCount=1)
    for x in xs:
        chromium.mouse(page, "mouseMoved", x, y, button="left", buttons=1)
    chromium.mouse(page, "mouseReleased", xs[-1], y, button="left", clickCount=1)


def type_into(page, label, text):
    """Put a text into the field with this label."""
    chromium.wait_for(page, f"document.querySelector('input[aria-label=\"{label}\"]')", 60.0)
    chromium.run(
        page, f"(field => (field.focus(), field.select()))(document.querySelector('input[aria-label=\"{label}\"]'))"
    )
    chromium.call(page.browser, "Input.insertText", page.session, text=text)


def write_all(number, data):
    """Write to a descriptor all of it: a pseudo-terminal takes what it has room for."""
    while data:
        data = data[os.write(number, data) :]
