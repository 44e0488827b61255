"""Marker detection: `python -m benchmarks.detection [--json] [--rendered N] [--empty N] [--frames N]`.

Real photographs of tags, simulated images of camouflaged markers, and time beside OpenCV's detector on the same frames.
Everything but the photographs is simulated.
"""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import typer
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxgeo.associate import AmbiguityRule, corners_to_sightings
from jaxgeo.data import Camera, CornerSightings, Rig
from jaxgeo.detect import Detections, Detector, DetectorSettings, MaskSettings
from jaxgeo.detect.families import dictionary, family
from jaxgeo.simulate.camouflage import camouflage
from jaxgeo.simulate.image_conditions import developed, sample_conditions
from jaxgeo.simulate.marker_image import MarkerImage, render_marker_image, sample_marker

ROOT = Path(__file__).resolve().parents[1]
FAMILY = "apriltag_36h11"
SIZE_M = 0.15
WIDTH, HEIGHT = 1280, 720
CAMERA = Camera(
    intrinsics_px=np.array([900.0, 900.0, 640.0, 360.0]),
    distortion_model="radtan",
    distortion=np.array([-0.12, 0.05, 0.0005, -0.0003]),
    resolution_px=(WIDTH, HEIGHT),
    t_body_cam_m=np.zeros(3),
    quat_body_cam_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
)
RIG = Rig({"cam0": CAMERA})
CANVASES = 8


def photographs() -> dict[str, Any]:
    """Ids found in 72 photographs of a room, and those that are not there; ids of a photograph of a screen."""
    root = Path(os.environ.get("JAXGEO_DATA", ROOT.parent / "shared" / "data")) / "tags"
    folder = root / "swatbotics_mapping"
    rows = [line.split() for line in (folder / "groundtruth_ids.txt").read_text().splitlines() if line.strip()]
    detector = Detector(DetectorSettings(families=(FAMILY,)))
    peer = cv2.aruco.ArucoDetector(dictionary(FAMILY))
    found = false = of = peer_found = 0
    for name, *ids in rows:
        image = cv2.imread(str(folder / name))
        seen, listed = set(detector(image).marker.tolist()), set(map(int, ids))
        of, found, false = of + len(listed), found + len(seen & listed), false + len(seen - listed)
        peer_ids = peer.detectMarkers(image)[1]
        peer_found += 0 if peer_ids is None else len(set(peer_ids.ravel().tolist()) & listed)
    screen = cv2.imread(str(root / "aruco_fdcl" / "test_image.png"))
    on_screen = Detector(DetectorSettings(families=("aruco_original",)))(screen)
    return {
        "swatbotics_found": found,
        "swatbotics_of": of,
        "swatbotics_false": false,
        "swatbotics_opencv_found": peer_found,
        "aruco_fdcl_found": len(set(on_screen.marker.tolist()) & set(range(8))),
    }


def rendered(count: int, seed: int) -> tuple[list[MarkerImage], list[float]]:
    """Simulated images of one camouflaged marker each, sides from 20 to 200 px (log-uniform), and these sides."""
    rng = np.random.default_rng(seed)
    canvases = [camouflage(rng, HEIGHT, WIDTH) for _ in range(CANVASES)]
    images, sides = [], []
    ids = len(family(FAMILY).codes)
    for i in range(count):
        side_px = float(np.exp(rng.uniform(np.log(20.0), np.log(200.0))))
        marker = sample_marker(rng, CAMERA, FAMILY, int(rng.integers(ids)), side_px, size_m=SIZE_M)
        images.append(render_marker_image(rng, CAMERA, canvases[i % CANVASES], [marker], sample_conditions(rng)))
        sides.append(side_px)
    return images, sides


def recall(count: int, seed: int) -> dict[str, Any]:
    """Share found, corner errors and honesty of the poses, batch by batch (images are large)."""
    detector = Detector(DetectorSettings(families=(FAMILY,), mask=MaskSettings()))
    sides, hits, errors, false, rows = [], [], [], 0, []
    for batch in range(0, count, 100):
        images, batch_sides = rendered(min(100, count - batch), seed + batch)
        for image, side_px in zip(images, batch_sides, strict=True):
            found = detector(image.bgr, CAMERA)
            right = np.flatnonzero(found.marker == image.markers[0].marker)
            false += len(found) - len(right)
            sides.append(side_px)
            hits.append(len(right) > 0)
            if len(right):
                errors.append((side_px, found.corners_px[right[0]] - image.corners_px[0]))
                rows.append((side_px, image, found, int(right[0])))
    side, hit = np.array(sides), np.array(hits)
    large = np.array([e for s, e in errors if s >= 40.0])
    return {
        "rendered_frames": count,
        "recall_40px": float(hit[side >= 40.0].mean()),
        "recall_20_to_40px": float(hit[side < 40.0].mean()),
        "false_ids_on_rendered": int(false),
        "corner_rms_px": float(np.sqrt(np.mean(large**2))),
        "corner_rms_20_to_40px": float(np.sqrt(np.mean([e**2 for s, e in errors if s < 40.0]))),
        **pose_honesty(rows),
    }


