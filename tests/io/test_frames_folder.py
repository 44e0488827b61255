"""Folders of images: stamps from tables, names and rates; tables and folders that do not fit."""

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from jaxgeo.errors import DetectError
from jaxgeo.io.frames import open_frames
from jaxgeo.io.input_warning import InputWarning

NS = (1_403_636_579_763_555_584, 1_403_636_579_813_555_456, 1_403_636_579_863_555_584)


def picture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (12, 16, 3), dtype=np.uint8)


def save(folder: Path, *names: str) -> None:
    """Picture i under name i."""
    for i, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(folder / name), picture(i))


def table(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def shown(source) -> list[tuple[float, str, int]]:
    """(stamp, camera, which picture) of all frames."""
    found = []
    for frame in source:
        same = [i for i in range(12) if np.array_equal(frame.image, picture(i))]
        assert len(same) == 1
        found.append((frame.stamp_s, frame.camera, same[0]))
    return found


def test_a_rate_and_the_natural_order_of_names(tmp_path):
    save(tmp_path, "img10.png", "img2.png", "img1.bmp", "img02.tif")
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "._img1.png").write_bytes(b"what some systems leave beside an image")
    source = open_frames(tmp_path, rate_hz=4.0, start_s=100.0, camera="left")
    assert shown(source) == [(100.0, "left", 2), (100.25, "left", 1), (100.5, "left", 3), (100.75, "left", 0)]
    assert source.n_frames == 4
    assert source.cameras == ("left",)
    assert next(iter(source)).source == str(tmp_path / "img1.bmp")


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        ([f"{ns}.png" for ns in NS], [ns / 10**9 for ns in NS]),
        (["1305031102.175304.png", "1305031102.211214.png"], [1305031102.175304, 1305031102.211214]),
        (["left_9.5.png", "left_12.25.png"], [9.5, 12.25]),
    ],
)
def test_stamps_in_names(tmp_path, names, stamps):
    save(tmp_path, *names)
    assert shown(open_frames(tmp_path)) == [(stamp, "cam0", i) for i, stamp in enumerate(stamps)]


def test_names_without_stamps(tmp_path):
    save(tmp_path, "000001.png", "frame-000002.color.png", "1403636579.png")
    with pytest.raises(DetectError, match=r"000001\.png: the name holds no stamp.*rate_hz"):
        open_frames(tmp_path)
    save(tmp_path, "5.5.png")
    with pytest.warns(InputWarning, match=r"3 of 4 images have no stamp in their name.*first is 000001\.png"):
        source = open_frames(tmp_path)
    assert shown(source) == [(5.5, "cam0", 0)]


@pytest.mark.parametrize(
    ("text", "stamps"),
    [
        ("stamp_s,file\n2.5,b.png\n1.25,a.png\n", [1.25, 2.5]),
        ("image;quality;timestamp_ns\na.png;1;1403636579763555584\nb.png;1;1403636579813555456\n", NS[:2]),
        ("# colour images\n# file: 'x.bag'\n# timestamp filename\n1.25 rgb/a.png\n2.5 rgb/b.png\n", [1.25, 2.5]),
        ("#timestamp [ns],filename\n1000000000,a.png\n2500000000,b.png\n", [1.0, 2.5]),
        ("1403636579763555584,a.png\n1403636579813555456,b.png\n", NS[:2]),
        ("1.25 a.png\n2.5 b.png\n", [1.25, 2.5]),
        ("time_us,file\n1250000,a.png\n2500000,b.png\n", [1.25, 2.5]),
    ],
)
def test_tables(tmp_path, text, stamps):
    save(tmp_path / "rgb", "a.png", "b.png")
    where = table(tmp_path / "table.txt", text)
    expected = [stamp if stamp < 1e15 else stamp / 10**9 for stamp in stamps]
    assert shown(open_frames(tmp_path / "rgb", stamps=where)) == [
        (stamp, "cam0", i) for i, stamp in enumerate(expected)
    ]


