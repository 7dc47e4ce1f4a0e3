from .frame import add_pages as add_pages

__all__ = ["add_pages"]
