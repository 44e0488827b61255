"""Readers of scans, clouds, images and orthophotos, with small valid files for each."""

import functools
import io
import struct
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.fuzz import checks
from benchmarks.fuzz.mutations import Kind
from benchmarks.fuzz.target import Target
from jaxgeo.io.clouds.source import open_cloud
from jaxgeo.io.frames.pixels import decoded_image
from jaxgeo.io.frames.video import VideoFrames
from jaxgeo.io.orthophoto import read_orthophoto
from jaxgeo.io.rgbd.depth import depth_of_file
from jaxgeo.io.scans.columns import scan_of_columns
from jaxgeo.io.scans.packed import PackedScans
from jaxgeo.io.scans.scan_file import read_scan_file

_POINTS_M = np.array([[1.0, 2, 3], [4, 5, 6], [0, 0, 0], [7, 8, 9.5]])
_PLY_TEXT = b"""ply
format ascii 1.0
comment origin_enh_m 79300 76800 300
comment crs EPSG:2169
element vertex 3
property double x
property double y
property double z
property uchar red
property uchar green
property uchar blue
property float intensity
element face 1
property list uchar int vertex_indices
end_header
1 2 3 255 0 7 0.5
4 5 6 1 2 3 0.25
7 8 9.5 0 0 0 1e-3
3 0 1 2
"""
_PCD_HEAD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z intensity t
SIZE 4 4 4 4 4
TYPE F F F F U
COUNT 1 1 1 1 1
WIDTH 3
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 3
DATA {}
"""
_PCD_ROWS = np.array(
    [(1, 2, 3, 0.5, 0), (4, 5, 6, 0.25, 40_000_000), (7, 8, 9.5, 1, 90_000_000)],
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4")],
)
_BOX = (79300.0, 76840.0, 79310.0, 76850.0)


def _ply_binary(order: str) -> bytes:
    rows = np.zeros(3, [(name, f"{order}f4") for name in ("x", "y", "z", "intensity")])
    for i, axis in enumerate("xyz"):
        rows[axis] = _POINTS_M[[0, 1, 3], i]
    name = {"<": "little", ">": "big"}[order]
    properties = "".join(f"property float {name}\n" for name in rows.dtype.names or ())
    return f"ply\nformat binary_{name}_endian 1.0\nelement vertex 3\n{properties}end_header\n".encode() + rows.tobytes()


def _pcd_text() -> bytes:
    rows = "1 2 3 0.5 0\n4 5 6 0.25 40000000\n7 8 9.5 1 90000000\n"
    return (_PCD_HEAD.format("ascii") + rows).encode()


def _pcd_compressed() -> bytes:
    """Runs of literals are a valid LZF stream; the last copies eight bytes from twelve back."""
    columns = b"".join(_PCD_ROWS[name].tobytes() for name in _PCD_ROWS.dtype.names or ())
    packed = b"".join(bytes([len(part) - 1]) + part for part in (columns[at : at + 32] for at in range(0, 60, 32)))
    return _PCD_HEAD.format("binary_compressed").encode() + struct.pack("<2I", len(packed), len(columns)) + packed


def npy(array: np.ndarray) -> bytes:
    """An array as a `.npy` file."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _npz(compressed: bool = False, **arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, **arrays)
    return file.getvalue()


