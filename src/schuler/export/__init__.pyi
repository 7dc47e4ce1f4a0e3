from .design import FilterDesign as FilterDesign
from .design import check_exported as check_exported
from .design import filter_design as filter_design
from .folder import write_filter as write_filter
from .simulated import simulated_run as simulated_run

__all__ = ["FilterDesign", "check_exported", "filter_design", "simulated_run", "write_filter"]
