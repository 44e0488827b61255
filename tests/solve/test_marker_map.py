"""Marker maps: against the truth, SciPy, Monte Carlo; wrong corners, flips, and what cannot be mapped."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import project as project_opencv
from jaxgeo.associate.planar import UNIT_CORNERS
from jaxgeo.data import Camera, CornerSightings
from jaxgeo.errors import SightingError, UndeterminedError
from jaxgeo.solve.marker_camera import Lens, lens_parts, project
from jaxgeo.solve.marker_map import _problem, build_marker_map
from jaxgeo.solve.marker_map_inputs import MapSettings, map_inputs
from jaxgeo.solve.marker_map_problem import cost_at, point_at, zero_unknowns
from jaxgeo.solve.marker_map_start import starting_poses
from jaxgeo.solve.marker_map_step import linearise, reduced_system
from tests.solve.marker_room import N_IMAGES, SIDE_M, room_rig, sighted

PLAIN = MapSettings(loss="none", floor_px=0.0, origin="m0")
NOISE_PX = 0.3


def rows_of(corners: CornerSightings, rows: np.ndarray) -> CornerSightings:
    return CornerSightings(
        corners.stamp_s[rows],
        corners.camera[rows],
        corners.marker[rows],
        corners.corners_px[rows],
        corners.source[rows],
    )


def pose_errors(found, truth) -> np.ndarray:
    """(m, 6) position off, and rotation off on the left."""
    R = Rotation.from_quat(found.quat_wxyz, scalar_first=True)
    return np.column_stack([found.position_m - truth[1], (R * truth[0].inv()).as_rotvec()])


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("none", ()), ("radtan", (-0.2, 0.05, 1e-3, -2e-3, 0.01)), ("equidistant", (0.02, -0.01, 3e-3, 1e-3))],
)
def test_projection_is_opencvs(model, distortion):
    camera = Camera(
        np.array([700.0, 650.0, 400.0, 300.0]), model, np.array(distortion), None, np.zeros(3), np.eye(4)[0]
    )
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 1.0], [0.5, 0.4, 3.0], (50, 3))
    points[0, :2] = 0.0
    lens = Lens(*(jnp.asarray(part) for part in lens_parts(camera)))
    expected, by_point, _ = project_opencv(points, camera)
    found = jax.vmap(project, in_axes=(0, None))(jnp.asarray(points), lens)
    derivative = jax.vmap(jax.jacfwd(project), in_axes=(0, None))(jnp.asarray(points), lens)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(derivative, by_point, atol=1e-6)


@pytest.mark.parametrize(("model", "distortion"), [("equidistant", (0.01, 0.0, 0.0, 0.0))])
def test_exact_corners_give_the_true_map(model, distortion):
    rig = room_rig(model, distortion)
    corners, markers, bodies = sighted(rig)
    found = build_marker_map(corners, rig, SIDE_M, settings=PLAIN)
    assert np.abs(pose_errors(found, markers)).max() < 1e-7
    np.testing.assert_allclose(found.image_position_m, bodies[1], atol=1e-7)
    turned = (Rotation.from_quat(found.image_quat_wxyz, scalar_first=True) * bodies[0].inv()).magnitude()
    assert turned.max() < 1e-7
    assert not found.covariance[0].any()


def scipy_map(corners: CornerSightings, rig, found) -> tuple[np.ndarray, np.ndarray, float]:
    """Marker poses, their covariance at one pixel's sigma and the cost by SciPy, started beside our optimum."""
    camera = rig.cameras["cam0"]
    names = list(found.marker)
    row = np.array([names.index(name) for name in corners.marker])
    image = np.searchsorted(found.stamp_s, corners.stamp_s)
    corners_m = np.column_stack([SIDE_M * UNIT_CORNERS, np.zeros(4)])
    R_body_cam = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True)
    free = len(names) - 1
    R0 = Rotation.from_quat(np.concatenate([found.quat_wxyz[1:], found.image_quat_wxyz]), scalar_first=True)
    t0 = np.concatenate([found.position_m[1:], found.image_position_m])

    def residual(x):
        delta = x.reshape(-1, 6)
        R, t = Rotation.from_rotvec(delta[:, 3:]) * R0, t0 + delta[:, :3]
        R_m = Rotation.concatenate([Rotation.identity(1), R[:free]])
        t_m, R_b, t_b = np.concatenate([np.zeros((1, 3)), t[:free]]), R[free:], t[free:]
        out = []
        for s in range(len(row)):
            in_map = R_m[row[s]].apply(corners_m) + t_m[row[s]]
            in_body = R_b[image[s]].inv().apply(in_map - t_b[image[s]])
            in_cam = R_body_cam.inv().apply(in_body - camera.t_body_cam_m)
            out.append(project_opencv(in_cam, camera)[0] - corners.corners_px[s])
        return np.array(out).ravel() / NOISE_PX

    start = 1e-4 * np.random.default_rng(1).standard_normal(6 * len(t0))
    solved = least_squares(residual, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=6)
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)
    return solved.x.reshape(-1, 6)[:free], covariance[: 6 * free, : 6 * free], solved.cost


