"""What can go wrong, in three kinds, each with the exit code of the command line.

A message names the place (file, line or id), the value met, what was expected, and the likely mend.
"""


class JaxgeoError(Exception):
    """Any refusal of jaxgeo. `exit_code` is what the command line returns."""

    exit_code = 2


class InputError(JaxgeoError):
    """A file, a table or an argument does not hold what it should."""


class ConfigError(InputError):
    """The configuration is malformed or contradicts itself."""


class SurveyError(InputError):
    """The survey, its coordinate system or its coordinates are unusable."""


class TrajectoryError(InputError):
    """A trajectory is unusable: stamps, rotations, or numbers."""


class SightingError(InputError):
    """Sightings, rig or visits are unusable or do not fit the trajectory or the survey."""


class DetectError(InputError):
    """Images, or what is said about the markers in them, are unusable."""


class ScanError(InputError):
    """LiDAR scans or RGB-D frames, or what is said about them, are unusable."""


class CloudError(InputError):
    """A point cloud is unusable, or does not fit its trajectory."""


class GraphError(InputError):
    """A graph of poses and relative poses is unusable."""


class EstimationError(JaxgeoError):
    """The estimate is not determined by the data, or did not converge."""

    exit_code = 3


class UndeterminedError(EstimationError):
    """The anchors leave a direction of the gauge free."""


class ConvergenceError(EstimationError):
    """The solver stopped before it converged."""
