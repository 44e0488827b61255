"""The noise that a simulated trajectory was drawn from, in the words of the estimator."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.graph.components import (
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    N_COMPONENTS,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
)
from jaxgeo.simulate.drift import Drift

# Over what way a bounded error forgets is read from its autocorrelation, on this many evenly spaced places.
PLACES = 512


def true_noise(trajectory: Trajectory, truth: Trajectory, drift: Drift) -> NoiseEnsemble:
    """One set of standard deviations, per metre (and per turned radian) of the trajectory's own way.

    Noise makes odometry longer than the true path, by a factor r: a white sigma is divided by √r, a bias by r, and a
    correlation length multiplied. What was constant has its size as sigma: |log-scale|, and the root mean square of a
    bias' axes; axes that wander by different sigmas become one likewise. Heavy tails enter with their variance only.

    With loop closures biases no longer accumulate: white noise stays, and `bounded_m` is what is left of the position
    error after the best rigid fit to the truth, root mean square over poses and axes; it forgets over the way in which
    its autocorrelation falls to 1/e.
    """
    longer, turned = _way(trajectory) / _way(truth), _turn(trajectory) / _turn(truth)
    sigma = np.zeros(N_COMPONENTS)
    sigma[TRANS] = np.array(drift.sigma_trans_m_per_sqrt_m) / math.sqrt(longer)
    sigma[ROT] = np.array(drift.sigma_rot_rad_per_sqrt_m) / math.sqrt(longer)
    sigma[TURN] = drift.sigma_turn_rad_per_sqrt_rad / math.sqrt(turned)
    correlation_m = 1.0
    if drift.closures:
        error_m = error_after_fit_m(trajectory, truth)
        sigma[BOUNDED] = float(np.sqrt(np.mean(error_m**2)))
        correlation_m = _correlation_m(trajectory, error_m)
    else:
        sigma[LOG_SCALE] = abs(drift.log_scale)
        sigma[BIAS_TRANS] = _rms(drift.bias_trans_m_per_m) / longer
        sigma[BIAS_ROT] = _rms(drift.bias_rot_rad_per_m) / longer
        if drift.wanders:
            sigma[WANDER_SCALE] = drift.wander_log_scale
            sigma[WANDER_TRANS] = _rms(drift.wander_trans_m_per_m) / longer
            sigma[WANDER_ROT] = _rms(drift.wander_rot_rad_per_m) / longer
            correlation_m = drift.wander_correlation_m * longer
    return NoiseEnsemble(jnp.asarray(sigma[None]), jnp.ones(1), jnp.asarray(correlation_m, dtype=jnp.float64))


def error_after_fit_m(trajectory: Trajectory, truth: Trajectory) -> Float[np.ndarray, "n 3"]:
    """Position error of every pose after the rigid motion that makes its squares least (Kabsch 1976)."""
    centre_m = trajectory.position_m.mean(axis=0)
    target_m = truth.position_m - truth.position_m.mean(axis=0)
    turn = Rotation.align_vectors(target_m, trajectory.position_m - centre_m)[0]
    return turn.apply(trajectory.position_m - centre_m) - target_m


def _correlation_m(trajectory: Trajectory, error_m: Float[np.ndarray, "n 3"]) -> float:
    """Way after which the error's autocorrelation has fallen to 1/e."""
    step_m = np.linalg.norm(np.diff(trajectory.position_m, axis=0), axis=1)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    place_m = np.linspace(0.0, along_m[-1], PLACES)
    error_m = np.column_stack([np.interp(place_m, along_m, axis) for axis in error_m.T])
    error_m -= error_m.mean(axis=0)
    products = [np.sum(error_m[: PLACES - lag] * error_m[lag:]) for lag in range(PLACES)]
    if not products[0] > 0:
        return float(along_m[-1])
    return float(place_m[np.argmax(np.array(products) < products[0] / math.e)])


def _way(trajectory: Trajectory) -> float:
    return float(np.linalg.norm(np.diff(trajectory.position_m, axis=0), axis=1).sum())


def _turn(trajectory: Trajectory) -> float:
    attitude = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return float((attitude[:-1].inv() * attitude[1:]).magnitude().sum())


def _rms(axes: tuple[float, float, float]) -> float:
    return float(np.sqrt(np.mean(np.square(axes))))
