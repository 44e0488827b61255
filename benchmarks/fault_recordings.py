"""Recordings cut off, damaged, or made to do harm: images, bags, archives of arrays, RTAB-Map databases."""

import io
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks import fault_inputs as inputs
from benchmarks.fault_case import Case, Change
from benchmarks.fault_files import QUIET, restored

# Without --quiet: of an image that cannot be read it says so, and goes on.
DETECT = ("--workers", "1", "--family", "aruco_mip_36h12", "--rate", "10", "--out", "out")
_BOMB_BYTES = 10 << 30


def recording_cases() -> Iterator[Case]:
    """Every kind of recording, damaged in several ways."""
    for name, (file, done, change) in _IMAGES.items():
        yield Case(
            f"image: {name}",
            done,
            inputs.photographs(),
            ("detect", "images", *DETECT),
            _changed(f"images/{file}", change),
            restored(inputs.photographs(), f"images/{file}"),
            says=(file,),
            codes=(0,),
            results=("corners.csv",),
        )
    for kind, file in _BAGS.items():
        for share in (0.0, 0.02, 0.5, 0.98):
            yield Case(
                f"bag: {kind} cut at {share:.0%}",
                f"{file} ends after {share:.0%} of its bytes",
                inputs.bag(kind),
                ("detect", file.split("/")[0], "--workers", "1", "--family", "aruco_mip_36h12", "--out", "out"),
                _changed(file, lambda data, share=share: data[: int(share * len(data))]),
                restored(inputs.bag(kind), file),
                says=(file.split("/")[0],),
                codes=(2, 0),  # 0 where all messages are there and only the index is cut
                results=("corners.csv",),
            )
    for name, (done, make) in _ARCHIVES.items():
        arguments = ("odometry", "scans.npz", "--rate", "10", *QUIET)
        yield Case(f"npz: {name}", done, make, arguments, says=("scans.npz",))
    for name, (done, change) in _DATABASES.items():
        yield Case(
            f"database: {name}",
            done,
            inputs.database(),
            ("rtabmap", "map.db", "--out", "out"),
            change,
            None if name in _HARMLESS else restored(inputs.database(), "map.db"),
            says=_HARMLESS.get(name, ("map.db",)),
            codes=(0,) if name in _HARMLESS else (2,),
            results=("odometry.tum",),
        )


def _changed(name: str, change: Callable[[bytes], bytes]) -> Change:
    def spoil(place: Path) -> None:
        (place / name).write_bytes(change((place / name).read_bytes()))

    return spoil


