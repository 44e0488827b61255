"""Files that are no sound database are refused in one message; reading leaves no trace."""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rtabmap_database import IDENTITY, SCHEMA, SmallDatabase, compressed

from jaxgeo.errors import GraphError, InputError, JaxgeoError
from jaxgeo.io.rtabmap import connection
from jaxgeo.io.rtabmap.database import open_rtabmap


def empty(path: Path) -> None:
    path.write_bytes(b"")


def other_kind(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))


def folder(path: Path) -> None:
    path.mkdir()


def other_schema(path: Path) -> None:
    _script(path, "CREATE TABLE songs (a); INSERT INTO songs VALUES (1);")


def view(path: Path) -> None:
    _script(path, SCHEMA.replace("CREATE TABLE Node", "CREATE TABLE Real_Node").split("CREATE TRIGGER")[0])
    _script(path, "CREATE VIEW Node AS SELECT * FROM Real_Node;")


def virtual(path: Path) -> None:
    _script(path, SCHEMA.split("CREATE TRIGGER")[0] + "DROP TABLE Link; CREATE VIRTUAL TABLE Link USING fts5(from_id);")


def computed(path: Path) -> None:
    """A column that calls a function when it is read."""
    with SmallDatabase(path) as small:
        small.run("DROP TABLE Info")
        small.run("CREATE TABLE Info (a, parameters TEXT GENERATED ALWAYS AS (hex(zeroblob(a))) VIRTUAL)")


def no_version(path: Path) -> None:
    with SmallDatabase(path) as small:
        small.run("DELETE FROM Admin")


def odd_version(path: Path) -> None:
    with SmallDatabase(path, version="; DROP") as _:
        pass


def old_version(path: Path) -> None:
    with SmallDatabase(path, version="0.11.8") as _:
        pass


def cut_off(path: Path) -> None:
    with SmallDatabase(path) as small:
        for node in range(1, 400):
            small.node(node)
    path.write_bytes(path.read_bytes()[:-9000])


def overwritten(path: Path) -> None:
    with SmallDatabase(path) as small:
        for node in range(1, 400):
            small.node(node)
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(data)


def half_written(path: Path) -> None:
    with SmallDatabase(path) as small:
        small.node(1)
    Path(f"{path}-journal").write_bytes(b"a transaction")


def _script(path: Path, script: str) -> None:
    made = sqlite3.connect(path)
    made.executescript(script)
    made.close()


def _node(**values: object) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1, **values)  # pyright: ignore[reportArgumentType]

    return make


def _optimised(ids: bytes | str | None, poses: bytes | None) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1)
            small.run("UPDATE Admin SET opt_ids = ?, opt_poses = ?", ids, poses)

    return make


def _link(*values: object) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1)
            small.node(2)
            small.link(*values)  # pyright: ignore[reportArgumentType]

    return make


