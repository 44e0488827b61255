"""Simulated sessions with known truth."""

from jaxgeo.simulate.drift import Drift, LoopClosure
from jaxgeo.simulate.faults import Faults
from jaxgeo.simulate.files import write_session_files
from jaxgeo.simulate.layout import UAV, UGV, Layout
from jaxgeo.simulate.regimes import drift_of, paper_drift, scaled
from jaxgeo.simulate.revisit import raw_revisit_gaps_m
from jaxgeo.simulate.session import SimulatedSession, simulate_session

__all__ = [
    "UAV",
    "UGV",
    "Drift",
    "Faults",
    "Layout",
    "LoopClosure",
    "SimulatedSession",
    "drift_of",
    "paper_drift",
    "raw_revisit_gaps_m",
    "scaled",
    "simulate_session",
    "write_session_files",
]
