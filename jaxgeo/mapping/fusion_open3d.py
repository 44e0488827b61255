"""RGB-D frames fused into a surface: a truncated signed distance field (extra `cloud`). Open3D lives here.

Curless, Levoy, "A volumetric method for building complex models from range images", SIGGRAPH 1996; sparse blocks:
Niessner, Zollhoefer, Izadi, Stamminger, "Real-time 3D reconstruction at scale using voxel hashing", 2013.
"""

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from jaxgeo.associate.camera_model import project
from jaxgeo.data import RgbdFrame
from jaxgeo.errors import CloudError, InputError
from jaxgeo.geometry import rigid
from jaxgeo.io.atomic import atomic_path
from jaxgeo.mapping.depth_gates import DepthGates, gated_depth
from jaxgeo.mapping.rgbd_camera import RgbdCamera

MESH_SUFFIXES = (".ply", ".obj", ".glb", ".stl")
_BLOCK = 16  # voxels along the edge of a block
_TRUNCATION = 6.0  # voxels to either side of a surface
_OUTSIDE_PX = -1e4  # where there is no image


@dataclasses.dataclass(frozen=True)
class Mesh:
    """A triangle mesh in the map frame.

    Attributes:
        vertices_m: (n, 3).
        colour: (n, 3) RGB of the vertices.
        triangles: (m, 3) rows of vertices, anticlockwise as seen from the side the cameras were on.
    """

    vertices_m: Float[np.ndarray, "n 3"]
    colour: UInt8[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]


