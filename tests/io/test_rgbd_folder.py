"""RGB-D frames of folders: three layouts, stamps, units of depth, what does not fit."""

import pickle

import cv2
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.errors import ScanError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.rgbd import FolderRgbd, open_rgbd

HEAD = "# images\n# file: 'freiburg.bag'\n# timestamp filename\n"
STAMPS = ("1305031102.175304", "1305031102.211214", "1305031102.243211")


def picture(i: int) -> np.ndarray:
    return np.random.default_rng(i).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def steps(i: int) -> np.ndarray:
    out = np.random.default_rng(i).integers(1, 6000, (6, 8)).astype(np.uint16)
    out[0, 0], out[0, 1] = 0, 65535
    return out


def save(path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def save_pair(folder, i: int, colour: str, depth: str) -> None:
    save(folder / colour, picture(i))
    save(folder / depth, steps(i))


def check(source, expected: list[tuple[float, int]], unit_m: float = 0.001) -> None:
    frames = list(source)
    assert [(frame.stamp_s, frame.index) for frame in frames] == [(at, i) for i, (at, _) in enumerate(expected)]
    for frame, (_, i) in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.image, picture(i))
        depth_m = np.where(steps(i) == 65535, 0, steps(i) * unit_m)
        np.testing.assert_array_equal(frame.depth_m, depth_m.astype(np.float32))
        assert frame.depth_m.dtype == np.float32


def ours(folder, names=STAMPS) -> None:
    for i, name in enumerate(names):
        save_pair(folder, i, f"color/{name}.png", f"depth/{name}.png")


def test_seven_scenes(tmp_path):
    for i, number in enumerate((10, 2, 0)):
        save_pair(tmp_path, i, f"frame-{number:06d}.color.png", f"frame-{number:06d}.depth.png")
        (tmp_path / f"frame-{number:06d}.pose.txt").write_text("1 0 0 0\n")
    source = open_rgbd(tmp_path, rate_hz=30, start_s=2.0)
    assert isinstance(source, FolderRgbd)
    assert source.n_frames == 3
    check(source, [(2.0, 2), (2.0 + 1 / 30, 1), (2.0 + 2 / 30, 0)])
    times = tmp_path / "times.txt"
    times.write_text("1\n2\n4\n")
    check(open_rgbd(tmp_path, stamps=times), [(1.0, 2), (2.0, 1), (4.0, 0)])
    with pytest.raises(ScanError, match=r"frame-000000\.color\.png: the name holds no stamp.*`rate_hz` for images"):
        open_rgbd(tmp_path)


def test_colour_without_depth_is_counted_but_keeps_its_place(tmp_path):
    ours(tmp_path, ("0", "1", "2"))
    (tmp_path / "depth" / "1.png").rename(tmp_path / "depth" / "7.png")
    with pytest.raises(ScanError, match=r"different names.*only stamps can tell"):
        open_rgbd(tmp_path, rate_hz=10)
    for i in range(3):
        save_pair(tmp_path / "scenes", i, f"f{i}.color.png", f"f{i}.depth.png")
    (tmp_path / "scenes" / "f1.depth.png").unlink()
    with pytest.warns(InputWarning, match="1 of 3 colour and 0 of 2 depth images have no partner of the same name"):
        check(open_rgbd(tmp_path / "scenes", rate_hz=10), [(0.0, 0), (0.2, 2)])


def test_equal_names_with_stamps(tmp_path):
    ours(tmp_path)
    source = pickle.loads(pickle.dumps(open_rgbd(tmp_path)))
    check(source, [(float(name), i) for i, name in enumerate(STAMPS)])
    assert [frame.index for frame in source.frames(2)] == [2]
    table = tmp_path / "stamps.csv"
    table.write_text("stamp_s,file\n" + "".join(f"{9 - i},{name}.png\n" for i, name in enumerate(STAMPS)))
    check(open_rgbd(tmp_path, stamps=table), [(7.0, 2), (8.0, 1), (9.0, 0)])


def tum(folder, gap_s: float = 0.004) -> list[float]:
    stamps = [float(name) for name in STAMPS]
    for i, at in enumerate(stamps):
        save_pair(folder, i, f"rgb/{at:.6f}.png", f"depth/{at + gap_s:.6f}.png")
    return stamps


def test_tum_by_the_stamps_in_the_names(tmp_path):
    stamps = tum(tmp_path)
    save(tmp_path / "rgb" / "1305031109.000000.png", picture(9))
    with pytest.warns(InputWarning, match=r"1 of 4 colour and 0 of 3 depth images have no partner within 0\.02 s"):
        source = open_rgbd(tmp_path, depth_unit_m=0.0002)
    check(source, list(zip(stamps, range(3), strict=True)), 0.0002)
    with pytest.raises(ScanError, match="none of 4 colour and 3 depth images has a partner"):
        open_rgbd(tmp_path, max_gap_s=0.003)