def _half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def png_of(width: int, height: int, rows: int) -> bytes:
    """A grey PNG that claims this size, with the first `rows` rows of it, all black: they pack to a thousandth."""
    pack = zlib.compressobj(9)
    pixels = b"".join(pack.compress(bytes(width + 1)) for _ in range(rows)) + pack.flush()
    head = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", pixels), (b"IEND", b""))
    parts = [struct.pack(">I", len(c)) + kind + c + struct.pack(">I", zlib.crc32(kind + c)) for kind, c in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _jpeg_claiming(data: bytes) -> bytes:
    """A JPEG whose frame header says 65 500 x 65 500."""
    at = data.index(b"\xff\xc0")
    return data[: at + 5] + struct.pack(">2H", 65_500, 65_500) + data[at + 9 :]


_IMAGES: dict[str, tuple[str, str, Callable[[bytes], bytes]]] = {
    "PNG cut off": ("000.png", "half of its bytes", _half),
    "JPEG cut off": ("001.jpg", "its first 100 bytes", lambda data: data[:100]),
    "PNG empty": ("000.png", "0 bytes", lambda _: b""),
    "text": ("000.png", "a text named .png", lambda _: b"this is no image\n" * 99),
    "PNG 100000 x 100000": ("000.png", "claims 10 gigapixels", lambda _: png_of(100_000, 100_000, 1)),
    "PNG 30000 x 30000": ("000.png", "0.9 gigapixels, black, 0.9 MB", lambda _: png_of(30_000, 30_000, 30_000)),
    "PNG 1 x 2^31-1": ("000.png", "claims a side of 2^31 - 1", lambda _: png_of(1, 2**31 - 1, 1)),
    "JPEG 65500 x 65500": ("001.jpg", "claims 4.3 gigapixels", _jpeg_claiming),
}
_BAGS = {"ros1": "images.bag", "sqlite3": "images_sqlite3/images_sqlite3.db3", "mcap": "images_mcap/images_mcap.mcap"}


def _array(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _head(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def _archive(name: str, write: Callable[[zipfile.ZipFile], None]) -> Change:
    def make(place: Path) -> None:
        with zipfile.ZipFile(place / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            write(archive)

    return make


def _member_above(archive: zipfile.ZipFile) -> None:
    archive.writestr("../outside.npy", _array(np.zeros((4, 3))))
    archive.writestr("/absolute.npy", _array(np.zeros((4, 3))))


def _member_link(archive: zipfile.ZipFile) -> None:
    link = zipfile.ZipInfo("xyz.npy")
    link.external_attr = 0o120777 << 16
    archive.writestr(link, "/etc/passwd")


def _bomb(archive: zipfile.ZipFile) -> None:
    """Ten gigabytes of zeros; as they would take half a minute to pack, one packed part is written many times over."""
    archive.writestr("xyz.npy", _head(f"({_BOMB_BYTES // 24}, 3)") + bytes(24 * 1000))


def _many_zeros(archive: zipfile.ZipFile) -> None:
    """Three gigabytes of zeros, 13 MB packed."""
    block = bytes(1 << 24)
    with archive.open("xyz.npy", "w", force_zip64=True) as member:
        member.write(_head(f"({192 * len(block) // 24}, 3)"))
        for _ in range(192):
            member.write(block)


def _pickled(archive: zipfile.ZipFile) -> None:
    file = io.BytesIO()
    np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    archive.writestr("xyz.npy", file.getvalue())


_ARCHIVES: dict[str, tuple[str, Change]] = {
    "../ members": ("members ../outside.npy and /absolute.npy", _archive("scans.npz", _member_above)),
    "link member": ("a member that is a symbolic link", _archive("scans.npz", _member_link)),
    "claims 10 GB": ("an array of 24 kB that claims 10 GB", _archive("scans.npz", _bomb)),
    "zip bomb": ("3 GB of zeros in 13 MB", _archive("scans.npz", _many_zeros)),
    "pickled": ("Python objects in it", _archive("scans.npz", _pickled)),
}


def _sql(script: str, *values: object) -> Change:
    def spoil(place: Path) -> None:
        connection = sqlite3.connect(place / "map.db")
        if values:
            connection.execute(script, values)
        else:
            connection.executescript(script)
        connection.commit()
        connection.close()

    return spoil


def _claiming_10_gb() -> bytes:
    """A compressed matrix of 100 000 x 25 000 float32 by its trailer, and 64 MB of zeros in its stream."""
    return zlib.compress(bytes(1 << 26)) + struct.pack("<3i", 100_000, 25_000, 5)


# What is read all the same: a number is a number; a link that is none is left out. What is to be said then.
_HARMLESS: dict[str, tuple[str, ...]] = {"id 2^62": (), "link to itself": ("link 3 -> 3",)}
_DATABASES: dict[str, tuple[str, Change]] = {
    "text": ("a text named .db", _changed("map.db", lambda _: b"this is no database\n" * 400)),
    "cut off": ("half of its bytes", _changed("map.db", _half)),
    "view": (
        "Node is a view that never ends",
        _sql(
            "ALTER TABLE Node RENAME TO Kept; CREATE VIEW Node AS WITH RECURSIVE c(id) AS "
            "(SELECT 1 UNION ALL SELECT id + 1 FROM c) SELECT * FROM c;"
        ),
    ),
    "pose of 3 bytes": ("a pose of three bytes", _sql("UPDATE Node SET pose = ? WHERE id = 2", b"abc")),
    "poses NaN": ("a pose of NaN", _sql("UPDATE Node SET pose = ? WHERE id = 2", np.full(12, np.nan, "<f4").tobytes())),
    "poses claim 10 GB": (
        "optimised poses that claim 10 GB",
        _sql("UPDATE Admin SET opt_ids = ?, opt_poses = ?", _claiming_10_gb(), _claiming_10_gb()),
    ),
    "stamp text": ("a stamp that is a text", _sql("UPDATE Node SET stamp = ? WHERE id = 2", "'); DROP TABLE Node; --")),
    "no tables": ("the table Node is gone", _sql("DROP TRIGGER insert_Node; DROP TABLE Node;")),
    "id 2^62": ("a node numbered 2^62, one -5", _sql("UPDATE Node SET id = 4611686018427387904 WHERE id = 2")),
    "version": ("a version that is a command", _sql("UPDATE Admin SET version = ?", "0.21.1; rm -rf /")),
    "link to itself": (
        "a neighbour link from 3 to itself",
        _sql("UPDATE Link SET to_id = 3, from_id = 3 WHERE to_id=3"),
    ),
}