def test_euroc_and_tum_layouts(tmp_path):
    """EuRoC names files in `data` beside the table, TUM with the folder; the path may be either folder."""
    save(tmp_path / "cam0" / "data", f"{NS[0]}.png", f"{NS[1]}.png")
    euroc = table(tmp_path / "cam0" / "data.csv", "".join(f"{ns},{ns}.png\n" for ns in NS[:2]))
    assert shown(open_frames(tmp_path / "cam0" / "data", stamps=euroc)) == [
        (ns / 10**9, "cam0", i) for i, ns in enumerate(NS[:2])
    ]
    save(tmp_path / "tum" / "rgb", "1.5.png")
    tum = table(tmp_path / "tum" / "rgb.txt", "# timestamp filename\n1.5 rgb/1.5.png\n")
    for folder in (tmp_path / "tum", tmp_path / "tum" / "rgb"):
        assert shown(open_frames(folder, stamps=tum)) == [(1.5, "cam0", 0)]


def test_cameras_of_a_table(tmp_path):
    save(tmp_path, "left/1.png", "right/1.png", "left/2.png")
    text = "stamp_s,camera,file\n1,right,right/1.png\n1,left,left/1.png\n2,left,left/2.png\n"
    (tmp_path / "tables").mkdir()
    source = open_frames(tmp_path, stamps=table(tmp_path / "tables" / "t.csv", text), camera="unused")
    assert source.cameras == ("left", "right")
    assert shown(source) == [(1.0, "right", 1), (1.0, "left", 0), (2.0, "left", 2)]


def test_resumes_at_every_frame(tmp_path):
    save(tmp_path, *(f"{i}.png" for i in range(4)))
    source = pickle.loads(pickle.dumps(open_frames(tmp_path, rate_hz=2.0)))
    for start in range(6):
        frames = list(source.frames(start))
        assert [(f.index, f.stamp_s) for f in frames] == [(i, i / 2) for i in range(start, 4)]
    with pytest.raises(DetectError, match=r"start at image -1"):
        next(source.frames(-1))


def test_a_table_that_names_missing_images(tmp_path):
    save(tmp_path, "a.png", "b.png")
    where = table(tmp_path / "t.csv", "stamp_s,file\n1,a.png\n2,gone.png\n3,b.png\n4,lost.png\n")
    with pytest.raises(DetectError, match=r"t\.csv:3: names 'gone\.png', which is not in .*; 2 of the 4 rows"):
        open_frames(tmp_path, stamps=where)
    source = open_frames(tmp_path, stamps=where, on_bad="skip")
    with pytest.warns(InputWarning) as caught:
        assert [(f.index, f.stamp_s) for f in source] == [(0, 1.0), (2, 3.0)]
    assert len(caught) == 2
    assert "gone.png: no such file" in str(caught[0].message)
    assert "2 images could not be read" in str(caught[1].message)
    assert sorted(source.bad) == [1, 3]
    save(tmp_path / "other", "c.png")
    with pytest.raises(DetectError, match=r"4 of the 4 rows.*another folder"):
        open_frames(
            tmp_path / "other",
            stamps=table(
                tmp_path / "t2.csv", where.read_text().replace(",", ",x").replace("stamp_s,xfile", "stamp_s,file")
            ),
            on_bad="skip",
        )


