"""How a choice of anchors did: the path corrected with these alone, its noise learned from these alone.

This is for paths whose truth, or whose other markers, are known: what was not chosen is what a choice is judged by.
"""

import dataclasses
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import learn_fold, prior_arrays
from eval.similarity import fitted_markers, markers_of
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import chain_of
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_fold import EnsembleFold


@dataclasses.dataclass(frozen=True)
class Chosen:
    """One choice: whether its anchors fix the frame, and the corrected path, local frame; None where that failed.

    A path of a determined choice is None where learning and correcting did not settle.
    """

    determined: bool
    corrected: Trajectory | None


def corrected_with(
    trajectory: Trajectory,
    anchors: Anchors,
    choices: Bool[np.ndarray, "s n"],
    settings: Settings,
    learn: LearnSettings,
) -> Iterator[Chosen]:
    """Each choice of locations in turn, as `calibrate_and_correct` does it, but without the poses' covariances.

    Args:
        anchors: every visit of every candidate.
        choices: (s, n) of locations by `location_index`; all visits of a chosen one are used.
    """
    chain, width = chain_of(trajectory), jnp.asarray(settings.loss_width)
    family, options = prior_arrays(learn.family), learn_options(settings, learn)
    markers = markers_of(trajectory, anchors, settings.extra_sigma_m, rotations=settings.use_rotation)
    use = choices[:, anchors.location_index].astype(float)
    _, determined = fitted_markers(
        markers, use, scale=settings.coarse_scale, gravity=settings.coarse_gravity, of_graph=True
    )
    # All choices in tables of one size: compiling for another takes longer than a hundred choices do.
    size = anchor_bucket(max(int(use.sum(axis=1).max()), 1))
    for choice, good in zip(choices, determined, strict=True):
        if not good:
            yield Chosen(False, None)
            continue
        table = _filled(anchor_table(of_locations(anchors, choice), chain, settings.extra_sigma_m), size)
        fold = learn_fold(chain, table, family, table.real, width, options).fold
        yield Chosen(True, path_of(trajectory, fold) if bool(fold.settled) else None)


def of_locations(anchors: Anchors, choice: Bool[np.ndarray, "n"]) -> Anchors:
    """The visits of some locations, these numbered anew in the order of their first visits."""
    rows = np.flatnonzero(choice[anchors.location_index])

    def taken(column: np.ndarray | tuple[str, ...]) -> np.ndarray | tuple[str, ...]:
        return column[rows] if isinstance(column, np.ndarray) else tuple(column[i] for i in rows)

    kept = jax.tree.map(taken, anchors, is_leaf=lambda x: isinstance(x, np.ndarray | tuple))
    _, first, index = np.unique(kept.location_index, return_index=True, return_inverse=True)
    return dataclasses.replace(kept, location_index=np.argsort(np.argsort(first))[index])


def _filled(table: AnchorTable, size: int) -> AnchorTable:
    """More rows of padding: copies of the last row that are not real and hang on the last pose."""
    more = size - table.real.shape[0]
    rows = {name: column for name, column in vars(table).items() if name != "later_than"}
    rows = jax.tree.map(lambda x: jnp.concatenate([x, jnp.repeat(x[-1:], more, axis=0)]), rows)
    fill = {"real": 0.0, "has_rotation": 0.0, "location": -1, "pose_index": len(table.later_than) - 1}
    for name, value in fill.items():
        rows[name] = rows[name].at[size - more :].set(value)
    return AnchorTable(**rows, later_than=table.later_than)


def path_of(trajectory: Trajectory, fold: EnsembleFold) -> Trajectory:
    """The corrected trajectory of a fold, local frame."""
    n = len(trajectory)
    poses, offset = fold.state.poses, fold.state.offset_m
    position = np.stack([np.asarray(p + u)[:n] for p, u in zip(poses.t, offset, strict=True)], axis=-1)
    quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=-1)
    return Trajectory(trajectory.stamp_s, position + np.asarray(fold.origin_m), quat)


def marker_error_m(path: Trajectory, anchors: Anchors) -> Float[np.ndarray, "k"]:
    """Distance of every visit's marker, as a corrected path has it (pose o lever arm), from its survey."""
    at = anchors.pose_index
    turn = Rotation.from_quat(path.quat_wxyz[at], scalar_first=True)
    found = path.position_m[at] + turn.apply(anchors.lever_arm_m)
    return np.linalg.norm(found - anchors.surveyed_enh_m, axis=1)
