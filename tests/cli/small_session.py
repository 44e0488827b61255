"""A small, sound session as files: 200 poses, six locations, seven visits; every kind of input, a config for each.

The noise is fixed and nothing is held out, so that all of its runs share one compiled program.

Configs: `poses.yaml` (marker poses, one moved marker), `corners.yaml` (decoded ids and a rig), `stops.yaml` (control
points), `truth.yaml` (survey and sightings from a true trajectory; KITTI rows with times).
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Trajectory
from jaxgeo.io import write_kitti, write_lines, write_tum
from jaxgeo.simulate.session import LOCATIONS, ORDER, ORIGIN_ENH_M, SURVEYED_NEH_M

N_POSES = 200
RATE_HZ = 5.0
STAY_S, WALK_S = 2.0, 4.0
SEEN_ROWS = (2, 5, 8)  # of the eleven poses of a stay
AHEAD_M = 3.0
MARKER_M = 0.3
FOCAL_PX = 600.0
# Optical axes (x right, y down, z forward) in the body (x forward, y left, z up).
R_BODY_CAM = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
RIG = f"""\
cameras:
  cam0:
    intrinsics_px: [{FOCAL_PX}, {FOCAL_PX}, 320, 240]
    distortion_model: radtan
    distortion: [0, 0, 0, 0]
    resolution_px: [640, 480]
    t_body_cam_m: [0, 0, 0]
    quat_body_cam_wxyz: {R_BODY_CAM.as_quat(scalar_first=True).tolist()}
"""
SURVEY = """\
name: small
crs: EPSG:2169
survey: {file: survey.csv}
"""
ODOMETRY = """\
evaluate: {leave_one_out: false}
noise: {mode: fixed}
trajectories:
  icp:
    file: icp.tum
    format: tum
    odometry: lidar
"""
CONFIGS = {
    "poses": f"""{SURVEY}
sightings: {{kind: poses, file: sightings.csv}}
visits: {{gap_s: 2.0, order: [{", ".join(ORDER)}]}}
{ODOMETRY}""",
    "corners": f"""{SURVEY}
rig: {{file: rig.yaml}}
sightings: {{kind: corners, file: corners.csv, marker_size_m: {MARKER_M}}}
visits: {{gap_s: 2.0}}
{ODOMETRY}""",
    "stops": f"""name: small
crs: EPSG:2169
sightings: {{kind: control_points, file: stops.csv, lever_arm_m: [{AHEAD_M}, 0, 0]}}
{ODOMETRY}""",
    "truth": """name: small
crs: EPSG:2169
survey:
  from_trajectory: {file: truth.tum, format: tum, rows: {A: 5, B: 35, C: 65, D: 95, E: 125, F: 155}}
sightings:
  kind: from_trajectory
  file: truth.tum
  format: tum
  visits:
    - {location: A, row: 5}
    - {location: B, row: 35}
    - {location: C, row: 65}
    - {location: D, row: 95}
    - {location: E, row: 125}
    - {location: F, row: 155}
    - {location: A, row: 185}
evaluate: {leave_one_out: false}
noise: {mode: fixed}
trajectories:
  icp: {file: icp.kitti, format: kitti, times: times.txt, odometry: lidar}