def test_optimum_and_covariance_are_scipys():
    rig = room_rig("radtan", (-0.1, 0.02, 1e-3, 0.0))
    corners, _, _ = sighted(rig, NOISE_PX)
    found = build_marker_map(corners, rig, SIDE_M, NOISE_PX, PLAIN)
    away, covariance, cost = scipy_map(corners, rig, found)
    factor = found.sigma_factor
    assert np.abs(away).max() < 1e-6
    assert found.chi2 * factor**2 == pytest.approx(2.0 * cost, rel=1e-7)
    blocks = covariance.reshape(4, 6, 4, 6)[np.arange(4), :, np.arange(4), :]
    scale = np.sqrt(np.einsum("mii->mi", blocks))
    ratio = (found.covariance[1:] / factor**2 - blocks) / scale[:, :, None] / scale[:, None]
    assert np.abs(ratio).max() < 1e-4


def test_covariance_is_what_repetitions_scatter():
    rig = room_rig()
    errors, factors, chi2 = [], [], []
    for seed in range(16):
        corners, markers, _ = sighted(rig, 0.0)
        noise = NOISE_PX * np.random.default_rng(100 + seed).standard_normal(corners.corners_px.shape)
        corners = eqx.tree_at(lambda c: c.corners_px, corners, corners.corners_px + noise)
        found = build_marker_map(corners, rig, SIDE_M, NOISE_PX, PLAIN)
        off = pose_errors(found, markers)[1:]
        errors.append(np.einsum("mi,mij,mj->m", off, np.linalg.inv(found.covariance[1:]), off))
        factors.append(found.sigma_factor)
        chi2.append(found.chi2 * found.sigma_factor**2 / found.dof)
    # 16 x 4 squared errors of 6 degrees of freedom each; markers of one map are correlated
    assert 4.5 < np.mean(errors) < 7.7
    assert np.mean(factors) == pytest.approx(1.0, abs=0.05)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.05)


def test_gradient_of_the_cost_is_finite_differences():
    rig = room_rig("radtan", (-0.1, 0.02, 0.0, 0.0))
    corners, _, _ = sighted(rig, NOISE_PX)
    settings = MapSettings(refine_camera=True, width=1.0)
    inputs = map_inputs(corners, rig, SIDE_M, NOISE_PX, settings)
    images, markers = starting_poses(inputs.candidates, N_IMAGES, 5, inputs.origin)
    problem = _problem(inputs, images, markers, np.array([1e-3, 1.0, -1.0, 0.01, 0.02]), 1.0, settings)
    y = zero_unknowns(problem)
    cost = jax.jit(lambda y: cost_at(point_at(y, problem), problem))
    by = jax.jit(jax.grad(cost))(y)
    forces = jax.jit(lambda: reduced_system(linearise(problem.base, problem), problem.base, problem, jnp.zeros(())))
    np.testing.assert_allclose(-forces().image_right, by.image, rtol=1e-8, atol=1e-7)
    # The other forces are eliminated already: differences of the cost along a direction instead.
    direction = jax.tree.map(lambda x: jnp.asarray(np.random.default_rng(3).standard_normal(x.shape)), y)
    ahead, behind = (cost(jax.tree.map(lambda d: step * d, direction)) for step in (1e-7, -1e-7))  # noqa: B023
    slope = sum(float(jnp.sum(a * b)) for a, b in zip(jax.tree.leaves(by), jax.tree.leaves(direction), strict=True))
    assert float(ahead - behind) / 2e-7 == pytest.approx(slope, rel=1e-5)


