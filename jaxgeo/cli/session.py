"""The main job: one session read, each of its trajectories aligned, corrected and held out."""

import contextlib
import dataclasses
import platform
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.calibrate import LearnSettings
from eval.drift_growth import drift_growth
from eval.loo import (
    EnsembleHeldOut,
    LeaveOneOut,
    correct_and_hold_out,
    correct_under_and_hold_out,
    learn_and_hold_out,
)
from eval.reference import absolute_error
from eval.revisit import revisit_gaps
from jaxgeo.associate import make_anchors, refuse_exchanged_axes, upside_down
from jaxgeo.cli.ingest import Ingested, file_hashes, ingest
from jaxgeo.cli.noise import (
    learn_settings,
    learned_values,
    noise_of,
    noise_values,
    stored_ensemble,
    stored_noise,
    stored_values,
)
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session_check import cause_words, check_anchors, check_warnings
from jaxgeo.cli.session_corrections import estimated, learn_corrected
from jaxgeo.config.inputs import AnyTrajectoryInput
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError, JaxgeoError
from jaxgeo.export.result import CoarseFit, DriftGrowth, HeldOut, ReferenceError, SessionResult, TrajectoryResult
from jaxgeo.graph.components import ensemble_of
from jaxgeo.solve.correct import Correction, Settings, correct
from jaxgeo.solve.ensemble_correct import EnsembleCorrection

