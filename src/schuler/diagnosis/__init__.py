"""Diagnosis of a log by physics: what is wrong with it, on what evidence, how sure, and which option mends it."""

from schuler.diagnosis.diagnose import diagnose
from schuler.diagnosis.diagnosis import Diagnosis
from schuler.diagnosis.findings import CODES, Finding
from schuler.diagnosis.first import check
from schuler.diagnosis.log import diagnose_log

__all__ = ["CODES", "Diagnosis", "Finding", "check", "diagnose", "diagnose_log"]
