"""What parsers of other libraries do with damaged files, for the tests of the process that they run in."""

import os
import re

from schuler.exceptions import FileFormatError


def first_bytes(path, count):
    print("what a library prints")
    return path.read_bytes()[:count], os.getpid()


def circles(path):
    """A loop in compiled code, which no signal of Python interrupts."""
    return re.match(r"(a+)+$", "a" * 60 + "b")


def hungry(path):
    return len(bytearray(5 << 30))  # never touched: it is address space


def crash(path):
    os.abort()


def refuse(path):
    raise FileFormatError("it is no log of ours", path, 7)


def defect(path):
    raise RuntimeError("a defect")
