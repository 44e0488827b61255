"""Anchors as padded arrays, before any frame is chosen: what the estimator is given beside the chain."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Anchors
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import Chain


class AnchorTable(eqx.Module):
    """Anchors padded to k. Rows of the padding have `real` 0 and hang on the last pose.

    Attributes:
        real: (k,) 1 for an anchor, 0 for padding.
        pose_index: (k,) sorted.
        later_than: (n,) number of anchors before pose i.
        lever_arm_m, lever_covariance_m2: body frame.
        surveyed_m, survey_covariance_m2: local frame.
        rotation: (k, 3, 3) body-to-grid rotation that the surveyed marker rotation implies; identity where none.
        rotation_covariance_rad2: (k, 3, 3) body axes.
        has_rotation: (k,) 1 where the marker's rotation was surveyed and seen.
        location: (k,) equal for visits of one location; -1 for padding.
    """

    real: Float[Array, "k"]
    pose_index: Int[Array, "k"]
    later_than: Int[Array, "n"]
    lever_arm_m: Float[Array, "k 3"]
    lever_covariance_m2: Float[Array, "k 3 3"]
    surveyed_m: Float[Array, "k 3"]
    survey_covariance_m2: Float[Array, "k 3 3"]
    rotation: Float[Array, "k 3 3"]
    rotation_covariance_rad2: Float[Array, "k 3 3"]
    has_rotation: Float[Array, "k"]
    location: Int[Array, "k"]


def anchor_table(anchors: Anchors, chain: Chain, extra_sigma_m: float = 0.0) -> AnchorTable:
    """Anchors for a chain; `extra_sigma_m` is added, in squares, to every visit's own covariance."""
    k, n = len(anchors), chain.length_m.shape[0]
    padding = anchor_bucket(k) - k
    index = np.concatenate([anchors.pose_index, np.full(padding, n - 1)])

    def grow(rows: np.ndarray, fill: float | np.ndarray) -> Array:
        return jnp.asarray(np.concatenate([rows, np.broadcast_to(fill, (padding, *rows.shape[1:]))]).astype(float))

    eye = np.eye(3)
    both = np.concatenate([anchors.quat_body_marker_wxyz, anchors.quat_grid_marker_wxyz], axis=1)
    known = np.all(np.isfinite(both), axis=1)
    rotation = np.broadcast_to(eye, (k, 3, 3)).copy()
    if known.any():
        body = Rotation.from_quat(anchors.quat_body_marker_wxyz[known], scalar_first=True)
        grid = Rotation.from_quat(anchors.quat_grid_marker_wxyz[known], scalar_first=True)
        rotation[known] = (grid * body.inv()).as_matrix()
    rotation_covariance = np.where(known[:, None, None], anchors.rotation_covariance_rad2, eye)
    return AnchorTable(
        real=grow(np.ones(k), 0.0),
        pose_index=jnp.asarray(index),
        later_than=jnp.asarray(np.searchsorted(index, np.arange(n), side="left")),
        lever_arm_m=grow(anchors.lever_arm_m, 0.0),
        lever_covariance_m2=grow(anchors.lever_covariance_m2 + extra_sigma_m**2 * eye, eye),
        surveyed_m=grow(anchors.surveyed_enh_m, 0.0),
        survey_covariance_m2=grow(anchors.survey_covariance_m2, eye),
        rotation=grow(rotation, eye),
        rotation_covariance_rad2=grow(rotation_covariance, eye),
        has_rotation=grow(known.astype(float), 0.0),
        location=jnp.asarray(np.concatenate([anchors.location_index, np.full(padding, -1)])),
    )
