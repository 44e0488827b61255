from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.errors import TrajectoryError
from jaxgeo.io import RoundedInputWarning, read_trajectory


def poses(n: int = 5) -> np.ndarray:
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(np.arange(n), [0.1, -0.2, 0.3])).as_matrix()
    T[:, :3, 3] = np.outer(np.arange(n), [1.0, 2.0, 3.0])
    return T


def saved(tmp_path: Path, array: np.ndarray) -> Path:
    np.save(tmp_path / "00_poses.npy", array, allow_pickle=True)
    return tmp_path / "00_poses.npy"


@pytest.mark.parametrize("rows", [3, 4])
def test_matrices_of_either_height(tmp_path: Path, rows: int) -> None:
    read = read_trajectory(saved(tmp_path, poses()[:, :rows]), "npy", rate_hz=10.0)
    np.testing.assert_array_equal(read.position_m, poses()[:, :3, 3])
    R = Rotation.from_quat(read.quat_wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, poses()[:, :3, :3], atol=1e-15)
    np.testing.assert_array_equal(read.stamp_s, np.arange(5) / 10)


def spoilt(where: tuple[int, int, int], value: float) -> np.ndarray:
    T = poses()
    T[where] = value
    return T


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 4)), r"an array \(3, 4\) of float64; expected \(n, 4, 4\)"),
        (np.array([[["a"] * 4] * 4]), r"expected \(n, 4, 4\)"),
        (np.array([{"a": 1}], dtype=object), "is no whole NumPy array"),
        (spoilt((2, 0, 3), np.nan), "pose 3: the pose holds nan"),
        (spoilt((1, 0, 0), 2.0), "pose 2: R R.T is off the identity"),
        (poses().mT, r"pose 2: the last row is .*transposed"),
        (poses() * np.array([1.0, 1.0, -1.0, 1.0]), "pose 1: R is a reflection"),
        (poses(1), r"1 pose\(s\), expected at least 2"),
        (spoilt((1, 2, 3), 1e12), "coordinate 1e.12 m is beyond"),
    ],
)
def test_arrays_refused(tmp_path: Path, array: np.ndarray, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        read_trajectory(saved(tmp_path, array), "npy", rate_hz=10.0)


def test_files_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, poses())
    data = path.read_bytes()
    for content in (b"", b"\x93NUMPY", data[:-1], data.replace(b"(5, 4, 4)", b"(9, 4, 4)"), b"1 2 3\n"):
        path.write_bytes(content)
        with pytest.raises(TrajectoryError, match="is no whole NumPy array"):
            read_trajectory(path, "npy", rate_hz=10.0)
    np.savez(tmp_path / "p.npz", a=poses())
    with pytest.raises(TrajectoryError, match=r"is an archive \(\.npz\)"):
        read_trajectory(tmp_path / "p.npz", "npy", rate_hz=10.0)
    with pytest.raises(TrajectoryError, match="no such file"):
        read_trajectory(tmp_path / "gone.npy", "npy", rate_hz=10.0)
    with pytest.raises(TrajectoryError, match="is a folder"):
        read_trajectory(tmp_path, "npy", rate_hz=10.0)


KISS_TUM = "0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 1.0000\n1.0000 0.5 0 0 0.0000 0.0000 0.7071 0.7071\n"


def test_stamps_that_count_frames(tmp_path: Path) -> None:
    """KISS-ICP's TUM of scans without stamps: four decimals, the first column a count."""
    path = tmp_path / "00_poses_tum.txt"
    path.write_text(KISS_TUM)
    with pytest.warns(RoundedInputWarning, match="few decimals"):
        read = read_trajectory(path, "tum-index", rate_hz=10.0)
    assert read.stamp_s.tolist() == [0.0, 0.1]
    assert read.position_m[1].tolist() == [0.5, 0.0, 0.0]
    path.write_text(KISS_TUM.replace("\n1.0000 ", "\n1700000000.1 ").replace("0.7071 0.7071", "0 1"))
    with pytest.raises(TrajectoryError, match=r"pose 2 has 1700000000\.1 in the first column; expected 1"):
        read_trajectory(path, "tum-index", rate_hz=10.0)
