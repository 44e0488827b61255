"""Meshes, the site and its light: closed where they should be, the same for both sessions, clear of the walks."""

import dataclasses

import numpy as np
import pytest

from jaxgeo.simulate import UAV, UGV
from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.layout import SURVEYED_ENH_M
from jaxgeo.simulate.sensors.board import SIDE_M, TEXEL_M, board_bgr, board_mesh, board_print, marker_visits
from jaxgeo.simulate.sensors.ground import MARKER_ABOVE_GROUND_M, RIPPLE_M, ground_height_m
from jaxgeo.simulate.sensors.mesh import Mesh, box, joined, placed, tapered_column
from jaxgeo.simulate.sensors.ray_casting import Scene
from jaxgeo.simulate.sensors.shadows import AMBIENT, SKYLIGHT, SUN, light, sun_map
from jaxgeo.simulate.sensors.site import site_mesh
from jaxgeo.simulate.sensors.texture import BRICK, GRASS, albedo_bgr, surface_coordinates_m, textures_of
from jaxgeo.simulate.session import simulate_session


def normals(mesh: Mesh) -> np.ndarray:
    a, b, c = mesh.vertex_m[mesh.triangle].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


@pytest.fixture(scope="module")
def site() -> Mesh:
    return site_mesh(3, leaves_a_tree=50)


def test_a_box_is_closed_and_faces_outwards():
    mesh = box([-1.0, -2.0, 0.5], [1.0, 3.0, 2.0], BRICK)
    double_area = normals(mesh)
    assert np.allclose(double_area.sum(axis=0), 0.0)
    outwards = np.sum(double_area * (mesh.vertex_m[mesh.triangle].mean(axis=1) - [0.0, 0.5, 1.25]), axis=1)
    assert (outwards > 0).all()
    assert np.linalg.norm(double_area, axis=1).sum() / 2 == pytest.approx(2 * (2 * 5 + 2 * 1.5 + 5 * 1.5))


def test_columns_face_outwards_and_moving_keeps_shapes():
    column = placed(tapered_column([0.3, 0.2, 0.1], [0.0, 1.0, 2.0], BRICK), [5.0, -2.0, 1.0], 0.7)
    middle_m = column.vertex_m[column.triangle].mean(axis=1) - [5.0, -2.0, 0.0]
    assert (np.sum(normals(column)[:, :2] * middle_m[:, :2], axis=1) > 0).all()
    both = joined([column, column])
    assert len(both) == 2 * len(column)
    assert np.array_equal(both.vertex_m[both.triangle[len(column) :]], column.vertex_m[column.triangle])


def test_the_site_is_one_for_all_sessions_of_a_seed_and_another_for_others(site):
    again = site_mesh(3, leaves_a_tree=50)
    for field in dataclasses.fields(Mesh):
        assert np.array_equal(getattr(site, field.name), getattr(again, field.name))
    assert not np.array_equal(site_mesh(4, leaves_a_tree=50).tint, site.tint)


def test_the_ground_lies_a_boards_height_below_the_surveyed_places():
    below_m = SURVEYED_ENH_M[:, 2] - ground_height_m(SURVEYED_ENH_M[:, :2])
    assert np.abs(below_m - MARKER_ABOVE_GROUND_M).max() <= RIPPLE_M + 1e-9


@pytest.mark.parametrize("layout", [UAV, UGV], ids=lambda layout: layout.name)
def test_nothing_stands_in_the_way(site, layout):
    """From pose to pose, and from where the rig stands to the marker, rays meet nothing."""
    scene = Scene(site)
    course = course_of(layout)
    at_m = course.pose.translation[::10]
    hits = scene.cast(at_m[:-1].astype(np.float32), np.diff(at_m, axis=0).astype(np.float32))
    assert (hits.t > 1.0).all()
    down = np.tile(np.float32([[0, 0, -1]]), (len(at_m), 1))
    assert scene.cast(at_m.astype(np.float32), down).t.min() > 0.5
    for visit in marker_visits(simulate_session(3, layout, drift={})):
        stand_m = course.walk.pose(np.linspace(visit.arrive_s, visit.leave_s, 15)).translation
        to = visit.T_local_marker.translation - stand_m
        assert (scene.cast(stand_m.astype(np.float32), to.astype(np.float32)).t > 1.0).all()


