"""``schuler explain``: terms of the field, from ``glossary.toml`` beside this file."""

from __future__ import annotations

import difflib
import re
import textwrap
from pathlib import Path
from typing import Any

from schuler.cli.output import Flag, print_json
from schuler.exceptions import InputError
from schuler.files import read_toml
from schuler.units import parse_unit


def explain(term: str | None = None, /, *, json: Flag = False) -> None:
    """Explain a term of inertial navigation, with its conversions of units; without a term list all of them.

    Parameters
    ----------
    term
        Such as ARW, NEES or "lever arm"; case, spaces, hyphens and underscores do not matter.
    json
        Print one JSON object instead of text.
    """
    terms = read_toml(Path(__file__).with_name("glossary.toml"))
    if term is None:
        listed = {key: entry["name"] for key, entry in terms.items()}
        if json:
            print_json({"command": "explain", "terms": listed})
        else:
            width = max(map(len, listed)) + 2
            print("\n".join(f"{key:<{width}}{name}" for key, name in listed.items()))
        return
    key = lookup(terms, term)
    entry = terms[key]
    converted = [conversion(*pair) for pair in entry.get("conversions", ())]
    if json:
        print_json({
            "command": "explain", "term": key, "name": entry["name"], "aliases": entry.get("aliases", []),
            "text": entry["text"], "conversions": converted, "relation": entry.get("relation"),
        })  # fmt: skip
        return
    print(f"{key}: {entry['name']}" if key != entry["name"] else key)
    print(textwrap.fill(entry["text"], 100))
    print("".join(f"  1 {c['from']} = {c['factor']:.6g} {c['to']}\n" for c in converted), end="")
    if "relation" in entry:
        print(f"  {entry['relation']}")


def lookup(terms: dict[str, Any], term: str) -> str:
    """Key of the entry that has a term as its key, name or alias.

    Raises
    ------
    InputError
        If none has; the message offers the nearest.
    """
    index = {
        _plain(word): key for key, entry in terms.items() for word in (*entry.get("aliases", ()), entry["name"], key)
    }
    if (plain := _plain(term)) in index:
        return index[plain]
    near = difflib.get_close_matches(plain, index, n=4, cutoff=0.6)
    near += [word for word in index if len(plain) > 2 and plain in word]
    offered = list(dict.fromkeys(index[word] for word in near))[:4]
    hint = f"did you mean {' or '.join(offered)}?" if offered else "schuler explain lists what there is"
    raise InputError(f"no term {term!r} in the glossary; {hint}")


def conversion(first: str, second: str) -> dict[str, Any]:
    """How many of the second unit one of the first is."""
    return {"from": first, "to": second, "factor": parse_unit(first).factor / parse_unit(second).factor}


def _plain(text: str) -> str:
    return re.sub(r"[\s_-]+", "", text).lower()
