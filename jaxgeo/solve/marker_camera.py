"""One camera's projection in JAX, both distortion models in one formula that a mask chooses from."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxgeo.data import Camera

N_GLOBALS = 5
"""Unknowns of a camera that is refined: log of the focal scale, cx and cy [px], k1, k2."""

_NEAREST_M = 1e-3  # a point behind the camera projects from here: far outside, so that such a step is rejected


class Lens(eqx.Module):
    """Intrinsics (fx, fy, cx, cy), five coefficients (unused ones zero) and which model they are of."""

    intrinsics_px: Float[Array, "*b 4"]
    distortion: Float[Array, "*b 5"]
    fisheye: Bool[Array, "*b"]


def lens_parts(camera: Camera) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "5"], bool]:
    """Intrinsics, coefficients filled up with zeros, and whether the model is equidistant."""
    coefficients = np.zeros(5)
    coefficients[: camera.distortion.size] = camera.distortion
    return camera.intrinsics_px, coefficients, camera.distortion_model == "equidistant"


def lens_at(lens: Lens, change: Float[Array, "5"]) -> Lens:
    """The lens with its focal lengths, principal point, k1 and k2 changed."""
    scale, one = jnp.exp(change[0]), jnp.ones(())
    by = jnp.stack([scale, scale, one, one])
    zero = jnp.zeros(())
    shift = jnp.stack([zero, zero, change[1], change[2]])
    bend = jnp.stack([change[3], change[4], zero, zero, zero])
    return Lens(
        lens.intrinsics_px * jnp.broadcast_to(by, lens.intrinsics_px.shape)
        + jnp.broadcast_to(shift, lens.intrinsics_px.shape),
        lens.distortion + jnp.broadcast_to(bend, lens.distortion.shape),
        lens.fisheye,
    )


def project(point_cam_m: Float[Array, "3"], lens: Lens) -> Float[Array, "2"]:
    """Pixel of one point in the camera's optical axes.

    Radtan: OpenCV's Brown-Conrady formula (k1, k2, p1, p2, k3); equidistant: Kannala & Brandt 2006 (k1 .. k4).
    """
    z = jnp.maximum(point_cam_m[2], _NEAREST_M)
    x, y = point_cam_m[0] / z, point_cam_m[1] / z
    r2 = x * x + y * y
    k = lens.distortion
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    x_rad = x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x)
    y_rad = y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y
    bend = _equidistant_factor(r2, k)
    x_d, y_d = jnp.where(lens.fisheye, x * bend, x_rad), jnp.where(lens.fisheye, y * bend, y_rad)
    fx, fy, cx, cy = lens.intrinsics_px
    return jnp.stack([fx * x_d + cx, fy * y_d + cy])


def _equidistant_factor(r2: Float[Array, ""], k: Float[Array, "5"]) -> Float[Array, ""]:
    """Distorted angle over tan(angle), regular on the axis."""
    near = r2 < 1e-10
    r = jnp.sqrt(jnp.where(near, 1.0, r2))
    angle = jnp.arctan(r)
    a2 = jnp.where(near, r2, angle * angle)
    polynomial = 1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])))
    return jnp.where(near, 1.0 - r2 / 3.0, angle / r) * polynomial
