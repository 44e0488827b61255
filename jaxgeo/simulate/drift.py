"""What odometry makes of a true motion."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from jaxgeo.errors import InputError
from jaxgeo.simulate.course import Course
from jaxgeo.simulate.prefix import chain, gauss_markov

Axes = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class LoopClosure:
    """A place recognised: the relative pose of two visits is measured, and the path between them bent to fit.

    Attributes:
        first, second: visits, counted from 1; the first is the earlier.
        sigma_trans_m, sigma_rot_rad: of the measured relative pose, each axis.
    """

    first: int
    second: int
    sigma_trans_m: float = 0.0
    sigma_rot_rad: float = 0.0


@dataclasses.dataclass(frozen=True)
class Drift:
    """The errors of one odometry, body axes; what is constant is given, what is random is drawn.

    Attributes:
        sigma_trans_m_per_sqrt_m, sigma_rot_rad_per_sqrt_m: white noise by distance.
        sigma_turn_rad_per_sqrt_rad: white rotation noise by turned angle.
        bias_trans_m_per_m, bias_rot_rad_per_m: constant over the session.
        log_scale: the odometry's translations are exp(-log_scale) times the true ones.
        wander_trans_m_per_m, wander_rot_rad_per_m, wander_log_scale: standard deviations of biases and of a scale error
            that change along the path: first-order Gauss-Markov.
        wander_correlation_m: the way in which they forget all but 1/e.
        student_dof: the white noise of each step is Student-t with these degrees of freedom, all six axes of a step
            together (a bad step is bad in all), of the same variance; infinite: normal.
        closures: bent into the finished chain, one after the other.
        draws_of: the trajectory whose white noise and wander this one has, too: a map built on that odometry.

    Raises:
        InputError: degrees of freedom of 2 or fewer, a wander without correlation length, a closure back to front.
    """

    sigma_trans_m_per_sqrt_m: Axes = (0.0, 0.0, 0.0)
    sigma_rot_rad_per_sqrt_m: Axes = (0.0, 0.0, 0.0)
    sigma_turn_rad_per_sqrt_rad: float = 0.0
    bias_trans_m_per_m: Axes = (0.0, 0.0, 0.0)
    bias_rot_rad_per_m: Axes = (0.0, 0.0, 0.0)
    log_scale: float = 0.0
    wander_trans_m_per_m: Axes = (0.0, 0.0, 0.0)
    wander_rot_rad_per_m: Axes = (0.0, 0.0, 0.0)
    wander_log_scale: float = 0.0
    wander_correlation_m: float = 0.0
    student_dof: float = math.inf
    closures: tuple[LoopClosure, ...] = ()
    draws_of: str = ""

    def __post_init__(self) -> None:
        if not self.student_dof > 2:
            raise InputError(f"student_dof: {self.student_dof:g}; a variance needs more than 2 degrees of freedom.")
        if self.wanders and not self.wander_correlation_m > 0:
            raise InputError("wander_correlation_m: 0; expected the way, in metres, over which the wander forgets.")
        for closure in self.closures:
            if not 1 <= closure.first < closure.second:
                raise InputError(
                    f"loop closure of visits {closure.first} and {closure.second}: expected the earlier first, counted "
                    "from 1."
                )

    @property
    def wanders(self) -> bool:
        return any((*self.wander_trans_m_per_m, *self.wander_rot_rad_per_m, self.wander_log_scale))


def drifting_steps(course: Course, drift: Drift, seed: np.random.SeedSequence) -> RigidTransform:
    """Odometry steps `O_k` with `T_{k+1} = T_k O_k Exp(e_k)`: e_k is what the odometry missed.

    A step of length d and turn a has white noise of variance `sigma_trans^2 d` and `sigma_rot^2 d + sigma_turn^2 a`,
    and a bias, constant and wandering, in proportion to d. Each source draws from a stream of its own below `seed`.
    """
    length_m, turn_rad = course.length_m[:, None], course.turn_rad[:, None]
    white = np.random.default_rng(seed).standard_normal((len(length_m), 6))
    if math.isfinite(drift.student_dof):
        chi_square = child(seed, 0).chisquare(drift.student_dof, (len(length_m), 1))
        white *= np.sqrt((drift.student_dof - 2.0) / chi_square)
    sigma_rot = np.sqrt(
        np.square(drift.sigma_rot_rad_per_sqrt_m) * length_m + drift.sigma_turn_rad_per_sqrt_rad**2 * turn_rad
    )
    trans = white[:, :3] * np.asarray(drift.sigma_trans_m_per_sqrt_m) * np.sqrt(length_m)
    rot = white[:, 3:] * sigma_rot
    wander = _wander(course, drift, child(seed, 1))
    trans = trans + (np.asarray(drift.bias_trans_m_per_m) + wander[:, :3]) * length_m
    rot = rot + (np.asarray(drift.bias_rot_rad_per_m) + wander[:, 3:6]) * length_m
    # SciPy's exponential coordinates are rotation first.
    missed = RigidTransform.from_exp_coords(np.hstack([rot, trans]))
    seen = course.step * missed.inv()
    return RigidTransform.from_components(
        seen.translation * np.exp(-drift.log_scale - wander[:, 6:]),
        seen.rotation,
    )


def drifting_poses(
    course: Course, drift: Drift, seed: np.random.SeedSequence, own_seed: np.random.SeedSequence | None = None
) -> RigidTransform:
    """The trajectory that this odometry makes of the course, in a map of its own, loop closures bent in.

    Args:
        seed: of white noise and wander; `own_seed` of the closures, default the same.

    Raises:
        InputError: a closure with a visit that the course does not have.
    """
    poses = chain(drifting_steps(course, drift, seed))
    random = child(seed if own_seed is None else own_seed, 2)
    for closure in drift.closures:
        if closure.second > len(course.visit_pose):
            raise InputError(f"loop closure with visit {closure.second}: there are {len(course.visit_pose)} visits.")
        poses = bent(poses, course, closure, random)
    return poses


def bent(poses: RigidTransform, course: Course, closure: LoopClosure, random: np.random.Generator) -> RigidTransform:
    """The trajectory with the relative pose of two visits as measured.

    With C the motion, in the map, that takes the second visit's pose to where the measurement wants it, the poses
    between the visits become Exp(s log C) T, s the share of the way from leaving the one to arriving at the other, and
    the later ones C T: nothing jumps, and no visit is bent in itself.
    """
    first, second = closure.first - 1, closure.second - 1
    a, b = course.visit_pose[[first, second]].tolist()
    sigma = np.repeat([closure.sigma_rot_rad, closure.sigma_trans_m], 3)
    measured = course.pose[a].inv() * course.pose[b] * RigidTransform.from_exp_coords(sigma * random.standard_normal(6))
    correction = (poses[a] * measured * poses[b].inv()).as_exp_coords()
    start_m, end_m = course.leave_m[first], course.arrive_m[second]
    share = np.clip((course.distance_m - start_m) / (end_m - start_m), 0.0, 1.0)
    return RigidTransform.from_exp_coords(share[:, None] * correction) * poses


def child(seed: np.random.SeedSequence, *key: int) -> np.random.Generator:
    """A stream of its own below a seed, the same however often it is asked for."""
    return np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key)))


def _wander(course: Course, drift: Drift, random: np.random.Generator) -> Float[np.ndarray, "m 7"]:
    """Bias of translation (3) and of rotation (3) per metre, and log-scale, of every step."""
    if not drift.wanders:
        return np.zeros((len(course.length_m), 7))
    sigma = np.array([*drift.wander_trans_m_per_m, *drift.wander_rot_rad_per_m, drift.wander_log_scale])
    unit = random.standard_normal((len(course.length_m), 7))
    # From the middle of one step to that of the next.
    between_m = 0.5 * (course.length_m + np.concatenate([[0.0], course.length_m[:-1]]))
    return sigma * gauss_markov(between_m, drift.wander_correlation_m, unit)
