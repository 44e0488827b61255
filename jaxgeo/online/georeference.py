"""Georeferencing while the robot moves: odometry and sightings in, the current pose and its covariance out."""

import collections
import dataclasses
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.centroid import CentroidRule
from jaxgeo.data import Anchors, Sightings, Survey
from jaxgeo.errors import ConvergenceError, JaxgeoError, TrajectoryError, UndeterminedError
from jaxgeo.georef import LocalFrame
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.bucket import anchor_bucket, pose_bucket
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.online.anchor_log import AnchorLog, Labels, padded
from jaxgeo.online.drift_state import DriftState, DriftVariances
from jaxgeo.online.estimators import Answer, estimator_of
from jaxgeo.online.frame_known import NOTHING_YET, undetermined_words
from jaxgeo.online.online_pose import OnlinePose, OnlineResult, Status, Update
from jaxgeo.online.pose_log import PoseLog
from jaxgeo.online.rehearsal import rehearsal, rehearse_interpolation
from jaxgeo.online.settings import OnlineSettings
from jaxgeo.online.sighting_checks import check_sightings, one_sighting
from jaxgeo.online.visit_log import VisitLog
from jaxgeo.online.warm_start import Given, LastSolution
from jaxgeo.precision import assert_float64


class OnlineGeoreference:
    """Push poses and sightings as they come; `update` after each, `current` whenever the pose is wanted.

    `push_odometry`, `push_sightings` and `current` take a fraction of a millisecond, at any length. `update` does as
    well until a visit has ended; then it makes its anchor and solves the graph of all poses and anchors, from the last
    solution on. `finish` gives the whole trajectory, equal to the batch answer. Not for several threads at once.
    """

    def __init__(
        self,
        survey: Survey,
        frame: LocalFrame,
        noise: OdometryNoise | NoiseEnsemble,
        settings: OnlineSettings | None = None,
        rule: CentroidRule | None = None,
    ) -> None:
        """
        Raises:
            SightingError: `gap_s`, `min_count` or `labels` cannot be.
        """
        assert_float64()
        self.settings = settings or OnlineSettings()
        self._survey, self._frame, self._noise, self._rule = survey, frame, noise, rule
        self._poses = PoseLog(pose_bucket(self.settings.capacity))
        self._visits = VisitLog(self.settings.gap_s, self.settings.min_count)
        self._log = AnchorLog(survey, frame.origin_enh_m, self.settings.labels, rule)
        # One row of padding is always there: the last pose's share of the small system.
        self._room = anchor_bucket(self.settings.capacity_anchors + 1)
        self._estimator = estimator_of(noise, self.settings.solve)
        self._variances = DriftVariances(noise)
        self._anchors: Anchors | None = None
        self._answer: Answer | None = None
        self._drift: DriftState | None = None
        self._status: Status = "undetermined"
        self._words = NOTHING_YET
        self._unknown: collections.Counter[str] = collections.Counter()
        self._grown: list[str] = []

    def warm_up(self) -> None:
        """Compile everything that a session within the capacity needs; seconds to a minute, before the first pose."""
        made = rehearsal(self.settings.gap_s, self._frame.origin_enh_m, self._survey.crs)
        settings = dataclasses.replace(self.settings, labels=Labels(), min_count=1)
        twin = OnlineGeoreference(made.survey, self._frame, self._noise, settings, self._rule)
        rows = zip(made.trajectory.stamp_s, made.trajectory.position_m, made.trajectory.quat_wxyz, strict=True)
        for i, row in enumerate(rows):
            twin.push_odometry(*row)
            twin.push_sightings(made.sightings.take(np.array([i])))
            twin.update()
            twin.current()
        twin.finish()
        assert twin._anchors is not None
        # Asked where the steps on the way do not settle.
        twin._estimator.solve(twin._given(twin._anchors), None, final=True)
        rehearse_interpolation(made.trajectory)

    def push_odometry(self, stamp_s: float, position_m: Sequence[float], quat_wxyz: Sequence[float]) -> None:
        """The next pose of the drifting trajectory, `T_map_body`.

        Raises:
            TrajectoryError: it is no pose, or not after the last one; nothing is kept of it.
        """
        if len(self._poses) == self._poses.capacity:
            self._grow_poses()
        column = self._poses.push(stamp_s, position_m, quat_wxyz)
        if self._drift is not None:
            self._drift.push(column)

    def push_sighting(
        self,
        stamp_s: float,
        marker: str,
        t_body_marker_m: Sequence[float],
        covariance: Float[np.ndarray, "3 3"] | Float[np.ndarray, "6 6"],
        quat_body_marker_wxyz: Sequence[float] | None = None,
        *,
        ambiguous: bool = False,
    ) -> None:
        """One sighting; see `Sightings` for the frames. Raises as `push_sightings` does."""
        self.push_sightings(
            one_sighting(stamp_s, marker, t_body_marker_m, covariance, quat_body_marker_wxyz, ambiguous)
        )

    def push_sightings(self, sightings: Sightings) -> None:
        """Sightings in any order, early or late. Ids without a surveyed location are counted, see `warnings`.

        Raises:
            SightingError: one cannot be used; nothing is kept of any.
        """
        labels = self.settings.labels
        check_sightings(sightings, by_order=labels.order is not None)
        known = np.array([labels.known(str(marker), self._survey) for marker in sightings.marker], dtype=bool)
        self._unknown.update(str(marker) for marker in sightings.marker[~known])
        if known.any():
            self._visits.push(sightings.take(np.flatnonzero(known)))

    def update(self, *, close_open: bool = False) -> Update | None:
        """Make anchors of the visits that have ended, and solve; None where none has.

        Args:
            close_open: use the visits that may still go on, too; their later sightings will change them.

        Raises:
            SightingError: more visits than the order names; the last answer is carried on, marked stale.
        """
        if len(self._poses) < 2 or not self._visits.close(math.inf if close_open else self._poses.last_s):
            return None
        return self._solve(final=False)

    def current(self) -> OnlinePose:
        """The newest pose: the last solution carried on by the odometry since."""
        stamp_s = self._poses.last_s
        count = 0 if self._anchors is None else len(self._anchors)
        age_s = math.inf if self._anchors is None else stamp_s - float(self._anchors.stamp_s[-1])
        if self._drift is None:
            none = np.full(3, np.nan)
            return OnlinePose(
                stamp_s,
                "undetermined",
                self._words,
                none,
                none,
                np.full(4, np.nan),
                np.full((6, 6), np.nan),
                count,
                age_s,
            )
        position, rotation, covariance = self._drift.pose()
        quat = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        enh = self._frame.to_grid(position)
        return OnlinePose(stamp_s, self._status, self._words, position, enh, quat, covariance, count, age_s)

    def finish(self) -> OnlineResult:
        """The whole trajectory with all visits, open ones too; solved to the optimum. More may follow.

        Raises:
            TrajectoryError: fewer than two poses.
            SightingError: more visits than the order names.
            UndeterminedError: the anchors do not fix the frame.
            ConvergenceError: the solver stopped early.
        """
        if len(self._poses) < 2:
            raise TrajectoryError(f"{len(self._poses)} pose(s) were pushed; expected at least 2.")
        self._visits.close(math.inf)
        self._solve(final=True)
        if self._drift is None or self._status == "undetermined":
            raise UndeterminedError(self._words)
        if self._status == "stale":
            raise ConvergenceError(self._words)
        assert self._anchors is not None
        assert self._answer is not None
        given = self._given(self._anchors)
        corrected, covariance, log_scale = self._estimator.whole(self._answer, self._poses.trajectory(), given)
        return OnlineResult(corrected, covariance, self._anchors, log_scale)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know so far: one sentence each, with the counts of this moment."""
        said = [
            f"marker {marker!r} has no surveyed location; its {count} sighting(s) are left out."
            for marker, count in sorted(self._unknown.items())
        ]
        if self._log.outside:
            said.append(
                f"{self._log.outside} of {len(self._visits)} sightings lie outside the odometry's time, "
                f"{self._poses.first_s:.3f} to {self._poses.last_s:.3f} s, and are left out. Are the clocks the same?"
            )
        return (*said, *dict.fromkeys(self._log.said), *self._grown)

    @property
    def open_visits(self) -> int:
        """Visits that have not ended."""
        return self._visits.open_count

    @property
    def anchors(self) -> Anchors | None:
        """The visits in use."""
        return self._anchors

    def _solve(self, *, final: bool) -> Update:
        try:
            anchors = self._log.anchors(self._visits.visits(), self._visits, self._poses.trajectory())
        except JaxgeoError as error:
            self._set("stale" if self._drift is not None else "undetermined", str(error))
            raise
        if anchors is None:
            self._set("undetermined", NOTHING_YET)
            return Update(0, (), self._status, self._words, 0)
        new = _changed(self._anchors, anchors)
        if not (new or final):
            return Update(len(anchors), new, self._status, self._words, 0)
        self._anchors = anchors
        if len(anchors) >= self._room:
            self._grow_anchors(len(anchors))
        answer = self._answered(self._given(anchors), final)
        if not bool(answer.known.determined):
            self._set("undetermined" if self._drift is None else "stale", undetermined_words(anchors, answer.known))
            return Update(len(anchors), new, self._status, self._words, 0)
        if answer.converged:
            self._answer, self._drift = answer, DriftState(answer.last_pose, self._variances)
            self._set("georeferenced", "")
        else:
            self._set(
                "undetermined" if self._drift is None else "stale",
                f"the solve with {len(anchors)} anchors did not converge: {answer.words} after {answer.steps} steps. "
                "The last answer is carried on. Check the newest anchors' labels, or the odometry noise.",
            )
        return Update(len(anchors), new, self._status, self._words, answer.steps)

    def _answered(self, given: Given, final: bool) -> Answer:
        """From the last solution; as the batch job does, from the coarse fit, where that fails or has two optima."""
        last: LastSolution | None = None if self._answer is None else self._answer.last
        if final and self.settings.solve.loss != "none":
            last = None
        answer = self._estimator.solve(given, last, final=final)
        if bool(answer.known.determined) and not answer.converged and not (final and last is None):
            answer = self._estimator.solve(given, None, final=True)
        return answer

    def _given(self, anchors: Anchors) -> Given:
        poses = self._poses
        rows, real = padded(anchors, self._room, poses.capacity - 1)
        table = anchor_table(rows, poses.chain(), self.settings.solve.extra_sigma_m)
        # A copy: the log's memory changes with the next pose.
        columns = jnp.array(poses.columns, copy=True)
        table = dataclasses.replace(table, real=jnp.asarray(real))
        return Given(columns, jnp.asarray(len(poses)), jnp.asarray(poses.origin_m), table)

    def _set(self, status: Status, words: str) -> None:
        self._status, self._words = status, words

    def _grow_poses(self) -> None:
        before = self._poses.capacity
        self._poses.grow(pose_bucket(2 * before))
        if self._answer is not None:
            more = self._poses.capacity - before
            last = self._answer.last
            poses = jax.tree.map(lambda c: jnp.pad(c, (0, more), mode="edge"), last.poses)
            self._answer = dataclasses.replace(self._answer, last=dataclasses.replace(last, poses=poses))
        self._grown.append(
            f"more than {before} poses: room for {self._poses.capacity} was made, and the next solve compiles for it "
            "(seconds). Set a larger capacity."
        )

    def _grow_anchors(self, count: int) -> None:
        before = self._room - 1
        self._room = anchor_bucket(2 * count)
        self._grown.append(
            f"more than {before} anchors: room for {self._room - 1} was made, and the solve compiles for it (seconds). "
            "Set a larger capacity_anchors."
        )


def _changed(before: Anchors | None, after: Anchors) -> tuple[str, ...]:
    """Labels of the anchors that were not there with these sightings."""
    old = set() if before is None else set(zip(before.label, before.pose_index, before.count, strict=True))
    rows = zip(after.label, after.pose_index, after.count, strict=True)
    return tuple(row[0] for row in rows if row not in old)
