"""The current pose and its covariance between solves: every odometry motion moves them on, in constant time.

A mirror in NumPy of how noise reaches the poses (`jaxgeo.solve.linearise`, `jaxgeo.solve.drift`), written for the error
at the pose itself. With T the mean pose, the motion O_k of length d and turn a,

    T_k = T_(k-1) O_k(e^s (1 + w_s)) Exp(eps_k),     eps_k = d (b + w) + (0, l omega_k)
    dp += dr x (t_k - t_(k-1)) + R_k (J n_t + Q n_r),     dr += R_k J n_r

for noise n on top of eps. Wander w and the bounded error forget over the correlation length, edge by edge; the batch
solve holds the wander constant on stretches of 1/64 of the path.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.graph.components import (
    BOUNDED,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
    ensemble_of,
)
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.online import joint, pose_log

_WANDER = slice(joint.WANDER_TRANS.start, joint.N_ERRORS)  # wander and bounded: all that forgets


class DriftVariances:
    """Mean variances of what is drawn anew: white noise, wander and bounded error, with their correlation length."""

    def __init__(self, noise: OdometryNoise | NoiseEnsemble) -> None:
        ensemble = ensemble_of(noise) if isinstance(noise, OdometryNoise) else noise
        variance = np.asarray(ensemble.weight) @ np.asarray(ensemble.sigma) ** 2
        self.trans, self.rot, self.turn = variance[TRANS], variance[ROT], float(variance[TURN])
        forgetting = np.zeros(joint.N_ERRORS)
        forgetting[joint.WANDER_TRANS], forgetting[joint.WANDER_ROT] = variance[WANDER_TRANS], variance[WANDER_ROT]
        forgetting[joint.WANDER_SCALE], forgetting[joint.BOUNDED] = variance[WANDER_SCALE], variance[BOUNDED]
        self.forgetting = forgetting[_WANDER]
        self.forgets = bool(np.any(self.forgetting > 0))
        self.correlation_m = float(ensemble.correlation_m)


class DriftState:
    """The pose that a solve left, moved on by the odometry since."""

    def __init__(self, last: joint.LastPose, variances: DriftVariances) -> None:
        self._variances = variances
        self._position = np.array(last.position_m)
        self._rotation = rotation_matrix(np.asarray(last.quat_wxyz).tolist())
        self._constants = np.concatenate([np.zeros(6), np.asarray(last.constants)])
        self._covariance = np.array(last.covariance)

    def push(self, column: Float[np.ndarray, "16"]) -> None:
        """Move on by one motion, a column of the `PoseLog`."""
        length, turn = float(column[pose_log.LENGTH]), float(column[pose_log.TURN])
        if self._variances.forgets:
            self._forget(length)
        c = self._constants
        moved = self._rotation @ column[pose_log.STEP_T]
        moved = math.exp(c[joint.LOG_SCALE]) * moved
        step_q = column[pose_log.STEP_Q].tolist()
        omega = np.array(pose_log.rotation_vector(step_q))
        bias_trans = length * (c[joint.BIAS_TRANS] + c[joint.WANDER_TRANS])
        bias_rot = length * (c[joint.BIAS_ROT] + c[joint.WANDER_ROT]) + c[joint.LOG_TURN] * omega
        half = -0.5 * hat(bias_rot)
        expected = self._rotation @ rotation_matrix(step_q)
        rotation = expected @ rotation_exp(bias_rot)
        # Exp's translation, to the second order of an edge's mean noise.
        position = self._position + (1.0 + c[joint.WANDER_SCALE]) * moved + expected @ (bias_trans - half @ bias_trans)
        on_trans = rotation + rotation @ half  # R J
        coupling = rotation @ (-0.5 * hat(bias_trans))  # R Q
        self._grow(position - self._position, moved, on_trans, coupling, omega, length, turn)
        self._position, self._rotation = position, rotation

    def _forget(self, length: float) -> None:
        v = self._variances
        rho = math.exp(-length / v.correlation_m)
        self._constants[_WANDER] *= rho
        self._covariance[_WANDER] *= rho
        self._covariance[:, _WANDER] *= rho
        index = np.arange(_WANDER.start, _WANDER.stop)
        self._covariance[index, index] += (1.0 - rho * rho) * v.forgetting

    def _grow(
        self,
        step: Float[np.ndarray, "3"],
        scaled: Float[np.ndarray, "3"],
        on_trans: Float[np.ndarray, "3 3"],
        coupling: Float[np.ndarray, "3 3"],
        omega: Float[np.ndarray, "3"],
        length: float,
        turn: float,
    ) -> None:
        """`P <- F P F' + G Q G'`: only the six rows of the pose change."""
        move = np.zeros((6, joint.N_ERRORS))
        move[:3, :3] = move[3:, 3:6] = np.eye(3)
        move[:3, 3:6] = -hat(step)
        for trans, rot, scale in (
            (joint.BIAS_TRANS, joint.BIAS_ROT, joint.LOG_SCALE),
            (joint.WANDER_TRANS, joint.WANDER_ROT, joint.WANDER_SCALE),
        ):
            move[:3, trans] = move[3:, rot] = length * on_trans
            move[:3, rot] = length * coupling
            move[:3, scale] = scaled
        move[:3, joint.LOG_TURN], move[3:, joint.LOG_TURN] = coupling @ omega, on_trans @ omega
        v = self._variances
        white_rot = v.rot * length + v.turn * turn
        onto = np.zeros((6, 6))
        onto[:3, :3] = onto[3:, 3:] = on_trans
        onto[:3, 3:] = coupling
        drawn = (onto * np.concatenate([v.trans * length, white_rot])) @ onto.T
        p = self._covariance
        row = move @ p
        own = row @ move.T + drawn
        p[:6, 6:] = row[:, 6:]
        p[6:, :6] = row[:, 6:].T
        p[:6, :6] = 0.5 * (own + own.T)

    def pose(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "6 6"]]:
        """Position (local frame, metres), rotation, and their covariance: position added, rotation on the left."""
        p, bounded = self._covariance, joint.BOUNDED
        covariance = p[:6, :6].copy()
        covariance[:3] += p[bounded, :6]
        covariance[:, :3] += p[:6, bounded]
        covariance[:3, :3] += p[bounded, bounded]
        return self._position + self._constants[bounded], self._rotation, covariance


def hat(v: Sequence[float] | Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Cross-product matrix."""
    x, y, z = float(v[0]), float(v[1]), float(v[2])
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_matrix(quat_wxyz: Sequence[float]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a unit quaternion; SciPy's takes ten times as long for a single one."""
    w, x, y, z = quat_wxyz
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    return np.array(
        [
            [1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)],
            [2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)],
            [2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)],
        ]
    )


def rotation_exp(w: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a rotation vector."""
    angle = math.sqrt(float(w @ w))
    if angle == 0.0:
        return np.eye(3)
    sine = math.sin(0.5 * angle) / angle
    return rotation_matrix((math.cos(0.5 * angle), sine * float(w[0]), sine * float(w[1]), sine * float(w[2])))
