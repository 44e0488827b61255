"""Which observations the noise is learned from: revisits alone, training anchors alone, or both."""

from typing import Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph.anchor_table import AnchorTable

ObservationSet = Literal["both", "anchors", "revisit"]
OBSERVATION_SETS: tuple[ObservationSet, ...] = get_args(ObservationSet)


class Learnable(eqx.Module):
    """Masks over the anchors.

    Attributes:
        relative: (k,) 1 for revisits of a location that is not used: learned from without its coordinates.
        learn: (k,) 1 for anchors that are learned from.
        unknown: (k,) 1 for those among them whose location's coordinates are not used.
        same_location: (k, k).
    """

    relative: Float[Array, "k"]
    learn: Float[Array, "k"]
    unknown: Float[Array, "k"]
    same_location: Float[Array, "k k"]


def learnable(table: AnchorTable, use: Float[Array, "k"], observations: ObservationSet) -> Learnable:
    """What may be learned from where only the anchors with `use` 1 may be used with their coordinates.

    `both`: those, and the differences between visits of every other location. `anchors`: those alone. `revisit`: the
    differences between visits of every location, no coordinates.
    """
    same = (table.location[:, None] == table.location[None, :]).astype(float) * table.real[:, None] * table.real[None]
    revisited = table.real * (same.sum(axis=1) > 1).astype(float)
    none = jnp.zeros_like(use)
    relative = none if observations == "anchors" else revisited * (1.0 - use)
    if observations == "revisit":
        return Learnable(relative, revisited, revisited, same)
    return Learnable(relative, use + relative, relative, same)
