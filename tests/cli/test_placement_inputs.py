"""From a placement's config to the local frame: paths of every kind, places, areas, noise; and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.cli.placement_areas import distance_to, inside
from jaxgeo.cli.placement_inputs import placement_inputs
from jaxgeo.config.load import read_config
from jaxgeo.config.placement import PlacementConfig
from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError
from jaxgeo.georef import LocalFrame
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.io import write_tum
from jaxgeo.io.waypoints_csv import followed

CORNER_ENH_M = np.array([[79300.0, 76800.0, 340.0], [79360.0, 76800.0, 341.0], [79360.0, 76840.0, 339.5]])
ORIGIN_ENH_M = [79300.0, 76800.0, 300.0]
SQUARE = np.array([[-5.0, -5.0], [30.0, -5.0], [30.0, 20.0], [-5.0, 20.0], [-5.0, -5.0]])
HOLE = np.array([[5.0, -2.0], [10.0, -2.0], [10.0, 2.0], [5.0, 2.0], [5.0, -2.0]])
BASE = {
    "name": "site",
    "crs": "EPSG:2169",
    "path": {"waypoints": {"file": "path.csv"}},
    "noise": {"odometry": "lidar"},
    "anchors": {"count": 4},
    "sighting": {"range_m": 8.0, "sigma_m": 0.03},
}


def inputs(folder: Path, *overrides: str, **changes):
    rows = "\n".join(",".join(map(str, row)) for row in CORNER_ENH_M.tolist())
    (folder / "path.csv").write_text(f"E,N,h\n{rows}\n")
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(BASE | changes))
    return placement_inputs(read_config(path, PlacementConfig, overrides), with_layout=False)


def refusal(folder: Path, *overrides: str, **changes) -> str:
    with pytest.raises(InputError) as error:
        inputs(folder, *overrides, **changes)
    return str(error.value)


def areas(folder: Path, *polygons: list[np.ndarray], crs: str | None = None) -> dict:
    coordinates = [[(ring + ORIGIN_ENH_M[:2]).tolist() for ring in rings] for rings in polygons]
    value = {"type": "MultiPolygon", "coordinates": coordinates}
    if crs is not None:
        value["crs"] = {"type": "name", "properties": {"name": crs}}
    (folder / "areas.geojson").write_text(json.dumps(value))
    return BASE["anchors"] | {"areas": "areas.geojson"}


def test_waypoints_and_what_follows_from_the_config(tmp_path):
    found = inputs(tmp_path)
    np.testing.assert_array_equal(found.frame.origin_enh_m, ORIGIN_ENH_M)
    np.testing.assert_allclose(found.frame.to_grid(found.path.position_m[[0, -1]]), CORNER_ENH_M[[0, -1]])
    assert found.given.reach_m == 4.0
    assert found.given.apart_m == 16.0
    assert found.given.most_passes > 1
    assert inputs(tmp_path, "sighting.passes=one").given.most_passes == 1
    # An anchor 7 m up is seen from 8 m away at most 3.9 m aside.
    lifted = inputs(tmp_path, "anchors.reach_m=6", "anchors.height_above_path_m=7").given
    assert lifted.reach_m == pytest.approx(np.sqrt(15.0))
    assert [path.name for path in found.files] == ["path.csv"]


def test_a_trajectory_in_the_grid_and_in_a_local_frame(tmp_path):
    in_grid = followed(CORNER_ENH_M, 1.0)
    local = Trajectory(in_grid.stamp_s, in_grid.position_m - ORIGIN_ENH_M, in_grid.quat_wxyz)
    write_tum(tmp_path / "grid.tum", in_grid)
    write_tum(tmp_path / "local.tum", local)
    one = inputs(tmp_path, path={"trajectory": {"file": "grid.tum", "format": "tum"}})
    two = inputs(
        tmp_path,
        path={"trajectory": {"file": "local.tum", "format": "tum", "frame": "local"}},
        origin_enh_m=ORIGIN_ENH_M,
    )
    np.testing.assert_allclose(one.path.position_m, local.position_m, atol=1e-9)
    np.testing.assert_allclose(two.path.position_m, local.position_m, atol=1e-9)


def test_the_path_of_a_run(tmp_path):
    local = followed(CORNER_ENH_M - ORIGIN_ENH_M, 1.0)
    for name in ("icp", "dense"):
        (tmp_path / "run" / name).mkdir(parents=True)
        write_tum(tmp_path / "run" / name / "trajectory.tum", local)
        file = tmp_path / "run" / name / "trajectory.tum"
        head = "# SIMULATED DATA: not a measurement\n# crs: EPSG:2169 (LUREF)\n"
        file.write_text(f"{head}# origin E=79300.0 N=76800.0 h=300.0 m\n{file.read_text()}")
    found = inputs(tmp_path, path={"run": {"folder": "run", "trajectory": "icp"}})
    np.testing.assert_allclose(found.frame.to_grid(found.path.position_m[-1]), CORNER_ENH_M[-1])
    assert found.simulated
    assert "path.run.trajectory" in refusal(tmp_path, path={"run": {"folder": "run"}})
    assert "the config says crs: local" in refusal(
        tmp_path, path={"run": {"folder": "run", "trajectory": "icp"}}, crs="local"
    )
    assert "is no folder" in refusal(tmp_path, path={"run": {"folder": "walk"}})


def test_areas_in_wgs84_are_those_in_the_grid(tmp_path):
    wanted = areas(tmp_path, [SQUARE, HOLE])
    in_grid = inputs(tmp_path, "anchors.areas_crs=grid", anchors=wanted).given.areas_en_m
    frame = LocalFrame.create("EPSG:2169", np.array(ORIGIN_ENH_M))
    lonlat = [frame.to_wgs84(np.column_stack([ring, np.zeros(len(ring))]))[:, :2].tolist() for ring in (SQUARE, HOLE)]
    (tmp_path / "areas.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": lonlat}))
    from_wgs84 = inputs(tmp_path, anchors=wanted).given.areas_en_m
    for one, two, ring in zip(in_grid, from_wgs84, (SQUARE, HOLE), strict=True):
        np.testing.assert_allclose(one, ring[:-1], atol=1e-9)
        np.testing.assert_allclose(two, one, atol=1e-3)  # the datum shift and its inverse agree to 0.3 mm
    named = inputs(tmp_path, anchors=areas(tmp_path, [SQUARE], crs="urn:ogc:def:crs:EPSG::2169")).given.areas_en_m
    np.testing.assert_allclose(named[0], SQUARE[:-1], atol=1e-9)


@pytest.mark.parametrize(
    ("made", "overrides", "said"),
    [
        ({}, (), "is no longitude and latitude"),
        ({"crs": "EPSG:32632"}, (), "is in EPSG:32632, the config in EPSG:2169"),
        ({"crs": "EPSG:2169"}, ("anchors.areas_crs=wgs84",), "remove one of the two"),
        ({}, ("anchors.areas_crs=grid", "anchors.reach_m=1", "sighting.range_m=2"), None),
        ({}, ("crs=local",), "say anchors.areas_crs: grid"),
    ],
)
def test_areas_in_other_coordinates(tmp_path, made, overrides, said):
    wanted = areas(tmp_path, [SQUARE], **made)
    if said is None:
        assert len(inputs(tmp_path, *overrides, anchors=wanted).given.areas_en_m) == 1
    else:
        assert said in refusal(tmp_path, *overrides, anchors=wanted)


def test_areas_that_cannot_be_meant(tmp_path):
    grid = "anchors.areas_crs=grid"
    assert "the nearest area is 35.0 m from the path" in refusal(
        tmp_path, grid, anchors=areas(tmp_path, [SQUARE - [0.0, 55.0]])
    )
    shifted = areas(tmp_path, [SQUARE], [SQUARE + np.array([20.0, 0.0])])
    assert "polygon 2: overlaps with" in refusal(tmp_path, grid, anchors=shifted)
    within = areas(tmp_path, [SQUARE], [0.1 * SQUARE])
    assert "overlaps" in refusal(tmp_path, grid, anchors=within)
    beside = areas(tmp_path, [SQUARE], [SQUARE + np.array([35.0, 0.0])])  # they touch
    assert len(inputs(tmp_path, grid, anchors=beside).given.areas_en_m) == 2


@given(st.tuples(st.floats(-20.0, 40.0), st.floats(-20.0, 40.0)))
def test_distance_to_a_square_with_a_hole(point):
    rings = (SQUARE[:-1], HOLE[:-1])

    def box(ring):
        low, high = ring.min(axis=0), ring.max(axis=0)
        outside = np.maximum(np.maximum(low - point, point - high), 0.0)
        return np.linalg.norm(outside), np.minimum(point - low, high - point).min()

    (away, _), (off_hole, depth) = box(SQUARE), box(HOLE)
    expected = away if off_hole > 0.0 else max(depth, 0.0)
    at = np.array([point])
    assert distance_to(at, rings)[0] == pytest.approx(expected, abs=1e-9)
    if expected > 1e-9:
        assert not inside(at, rings)[0]


def test_places_and_a_name_that_is_both(tmp_path):
    points = {"A": {"N": 76801.0, "E": 79310.0, "h": 340.0}, "B": {"N": 76802.0, "E": 79320.0}}
    candidates = {"points": points, "height_m": 341.0}
    found = inputs(tmp_path, anchors={"count": 2, "candidates": candidates}).given
    np.testing.assert_allclose(found.candidate_m, [[10.0, 1.0, 40.0], [20.0, 2.0, 41.0]])
    assert found.candidate_name == ("A", "B")
    both = {"count": 2, "candidates": candidates, "standing": {"points": {"A": points["A"]}}}
    assert "both name 'A'" in refusal(tmp_path, anchors=both)
    far = {"count": 2, "standing": {"points": {"A": {"N": 1e6, "E": 0.0, "h": 0.0}}}}
    assert "anchors.standing: location 'A': E 0.000" in refusal(tmp_path, anchors=far)


def test_a_layout_is_read_only_where_it_is_asked_about(tmp_path):
    assert inputs(tmp_path, layout={"file": "not_yet.csv"}).layout.name == ()
    config = read_config(tmp_path / "plan.yaml", PlacementConfig)
    with pytest.raises(InputError, match=r"not_yet\.csv: no such file"):
        placement_inputs(config, with_layout=True)


def test_noise_by_kind_and_from_a_file(tmp_path):
    default = inputs(tmp_path, "noise.values.sigma_log_scale=0.5")
    sigma = default.noise_facts["sigma_median"]
    assert (sigma["log_scale"], sigma["trans_x_m_per_sqrt_m"]) == (0.5, 0.02)
    n = len(COMPONENTS)
    ensemble = {"sigma": [[0.1] * n, [0.2] * n, [0.9] * n], "weight": [0.3, 0.3, 0.4], "correlation_m": 12.0}
    learned = {"kind": "lidar", "observations": "both", "components": list(COMPONENTS), "ensemble": ensemble}
    learned |= {"theta_mean": [0.0] * n, "theta_covariance": np.eye(n).tolist()}
    (tmp_path / "noise.json").write_text(
        json.dumps({"session": "walk", "trajectories": {"icp": {"fixed": {}, "learned": learned}}})
    )
    found = inputs(tmp_path, "noise.file=noise.json")
    assert (found.noise_facts["sets"], found.noise_facts["session"]) == (3, "walk")
    assert found.noise_facts["sigma_median"]["log_scale"] == 0.2
    np.testing.assert_allclose(np.asarray(found.noise.weight), [0.3, 0.3, 0.4])
    assert "noise.odometry says 'vio'" in refusal(tmp_path, "noise.file=noise.json", "noise.odometry=vio")


def test_a_path_with_east_and_north_exchanged_is_told_so(tmp_path):
    (tmp_path / "utm.csv").write_text("E,N,h\n5497000,292000,300\n5497060,292000,300\n")
    said = refusal(tmp_path, crs="EPSG:32632", path={"waypoints": {"file": "utm.csv"}})
    assert "waypoints utm.csv: pose 1" in said
    assert "swapped" in said