_VERSIONS = ("jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "scipy", "opencv-python-headless", "pyproj")


def run_session(
    config: SessionConfig,
    progress: Progress,
    data: Ingested | None = None,
    out: Path | None = None,
    *,
    check: bool = False,
) -> SessionResult:
    """Run one session.

    Args:
        data: what `ingest` made of this config, where it is known already.
        out: the session's folder.
        check: whether to look for wrong anchors where the config does not say.

    Raises:
        InputError: bad input.
        EstimationError: a trajectory whose anchors do not fix its frame, or whose solve did not converge.
    """
    started = time.perf_counter()
    if data is None:
        progress.phase("read", config.name)
        data = ingest(config, progress, out)
    read_s = time.perf_counter() - started
    trajectories: dict[str, TrajectoryResult] = {}
    for name, source in config.trajectories.items():
        with named(name):
            trajectories[name] = _run_trajectory(name, source, config, data, progress, check=check)
    return SessionResult(
        name=config.name,
        frame=data.frame,
        survey_enh_m={n: data.frame.to_local(x) for n, x in zip(data.survey.name, data.survey.enh_m, strict=True)},
        trajectories=trajectories,
        config=config.model_dump(mode="json"),
        run={
            "versions": {"jaxgeo": version("jaxgeo"), "python": platform.python_version()}
            | {name: version(name) for name in _VERSIONS},
            "inputs_sha256": file_hashes(data.files),
            "seed": config.seed,
            "timing_s": {"read": read_s, "total": time.perf_counter() - started},
        },
        simulated=config.simulated,
        basemap=data.basemap,
    )


def settings_of(config: SessionConfig) -> Settings:
    """What the estimator takes of a config."""
    return Settings(
        coarse_scale=config.coarse.scale,
        coarse_gravity=config.coarse.gravity,
        loss=config.anchors.loss,
        loss_width=config.anchors.loss_width,
        use_rotation=config.anchors.use_rotation,
        extra_sigma_m=config.anchors.extra_sigma_m,
        max_steps=config.solver.max_steps,
    )


@dataclasses.dataclass(frozen=True)
class _Refined:
    """What is written of one trajectory, whichever noise it was corrected with; `held_out_m` of every visit's fold."""

    stage: str
    corrected: Trajectory
    covariance: Float[np.ndarray, "n 6 6"]
    point_m: Float[np.ndarray, "k 3"]
    log_scale: tuple[float, float]
    solver: dict[str, Any]
    held_out: HeldOut | None
    held_out_m: Float[np.ndarray, "k 3"] | None


def _run_trajectory(
    name: str, source: AnyTrajectoryInput, config: SessionConfig, data: Ingested, progress: Progress, *, check: bool
) -> TrajectoryResult:
    settings, noise = settings_of(config), noise_of(source, config)
    learn = learn_settings(config, source, noise, stored_noise(config, source))
    clock = Clock(progress, name)
    trajectory, anchors, said = anchored(name, settings, data, clock)
    asked = check if config.evaluate.check is None else config.evaluate.check

    def checked(used: Anchors) -> dict[str, Any] | None:
        if not asked:
            return None
        clock.phase("check the anchors")
        return check_anchors(config, data, trajectory, used, settings, learn)

    try:
        found = _estimated(name, source, config, data, trajectory, anchors, learn, clock)
    except ConvergenceError as error:  # most often an anchor is wrong: then that is the message
        raise ConvergenceError(f"{error} {cause_words(checked(anchors))}") from error
    finding = checked(found.anchors)
    clock.end()
    # Anchors that were made twice are told of once.
    warnings = tuple(dict.fromkeys((*said, *found.warnings, *check_warnings(finding))))
    return dataclasses.replace(found, check=finding, warnings=warnings)


def _estimated(
    name: str,
    source: AnyTrajectoryInput,
    config: SessionConfig,
    data: Ingested,
    trajectory: Trajectory,
    anchors: Anchors,
    learn: LearnSettings,
    clock: "Clock",
) -> TrajectoryResult:
    """Everything but the check; its warnings are those of corrections and of the similarity.

    Raises:
        EstimationError: the anchors do not fix the frame, or a solve did not converge.
    """
    settings, noise, stored = settings_of(config), learn.noise, stored_noise(config, source)
    hold_out = config.evaluate.leave_one_out
    # The fixed noise first, always: it says whether the anchors fix the frame, and what learning has to beat.
    clock.phase("correct and hold out" if hold_out else "correct")
    if hold_out:
        found, held_out = correct_and_hold_out(trajectory, anchors, noise, settings)
    else:
        found, held_out = correct(trajectory, anchors, noise, settings), None
    refined = [_of_fixed(found, held_out, len(anchors))]
    written: dict[str, Any] = {"fixed": noise_values(noise)}
    ensemble, learned = ensemble_of(noise), None
    made = None
    if config.corrections is not None:
        clock.phase("corrections")
        made = estimated(config.corrections, trajectory, anchors, data, settings, learn)
    final = anchors if made is None or made.anchors is None else made.anchors
    if config.noise.mode == "learned":
        clock.phase("learn and hold out" if hold_out else "learn")
        if made is not None and made.anchors is not None:
            calibration, correction, predicted = learn_corrected(made, trajectory, data, settings, learn, held_out)
        else:
            calibration, correction, predicted = learn_and_hold_out(trajectory, anchors, settings, learn, held_out)
        refined.append(_of_ensemble("learned", correction, predicted, len(anchors)))
        written["learned"] = learned_values(calibration)
        learned = calibration.ensemble
    elif stored is not None:
        clock.phase("correct with the file's noise")
        ensemble = stored_ensemble(stored)
        correction, predicted = correct_under_and_hold_out(trajectory, anchors, settings, ensemble, held_out)
        refined = [_of_ensemble("fixed", correction, predicted, len(anchors))]
        written = {"fixed": stored_values(stored)}
    clock.phase("compare")
    estimates = {"coarse": found.coarse} | {each.stage: each.corrected for each in refined}
    reference = _reference_errors(source, data.references.get(name), estimates, data)
    coarse_m = np.asarray(found.fold.coarse_point_m)[: len(anchors)]
    growth = drift_growth(
        trajectory, anchors, float(found.fold.coarse.scale), coarse_m - anchors.surveyed_enh_m, ensemble, learned
    )
    clock.end()
    said = (*(() if made is None else made.warnings), *upside_down(np.asarray(found.fold.coarse.rotation)))
    whole = _result(name, trajectory, final, found, held_out, refined, reference, written, growth, clock.timing_s, said)
    return dataclasses.replace(whole, corrections=None if made is None else made.facts())


def anchored(
    name: str, settings: Settings, data: Ingested, clock: "Clock"
) -> tuple[Trajectory, Anchors, tuple[str, ...]]:
    """One trajectory, its anchors, and what is to be said of them.

    Raises:
        InputError: sightings or survey do not fit the trajectory.
    """
    trajectory = data.trajectories[name]
    clock.phase("anchors")
    anchors, said = make_anchors(
        trajectory, data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
    )
    refuse_exchanged_axes(trajectory, anchors, scale=settings.coarse_scale, gravity=settings.coarse_gravity)
    return trajectory, anchors, (*data.made_warnings.get(name, ()), *data.warnings, *said)


def _of_fixed(found: Correction, held_out: LeaveOneOut | None, k: int) -> _Refined:
    solution = found.fold.solution
    return _Refined(
        stage="fixed",
        corrected=found.corrected,
        covariance=found.covariance,
        point_m=np.asarray(found.fold.point_m)[:k],
        log_scale=found.log_scale,
        solver={"result": found.result, "steps": int(solution.steps), "cost": float(solution.cost)},
        held_out=None if held_out is None else held_out.refined,
        held_out_m=None if held_out is None else held_out.point_m,
    )


def _of_ensemble(stage: str, found: EnsembleCorrection, held_out: EnsembleHeldOut | None, k: int) -> _Refined:
    """Of a mixture there is no one cost, and its log-scale has no standard deviation of its own."""
    return _Refined(
        stage=stage,
        corrected=found.corrected,
        covariance=found.covariance,
        point_m=found.point_m[:k],
        log_scale=(found.log_scale, float("nan")),
        solver={"result": "converged", "steps": found.rounds, "cost": None},
        held_out=None if held_out is None else held_out.refined,
        held_out_m=None if held_out is None else held_out.point_m,
    )


@contextlib.contextmanager
def named(name: str) -> Iterator[None]:
    """Errors say which trajectory they are about."""
    try:
        yield
    except JaxgeoError as error:
        raise type(error)(f"trajectories.{name}: {error}") from error


def _result(
    name: str,
    trajectory: Trajectory,
    anchors: Anchors,
    found: Correction,
    held_out: LeaveOneOut | None,
    refined: list[_Refined],
    reference: dict[str, ReferenceError],
    noise: dict[str, Any],
    growth: DriftGrowth,
    timing_s: dict[str, float],
    warnings: tuple[str, ...],
) -> TrajectoryResult:
    """The last of `refined` is what is written."""
    final, coarse_point = refined[-1], np.asarray(found.fold.coarse_point_m)[: len(anchors)]
    points = {"coarse_m": coarse_point, "refined_m": final.point_m}
    stages: dict[str, HeldOut] = {} if held_out is None else {"coarse": held_out.coarse}
    stages |= {each.stage: each.held_out for each in refined if each.held_out is not None}
    if final.held_out_m is not None:
        points["held_out_m"] = final.held_out_m
    return TrajectoryResult(
        name=name,
        measured=trajectory,
        coarse=coarse_fit(found),
        coarse_trajectory=found.coarse,
        corrected=final.corrected,
        covariance=final.covariance,
        anchors=anchors,
        residual_coarse_m=coarse_point - anchors.surveyed_enh_m,
        residual_refined_m=final.point_m - anchors.surveyed_enh_m,
        held_out=stages,
        revisit=revisit_gaps(anchors.location, points),
        reference=reference,
        noise=noise,
        log_scale=final.log_scale,
        solver=final.solver,
        timing_s=timing_s,
        warnings=warnings,
        drift_growth=growth,
    )


def coarse_fit(found: Correction) -> CoarseFit:
    """The one-time similarity from the trajectory's own frame."""
    fit = found.fold.coarse
    measured_to_grid = found.coarse_translation_m
    return CoarseFit(float(fit.scale), np.asarray(fit.rotation), measured_to_grid, float(found.fold.coarse_rms_m))


def _reference_errors(
    source: AnyTrajectoryInput, reference: Trajectory | None, estimates: dict[str, Trajectory], data: Ingested
) -> dict[str, ReferenceError]:
    """ATE of every stage's trajectory; only a reference in a frame of its own is aligned first."""
    if reference is None or source.reference is None:
        return {}
    reference = local_reference(source, reference, data)
    align = "se3" if source.reference.frame == "own" else "none"
    arm = source.reference.t_body_reference_m
    return {
        stage: absolute_error(estimate, reference, t_body_reference_m=arm, align=align)
        for stage, estimate in estimates.items()
    }


def local_reference(source: AnyTrajectoryInput, reference: Trajectory, data: Ingested) -> Trajectory:
    """The reference in the session's local frame; as it is where it has a frame of its own."""
    if source.reference is None or source.reference.frame != "grid":
        return reference
    return Trajectory(reference.stamp_s, data.frame.to_local(reference.position_m), reference.quat_wxyz)


class Clock:
    """Times phases and shows them."""

    def __init__(self, progress: Progress, name: str) -> None:
        self._progress, self._name = progress, name
        self._phase, self._since = "", 0.0
        self.timing_s: dict[str, float] = {}

    def phase(self, phase: str) -> None:
        self.end()
        self._progress.phase(phase, self._name)
        self._phase, self._since = phase, time.perf_counter()

    def end(self) -> None:
        if self._phase:
            self.timing_s[self._phase.replace(" ", "_")] = time.perf_counter() - self._since
            self._phase = ""
