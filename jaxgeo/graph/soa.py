"""3-vectors, 3x3 matrices and quaternions as tuples of components, each component an (n,) vector.

XLA then vectorises over the n poses; arrays of shape (n, 3, 3) were 2.5 times slower on the same step.
A vector is a tuple of 3, a matrix a tuple of 3 rows, a quaternion a tuple (w, x, y, z).
"""

from jaxtyping import Array

Vec3 = tuple[Array, Array, Array]
Mat3 = tuple[Vec3, Vec3, Vec3]
Quat = tuple[Array, Array, Array, Array]


def add(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(s: Array, a: Vec3) -> Vec3:
    return (s * a[0], s * a[1], s * a[2])


def mul(a: Vec3, b: Vec3) -> Vec3:
    """Component by component."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


def dot(a: Vec3, b: Vec3) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def matvec(m: Mat3, a: Vec3) -> Vec3:
    return (dot(m[0], a), dot(m[1], a), dot(m[2], a))


def transpose(m: Mat3) -> Mat3:
    return ((m[0][0], m[1][0], m[2][0]), (m[0][1], m[1][1], m[2][1]), (m[0][2], m[1][2], m[2][2]))


def matmul(a: Mat3, b: Mat3) -> Mat3:
    c = transpose(b)
    return tuple(tuple(dot(row, col) for col in c) for row in a)  # type: ignore[return-value]


def mat_add(a: Mat3, b: Mat3) -> Mat3:
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def scale_columns(m: Mat3, s: Vec3) -> Mat3:
    """`m diag(s)`."""
    return (mul(m[0], s), mul(m[1], s), mul(m[2], s))


def hat_matmul(t: Vec3, m: Mat3) -> Mat3:
    """`[t]x m`: the cross product of t with every column of m."""
    return transpose(tuple(cross(t, column) for column in transpose(m)))  # type: ignore[arg-type]


def quat_mul(p: Quat, q: Quat) -> Quat:
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


def quat_conj(q: Quat) -> Quat:
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quat, a: Vec3) -> Vec3:
    """Rotate a by the unit quaternion q."""
    u = (q[1], q[2], q[3])
    t = scale(2.0, cross(u, a))  # type: ignore[arg-type]
    return add(add(a, scale(q[0], t)), cross(u, t))


def quat_matrix(q: Quat) -> Mat3:
    """Rotation matrix of a unit quaternion."""
    w, x, y, z = q
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    return (
        (1 - yy - zz, xy - wz, xz + wy),
        (xy + wz, 1 - xx - zz, yz - wx),
        (xz - wy, yz + wx, 1 - xx - yy),
    )
