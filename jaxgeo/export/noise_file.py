"""noise.json: the noise values every trajectory was corrected with, by stage."""

from jaxgeo.export.json_text import json_text
from jaxgeo.export.result import SessionResult


def noise_text(result: SessionResult) -> str:
    """`trajectories.{name}.{stage}` holds the values."""
    return json_text(
        {
            "session": result.name,
            "simulated": result.simulated,
            "trajectories": {name: t.noise for name, t in result.trajectories.items()},
        }
    )
