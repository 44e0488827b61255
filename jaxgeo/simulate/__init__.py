"""One simulated session with known truth."""

from jaxgeo.simulate.drift import Drift
from jaxgeo.simulate.files import write_session_files
from jaxgeo.simulate.session import SimulatedSession, simulate_session

__all__ = ["Drift", "SimulatedSession", "simulate_session", "write_session_files"]
