"""Many and large: fifty tabs, ten gigabytes, two browsers on one job, two tabs on one configuration, keys alone."""

import http.client
import json
import time
from importlib.util import find_spec
from pathlib import Path

import chromium
import pytest
from workbench import Server, press, type_into

if find_spec("nicegui") is None:  # imported by the server alone, not by every process that collects tests
    pytest.skip("the workbench needs the extra studio", allow_module_level=True)

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("many")
    (made / "drive.toml").write_text((EXAMPLES / "town_navigation.toml").read_text())
    return made


@pytest.fixture(scope="module")
def server(folder):
    served = Server(folder)
    yield served
    served.stop()


def test_ten_gigabytes_are_refused_before_they_are_sent(server, folder):
    """By what is stated, and a stream that says nothing of its size by the names of what it may hold."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30.0)
    connection.putrequest("PUT", "/studio/uploads/large.bin")
    connection.putheader("Cookie", f"schuler_studio_{server.port}={server.token}")
    connection.putheader("Content-Length", str(10 << 30))
    connection.endheaders()
    answer = connection.getresponse()
    assert answer.status == 400
    assert b"at most 4 GiB" in answer.read()
    connection.close()
    assert not [path for path in folder.iterdir() if "large" in path.name]


def test_a_stream_that_grows_beyond_the_bound_leaves_nothing(tmp_path, monkeypatch):
    import asyncio

    from schuler.exceptions import InputError
    from schuler.studio import uploads

    monkeypatch.setattr(uploads, "LARGEST", 1 << 20)

    async def blocks():
        for _ in range(40):
            yield bytes(1 << 16)

    with pytest.raises(InputError, match="expected at most"):
        asyncio.run(uploads.receive(tmp_path / "x.bin", blocks(), None))
    assert not list(tmp_path.iterdir())


@pytest.mark.campaign
def test_an_upload_that_breaks_off_leaves_nothing(server, folder):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30.0)
    connection.putrequest("PUT", "/studio/uploads/broken.bin")
    connection.putheader("Cookie", f"schuler_studio_{server.port}={server.token}")
    connection.putheader("Content-Length", "1000000")
    connection.endheaders()
    connection.send(bytes(1000))
    connection.close()
    until = time.monotonic() + 30.0
    while [path for path in folder.iterdir() if "broken" in path.name]:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert server.ask("/")[0] == 200


@chromium.needed
@pytest.mark.campaign
def test_fifty_tabs_are_answered(server):
    """Each with its socket; the last one answers as the first did, and the server is there when all are closed."""
    pages = [
        chromium.call(chromium.browser(), "Target.createTarget", url=server.page("/runs"))["targetId"]
        for _ in range(49)
    ]
    try:
        with chromium.opened(server.page("/navigate", config="drive.toml"), 1400) as page:
            chromium.wait_for(page, "document.querySelector('.entry.stated')", 120.0)  # the file was read
            type_into(page, "imu.catalogue", '"MPU-6000"')
            chromium.wait_for(page, "document.querySelector('.entry.changed')", 120.0)
            assert chromium.errors(page) == ()
    finally:
        for page in pages:
            chromium.call(chromium.browser(), "Target.closeTarget", targetId=page)
    assert server.ask("/")[0] == 200


@chromium.needed
@pytest.mark.campaign
def test_of_two_tabs_that_change_a_configuration_the_second_is_told(server, folder):
    path = folder / "drive.toml"
    before = path.read_text()
    notice = "document.body.innerText.includes('was changed meanwhile')"
    entry = "document.querySelector('input[aria-label=\"imu.catalogue\"]')"
    with chromium.opened(server.page("/navigate", config="drive.toml"), 1400) as second:
        chromium.wait_for(second, "document.querySelector('.entry.stated')", 60.0)
        with chromium.opened(server.page("/navigate", config="drive.toml"), 1400) as first:
            chromium.wait_for(first, "document.querySelector('.entry.stated')", 60.0)
            type_into(first, "imu.catalogue", '"MPU-6000"')
            chromium.wait_for(first, "document.querySelector('.entry.changed')", 60.0)
            press(first, "save into the configuration")
            chromium.wait_for(first, "document.body.innerText.includes('written: drive.toml')", 60.0)
        saved = path.read_text()
        assert "MPU-6000" in saved != before
        type_into(second, "imu.catalogue", '"MTi-3"')
        chromium.wait_for(second, "document.querySelector('.entry.changed')", 60.0)
        press(second, "save into the configuration")
        chromium.wait_for(second, notice, 60.0)
        assert path.read_text() == saved
        press(second, "load again")
        chromium.wait_for(second, f"{entry}.value.includes('MPU-6000')", 60.0)
    path.write_text(before)


def front(page):
    """Bring a tab to the front: one behind another draws nothing, and what waits for a frame waits for ever."""
    chromium.call(page.browser, "Page.bringToFront", page.session)


@chromium.needed
@pytest.mark.campaign
def test_two_browsers_see_the_same_budget(server):
    """One starts it, the other, open before, shows its result; with the keyboard alone."""
    with chromium.opened(server.page("/plan"), 1400) as one:
        press(one, "new mission")
        type_into(one, "IMU", "MTi-G-710")
        item = "[...document.querySelectorAll('.q-item')].find(i => i.textContent.includes('MTi-G-710'))"
        chromium.wait_for(one, item, 60.0)
        chromium.run(one, f"{item}.click()")
        chromium.wait_for(one, "document.querySelector('.command pre')?.textContent.includes('MTi-G-710')", 60.0)
        with chromium.opened(server.page("/plan", mission="mission.toml"), 390) as other:
            chromium.wait_for(other, "document.querySelector('.command pre')", 60.0)
            button = (
                "[...document.querySelectorAll('button')].find(b => b.textContent.trim() === 'work out the budget')"
            )
            chromium.run(one, f"{button}.focus()")
            assert chromium.run(one, f"document.activeElement === {button}")
            for kind in ("keyDown", "keyUp"):
                key = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13}
                text = {"text": "\r"} if kind == "keyDown" else {}
                chromium.call(one.browser, "Input.dispatchKeyEvent", one.session, type=kind, **key, **text)
            verdicts = []
            for page in (one, other):
                front(page)
                chromium.wait_for(page, "document.querySelector('.verdict b')", 180.0)
                verdicts.append(chromium.run(page, "document.querySelector('.verdict').textContent"))
            assert json.dumps(verdicts[0]) == json.dumps(verdicts[1])
            assert chromium.overflow(other) <= 0.0
