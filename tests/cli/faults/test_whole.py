"""What the table of faults takes for a whole file, and for a changed folder."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.fault_kills import _names
from benchmarks.fault_whole import broken_files, changes, snapshot

WHOLE: dict[str, bytes] = {
    "a.json": b'{"a": [1, 2]}\n',
    "a.csv": b"# title\nx,y\n1,2\n3,4\n",
    "a.tum": b"0.0 0 0 0 0 0 0 1\n1.0 1 0 0 0 0 0 1\n",
    "a.html": b"<html><body>x</body></html>\n",
    "a.png": cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes(),
}


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_that_is_cut_off_is_not_whole(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(WHOLE[name])
    assert broken_files(tmp_path) == []
    (tmp_path / name).write_bytes(WHOLE[name][:-3])
    assert [problem.partition(":")[0] for problem in broken_files(tmp_path)] == [name]


def test_temporary_files_are_told(tmp_path: Path) -> None:
    (tmp_path / ".a.x1.tmp.csv").write_bytes(WHOLE["a.csv"])
    assert broken_files(tmp_path) == [".a.x1.tmp.csv: temporary"]


def test_every_change_is_seen_but_those_of_the_outputs(tmp_path: Path) -> None:
    for name in ("same", "changed", "gone"):
        (tmp_path / name).write_text(name)
    (tmp_path / "out").mkdir()
    before = snapshot(tmp_path, (tmp_path / "out",))
    (tmp_path / "changed").write_text("CHANGED")
    (tmp_path / "gone").unlink()
    (tmp_path / "link").symlink_to("same")
    (tmp_path / "out" / "a").write_text("a")
    seen = changes(before, snapshot(tmp_path, (tmp_path / "out",)))
    assert [line.partition(":")[0] for line in seen] == ["changed", "gone", "link"]


def test_rows_named_by_hashes_are_counted(tmp_path: Path) -> None:
    for digit in "ab":
        (tmp_path / f"{digit * 64}.json").write_text("{}")
    assert _names(tmp_path) == {"*.json": 2}
