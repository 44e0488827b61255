"""Errors of every choice of k locations, and their sums: in the sample, held out, inside the predicted ellipsoid."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from eval.uncertainty import inside_ellipsoid
from jaxgeo.errors import InputError
from jaxgeo.export.held_out_stats import finite, mean_or_nan


@dataclasses.dataclass(frozen=True)
class SubsetErrors:
    """All choices of k locations, one a row.

    Attributes:
        n_possible: choices there are; `used` may be a sample of them.
        used: (s, n_locations).
        in_sample_m: (s, visits) distance of the predicted marker from its survey point; NaN where the visit was not
            used, or the choice failed.
        held_out_m: (s, visits) the same of the visits of locations that were not used.
        inside_95: (s, visits) of those, 1 inside the ellipsoid that the choice itself predicts, 0 outside; NaN without.
        failed: (s,) the anchors do not fix the frame, or the estimate did not settle.
    """

    k: int
    n_possible: int
    used: Bool[np.ndarray, "s n_locations"]
    in_sample_m: Float[np.ndarray, "s visits"]
    held_out_m: Float[np.ndarray, "s visits"]
    inside_95: Float[np.ndarray, "s visits"]
    failed: Bool[np.ndarray, "s"]


@dataclasses.dataclass(frozen=True)
class SubsetSummary:
    """Means and root mean squares over all visits of all choices that did not fail; NaN of nothing.

    Attributes:
        n_subsets: choices tried, `n_failed` of them failed; of `n_possible`.
        coverage_95: share of held-out visits inside their own 95 % ellipsoid.
    """

    k: int
    n_subsets: int
    in_sample_mean_m: float
    in_sample_rms_m: float
    held_out_mean_m: float
    held_out_rms_m: float
    coverage_95: float
    n_failed: int
    n_possible: int


def summary(errors: SubsetErrors) -> SubsetSummary:
    """Of one session."""
    return pooled_summary([errors])


def pooled_summary(errors: Sequence[SubsetErrors]) -> SubsetSummary:
    """Of several sessions with the same k, all their choices and visits together.

    Raises:
        InputError: none, or of different k.
    """
    ks = sorted({each.k for each in errors})
    if len(ks) != 1:
        raise InputError(f"choices of k = {ks} locations cannot be summed up together: expected one k.")
    in_sample_m, held_out_m, inside = (
        finite(np.concatenate([getattr(each, name).ravel() for each in errors]))
        for name in ("in_sample_m", "held_out_m", "inside_95")
    )
    return SubsetSummary(
        k=ks[0],
        n_subsets=sum(len(each.used) for each in errors),
        in_sample_mean_m=mean_or_nan(in_sample_m),
        in_sample_rms_m=float(np.sqrt(mean_or_nan(in_sample_m**2))),
        held_out_mean_m=mean_or_nan(held_out_m),
        held_out_rms_m=float(np.sqrt(mean_or_nan(held_out_m**2))),
        coverage_95=mean_or_nan(inside),
        n_failed=int(sum(each.failed.sum() for each in errors)),
        n_possible=sum(each.n_possible for each in errors),
    )


def gathered(
    k: int,
    n_possible: int,
    used: Bool[np.ndarray, "s n_locations"],
    use: Bool[np.ndarray, "s visits"],
    takes_part: Bool[np.ndarray, "visits"],
    error_m: Float[np.ndarray, "s visits 3"],
    covariance_m2: Float[np.ndarray, "s visits 3 3"],
    good: Bool[np.ndarray, "s"],
) -> SubsetErrors:
    """From predicted minus surveyed positions of all visits; `use` says which visits a choice used."""
    norm_m = np.linalg.norm(error_m, axis=-1)
    held = ~use & takes_part & good[:, None]
    return SubsetErrors(
        k=k,
        n_possible=n_possible,
        used=used,
        in_sample_m=np.where(use & good[:, None], norm_m, np.nan),
        held_out_m=np.where(held, norm_m, np.nan),
        inside_95=np.where(held, inside_ellipsoid(error_m, covariance_m2), np.nan),
        failed=~good,
    )
