"""The ways in which the simulated odometry errs, and what is assumed of it beforehand: plain data."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.calibrate import LearnSettings
from jaxgeo.errors import InputError
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.simulate import Drift

KIND = "lidar"


@dataclass(frozen=True)
class Regime:
    """Where the true errors of a session's odometry are drawn from, and the noise that is assumed of it.

    Attributes:
        name: as on the command line and in the tables.
        drift: standard deviations; those of the constant biases and of the log-scale are of what is drawn once a
            session, each axis for itself.
        assumed_trans_m_per_sqrt_m, assumed_rot_rad_per_sqrt_m: the fixed noise, and the median of the learned one's
            prior; None: the defaults of the kind of odometry.
        words: one line for the reader.
    """

    name: str
    drift: Drift
    assumed_trans_m_per_sqrt_m: float | None
    assumed_rot_rad_per_sqrt_m: float | None
    words: str

    @property
    def assumed(self) -> OdometryNoise:
        given = {
            "sigma_trans_m_per_sqrt_m": self.assumed_trans_m_per_sqrt_m,
            "sigma_rot_rad_per_sqrt_m": self.assumed_rot_rad_per_sqrt_m,
        }
        return default_noise(KIND, **{name: value for name, value in given.items() if value is not None})

    @property
    def learn(self) -> LearnSettings:
        return LearnSettings(KIND, self.assumed)

    def drawn(self, seed: int) -> Drift:
        """The drift of one session: what is constant over it drawn; the streams are apart from the simulator's."""
        bias = np.random.default_rng([seed, 7]).standard_normal((2, 3))
        scale = np.random.default_rng([seed, 8]).standard_normal()
        return replace(
            self.drift,
            bias_trans_m_per_m=_times(self.drift.bias_trans_m_per_m, bias[0]),
            bias_rot_rad_per_m=_times(self.drift.bias_rot_rad_per_m, bias[1]),
            log_scale=float(self.drift.log_scale * scale),
        )


def _times(sigma: tuple[float, float, float], unit: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (np.asarray(sigma) * unit).tolist()
    return x, y, z


def _same(value: float) -> tuple[float, float, float]:
    return value, value, value


# Raw revisit gaps of some metres, as in the reference study; and the white noise of a good LiDAR odometry.
_STRONG = Drift(sigma_trans_m_per_sqrt_m=_same(0.14), sigma_rot_rad_per_sqrt_m=_same(0.007))
_WEAK = Drift(sigma_trans_m_per_sqrt_m=_same(0.02), sigma_rot_rad_per_sqrt_m=_same(0.002))

REGIMES: dict[str, Regime] = {
    regime.name: regime
    for regime in (
        Regime("white", _STRONG, 0.14, 0.007, "white noise, assumed right"),
        Regime(
            "biased",
            replace(_WEAK, bias_trans_m_per_m=_same(0.015), bias_rot_rad_per_m=_same(0.001)),
            None,
            None,
            "white noise and a constant bias, drawn per axis and session; white noise assumed",
        ),
        Regime("misassumed", _STRONG, None, None, "white noise, assumed seven times too small"),
        Regime(
            "gauss-markov",
            replace(
                _WEAK,
                wander_trans_m_per_m=_same(0.03),
                wander_rot_rad_per_m=_same(0.002),
                wander_log_scale=0.03,
                wander_correlation_m=30.0,
            ),
            None,
            None,
            "white noise, and biases and a scale that wander over 30 m; white noise assumed",
        ),
        Regime(
            "heavy-tailed",
            replace(_STRONG, student_dof=3.0),
            0.14,
            0.007,
            "Student-t noise of 3 degrees of freedom, its variance assumed right",
        ),
        Regime(
            "scale",
            replace(_WEAK, log_scale=0.03),
            None,
            None,
            "white noise and a scale error of 3 %, drawn once a session; 1 % assumed",
        ),
    )
}


def regimes_named(names: str) -> tuple[Regime, ...]:
    """The regimes of a comma-separated list, in its order.

    Raises:
        InputError: an unknown or repeated name, or none.
    """
    asked = [name.strip() for name in names.split(",") if name.strip()]
    for name in asked:
        if name not in REGIMES:
            raise InputError(f"--regimes: {name!r}; expected some of {', '.join(REGIMES)}, separated by commas.")
    if not asked or len(set(asked)) < len(asked):
        raise InputError(f"--regimes: {names!r}; expected each of {', '.join(REGIMES)} at most once, and one at least.")
    return tuple(REGIMES[name] for name in asked)