def test_one_wrong_sighting_is_reported_and_does_little():
    rig = room_rig()
    corners, markers, _ = sighted(rig, 0.1)
    wrong = int(np.flatnonzero(corners.marker == "m2")[1])
    corners.corners_px[wrong] += [25.0, -12.0]
    found = build_marker_map(corners, rig, SIDE_M, 0.1, MapSettings(origin="m0"))
    assert found.outliers.tolist() == [wrong]
    assert np.linalg.norm(pose_errors(found, markers)[:, :3], axis=1).max() < 0.02


def test_the_camera_is_found_with_the_map():
    rig = room_rig("radtan", (-0.15, 0.05, 0.0, 0.0))
    corners, _, _ = sighted(rig, 0.05)
    given = room_rig()
    found = build_marker_map(corners, given, SIDE_M, 0.05, MapSettings(origin="m0", floor_px=0.0, refine_camera=True))
    plain = build_marker_map(corners, given, SIDE_M, 0.05, MapSettings(origin="m0", floor_px=0.0))
    off = np.abs(found.camera - [0.0, 0.0, 0.0, -0.15, 0.05]) / found.camera_sigma
    assert off.max() < 4.0
    assert np.median(found.corner_error_px) < 0.5 * np.median(plain.corner_error_px)


def test_frame_does_not_matter():
    rig = room_rig()
    corners, _, _ = sighted(rig, NOISE_PX)
    first = build_marker_map(corners, rig, SIDE_M, NOISE_PX, PLAIN)
    other = build_marker_map(corners, rig, SIDE_M, NOISE_PX, eqx.tree_at(lambda s: s.origin, PLAIN, "m3"))
    gaps = [np.linalg.norm(m.position_m[:, None] - m.position_m[None], axis=2) for m in (first, other)]
    np.testing.assert_allclose(*gaps, atol=1e-6)
    assert first.cost == pytest.approx(other.cost, rel=1e-6)


def test_what_cannot_be_mapped():
    rig = room_rig()
    corners, _, _ = sighted(rig)
    with pytest.raises(UndeterminedError, match="only marker 'm1' was seen"):
        build_marker_map(rows_of(corners, np.flatnonzero(corners.marker == "m1")), rig, SIDE_M)
    early = np.isin(corners.marker, ["m0", "m1"]) & (corners.stamp_s < 5)
    late = np.isin(corners.marker, ["m2", "m3", "m4"]) & (corners.stamp_s >= 5)
    with pytest.raises(UndeterminedError, match=r"2 groups that no image links.*m2, m3, m4.*m0, m1"):
        build_marker_map(rows_of(corners, np.flatnonzero(early | late)), rig, SIDE_M)
    with pytest.raises(SightingError, match=r"room.csv:2 and room.csv:2: marker 'm\d' is seen twice"):
        build_marker_map(rows_of(corners, np.array([0, 0, 1])), rig, SIDE_M)
    with pytest.raises(SightingError, match="origin 'x' is not among"):
        build_marker_map(corners, rig, SIDE_M, settings=MapSettings(origin="x"))
    with pytest.raises(SightingError, match="marker side is 0"):
        build_marker_map(corners, rig, 0.0)
