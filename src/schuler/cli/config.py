"""``schuler config``."""

from __future__ import annotations

import json
from typing import Any, Literal

from schuler.cli.output import File
from schuler.files import write_text

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def config(what: Literal["schema"], /, *, out: File = None) -> None:
    """Write the JSON schema of a navigation configuration: entries, types, bounds and defaults, for editors.

    Parameters
    ----------
    what
        What to write: schema.
    out
        File to write instead of stdout.
    """
    text = json.dumps(schema(), indent=1) + "\n"
    if out is None:
        print(text, end="")
    else:
        print(f"schema: {write_text(out, text)}")


def schema() -> dict[str, Any]:
    """JSON schema of :class:`~schuler.navigation.config.NavigationConfig`."""
    from schuler.navigation.config import NavigationConfig

    return {"$schema": _DIALECT, **NavigationConfig.model_json_schema()}
