"""Odometry noise before anything is known of a trajectory, by the kind of odometry."""

from jaxgeo.graph.noise import OdometryNoise, odometry_noise

# Standard deviations of good odometry of each kind, as benchmarks and data sheets have them: translation error of about
# 1 % over 100 m grows from the heading noise; wheel and monocular odometry are looser; only monocular scale is unknown,
# visual-inertial scale is observable but often off by some per cent.
DEFAULTS: dict[str, dict[str, float]] = {
    "lidar": {"sigma_trans_m_per_sqrt_m": 0.01, "sigma_rot_rad_per_sqrt_m": 0.002, "sigma_log_scale": 0.01},
    "vio": {"sigma_trans_m_per_sqrt_m": 0.02, "sigma_rot_rad_per_sqrt_m": 0.005, "sigma_log_scale": 0.1},
    "wheel": {"sigma_trans_m_per_sqrt_m": 0.03, "sigma_rot_rad_per_sqrt_m": 0.01, "sigma_log_scale": 0.03},
    "mono": {"sigma_trans_m_per_sqrt_m": 0.03, "sigma_rot_rad_per_sqrt_m": 0.005, "sigma_log_scale": 1.0},
}


def default_noise(kind: str, **values: float | list[float]) -> OdometryNoise:
    """The defaults of one kind of odometry, single values replaced."""
    return odometry_noise(**{**DEFAULTS[kind], **values})  # type: ignore[arg-type]
