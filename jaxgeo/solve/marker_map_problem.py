"""The joint problem of image poses and marker poses: its unknowns, and its residuals as a plain function of them.

Sightings lie in a table of images by sightings an image, padded: an image sees markers only, so that its 6x6 block is
eliminated by itself. Poses are (position, quaternion) in the map frame; an increment adds to the position and turns the
rotation from the left, as in `Sightings.covariance`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxgeo.geometry.robust import RobustKind, robust_residual, robust_rho
from jaxgeo.geometry.se3 import so3_exp, so3_log, so3_matrix, so3_multiply
from jaxgeo.solve.marker_camera import N_GLOBALS, Lens, lens_at, project

PRIOR_SIGMA = (0.05, 30.0, 30.0, 0.3, 0.3)
"""Of a refined camera: log focal scale, cx and cy [px], k1, k2; weak against hundreds of corners."""


class Frames(eqx.Module):
    """Poses in the map frame."""

    position_m: Float[Array, "n 3"]
    quat_wxyz: Float[Array, "n 4"]


class Unknowns(eqx.Module):
    """Increments: of image poses T_map_body, of marker poses T_map_marker, and of the camera."""

    image: Float[Array, "i 6"]
    marker: Float[Array, "m 6"]
    camera: Float[Array, "5"]


class MapPoint(eqx.Module):
    """Where the solver stands."""

    images: Frames
    markers: Frames
    camera: Float[Array, "5"]


class MapProblem(eqx.Module):
    """Padded: `i` images, `k` sightings an image, `m` markers.

    Attributes:
        marker: marker of each sighting (0 in the padding).
        seen: which entries of the table are sightings.
        corners_px, corners_m: observed corners, and the corners in the marker's frame.
        whiten: V with V C V^T = I of each sighting's corner covariance C (u0, v0, u1, ..).
        lens, R_cam_body, t_cam_body_m: the camera of each sighting.
        base: where increments are zero.
        free: which markers may move: not the one that the frame hangs on, nor the padding.
        refine_camera: whether the camera's five globals may move.
        width: of the robust loss, in standard deviations of one coordinate.
    """

    marker: Int[Array, "i k"]
    seen: Bool[Array, "i k"]
    corners_px: Float[Array, "i k 4 2"]
    corners_m: Float[Array, "i k 4 3"]
    whiten: Float[Array, "i k 8 8"]
    lens: Lens
    R_cam_body: Float[Array, "i k 3 3"]
    t_cam_body_m: Float[Array, "i k 3"]
    base: MapPoint
    free: Bool[Array, "m"]
    refine_camera: Bool[Array, ""]
    width: Float[Array, ""]
    loss: RobustKind = eqx.field(static=True)


def moved(frames: Frames, delta: Float[Array, "n 6"]) -> Frames:
    """Positions plus the first three, rotations turned from the left by the last three."""
    quat = so3_multiply(so3_exp(delta[:, 3:]), frames.quat_wxyz)
    return Frames(frames.position_m + delta[:, :3], quat / jnp.linalg.norm(quat, axis=1, keepdims=True))


def between(frames: Frames, base: Frames) -> Float[Array, "n 6"]:
    """The increments that take `base` to `frames`."""
    back = base.quat_wxyz * jnp.broadcast_to(jnp.array([1.0, -1.0, -1.0, -1.0]), base.quat_wxyz.shape)
    turn = so3_log(so3_multiply(frames.quat_wxyz, back))
    return jnp.concatenate([frames.position_m - base.position_m, turn], axis=1)


def point_at(y: Unknowns, problem: MapProblem) -> MapPoint:
    """Poses and camera of the increments; what is held does not move."""
    held = jnp.where(problem.free[:, None], y.marker, 0.0)
    camera = problem.base.camera + jnp.where(problem.refine_camera, y.camera, 0.0)
    return MapPoint(moved(problem.base.images, y.image), moved(problem.base.markers, held), camera)


def sighting_residual(
    image_delta: Float[Array, "6"],
    marker_delta: Float[Array, "6"],
    camera: Float[Array, "5"],
    image: tuple[Float[Array, "3"], Float[Array, "3 3"]],
    marker: tuple[Float[Array, "3"], Float[Array, "3 3"]],
    row: tuple,
) -> Float[Array, "8"]:
    """Predicted minus observed corners, whitened, of one sighting at increments of the two poses."""
    corners_px, corners_m, whiten, lens, R_cam_body, t_cam_body_m = row
    turn_image, turn_marker = so3_matrix(so3_exp(image_delta[3:])), so3_matrix(so3_exp(marker_delta[3:]))
    points = corners_m @ (turn_marker @ marker[1]).T + (marker[0] + marker_delta[:3])[None]
    in_body = (points - (image[0] + image_delta[:3])[None]) @ (turn_image @ image[1])
    in_cam = in_body @ R_cam_body.T + t_cam_body_m[None]
    changed = lens_at(lens, camera)
    predicted = jax.vmap(project, in_axes=(0, None))(in_cam, changed)
    return whiten @ (predicted - corners_px).reshape(8)


def table_rows(problem: MapProblem) -> tuple:
    """What `sighting_residual` takes as `row`, with the table's two leading axes."""
    p = problem
    return (p.corners_px, p.corners_m, p.whiten, p.lens, p.R_cam_body, p.t_cam_body_m)


