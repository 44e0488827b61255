"""Small RTAB-Map databases, written from the formats' descriptions."""

import sqlite3
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

SCHEMA = """
CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT, pose BLOB,
    ground_truth_pose BLOB, velocity BLOB, label TEXT, gps BLOB, env_sensors BLOB, time_enter DATE, PRIMARY KEY (id));
CREATE TABLE Data (id INTEGER NOT NULL, image BLOB, depth BLOB, calibration BLOB, scan BLOB, scan_info BLOB,
    ground_cells BLOB, obstacle_cells BLOB, empty_cells BLOB, cell_size FLOAT, user_data BLOB, PRIMARY KEY (id));
CREATE TABLE Link (from_id INTEGER NOT NULL, to_id INTEGER NOT NULL, type INTEGER NOT NULL,
    information_matrix BLOB NOT NULL, transform BLOB, user_data BLOB);
CREATE TABLE Info (STM_size INTEGER, parameters TEXT, time_enter DATE);
CREATE TABLE Admin (version TEXT, opt_ids BLOB, opt_poses BLOB, time_enter DATE);
CREATE TRIGGER insert_Node AFTER INSERT ON Node BEGIN UPDATE Node SET time_enter = DATETIME('NOW'); END;
"""
OPTICAL = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.2], [0, -1, 0, 0.3]])
IDENTITY = np.eye(4)[:3]


class SmallDatabase:
    """Writes tables row by row; use as a context manager."""

    def __init__(self, path: Path, version: str = "0.21.1", parameters: str = "A:1;B:2") -> None:
        self.path = path
        self._connection = sqlite3.connect(path)
        self._connection.executescript(SCHEMA)
        self.run("INSERT INTO Admin(version) VALUES (?)", version)
        self.run("INSERT INTO Info(parameters) VALUES (?)", parameters)

    def __enter__(self) -> "SmallDatabase":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.commit()
        self._connection.close()

    def run(self, query: str, *values: object) -> None:
        self._connection.execute(query, values)

    def node(self, node: int, pose: object = IDENTITY, stamp: object = None, map_id: int = 0, **more: object) -> None:
        values = {"id": node, "map_id": map_id, "stamp": 100.0 + node if stamp is None else stamp, "pose": packed(pose)}
        self._insert("Node", {**values, **{key: packed(value) for key, value in more.items()}})

    def data(self, node: int, **blobs: object) -> None:
        self._insert("Data", {"id": node, **blobs})

    def link(self, first: int, second: int, kind: int, pose: object = IDENTITY, information: object = None) -> None:
        matrix = np.eye(6) if information is None else information
        values = {"from_id": first, "to_id": second, "type": kind, "transform": packed(pose)}
        self._insert("Link", {**values, "information_matrix": packed(matrix, "<f8")})

    def optimised(self, ids: Sequence[int], poses: np.ndarray) -> None:
        ids_blob = compressed(np.array([ids], dtype="<i4"))
        self.run("UPDATE Admin SET opt_ids = ?", ids_blob)
        self.run("UPDATE Admin SET opt_poses = ?", compressed(np.asarray(poses, dtype="<f4").reshape(1, -1)))

    def _insert(self, table: str, values: dict[str, object]) -> None:
        marks = ", ".join("?" * len(values))
        self.run(f"INSERT INTO {table}({', '.join(values)}) VALUES ({marks})", *values.values())


def packed(value: object, dtype: str = "<f4") -> object:
    return np.asarray(value, dtype=dtype).tobytes() if isinstance(value, np.ndarray) else value


def compressed(array: np.ndarray, channels: int = 1) -> bytes:
    """A matrix as RTAB-Map compresses it; several channels are the columns of `array`, the matrix has one row."""
    depth = {"u1": 0, "i1": 1, "u2": 2, "i2": 3, "i4": 4, "f4": 5, "f8": 6}[array.dtype.str[1:]]
    rows, columns = array.shape if channels == 1 else (1, array.shape[0])
    return zlib.compress(array.tobytes()) + struct.pack("<3i", rows, columns, depth + ((channels - 1) << 3))


def camera_blob(
    size: tuple[int, int] = (8, 6),
    fx: float = 10.0,
    D: Sequence[float] = (),
    P: np.ndarray | None = None,
    local: np.ndarray = OPTICAL,
) -> bytes:
    K = np.array([[fx, 0, 4], [0, fx + 1, 3], [0, 0, 1]], dtype="<f8")
    head = struct.pack("<11i", 0, 21, 1, 0, *size, 9, len(D), 0, 0 if P is None else 12, local.size)
    parts = [K.tobytes(), np.array(D, dtype="<f8").tobytes(), b"" if P is None else P.astype("<f8").tobytes()]
    return head + b"".join(parts) + local.astype("<f4").tobytes()


def stereo_blob(left: bytes, right: bytes, R: np.ndarray | None = None, T: np.ndarray | None = None) -> bytes:
    counts = (0 if R is None else 9, 0 if T is None else 3, 0, 0)
    head = struct.pack("<10i", 0, 21, 1, 1, *counts, len(left), len(right))
    extrinsics = b"".join(np.asarray(part, dtype="<f8").tobytes() for part in (R, T) if part is not None)
    return head + extrinsics + left + right


def projection(fx: float, baseline_m: float = 0.0) -> np.ndarray:
    return np.array([[fx, 0, 4.5, -fx * baseline_m], [0, fx, 3.5, 0], [0, 0, 1, 0]])


def scan_info_blob(format: int, local: np.ndarray = IDENTITY) -> bytes:
    return np.concatenate([[format, 0, 30, 0, 0, 0, 1000], local.ravel()]).astype("<f4").tobytes()


def encoded(image: np.ndarray, suffix: str = ".png") -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


def rvl(image: np.ndarray) -> bytes:
    """Depth as RVL, number by number, as its paper describes it."""
    pixels = image.ravel().tolist()
    nibbles: list[int] = []

    def number(value: int) -> None:
        while True:
            nibbles.append((value & 7) | (8 if value > 7 else 0))
            value >>= 3
            if not value:
                return

    at, before = 0, 0
    while at < len(pixels):
        start = at
        while at < len(pixels) and pixels[at] == 0:
            at += 1
        number(at - start)
        start = at
        while at < len(pixels) and pixels[at] != 0:
            at += 1
        number(at - start)
        for value in pixels[start:at]:
            difference = value - before
            number(2 * difference if difference >= 0 else -2 * difference - 1)
            before = value
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{n:x}" for n in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return b"DEPTHRVL" + struct.pack("<2I", image.shape[1], image.shape[0]) + struct.pack(f"<{len(words)}I", *words)
