"""What the rig sees of the markers: scatter of the study's size, and one constant error a visit."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Sightings
from jaxgeo.simulate.layout import Layout
from jaxgeo.simulate.walk import Walk

SIGHTING_SIGMA_ROT_RAD = 0.03
# Noise-free sightings still need a covariance that can be inverted.
SMALLEST_SIGMA = 1e-4


def sightings_of(
    walk: Walk,
    layout: Layout,
    marker_m: Float[np.ndarray, "k 3"],
    visit_sigma_m: float,
    noise: float,
    random: np.random.Generator,
) -> Sightings:
    """Every visit's sightings at the image rate, stamps from 0.

    Args:
        marker_m: true position of each visit's marker, local frame.
        visit_sigma_m: of the constant error of a visit, each axis, body frame.
        noise: factor on the layout's repeatability, which is the length of an error of three axes, and on the rotation.
    """
    stamps, errors, turns = [], [], []
    sigma_m = noise * np.array(layout.repeatability_m) / np.sqrt(3)
    for visit, count in enumerate(layout.counts):
        stamps.append(
            walk.arrive_s[visit] + (np.arange(count) + random.uniform(0.2, 0.8, count)) / layout.image_rate_hz
        )
        constant_m = visit_sigma_m * random.standard_normal(3)
        errors.append(constant_m + sigma_m[visit] * random.standard_normal((count, 3)))
        turns.append(noise * SIGHTING_SIGMA_ROT_RAD * random.standard_normal((count, 3)))
    stamp_s = np.concatenate(stamps)
    body = walk.pose(stamp_s)
    visit = np.repeat(np.arange(len(layout.counts)), layout.counts)
    seen = body.inv() * RigidTransform.from_components(marker_m[visit], _facing(body, marker_m, layout))
    attitude = Rotation.from_rotvec(np.concatenate(turns)) * seen.rotation
    n = len(stamp_s)
    covariance = np.zeros((n, 6, 6))
    covariance[:, [0, 1, 2], [0, 1, 2]] = np.maximum(sigma_m, SMALLEST_SIGMA)[visit, None] ** 2
    covariance[:, [3, 4, 5], [3, 4, 5]] = max(noise * SIGHTING_SIGMA_ROT_RAD, SMALLEST_SIGMA) ** 2
    return Sightings(
        stamp_s=stamp_s,
        marker=np.full(n, ""),
        t_body_marker_m=seen.translation + np.concatenate(errors),
        quat_body_marker_wxyz=attitude.as_quat(canonical=True, scalar_first=True),
        covariance=covariance,
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"simulated:{row + 1}" for row in range(n)]),
    )


def _facing(body: RigidTransform, marker_m: Float[np.ndarray, "k 3"], layout: Layout) -> Rotation:
    """The marker of each sighting: its z axis points, level, at where its visit looks from; its y axis up."""
    first = np.concatenate([[0], np.cumsum(layout.counts)[:-1]])
    middle_m = np.add.reduceat(body.translation, first) / np.array(layout.counts)[:, None]
    away = middle_m - marker_m
    yaw = np.repeat(np.arctan2(away[:, 1], away[:, 0]), layout.counts)
    return Rotation.from_euler("ZY", np.column_stack([yaw, np.full(len(yaw), np.pi / 2)])) * Rotation.from_euler(
        "z", np.pi / 2
    )
