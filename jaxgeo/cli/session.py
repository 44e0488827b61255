"""The main job: one session read, each of its trajectories aligned, corrected and held out."""

import contextlib
import platform
import time
from collections.abc import Iterator
from importlib.metadata import version

import numpy as np

from eval.loo import LeaveOneOut, correct_and_hold_out
from eval.reference import absolute_error
from eval.revisit import revisit_gaps
from jaxgeo.associate import make_anchors, refuse_exchanged_axes, upside_down
from jaxgeo.cli.ingest import Ingested, file_hashes, ingest
from jaxgeo.cli.progress import Progress
from jaxgeo.config.inputs import TrajectoryInput
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import JaxgeoError
from jaxgeo.export.result import CoarseFit, HeldOut, ReferenceError, SessionResult, TrajectoryResult
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.solve.correct import Correction, Settings, correct

_VERSIONS = ("jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "scipy", "opencv-python-headless", "pyproj")


def run_session(config: SessionConfig, progress: Progress) -> SessionResult:
    """Run one session.

    Raises:
        InputError: bad input.
        EstimationError: a trajectory whose anchors do not fix its frame, or whose solve did not converge.
    """
    started = time.perf_counter()
    progress.phase("read", config.name)
    data = ingest(config)
    read_s = time.perf_counter() - started
    trajectories: dict[str, TrajectoryResult] = {}
    for name, source in config.trajectories.items():
        with _named(name):
            trajectories[name] = _run_trajectory(name, source, config, data, progress)
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


def noise_of(source: TrajectoryInput, config: SessionConfig) -> OdometryNoise:
    """Fixed noise: the defaults of the kind of odometry, the session's values, then the trajectory's own."""
    values = config.noise.values.model_dump(exclude_none=True) | source.noise.model_dump(exclude_none=True)
    return default_noise(source.odometry, **values)


def _run_trajectory(
    name: str, source: TrajectoryInput, config: SessionConfig, data: Ingested, progress: Progress
) -> TrajectoryResult:
    trajectory = data.trajectories[name]
    settings, noise = settings_of(config), noise_of(source, config)
    clock = _Clock(progress, name)
    clock.phase("anchors")
    anchors, said = make_anchors(
        trajectory, data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
    )
    refuse_exchanged_axes(trajectory, anchors, scale=settings.coarse_scale, gravity=settings.coarse_gravity)
    if config.evaluate.leave_one_out:
        clock.phase("correct and hold out")
        found, held_out = correct_and_hold_out(trajectory, anchors, noise, settings)
    else:
        clock.phase("correct")
        found, held_out = correct(trajectory, anchors, noise, settings), None
    clock.phase("compare")
    reference = _reference_errors(source, data.references.get(name), found, data)
    clock.end()
    said = (*data.warnings, *said, *upside_down(np.asarray(found.fold.coarse.rotation)))
    return _result(name, trajectory, anchors, found, held_out, reference, noise, clock.timing_s, said)


@contextlib.contextmanager
def _named(name: str) -> Iterator[None]:
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
    reference: dict[str, ReferenceError],
    noise: OdometryNoise,
    timing_s: dict[str, float],
    warnings: tuple[str, ...],
) -> TrajectoryResult:
    k, fold = len(anchors), found.fold
    point, coarse_point = np.asarray(fold.point_m)[:k], np.asarray(fold.coarse_point_m)[:k]
    points = {"coarse_m": coarse_point, "refined_m": point}
    stages: dict[str, HeldOut] = {}
    if held_out is not None:
        points["held_out_m"] = held_out.point_m
        stages = {"coarse": held_out.coarse, "fixed": held_out.refined}
    return TrajectoryResult(
        name=name,
        measured=trajectory,
        coarse=coarse_fit(found),
        coarse_trajectory=found.coarse,
        corrected=found.corrected,
        covariance=found.covariance,
        anchors=anchors,
        residual_coarse_m=coarse_point - anchors.surveyed_enh_m,
        residual_refined_m=point - anchors.surveyed_enh_m,
        held_out=stages,
        revisit=revisit_gaps(anchors.location, points),
        reference=reference,
        noise={"fixed": noise_values(noise)},
        log_scale=found.log_scale,
        solver={
            "result": found.result,
            "steps": int(fold.solution.steps),
            "cost": float(fold.solution.cost),
        },
        timing_s=timing_s,
        warnings=warnings,
    )


def coarse_fit(found: Correction) -> CoarseFit:
    """The one-time similarity from the trajectory's own frame."""
    fit = found.fold.coarse
    measured_to_grid = found.coarse_translation_m
    return CoarseFit(float(fit.scale), np.asarray(fit.rotation), measured_to_grid, float(found.fold.coarse_rms_m))


def noise_values(noise: OdometryNoise) -> dict[str, float | list[float]]:
    """Noise as plain numbers, named as in the config."""
    return {name: np.asarray(value).tolist() for name, value in vars(noise).items()}


def _reference_errors(
    source: TrajectoryInput, reference: Trajectory | None, found: Correction, data: Ingested
) -> dict[str, ReferenceError]:
    """ATE of both stages; only a reference in a frame of its own is aligned first."""
    if reference is None or source.reference is None:
        return {}
    if source.reference.frame == "grid":
        position_m = data.frame.to_local(reference.position_m)
        reference = Trajectory(reference.stamp_s, position_m, reference.quat_wxyz)
    align = "se3" if source.reference.frame == "own" else "none"
    arm = source.reference.t_body_reference_m
    return {
        stage: absolute_error(estimate, reference, t_body_reference_m=arm, align=align)
        for stage, estimate in (("coarse", found.coarse), ("fixed", found.corrected))
    }


class _Clock:
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
