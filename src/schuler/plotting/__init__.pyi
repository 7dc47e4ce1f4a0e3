from .drawing import draw as draw
from .drawing import save as save
from .drawing import save_all as save_all
from .figure import Band as Band
from .figure import Bars as Bars
from .figure import Figure as Figure
from .figure import Line as Line
from .figure import Markers as Markers
from .figure import Panel as Panel
from .figure import Picture as Picture
from .figure import Span as Span
from .figure import Text as Text
from .figure import band as band
from .figure import line as line
from .figure import markers as markers
from .page import Section as Section
from .page import plotly_script as plotly_script
from .page import whole_page as whole_page
from .table import ResultTable as ResultTable
from .table import TabularResult as TabularResult

__all__ = [
    "Band",
    "Bars",
    "Figure",
    "Line",
    "Markers",
    "Panel",
    "Picture",
    "ResultTable",
    "Section",
    "Span",
    "TabularResult",
    "Text",
    "band",
    "draw",
    "line",
    "markers",
    "plotly_script",
    "save",
    "save_all",
    "whole_page",
]
