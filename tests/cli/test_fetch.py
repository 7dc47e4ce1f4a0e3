"""``schuler fetch`` from a server on loopback."""

import hashlib
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from command import answer, refusal, run

from schuler.exceptions import InputError
from schuler.recording import public

CONTENTS = b"t,ax\n0,1\n"


@pytest.fixture
def server(monkeypatch):
    """A host with one recording of one file; asked for paths are kept."""
    pytest.importorskip("pooch")
    asked, answers = [], {"body": CONTENTS}

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_response(200 if answers["body"] else 404)
            self.end_headers()
            self.wfile.write(answers["body"])

        def log_message(self, *_):
            pass

    host = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=host.serve_forever, daemon=True)
    thread.start()
    file = public.PublicFile("data/a.csv", "0" * 40, hashlib.sha256(CONTENTS).hexdigest(), len(CONTENTS))
    ours = replace(public.RECORDINGS["phone-drive"], repository="owner/repo", files=(file,))
    monkeypatch.setattr(public, "RECORDINGS", {"toy": ours})
    monkeypatch.setattr(public, "HOST", f"http://127.0.0.1:{host.server_address[1]}")
    yield asked, answers
    host.shutdown()
    host.server_close()
    thread.join()


def test_listing_fetches_nothing(server, capsys):
    asked, _ = server
    code, out, _ = run(capsys, "fetch")
    assert code == 0
    assert "toy" in out
    assert "licence MIT" in out
    assert asked == []


def test_a_file_comes_from_its_commit_once(server, capsys, tmp_path):
    asked, _ = server
    data = answer(capsys, "fetch", "toy", "--out", tmp_path / "toy", "--json")
    assert (tmp_path / "toy" / "a.csv").read_bytes() == CONTENTS
    assert data["recordings"]["toy"]["licence"] == "MIT"
    assert asked == [f"/owner/repo/{'0' * 40}/data/a.csv"]
    public.fetch("toy", tmp_path / "toy")
    assert len(asked) == 1


def test_other_contents_are_not_kept(server, capsys, tmp_path):
    _, answers = server
    answers["body"] = CONTENTS + b"1,2\n"
    code, out, err = run(capsys, "fetch", "toy", "--out", tmp_path / "toy")
    assert (code, out) == (2, "")
    assert "not the file that is pinned" in err
    assert not list((tmp_path / "toy").glob("*"))
    answers["body"] = b""
    with pytest.raises(InputError, match="cannot be fetched"):
        public.fetch("toy", tmp_path / "toy")
    (tmp_path / "toy").mkdir(exist_ok=True)
    (tmp_path / "toy" / "a.csv").write_bytes(b"mine")
    with pytest.raises(InputError, match="is another file"):
        public.fetch("toy", tmp_path / "toy")
    assert (tmp_path / "toy" / "a.csv").read_bytes() == b"mine"


def test_an_unknown_name_is_answered_with_the_known_ones(capsys):
    assert "phone-drive" in refusal(capsys, "fetch", "phone_drive")


@pytest.mark.realdata
def test_the_pins_are_those_of_the_recordings_at_hand(shared_data):
    """SHA-256 of the same files, where they are."""
    folders = {"phone-drive": "oan_phone_drive", "hand-mpu9150": "mikoff_mpu9150", "laser-gyro": "psins_lasergyro"}
    for name, recording in public.RECORDINGS.items():
        for file in recording.files:
            path = shared_data / folders[name] / file.path.rpartition("/")[2]
            assert hashlib.sha256(path.read_bytes()).hexdigest() == file.sha256
            assert path.stat().st_size == file.size
