"""Surfaces from RGB-D frames of a room whose walls are known."""

import numpy as np
import pytest
from rgbd_room import body_pose, looking, off_walls_m, photograph, pinhole, walls

from jaxgeo.errors import CloudError, InputError
from jaxgeo.mapping.fusion_open3d import Mesh, TsdfVolume, mesh_distance, write_mesh

o3d = pytest.importorskip("open3d")
WALLS = walls(0)
POSES = [looking((0.1 * row - 0.2, 0.0, 0.0), 0.15 * row) for row in range(4)]


def volume_of(camera, offset_m=(0.0, 0.0, 0.0), voxel_m=0.04) -> TsdfVolume:
    volume = TsdfVolume(camera, voxel_m)
    for row, T in enumerate(POSES):
        T_map_body = body_pose(T, camera)
        T_map_body[:3, 3] += offset_m
        volume.add(photograph(WALLS, T, camera, float(row)), T_map_body)
    return volume


@pytest.fixture(scope="module")
def volume() -> TsdfVolume:
    return volume_of(pinhole((0.1, 0.0, 0.2), (0.0, 0.3, 0.0)))


@pytest.fixture(scope="module")
def mesh(volume) -> Mesh:
    return volume.mesh()


def test_the_surface_lies_on_the_walls_and_faces_the_cameras(mesh):
    assert len(mesh.triangles) > 1000
    assert np.median(off_walls_m(mesh.vertices_m)) < 0.002
    assert np.percentile(off_walls_m(mesh.vertices_m), 95) < 0.02
    a, b, c = (mesh.vertices_m[mesh.triangles[:, corner]] for corner in range(3))
    inward = np.sum(np.cross(b - a, c - a) * (POSES[0][:3, 3] - a), axis=1)
    assert np.mean(inward > 0) > 0.99


def test_its_colours_are_those_of_the_walls(mesh):
    far = np.abs(mesh.vertices_m[:, 0] - 2.0) < 0.01  # the wall towards x; its texture is indexed by (z, y)
    u, v = ((mesh.vertices_m[far][:, 1:] + [1.6, 1.3]) * 140.0).astype(int).T
    texture = WALLS[1][..., ::-1].astype(float)
    inside = (u < texture.shape[1]) & (v < texture.shape[0])
    assert inside.sum() > 300
    own = mesh.colour[far][inside].astype(float)
    there = texture[v[inside], u[inside]]
    assert np.corrcoef(own.ravel(), there.ravel())[0, 1] > 0.7


def test_a_lens_is_taken_out():
    mesh = volume_of(pinhole(model="radtan", distortion=(-0.25, 0.08, 0.001, -0.001))).mesh()
    assert np.median(off_walls_m(mesh.vertices_m)) < 0.0015
    assert np.percentile(off_walls_m(mesh.vertices_m), 95) < 0.005


def test_far_from_the_origin_it_is_the_same(mesh):
    offset = np.array([70_000.0, -20_000.0, 300.0])
    away = volume_of(pinhole((0.1, 0.0, 0.2), (0.0, 0.3, 0.0)), offset).mesh()
    assert len(away.vertices_m) == pytest.approx(len(mesh.vertices_m), rel=0.1)
    assert np.median(off_walls_m(away.vertices_m - offset)) < 0.002


def test_surfaces_seen_too_rarely_are_refused(volume):
    points, colour = volume.points(min_frames=4)
    assert np.median(off_walls_m(points)) < 0.004
    assert colour.shape == points.shape
    assert len(volume.points(min_frames=1)[0]) > len(points)
    with pytest.raises(CloudError, match="seen by 5 frames"):
        volume.mesh(min_frames=5)
    with pytest.raises(CloudError, match="seen by 3 frames"):
        TsdfVolume(pinhole()).points()


AWAY_M = np.array([5000.0, 0.0, 0.0])
SQUARE = Mesh(
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]) + AWAY_M,
    np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]], dtype=np.uint8),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


def test_distances_to_triangles():
    points = np.array([[0.5, 0.2, 3.0], [2.0, 0.5, 1.0], [0.3, 0.3, 1.0], [-3.0, 0.5, 5.0]]) + AWAY_M
    np.testing.assert_allclose(mesh_distance(points, SQUARE), [2.0, 1.0, 0.0, 5.0], atol=1e-6)


def test_a_written_mesh_is_read_back_and_a_failed_one_leaves_nothing(tmp_path):
    write_mesh(tmp_path / "mesh.ply", SQUARE)
    back = o3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    np.testing.assert_array_equal(np.asarray(back.vertices), SQUARE.vertices_m)
    np.testing.assert_array_equal(np.asarray(back.triangles), SQUARE.triangles)
    np.testing.assert_allclose(np.asarray(back.vertex_colors) * 255, SQUARE.colour, atol=0.5)
    with pytest.raises(InputError, match=r"mesh.txt: expected a mesh file: .ply"):
        write_mesh(tmp_path / "mesh.txt", SQUARE)
    with pytest.raises(InputError, match="cannot write into"):
        write_mesh(tmp_path / "nowhere" / "mesh.ply", SQUARE)
    assert [file.name for file in tmp_path.iterdir()] == ["mesh.ply"]
