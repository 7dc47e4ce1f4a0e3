"""The drawing library in the package is that of its authors, with their licence."""

import hashlib
from importlib import resources

from schuler.plotting.page import plotly_script

#: Of ``plotly-basic.min.js`` in the npm package plotly.js-basic-dist-min 4.1.1.
SHA_256 = "99784e3abfb07b142a15e521a439e6d9addceadb3f79553fd24c72774f0649ba"


def test_it_is_the_authors_file_to_the_byte():
    assert hashlib.sha256(plotly_script().encode()).hexdigest() == SHA_256


def test_it_has_its_licence_beside_it():
    assert "MIT license" in plotly_script()[:400]
    licence = (resources.files("schuler.plotting") / "assets" / "plotly-LICENSE").read_text(encoding="utf-8")
    assert "Permission is hereby granted" in licence
    assert "Plotly" in licence
