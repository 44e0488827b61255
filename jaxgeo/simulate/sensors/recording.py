"""What the rig records on its walk: which scans and frames there are, and each of them rendered."""

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.data.scan import Scan
from jaxgeo.errors import InputError
from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.layout import UAV, Layout
from jaxgeo.simulate.sensors.board import MarkerVisit, marker_visits
from jaxgeo.simulate.sensors.lidar import Lidar, render_scan, ring_errors
from jaxgeo.simulate.sensors.rgbd import Marker, RgbdCamera, render_frame
from jaxgeo.simulate.sensors.rig import SensorRig, sensor_rig
from jaxgeo.simulate.sensors.world import World, world_of
from jaxgeo.simulate.session import START_S, SimulatedSession, simulate_session
from jaxgeo.simulate.walk import Walk

# The cameras' clock ticks beside the LiDAR's.
FRAME_OFFSET_S = 0.013
TRUTH_HZ = 20.0
JPEG_QUALITY, DEPTH_UNIT_M = 90, 0.001
# No visit is begun that would leave fewer seconds than this to see it.
_SHORTEST_VISIT_S = 1.0
_STREAM = 1000
_SCAN, _FRAME = 0, 1


@dataclasses.dataclass(frozen=True)
class EncodedFrame:
    """An RGB-D frame as it is stored: JPEG, and PNG of 16 bits in steps of `DEPTH_UNIT_M`."""

    stamp_s: float
    index: int
    color_jpeg: bytes
    depth_png: bytes


@dataclasses.dataclass(frozen=True)
class Recording:
    """One simulated session from raw sensors; `record` makes it.

    Attributes:
        session: survey, layout and true marker places.
        lidar, camera, marker: what is rendered; without a camera scans only.
        rig: where the sensors sit.
        duration_s: it ends there.
    """

    session: SimulatedSession
    lidar: Lidar
    camera: RgbdCamera | None
    marker: Marker
    rig: SensorRig
    duration_s: float

    @property
    def walk(self) -> Walk:
        """The true motion of the body."""
        return course_of(self.session.layout).walk

    @functools.cached_property
    def visits(self) -> tuple[MarkerVisit, ...]:
        """The visits that the recording holds, in their order."""
        last_s = self.duration_s - _SHORTEST_VISIT_S
        return tuple(visit for visit in marker_visits(self.session) if visit.arrive_s <= last_s)

    @property
    def order(self) -> tuple[str, ...]:
        """The location of each of these."""
        return tuple(visit.location for visit in self.visits)

    @functools.cached_property
    def scan_s(self) -> Float[np.ndarray, "n"]:
        """Starts of the scans, from the session's start; the last ends within the recording."""
        return np.arange(max(int(self.duration_s * self.lidar.rate_hz + 1e-9), 1)) / self.lidar.rate_hz

    @functools.cached_property
    def frame_s(self) -> Float[np.ndarray, "m"]:
        """Times of the frames, to the microsecond: denser where a marker is shown."""
        if self.camera is None:
            return np.zeros(0)
        sparse = np.arange(FRAME_OFFSET_S, self.duration_s, 1.0 / self.camera.rate_hz)
        dense = np.arange(FRAME_OFFSET_S, self.duration_s, 1.0 / self.camera.visit_rate_hz)
        shown = [np.array([self.visit_at(time_s) is not None for time_s in times]) for times in (sparse, dense)]
        return np.round(np.sort(np.concatenate([sparse[~shown[0]], dense[shown[1]]])), 6)

    def visit_at(self, time_s: float) -> MarkerVisit | None:
        """The visit whose board stands there at this time."""
        return next((visit for visit in self.visits if visit.shows(time_s)), None)

    def truth(self) -> Trajectory:
        """True poses `T_local_body` at every scan's stamp and between."""
        between = int(np.ceil(TRUTH_HZ / self.lidar.rate_hz))
        time_s = np.arange(int(self.duration_s * self.lidar.rate_hz * between + 1e-9) + 1)
        time_s = time_s / (self.lidar.rate_hz * between)
        pose = self.walk.pose(time_s)
        return Trajectory(START_S + time_s, pose.translation, pose.rotation.as_quat(canonical=True, scalar_first=True))


