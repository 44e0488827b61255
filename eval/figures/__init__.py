"""The figures of a study: plain arrays in, one picture as SVG, PNG and PDF out."""

from eval.figures.calibration_ratio import calibration_ratio
from eval.figures.ellipses import error_ellipses
from eval.figures.held_out_by_k import held_out_by_k
from eval.figures.maps import before_after_map, trajectories_map
from eval.figures.picture import Picture, write_pictures
from eval.figures.predicted_achieved import predicted_achieved

__all__ = [
    "Picture",
    "before_after_map",
    "calibration_ratio",
    "error_ellipses",
    "held_out_by_k",
    "predicted_achieved",
    "trajectories_map",
    "write_pictures",
]
