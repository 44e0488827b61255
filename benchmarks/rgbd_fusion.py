"""RGB-D on real frames with known poses: fusion and closures. `python -m benchmarks.rgbd_fusion [--json]`.

The 7-Scenes frames of `$JAXGEO_DATA/rgbd_7scenes_redkitchen`. Their poses are KinectFusion's, and their colour and
depth images are not registered to one another: what features alone say of a turn is a tenth too small.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import typer
from jaxtyping import Float

from jaxgeo.data import Camera
from jaxgeo.geometry import rigid
from jaxgeo.io.rgbd.source import open_rgbd
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.fusion import FusionSettings, PosedCloud, cloud_of_frame, fuse_points, model_distance
from jaxgeo.mapping.fusion_open3d import TsdfVolume, mesh_distance
from jaxgeo.mapping.image_features import SiftFeatures
from jaxgeo.mapping.keyframe_graph import chain_and, solve_keyframes
from jaxgeo.mapping.rgbd_alignment import Alignment, align_keyframes
from jaxgeo.mapping.rgbd_camera import RgbdCamera, rgbd_camera
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe, make_keyframe
from jaxgeo.solve.closure_graph import ClosureSettings

ROOT = Path(__file__).resolve().parents[1]
FRAMES_HZ = 6.0  # every fifth of thirty
VOXEL_M = 0.02
EVERY = 3  # frame is left out in turn: each takes a model of its own
SAMPLE = 4000  # points of a frame that are measured against the model
OVERLAP = 0.5  # of the smaller share of points that the other camera has in view: pairs that ought to be found
Poses = Float[np.ndarray, "k 4 4"]


def camera_of(path: Path) -> RgbdCamera:
    """The camera of the folder's intrinsics; the body is the camera."""
    matrix = np.loadtxt(path / "camera-intrinsics.txt")
    intrinsics = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
    return rgbd_camera(Camera(intrinsics, "none", np.zeros(0), (640, 480), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))


def poses_of(path: Path) -> Poses:
    """`T_world_cam` of the frames, their rotations made proper (they are off by 2e-4)."""
    T = np.array([np.loadtxt(file) for file in sorted(path.glob("*.pose.txt"))])
    return rigid.matrices(*rigid.parts(T))


def clouds_of(path: Path, T_map_body: Poses) -> list[PosedCloud]:
    """All pixels of all frames that pass the gates."""
    camera, frames = camera_of(path), open_rgbd(path, rate_hz=FRAMES_HZ)
    return [
        cloud_of_frame(frame, camera, T, row) for row, (frame, T) in enumerate(zip(frames, T_map_body, strict=True))
    ]


def distances_m(clouds: list[PosedCloud], leave_out: bool) -> Float[np.ndarray, "n"]:
    """Of points of every third frame to the model of the other frames (or of all), nearest point to point."""
    random, found = np.random.default_rng(0), []
    whole = None if leave_out else fuse_points(clouds, FusionSettings(VOXEL_M)).points_m
    for row, cloud in list(enumerate(clouds))[::EVERY]:
        model = whole
        if model is None:
            model = fuse_points(clouds[:row] + clouds[row + 1 :], FusionSettings(VOXEL_M)).points_m
        points = random.permutation(cloud.points_m)[:SAMPLE]
        found.append(model_distance(rigid.apply(cloud.T_map_body, points), model))
    return np.concatenate(found)


def surface_distances_m(path: Path, clouds: list[PosedCloud]) -> Float[np.ndarray, "n"]:
    """Of points of every third frame to the triangles of the surface made of the other frames."""
    random, frames, found = np.random.default_rng(0), list(open_rgbd(path, rate_hz=FRAMES_HZ)), []
    for left_out in range(0, len(frames), EVERY):
        volume = TsdfVolume(camera_of(path), VOXEL_M)
        for row, (frame, cloud) in enumerate(zip(frames, clouds, strict=True)):
            if row != left_out:
                volume.add(frame, cloud.T_map_body)
        points = random.permutation(clouds[left_out].points_m)[:SAMPLE]
        found.append(mesh_distance(rigid.apply(clouds[left_out].T_map_body, points), volume.mesh()))
    return np.concatenate(found)


def rgbd_median_m(path: Path) -> float:
    """Median distance of frames' points to the fused model of the other frames, at the frames' own poses."""
    return float(np.median(distances_m(clouds_of(path, poses_of(path)), leave_out=True)))


def keyframes_of(path: Path, camera: RgbdCamera) -> list[RgbdKeyframe]:
    """A keyframe of every frame."""
    method = SiftFeatures()
    return [make_keyframe(frame, camera, method) for frame in open_rgbd(path, rate_hz=FRAMES_HZ)]


def all_alignments(keyframes: list[RgbdKeyframe], camera: RgbdCamera) -> dict[tuple[int, int], Alignment]:
    """The pairs that are verified, of all there are."""
    method, found = SiftFeatures(), {}
    for first, a in enumerate(keyframes):
        for second in range(first + 1, len(keyframes)):
            b = keyframes[second]
            aligned, _ = align_keyframes(a, b, method.match(a.features, b.features), camera)
            if aligned is not None:
                found[first, second] = aligned
    return found