def record(
    seed: int = 0,
    layout: Layout = UAV,
    *,
    lidar: Lidar | None = None,
    camera: RgbdCamera | None = None,
    marker: Marker | None = None,
    duration_s: float | None = None,
) -> Recording:
    """Plan a recording; the same arguments give the same bytes.

    Args:
        layout: `UAV`, `UGV`, or one's own at the same site: under one seed all see the same world.
        camera: None: scans only.
        duration_s: the recording is cut there; default the whole session.

    Raises:
        InputError: a duration that holds no scan.
    """
    lidar = Lidar() if lidar is None else lidar
    whole_s = layout.duration_s
    duration_s = whole_s if duration_s is None else min(duration_s, whole_s)
    if not duration_s * lidar.rate_hz >= 1.0:
        raise InputError(f"duration {duration_s:g} s: expected a scan or more, {1 / lidar.rate_hz:g} s each.")
    optics = RgbdCamera() if camera is None else camera
    rig = sensor_rig(layout, optics.resolution_px, optics.focal_px, optics.distortion)
    session = simulate_session(seed, layout, drift={})
    return Recording(session, lidar, camera, Marker() if marker is None else marker, rig, duration_s)


class Renderer:
    """Renders the scans and frames of a recording, one by one and in any order."""

    def __init__(self, recording: Recording, world: World | None = None) -> None:
        self._recording = recording
        self._world = world_of(recording.session.seed) if world is None else world
        # One rig: its sensor is the same in all sessions of a seed.
        sensor = np.random.SeedSequence([recording.session.seed], spawn_key=(_STREAM,))
        self._ring_errors = ring_errors(np.random.default_rng(sensor), recording.lidar)

    def scan(self, index: int) -> Scan:
        """Scan `index` of `Recording.scan_s`."""
        recording = self._recording
        start_s = recording.scan_s[index]
        return render_scan(
            self._random(_SCAN, index),
            recording.lidar,
            self._ring_errors,
            self._world.scene(recording.visit_at(start_s)),
            lambda after_s: recording.walk.pose(start_s + after_s) * recording.rig.T_body_lidar,
            START_S + start_s,
            index,
        )

    def frame(self, index: int) -> EncodedFrame:
        """Frame `index` of `Recording.frame_s`."""
        recording = self._recording
        assert recording.camera is not None
        time_s = recording.frame_s[index]
        frame = render_frame(
            self._random(_FRAME, index),
            recording.camera,
            recording.rig.camera,
            recording.marker,
            self._world,
            recording.visit_at(time_s),
            lambda after_s: recording.walk.pose(time_s + after_s) * recording.rig.T_body_cam,
            START_S + time_s,
            index,
        )
        depth = np.rint(frame.depth_m / DEPTH_UNIT_M).astype(np.uint16)
        return EncodedFrame(
            frame.stamp_s,
            index,
            cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes(),
            cv2.imencode(".png", depth)[1].tobytes(),
        )

    def item(self, job: tuple[int, int]) -> Scan | EncodedFrame:
        """What one of `jobs` names."""
        kind, index = job
        return self.scan(index) if kind == _SCAN else self.frame(index)

    def _random(self, kind: int, index: int) -> np.random.Generator:
        session = self._recording.session
        entropy = [session.seed, session.layout.stream]
        return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(_STREAM, kind, index)))


def jobs(recording: Recording) -> list[tuple[int, int]]:
    """All scans and frames by their stamps, for `Renderer.item`."""
    every = [(stamp, _SCAN, i) for i, stamp in enumerate(recording.scan_s)]
    every += [(stamp, _FRAME, i) for i, stamp in enumerate(recording.frame_s)]
    return [(kind, index) for _, kind, index in sorted(every)]
