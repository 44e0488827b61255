"""All kinds of bad input."""

from cli.bad_input.config_cases import CONFIG
from cli.bad_input.estimate_cases import ESTIMATE
from cli.bad_input.file_cases import every_file
from cli.bad_input.sighting_cases import SIGHTINGS
from cli.bad_input.survey_cases import SURVEY
from cli.bad_input.trajectory_cases import TRAJECTORY

CASES = [*every_file(), *TRAJECTORY, *SURVEY, *SIGHTINGS, *CONFIG, *ESTIMATE]