def pose_honesty(rows: list[tuple[float, MarkerImage, Detections, int]]) -> dict[str, Any]:
    """Mean squared pose error over its covariance (6 is honest), ambiguous poses too, with the 95 % band."""
    n = len(rows)
    corners = CornerSightings(
        stamp_s=np.arange(n, dtype=np.float64),
        camera=np.full(n, "cam0"),
        marker=np.full(n, "0"),
        corners_px=np.array([found.corners_px[row] for _, _, found, row in rows]),
        source=np.array([str(i) for i in range(n)]),
        covariance_px2=np.array([found.covariance_px2[row] for _, _, found, row in rows]),
    )
    sightings, _ = corners_to_sightings(corners, RIG, SIZE_M, 1.0, ambiguity_rule=AmbiguityRule())
    nees, sides = [], []
    for i in range(len(sightings)):
        side_px, image, _, _ = rows[int(sightings.source[i])]
        truth = image.markers[0]
        turned = Rotation.from_quat(sightings.quat_body_marker_wxyz[i], scalar_first=True)
        true_turn = Rotation.from_quat(truth.quat_cam_marker_wxyz, scalar_first=True)
        error = np.concatenate(
            [sightings.t_body_marker_m[i] - truth.t_cam_marker_m, (turned * true_turn.inv()).as_rotvec()]
        )
        nees.append(error @ np.linalg.solve(sightings.covariance[i], error))
        sides.append(side_px)
    value, large = np.array(nees), np.array(sides) >= 40.0
    band = chi2.ppf([0.025, 0.975], 6)
    return {
        "pose_nees": float(value.mean()),
        "pose_nees_mean_band": [float(x) / n for x in chi2.ppf([0.025, 0.975], 6 * n)],
        "pose_nees_40px": float(value[large].mean()),
        "poses_in_own_band": float(np.mean((value > band[0]) & (value < band[1]))),
        "poses": n,
        "poses_ambiguous": int(sightings.ambiguous.sum()),
    }


def false_ids(count: int, seed: int) -> dict[str, Any]:
    """Ids found in simulated camouflage without any marker."""
    rng = np.random.default_rng(seed)
    detector = Detector(DetectorSettings(families=(FAMILY,), mask=MaskSettings()))
    canvas = camouflage(rng, 3 * HEIGHT, 3 * WIDTH)
    found = 0
    none = np.zeros((0, 4, 2))
    for i in range(count):
        if i % 500 == 499:
            canvas = camouflage(rng, 3 * HEIGHT, 3 * WIDTH)
        y, x = rng.integers(2 * HEIGHT), rng.integers(2 * WIDTH)
        part = canvas[y : y + HEIGHT, x : x + WIDTH]
        found += len(detector(developed(rng, part.copy(), none, sample_conditions(rng))))
    return {"empty_frames": count, "false_ids": found, "false_ids_per_10000": 1e4 * found / count}


def speed(count: int, repetitions: int, seed: int) -> dict[str, Any]:
    """Median time a frame beside OpenCV's detector on the whole gray frame, one thread, same frames, by turns.

    `ms_per_frame` is mask, decoding and pose as `jaxgeo detect` works: frame by frame, then the poses of all in one
    call. `ms_per_frame_alone` has the pose solved after every single frame.
    """
    cv2.setNumThreads(1)
    frames = [image.bgr for image in rendered(count, seed)[0]]
    detector = Detector(DetectorSettings(families=(FAMILY,), mask=MaskSettings()))
    peer = cv2.aruco.ArucoDetector(dictionary(FAMILY))
    detect_s, pose_s, alone_s, peer_s = [], [], [], []
    for turn in range(repetitions + 1):  # the first turn warms up
        found, ours = _timed(lambda bgr: detector(bgr, CAMERA), frames)
        started = time.perf_counter()
        _poses(found)
        all_poses = (time.perf_counter() - started) / count
        _, alone = _timed(lambda bgr: _poses([detector(bgr, CAMERA)]), frames)
        _, theirs = _timed(lambda bgr: peer.detectMarkers(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)), frames)
        if turn:
            detect_s.append(ours)
            pose_s.append(all_poses)
            alone_s.append(alone)
            peer_s.append(theirs)
    ours_s = float(np.median(np.median(detect_s, axis=0)) + np.median(pose_s))
    theirs_s = float(np.median(np.median(peer_s, axis=0)))
    return {
        "ms_per_frame": 1e3 * ours_s,
        "ms_per_frame_alone": 1e3 * float(np.median(np.median(alone_s, axis=0))),
        "opencv_ms_per_frame": 1e3 * theirs_s,
        "ratio_to_opencv": theirs_s / ours_s,
    }


def _timed(work: Callable[[np.ndarray], Any], frames: list[np.ndarray]) -> tuple[list[Any], list[float]]:
    """What the work gives for every frame, and the seconds it takes."""
    results, seconds = [], []
    for bgr in frames:
        started = time.perf_counter()
        results.append(work(bgr))
        seconds.append(time.perf_counter() - started)
    return results, seconds


def _poses(found: list[Detections]) -> None:
    n = sum(len(one) for one in found)
    if n:
        corners = CornerSightings(
            stamp_s=np.repeat(np.arange(len(found), dtype=np.float64), [len(one) for one in found]),
            camera=np.full(n, "cam0"),
            marker=np.concatenate([one.marker for one in found]).astype(str),
            corners_px=np.concatenate([one.corners_px for one in found]),
            source=np.full(n, "frame"),
            covariance_px2=np.concatenate([one.covariance_px2 for one in found]),
        )
        corners_to_sightings(corners, RIG, SIZE_M, 1.0)


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    images: int = typer.Option(1000, "--rendered", help="Simulated images with a marker."),
    empty: int = typer.Option(10_000, help="Simulated images without one."),
    frames: int = typer.Option(100, help="Images timed."),
    repetitions: int = typer.Option(7, help="Times each."),
    seed: int = typer.Option(0, help="Seed of the simulated images."),
) -> None:
    started = time.perf_counter()
    found = {"simulated": "all but the photographs", **photographs(), **recall(images, seed)}
    found |= speed(frames, repetitions, seed + 10_000)
    found |= false_ids(empty, seed + 20_000)
    found["seconds"] = time.perf_counter() - started
    if as_json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    typer.run(main)
