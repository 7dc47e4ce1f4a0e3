from .admission import check as check
from .log import diagnose_log as diagnose_log
from .report.document import diagnosis_report as diagnosis_report
from .result import CODES as CODES
from .result import Diagnosis as Diagnosis
from .result import Finding as Finding
from .run import diagnose as diagnose

__all__ = [
    "CODES",
    "Diagnosis",
    "Finding",
    "check",
    "diagnose",
    "diagnose_log",
    "diagnosis_report",
]