def test_tum_tables(tmp_path):
    """The tables' stamps count, not those of the names."""
    for i in range(3):
        save_pair(tmp_path, i, f"rgb/c{i}.png", f"depth/d{i}.png")
    (tmp_path / "rgb.txt").write_text(HEAD + "".join(f"{i + 1}.5 rgb/c{i}.png\n" for i in range(3)))
    (tmp_path / "depth.txt").write_text(HEAD + "".join(f"{i + 1}.51 depth/d{i}.png\n" for i in range(3)))
    check(open_rgbd(tmp_path), [(1.5, 0), (2.5, 1), (3.5, 2)])
    (tmp_path / "associations.txt").write_text("4.5 rgb/c1.png 4.7 depth/d1.png\n6.5 rgb/c2.png 6.6 depth/d2.png\n")
    check(open_rgbd(tmp_path), [(4.5, 1), (6.5, 2)])
    (tmp_path / "associations.txt").write_text("4.5 depth/d1.png 4.7 rgb/c1.png\n")
    check(open_rgbd(tmp_path), [(4.7, 1)])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 rgb/c0.png 1\n", "3 columns, expected stamp, colour image"),
        ("1 rgb/c0.png 1 depth/d0.png\n1 rgb/c1.png 1 depth/d1.png\n", r"\.txt:2: stamp 1\.0 s after 1\.0 s"),
        ("1 rgb/c0.png 1 depth/d7.png\n", r"\.txt:1: names 'depth/d7\.png', which is not in"),
        ("x rgb/c0.png 1 depth/d7.png\n", r"\.txt:1: stamp 'x', expected a number"),
    ],
)
def test_associations_that_do_not_fit(tmp_path, content, message):
    for i in range(2):
        save_pair(tmp_path, i, f"rgb/c{i}.png", f"depth/d{i}.png")
    (tmp_path / "associations.txt").write_text(content)
    with pytest.raises(ScanError, match=message):
        open_rgbd(tmp_path)


def test_depth_in_metres(tmp_path):
    ours(tmp_path, STAMPS[:1])
    metres = np.full((6, 8), 1.25, np.float32)
    metres[0] = [0, np.nan, np.inf, -1, 2, 3, 4, 5]
    (tmp_path / "depth" / f"{STAMPS[0]}.png").unlink()
    save(tmp_path / "depth" / f"{STAMPS[0]}.tiff", metres)
    (frame,) = open_rgbd(tmp_path)
    np.testing.assert_array_equal(frame.depth_m[0], [0, 0, 0, 0, 2, 3, 4, 5])
    assert (frame.depth_m[1:] == 1.25).all()


def test_unreadable_frames_are_named_or_counted(tmp_path):
    names = [f"{i}.5" for i in range(6)]
    ours(tmp_path, names)
    save(tmp_path / "depth" / "1.5.png", picture(1))
    save(tmp_path / "depth" / "2.5.png", np.ones((3, 4), np.uint16))
    (tmp_path / "depth" / "3.5.png").write_bytes(b"cut")
    (tmp_path / "color" / "4.5.png").write_bytes(b"")
    for start, message in (
        (1, r"depth/1\.5\.png: 3 channels of uint8, expected one of uint16 or floats. Is it a picture"),
        (2, r"color/2\.5\.png: colour of 8×6 pixels, depth of 4×3; expected one size. Register the depth"),
        (3, r"depth/3\.5\.png: 3 bytes, beginning with 63 75 74, are no depth image"),
        (4, r"color/4\.5\.png: the image is empty"),
    ):
        with pytest.raises(ScanError, match=message):
            next(open_rgbd(tmp_path).frames(start))
    source = open_rgbd(tmp_path, on_bad="skip")
    with pytest.warns(InputWarning) as caught:
        assert [frame.index for frame in source] == [0, 5]
    assert sorted(source.bad) == [1, 2, 3, 4]
    assert "4 frames could not be read" in str(caught[-1].message)


def test_what_is_no_recording(tmp_path):
    ours(tmp_path / "good")
    (tmp_path / "bare" / "color").mkdir(parents=True)
    (tmp_path / "empty" / "color").mkdir(parents=True)
    (tmp_path / "empty" / "depth").mkdir()
    (tmp_path / "a.mp4").write_bytes(b"")
    for path, options, message in (
        (tmp_path, {}, r"neither NAME\.color.*It holds a\.mp4, bare, empty, good"),
        (tmp_path / "bare", {}, "nor one of the folders color, rgb, colour beside depth. It holds color"),
        (tmp_path / "empty", {}, "color: holds no images"),
        (tmp_path / "none", {}, "no such file or folder"),
        (tmp_path / "a.mp4", {}, r"suffix '\.mp4', expected a folder of colour and depth"),
        (tmp_path / "good", {"depth_unit_m": 5000}, r"depth_unit_m is 5000.*0\.0002 for the factor 5000"),
        (tmp_path / "good", {"depth_unit_m": 0}, "depth_unit_m is 0"),
        (tmp_path / "good", {"max_gap_s": -1}, "max_gap_s is -1"),
        (tmp_path / "good", {"topics": {"color": "/a"}}, "'topics' says nothing about a source of kind 'folder'"),
        (tmp_path / "good", {"kind": "tar"}, "kind 'tar', expected one of folder, bag"),
    ):
        with pytest.raises(ScanError, match=message):
            open_rgbd(path, **options)


def test_real_frames():
    folder = data_root() / "rgbd_7scenes_redkitchen"
    source = open_rgbd(folder, rate_hz=6)
    assert source.n_frames == 30
    frame = next(source.frames(29))
    raw = cv2.imread(str(folder / "frame-000145.depth.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(frame.depth_m, np.where(raw == 65535, 0, raw / 1000).astype(np.float32))
    np.testing.assert_array_equal(frame.image, cv2.imread(str(folder / "frame-000145.color.jpg")))
