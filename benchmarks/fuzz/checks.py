"""What valid data are, for every kind that a reader gives back; a breach is an AssertionError."""

from typing import Any

import numpy as np

from jaxgeo.data import CornerSightings, RgbdFrame, Rig, Scan, Sightings, Survey, Trajectory
from jaxgeo.io.areas_geojson import Areas
from jaxgeo.io.g2o_graph import G2oGraph
from jaxgeo.io.noise_json import StoredNoise


def nothing(value: Any) -> None:
    """What came back is of no fixed form."""


def trajectory(value: Trajectory) -> None:
    n = len(value)
    assert n >= 2
    _finite(value.stamp_s, (n,))
    _finite(value.position_m, (n, 3))
    assert (np.diff(value.stamp_s) > 0).all()
    _rotations(value.quat_wxyz, n)


def graph(value: G2oGraph) -> None:
    n, m = len(value.id), len(value.edges)
    assert n >= 1
    assert len(set(value.id)) == n
    _finite(value.position_m, (n, 3))
    _rotations(value.quat_wxyz, n)
    _finite(value.edges.t_m, (m, 3))
    _rotations(value.edges.quat_wxyz, m)
    _finite(value.edges.information, (m, 6, 6))
    for rows in (value.edges.first, value.edges.second, value.fixed):
        assert ((rows >= 0) & (rows < n)).all()


def survey(value: Survey) -> None:
    n = len(value)
    assert n >= 1
    assert len(set(value.name)) == n
    assert all(value.name)
    _finite(value.enh_m, (n, 3))
    _finite(value.sigma_m, (n, 3))
    assert (value.sigma_m > 0).all()
    known = ~np.isnan(value.quat_grid_marker_wxyz).all(axis=1)
    _rotations(value.quat_grid_marker_wxyz[known], int(known.sum()))


def corner_sightings(value: CornerSightings) -> None:
    n = len(value)
    assert n >= 1
    _finite(value.stamp_s, (n,))
    assert (np.diff(value.stamp_s) >= 0).all()
    _finite(value.corners_px, (n, 4, 2))
    assert value.camera.shape == value.marker.shape == value.source.shape == (n,)
    if value.covariance_px2 is not None:
        known = ~np.isnan(value.covariance_px2[:, 0, 0])
        _finite(value.covariance_px2[known], (int(known.sum()), 8, 8))


def sightings(value: Sightings) -> None:
    n = len(value.stamp_s)
    assert n >= 1
    _finite(value.stamp_s, (n,))
    assert (np.diff(value.stamp_s) >= 0).all()
    _finite(value.t_body_marker_m, (n, 3))
    _finite(value.covariance, (n, 6, 6))
    known = ~np.isnan(value.quat_body_marker_wxyz).all(axis=1)
    _rotations(value.quat_body_marker_wxyz[known], int(known.sum()))
    assert value.marker.shape == value.source.shape == value.ambiguous.shape == (n,)


def control_points(value: tuple[Survey, Sightings]) -> None:
    survey(value[0])
    sightings(value[1])
    assert set(value[1].marker.tolist()) <= set(value[0].name)


def rig(value: Rig) -> None:
    assert value.cameras
    for camera in value.cameras.values():
        _finite(camera.intrinsics_px, (4,))
        assert (camera.intrinsics_px[:2] > 0).all()
        _finite(camera.distortion, (len(camera.distortion),))
        _finite(camera.t_body_cam_m, (3,))
        _rotations(camera.quat_body_cam_wxyz[None], 1)
        assert camera.resolution_px is None or min(camera.resolution_px) > 0


def noise(value: StoredNoise) -> None:
    q, n = value.sigma.shape
    _finite(value.theta_mean, (n,))
    _finite(value.theta_covariance, (n, n))
    _finite(value.sigma, (q, n))
    _finite(value.weight, (q,))
    assert abs(value.weight.sum() - 1.0) < 1e-9
    assert np.isfinite(value.correlation_m)
    assert value.correlation_m > 0


def areas(value: Areas) -> None:
    assert value.polygon
    assert len(value.place) == len(value.polygon)
    for rings in value.polygon:
        assert rings
        for ring in rings:
            _finite(ring, (len(ring), 2))
            assert len(ring) >= 3


def stamps(value: list[Any]) -> None:
    """Rows with a `stamp_s` each."""
    assert value
    assert np.isfinite([row.stamp_s for row in value]).all()


def scans(value: list[Scan]) -> None:
    for scan in value:
        n = len(scan)
        assert np.isfinite(scan.stamp_s)
        _finite(scan.points_m, (n, 3))
        if scan.time_s is not None:
            _finite(scan.time_s, (n,))
        assert scan.intensity is None or scan.intensity.shape == (n,)


def rgbd_frames(value: list[RgbdFrame]) -> None:
    for frame in value:
        assert np.isfinite(frame.stamp_s)
        bgr(frame.image)
        depth(frame.depth_m)


def bgr(value: np.ndarray) -> None:
    assert value.dtype == np.uint8
    assert value.ndim == 3
    assert value.shape[2] == 3


def depth(value: np.ndarray | None) -> None:
    if value is not None:
        assert value.ndim == 2
        assert np.isfinite(value).all()
        assert (value >= 0).all()


def _finite(values: np.ndarray, shape: tuple[int, ...]) -> None:
    assert values.shape == shape, (values.shape, shape)
    assert values.dtype == np.float64
    assert np.isfinite(values).all()


def _rotations(quat_wxyz: np.ndarray, n: int) -> None:
    _finite(quat_wxyz, (n, 4))
    assert (np.abs(np.linalg.norm(quat_wxyz, axis=1) - 1.0) < 1e-9).all()
