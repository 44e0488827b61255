"""The figures of one or several evaluated sessions, each behind the table that it illustrates."""

from collections.abc import Sequence

import numpy as np

from eval.evaluation import STAGE_NAME, TrajectoryEvaluation
from eval.figures import before_after_map, error_ellipses, held_out_by_k, predicted_achieved, trajectories_map
from eval.figures.held_out_by_k import ByNumber
from eval.reference_study import BY_COUNT
from eval.study_page import StudyFigure
from eval.tables.by_count import grouped, summaries
from jaxgeo.export.held_out_stats import final_stage
from jaxgeo.export.result import SessionResult


def study_figures(
    sessions: Sequence[SessionResult],
    evaluations: Sequence[TrajectoryEvaluation],
    *,
    beside: bool = False,
) -> tuple[StudyFigure, ...]:
    """Those that the data allow. `beside`: with the reference study's figures."""
    simulated = any(result.simulated for result in sessions)
    found: list[StudyFigure] = []
    for result in sessions:
        found += _maps(result)
    found += _by_number(evaluations, simulated, beside)
    predicted = {
        STAGE_NAME[stage]: _predicted_achieved(evaluations, stage)
        for stage in ("fixed", "learned", "true")
        if all(stage in e.held_out for e in evaluations)
    }
    if predicted:
        found.append(
            StudyFigure(
                "predicted_achieved",
                "uncertainty",
                predicted_achieved(predicted, simulated),
                "Predicted against achieved held-out error",
                "Every point a held-out visit: the error that was predicted for it (one sigma in space) against the "
                "error found. In the band lie 95 of 100 points where the prediction is right.",
            )
        )
    for evaluation in evaluations:
        found.append(_ellipses(evaluation, simulated))
    return tuple(found)


def _maps(result: SessionResult) -> list[StudyFigure]:
    """The session's trajectories on one map, and each before and after its correction."""
    survey = {name: np.asarray(place)[:2] for name, place in result.survey_enh_m.items()}
    paths = {name: t.corrected.position_m[:, :2] for name, t in result.trajectories.items()}
    origin = np.asarray(result.frame.origin_enh_m)
    where = "grid coordinates" if result.frame.has_datum else "the site's own coordinates"
    figures = [
        StudyFigure(
            f"map_{result.name}",
            "effect",
            trajectories_map(paths, survey, origin, result.frame.crs, result.basemap, result.simulated),
            f"Corrected trajectories of {result.name}",
            f"Session {result.name}: corrected trajectories and surveyed points in {where}"
            + ("." if result.basemap is not None else "; no orthophoto was given."),
        )
    ]
    figures += [
        StudyFigure(
            f"before_after_{result.name}_{name}",
            "effect",
            before_after_map(result, trajectory),
            f"Before and after: {result.name} {name}",
            f"Session {result.name}, trajectory {name}: after the one-time similarity and after the correction.",
            on_page=False,
        )
        for name, trajectory in result.trajectories.items()
    ]
    return figures


def _by_number(evaluations: Sequence[TrajectoryEvaluation], simulated: bool, beside: bool) -> list[StudyFigure]:
    """Panels by trajectory and stage: the similarity, and the best that was done."""
    groups = grouped(evaluations, pooled=beside)
    series: dict[str, ByNumber] = {}
    study: dict[str, ByNumber] = {}
    for (session, name), group in groups.items():
        best = "learned" if all("learned" in e.subsets for e in group) else "fixed"
        for stage in ("first" if beside else "coarse", best):
            rows = summaries(group, stage)
            if rows:
                title = f"{name if beside else f'{session} {name}'}: {STAGE_NAME[stage]}"
                series[title] = ByNumber(
                    *(
                        np.array([getattr(row, field) for row in rows])
                        for field in ("k", "held_out_mean_m", "held_out_rms_m", "in_sample_mean_m")
                    )
                )
                if beside and stage == "first" and name in BY_COUNT:
                    study[title] = _study_by_number(name)
    if not series:
        return []
    caption = "Mean error over all choices of k locations; the noise is learned anew for each choice. " + (
        "Hollow: the reference study's own recordings, for orientation only." if study else ""
    )
    picture = held_out_by_k(series, study or None, simulated=simulated)
    return [StudyFigure("held_out_by_k", "by_count", picture, "Error against the number of anchors", caption.strip())]


def _study_by_number(trajectory: str) -> ByNumber:
    rows = BY_COUNT[trajectory]
    nothing = (float("nan"), float("nan"))
    return ByNumber(
        np.array(list(rows)),
        np.array([(row.held_out_m or nothing)[0] for row in rows.values()]),
        np.array([(row.held_out_m or nothing)[1] for row in rows.values()]),
        np.array([row.in_sample_m[0] for row in rows.values()]),
    )


def _predicted_achieved(evaluations: Sequence[TrajectoryEvaluation], stage: str) -> tuple[np.ndarray, np.ndarray]:
    held_out = [e.held_out[stage] for e in evaluations]
    predicted = np.concatenate([np.sqrt(np.trace(h.covariance_m2, axis1=1, axis2=2)) for h in held_out])
    return predicted, np.concatenate([np.linalg.norm(h.error_enh_m, axis=1) for h in held_out])


def _ellipses(evaluation: TrajectoryEvaluation, simulated: bool) -> StudyFigure:
    name = f"{evaluation.session}_{evaluation.name}"
    stage = final_stage(evaluation.result)
    picture = error_ellipses(
        evaluation.anchors.label,
        {s: h.error_enh_m[:, :2] for s, h in evaluation.held_out.items()},
        evaluation.held_out[stage].covariance_m2[:, :2, :2],
        stage,
        simulated,
    )
    return StudyFigure(
        f"ellipses_{name}",
        "uncertainty",
        picture,
        f"Held-out errors and predicted ellipses of {evaluation.session} {evaluation.name}",
        f"Session {evaluation.session}, trajectory {evaluation.name}: horizontal error of every visit when its "
        f"location was held out, in the 50 and 95 % ellipses that the {STAGE_NAME[stage]} predicts for it.",
    )
