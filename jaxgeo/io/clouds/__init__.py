"""Point clouds in files: LAS, LAZ, PLY."""

from jaxgeo.io.clouds.chunk import CloudChunk, Columns
from jaxgeo.io.clouds.source import CHUNK, CloudSource, open_cloud
from jaxgeo.io.clouds.writer import CloudWriter, cloud_writer

__all__ = ["CHUNK", "CloudChunk", "CloudSource", "CloudWriter", "Columns", "cloud_writer", "open_cloud"]
