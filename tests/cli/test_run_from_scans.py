"""`jaxgeo run` with scans and no trajectory: odometry, mapping, correction and the georeferenced cloud."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import yaml
from mapping.walled_loop import STEP_S, scans_of, walk, world
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxgeo.cli.computed import computed_odometry
from jaxgeo.cli.main import BAD_INPUT, main
from jaxgeo.cli.progress import Progress
from jaxgeo.config import load_config
from jaxgeo.data import Sightings
from jaxgeo.geometry import rigid
from jaxgeo.io.scans.write import write_packed_scans
from jaxgeo.io.sightings_csv import write_pose_sightings

ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
GRID_FROM_WORLD = rigid.matrices(np.array([12.0, -7.0, 3.0]), Rotation.from_euler("z", 0.7).as_quat(scalar_first=True))
# Markers a metre beside the way, and the pose that passes them; A is passed twice.
MARKERS = {
    "A": (3.5, 1.0, 1.0),
    "B": (9.0, 1.2, 1.4),
    "C": (15.0, 6.0, 1.1),
    "D": (8.0, 11.0, 1.5),
    "E": (1.0, 6.0, 0.9),
}


def recorded(folder: Path) -> Path:
    """A walk round a block, its scans, the markers as they were seen, and the config; all simulated."""
    rng = np.random.default_rng(7)
    truth = walk()
    write_packed_scans(folder / "scans.npz", scans_of(truth, world(rng), rng))
    rows = []
    for name, place in MARKERS.items():
        away = np.linalg.norm(truth[:, :3, 3] - place, axis=1)
        passes = (
            [int(np.argmin(away[:60]))] if name != "A" else [int(np.argmin(away[:20])), 60 + int(np.argmin(away[60:]))]
        )
        for k in passes:
            rows += [
                (j * STEP_S, name, rigid.apply(rigid.inverse(truth[j]), np.array([place]))[0])
                for j in (max(k, 1) - 1, max(k, 1), max(k, 1) + 1)
            ]
    rows.sort(key=lambda row: row[0])
    n = len(rows)
    seen = Sightings(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]) + 0.01 * rng.normal(size=(n, 3)),
        np.full((n, 4), np.nan),
        np.tile(np.diag([1e-4] * 3 + [0.0] * 3), (n, 1, 1)),
        np.zeros(n, bool),
        np.full(n, np.nan),
        np.array([f"row {i}" for i in range(n)]),
    )
    write_pose_sightings(folder / "sightings.csv", seen)
    surveyed = rigid.apply(GRID_FROM_WORLD, np.array(list(MARKERS.values()))) + ORIGIN_ENH_M
    config = {
        "name": "walled",
        "simulated": True,
        "crs": "EPSG:2169",
        "origin_enh_m": ORIGIN_ENH_M.tolist(),
        "survey": {
            "points": {
                name: {"E": e, "N": n, "h": h} for name, (e, n, h) in zip(MARKERS, surveyed.tolist(), strict=True)
            }
        },
        "scans": {"path": "scans.npz"},
        "sightings": {"kind": "poses", "file": "sightings.csv"},
        "visits": {"gap_s": 5.0},
        "noise": {"mode": "fixed"},  # learning is tested elsewhere, and takes most of the time
        "report": {"interactive": False},
    }
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scans")
    assert main(["run", str(recorded(folder)), "--out", str(folder / "out"), "--quiet"]) == 0
    return folder


def test_both_trajectories_are_corrected(run):
    found = json.loads((run / "out" / "metrics.json").read_text())["trajectories"]
    assert set(found) == {"icp", "dense"}
    for trajectory in found.values():
        assert trajectory["n_visits"] == 6
        assert trajectory["loo"]["fixed"]["mean_m"] < 0.15
        assert trajectory["revisit"]["A"]["refined_m"] < 0.1


def test_the_cloud_lies_on_the_world_in_the_grid(run):
    cloud = laspy.read(run / "out" / "cloud_dense.laz")
    assert 'AUTHORITY["EPSG","2169"]]' in cloud.header.vlrs[0].string
    points = np.asarray(cloud.xyz) - ORIGIN_ENH_M
    surfaces = rigid.apply(GRID_FROM_WORLD, world(np.random.default_rng(7)))
    away = KDTree(surfaces).query(points)[0]
    assert len(points) > 10_000
    assert np.median(away) < 0.1  # the world's points are 16 cm apart, the cloud's voxels 10
    stamps = np.asarray(cloud.gps_time)
    assert (stamps.min(), stamps.max()) == (0.0, STEP_S * (len(walk()) - 1))


def test_a_second_run_uses_what_is_there(run, monkeypatch):
    before = (run / "out" / "computed" / "icp" / "trajectory.tum").read_bytes()
    written = json.loads((run / "out" / "metrics.json").read_text())

    def refuse(*_, **__):
        raise AssertionError("made again")

    monkeypatch.setattr("jaxgeo.cli.computed.estimate_odometry", refuse)
    monkeypatch.setattr("jaxgeo.cli.computed.build_map", refuse)
    monkeypatch.chdir(run)  # by relative paths too
    code = main(["run", "config.yaml", "--out", "out", "--quiet", "--set", "mapping.clouds=none"])
    assert code == 0
    assert (run / "out" / "computed" / "icp" / "trajectory.tum").read_bytes() == before
    again = json.loads((run / "out" / "metrics.json").read_text())
    for name in ("icp", "dense"):
        assert again["trajectories"][name]["loo"] == written["trajectories"][name]["loo"]
    changed = load_config(run / "config.yaml", ["scans.min_range_m=0.5"])
    with pytest.raises(AssertionError, match="made again"):
        computed_odometry("icp", changed, run / "out" / "computed" / "icp", Progress(quiet=True))


def test_scans_that_are_not_there(run, tmp_path, capsys):
    arguments = ["run", str(run / "config.yaml"), "--out", str(tmp_path / "o"), "--set", "scans.path=nowhere.npz"]
    assert main(arguments) == BAD_INPUT
    error = capsys.readouterr().err
    assert "nowhere.npz" in error
    assert "Traceback" not in error
    assert not (tmp_path / "o" / "metrics.json").exists()
