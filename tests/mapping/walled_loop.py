"""A walk round a block of walls and boxes, back to its start, scanned on the way: truth, scans, drifting odometry."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import Scan, Trajectory
from jaxgeo.geometry import rigid

STEP_S = 0.5
RANGE_M = 6.0


def world(rng: np.random.Generator) -> np.ndarray:
    """(n, 3) points 16 cm apart: a court of 16 m by 12 m with a block of 8 m by 4 m in it, a floor, and boxes about."""
    faces = [
        _wall((0, 0), (16, 0), 3),
        _wall((16, 0), (16, 12), 3),
        _wall((16, 12), (0, 12), 3),
        _wall((0, 12), (0, 0), 3),
    ]
    block = ((4, 4), (12, 4), (12, 8), (4, 8), (4, 4))
    faces += [_wall(a, b, 3) for a, b in itertools.pairwise(block)]
    for _ in range(24):
        x, y = rng.uniform(0.3, 15.5), rng.uniform(0.3, 11.5)
        if 1.2 < x < 14.8 and 1.2 < y < 10.8 and not (3 < x < 13 and 3 < y < 9):
            continue  # the way stays free
        a, b, height = rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), rng.uniform(0.4, 2.5)
        corners = [(x, y), (x + a, y), (x + a, y + b), (x, y + b), (x, y)]
        faces += [_wall(p, q, height) for p, q in itertools.pairwise(corners)]
    floor = np.stack(np.meshgrid(np.arange(0, 16, 0.4), np.arange(0, 12, 0.4)), axis=-1).reshape(-1, 2)
    return np.concatenate([*faces, np.column_stack([floor, np.zeros(len(floor))])])


def _wall(a: tuple[float, float], b: tuple[float, float], height: float) -> np.ndarray:
    length = np.hypot(b[0] - a[0], b[1] - a[1])
    along, up = np.meshgrid(np.arange(0, length, 0.16), np.arange(0, height, 0.16))
    way = np.outer(along.ravel() / length, np.subtract(b, a)) + a
    return np.column_stack([way, up.ravel()])


def walk(step_m: float = 0.5) -> np.ndarray:
    """(n, 4, 4) level poses once round the block, 36 m, and 4 m further on the same way; turned along the way."""
    corners = np.array([(2, 2), (14, 2), (14, 10), (2, 10), (2, 2), (6, 2)], dtype=float)
    legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    at = np.arange(0, legs.sum(), step_m)
    ends = np.concatenate([[0.0], np.cumsum(legs)])
    xy = np.column_stack([np.interp(at, ends, corners[:, axis]) for axis in (0, 1)])
    xy = np.stack([np.convolve(np.pad(c, 2, "edge"), np.ones(5) / 5, "valid") for c in xy.T], axis=1)
    ahead = np.gradient(xy, axis=0)
    T = np.tile(np.eye(4), (len(xy), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("z", np.arctan2(ahead[:, 1], ahead[:, 0])[:, None]).as_matrix()
    T[:, :2, 3], T[:, 2, 3] = xy, 1.2
    return T


def scans_of(truth: np.ndarray, points_m: np.ndarray, rng: np.random.Generator, noise_m: float = 0.01) -> list[Scan]:
    """What a sensor at each pose sees within its range, ahead and to the sides; a third of the points, at random."""
    scans = []
    for k, T in enumerate(truth):
        seen = rigid.apply(rigid.inverse(T), points_m)
        near = (np.linalg.norm(seen, axis=1) < RANGE_M) & (seen[:, 0] > -1.0) & (rng.random(len(seen)) < 0.35)
        cloud = seen[near] + noise_m * rng.normal(size=(int(near.sum()), 3))
        scans.append(Scan(k * STEP_S, cloud, None, None, f"scan {k}", k))
    return scans


def drifting(truth: np.ndarray, yaw_rad: float, along_share: float) -> Trajectory:
    """Odometry that turns too much, evenly by `yaw_rad` in all, and goes too far, by a share of the way."""
    steps = rigid.inverse(truth[:-1]) @ truth[1:]
    extra = np.zeros((len(steps), 6))
    extra[:, 0] = along_share * np.linalg.norm(steps[:, :3, 3], axis=1)
    extra[:, 5] = yaw_rad / len(steps)
    poses = [truth[0]]
    for step in steps @ rigid.exp(extra):
        poses.append(poses[-1] @ step)
    return Trajectory(STEP_S * np.arange(len(truth)), *rigid.parts(np.stack(poses)))


def rmse_m(position_m: np.ndarray, truth_m: np.ndarray) -> float:
    """RMSE after one rigid fit."""
    a, b = position_m - position_m.mean(axis=0), truth_m - truth_m.mean(axis=0)
    rotation = Rotation.align_vectors(b, a)[0]
    return float(np.sqrt(np.mean(np.sum((b - rotation.apply(a)) ** 2, axis=1))))
