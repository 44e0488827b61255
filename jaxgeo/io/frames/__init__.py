"""Where images come from: folders, video files, ROS bags; one interface for all.

    frames = open_frames(path, kind=None, stamps=None, rate_hz=None, start_s=None, topics=None, camera=None,
                         on_bad="raise")                                 # -> FrameSource
    frames.cameras      # names of cameras
    frames.n_frames     # how many there are (of a video: as its header announces), None where nothing tells
    frames.bad          # {index: message} of images that could not be read; empty unless on_bad="skip"
    for frame in frames.frames(start=0):  # or: for frame in frames
        frame.stamp_s, frame.camera, frame.image  # float seconds, name, uint8 (h, w, 3) BGR
        frame.index     # its place in the source, unreadable ones counted too: go on with frames(start=index + 1)
        frame.source    # "file:frame", for messages

`FolderFrames(path, stamps=, rate_hz=, start_s=, camera=, on_bad=)`, `VideoFrames(path, rate_hz=, start_s=, camera=,
on_bad=)` and `BagFrames(path, topics=, camera=, on_bad=)` are the three kinds. A source holds names and stamps, no
open file: it can be read more than once, and pickled. What is wrong with it as a whole is a `DetectError` when it is
made; an image that cannot be read is one while reading, or with on_bad="skip" an `InputWarning` and an entry of `bad`.
"""

from jaxgeo.io.frames.bag import BagFrames
from jaxgeo.io.frames.folder import FolderFrames
from jaxgeo.io.frames.frame import Frame, FrameSource
from jaxgeo.io.frames.source import open_frames
from jaxgeo.io.frames.video import VideoFrames

__all__ = ["BagFrames", "FolderFrames", "Frame", "FrameSource", "VideoFrames", "open_frames"]
