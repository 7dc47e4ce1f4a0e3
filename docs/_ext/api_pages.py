"""The API reference: one page for each package, written from the package itself before every build.

Everything public is documented once, under the shortest name it can be imported by: ``schuler.navigate`` rather than
``schuler.navigation.run.navigate``. Only names in the ``__all__`` of a package have such a short name. Commands
are left out; they are in commands.md.
"""

from __future__ import annotations

import ast
import inspect
import pkgutil
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer

ROOT = "schuler"
ELSEWHERE = ("schuler.cli", "schuler.__main__")


def public(module: str) -> bool:
    """Whether a module belongs into the reference."""
    parts = module.split(".")
    return not module.startswith(ELSEWHERE) and not any(p.startswith("_") or p.endswith("kernels") for p in parts)


@cache
def packages() -> tuple[str, ...]:
    """The package and those within it, by name."""
    walked = pkgutil.walk_packages(import_module(ROOT).__path__, ROOT + ".")
    return ROOT, *(outcome.name for outcome in walked if outcome.ispkg and public(outcome.name))


def modules(package: str) -> list[str]:
    """Public modules directly in a package."""
    outcome = pkgutil.iter_modules(import_module(package).__path__, package + ".")
    return [one.name for one in outcome if not one.ispkg and public(one.name)]


def defined_in(value: Any) -> tuple[str, str]:
    """Module and name that a function or class of ours was defined with; empty for anything else."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    return (module, name) if module and name and module.startswith(ROOT) else ("", "")


def imported_from(module: ModuleType, name: str) -> str:
    """Module that a package's stub or ``__init__`` imports a name from; the package itself if it defines it."""
    stub = Path(inspect.getfile(module)).with_suffix(".pyi")
    text = stub.read_text(encoding="utf-8") if stub.exists() else inspect.getsource(module)
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom) and any((a.asname or a.name) == name for a in node.names):
            return f"{module.__name__}.{node.module}" if node.level else str(node.module)
    return module.__name__


def constants(module: str) -> dict[str, list[str]]:
    """Names of a module that a ``#:`` comment describes, with the comment's lines."""
    outcome = ModuleAnalyzer.for_module(module).find_attr_docs()
    return {name: lines for (owner, name), lines in outcome.items() if not owner and not name.startswith("_")}


@cache
def short_names() -> dict[tuple[str, str], str]:
    """Of everything in an ``__all__`` of a package: where it was defined, and the shortest name."""
    names: dict[tuple[str, str], str] = {}
    for package in sorted(packages(), key=lambda name: name.count(".")):
        module = import_module(package)
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            if not inspect.ismodule(value):
                place = defined_in(value)
                key = place if place[0] else (imported_from(module, name), name)
                names.setdefault(key, f"{package}.{name}")
    return names


def members(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Public functions, classes and described constants that a module defines, in its order."""
    described = constants(module.__name__)
    for name, value in vars(module).items():
        if not name.startswith("_") and (defined_in(value) == (module.__name__, name) or name in described):
            yield name, value


def entry(name: str, value: Any, home: str) -> str:
    """The directive that documents one name."""
    if inspect.isclass(value):
        return f".. autoclass:: {name}\n   :members:\n"
    if defined_in(value)[0]:
        return f".. autofunction:: {name}\n"
    # of a name imported from elsewhere autodoc does not find the comment
    module, _, last = name.rpartition(".")
    text = constants(home).get(last, [])
    return "\n".join([f".. py:data:: {last}", f"   :module: {module}", "", *(f"   {line}" for line in text), ""])


def heading(text: str, line: str) -> str:
    """A title with its underline."""
    return f"{text}\n{line * len(text)}\n"


def module_text(name: str) -> str:
    """One module: what it is for, what it defines, and what of it has a shorter name."""
    short = short_names()
    # a function may be called as its module is; then the name is the function's
    hidden = "   :no-index:\n" if name in short.values() else ""
    parts = [heading(name.removeprefix(ROOT + "."), "-"), f".. automodule:: {name}\n{hidden}"]
    for member, value in members(import_module(name)):
        other = short.get((name, member))
        parts.append(entry(f"{name}.{member}", value, name) if other is None else f"* :py:obj:`{other}`\n")
    return "\n".join(parts)


def package_text(package: str) -> str:
    """One page: the package's own list, then module by module."""
    short = short_names()
    parts = [heading(package, "="), f".. automodule:: {package}\n"]
    for (home, _), shortest in short.items():
        if shortest.rpartition(".")[0] == package:
            parts.append(entry(shortest, getattr(import_module(package), shortest.rpartition(".")[2]), home))
    module = import_module(package)
    parts += [entry(f"{package}.{n}", v, package) for n, v in members(module) if (package, n) not in short]
    parts += [module_text(name) for name in modules(package)]
    return "\n".join(parts)


def write_pages(app: Sphinx) -> None:
    """Write the pages that changed into ``api/``, and remove those of packages that are gone."""
    folder = Path(app.srcdir) / "api"
    pages = {folder / f"{package}.rst": package_text(package) for package in packages()}
    for path in set(folder.glob("*.rst")) - set(pages):
        path.unlink()
    for path, text in pages.items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def exact_types(app: Sphinx, doctree: nodes.document) -> None:
    """Words in the types of docstrings are no names to search for: "start" is none of ten attributes called so."""
    for reference in doctree.findall(addnodes.pending_xref):
        reference.attributes.pop("refspecific", None)


def both_names(app: Sphinx, doctree: nodes.document) -> None:
    """What is shown under its short name is found under the name it was defined with, too; Sphinx sees to classes."""
    homes = {short: f"{module}.{name}" for (module, name), short in short_names().items()}
    python = app.env.domains.python_domain
    for signature in doctree.findall(addnodes.desc_signature):
        kind = signature.parent["objtype"]
        home = homes.get(f"{signature.get('module')}.{signature.get('fullname')}")
        if home is not None and kind in ("function", "data") and home not in python.objects:
            python.note_object(home, kind, signature["ids"][0], aliased=True, location=signature)


def plain_defaults(
    app: Sphinx, what: str, name: str, value: Any, options: Any, signature: str | None, returns: Any
) -> Any:
    """Defaults that a dataclass makes anew are shown as ``...``: Sphinx cannot read a signature with ``<factory>``."""
    return None if signature is None else (signature.replace("<factory>", "..."), returns)


@cache
def classes() -> dict[str, str]:
    """Full name of every class of ours whose last part is its alone."""
    outcome: dict[str, set[str]] = {}
    for package in packages():
        for module in [package, *modules(package)]:
            for name, value in members(import_module(module)):
                if inspect.isclass(value):
                    outcome.setdefault(name, set()).add(short_names().get((module, name), f"{module}.{name}"))
    return {name: full.pop() for name, full in outcome.items() if len(full) == 1}


def bare_class(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, text: nodes.Element) -> Any:
    """Link a class that a docstring names without its module, as in "Raises InputError"."""
    full = classes().get(node["reftarget"]) if node.get("refdomain") == "py" else None
    if full is None:
        return None
    return env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages when the build begins."""
    app.connect("builder-inited", write_pages)
    app.connect("doctree-read", exact_types)
    app.connect("doctree-read", both_names)
    app.connect("autodoc-process-signature", plain_defaults)
    app.connect("missing-reference", bare_class)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
