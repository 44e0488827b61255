"""A map of markers from photographs alone: no survey, no odometry, only who was seen with whom, and where in the image.

Start (`marker_map_start`), joint least squares of all image and marker poses on the corners (`marker_map_problem`,
`marker_map_step`), flips tried again, and the common factor on the corners' sigmas that makes the residuals honest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxgeo.data import CornerSightings, Rig
from jaxgeo.errors import ConvergenceError, UndeterminedError
from jaxgeo.geometry.robust import check_robust, robust_weight
from jaxgeo.graph.bucket import anchor_bucket, pose_bucket
from jaxgeo.solve.marker_camera import N_GLOBALS, Lens
from jaxgeo.solve.marker_map_flips import flipped, flips
from jaxgeo.solve.marker_map_inputs import MapInputs, MapSettings, map_inputs
from jaxgeo.solve.marker_map_problem import (
    Frames,
    MapPoint,
    MapProblem,
    mean_square,
    residuals,
    whitened,
    zero_unknowns,
)
from jaxgeo.solve.marker_map_start import (
    Poses,
    sighting_error_px,
    starting_poses,
)
from jaxgeo.solve.marker_map_step import CHUNK, MarkerMapLM, linearise, reduced_system, solve_reduced
from jaxgeo.solve.solver import result_words, succeeded

_SOLVER = MarkerMapLM()
_MOST_FLIPS = 12  # joint solves of one round; the likeliest are first in line
_SMALLEST_FACTOR = 1e-3  # exact corners: below this the cost is rounding
_SIGMA_ROUNDS = 8
_OUTLIER_WEIGHT = 0.5  # a sighting that the robust loss counts less than this is reported as an outlier


class MarkerMap(eqx.Module):
    """A solved map; its frame is the marker `origin` (x right, y up, z out of the printed face).

    Attributes:
        marker: (m,) ids; origin: one of them.
        position_m, quat_wxyz: T_map_marker.
        covariance: (m, 6, 6) of the marker poses relative to the origin (position added, rotation on the left),
            times sigma_factor^2; zero for the origin.
        stamp_s: (i,) images; image_position_m, image_quat_wxyz: T_map_body.
        sighting_image, sighting_marker, source: (s,) of each sighting.
        residual_px: (s, 4, 2) predicted minus observed.
        weight: (s,) of the robust loss; outliers are below 0.5.
        sigma_factor: what the corners' sigmas are multiplied by so that the median residual is as expected.
        chi2, dof: of the weighted residuals after the factor, and observations less unknowns.
        camera_name: the one that is refined; empty where none is.
        camera, camera_sigma: change of log focal scale, cx, cy [px], k1, k2, and sigmas; zero where not refined.
        cost, steps: of the last joint solve.
    """

    marker: np.ndarray
    origin: str
    position_m: Float[np.ndarray, "m 3"]
    quat_wxyz: Float[np.ndarray, "m 4"]
    covariance: Float[np.ndarray, "m 6 6"]
    stamp_s: Float[np.ndarray, "i"]
    image_position_m: Float[np.ndarray, "i 3"]
    image_quat_wxyz: Float[np.ndarray, "i 4"]
    sighting_image: Int[np.ndarray, "s"]
    sighting_marker: Int[np.ndarray, "s"]
    source: np.ndarray
    residual_px: Float[np.ndarray, "s 4 2"]
    weight: Float[np.ndarray, "s"]
    sigma_factor: float
    chi2: float
    dof: int
    camera_name: str
    camera: Float[np.ndarray, "5"]
    camera_sigma: Float[np.ndarray, "5"]
    cost: float
    steps: int

    @property
    def corner_error_px(self) -> Float[np.ndarray, "s 4"]:
        """Distance of each predicted corner from the observed one."""
        return np.linalg.norm(self.residual_px, axis=2)

    @property
    def outliers(self) -> Int[np.ndarray, "o"]:
        """Sightings that the robust loss counts less than half."""
        return np.flatnonzero(self.weight < _OUTLIER_WEIGHT)


def build_marker_map(
    corners: CornerSightings,
    rig: Rig,
    side_m: float,
    pixel_sigma_px: float = 0.3,
    settings: MapSettings = MapSettings(),  # noqa: B008  (immutable)
) -> MarkerMap:
    """Map all markers of the sightings in the frame of one of them.

    Args:
        side_m: side length of all markers.
        pixel_sigma_px: of each corner coordinate where `corners` have no covariance.

    Raises:
        SightingError: no usable sightings, a camera that the rig lacks, an id seen twice in one image, too many
            markers, an origin that was not seen, or a side that is not positive.
        ConfigError: an unknown loss.
        UndeterminedError: one marker only, or groups of markers that no image links.
        ConvergenceError: the joint solve did not converge.
    """
    check_robust(settings.loss, settings.width)
    inputs = map_inputs(corners, rig, side_m, pixel_sigma_px, settings)
    c = inputs.candidates
    images, markers = starting_poses(c, len(inputs.stamp_s), len(inputs.marker), inputs.origin)
    camera, steps = np.zeros(N_GLOBALS), 0
    factor = max(1.0, _typical_factor(inputs, images, markers))
    for _ in range(_SIGMA_ROUNDS):
        problem = _problem(inputs, images, markers, camera, factor, settings)
        solved = _solve(problem, settings.max_steps)
        residual = np.asarray(whitened(solved.point, problem))[inputs.slot[0], inputs.slot[1]]
        found = factor * _sigma_factor(residual, _n_unknowns(inputs, settings))
        stands, fell = abs(np.log(found / factor)) < 0.02 or factor == _SMALLEST_FACTOR, False
        if stands:
            solved, fell = _with_flips(solved, problem, inputs, settings)
        steps += int(solved.steps)
        (images, markers), camera = _poses(solved.point, inputs), np.asarray(solved.point.camera)
        if stands and not fell:
            break
        factor = max(found, _SMALLEST_FACTOR)
    if not bool(succeeded(solved.result)):
        raise ConvergenceError(
            f"the marker map did not converge: {result_words(solved.result)} after {steps} steps (at most "
            f"{settings.max_steps} a solve) at cost {float(solved.cost):.6g}. Check the side length, the intrinsics "
            "and ids that two markers share."
        )
    return _marker_map(inputs, solved.point, problem, factor, float(solved.cost), steps, settings)


def _n_unknowns(inputs: MapInputs, settings: MapSettings) -> int:
    return 6 * (len(inputs.stamp_s) + len(inputs.marker) - 1) + N_GLOBALS * settings.refine_camera


def _sigma_factor(residual: Float[np.ndarray, "s 8"], unknowns: int) -> float:
    """Root of the median squared residual of a sighting over what it should be, unknowns spread evenly."""
    degrees = 8.0 * max(1.0 - unknowns / residual.size, 0.05)
    return float(np.sqrt(np.median(np.sum(residual**2, axis=1)) / chi2.median(degrees)))


def _typical_factor(inputs: MapInputs, images: Poses, markers: Poses) -> float:
    """How many sigmas the start is off: the robust loss must not take everything for an outlier."""
    c = inputs.candidates
    rows = np.arange(len(c.image))
    body, marker = Poses(images.R[c.image], images.t[c.image]), Poses(markers.R[c.marker], markers.t[c.marker])
    sigma = np.sqrt(np.trace(inputs.covariance_px2, axis1=1, axis2=2) / 8.0)
    return float(np.median(sighting_error_px(c, rows, body, marker) / sigma))


def _problem(
    inputs: MapInputs, images: Poses, markers: Poses, camera: np.ndarray, factor: float, settings: MapSettings
) -> MapProblem:
    """The padded problem with the poses as its base."""
    n = len(inputs.stamp_s)
    i, k = CHUNK * -(-n // CHUNK) if n <= 4 * CHUNK else pose_bucket(n), 4 * (int(inputs.slot[1].max()) // 4 + 1)
    m = anchor_bucket(len(inputs.marker))
    c, slot = inputs.candidates, tuple(inputs.slot)

    def table(values: np.ndarray, fill: float) -> Array:
        full = np.full((i, k, *values.shape[1:]), fill, dtype=values.dtype)
        full[slot] = values
        return jnp.asarray(full)

    whiten = np.linalg.inv(np.linalg.cholesky(inputs.covariance_px2)) / factor
    free = np.arange(m) < len(inputs.marker)
    free[inputs.origin] = False
    return MapProblem(
        marker=table(c.marker, 0),
        seen=table(np.ones(len(c.marker), dtype=bool), False),
        corners_px=table(inputs.corners.corners_px, 0.0),
        corners_m=table(c.corners_m, 0.0),
        whiten=table(whiten, 0.0),
        lens=Lens(table(inputs.intrinsics_px, 0.0), table(inputs.distortion, 0.0), table(inputs.fisheye, False)),
        R_cam_body=table(c.R_cam_body, 0.0),
        t_cam_body_m=table(c.t_cam_body_m, 1.0),
        base=MapPoint(_frames(images, i), _frames(markers, m), jnp.asarray(camera)),
        free=jnp.asarray(free),
        refine_camera=jnp.asarray(settings.refine_camera),
        width=jnp.asarray(settings.width),
        loss=settings.loss,
    )


def _frames(poses: Poses, n: int) -> Frames:
    position, quat = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    position[: len(poses.t)] = poses.t
    quat[: len(poses.t)] = Rotation.from_matrix(poses.R).as_quat(scalar_first=True)
    return Frames(jnp.asarray(position), jnp.asarray(quat))


def _numpy_poses(frames: Frames) -> Poses:
    rotation = Rotation.from_quat(np.asarray(frames.quat_wxyz), scalar_first=True)
    return Poses(rotation.as_matrix(), np.array(frames.position_m))


def _trimmed(images: Poses, markers: Poses, inputs: MapInputs) -> tuple[Poses, Poses]:
    """Without the padding."""
    i, m = len(inputs.stamp_s), len(inputs.marker)
    return Poses(images.R[:i], images.t[:i]), Poses(markers.R[:m], markers.t[:m])


class _Solved(NamedTuple):
    """A joint solve: where it ended, half the sum of the losses, trial steps, result code."""

    point: MapPoint
    cost: Array
    steps: Array
    result: optx.RESULTS


@eqx.filter_jit
def _solve(problem: MapProblem, max_steps: int) -> _Solved:
    found = optx.least_squares(residuals, _SOLVER, zero_unknowns(problem), problem, max_steps=max_steps, throw=False)
    return _Solved(found.state.point, found.state.cost, found.stats["num_steps"], found.result)


def _with_flips(found: _Solved, problem: MapProblem, inputs: MapInputs, settings: MapSettings) -> tuple[_Solved, bool]:
    """Joint solves from the likeliest other minima of single poses, kept where the cost falls; and whether it fell."""
    fell = False
    for tried in flips(inputs.candidates, *_poses(found.point, inputs), inputs.origin)[:_MOST_FLIPS]:
        images, markers = flipped(tried, *_poses(found.point, inputs))
        base = MapPoint(
            _frames(images, problem.marker.shape[0]), _frames(markers, problem.free.shape[0]), found.point.camera
        )
        retried = _solve(eqx.tree_at(lambda p: p.base, problem, base), settings.max_steps)
        steps = found.steps + retried.steps
        if float(retried.cost) < float(found.cost) * (1.0 - 1e-6):
            found, fell = retried, True
        found = found._replace(steps=steps)
    return found, fell


def _poses(point: MapPoint, inputs: MapInputs) -> tuple[Poses, Poses]:
    """Of images and markers, without the padding."""
    return _trimmed(_numpy_poses(point.images), _numpy_poses(point.markers), inputs)


@eqx.filter_jit
def _covariances(point: MapPoint, problem: MapProblem) -> tuple[Float[Array, "m 6 6"], Float[Array, "5"]]:
    """Blocks of the inverse of the reduced system: marker poses, and variances of the camera's globals."""
    reduced = reduced_system(linearise(point, problem), point, problem, jnp.zeros(()))
    inverse = solve_reduced(reduced, jnp.eye(reduced.right.shape[0]))
    m = problem.free.shape[0]
    index = jnp.arange(m)
    blocks = inverse[: 6 * m, : 6 * m].reshape(m, 6, m, 6)[index, :, index, :]
    return jnp.where(problem.free[:, None, None], blocks, 0.0), jnp.diagonal(inverse)[6 * m :]


