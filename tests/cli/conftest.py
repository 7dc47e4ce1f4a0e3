"""Fixtures of the tests of commands."""

import pytest

from schuler.files import replacing


@pytest.fixture(params=[False, pytest.param(True, marks=pytest.mark.campaign)], ids=["named", "drawn"])
def drawn(request, monkeypatch):
    """Whether files of figures hold what they show; by default only their names: all figures are drawn in
    tests/plotting/test_all_figures.py, and files of them written in tests/plotting."""

    def name_only(figure, stem, formats):
        written = [stem.with_name(f"{stem.name}.{suffix}") for suffix in formats]
        for path in written:
            with replacing(path) as temporary:
                temporary.write_bytes(bytes(200))
        return written

    if not request.param:
        monkeypatch.setattr("schuler.plotting.drawing.save", name_only)
    return request.param