class TsdfVolume:
    """Signed distances to the surface along the rays of all frames, averaged in voxels near it; on the CPU.

    Single precision: distances count from the first camera, rounded to metres, and the origin is added to the results.
    Memory goes with the surface, some 50 kB a block of 16^3 voxels.

    Raises:
        InputError: Open3D is not installed.
    """

    def __init__(self, camera: RgbdCamera, voxel_m: float = 0.02, gates: DepthGates | None = None):
        if not voxel_m > 0.0:
            raise CloudError(f"surface: voxels of {voxel_m} m; expected an edge above 0 m.")
        self._o3d = _open3d()
        core = self._o3d.core
        self.camera, self.voxel_m, self.gates = camera, voxel_m, gates or DepthGates()
        self._origin_m: np.ndarray | None = None
        self._grid = self._o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"),
            (core.float32, core.uint16, core.uint16),
            ((1), (1), (3)),
            voxel_m,
            _BLOCK,
            10_000,
        )
        fx, fy, cx, cy = camera.camera.intrinsics_px
        self._matrix = core.Tensor(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))
        self._source_px = _pinhole_source(camera)

    def add(self, frame: RgbdFrame, T_map_body: Float[np.ndarray, "4 4"]) -> None:
        """Integrate a frame at its pose; frames in which no depth passes the gates add nothing.

        Raises:
            ScanError: the images are not of the camera's size.
        """
        self.camera.check(frame.image.shape, frame.source)
        depth = gated_depth(frame.depth_m, self.camera, self.gates, frame.source)
        if not (depth > 0.0).any():
            return
        T_map_cam = T_map_body @ self.camera.T_body_cam
        if self._origin_m is None:
            self._origin_m = np.round(T_map_cam[:3, 3])
        T_map_cam = T_map_cam.copy()
        T_map_cam[:3, 3] -= self._origin_m
        colour = np.ascontiguousarray(frame.image[..., ::-1], dtype=np.float32) / 255.0
        if self._source_px is not None:
            column, row = self._source_px
            depth = cv2.remap(depth, column, row, cv2.INTER_NEAREST)
            colour = cv2.remap(colour, column, row, cv2.INTER_LINEAR)
        image = self._o3d.t.geometry.Image
        depth_image, colour_image = image(depth), image(colour)
        extrinsic = self._o3d.core.Tensor(rigid.inverse(T_map_cam))
        scale, reach = 1.0, float(self.gates.max_m)
        blocks = self._grid.compute_unique_block_coordinates(
            depth_image, self._matrix, extrinsic, scale, reach, _TRUNCATION
        )
        self._grid.integrate(
            blocks, depth_image, colour_image, self._matrix, self._matrix, extrinsic, scale, reach, _TRUNCATION
        )

    def mesh(self, min_frames: int = 3) -> Mesh:
        """The surface, as triangles (marching cubes), in voxels that at least `min_frames` frames saw.

        Raises:
            CloudError: no voxel was seen so often.
        """
        found = self._surface("extract_triangle_mesh", "vertex", min_frames)
        return Mesh(
            self._in_map(found.vertex.positions),
            _bytes(found.vertex.colors.numpy()),
            found.triangle.indices.numpy().astype(np.int64),
        )

    def points(self, min_frames: int = 3) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
        """The surface, as points in the map frame (where it crosses the edges of voxels) and their RGB.

        Raises:
            CloudError: no voxel was seen so often.
        """
        found = self._surface("extract_point_cloud", "point", min_frames).point
        return self._in_map(found.positions), _bytes(found.colors.numpy())

    def _surface(self, extract: str, part: str, min_frames: int) -> Any:
        if self._origin_m is not None:
            found = getattr(self._grid, extract)(min_frames - 0.5)  # Open3D takes what weighs more than this
            positions = getattr(found, part)
            if "positions" in positions and len(positions.positions):
                return found
        raise CloudError(
            f"surface: no voxel of {self.voxel_m} m was seen by {min_frames} frames with a depth; expected frames that "
            "overlap. Use more frames, larger voxels or a smaller `min_frames`."
        )

    def _in_map(self, positions: Any) -> Float[np.ndarray, "n 3"]:
        return positions.numpy().astype(np.float64) + self._origin_m


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a mesh with its colours, whole or not at all; the format goes by the suffix.

    Coordinates are written as Open3D holds them: PLY in double precision.

    Raises:
        InputError: a suffix other than .ply, .obj, .glb, .stl, a folder that cannot be written to, no Open3D.
    """
    if Path(path).suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: expected a mesh file: {', '.join(MESH_SUFFIXES)}.")
    o3d = _open3d()
    legacy = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_m), o3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    )
    legacy.vertex_colors = o3d.utility.Vector3dVector(mesh.colour / 255.0)
    legacy.compute_triangle_normals()
    with atomic_path(path) as temporary:
        if not o3d.io.write_triangle_mesh(str(temporary), legacy):
            raise InputError(f"{path}: Open3D could not write the mesh of {len(mesh.triangles)} triangles.")


def mesh_distance(points_m: Float[np.ndarray, "n 3"], mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Distance of every point to the nearest triangle, both in the map frame."""
    o3d = _open3d()
    origin_m = np.round(mesh.vertices_m.mean(axis=0))  # single precision below
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles((mesh.vertices_m - origin_m).astype(np.float32), mesh.triangles.astype(np.uint32))
    return scene.compute_distance((points_m - origin_m).astype(np.float32)).numpy().astype(np.float64)


def _pinhole_source(camera: RgbdCamera) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]] | None:
    """Column and row in the distorted image of every pixel of a pinhole image; None where there is no distortion."""
    if camera.camera.distortion_model == "none":
        return None
    width, height = camera.resolution_px
    fx, fy, cx, cy = camera.camera.intrinsics_px
    columns, rows = np.meshgrid((np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy)
    rays = np.column_stack([columns.ravel(), rows.ravel(), np.ones(width * height)])
    pixels, _, in_range = project(rays, camera.camera)
    column, row = np.where(in_range[:, None], pixels, _OUTSIDE_PX).T.reshape(2, height, width).astype(np.float32)
    return column, row


def _bytes(colour: Float[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    return np.clip(np.round(colour * 255.0), 0, 255).astype(np.uint8)


def _open3d() -> Any:
    try:
        import open3d
    except ImportError as failure:
        raise InputError(
            f"a surface from RGB-D frames needs Open3D, which cannot be imported ({failure}): "
            "pip install 'jaxgeo[cloud]'."
        ) from None
    return open3d