def test_images_that_the_table_does_not_name(tmp_path):
    save(tmp_path, "a.png", "b.png", "c.png")
    with pytest.warns(InputWarning, match=r"2 of 3 images are not in .*t\.csv and are left out; the first is b\.png"):
        source = open_frames(tmp_path, stamps=table(tmp_path / "t.csv", "stamp_s,file\n1,a.png\n"))
    assert shown(source) == [(1.0, "cam0", 0)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stamp_s,file\n1,a.png\nx,b.png\n", r"t\.csv:3: stamp 'x', expected a number"),
        ("stamp_s,file\n1,a.png\n1.0,b.png\n", r"t\.csv:3: b\.png has the stamp 1\.0 s of a\.png \(.*t\.csv:2\)"),
        (
            "stamp_s,file\n1,a.png\n2,a.png\n3,b.png\n",
            r"t\.csv:3: .*a\.png is named a second time, first in .*t\.csv:2",
        ),
        ("stamp_s,file\n1,\n2,b.png\n", r"t\.csv:2: column 1 .* holds ''"),
        ("a.png,1\nb.png,2\n", r"t\.csv:1: stamp 'a\.png', expected a number"),
        ("1,2\n2,3\n", r"t\.csv:1: column 1 \(counted from 0\) holds '2', expected the name of an image"),
        ("stamp_s,quality\n1,2\n", r"the table has stamp_s, quality; expected columns stamp_s and file"),
        ("stamp_s,time,file\n1,1,a.png\n", r"2 columns of stamps: stamp_s, time"),
        ("1,2,3,a.png\n", r"4 columns without names"),
        ("t,file\n1403636579763555,a.png\n", r"stamp 1403636579763555 is neither .* stamp_us"),
        ("stamp_s,file,camera\n1,a.png,left\n2,b.png,\n", r"t\.csv:3: no camera"),
        ("stamp_s,file\nnan,a.png\n", r"t\.csv:2: stamp 'nan'"),
        ("stamp_s,file\n1_000,a.png\n", r"t\.csv:2: stamp '1_000'"),
    ],
)
def test_tables_that_are_refused(tmp_path, text, message):
    save(tmp_path, "a.png", "b.png")
    with pytest.raises(DetectError, match=message):
        open_frames(tmp_path, stamps=table(tmp_path / "t.csv", text))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rate_hz": 0.0}, "rate_hz is 0.0, expected a positive number"),
        ({"rate_hz": 5.0, "start_s": float("nan")}, "start_s is nan"),
        ({"start_s": 5.0}, "stamp of the first image at `rate_hz`"),
        ({"rate_hz": 5.0, "stamps": "t.csv"}, "both `stamps` and `rate_hz`"),
        ({"topics": {"/a": "b"}}, "'topics' says nothing about a source of kind 'folder'"),
        ({"rate_hz": 5.0, "on_bad": "ignore"}, "on_bad is 'ignore'"),
        ({"kind": "film"}, "kind 'film', expected one of folder, video, bag"),
    ],
)
def test_arguments_that_are_refused(tmp_path, arguments, message):
    save(tmp_path, "a.png")
    with pytest.raises(DetectError, match=message):
        open_frames(tmp_path, **arguments)


def test_paths_that_are_refused(tmp_path):
    save(tmp_path, "below/a.png")
    with pytest.raises(DetectError, match=r"holds no images .*folder below, such as 'below'"):
        open_frames(tmp_path, rate_hz=1.0)
    with pytest.raises(DetectError, match="single image, expected a folder"):
        open_frames(tmp_path / "below" / "a.png")
    with pytest.raises(DetectError, match="no such file or folder"):
        open_frames(tmp_path / "gone")
    with pytest.raises(DetectError, match="no such folder"):
        open_frames(tmp_path / "gone", kind="folder")


def test_unreadable_images_are_named_or_counted(tmp_path):
    save(tmp_path, "0.5.png", "1.5.jpg", "2.5.png")
    (tmp_path / "0.5.png").write_bytes(b"")
    (tmp_path / "1.5.jpg").write_bytes((tmp_path / "1.5.jpg").read_bytes()[:-40])
    with pytest.raises(DetectError, match=r"0\.5\.png: the image is empty"):
        list(open_frames(tmp_path))
    source = open_frames(tmp_path, on_bad="skip")
    for _ in range(2):  # counted once each, however often the source is read
        with pytest.warns(InputWarning, match=r"empty.*left out|2 images could not be read"):
            assert shown(source) == [(2.5, "cam0", 2)]
    assert list(source.bad) == [0, 1]
    assert "no image that OpenCV can decode" in source.bad[1]


def test_pixels_as_stored(tmp_path):
    """16 bits become the upper 8, grey three equal channels, and the rotation that EXIF asks for is not applied."""
    wide = np.arange(6 * 4, dtype=np.uint16).reshape(4, 6) * 2731
    assert cv2.imwrite(str(tmp_path / "0.5.png"), wide)
    data = cv2.imencode(".jpg", np.zeros((8, 16, 3), np.uint8))[1].tobytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"  # orientation 6: turn by 90°
    turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape == (16, 8, 3)
    (tmp_path / "1.5.jpg").write_bytes(turned)
    grey, plain = (frame.image for frame in open_frames(tmp_path))
    np.testing.assert_array_equal(grey, np.repeat((wide >> 8).astype(np.uint8)[..., None], 3, axis=2))
    assert plain.shape == (8, 16, 3)