def _npz_of(member: bytes, name: str, **others: np.ndarray) -> bytes:
    """An archive whose checksums fit, however its one member was damaged."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(f"{name}.npy", member)
        for other, array in others.items():
            archive.writestr(f"{other}.npy", npy(array))
    return file.getvalue()


_PACKED = {
    "xyz": (_POINTS_M * 100).astype(np.int16),
    "scale": np.float64(0.01),
    "offset": np.array([0.0, 0.0, 1.0]),
    "offsets": np.array([0, 2, 4]),
    "times": np.array([10.0, 10.1]),
    "intensity": np.arange(4, dtype=np.uint8),
    "point_times": np.array([0.0, 0.09, 0.0, 0.08], np.float32),
}
_ONE = {"xyz": _POINTS_M.astype(np.float32), "intensity": np.arange(4.0)}


def _scan(path: Path) -> list[Any]:
    return [scan_of_columns(read_scan_file(path), 10.0, str(path), 0)]


def _packed(path: Path) -> list[Any]:
    return list(PackedScans(path))


def _member(path: Path, name: str, arrays: dict[str, np.ndarray], read: Callable[[Path], Any]) -> Any:
    """What the reader makes of an archive one of whose members is the file at the path."""
    others = {key: value for key, value in arrays.items() if key != name}
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / f"{path.name}.npz"
        archive.write_bytes(_npz_of(path.read_bytes(), name, **others))
        return read(archive)


def _cloud(path: Path) -> Any:
    source = open_cloud(path)
    columns = [list(source.column(name)) for name in source.columns]
    return source, list(source.chunks(2)), columns


def _check_cloud(value: Any) -> None:
    source, chunks, columns = value
    assert sum(map(len, chunks)) == source.n_points > 0
    assert np.isfinite(source.origin_enh_m).all()
    for chunk in chunks:
        assert chunk.points_m.shape == (len(chunk), 3)
        assert set(chunk.columns) == set(source.columns)
        assert all(values.shape == (len(chunk),) for values in chunk.columns.values())
    assert all(sum(map(len, parts)) == source.n_points for parts in columns)


def _las(suffix: str, version: str = "1.4", point_format: int = 7) -> bytes:
    import laspy
    import pyproj

    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.001] * 3, [79300.0, 76800.0, 300.0]
    header.add_crs(pyproj.CRS("EPSG:2169"))
    header.add_extra_dim(laspy.ExtraBytesParams(name="pose_index", type=np.uint32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (_POINTS_M + np.array(header.offsets)).T
    las.intensity = np.arange(4)
    file = io.BytesIO()
    las.write(file, do_compress=suffix == ".laz")
    return file.getvalue()


_PICTURE = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(6, 8, 3)


def encoded(suffix: str, image: np.ndarray = _PICTURE) -> bytes:
    """An image as a file of that kind."""
    return cv2.imencode(suffix, image)[1].tobytes()


def _image(path: Path) -> np.ndarray:
    return decoded_image(path.read_bytes(), str(path))


def _video() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
        for i in range(3):
            writer.write(np.full((48, 64, 3), 40 * i, np.uint8))
        writer.release()
        return path.read_bytes()


def _frames(path: Path) -> list[np.ndarray]:
    return [frame.image for frame in VideoFrames(path, rate_hz=10.0)]


def _check_frames(value: list[np.ndarray]) -> None:
    for image in value:
        checks.bgr(image)


def _tiff(**profile: Any) -> bytes:
    import rasterio
    from rasterio.transform import Affine

    bands = np.arange(3 * 10 * 10, dtype=profile.pop("dtype", np.uint8)).reshape(3, 10, 10)
    place = Affine(1.0, 0.0, 79300.0, 0.0, -1.0, 76850.0)
    with rasterio.MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=10, height=10, count=3, dtype=bands.dtype, crs="EPSG:2169", transform=place, **profile
        ) as file:
            file.write(bands)
        return memory.read()


def _check_photo(value: Any) -> None:
    assert value.rgba.dtype == np.uint8
    assert value.rgba.shape[2] == 4
    assert np.isfinite(value.bounds_en_m).all()


def _target(
    name: str,
    suffix: str,
    read: Callable[[Path], Any],
    check: Callable[[Any], None],
    *examples: Callable[[], bytes],
    covers: tuple[str, ...],
    kind: Kind = "binary",
    places: bool = True,
) -> Target:
    make_all = functools.cache(lambda: tuple(make() for make in examples))
    return Target(name, suffix, kind, read, check, make_all, covers, places=places)


_SCANS = "jaxgeo.io.scans"
_SCAN_FILE = (f"{_SCANS}.scan_file.read_scan_file", f"{_SCANS}.columns.scan_of_columns")
_PLY = (
    *("jaxgeo.io.ply.read_ply_header", "jaxgeo.io.ply.ply_vertices", "jaxgeo.io.clouds.source.open_cloud"),
    "jaxgeo.io.clouds.ply_cloud.PlyCloud",
)
_NPZ = (f"{_SCANS}.npz.load_arrays", f"{_SCANS}.npz.points_of_arrays", f"{_SCANS}.npz.columns_of_points")

BINARY_TARGETS = (
    _target(
        *("scan-ply", ".ply", _scan, checks.scans),
        *(lambda: _PLY_TEXT, lambda: _ply_binary("<"), lambda: _ply_binary(">")),
        covers=_SCAN_FILE,
    ),
    _target(
        *("scan-pcd", ".pcd", _scan, checks.scans),
        *(_pcd_text, lambda: _PCD_HEAD.format("binary").encode() + _PCD_ROWS.tobytes(), _pcd_compressed),
        covers=(f"{_SCANS}.pcd.read_pcd", f"{_SCANS}.lzf.unpacked"),
    ),
    _target(
        *("scan-kitti", ".bin", _scan, checks.scans),
        lambda: np.column_stack([_POINTS_M, np.arange(4)]).astype("<f4").tobytes(),
        covers=_SCAN_FILE,
    ),
    _target("scan-npz", ".npz", _scan, checks.scans, lambda: _npz(**_ONE), lambda: _npz(True, **_ONE), covers=_NPZ),
    _target(
        *("scan-npz-member", ".npy", functools.partial(_member, name="xyz", arrays=_ONE, read=_scan), checks.scans),
        *(lambda: npy(_ONE["xyz"]), lambda: npy(_POINTS_M)),
        covers=_NPZ,
        places=False,
    ),
    _target(
        *("scan-npy", ".npy", _scan, checks.scans),
        *(lambda: npy(_POINTS_M), lambda: npy(_PCD_ROWS), lambda: npy(np.asfortranarray(_POINTS_M.astype("f4")))),
        covers=_SCAN_FILE,
    ),
    _target(
        *("packed", ".npz", _packed, checks.scans),
        *(lambda: _npz(**_PACKED), lambda: _npz(True, **_PACKED)),
        covers=(f"{_SCANS}.packed.PackedScans", f"{_SCANS}.npz.check_columns"),
    ),
    *(
        _target(
            *(f"packed-{name}", ".npy", functools.partial(_member, name=name, arrays=_PACKED, read=_packed)),
            checks.scans,
            functools.partial(npy, _PACKED[name]),
            covers=(f"{_SCANS}.packed.PackedScans", f"{_SCANS}.point_times.point_time_s"),
            places=False,
        )
        for name in ("xyz", "scale", "offset", "offsets", "times", "intensity", "point_times")
    ),
    _target("cloud-ply", ".ply", _cloud, _check_cloud, lambda: _PLY_TEXT, covers=_PLY, kind="text"),
    _target(
        *("cloud-ply-binary", ".ply", _cloud, _check_cloud, lambda: _ply_binary("<"), lambda: _ply_binary(">")),
        covers=_PLY,
    ),
    _target(
        *("cloud-las", ".las", _cloud, _check_cloud, lambda: _las(".las"), lambda: _las(".las", "1.2", 3)),
        covers=("jaxgeo.io.clouds.las.LasCloud",),
    ),
    _target(
        *("cloud-laz", ".laz", _cloud, _check_cloud, lambda: _las(".laz"), lambda: _las(".laz", "1.2", 3)),
        covers=("jaxgeo.io.clouds.las.LasCloud", "jaxgeo.io.clouds.laszip_head.laszip_problem"),
    ),
    _target(
        *("image", ".png", _image, checks.bgr),
        *(functools.partial(encoded, suffix) for suffix in (".png", ".jpg", ".bmp", ".tiff", ".webp", ".ppm")),
        covers=("jaxgeo.io.frames.pixels.decoded_image",),
    ),
    _target(
        *("depth", ".png", functools.partial(depth_of_file, depth_unit_m=0.001), checks.depth),
        lambda: encoded(".png", np.arange(48, dtype=np.uint16).reshape(6, 8)),
        lambda: encoded(".tiff", np.arange(48, dtype=np.float32).reshape(6, 8)),
        covers=("jaxgeo.io.rgbd.depth.depth_of_file", "jaxgeo.io.rgbd.depth.metres"),
    ),
    _target("video", ".avi", _frames, _check_frames, _video, covers=("jaxgeo.io.frames.video.VideoFrames",)),
    _target(
        *("orthophoto", ".tif", functools.partial(read_orthophoto, crs="EPSG:2169", bounds_en_m=_BOX), _check_photo),
        *(_tiff, lambda: _tiff(dtype=np.float32, compress="deflate"), lambda: _tiff(dtype=np.uint16, tiled=False)),
        covers=("jaxgeo.io.orthophoto.read_orthophoto",),
    ),
)
