"""One trajectory, its visits and what is known beforehand: what stays the same while corrections are searched for."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from calibration.calibrate import LearnSettings, learn_options
from calibration.corrections_between import Between, CorrectionStep, correction_step, first_state
from calibration.learn import FamilyPriorArrays, LearnOptions, prior_arrays
from jaxgeo.associate import make_anchors
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory, Visit
from jaxgeo.errors import SightingError
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.solve.anchor_system import State
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import N_CORRECTIONS, TIME, CorrectionPrior, compose, corrected_sightings, visits_within
from jaxgeo.solve.corrections_within import Within, WithinInformation, within_information, within_visits
from jaxgeo.solve.gauge import determined, gauge_covariance


@dataclasses.dataclass(frozen=True)
class Problem:
    """What the corrections are estimated from.

    Attributes:
        visits: without the sightings that an offset could move out of the trajectory's time.
        origin_enh_m: of the local frame.
        fixes_frame: whether the anchors alone fix the frame; where not, only single visits are asked.
    """

    trajectory: Trajectory
    sightings: Sightings
    visits: tuple[Visit, ...]
    survey: Survey
    origin_enh_m: Float[np.ndarray, "3"]
    settings: Settings
    prior: CorrectionPrior
    family: FamilyPriorArrays
    options: LearnOptions
    chain: Chain
    fixes_frame: bool

    @property
    def sigma(self) -> Float[np.ndarray, "7"]:
        return self.prior.sigma

    def composed(self, value: Float[np.ndarray, "7"], difference_s: float) -> Within:
        """The sightings of single visits at these corrections."""
        return within_visits(self.trajectory, self.sightings, self.visits, value, difference_s)

    def asked_within(
        self, value: Float[np.ndarray, "7"], difference_s: float, log_sigma: Float[np.ndarray, "5"] | None
    ) -> WithinInformation:
        """What single visits say of a step from these corrections; the search for their noise starts at `log_sigma`."""
        return within_information(self.composed(value, difference_s), -value, self.sigma, log_sigma)

    def asked_between(
        self,
        value: Float[np.ndarray, "7"],
        difference_s: float,
        before: Between,
        theta: Array | None,
        state: State | None,
    ) -> CorrectionStep:
        """What the survey says, from anchors made at these corrections; `theta`, `state` of the step before."""
        anchors = corrected_anchors(
            self.trajectory, self.sightings, self.visits, self.survey, value, origin_enh_m=self.origin_enh_m
        )[0]
        table = anchor_table(anchors, self.chain, self.settings.extra_sigma_m)
        influence = np.zeros((table.real.shape[0], 3, N_CORRECTIONS))
        influence[: len(anchors)] = lever_arm_derivative(
            self.trajectory, self.sightings, self.visits, anchors, value, difference_s
        )
        width = jnp.asarray(self.settings.loss_width)
        if state is None:
            state = first_state(self.chain, table, table.real, width, self.options)
        arrays = (jnp.asarray(influence), jnp.asarray(value), before)
        return correction_step(self.chain, table, *arrays, self.family, theta, state, table.real, width, self.options)


def problem_of(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    survey: Survey,
    origin_enh_m: Float[np.ndarray, "3"],
    settings: Settings,
    learn: LearnSettings,
    prior: CorrectionPrior,
) -> Problem:
    """Surveyed rotations of markers are not used: they say little of the corrections, and other noise goes with them.

    Raises:
        SightingError: no sighting can be used, or one that `make_anchors` refuses.
    """
    settings = dataclasses.replace(settings, use_rotation=False)
    inside = visits_within(trajectory, sightings, visits, prior.reach_s)
    if not inside:
        raise SightingError(
            f"corrections: no sighting lies more than {prior.reach_s:.2f} s inside the trajectory's time, so an offset "
            "of that size cannot be judged. Give corrections.time_offset a smaller sigma_s, or a longer trajectory."
        )
    anchors, _ = corrected_anchors(
        trajectory, sightings, inside, survey, np.zeros(N_CORRECTIONS), origin_enh_m=origin_enh_m
    )
    return Problem(
        trajectory=trajectory,
        sightings=sightings,
        visits=inside,
        survey=survey,
        origin_enh_m=origin_enh_m,
        settings=settings,
        prior=prior,
        family=prior_arrays(learn.family),
        options=learn_options(settings, learn),
        chain=chain_of(trajectory),
        fixes_frame=_fixes_frame(anchors),
    )


def corrected_anchors(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    survey: Survey,
    value: Float[np.ndarray, "7"],
    *,
    origin_enh_m: Float[np.ndarray, "3"],
) -> tuple[Anchors, tuple[str, ...]]:
    """`make_anchors` of the visits with these corrections made.

    Raises:
        SightingError: as `make_anchors`.
    """
    moved = [dataclasses.replace(v, start_s=v.start_s + value[TIME], end_s=v.end_s + value[TIME]) for v in visits]
    return make_anchors(trajectory, corrected_sightings(sightings, value), moved, survey, origin_enh_m=origin_enh_m)


def lever_arm_derivative(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    anchors: Anchors,
    value: Float[np.ndarray, "7"],
    difference_s: float,
) -> Float[np.ndarray, "k 3 7"]:
    """Of the anchors' lever arms, body axes of their poses: the mean of the sightings', weighted by information."""
    rows = [visit.sightings for visit in visits]
    found = compose(trajectory, sightings, rows, value, difference_s)
    weight = 1.0 / np.trace(found.covariance_m2, axis1=1, axis2=2)
    first = np.cumsum([0, *[visit.count for visit in visits[:-1]]])
    summed = np.add.reduceat(weight[:, None, None] * found.jacobian, first)
    mean = summed / np.add.reduceat(weight, first)[:, None, None]
    row = {visit.label: i for i, visit in enumerate(visits)}
    R_map_body = Rotation.from_quat(trajectory.quat_wxyz[anchors.pose_index], scalar_first=True)
    return R_map_body.inv().as_matrix() @ mean[[row[label] for label in anchors.label]]


def _fixes_frame(anchors: Anchors) -> bool:
    root = np.linalg.inv(np.linalg.cholesky(anchors.lever_covariance_m2 + anchors.survey_covariance_m2))
    none = jnp.zeros((len(anchors), 3, 3))
    return bool(determined(*gauge_covariance(jnp.asarray(anchors.surveyed_enh_m), jnp.asarray(root), none)))
