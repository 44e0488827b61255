"""Whether the anchors so far fix the frame, and which direction they leave free."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxgeo.data import Anchors
from jaxgeo.graph.pose_graph import PoseGraph, at_anchors
from jaxgeo.solve.gauge import determined, free_direction_words, gauge_covariance

NOTHING_YET = "no anchor yet: visits to three locations off one line are needed"


class FrameKnown(eqx.Module):
    """See `gauge.gauge_covariance` for `sigma` and `direction`."""

    determined: Bool[Array, ""]
    sigma: Float[Array, "6"]
    direction: Float[Array, "6 6"]


def frame_known(graph: PoseGraph) -> FrameKnown:
    """From the anchors of a graph at its coarse fit, as the batch solve asks it."""
    anchors = graph.anchors
    turned = anchors.sqrt_information_rotation @ jnp.swapaxes(at_anchors(graph.base, graph).rotation, -1, -2)
    information = jnp.swapaxes(turned, -1, -2) @ turned * float(graph.terms.rotation)
    sigma, direction = gauge_covariance(anchors.measured_m, anchors.sqrt_information, information)
    return FrameKnown(determined(sigma, direction), sigma, direction)


def undetermined_words(anchors: Anchors, known: FrameKnown) -> str:
    """What the anchors so far leave free, and how many are missing."""
    places = sorted(set(anchors.location))
    free = free_direction_words(np.asarray(known.sigma), np.asarray(known.direction))
    missing = (
        f"at least {3 - len(places)} more location(s), off one line, needed"
        if len(places) < 3
        else "one more location, to the side of the line, is needed"
    )
    return (
        f"the {len(anchors)} anchor(s) at {len(places)} location(s) ({', '.join(places[:8])}) do not fix the frame "
        f"yet: {free}; {missing}"
    )
