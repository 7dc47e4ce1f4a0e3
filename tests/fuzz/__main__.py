"""Attack the readers: ``python -m tests.fuzz`` (docs/project/fuzzing.md).

--minutes M     damaged logs for M minutes (default 60)
--targets A,B   of these formats (default all)
--first N       first seed (default 0: the same logs each time)
--most N        damaged logs of each format
--processes N   (default 1)
--guided        coverage-guided runs with atheris instead
--small T:SEED  make the log of a finding small and write it into the corpus
--out FILE      counts and findings as JSON
"""

import sys
from pathlib import Path

from tests.fuzz import campaign


def main(words: list[str]) -> int:
    """The command; 1 if something was found."""
    guided = "--guided" in words
    words = [word for word in words if word != "--guided"]
    given = dict(zip(words[::2], words[1::2], strict=False))
    unknown = set(given) - {"--minutes", "--targets", "--first", "--most", "--processes", "--small", "--out"}
    if unknown or "--help" in words:
        print(__doc__)
        return 2
    campaign._own_paths()
    if "--small" in given:
        name, _, seed = given["--small"].partition(":")
        return _small(name, int(seed))
    from tests.fuzz import targets

    names = given["--targets"].split(",") if "--targets" in given else targets.names()
    if guided:
        from tests.fuzz import guided as with_atheris

        return 1 if with_atheris.run(names, minutes=float(given.get("--minutes", 60)))[1] else 0
    done = campaign.run(
        names,
        minutes=float(given.get("--minutes", 60)),
        first=int(given.get("--first", 0)),
        most=int(given.get("--most", 10**9)),
        processes=int(given.get("--processes", 1)),
        tell=True,
    )
    print(done.table())
    if "--out" in given:
        done.save(Path(given["--out"]))
    return 1 if done.findings else 0


def _small(name: str, seed: int) -> int:
    from tests.fuzz import targets

    file, data, message = campaign.smallest(name, seed)
    print(f"{len(data)} bytes, {message or 'nothing is found any more'}")
    if message:
        path = targets.CORPUS / name / f"seed-{seed}--{file}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        print(f"written to {path}; give it a name that says what it shows")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
