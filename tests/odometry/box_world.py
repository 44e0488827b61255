"""A world of boxes, seen by a spinning LiDAR whose every column has its own time and pose."""

import numpy as np

from jaxgeo.data import Scan
from jaxgeo.geometry.rigid import exp

HALL = (np.array([-15.0, -10.0, -1.5]), np.array([45.0, 10.0, 8.0]))  # seen from inside
CRATES = [
    (np.array([x, y, -1.5]), np.array([x + a, y + b, h]))
    for x, y, a, b, h in [
        (2, 6, 2, 1.5, 1.0),
        (8, -7, 1, 3, 2.0),
        (14, 5, 3, 2, 0.5),
        (20, -6, 2, 2, 3.0),
        (26, 7, 1.5, 1.5, 1.5),
        (32, -8, 3, 1, 1.0),
        (-6, -6, 2, 2, 2.5),
        (-10, 5, 1, 2, 0.5),
        (38, 2, 2, 3, 2.0),
    ]
]
SWEEP_S = 0.1


def distances_m(origin_m, direction, room, boxes):
    """(n,) along each ray to the nearest wall: `room` is left, `boxes` are entered."""
    inverse = 1.0 / np.where(direction == 0.0, 1e-300, direction)
    far = np.max(np.stack([(side - origin_m) * inverse for side in room]), axis=0).min(axis=1)
    for box in boxes:
        sides = np.stack([(side - origin_m) * inverse for side in box])
        enter, leave = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
        far = np.where((enter < leave) & (enter > 0.0) & (enter < far), enter, far)
    return far


def scan_at(T_map_lidar, twist, stamp_s, index=0, *, noise_m=0.01, room=HALL, boxes=CRATES, max_range_m=np.inf):
    """A sweep that ends at `stamp_s`, taken at the constant velocity `twist` (m/s, rad/s, sensor frame)."""
    columns, rings = 240, 16
    rng = np.random.default_rng(index)
    time_s = np.repeat(np.linspace(-SWEEP_S, 0.0, columns), rings)
    azimuth = np.repeat(np.linspace(0.0, 2 * np.pi, columns, endpoint=False), rings)
    elevation = np.tile(np.radians(np.linspace(-25.0, 25.0, rings)), columns)
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    poses = np.array([T_map_lidar @ exp(t * twist) for t in time_s[::rings]]).repeat(rings, axis=0)
    direction = np.einsum("nij,nj->ni", poses[:, :3, :3], ray)
    range_m = distances_m(poses[:, :3, 3], direction, room, boxes) + rng.normal(0.0, noise_m, len(ray))
    near = range_m < max_range_m
    return Scan(stamp_s, (ray * range_m[:, None])[near], time_s[near], None, f"world scan {index}", index)


def drive(n, twist, *, start_s=1000.0, dt_s=0.1, **world):
    """(scans, T_map_lidar (n, 4, 4)) of a drive at constant velocity from the map's origin."""
    poses = np.array([exp(k * dt_s * twist) for k in range(n)])
    return [scan_at(T, twist, start_s + k * dt_s, k, **world) for k, T in enumerate(poses)], poses


def without_times(scans):
    return [Scan(s.stamp_s, s.points_m, None, None, s.source, s.index) for s in scans]
