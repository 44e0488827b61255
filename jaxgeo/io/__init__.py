"""Readers and writers: one format a file, every refusal with file and line, every file written whole or not at all."""

from jaxgeo.io.atomic import atomic_path, check_output_folder, output_folder, write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.control_points import read_control_points
from jaxgeo.io.euroc import read_euroc, write_euroc
from jaxgeo.io.g2o_poses import read_g2o_poses, write_g2o_poses
from jaxgeo.io.input_warning import InputWarning, RoundedInputWarning
from jaxgeo.io.kitti import read_kitti, write_kitti
from jaxgeo.io.rig_yaml import read_rig
from jaxgeo.io.sightings_csv import (
    read_corner_sightings,
    read_pose_sightings,
    write_corner_sightings,
    write_pose_sightings,
)
from jaxgeo.io.survey_csv import read_survey, survey_from_points
from jaxgeo.io.text_table import float_columns, read_table, text_column
from jaxgeo.io.trajectory_file import read_trajectory
from jaxgeo.io.tum import read_tum, write_tum
from jaxgeo.io.yaml_file import read_yaml

__all__ = [
    "InputWarning",
    "RoundedInputWarning",
    "atomic_path",
    "check_output_folder",
    "float_columns",
    "output_folder",
    "read_control_points",
    "read_corner_sightings",
    "read_euroc",
    "read_g2o_poses",
    "read_kitti",
    "read_pose_sightings",
    "read_rig",
    "read_survey",
    "read_table",
    "read_trajectory",
    "read_tum",
    "read_yaml",
    "survey_from_points",
    "text_column",
    "validated_trajectory",
    "write_corner_sightings",
    "write_euroc",
    "write_g2o_poses",
    "write_kitti",
    "write_lines",
    "write_pose_sightings",
    "write_tum",
]
