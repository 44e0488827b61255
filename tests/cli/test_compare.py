"""`jaxgeo compare`: files in, figures, pictures and one coloured cloud out; what is refused."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxgeo.cli.main import BAD_INPUT, main
from jaxgeo.io.clouds.chunk import CloudChunk
from jaxgeo.io.clouds.writer import cloud_writer

ORIGIN = np.array([79300.0, 76800.0, 300.0])


def written(path: Path, points: np.ndarray, crs: str | None = "EPSG:2169", origin: np.ndarray = ORIGIN) -> Path:
    with cloud_writer(path, {}, origin, crs) as writer:
        for part in np.array_split(points - (origin - ORIGIN), 3):
            writer.append(CloudChunk(part, {}))
    return path


@pytest.fixture(scope="module")
def clouds() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    a = rng.uniform(0.0, [30.0, 20.0, 3.0], (900, 3))
    return a, a[:700] + rng.normal(0.0, 0.05, (700, 3))


def test_two_clouds_of_one_system(tmp_path, clouds, capsys):
    a, b = clouds
    files = written(tmp_path / "uav.laz", a), written(tmp_path / "ugv.ply", b, origin=np.add(ORIGIN, [5.0, -3.0, 1.0]))
    out = tmp_path / "out"
    assert main(["compare", *map(str, files), "--out", str(out), "--simulated"]) == 0
    said = capsys.readouterr().out
    found = json.loads((out / "compare.json").read_text())
    expected = KDTree(b).query(a)[0]
    there = found["distances"]["uav to ugv"]
    assert there["median_m"] == pytest.approx(np.median(expected), abs=1e-3)  # LAS holds millimetres
    assert there["mean_m"] == pytest.approx(np.mean(expected), abs=1e-3)
    assert there["percentiles_m"]["95"] == pytest.approx(np.percentile(expected, 95), abs=2e-3)
    assert found["distances"]["ugv to uav"]["n"] == 700
    assert found["simulated"] is True
    assert "(simulated data)" in said
    assert f"median {100 * np.median(expected):.1f} cm" in said
    fused = laspy.read(out / "fused.laz")
    np.testing.assert_allclose(fused.xyz[:900], a + ORIGIN, atol=6e-4)
    np.testing.assert_allclose(fused.xyz[900:], b + ORIGIN, atol=6e-4)
    assert set(zip(fused.red[:900].tolist(), fused.blue[:900].tolist(), strict=True)) == {(0, 0xB2B2)}
    assert 'AUTHORITY["EPSG","2169"]]' in fused.header.vlrs[0].string
    assert {p.name for p in out.glob("*.png")} == {
        "distance_map.png",
        "distance_map_back.png",
        "distance_histogram.png",
    }


def test_thinning_keeps_one_point_a_voxel(tmp_path, clouds):
    a, b = clouds
    files = written(tmp_path / "a.ply", a), written(tmp_path / "b.ply", b)
    assert main(["compare", *map(str, files), "--out", str(tmp_path / "o"), "--voxel", "2", "--quiet"]) == 0
    found = json.loads((tmp_path / "o" / "compare.json").read_text())
    assert found["distances"]["a to b"]["n"] == len({tuple(v) for v in np.floor((a + ORIGIN - origin_of(found)) / 2)})
    assert found["clouds"]["a"]["points"] == 900


def origin_of(found: dict) -> np.ndarray:
    return np.array(found["origin_enh_m"])


def test_runs_by_their_folders(tmp_path, clouds, capsys):
    a, b = clouds
    for name, points in (("one", a), ("two", b)):
        (tmp_path / name).mkdir()
        written(tmp_path / name / "cloud_dense.laz", points)
        (tmp_path / name / "run.json").write_text(json.dumps({"simulated": name == "two"}))
    assert main(["compare", str(tmp_path / "one"), str(tmp_path / "two"), "--out", str(tmp_path / "o")]) == 0
    assert "one and two (simulated data)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("second", "crs", "arguments", "said"),
    [
        ("b.ply", "EPSG:25832", [], "expected one system"),
        ("b.ply", "EPSG:2169", ["--names", "a"], "give two names with --names A,B"),
        ("a.ply", "EPSG:2169", [], "give two names with --names A,B"),
        ("folder", "EPSG:2169", [], "expected one georeferenced cloud (cloud_*.laz, .las or .ply), found none"),
        ("c.xyz", "EPSG:2169", [], "suffix '.xyz'"),
    ],
)
def test_what_is_refused(tmp_path, clouds, capsys, second, crs, arguments, said):
    (tmp_path / "folder").mkdir()
    (tmp_path / "c.xyz").write_text("0 0 0\n")
    first = written(tmp_path / "a.ply", clouds[0])
    if second == "b.ply":
        written(tmp_path / second, clouds[1], crs)
    out = tmp_path / "out"
    assert main(["compare", str(first), str(tmp_path / second), "--out", str(out), *arguments]) == BAD_INPUT
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
    assert not out.exists()


def test_a_cloud_without_a_system_takes_the_others_and_says_so(tmp_path, clouds, capsys):
    files = written(tmp_path / "a.ply", clouds[0]), written(tmp_path / "b.laz", clouds[1], crs=None)
    assert main(["compare", *map(str, files), "--out", str(tmp_path / "o")]) == 0
    assert "says nothing of its coordinate system" in capsys.readouterr().err
    assert json.loads((tmp_path / "o" / "compare.json").read_text())["crs"] == "EPSG:2169"
