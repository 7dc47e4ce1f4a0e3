"""docs/navigation-entries.md lists every entry of a configuration as the code has it."""

from __future__ import annotations

from typing import Any

from places import ROOT
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from schuler.navigation.config import NavigationConfig

PAGE = ROOT / "docs" / "navigation-entries.md"
HEAD = """# Every entry of a navigation configuration

Made from the code (tests/navigation/test_config_page.py holds it to that). What it means: [navigation](navigation.md).
A section below `[aiding]` that is not in the file is not used; `schuler navigate --aid NAME` puts an empty one there,
which takes the defaults, and `--set SECTION.KEY=VALUE` changes any entry.
"""


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The section a field holds, itself or optionally."""
    for candidate in (annotation, *getattr(annotation, "__args__", ())):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def default_of(field: Any) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "must be given"
    if value is None:
        return "-"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, tuple):
        return f"`[{', '.join(str(v) for v in value)}]`"
    return f"`{value}`"


def tables(model: type[BaseModel], name: str) -> list[str]:
    rows, below = [], []
    for key, field in model.model_fields.items():
        inner = section_of(field.annotation)
        if inner is not None and not str(field.annotation).startswith("dict"):
            below += tables(inner, f"{name}.{key}" if name else key)
        elif name:
            rows.append(f"| `{key}` | {default_of(field)} | {field.description or ''} |")
    text = (model.__doc__ or "").split("\n")[0]
    head = [f"\n## `[{name}]`\n", text, "\n| Entry | Default | Meaning |\n|---|---|---|", *rows] if rows else []
    return head + below


def page() -> str:
    return HEAD + "\n".join(tables(NavigationConfig, "")) + "\n"


def test_the_page_lists_every_entry():
    assert PAGE.read_text(encoding="utf-8") == page(), "write it anew: python tests/navigation/test_config_page.py"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