def pose_parts(frames: Frames) -> tuple[Float[Array, "n 3"], Float[Array, "n 3 3"]]:
    return frames.position_m, so3_matrix(frames.quat_wxyz)


def whitened(point: MapPoint, problem: MapProblem) -> Float[Array, "i k 8"]:
    """Whitened residuals without the robust loss; zero in the padding."""
    zero = jnp.zeros(6)
    markers = jax.tree.map(lambda x: x[problem.marker], pose_parts(point.markers))

    def one(image, marker, row):
        return sighting_residual(zero, zero, point.camera, image, marker, row)

    over_sightings = jax.vmap(one, in_axes=(None, 0, 0))
    found = jax.vmap(over_sightings)(pose_parts(point.images), markers, table_rows(problem))
    return jnp.where(problem.seen[..., None], found, 0.0)


def mean_square(residual: Float[Array, "i k 8"]) -> Float[Array, "i k"]:
    """Squared residual of a sighting per coordinate: what the robust loss judges it by."""
    return jnp.sum(residual * residual, axis=-1) / 8.0


def camera_prior(camera: Float[Array, "5"], problem: MapProblem) -> Float[Array, "5"]:
    """Whitened distance of the refined camera from the calibration given; zero where it is not refined."""
    return jnp.where(problem.refine_camera, camera / jnp.array(PRIOR_SIGMA), 0.0)


def cost_at(point: MapPoint, problem: MapProblem) -> Float[Array, ""]:
    """Half the sum of the losses."""
    rho = robust_rho(mean_square(whitened(point, problem)), problem.loss, problem.width)
    return 4.0 * jnp.sum(rho) + 0.5 * jnp.sum(camera_prior(point.camera, problem) ** 2)


def residuals(y: Unknowns, problem: MapProblem) -> tuple[Float[Array, "i k 8"], Float[Array, "5"]]:
    """The residual function of the least-squares problem: half its squared norm is `cost_at`."""
    point = point_at(y, problem)
    scaled = whitened(point, problem) / jnp.sqrt(8.0)
    return jnp.sqrt(8.0) * robust_residual(scaled, problem.loss, problem.width), camera_prior(point.camera, problem)


def zero_unknowns(problem: MapProblem) -> Unknowns:
    return Unknowns(
        jnp.zeros((problem.marker.shape[0], 6)), jnp.zeros((problem.free.shape[0], 6)), jnp.zeros(N_GLOBALS)
    )
