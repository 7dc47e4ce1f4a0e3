"""Every file of the real recordings: ``schuler info`` opens it, or says in one line why not and what would help."""

import json
import re

import pytest
from places import DATA
from real_recordings import GOOD

from schuler.cli import main
from schuler.diagnosis.log import not_a_log

FILES = sorted(str(p.relative_to(DATA)) for p in DATA.rglob("*") if p.is_file()) if DATA.is_dir() else []

#: What a file is by its name: the first rule that fits.
RULES = (
    ("no log", r"(^|/)(README|LICENSE)[^/]*$|\.(md|json|tag|gz|yaml)$"),
    # formats that say all of themselves
    (
        "log",
        r"\.(obs|rnx|nav|pos|ubx|sp3|imu|\d\d[nNoOlLbB])$|/(imu0|state_groundtruth_estimate0)/data\.csv$|/(imu_gpst|vn310-\w+(-after)?)\.csv$|/static_z[^/]*\.csv$",
    ),
    (
        "log",
        r"/(insgpseo_tc\.mat|android_pixel6\.txt|Pixel4_ground_truth\.csv)$|oan_phone_drive/.*\.csv$|pyshoe_(more|vicon)/.*\.mat$",
    ),
    # told by their numbers: gravity's norm, turns between rests, a limb's swing, weeks beside their seconds
    ("log", r"snu_staticposes/\w+\.txt$|llio_foot/\w+\.mat$|groundTruth_\w+\.csv$"),
    # tables and arrays of which only their owner knows what they are
    ("hints", r"\.(csv|txt|dat|mat|npz|npy|log)$"),
)


def kind_of(name):
    return next(kind for kind, pattern in RULES if re.search(pattern, name, re.IGNORECASE))


@pytest.mark.realdata
def test_there_are_files(shared_data):
    assert {kind_of(name) for name in FILES} == {kind for kind, _ in RULES}


@pytest.mark.thinned(72)
@pytest.mark.realdata
@pytest.mark.parametrize("name", FILES)
def test_every_file_opens_or_is_refused_with_the_reason(shared_data, name, capsys):
    code = main(["info", str(shared_data / name)])
    out, err = capsys.readouterr()
    kind = kind_of(name)
    if kind == "log":
        assert code == 0, err
        assert len(out.splitlines()) >= 2
        return
    assert (code, out) == (2, "")
    assert err.startswith("schuler: ")
    assert err.count("\n") == 1
    assert str(shared_data / name) in err
    if kind == "no log":
        assert "this is no log but " in err
    else:
        assert re.search(r"--(columns|units|variable) ", err), err


#: Logs that need hints, with those of their READMEs.
HINTED = {
    name: hints | ({"allow": "norm"} if "ferraris_session" in name else {})
    for name, (hints, _) in GOOD.items()
    if hints and not any(isinstance(v, dict) for v in hints.values())
}


@pytest.mark.thinned(5)
@pytest.mark.realdata
@pytest.mark.parametrize(("name", "hints"), list(HINTED.items()), ids=list(HINTED))
def test_logs_open_with_the_hints_of_their_readmes(shared_data, name, hints, capsys):
    options = [part for key, value in hints.items() for part in (f"--{key}", str(value))]
    code = main(["info", str(shared_data / name), *options, "--json"])
    out, err = capsys.readouterr()
    assert code == 0, err
    assert json.loads(out)["imu"]["samples"] >= 50


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("notes.txt", b"The car stood still for a minute.\nThen it went round twice.\n", "text for people"),
        ("a.json", b'{"units": "g", "rate": 100}\n', "a JSON file"),
        ("a.bin", b"\x1f\x8b\x08\x00" + b"\x00" * 40, "compressed"),
        ("a.csv", b"\n \n", "empty"),
        ("a.csv.tag", b"TIMETAG RTKLIB demo5" + b"\x00" * 40, "RTKLIB's time tags of another file"),
    ],
)
def test_what_is_no_log_is_called_what_it_is(tmp_path, name, content, what, capsys):
    path = tmp_path / name
    path.write_bytes(content)
    assert what in not_a_log(path)
    assert main(["info", str(path)]) == 2
    assert f"this is no log but {what}" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content",
    [
        b"t,ax,ay,az,gx,gy,gz\n0,0,0,9.8,0,0,0\n0.01,0,0,9.8,0,0,0\n",
        b"time stamp of the logger;acceleration along x;y;z\n0;0;0;9.8\n1;0;0;9.8\n2;0;0;9.8\n",
        b"1 2 3 4\n" * 30,
    ],
)
def test_tables_may_be_logs(tmp_path, content):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    assert not_a_log(path) is None