def _marker_map(
    inputs: MapInputs,
    point: MapPoint,
    problem: MapProblem,
    factor: float,
    cost: float,
    steps: int,
    settings: MapSettings,
) -> MarkerMap:
    covariance, camera_variance = _covariances(point, problem)
    i, m = len(inputs.stamp_s), len(inputs.marker)
    if not bool(jnp.all(jnp.isfinite(covariance[:m]))):
        raise UndeterminedError(
            "the sightings leave a marker's pose free: its normal matrix is singular. Are its corners on one line?"
        )
    slot: Sequence[np.ndarray] = tuple(inputs.slot)
    residual = whitened(point, problem)
    weight = robust_weight(mean_square(residual), problem.loss, problem.width)
    white = np.asarray(residual)[slot]
    weights = np.asarray(weight)[slot]
    residual_px = np.linalg.solve(np.asarray(problem.whiten)[slot], white[..., None])[..., 0]
    refined = settings.refine_camera
    return MarkerMap(
        marker=inputs.marker,
        origin=str(inputs.marker[inputs.origin]),
        position_m=np.array(point.markers.position_m)[:m],
        quat_wxyz=np.array(point.markers.quat_wxyz)[:m],
        covariance=np.array(covariance)[:m],
        stamp_s=inputs.stamp_s,
        image_position_m=np.array(point.images.position_m)[:i],
        image_quat_wxyz=np.array(point.images.quat_wxyz)[:i],
        sighting_image=inputs.slot[0],
        sighting_marker=inputs.candidates.marker,
        source=inputs.corners.source,
        residual_px=residual_px.reshape(-1, 4, 2),
        weight=weights,
        sigma_factor=factor,
        chi2=float(np.sum(weights[:, None] * white**2)),
        dof=white.size - _n_unknowns(inputs, settings),
        camera_name=str(inputs.corners.camera[0]) if refined else "",
        camera=np.array(point.camera),
        camera_sigma=np.sqrt(np.asarray(camera_variance)) * refined,
        cost=cost,
        steps=steps,
    )
