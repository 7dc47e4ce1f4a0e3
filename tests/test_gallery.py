"""The gallery: its programs run as they stand, every picture is there, is small, and is what its program draws."""

import re

import make
import pytest
from matplotlib.figure import Figure
from PIL import Image
from places import DOCS

TEXT = (DOCS / "gallery.md").read_text(encoding="utf-8")
LINES = 10  # of a program, imports and blanks left out


PROGRAMS = make.programs(TEXT)


@pytest.fixture(scope="module")
def drawn():
    """Each program's figure, by the name of its picture; one namespace, as on the page."""
    space, figures = {}, {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(make.ROOT)
        for name, program in PROGRAMS:
            exec(program, space)
            figures[name] = space["figure"]
    return figures


@pytest.mark.campaign
def test_every_program_draws(drawn):
    """As many as pictures, and one for axes of one's own; all can be rendered."""
    assert len(drawn) == len(PROGRAMS)
    for name, figure in drawn.items():
        assert isinstance(figure, Figure), name
        figure.draw_without_rendering()
        assert any(ax.lines or ax.collections or ax.images for ax in figure.axes), name


@pytest.mark.campaign
def test_pictures_are_those_of_the_programs(drawn):
    """Shapes as the figures have them now: a picture of an older figure is seen by its size."""
    for name, figure in drawn.items():
        if name:
            with Image.open(DOCS / "gallery" / f"{name}.png") as image:
                height = make.WIDTH * figure.get_figheight() / figure.get_figwidth()
                assert image.size == (make.WIDTH, pytest.approx(height, abs=1.5)), f"{name}: run docs/gallery/make.py"


def test_every_picture_is_there_and_small():
    names = re.findall(r"!\[[^]]+\]\(gallery/([\w-]+)\.png\)", TEXT)
    assert names == [name for name, _ in PROGRAMS if name]
    assert len(names) == len(set(names)) >= 12
    files = {path.stem: path for path in (DOCS / "gallery").glob("*.png")}
    assert set(files) == set(names)
    assert all(path.stat().st_size <= make.MOST for path in files.values())
    assert sum(path.stat().st_size for path in files.values()) < 700_000
    for path in files.values():
        with Image.open(path) as image:
            assert image.mode == "P", path.name


def test_programs_are_short():
    for name, program in PROGRAMS:
        lines = [x for x in program.splitlines() if x.strip() and not re.match(r"(from|import) ", x)]
        assert len(lines) <= LINES, name


def test_the_page_says_how_pictures_are_made():
    assert "`python docs/gallery/make.py`" in TEXT