def own_poses(aligned: dict[tuple[int, int], Alignment], n: int) -> tuple[Poses, Poses]:
    """Poses by successive frames alone, and by the graph of all verified pairs; the first is the identity."""
    chain = [np.eye(4)]
    for row in range(n - 1):
        chain.append(chain[-1] @ aligned[row, row + 1].T_first_second)
    covariance = np.array([np.linalg.inv(aligned[row, row + 1].information) for row in range(n - 1)])
    closures = [
        Closure(*pair, one.T_first_second, one.information, one.share, "rgbd")
        for pair, one in aligned.items()
        if pair[1] > pair[0] + 1
    ]
    poses = np.array(chain)
    solved = solve_keyframes(poses, chain_and(poses, covariance, closures), ClosureSettings(loss="gnc"))
    return poses, solved.T_map_body


def in_view(keyframes: list[RgbdKeyframe], camera: RgbdCamera, T_map_body: Poses, first: int, second: int) -> float:
    """The smaller share of points of one that the other camera has inside its image."""
    shares = []
    fx, fy, cx, cy = camera.camera.intrinsics_px
    width, height = camera.resolution_px
    for a, b in ((first, second), (second, first)):
        x, y, z = rigid.apply(rigid.inverse(T_map_body[b]) @ T_map_body[a], keyframes[a].points_m).T
        ahead = np.maximum(z, 0.1)
        u, v = fx * x / ahead + cx, fy * y / ahead + cy
        shares.append(float(np.mean((z > 0.1) & (u >= 0) & (u < width) & (v >= 0) & (v < height))))
    return min(shares)


def closure_figures(
    keyframes: list[RgbdKeyframe], camera: RgbdCamera, aligned: dict[tuple[int, int], Alignment], T_map_body: Poses
) -> dict[str, Any]:
    """Which pairs are verified, and how far their motions are from those of the frames' own poses."""
    off, nees = [], []
    for (first, second), one in aligned.items():
        x = rigid.log(rigid.inverse(one.T_first_second) @ rigid.inverse(T_map_body[first]) @ T_map_body[second])
        off.append((np.linalg.norm(x[:3]), np.degrees(np.linalg.norm(x[3:]))))
        nees.append(float(x @ one.information @ x))
    off_m, off_deg = np.array(off).T
    n = len(keyframes)
    view = {(i, j): in_view(keyframes, camera, T_map_body, i, j) for i in range(n) for j in range(i + 1, n)}
    wanted = {pair for pair, share in view.items() if share >= OVERLAP}
    right = sum(view[pair] >= 0.1 and m < 0.15 for pair, m in zip(aligned, off_m, strict=True))
    return {
        "pairs": len(view),
        "verified": len(aligned),
        "precision": right / len(aligned),
        "recall": len(wanted & set(aligned)) / len(wanted),
        "median_m": float(np.median(off_m)),
        "median_deg": float(np.median(off_deg)),
        "worst_m": float(off_m.max()),
        "worst_deg": float(off_deg.max()),
        "median_nees": float(np.median(nees)),
    }


def measure(path: Path) -> dict[str, Any]:
    """Every figure."""
    camera, T_map_body = camera_of(path), poses_of(path)
    clouds = clouds_of(path, T_map_body)
    keyframes = keyframes_of(path, camera)
    aligned = all_alignments(keyframes, camera)
    found: dict[str, Any] = {
        "frames": len(keyframes),
        "median_all_m": float(np.median(distances_m(clouds, leave_out=False))),
        "median_m": float(np.median(distances_m(clouds, leave_out=True))),
        "surface_median_m": float(np.median(surface_distances_m(path, clouds))),
        "closures": closure_figures(keyframes, camera, aligned, T_map_body),
    }
    for name, poses in zip(("frame_to_frame", "graph"), own_poses(aligned, len(keyframes)), strict=True):
        own = clouds_of(path, poses)
        apart = np.linalg.norm((T_map_body[0] @ poses)[:, :3, 3] - T_map_body[:, :3, 3], axis=1)
        found[name] = {
            "median_m": float(np.median(distances_m(own, leave_out=True))),
            "surface_median_m": float(np.median(surface_distances_m(path, own))),
            "worst_position_m": float(apart.max()),
        }
    return found


def main(as_json: bool = typer.Option(False, "--json", help="One JSON object instead of lines.")) -> None:
    data = Path(os.environ.get("JAXGEO_DATA") or ROOT.parent / "shared" / "data")
    found = measure(data / "rgbd_7scenes_redkitchen")
    if as_json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(
            f"{name:18} {value if not isinstance(value, dict) else ', '.join(f'{k} {v:.4g}' for k, v in value.items())}"
        )


if __name__ == "__main__":
    typer.run(main)
