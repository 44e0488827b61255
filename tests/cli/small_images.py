"""The small session with images: printed markers drawn where its camera saw them (simulated)."""

from pathlib import Path

import cv2
import numpy as np
from cli.small_session import (
    AHEAD_M,
    MARKER_M,
    N_POSES,
    ODOMETRY,
    R_BODY_CAM,
    RATE_HZ,
    SEEN_ROWS,
    STAY_S,
    SURVEY,
    WALK_S,
    true_poses,
    write_small_session,
)
from scipy.spatial.transform import Rotation

from jaxgeo.detect.families import dictionary
from jaxgeo.io import write_lines
from jaxgeo.simulate.session import LOCATIONS, ORDER, ORIGIN_ENH_M, SURVEYED_NEH_M

FAMILY = "aruco_mip_36h12"
WIDTH, HEIGHT, FOCAL_PX = 320, 240, 300.0
FINE = 4  # samples of a pixel along each axis
CELL_PX = 10
IDS = {name: 11 + place for place, name in enumerate(LOCATIONS)}
RIG = f"""\
cameras:
  cam0:
    intrinsics_px: [{FOCAL_PX}, {FOCAL_PX}, 160, 120]
    distortion_model: none
    resolution_px: [{WIDTH}, {HEIGHT}]
    t_body_cam_m: [0, 0, 0]
    quat_body_cam_wxyz: {R_BODY_CAM.as_quat(scalar_first=True).tolist()}
"""
CONFIG = f"""{SURVEY}
simulated: true
rig: {{file: rig_images.yaml}}
sightings:
  kind: images
  source: {{kind: folder, path: images, stamps: stamps.csv}}
  families: [{FAMILY}]
  marker_size_m: {MARKER_M}
visits:
  gap_s: 2.0
  locations: {{{", ".join(f"{marker}: {name}" for name, marker in IDS.items())}}}
{ODOMETRY}"""


def write_small_images(folder: Path) -> None:
    """Write the small session, and `images/`, `stamps.csv`, `rig_images.yaml`, `images.yaml`: 21 images of 7 visits."""
    write_small_session(folder)
    (folder / "rig_images.yaml").write_text(RIG)
    (folder / "images.yaml").write_text(CONFIG)
    (folder / "images").mkdir()
    stamp_s, truth, marker_m = true_scene()
    rows = []
    for number, (row, name) in enumerate(seen()):
        file = f"{number:03d}.png"
        cv2.imwrite(str(folder / "images" / file), picture(truth, marker_m, row, name, seed=number))
        rows.append(f"{float(stamp_s[row])!r},{file}")
    write_lines(folder / "stamps.csv", ["stamp_s,file", *rows])


def true_scene():
    """Stamps, poses of the body, and the markers' positions by location, in the local frame."""
    marker_m = dict(zip(LOCATIONS, SURVEYED_NEH_M[:, [1, 0, 2]] - ORIGIN_ENH_M, strict=True))
    stamp_s = np.arange(N_POSES) / RATE_HZ
    return stamp_s, true_poses(stamp_s, np.array([marker_m[name] for name in ORDER])), marker_m


def seen() -> list[tuple[int, str]]:
    """(row of the trajectory, location) of every image."""
    first = [round(visit * (STAY_S + WALK_S) * RATE_HZ) for visit in range(len(ORDER))]
    return [(begin + row, name) for begin, name in zip(first, ORDER, strict=True) for row in SEEN_ROWS]


def picture(truth, marker_m, row: int, name: str, seed: int) -> np.ndarray:
    """The image: a print that hangs upright and turned a little, gray around it, a little noise."""
    stand = row - row % round((STAY_S + WALK_S) * RATE_HZ) + 5
    upright = truth[stand].rotation * R_BODY_CAM * Rotation.from_euler("xy", [np.pi, 0.35])
    square_m = MARKER_M / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])  # UL, UR, LR, LL
    x, y, z = R_BODY_CAM.inv().apply(truth[row].inv().apply(marker_m[name] + upright.apply(square_m))).T
    assert z.min() > AHEAD_M / 2
    corners = np.column_stack([160 + FOCAL_PX * x / z, 120 + FOCAL_PX * y / z])
    cells = dictionary(FAMILY).markerSize + 2
    side = cells * CELL_PX
    code = cv2.aruco.generateImageMarker(dictionary(FAMILY), IDS[name], side)
    paper = cv2.copyMakeBorder(code, *[2 * CELL_PX] * 4, cv2.BORDER_CONSTANT, value=255)
    print_px = 2 * CELL_PX - 0.5 + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    warp = cv2.getPerspectiveTransform(print_px.astype(np.float32), ((corners + 0.5) * FINE - 0.5).astype(np.float32))
    fine = np.full((HEIGHT * FINE, WIDTH * FINE), 140, np.uint8)
    cv2.warpPerspective(paper, warp, fine.shape[::-1], fine, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    image = cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64)
    noisy = image + np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return cv2.cvtColor(np.clip(np.round(noisy), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)
