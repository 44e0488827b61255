"""The loop-closed keyframes: odometry and closures in one pose graph."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.geometry import poses_at
from jaxgeo.geometry.rigid import adjoint, inverse, log, matrices, parts, trajectory_matrices
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.keyframe_graph import (
    SolvedKeyframes,
    carried_covariance,
    chain_and,
    covariance_between,
    solve_keyframes,
    squared_residuals,
)
from jaxgeo.mapping.keyframes import Keyframes
from jaxgeo.solve.closure_graph import ClosureSettings

# Errors of odometry that nothing is known of, as multiples of the assumed noise.
_FACTORS = tuple(float(2.0 ** (k / 2)) for k in range(13))
# Chi-squared with six degrees of freedom: median, and 99.9 %.
_CHI2_6_MEDIAN = 5.348
_CHI2_6 = 22.46
_NEIGHBOURHOOD = 10  # keyframes
_HUSH = 1e-9  # factor on the information of closures that are not to be heard


@dataclasses.dataclass(frozen=True)
class LoopClosed:
    """Solved keyframes.

    Attributes:
        T_map_body: (k, 4, 4); the first is where it was.
        edges: odometry (k - 1), neighbours, then closures, with the information they were solved with.
        weight: (c,) of every closure, 0 rejected .. 1 accepted.
        chi2_before, chi2_after: (c,) squared whitened residuals of the closures.
        cost_before, cost_after: half chi-squared of odometry and accepted closures.
        noise_factor: the odometry's sigmas were multiplied by this.
        result: how the solve ended; "converged" or why not.
    """

    T_map_body: Float[np.ndarray, "k 4 4"]
    edges: RelativePoses
    weight: Float[np.ndarray, "c"]
    chi2_before: Float[np.ndarray, "c"]
    chi2_after: Float[np.ndarray, "c"]
    cost_before: float
    cost_after: float
    noise_factor: float
    result: str


def close_loops(
    T_map_body: Float[np.ndarray, "k 4 4"],
    covariance: Float[np.ndarray, "e 6 6"],
    closures: Sequence[Closure],
    settings: ClosureSettings,
    *,
    neighbours: Sequence[Closure] = (),
    start: Float[np.ndarray, "k 4 4"] | None = None,
) -> LoopClosed:
    """Solve keyframes, odometry and closures; the robust loss decides which closures count.

    How far odometry of unknown quality drifts is not known beforehand: its sigmas are first multiplied by what the
    closures that support one another ask for (`noise_factor`), never divided.

    Truncated least squares has many minima, and odometry far from closed may lie in the basin of the one that rejects
    every closure. So it is begun twice, at the odometry and where the supported closures alone lead without any loss;
    the cheaper result counts.

    Args:
        T_map_body: keyframes by the odometry.
        covariance: of its edges.
        neighbours: registrations of keyframes next to one another: they do not drift as the odometry does, and keep
            their own covariance.
        start: better poses to start from.
    """
    supported = support(T_map_body, covariance, closures)
    factor = noise_factor(T_map_body, covariance, [c for c, other in zip(closures, supported, strict=True) if other])
    edges = chain_and(T_map_body, covariance * factor**2, [*neighbours, *closures])
    begun = T_map_body if start is None else start
    odometry = len(covariance) + len(neighbours)
    solved = _better(begun, edges, np.concatenate([np.ones(odometry), supported]), settings)
    weight = solved.weight[odometry:]
    before, after = squared_residuals(begun, edges), squared_residuals(solved.T_map_body, edges)
    counted = np.concatenate([np.ones(odometry), weight])
    return LoopClosed(
        solved.T_map_body,
        edges,
        weight,
        before[odometry:],
        after[odometry:],
        0.5 * float(counted @ before),
        0.5 * float(counted @ after),
        factor,
        solved.result,
    )


def _better(
    begun: Float[np.ndarray, "k 4 4"],
    edges: RelativePoses,
    believed: Float[np.ndarray, "m"],
    settings: ClosureSettings,
) -> SolvedKeyframes:
    solved = solve_keyframes(begun, edges, settings)
    if settings.loss != "gnc" or solved.weight.min() > 0.5:
        return solved
    hushed = dataclasses.replace(edges, information=edges.information * np.maximum(believed, _HUSH)[:, None, None])
    led = solve_keyframes(begun, hushed, dataclasses.replace(settings, loss="none"))
    other = solve_keyframes(led.T_map_body, edges, settings)
    return min((solved, other), key=lambda one: one.cost if one.result == "converged" else np.inf)


def noise_factor(
    T_map_body: Float[np.ndarray, "k 4 4"], covariance: Float[np.ndarray, "e 6 6"], supported: Sequence[Closure]
) -> float:
    """The least factor on the odometry's sigmas with which the closures are as likely as not, 1 to 64.

    A closure's innovation `Log(Z^-1 T_first^-1 T_second)` has the covariance of the odometry between its ends plus its
    own. Their median is compared with that of chi-squared with six degrees of freedom.

    Args:
        supported: closures that another one supports; one alone may be false, and nothing is learned from it.
    """
    if not supported:
        return 1.0
    carried = carried_covariance(T_map_body, covariance)
    errors, odometry, own = [], [], []
    for c in supported:
        errors.append(log(inverse(c.T_first_second) @ inverse(T_map_body[c.first]) @ T_map_body[c.second]))
        odometry.append(covariance_between(T_map_body, carried, c.first, c.second))
        own.append(np.linalg.inv(c.information))
    error = np.stack(errors)
    for factor in _FACTORS:
        innovation = factor**2 * np.stack(odometry) + np.stack(own)
        chi2 = np.einsum("ma,ma->m", error, np.linalg.solve(innovation, error[..., None])[..., 0])
        if np.median(chi2) <= _CHI2_6_MEDIAN:
            return factor
    return _FACTORS[-1]


def support(
    T_map_body: Float[np.ndarray, "k 4 4"], covariance: Float[np.ndarray, "e 6 6"], closures: Sequence[Closure]
) -> list[bool]:
    """Whether another closure between neighbouring keyframes says the same.

    Two closures (i, j) and (k, l) and the odometry from i to k and from j to l make a loop of short edges, whose error
    does not depend on the drift between the two visits (pairwise consistency: Mangelson et al., ICRA 2018). Closures
    of the very same keyframe pair do not support one another, nor do those that do not share a neighbourhood.
    """
    carried = carried_covariance(T_map_body, 4.0 * covariance)
    found = [False] * len(closures)
    for a, one in enumerate(closures):
        for b in range(a + 1, len(closures)):
            two = closures[b]
            apart = max(abs(one.first - two.first), abs(one.second - two.second))
            if (found[a] and found[b]) or apart > _NEIGHBOURHOOD or one.second == two.second:
                continue
            to_first = inverse(T_map_body[one.first]) @ T_map_body[two.first]
            to_second = inverse(T_map_body[one.second]) @ T_map_body[two.second]
            error = log(inverse(one.T_first_second @ to_second) @ to_first @ two.T_first_second)
            back = adjoint(inverse(to_second))
            spread = (
                back @ np.linalg.inv(one.information) @ back.T
                + np.linalg.inv(two.information)
                + covariance_between(T_map_body, carried, *sorted((one.second, two.second)))
                + covariance_between(T_map_body, carried, *sorted((one.first, two.first)))
            )
            if error @ np.linalg.solve(spread, error) < _CHI2_6:
                found[a] = found[b] = True
    return found


def carried_to_all(trajectory: Trajectory, keyframes: Keyframes, solved: Float[np.ndarray, "k 4 4"]) -> Trajectory:
    """All poses, moved as the keyframes about them were.

    The correction `T_solved T_odometry^-1` of each keyframe, a motion of the map, is interpolated on SE(3) between
    them; before the first and after the last it is held.
    """
    if len(keyframes) == 1:
        return trajectory
    correction = solved @ inverse(keyframes.T_map_body)
    at = np.clip(trajectory.stamp_s, keyframes.stamp_s[0], keyframes.stamp_s[-1])
    between_keyframes = poses_at(Trajectory(keyframes.stamp_s, *parts(correction)), at)
    moved = matrices(between_keyframes.position_m, between_keyframes.quat_wxyz) @ trajectory_matrices(trajectory)
    return Trajectory(trajectory.stamp_s, *parts(moved))
