"""The rig that a config names."""

from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Rig
from jaxgeo.io import read_rig


def rig_of(config: SessionConfig) -> Rig | None:
    """Read it from its file, or from the config itself; None where there is none.

    Raises:
        SightingError: as `read_rig`.
    """
    source = config.rig
    if source is None:
        return None
    return read_rig(source.model_dump(exclude_none=True) if source.file is None else source.file)
