"""One session run and evaluated: what `jaxgeo evaluate` and `jaxgeo study paper` both do to a config."""

import dataclasses
from pathlib import Path

from calibration.calibrate import LearnSettings
from eval.evaluation import EvaluationInput, TrajectoryEvaluation, evaluate_trajectory
from jaxgeo.cli.ingest import Ingested, ingest
from jaxgeo.cli.noise import learn_settings, noise_of, stored_ensemble, stored_noise
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session import local_reference, named, run_session, settings_of
from jaxgeo.cli.session_corrections import as_recorded
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Trajectory
from jaxgeo.export.result import SessionResult
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise


@dataclasses.dataclass(frozen=True)
class EvaluatedSession:
    """What one session gave. `fixed` is the fixed noise, `true` the true one where it is known, by trajectory."""

    config: SessionConfig
    result: SessionResult
    evaluations: tuple[TrajectoryEvaluation, ...]
    fixed: dict[str, OdometryNoise]
    true: dict[str, NoiseEnsemble]


def evaluate_session(
    config: SessionConfig,
    progress: Progress,
    *,
    true: dict[str, NoiseEnsemble] | None = None,
    out: Path | None = None,
) -> EvaluatedSession:
    """Run one session, then hold out, repeat and compare each of its trajectories.

    Args:
        true: noise that simulated trajectories were drawn from, by name.
        out: the session's folder, where what was detected in images is kept; default out/NAME.

    Raises:
        InputError: bad input.
        EstimationError: a trajectory whose anchors do not fix its frame, or whose solve did not converge.
    """
    true = true or {}
    progress.phase("read", config.name)
    data = ingest(config, progress, out)
    recorded = as_recorded(config, "jaxgeo evaluate")
    result = _with_warnings(run_session(config.model_copy(update={"corrections": None}), progress, data), recorded)
    evaluations, fixed = [], {}
    for name, source in config.trajectories.items():
        with named(name):
            noise = fixed[name] = noise_of(source, config)
            learn: LearnSettings | None = None
            ensemble: NoiseEnsemble | None = None
            stored = stored_noise(config, source)
            if config.noise.mode == "learned":
                learn = learn_settings(config, source, noise, stored)
            elif stored is not None:
                ensemble = stored_ensemble(stored)
            given = EvaluationInput(
                settings=settings_of(config),
                noise=noise,
                learn=learn,
                ensemble=ensemble,
                true=true.get(name),
                reference=_reference(name, config, data),
                reference_own_frame=source.reference is not None and source.reference.frame == "own",
                reference_arm_m=source.reference.t_body_reference_m if source.reference else (0.0, 0.0, 0.0),
                most_subsets=config.evaluate.subsets,
                cost=config.evaluate.cost,
            )
            evaluations.append(
                evaluate_trajectory(
                    config.name,
                    config.simulated,
                    config.seed,
                    result.run["versions"],
                    result.trajectories[name],
                    given,
                    lambda what, name=name: progress.phase(what, name),
                )
            )
    return EvaluatedSession(config, result, tuple(evaluations), fixed, true)


def _with_warnings(result: SessionResult, more: tuple[str, ...]) -> SessionResult:
    trajectories = {
        name: dataclasses.replace(found, warnings=(*more, *found.warnings))
        for name, found in result.trajectories.items()
    }
    return dataclasses.replace(result, trajectories=trajectories)


def _reference(name: str, config: SessionConfig, data: Ingested) -> Trajectory | None:
    reference = data.references.get(name)
    return None if reference is None else local_reference(config.trajectories[name], reference, data)
