"""Video files: pixels, stamps of the container, resuming, files that are cut off."""

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.errors import DetectError
from jaxgeo.io.frames import VideoFrames, open_frames
from jaxgeo.io.input_warning import InputWarning

N = 40
capture = cv2.VideoCapture


def picture(i: int) -> np.ndarray:
    """A bar whose length is the number of the frame, over a fixed texture."""
    image = np.random.default_rng(5).integers(0, 60, (48, 64, 3), dtype=np.uint8)
    image[:, : i + 1] += 180
    return image


def write_video(path: Path, codec: str, rate_hz: float = 30.0, n: int = N) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate_hz, (64, 48))
    assert writer.isOpened()
    for i in range(n):
        writer.write(picture(i))
    writer.release()
    return path


def bar(image: np.ndarray) -> int:
    return int((image[:, :, 1].mean(axis=0) > 120).sum()) - 1


CODECS = [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "FFV1")]


@pytest.mark.parametrize(("name", "codec"), CODECS)
def test_frames_and_the_times_of_the_container(tmp_path, name, codec):
    source = open_frames(write_video(tmp_path / name, codec), start_s=1000.0, camera="front")
    assert isinstance(source, VideoFrames)
    assert (source.n_frames, source.cameras) == (N, ("front",))
    frames = list(source)
    assert [frame.index for frame in frames] == list(range(N))
    assert [bar(frame.image) for frame in frames] == list(range(N))
    rounded_s = 5.1e-4 if name.endswith("mkv") else 1e-9  # Matroska: whole milliseconds
    np.testing.assert_allclose([f.stamp_s for f in frames], 1000.0 + np.arange(N) / 30.0, rtol=0, atol=rounded_s)
    assert frames[3].source == f"{tmp_path / name}:3"
    assert frames[3].camera == "front"
    if codec == "FFV1":  # lossless but for the conversion to YUV and back
        assert np.abs(frames[7].image.astype(int) - picture(7)).max() < 40
    rated = list(open_frames(tmp_path / name, rate_hz=20.0, start_s=5.0))
    assert [frame.stamp_s for frame in rated] == [5.0 + i / 20.0 for i in range(N)]


@pytest.mark.parametrize(("name", "codec"), CODECS)
def test_resumes_with_the_same_frames(tmp_path, name, codec):
    source = pickle.loads(pickle.dumps(open_frames(write_video(tmp_path / name, codec))))
    whole = list(source)
    for start in (1, 13, N - 1, N, N + 5):
        rest = list(source.frames(start))
        assert [(f.index, f.stamp_s) for f in rest] == [(f.index, f.stamp_s) for f in whole[start:]]
        for one, other in zip(rest, whole[start:], strict=True):
            np.testing.assert_array_equal(one.image, other.image)


def test_a_gif():
    source = open_frames(data_root() / "imarkers" / "standalone_demo.gif")
    assert source.n_frames == 200
    frames = list(source.frames(190))
    assert [frame.index for frame in frames] == list(range(190, 200))
    assert frames[0].image.shape == (499, 800, 3)
    np.testing.assert_allclose([frame.stamp_s for frame in frames], np.arange(190, 200) / 10.0, rtol=0, atol=1e-9)


def test_rows_and_columns_as_stored(tmp_path):
    """A telephone held upright says that its frames are to be turned for showing; the calibration is of the sensor."""
    path = write_video(tmp_path / "a.mp4", "mp4v", n=3)
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 40  # behind version, times, track, duration, layer, volume: the 3 × 3 matrix
    turn = np.array([0, 1 << 16, 0, -1 << 16, 0, 0, 48 << 16, 0, 1 << 30], ">i4")
    data[at : at + 36] = turn.tobytes()
    path.write_bytes(bytes(data))
    assert cv2.VideoCapture(str(path)).read()[1].shape == (64, 48, 3)
    assert [frame.image.shape for frame in open_frames(path)] == [(48, 64, 3)] * 3


def test_a_file_that_ends_early(tmp_path):
    path = write_video(tmp_path / "a.avi", "MJPG")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    source = open_frames(path)
    with pytest.warns(InputWarning, match=r"a\.avi: \d+ frames could be read of the 40 that the file announces"):
        frames = list(source)
    assert 5 < len(frames) < 30
    assert [bar(frame.image) for frame in frames] == list(range(len(frames)))


class Timeless:
    """A capture whose frames all have time 0. (No subclass: OpenCV's types break the memory when they are derived.)"""

    def __init__(self, *args):
        self.capture = capture(*args)

    def __getattr__(self, name):
        return getattr(self.capture, name)

    def get(self, what):
        return 0.0 if what == cv2.CAP_PROP_POS_MSEC else self.capture.get(what)


def test_times_that_do_not_increase(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.avi", "MJPG")

    monkeypatch.setattr(cv2, "VideoCapture", Timeless)
    with pytest.raises(DetectError, match=r"a\.avi:1: the frame's own time, 0 ms, is not after 0 ms.*`rate_hz`"):
        list(open_frames(path))
    assert len(list(open_frames(path, rate_hz=30.0))) == N


def test_files_that_are_refused(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"not a video at all" * 100)
    (tmp_path / "empty.avi").write_bytes(b"")
    cut = write_video(tmp_path / "cut.mp4", "mp4v")
    cut.write_bytes(cut.read_bytes()[:-300])
    for name in ("a.mp4", "empty.avi", "cut.mp4"):
        with pytest.raises(DetectError, match=rf"{name}: .*(no video that OpenCV|no frame that can be decoded)"):
            open_frames(tmp_path / name)
    with pytest.raises(DetectError, match="is a folder, expected a video file"):
        open_frames(tmp_path, kind="video")
    with pytest.raises(DetectError, match="no such file"):
        open_frames(tmp_path / "gone.mp4", kind="video")
    with pytest.raises(DetectError, match="'stamps' says nothing about a source of kind 'video'"):
        open_frames(tmp_path / "a.mp4", stamps="t.csv")
