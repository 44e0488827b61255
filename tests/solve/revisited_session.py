"""A small simulated session whose first location is visited twice, each location surveyed once."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from solve.chain_session import Session, drifted, trajectory_of, walk

from jaxgeo.data import Anchors
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.graph.pose_graph import Terms
from jaxgeo.solve.fold import FoldOptions

N = 120
POSES = (2, 24, 43, 61, 80, 99, 117)
LOCATIONS = ("A", "B", "C", "D", "E", "F", "A")
KIND = "lidar"
MEDIANS = default_noise(KIND)
OPTIONS = FoldOptions(terms=Terms(log_scale=True))
WIDTH = jnp.asarray(3.0)
SURVEY_M, SEEN_M = 0.02, 0.01


def revisited_session(
    seed: int = 0, *, size: float = 1.0, noise: OdometryNoise = MEDIANS, locations: tuple[str, ...] = LOCATIONS
) -> Session:
    """White noise of `size` times `noise`; markers a metre off the path, each location surveyed once."""
    truth = walk(N)
    rng = np.random.default_rng([seed, 77])
    index = np.array(POSES[: len(locations)])
    k = len(index)
    names = list(dict.fromkeys(locations))
    where = np.array([names.index(name) for name in locations])
    first = np.array([locations.index(name) for name in locations])
    body = truth[index]
    marker = (body.translation + rng.uniform(-1.5, 1.5, (k, 3)))[first]
    surveyed = (marker + SURVEY_M * rng.standard_normal((k, 3)))[first]
    lever = body.inv().apply(marker) + SEEN_M * rng.standard_normal((k, 3))
    eye = np.broadcast_to(np.eye(3), (k, 3, 3))
    anchors = Anchors(
        label=tuple(f"visit{i}" for i in range(k)),
        location=tuple(locations),
        location_index=where,
        pose_index=index,
        lever_arm_m=lever,
        lever_covariance_m2=SEEN_M**2 * eye,
        surveyed_enh_m=surveyed,
        survey_covariance_m2=SURVEY_M**2 * eye,
        quat_body_marker_wxyz=np.full((k, 4), np.nan),
        quat_grid_marker_wxyz=np.full((k, 4), np.nan),
        rotation_covariance_rad2=np.zeros((k, 3, 3)),
        repeatability_m=np.full(k, SEEN_M),
        count=np.full(k, 10),
        stamp_s=index * 0.1,
    )
    return Session(trajectory_of(truth), trajectory_of(drifted(truth, noise, seed, size)), anchors, noise)


def tables(made: Session) -> tuple[Chain, AnchorTable]:
    chain = chain_of(made.trajectory)
    return chain, anchor_table(made.anchors, chain)


def without(table: AnchorTable, location: int) -> jax.Array:
    """`use` of the fold that holds one location out."""
    return table.real * (table.location != location).astype(float)


def moved(made: Session, location: int, shift_m: float, sigma_factor: float = 1.0) -> Session:
    """The same with one location's coordinates moved, and its survey sigma multiplied."""
    here = made.anchors.location_index == location
    surveyed = made.anchors.surveyed_enh_m + shift_m * here[:, None] * np.array([1.0, -0.7, 0.4])
    factor = np.where(here, sigma_factor**2, 1.0)[:, None, None]
    survey = made.anchors.survey_covariance_m2 * factor
    anchors = dataclasses.replace(made.anchors, surveyed_enh_m=surveyed, survey_covariance_m2=survey)
    return dataclasses.replace(made, anchors=anchors)
