"""One session run and evaluated: what `jaxgeo evaluate` and `jaxgeo study paper` both do to a config."""

import dataclasses

import numpy as np

from calibration.calibrate import LearnSettings
from eval.evaluation import EvaluationInput, TrajectoryEvaluation, evaluate_trajectory
from jaxgeo.cli.ingest import Ingested, ingest
from jaxgeo.cli.noise import learn_settings, noise_of, stored_noise
from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session import local_reference, named, run_session, settings_of
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Trajectory
from jaxgeo.export.basemap import read_basemap
from jaxgeo.export.result import SessionResult
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.io.orthophoto import Orthophoto

# How far beyond the surveyed points an orthophoto is read, in the site's size: trajectories go there.
BASEMAP_REACH = 0.3


@dataclasses.dataclass(frozen=True)
class EvaluatedSession:
    """What one session gave.

    Attributes:
        fixed: the fixed noise by trajectory, `true` the true one where it is known.
        basemap: the orthophoto of its site, if there is one.
    """

    config: SessionConfig
    result: SessionResult
    evaluations: tuple[TrajectoryEvaluation, ...]
    fixed: dict[str, OdometryNoise]
    true: dict[str, NoiseEnsemble]
    basemap: Orthophoto | None


def evaluate_session(
    config: SessionConfig,
    progress: Progress,
    *,
    true: dict[str, NoiseEnsemble] | None = None,
) -> EvaluatedSession:
    """Run one session, then hold out, repeat and compare each of its trajectories.

    Args:
        true: noise that simulated trajectories were drawn from, by name.

    Raises:
        InputError: bad input.
        EstimationError: a trajectory whose anchors do not fix its frame, or whose solve did not converge.
    """
    true = true or {}
    progress.phase("read", config.name)
    data = ingest(config)
    basemap = _basemap(config, data)  # at once: a file that cannot be read should not cost the whole computation
    result = run_session(config, progress, data)
    evaluations, fixed = [], {}
    for name, source in config.trajectories.items():
        with named(name):
            noise = fixed[name] = noise_of(source, config)
            learn: LearnSettings | None = None
            if config.noise.mode == "learned":
                learn = learn_settings(config, source, noise, stored_noise(config, source))
            given = EvaluationInput(
                settings=settings_of(config),
                noise=noise,
                learn=learn,
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
    return EvaluatedSession(config, result, tuple(evaluations), fixed, true, basemap)


def _basemap(config: SessionConfig, data: Ingested) -> Orthophoto | None:
    """Around the survey; paths that leave it by far are not drawn over it."""
    if config.basemap is None:
        return None
    survey_m = data.frame.to_local(data.survey.enh_m)[:, :2]
    reach = BASEMAP_REACH * np.ptp(survey_m, axis=0).max()
    corners = np.array([survey_m.min(axis=0) - reach, survey_m.max(axis=0) + reach])
    return read_basemap(config.basemap, data.frame, corners)


def _reference(name: str, config: SessionConfig, data: Ingested) -> Trajectory | None:
    reference = data.references.get(name)
    return None if reference is None else local_reference(config.trajectories[name], reference, data)
