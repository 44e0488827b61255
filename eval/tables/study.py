"""All tables of one or several sessions, in the order in which they are read."""

from collections.abc import Sequence

import numpy as np

from eval.evaluation import TrajectoryEvaluation
from eval.tables.by_count import by_count_table
from eval.tables.collinearity import contrast_table, geometry_table
from eval.tables.effect import effect_table
from eval.tables.noise_values import noise_table
from eval.tables.places import places_table
from eval.tables.reference import absolute_table, relative_table
from eval.tables.uncertainty import uncertainty_table
from jaxgeo.export.table import Table
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise


def study_tables(
    evaluations: Sequence[TrajectoryEvaluation],
    origin_enh_m: dict[str, np.ndarray],
    fixed: dict[tuple[str, str], OdometryNoise],
    true: dict[tuple[str, str], NoiseEnsemble] | None = None,
    *,
    beside: bool = False,
) -> tuple[Table, ...]:
    """Those that the data allow; nothing in them depends on time.

    Args:
        origin_enh_m: of every session's local frame.
        fixed, true: noise by session and trajectory.
        beside: print the reference study's figures beside.
    """
    tables = (
        places_table(evaluations, origin_enh_m, beside),
        effect_table(evaluations, beside),
        by_count_table(evaluations, beside),
        geometry_table(evaluations, beside),
        contrast_table(evaluations, beside),
        uncertainty_table(evaluations),
        noise_table(evaluations, fixed, true or {}),
        absolute_table(evaluations),
        relative_table(evaluations),
    )
    return tuple(table for table in tables if table is not None)
