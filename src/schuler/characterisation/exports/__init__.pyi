from .programs import EXPORTS as EXPORTS
from .programs import Export as Export
from .programs import export as export
from .programs import export_text as export_text

__all__ = [
    "EXPORTS",
    "Export",
    "export",
    "export_text",
]
