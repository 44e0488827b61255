from pathlib import Path

import numpy as np
import pytest
from cloud_strategy import some_cloud, whole
from data_root import data_root

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds import CloudChunk, cloud_writer, open_cloud
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.ply import PlyWriter

ORIGIN = np.array([79_300.0, 76_800.0, 300.25])


def write(path: Path, cloud: CloudChunk, crs: str | None = "EPSG:2169+5774") -> Path:
    types = {name: values.dtype for name, values in cloud.columns.items()}
    with cloud_writer(path, types, ORIGIN, crs, comments=["a first line"]) as writer:
        writer.append(cloud)
    return path


def vertices(path: Path, rows: np.ndarray, comments: tuple[str, ...] = ()) -> Path:
    with PlyWriter(path, rows.dtype, comments) as writer:
        writer.append(rows)
    return path


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    cloud = some_cloud(50)
    source = open_cloud(write(tmp_path / "a.ply", cloud))
    found = whole(source, 20)
    np.testing.assert_array_equal(found.points_m, cloud.points_m)
    assert found.columns.keys() == cloud.columns.keys()
    for name, values in cloud.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    assert source.crs == "EPSG:2169+5774"
    assert source.origin_enh_m.tolist() == ORIGIN.tolist()


def test_a_site_frame_has_no_datum(tmp_path: Path) -> None:
    assert open_cloud(write(tmp_path / "a.ply", some_cloud(), crs=None)).crs == "local"


def test_the_names_of_cloudcompare() -> None:
    source = open_cloud(data_root() / "lidar/small_gicp/source.ply")
    assert dict(source.columns) == {"intensity": np.dtype("f4")}
    assert source.crs is None
    assert source.origin_enh_m.tolist() == [0.0, 0.0, 0.0]
    assert len(whole(source, 50_000)) == 69_792


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("u1", [0, 128, 255], [0, 32896, 65535]),
        ("u2", [0, 7, 65535], [0, 7, 65535]),
        ("f4", [0.0, 0.5, 1.5], [0, 32768, 65535]),
    ],
)
def test_colours_use_the_full_range(tmp_path: Path, kind: str, given: list, expected: list[int]) -> None:
    dtype = [(axis, "f4") for axis in "xyz"] + [(name, kind) for name in ("red", "green", "blue")]
    rows = np.zeros(3, dtype)
    rows["green"] = given
    colour = whole(open_cloud(vertices(tmp_path / "a.ply", rows))).colour
    assert colour is not None
    assert colour.dtype == np.uint16
    assert colour[:, 1].tolist() == expected


def test_names_that_mean_the_same(tmp_path: Path) -> None:
    names = ("X", "Y", "Z", "scalar_GpsTime", "scalar_Intensity", "reflectance", "red", "ring")
    rows = np.ones(2, [(name, "f8") for name in names])
    columns = whole(open_cloud(vertices(tmp_path / "a.ply", rows))).columns
    # The first takes the shared name; one channel alone is no colour
    assert list(columns) == ["stamp_s", "intensity", "reflectance", "red", "ring"]
    assert columns["red"].dtype == np.float64


def test_what_ply_cannot_hold_is_said(tmp_path: Path) -> None:
    columns = {"sequence": np.zeros(2, "i8"), "pose_index": np.array([1, 2], "i8")}
    with pytest.warns(InputWarning, match=r"columns sequence are left out: PLY has no type"):
        path = write(tmp_path / "a.ply", CloudChunk(np.zeros((2, 3)), columns))
    assert whole(open_cloud(path)).columns["pose_index"].tolist() == [1, 2]
    with pytest.raises(CloudError, match="pose_index 4294967296 does not fit into 32 bits"):
        write(path, CloudChunk(np.zeros((1, 3)), {"pose_index": np.array([1 << 32])}))


def test_what_is_no_cloud(tmp_path: Path) -> None:
    rows = np.zeros(1, [("x", "f4"), ("y", "f4"), ("w", "f4")])
    with pytest.raises(CloudError, match=r"the vertices have no z; they have x, y, w"):
        open_cloud(vertices(tmp_path / "a.ply", rows))
    rows = np.zeros(1, [(axis, "f4") for axis in "xyz"])
    with pytest.raises(CloudError, match=r"comment `origin_enh_m 1 2 north`; expected three numbers"):
        open_cloud(vertices(tmp_path / "a.ply", rows, ("origin_enh_m 1 2 north",)))
    with pytest.raises(CloudError, match="holds no points"):
        open_cloud(vertices(tmp_path / "a.ply", rows[:0]))
