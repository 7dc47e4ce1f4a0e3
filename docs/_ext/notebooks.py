"""Notebooks (``.ipynb``): their Markdown with the outputs they were saved with, and new outputs.

``python docs/_ext/notebooks.py docs/notebook.ipynb`` executes one anew and saves its outputs (needs ``nbclient``
and ``ipykernel``, extra ``docs``); tests/test_notebooks.py executes it and compares the kinds of its outputs.
"""

from __future__ import annotations

import base64
import io
import json
import re
import sys
from pathlib import Path
from typing import Any

PICTURE = re.compile(r"iVBOR[A-Za-z0-9+/=\n]+")
COLOURS = 64  # of the palette of a picture


def markdown(notebook: dict[str, Any]) -> str:
    """A page: texts as they stand, programs as blocks of Python, each followed by what it put out."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [html(output) for output in cell.get("outputs", ())]
    return "\n\n".join(part for part in parts if part) + "\n"


def html(output: dict[str, Any]) -> str:
    """What a cell put out, the richest form of it."""
    if output["output_type"] == "stream":
        return f"```text\n{''.join(output['text']).rstrip()}\n```"
    given = output.get("data", {})
    data = {kind: "".join(value) if isinstance(value, list) else value for kind, value in given.items()}
    if "text/html" in data:
        # a blank line would end the block of HTML
        text = "\n".join(line for line in data["text/html"].splitlines() if line.strip())
        return f'<div class="output">\n{text}\n</div>'
    if "image/png" in data:
        picture = "".join(data["image/png"].split())
        return f'<div class="output"><img alt="drawn by the program above" src="data:image/png;base64,{picture}"></div>'
    return f"```text\n{data.get('text/plain', '').rstrip()}\n```"


def executed(path: Path) -> dict[str, Any]:
    """The notebook with new outputs, its programs run in its folder."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=where).execute()
    for cell in notebook.cells:
        cell.metadata = {}  # times of execution
        for output in cell.get("outputs", ()):
            for kind, value in output.get("data", {}).items():
                output.data[kind] = PICTURE.sub(smaller, value) if kind != "text/plain" else value
    notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return dict(notebook)


def smaller(match: re.Match[str]) -> str:
    """A PNG as base64 with a palette, a third as long."""
    from PIL import Image

    stream = io.BytesIO()
    picture = Image.open(io.BytesIO(base64.b64decode(match[0]))).convert("RGB")
    picture.quantize(COLOURS).save(stream, "PNG", optimize=True)
    return base64.b64encode(stream.getvalue()).decode("ascii")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        text = json.dumps(executed(Path(name)), indent=1, ensure_ascii=False) + "\n"
        Path(name).write_text(text, encoding="utf-8")
