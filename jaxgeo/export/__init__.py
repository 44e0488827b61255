"""Results as files: trajectories, tables, figures, the report."""

from jaxgeo.export.result import CoarseFit, HeldOut, ReferenceError, SessionResult, TrajectoryResult
from jaxgeo.export.session_files import write_session

__all__ = ["CoarseFit", "HeldOut", "ReferenceError", "SessionResult", "TrajectoryResult", "write_session"]
