"""A small cloud with every kind of column."""

import numpy as np

from jaxgeo.io.clouds import CloudChunk, CloudSource

TYPES = {
    **dict.fromkeys(("red", "green", "blue"), np.dtype("u2")),
    "intensity": np.dtype("u2"),
    "stamp_s": np.dtype("f8"),
    "pose_index": np.dtype("i4"),
    **dict.fromkeys(("nx", "ny", "nz"), np.dtype("f4")),
    "classification": np.dtype("u1"),
    "roughness": np.dtype("f4"),
}


def some_cloud(n: int = 7, seed: int = 0, types: dict[str, np.dtype] = TYPES) -> CloudChunk:
    random = np.random.default_rng(seed)
    columns = {name: random.uniform(0, 200, n).astype(kind) for name, kind in types.items()}
    if "red" in columns:  # 8 bits on the full range, as PLY holds them
        columns |= {name: (columns[name] % 256 * 257).astype(np.uint16) for name in ("red", "green", "blue")}
    if "stamp_s" in columns:
        columns["stamp_s"] = 1.7e9 + columns["stamp_s"]
    return CloudChunk(random.normal(0, 100, (n, 3)), columns)


def whole(source: CloudSource, size: int = 3) -> CloudChunk:
    chunks = list(source.chunks(size))
    assert all(0 < len(chunk) <= size for chunk in chunks)
    columns = {name: np.concatenate([chunk.columns[name] for chunk in chunks]) for name in source.columns}
    for name, kind in source.columns.items():
        assert columns[name].dtype == kind
        np.testing.assert_array_equal(np.concatenate(list(source.column(name, size))), columns[name])
    return CloudChunk(np.concatenate([chunk.points_m for chunk in chunks]), columns)
