"""The one-time similarity from many choices of anchors at once, and whether each choice fixes the frame.

Only the markers are needed, none of the poses between them: one small program for sessions of any length.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.geometry import sim3_apply, umeyama
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.solve.fold import sqrt_information
from jaxgeo.solve.gauge import determined, gauge_covariance

# Where gravity is known: how well, rad. Only for whether the anchors fix the frame.
_TILT_RAD = 0.01


class Markers(eqx.Module):
    """Markers in the map frame, as the odometry has them, and as surveyed; all that a similarity needs.

    Attributes:
        map_m: (k, 3); `seen_m2` (k, 3, 3) covariance of what was measured, map axes.
        surveyed_m: (k, 3) local frame; `survey_m2` (k, 3, 3).
        turn_information: (k, 3, 3) of the surveyed rotations, map axes; zero where none or not wanted.
    """

    map_m: Float[Array, "k 3"]
    seen_m2: Float[Array, "k 3 3"]
    surveyed_m: Float[Array, "k 3"]
    survey_m2: Float[Array, "k 3 3"]
    turn_information: Float[Array, "k 3 3"]


def markers_of(trajectory: Trajectory, anchors: Anchors, extra_sigma_m: float, *, rotations: bool) -> Markers:
    """Padded to the anchors' bucket with points of no weight."""
    index = anchors.pose_index
    body = Rotation.from_quat(trajectory.quat_wxyz[index], scalar_first=True)
    turn = body.as_matrix()
    lever = anchors.lever_covariance_m2 + extra_sigma_m**2 * np.eye(3)
    both = np.concatenate([anchors.quat_body_marker_wxyz, anchors.quat_grid_marker_wxyz], axis=1)
    known = np.isfinite(both).all(axis=1) & rotations
    information = np.zeros((len(anchors), 3, 3))
    information[known] = np.linalg.inv(anchors.rotation_covariance_rad2[known])
    padding = anchor_bucket(len(anchors)) - len(anchors)

    def grow(rows: np.ndarray) -> Array:
        return jnp.asarray(np.concatenate([rows, np.broadcast_to(rows[-1], (padding, *rows.shape[1:]))]))

    # About the first pose: where a map frame begins says nothing, and large numbers lose digits.
    return Markers(
        grow(trajectory.position_m[index] - trajectory.position_m[0] + body.apply(anchors.lever_arm_m)),
        grow(turn @ lever @ np.swapaxes(turn, 1, 2)),
        grow(anchors.surveyed_enh_m),
        grow(anchors.survey_covariance_m2),
        grow(turn @ information @ np.swapaxes(turn, 1, 2)),
    )


def fitted_markers(
    markers: Markers, use: Float[np.ndarray, "s k"], *, scale: bool, gravity: bool, of_graph: bool
) -> tuple[Float[np.ndarray, "s k 3"], Bool[np.ndarray, "s"]]:
    """Markers after the similarity of every row, and whether its anchors fix the frame; one compiled call.

    Args:
        scale, gravity: of the similarity.
        of_graph: the frame is to be fixed for a pose graph, to which gravity is not told.
    """
    s, k = use.shape
    rows = np.pad(use, ((0, anchor_bucket(s) - s), (0, markers.map_m.shape[0] - k)))
    tilt = jnp.asarray(np.diag([1.0, 1.0, 0.0]) * (gravity and not of_graph) / _TILT_RAD**2)
    point, good = _similarities(markers, jnp.asarray(rows), tilt, scale=scale, gravity=gravity)
    return np.asarray(point)[:s, :k], np.asarray(good)[:s]


@functools.partial(jax.jit, static_argnames=("scale", "gravity"))
def _similarities(
    markers: Markers, use: Float[Array, "s k"], tilt: Float[Array, "3 3"], *, scale: bool, gravity: bool
) -> tuple[Float[Array, "s k 3"], Bool[Array, "s"]]:
    def one(row: Float[Array, "k"]) -> tuple[Float[Array, "k 3"], Bool[Array, ""]]:
        used = row > 0
        # Not a bit of a location that is not used.
        target = jnp.where(used[:, None], markers.surveyed_m, 0.0)
        fit = umeyama(markers.map_m, target, row, scale=scale, gravity=gravity).sim3
        turn, back = fit.rotation[None], fit.rotation.T[None]
        weight = sqrt_information(turn @ markers.seen_m2 @ back + markers.survey_m2)
        information = jnp.where(used[:, None, None], turn @ markers.turn_information @ back, 0.0)
        weight = jnp.where(used[:, None, None], weight, 0.0)
        sigma, direction = gauge_covariance(target, weight, information.at[0].add(tilt))
        return jax.vmap(lambda p: sim3_apply(fit, p))(markers.map_m), determined(sigma, direction)

    return jax.vmap(one)(use)
