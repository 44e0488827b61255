"""Wrong anchors: labels and positions of visits, tested with noise learned from the session that may be wrong."""

from calibration.faults.align import Alignment, align
from calibration.faults.find import find_fault
from calibration.faults.finding import Finding, fault_words, finding_sentences
from calibration.faults.gate import Gate, gate
from calibration.faults.hypotheses import FREE, Hypothesis
from calibration.faults.session import Session, Site, relabelled, session_of, site_of

__all__ = [
    "FREE",
    "Alignment",
    "Finding",
    "Gate",
    "Hypothesis",
    "Session",
    "Site",
    "align",
    "fault_words",
    "find_fault",
    "finding_sentences",
    "gate",
    "relabelled",
    "session_of",
    "site_of",
]
