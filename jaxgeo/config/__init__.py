"""The config of a session: schema, reading, writing."""

from jaxgeo.config.load import dump_config, load_config
from jaxgeo.config.schema import SessionConfig

__all__ = ["SessionConfig", "dump_config", "load_config"]