def test_the_board_faces_the_rig_upright_with_the_marker_on_its_front():
    session = simulate_session(0, UGV, drift={})
    visits = marker_visits(session)
    assert tuple(visit.location for visit in visits) == UGV.order
    for visit in visits:
        pose = visit.T_local_marker
        assert np.allclose(pose.translation, session.marker_enh_m[visit.location])
        _, up, out = pose.rotation.as_matrix().T
        assert np.allclose(up, [0, 0, 1])
        rig_m = course_of(UGV).walk.pose(np.array([(visit.arrive_s + visit.leave_s) / 2])).translation[0]
        towards = (rig_m - pose.translation)[:2]
        assert out[:2] @ towards / np.linalg.norm(towards) > 0.99
        front = Scene(board_mesh(pose)).cast(
            rig_m.astype(np.float32), (pose.translation - rig_m)[None].astype(np.float32)
        )
        assert front.t[0] == pytest.approx(1.0, abs=1e-4)


def test_the_sun_lights_what_nothing_shades():
    """A plate 2 m above the ground: its shadow lies where the sun's rays through it meet the ground."""
    ground, plate = box([-6, -6, -1], [6, 6, 0], GRASS), box([-0.5, -0.5, 2.0], [0.5, 0.5, 2.1], BRICK)
    sun = sun_map(Scene(joined([ground, plate])))
    shaded = np.array([0.0, 0.0, 2.0]) - 2.0 * SUN / SUN[2]
    points_m = np.array([shaded, [4.0, 4.0, 0.0], shaded + np.array([1.5, 0.0, 0.0])])
    brightness = light(sun, points_m, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert brightness[0] == pytest.approx(AMBIENT + SKYLIGHT)
    assert (brightness[1:] > brightness[0] + 0.3).all()


def test_colours_belong_to_places_and_calm_down_with_distance():
    textures = textures_of(0)
    random = np.random.default_rng(0)
    points_m = np.column_stack([random.uniform(0, 30, 4000), np.zeros(4000), random.uniform(0, 9, 4000)])
    wall, brick = np.tile([0.0, -1.0, 0.0], (4000, 1)), np.full(4000, BRICK, np.uint8)
    near = albedo_bgr(textures, points_m, wall, brick, np.full(4000, 0.005))
    assert np.array_equal(near, albedo_bgr(textures, points_m, wall, brick, np.full(4000, 0.005)))
    far = albedo_bgr(textures, points_m, wall, brick, np.full(4000, 1.0))
    assert (far.std(axis=0) < 0.7 * near.std(axis=0)).all()
    assert np.allclose(far.mean(axis=0), near.mean(axis=0), rtol=0.05)


def test_coordinates_on_surfaces_keep_lengths():
    """Two points of a wall, whichever way it faces, are as far apart on it as in space."""
    random = np.random.default_rng(1)
    for yaw in random.uniform(0, 2 * np.pi, 5):
        normal = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        along = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        points_m = random.uniform(-5, 5, (6, 1)) * along + random.uniform(0, 5, (6, 1)) * [0, 0, 1] + 3 * normal
        on = surface_coordinates_m(points_m, np.tile(normal, (6, 1)))
        assert np.allclose(np.diff(on, axis=0) ** 2 @ [1, 1], np.sum(np.diff(points_m, axis=0) ** 2, axis=1))


def test_the_print_hangs_upright_on_the_board():
    visit = marker_visits(simulate_session(0, UGV, drift={}))[0]
    half, texel_m = SIDE_M / 2, TEXEL_M / 2
    corners_m = [[-half + texel_m, half - texel_m, 0], [half - texel_m, half - texel_m, 0], [0.0, -half + texel_m, 0]]
    colours = board_bgr(0, visit, visit.T_local_marker.apply(np.array(corners_m)))
    printed = board_print(0, visit.location)
    middle = printed.shape[1] // 2
    expected = [printed[0, 0], printed[0, -1], printed[-1, middle - 1 : middle + 1].mean(axis=0)]
    assert np.allclose(colours, expected, atol=0.5)