""",
}


def write_small_session(folder: Path) -> None:
    """Write every input and every config into `folder`."""
    marker_m = dict(zip(LOCATIONS, SURVEYED_NEH_M[:, [1, 0, 2]] - ORIGIN_ENH_M, strict=True))
    stamp_s = np.arange(N_POSES) / RATE_HZ
    truth = true_poses(stamp_s, np.array([marker_m[name] for name in ORDER]))
    to_grid = RigidTransform.from_translation(ORIGIN_ENH_M) * truth
    odometry = _trajectory(stamp_s, _drifted(truth))
    write_tum(folder / "truth.tum", _trajectory(stamp_s, to_grid))
    write_tum(folder / "icp.tum", odometry)
    write_kitti(folder / "icp.kitti", odometry, times=folder / "times.txt")
    rows = [f"{name},{n},{e},{h},0.01" for name, (n, e, h) in zip(LOCATIONS, SURVEYED_NEH_M.tolist(), strict=True)]
    write_lines(folder / "survey.csv", ["name,N,E,h,sigma_m", *rows])
    _write_sightings(folder, stamp_s, truth, marker_m)
    (folder / "rig.yaml").write_text(RIG)
    for name, text in CONFIGS.items():
        (folder / f"{name}.yaml").write_text(text)


def true_poses(stamp_s: np.ndarray, visited_m: np.ndarray) -> RigidTransform:
    """Standing nearly still before each marker in turn, looking at it; a straight way to the next."""
    yaw = 0.7 * np.arange(len(visited_m))
    stand_m = visited_m - AHEAD_M * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    arrive_s = (STAY_S + WALK_S) * np.arange(len(visited_m))
    knots_s = np.column_stack([arrive_s, arrive_s + STAY_S]).ravel()
    sway_m = 0.05 * np.sin(stamp_s)[:, None] * [1.0, 0.5, 0.2]
    stand_m, yaw = np.repeat(stand_m, 2, axis=0), np.repeat(yaw, 2)
    position_m = np.column_stack([np.interp(stamp_s, knots_s, axis) for axis in stand_m.T]) + sway_m
    return RigidTransform.from_components(
        position_m, Rotation.from_euler("z", np.interp(stamp_s, knots_s, yaw)[:, None])
    )


def _drifted(truth: RigidTransform) -> RigidTransform:
    """As an odometry has it: starts at the origin of its own map, and drifts by a few centimetres."""
    poses = truth[0].inv() * truth
    drift_m = 0.1 * np.linspace(0.0, 1.0, N_POSES)[:, None] ** 2 * [1.0, -1.0, 0.5]
    return RigidTransform.from_components(poses.translation + drift_m, poses.rotation)


def _trajectory(stamp_s: np.ndarray, poses: RigidTransform) -> Trajectory:
    return Trajectory(stamp_s, poses.translation, poses.rotation.as_quat(canonical=True, scalar_first=True))


def _write_sightings(folder: Path, stamp_s: np.ndarray, truth: RigidTransform, marker_m: dict[str, np.ndarray]) -> None:
    """The same sightings as marker poses, as corners, and as stops on the surveyed points."""
    poses, corners, stops = [], [], []
    for visit, name in enumerate(ORDER):
        first = round(visit * (STAY_S + WALK_S) * RATE_HZ)
        e, n, h = (marker_m[name] + ORIGIN_ENH_M).tolist()
        stops.append(f"{stamp_s[first + 5]},{name},{n},{e},{h}")
        facing = truth[first + 5].rotation * R_BODY_CAM  # the marker's axes: parallel to the image
        for row in first + np.array(SEEN_ROWS):
            seen_m = truth[row].inv().apply(marker_m[name])
            poses.append(",".join(map(repr, [stamp_s[row].item(), *seen_m.tolist()])))
            square_m = MARKER_M / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
            x, y, z = R_BODY_CAM.inv().apply(truth[row].inv().apply(marker_m[name] + facing.apply(square_m))).T
            pixels = np.column_stack([320 + FOCAL_PX * x / z, 240 + FOCAL_PX * y / z]).ravel().tolist()
            corners.append(f"{stamp_s[row]},cam0,{name},{','.join(map(repr, pixels))}")
    write_lines(folder / "sightings.csv", ["stamp_s,x,y,z", *poses])
    write_lines(folder / "corners.csv", ["stamp_s,camera,marker,u0,v0,u1,v1,u2,v2,u3,v3", *corners])
    write_lines(folder / "stops.csv", ["stamp_s,name,N,E,h", *stops])
