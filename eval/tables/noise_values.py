"""Noise values: fixed, learned with their widths, and true where the session was simulated."""

from collections.abc import Sequence

import numpy as np

from eval.evaluation import TrajectoryEvaluation
from eval.tables.columns import PROVENANCE, SESSION, TRAJECTORY, notes, provenance, shares
from jaxgeo.export.table import Column, Table
from jaxgeo.graph.components import COMPONENTS, ROT, TRANS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import OdometryNoise

_NOTE = (
    "Standard deviations per metre of the odometry's own path; three axes as their geometric mean. Learned: median and "
    "95 % range over all models of the family, of those that have the component; probability: of these models. "
    "noise.json has every axis."
)


def noise_table(
    evaluations: Sequence[TrajectoryEvaluation],
    fixed: dict[tuple[str, str], OdometryNoise],
    true: dict[tuple[str, str], NoiseEnsemble],
) -> Table | None:
    """A row for every trajectory and noise component; `fixed` and `true` by session and trajectory."""
    rows = []
    for evaluation in evaluations:
        learned = evaluation.result.noise.get("learned")
        if learned is None or "sigmas" not in learned:
            continue
        key = (evaluation.session, evaluation.name)
        assumed = component_values(ensemble_of(fixed[key]))
        known = component_values(true[key]) if key in true else {}
        for sigma in learned["sigmas"]:
            name = sigma["component"]
            if name in COMPONENTS[ROT] or name in COMPONENTS[TRANS]:
                continue
            truth = known.get(name)
            ratio = sigma["median"] / truth if truth else None
            sizes = (assumed.get(name), sigma["median"], sigma["low_95"], sigma["high_95"])
            rows.append(
                (*key, name, *map(significant, sizes), sigma["probability"])
                + ((significant(truth), ratio) if true else ())
                + provenance(evaluation, "learned")
            )
    if not rows:
        return None

    def value(head: str, group: str = "") -> Column:
        return Column(head, group=group)

    columns = (
        SESSION,
        TRAJECTORY,
        Column("component", align="left"),
        value("fixed"),
        *(value(head, "learned") for head in ("median", "low 95 %", "high 95 %")),
        *shares("learned", "probability"),
        *((value("true"), Column("learned / true", digits=2)) if true else ()),
        *PROVENANCE,
    )
    return Table("noise", "Odometry noise", columns, tuple(rows), notes(evaluations, False, _NOTE))


def significant(value: float | None) -> float | None:
    """Three digits: more than any noise is known to."""
    return None if value is None else float(f"{value:.3g}")


def component_values(ensemble: NoiseEnsemble) -> dict[str, float]:
    """Root mean square over the ensemble's sets of every component, and, as `trans_..`, of three axes together."""
    rms = np.sqrt(np.asarray(ensemble.weight) @ np.asarray(ensemble.sigma) ** 2)
    values = dict(zip(COMPONENTS, rms.tolist(), strict=True))
    for part, name in ((TRANS, "trans_m_per_sqrt_m"), (ROT, "rot_rad_per_sqrt_m")):
        axes = rms[part]
        values[name] = float(np.exp(np.mean(np.log(axes)))) if np.all(axes > 0) else 0.0
    return values
