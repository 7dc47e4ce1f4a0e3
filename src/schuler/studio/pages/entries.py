"""The entries of a configuration as fields: search, units, help, what is stated and what was changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any

from nicegui import ui

from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import Config
from schuler.studio import form
from schuler.studio.pages.frame import block, hint, html


def entry_fields(
    data: Mapping[str, Any],
    texts: dict[str, str],
    search: str,
    *,
    only_stated: bool,
    changed: Callable[[], None],
    model: type[Config] = NavigationConfig,
) -> None:
    """Fields of the entries that match, by section.

    Parameters
    ----------
    data : mapping
        Configuration as its file has it.
    texts : dict of str to str
        What was typed, by name of the entry; changed in place.
    search : str
        Words that name or help of an entry must have.
    only_stated : bool
        Leave out what neither states.
    changed : callable
        Called after every change.
    model : type
        Of the configuration.
    """
    section: str | None = None
    words = search.lower().split()
    for field in form.fields(model):
        before = form.shown(data, field)
        text = texts.get(field.name, before)
        if only_stated and not text and not before:
            continue
        if not all(word in f"{field.name} {field.help}".lower() for word in words):
            continue
        if field.section != section:
            section = field.section
            html(f"<h3>{escape(section or 'general')}</h3>")
        _entry(texts, field, before, text, changed)
    if section is None:
        hint("no entry matches")


def _entry(texts: dict[str, str], field: form.Field, before: str, text: str, changed: Callable[[], None]) -> None:
    """One entry: name, unit, help, and its value as TOML spells it."""
    with block("entry") as row:
        unit = f' <span class="unit">[{escape(field.unit)}]</span>' if field.unit else ""
        html(f'<span class="name">{escape(field.name)}{unit}</span><br><span class="help">{escape(field.help)}</span>')

        def marked() -> None:
            now = texts.get(field.name, before)
            row.classes(remove="stated changed")
            row.classes(add=("stated " if now else "") + ("changed" if now.strip() != before else ""))

        def edit(value: str | bool | None) -> None:
            spelt = ("true" if value else "") if isinstance(value, bool) else (value or "")
            texts[field.name] = spelt
            marked()
            changed()

        label = f'aria-label="{escape(field.name)}"'
        default = f"default: {field.default}" if field.default else "left out"
        if field.switch:
            ui.checkbox("on", value=text == "true", on_change=lambda e: edit(e.value)).props(label)
        elif field.choices:
            options = {"": default, **{choice: choice for choice in field.choices}}
            if text not in options:
                options[text] = text
            ui.select(options, value=text, on_change=lambda e: edit(e.value)).props(f"outlined dense {label}")
        else:
            entry = ui.input(value=text, placeholder=default).props(f"outlined dense debounce=400 {label}")
            entry.on_value_change(lambda e: edit(e.value))
        marked()
