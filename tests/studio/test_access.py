"""Who is let in: the token, the server's own name, its own pages; everything else is refused before the application."""

import asyncio

import pytest

from schuler.exceptions import InputError
from schuler.studio.access import Door, Guard, new_token, refusal, token_of

DOOR = Door("a-token-of-this-test", 8123)
HOST = {"host": "127.0.0.1:8123"}


def ask(headers, path="/", query="", kind="http"):
    """Messages that a client gets."""
    sent = []

    async def application(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"inside"})

    async def receive():
        return {"type": "websocket.connect"}

    async def send(message):
        sent.append(message)

    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "method": "GET", "path": path, "query_string": query.encode(), "headers": pairs}
    asyncio.run(Guard(application, DOOR)(scope, receive, send))
    return sent


def cookie(token=DOOR.token):
    return {"cookie": f"other=1; {DOOR.cookie}={token}"}


def test_the_first_visit_gets_a_cookie_and_an_address_without_the_token():
    start = ask(HOST, "/runs", f"a=1&token={DOOR.token}")[0]
    assert start["status"] == 303
    headers = dict(start["headers"])
    assert headers[b"location"] == b"/runs?a=1"
    for word in (b"HttpOnly", b"SameSite=Strict", DOOR.token.encode()):
        assert word in headers[b"set-cookie"]


def test_with_the_cookie_pages_come_with_a_policy_that_names_no_other_machine():
    start, body = ask({**HOST, **cookie()})
    assert (start["status"], body["body"]) == (200, b"inside")
    policy = dict(start["headers"])[b"content-security-policy"].decode()
    assert "http" not in policy
    assert "*" not in policy


@pytest.mark.parametrize(
    "headers",
    [
        HOST,
        {**HOST, **cookie("another-token-than-it")},
        {"host": "rebound.example:8123", **cookie()},
        {"host": "127.0.0.1:9999", **cookie()},
        cookie(),
        {**HOST, **cookie(), "origin": "https://example.org"},
        {**HOST, **cookie(), "origin": "null"},
        {**HOST, **cookie(), "origin": "http://127.0.0.1:9999"},
    ],
    ids=["no-token", "wrong-token", "other-host", "other-port", "no-host", "other-site", "sandbox", "other-server"],
)
def test_what_is_refused(headers):
    assert ask(headers)[0]["status"] == 403
    assert ask(headers, kind="websocket")[0] == {"type": "websocket.close", "code": 1008}


def test_a_wrong_token_in_the_address_is_refused_although_the_cookie_is_right():
    assert ask({**HOST, **cookie()}, query="token=guess")[0]["status"] == 403


def test_an_address_with_two_slashes_leads_to_no_other_host():
    place = dict(ask(HOST, "//example.org/x", f"token={DOOR.token}")[0]["headers"])[b"location"]
    assert place == b"/example.org/x"


def test_own_pages_are_let_in():
    assert refusal(DOOR, {**HOST, **cookie(), "origin": "http://127.0.0.1:8123"}, None) is None


def test_any_host_name_where_all_addresses_are_listened_on():
    assert refusal(Door(DOOR.token, 8123, None), {"host": "lab.example:8123", **cookie()}, None) is None


def test_tokens_differ_and_are_long():
    assert len({new_token() for _ in range(20)}) == 20
    assert len(new_token()) >= 43


def test_token_files(tmp_path):
    good, short = tmp_path / "good", tmp_path / "short"
    good.write_text("  0123456789abcdef0123\n")
    short.write_text("secret")
    assert token_of(good) == "0123456789abcdef0123"
    for path in (short, tmp_path / "missing"):
        with pytest.raises(InputError, match="--token-file: expected"):
            token_of(path)
