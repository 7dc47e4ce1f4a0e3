"""Pages in Chromium as a reader has them: what the console says, what is asked of a network, what does not fit.

It is driven by its own protocol over two pipes, so nothing but the browser is needed: ``visit(path, width)``, or
``with opened(path, width) as page`` and ``run``, ``click``, ``hover``, ``resize``. Tests skip with :data:`needed` where
there is no Chromium; ``SCHULER_CHROMIUM`` names another one.
"""

import atexit
import base64
import contextlib
import json
import os
import re
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pytest

PROGRAM = os.environ.get("SCHULER_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
needed = pytest.mark.skipif(PROGRAM is None, reason="Chromium is not here (Debian: apt-get install chromium)")

PATIENCE_S = 120.0  # for one answer of the browser; machines of CI can be slow
LOCAL = ("file:", "data:", "blob:", "about:")
FLAGS = (
    "--headless=new", "--remote-debugging-pipe", "--no-first-run", "--disable-gpu", "--hide-scrollbars",
    "--disable-extensions", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-renderer-backgrounding", "--disable-backgrounding-occluded-windows", "--disable-dev-shm-usage",
    "--password-store=basic", "--force-color-profile=srgb", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip


@dataclass(frozen=True)
class Visit:
    """What was seen of a page.

    Attributes
    ----------
    errors : tuple of str
        Exceptions, and what the console calls an error (a refused or missing file too).
    requests : tuple of str
        Addresses asked for that are not on this machine's file system or in the page.
    overflow : float
        Width of the page beyond that of the window. [px]
    text : str
        What can be read.
    screenshot : bytes
        PNG of the window.
    """

    errors: tuple[str, ...]
    requests: tuple[str, ...]
    overflow: float
    text: str
    screenshot: bytes


@dataclass
class Browser:
    """A running Chromium and the two ends of its pipes."""

    process: subprocess.Popen[bytes]
    commands: int
    answers: int
    rest: bytes = b""
    number: int = 0
    events: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Page:
    """One tab."""

    browser: Browser
    session: str
    width: int
    own: tuple[str, ...] = ()  # how addresses begin that are the page's own


@cache
def browser() -> Browser:
    """The one browser of this process, started when it is first wanted and ended with it."""
    assert PROGRAM is not None
    profile = tempfile.mkdtemp(prefix="chromium-")
    read_command, commands = os.pipe()
    answers, write_answer = os.pipe()
    flags = [*FLAGS, f"--user-data-dir={profile}", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    process = subprocess.Popen(  # Chromium reads commands from descriptor 3 and answers on 4
        ["bash", "-c", f'exec "$@" 3<&{read_command} 4>&{write_answer}', "bash", PROGRAM, *flags, "about:blank"],
        pass_fds=(read_command, write_answer), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, env={**os.environ, "HOME": profile},
    )  # fmt: skip
    os.close(read_command)
    os.close(write_answer)

    def stop() -> None:
        os.close(commands)  # the browser ends when nobody can command it any more
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10.0)
        process.kill()
        process.wait()
        os.close(answers)
        shutil.rmtree(profile, ignore_errors=True)

    atexit.register(stop)
    return Browser(process, commands, answers)


def message(b: Browser, until: float) -> dict[str, Any]:
    """The next thing the browser says."""
    while b"\0" not in b.rest:
        ready, _, _ = select.select([b.answers], [], [], max(until - time.monotonic(), 0.0))
        chunk = os.read(b.answers, 1 << 20) if ready else b""
        if not chunk:
            raise RuntimeError(f"Chromium {'ended' if ready else 'does not answer'}")
        b.rest += chunk
    text, _, b.rest = b.rest.partition(b"\0")
    return dict(json.loads(text))


def call(b: Browser, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
    """One command and its answer; what happens meanwhile is kept in ``events``."""
    b.number += 1
    command = {"id": b.number, "method": method, "params": parameters}
    text = json.dumps(command if session is None else {**command, "sessionId": session}).encode() + b"\0"
    while text:
        text = text[os.write(b.commands, text) :]
    until = time.monotonic() + PATIENCE_S
    while True:
        sentence = message(b, until)
        if sentence.get("id") == b.number:
            assert "error" not in sentence, f"{method}: {sentence['error']}"
            return dict(sentence["result"])
        b.events.append(sentence)


@contextlib.contextmanager
def opened(path: Path | str, width: int, height: int = 900, *, dark: bool = False) -> Iterator[Page]:
    """A page in a window of that size, loaded; a narrow window is a phone's. A text is an address on this machine."""
    b = browser()
    b.events.clear()
    target = call(b, "Target.createTarget", url="about:blank")["targetId"]
    session = call(b, "Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    served = re.match(r"http://(127\.0\.0\.1:\d+)/", path) if isinstance(path, str) else None
    own = () if served is None else (f"http://{served[1]}/", f"ws://{served[1]}/")
    page = Page(b, session, width, own)
    for domain in ("Page", "Runtime", "Log", "Network"):
        call(b, f"{domain}.enable", session)
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    call(b, "Emulation.setEmulatedMedia", session, features=scheme)
    resize(page, width, height)
    call(b, "Page.navigate", session, url=path if served is not None else Path(path).resolve().as_uri())
    until = time.monotonic() + PATIENCE_S
    while not any(e.get("method") == "Page.loadEventFired" for e in b.events):
        b.events.append(message(b, until))
    settle(page)
    try:
        yield page
    finally:
        call(b, "Target.closeTarget", targetId=target)


def run(page: Page, script: str) -> Any:
    """Value of a JavaScript expression; of a promise what it comes to."""
    answer = call(
        page.browser, "Runtime.evaluate", page.session, expression=script, returnByValue=True, awaitPromise=True
    )
    assert "exceptionDetails" not in answer, answer["exceptionDetails"]
    return answer["result"].get("value")


def settle(page: Page) -> None:
    """Wait for fonts and for two frames, so that what a script has just changed is drawn."""
    frames = "requestAnimationFrame(() => requestAnimationFrame(done))"
    run(page, f"document.fonts.ready.then(() => new Promise(done => {frames})).then(() => 0)")


def wait_for(page: Page, condition: str, seconds: float = 30.0) -> None:
    """Until a JavaScript expression is true."""
    until = time.monotonic() + seconds
    while not run(page, f"Boolean({condition})"):
        assert time.monotonic() < until, f"never true: {condition}"
        settle(page)


def resize(page: Page, width: int, height: int = 900) -> None:
    """Another size of the window."""
    call(
        page.browser, "Emulation.setDeviceMetricsOverride", page.session,
        width=width, height=height, deviceScaleFactor=1, mobile=width < 600,
    )  # fmt: skip


def centre(page: Page, selector: str) -> tuple[float, float]:
    """Where an element is in the window, after scrolling to it and once it stands still."""
    name = json.dumps(selector)
    run(page, f"document.querySelector({name}).scrollIntoView({{block: 'center', behavior: 'instant'}})")
    box = f"document.querySelector({name}).getBoundingClientRect()"
    before: Any = None
    for _ in range(100):
        settle(page)
        place = run(page, f"(r => [r.x + r.width / 2, r.y + r.height / 2])({box})")
        if place == before:
            break
        before = place
    return place[0], place[1]


def mouse(page: Page, kind: str, x: float, y: float, **more: Any) -> None:
    """One event of the mouse."""
    call(page.browser, "Input.dispatchMouseEvent", page.session, type=kind, x=x, y=y, **more)


def hover(page: Page, selector: str, right: float = 0.0, down: float = 0.0) -> None:
    """Move the mouse onto an element, or so many pixels from its middle."""
    x, y = centre(page, selector)
    for step in (8.0, 4.0, 0.0):  # it has to arrive from somewhere
        mouse(page, "mouseMoved", x + right + step, y + down)
    settle(page)


def click(page: Page, selector: str) -> None:
    """Press and release the left button on an element; again, if the page had moved it from under the mouse."""
    name = json.dumps(selector)
    noted = f"e => {{ pressed = e.target.closest({name}) }}, {{capture: true, once: true}}"
    for _ in range(20):
        x, y = centre(page, selector)
        mouse(page, "mouseMoved", x, y)
        run(page, f"var pressed = null; addEventListener('mousedown', {noted})")
        if not run(page, f"Boolean(document.elementFromPoint({x}, {y})?.closest({name}))"):
            continue
        for kind in ("mousePressed", "mouseReleased"):
            mouse(page, kind, x, y, button="left", clickCount=1)
        settle(page)
        if run(page, "Boolean(pressed)"):
            return
    raise AssertionError(f"never under the mouse: {selector}")


def errors(page: Page) -> tuple[str, ...]:
    """What went wrong on the page so far."""
    problems = []
    for event in page.browser.events:
        sentence, what = event.get("method"), event.get("params", {})
        if sentence == "Runtime.exceptionThrown":
            details = what["exceptionDetails"]
            problems.append(details.get("exception", {}).get("description", details["text"]))
        elif sentence == "Runtime.consoleAPICalled" and what["type"] in ("error", "assert"):
            problems.append(" ".join(str(a.get("value", a.get("description"))) for a in what["args"]))
        elif sentence == "Log.entryAdded" and what["entry"]["level"] == "error":
            problems.append(f"{what['entry']['text']} {what['entry'].get('url', '')}".strip())
    return tuple(problems)


def requests(page: Page) -> tuple[str, ...]:
    """Addresses outside the page, its server and the file system that were asked for so far."""
    asked = [
        event["params"]["request"]["url"] if "request" in event["params"] else event["params"]["url"]
        for event in page.browser.events
        if event.get("method") in ("Network.requestWillBeSent", "Network.webSocketCreated")
    ]
    return tuple(url for url in asked if not url.startswith((*LOCAL, *page.own)))


def overflow(page: Page) -> float:
    """Width of the page beyond that of the window. [px]"""
    widest = run(page, "Math.max(document.documentElement.scrollWidth, document.body.scrollWidth)")
    return float(widest - page.width)


def screenshot(page: Page) -> bytes:
    """The window as PNG."""
    return base64.b64decode(call(page.browser, "Page.captureScreenshot", page.session, format="png")["data"])


def seen(page: Page) -> Visit:
    """All of that at once."""
    settle(page)
    text = run(page, "document.body.innerText")
    return Visit(errors(page), requests(page), overflow(page), text, screenshot(page))


def visit(path: Path, width: int) -> Visit:
    """Open a page, look, close it."""
    with opened(path, width) as page:
        return seen(page)
