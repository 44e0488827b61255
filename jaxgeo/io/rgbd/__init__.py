"""RGB-D frames from files: folders of colour and depth images, ROS bags.

frames = open_rgbd(path, kind=None, stamps=None, rate_hz=None, start_s=None, topics=None, depth_unit_m=0.001,
                   max_gap_s=0.02, on_bad="raise")
frames.n_frames     # how many pairs there are; None where only reading tells
frames.bad          # {index: message} of pairs that could not be read; empty unless on_bad="skip"
for frame in frames.frames(start=0):  # or: for frame in frames
    frame.stamp_s, frame.image, frame.depth_m  # see jaxgeo.data.RgbdFrame
"""

from jaxgeo.io.rgbd.bag import BagRgbd
from jaxgeo.io.rgbd.folder import FolderRgbd
from jaxgeo.io.rgbd.rgbd_source import RgbdSource
from jaxgeo.io.rgbd.source import open_rgbd

__all__ = ["BagRgbd", "FolderRgbd", "RgbdSource", "open_rgbd"]
