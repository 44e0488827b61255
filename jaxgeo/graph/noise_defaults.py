"""Odometry noise before anything is known of a trajectory, by the kind of odometry."""

from jaxgeo.graph.noise import OdometryNoise, odometry_noise

# Drift over 100 m of 0.2 m (lidar), 1 m (visual-inertial, monocular) and 0.5 m (wheel) from the translations alone, and
# of 0.6 degrees (lidar) or 6 in heading: the order of magnitude of odometry without loop closure. Only monocular scale
# is unknown; visual-inertial scale is observable, but often off by some per cent or more.
DEFAULTS: dict[str, dict[str, float]] = {
    "lidar": {"sigma_trans_m_per_sqrt_m": 0.02, "sigma_rot_rad_per_sqrt_m": 0.001, "sigma_log_scale": 0.01},
    "vio": {"sigma_trans_m_per_sqrt_m": 0.1, "sigma_rot_rad_per_sqrt_m": 0.01, "sigma_log_scale": 0.1},
    "wheel": {"sigma_trans_m_per_sqrt_m": 0.05, "sigma_rot_rad_per_sqrt_m": 0.01, "sigma_log_scale": 0.05},
    "mono": {"sigma_trans_m_per_sqrt_m": 0.1, "sigma_rot_rad_per_sqrt_m": 0.01, "sigma_log_scale": 1.0},
}


def default_noise(kind: str, **values: float | list[float]) -> OdometryNoise:
    """The defaults of one kind of odometry, single values replaced."""
    return odometry_noise(**{**DEFAULTS[kind], **values})  # type: ignore[arg-type]
