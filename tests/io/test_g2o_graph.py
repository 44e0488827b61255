from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.data import RelativePoses
from jaxgeo.errors import GraphError
from jaxgeo.io.g2o_graph import EDGE, G2oGraph, read_g2o_graph, write_g2o_graph
from jaxgeo.io.input_warning import InputWarning

INFORMATION = "11 12 13 14 15 16 22 23 24 25 26 33 34 35 36 44 45 46 55 56 66"
FIRST_EDGE = f"{EDGE} 7 -3 1 2 3 0 0 0 1 {INFORMATION}"
GRAPH = f"""# two poses, numbered as they like
VERTEX_SE3:QUAT 7 3 0 0 0 0 1 0
VERTEX_SE3:QUAT -3 1 0 0 0 0 0 1
FIX 7
{FIRST_EDGE}
"""
LANDMARK = "VERTEX_SE3:QUAT 9 4 4 4 0 0 0 1\nEDGE_SE3 7 9 0 0 0 0 0 0 1\nVERTEX_TRACKXYZ 12 1 2 3\n"


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "graph.g2o"
    path.write_text(text)
    return path


def test_poses_in_the_order_of_ids_edges_refer_to_rows(tmp_path: Path) -> None:
    graph = read_g2o_graph(write(tmp_path, GRAPH))
    assert graph.id == (-3, 7)
    assert graph.fixed.tolist() == [1]
    assert (graph.edges.first.tolist(), graph.edges.second.tolist()) == ([1], [0])
    assert graph.edges.t_m.tolist() == [[1, 2, 3]]
    assert graph.edges.quat_wxyz.tolist() == [[1, 0, 0, 0]]
    expected = np.add.outer(10 * np.arange(1, 7), np.arange(1, 7))
    np.testing.assert_array_equal(np.triu(graph.edges.information[0]), np.triu(expected))
    np.testing.assert_array_equal(graph.edges.information[0], graph.edges.information[0].T)


def test_what_is_no_pose_graph_is_skipped_and_counted(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match=r"skipped: EDGE_SE3 \(1\), VERTEX_TRACKXYZ \(1\), .* of landmarks \(1\)"):
        graph = read_g2o_graph(write(tmp_path, GRAPH + LANDMARK))
    assert graph.id == (-3, 7)


def test_error_is_gtsams_so_the_rotations_information_is_taken_as_written(tmp_path: Path) -> None:
    """One edge off by 0.2 rad about each axis in turn, its information anything but diagonal."""
    rng = np.random.default_rng(1)
    half = rng.normal(size=(6, 6))
    information = half @ half.T + np.eye(6)
    upper = " ".join(map(repr, information[np.triu_indices(6)].tolist()))
    for axis in range(3):
        vector = [0.0, 0.0, 0.0]
        vector[axis] = float(np.sin(0.1))
        turned = f"{vector[0]!r} {vector[1]!r} {vector[2]!r} {float(np.cos(0.1))!r}"
        text = f"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 {turned}\n{EDGE} 0 1 0 0 0 0 0 0 1 {upper}\n"
        path = write(tmp_path, text)
        graph = read_g2o_graph(path)
        residual = np.zeros(6)
        residual[3 + axis] = 0.2
        factors, values = gtsam.readG2o(str(path), True)
        assert 0.5 * residual @ graph.edges.information[0] @ residual == pytest.approx(factors.error(values), rel=1e-12)


def test_reads_the_edges_that_gtsam_reads() -> None:
    path = data_root() / "g2o/parking-garage.g2o"
    graph = read_g2o_graph(path)
    factors, _ = gtsam.readG2o(str(path), True)
    assert len(graph.edges) == factors.size() == 6275
    for i in (0, 1234, 6274):
        factor: Any = factors.at(i)
        assert [graph.id[graph.edges.first[i]], graph.id[graph.edges.second[i]]] == list(factor.keys())
        np.testing.assert_allclose(graph.edges.t_m[i], factor.measured().translation(), rtol=1e-15)
        swap = [3, 4, 5, 0, 1, 2]
        ours = graph.edges.information[i][np.ix_(swap, swap)]
        np.testing.assert_allclose(ours, factor.noiseModel().information(), rtol=1e-6, atol=1e-9)


def test_export_then_import_is_identity(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    quat = rng.normal(size=(5, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    half = rng.normal(size=(3, 6, 6))
    information = half @ half.transpose(0, 2, 1)
    information = 0.5 * (information + information.transpose(0, 2, 1))
    edges = RelativePoses(np.array([0, 1, 4]), np.array([1, 2, 0]), rng.normal(size=(3, 3)), quat[:3], information)
    graph = G2oGraph(
        (-5, 0, 3, 6989586621679009792, 6989586621679009793), rng.normal(size=(5, 3)), quat, edges, np.array([2])
    )
    write_g2o_graph(tmp_path / "out.g2o", graph)
    read = read_g2o_graph(tmp_path / "out.g2o")
    assert read.id == graph.id
    assert read.fixed.tolist() == [2]
    for ours, theirs in (
        (read.position_m, graph.position_m),
        (read.edges.t_m, edges.t_m),
        (read.edges.information, information),
    ):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_allclose(read.quat_wxyz, quat, rtol=1e-14)
    np.testing.assert_array_equal(read.edges.first, edges.first)
    np.testing.assert_array_equal(read.edges.second, edges.second)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GRAPH.replace(" 66", ""), r"graph\.g2o:5: 30 fields, expected the 31 of EDGE_SE3:QUAT id id x y z"),
        (GRAPH.replace("QUAT 7 -3", "QUAT 7 8"), r"graph\.g2o:5: vertex 8 is not in the file"),
        (GRAPH.replace("QUAT 7 -3", "QUAT 7 a"), r"graph\.g2o:5: edge's vertex id 'a', expected a whole number"),
        (GRAPH.replace(" 66", " nan"), r"graph\.g2o:5: column 30 .* holds 'nan'"),
        (GRAPH.replace("3 0 0 0 1 11", "3 0 0 0 2 11"), r"graph\.g2o:5: the quaternion has norm 2"),
        (GRAPH.replace("FIX 7", "FIX 8"), r"graph\.g2o:4: 'FIX 8', expected FIX followed by ids"),
        (GRAPH.replace(FIRST_EDGE, ""), r"graph\.g2o: no EDGE_SE3:QUAT record: poses alone are no graph"),
        ("VERTEX_SE2 0 1 2 3\n", r"no VERTEX_SE3:QUAT record; found VERTEX_SE2 \(1\)"),
    ],
)
def test_bad_graphs(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(GraphError, match=message):
        read_g2o_graph(write(tmp_path, text))