IDS = compressed(np.array([[1]], "<i4"))
POSES = compressed(IDENTITY.astype("<f4").reshape(1, 12))
HOSTILE: list[tuple[Callable[[Path], None], str]] = [
    (empty, "is empty; an RTAB-Map database is an SQLite file"),
    (other_kind, "begins with b'.x89PNG.*an RTAB-Map database is an SQLite file"),
    (folder, "is a folder, expected an RTAB-Map database"),
    (other_schema, r"no table 'Admin' \(tables: songs\)"),
    (view, "'Node' is a view, expected an ordinary table.*do not trust it"),
    (virtual, "'Link' is a virtual table, expected an ordinary table"),
    (computed, "column 'parameters' of table 'Info' is computed.*do not trust it"),
    (no_version, "Admin.version is ''"),
    (odd_version, "Admin.version is '; DROP'; expected one such as '0.21.1'"),
    (old_version, "database of RTAB-Map 0.11.8; expected 0.13 or later.*rtabmap-reprocess"),
    (cut_off, "SQLite cannot read it: database disk image is malformed"),
    (overwritten, "SQLite cannot read it: database disk image is malformed"),
    (half_written, "hostile.db-journal lies beside it: something still writes"),
    (_node(pose="0 0 0"), "node 1: pose: holds str '0 0 0', expected binary data"),
    (_node(pose=b"abc"), "node 1: pose: 3 bytes, expected 48"),
    (_node(pose=IDENTITY * np.nan), "node 1: pose: the pose holds nan"),
    (_node(pose=IDENTITY * 5), "node 1: pose: R R.T is off the identity by 24"),
    (_node(stamp="noon"), "node 1: stamp 'noon'; expected seconds"),
    (_node(stamp=1.7e18), "node 1: stamp '1.7e.18'; expected seconds"),
    (_node(map_id="x"), "node 1: map_id 'x'"),
    (_node(gps=bytes(40)), "node 1: gps: 40 bytes, expected 48"),
    (_node(gps=np.full(6, 500.0).tobytes()), "node 1: gps: .*expected stamp, longitude, latitude in degrees"),
    (_optimised(IDS, None), "Admin.opt_poses is missing"),
    (_optimised("1", POSES), "Admin.opt_ids: holds str '1'"),
    (_optimised(IDS, POSES[:-1]), "Admin.opt_poses: announces .* and holds 48"),
    (_optimised(compressed(np.array([[1, 2]], "<i4")), POSES), "12 numbers of float32 for 2 ids"),
    (_optimised(compressed(np.array([[1, 1]], "<i4")), compressed(np.tile(IDENTITY, (2, 1)).astype("<f4"))), "twice"),
    (_optimised(IDS, compressed(np.full((1, 12), np.inf, "<f4"))), "Admin.opt_poses: node 1: the pose holds inf"),
    (_link("a", 2, 0), "link a -> 2 of type 0; expected whole numbers"),
    (_link(1, 2, 0, b"short"), "link 1 -> 2: transform: 5 bytes, expected 48"),
    (_link(1, 2, 0, np.full((3, 4), np.inf)), "link 1 -> 2: the pose holds"),
    (_link(1, 2, 0, IDENTITY, "text"), "link 1 -> 2: information_matrix: holds str"),
    (_link(1, 2, 0, IDENTITY, np.eye(3)), "link 1 -> 2: information_matrix: 72 bytes, expected 288"),
]


@pytest.mark.parametrize(("make", "message"), HOSTILE)
def test_hostile_files_are_refused_in_one_message(tmp_path: Path, make: Callable[[Path], None], message: str) -> None:
    path = tmp_path / "hostile.db"
    make(path)
    with pytest.raises(JaxgeoError, match=message) as caught, open_rtabmap(path):
        pass
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, (InputError, GraphError))


def test_huge_values_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "LARGEST_VALUE_BYTES", 1 << 20)
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1)
        small.run("UPDATE Node SET pose = zeroblob(2000000)")
    with pytest.raises(InputError, match="SQLite cannot read it: string or blob too big"), open_rtabmap(small.path):
        pass


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"), open_rtabmap(tmp_path / "gone.db"):
        pass
    os.mkfifo(tmp_path / "pipe.db")
    with pytest.raises(InputError, match="is a device or a pipe"), open_rtabmap(tmp_path / "pipe.db"):
        pass


def test_reading_leaves_no_trace(tmp_path: Path) -> None:
    """Odd characters in the name, write-ahead logging, a read-only folder: nothing is made beside the file."""
    path = tmp_path / "a #1 100% ?mode=rwc.db"
    with SmallDatabase(path) as small:
        small.node(1)
        small.node(2)
    _script(path, "PRAGMA journal_mode = WAL")
    assert path.read_bytes()[18] == 2  # write-ahead logging: whoever opens it to write makes two files beside it
    before = path.read_bytes(), path.stat().st_mtime_ns
    with open_rtabmap(path) as database:
        assert len(database.nodes) == 2
        assert [file.name for file in tmp_path.iterdir()] == [path.name]
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("DELETE FROM Node")
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("ATTACH ? AS other", (str(tmp_path / "other.db"),))
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("PRAGMA query_only = OFF")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
