import os
import stat
from pathlib import Path

import pytest

from jaxgeo.errors import InputError
from jaxgeo.io import atomic_path, output_folder, write_lines


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent == path.parent
        assert temporary.suffix == ".html"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_of_a_block_that_fails(tmp_path: Path, failure: type[BaseException]) -> None:
    def fail_half_way(path: Path) -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise failure

    with pytest.raises(failure):
        fail_half_way(tmp_path / "out.txt")
    assert not list(tmp_path.iterdir())
    (tmp_path / "out.txt").write_text("old")
    with pytest.raises(failure):
        fail_half_way(tmp_path / "out.txt")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("out.txt", "old")]


def test_lines_that_fail_leave_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    write_lines(path, ["old", "é"])
    assert path.read_bytes() == "old\né\n".encode()
    with pytest.raises(ZeroDivisionError):
        write_lines(path, (str(1 // (2 - i)) for i in range(5)))
    assert path.read_bytes() == "old\né\n".encode()


def test_permissions_are_the_usual_ones(tmp_path: Path) -> None:
    usual = tmp_path / "usual"
    usual.touch()
    write_lines(tmp_path / "ours", [])
    assert stat.S_IMODE((tmp_path / "ours").stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)
    (tmp_path / "ours").chmod(0o640)
    write_lines(tmp_path / "ours", [])
    assert stat.S_IMODE((tmp_path / "ours").stat().st_mode) == 0o640


def test_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_lines(tmp_path / "link", ["new"])
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new\n"


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder, expected the name of a file"):
        write_lines(tmp_path, [])
    with pytest.raises(InputError, match=r"cannot write into .*gone: No such file"):
        write_lines(tmp_path / "gone" / "out", [])
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is a file, expected a folder"), output_folder(tmp_path / "file"):
        pass


def test_a_new_folder_appears_whole(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with output_folder(target) as folder:
        (folder / "a").write_text("1")
        (folder / "sub").mkdir()
        (folder / "sub" / "b").write_text("2")
        assert not target.exists()
    assert (target / "a").read_text() + (target / "sub" / "b").read_text() == "12"
    assert os.listdir(target.parent) == ["out"]


def test_an_old_folder_keeps_its_other_files(tmp_path: Path) -> None:
    target = tmp_path / "out"
    (target / "sub").mkdir(parents=True)
    for name in ("a", "mine", "sub/b"):
        (target / name).write_text("old")
    with output_folder(target) as folder:
        (folder / "a").write_text("new")
        (folder / "sub").mkdir()
        (folder / "sub" / "b").write_text("new")
    assert {name: (target / name).read_text() for name in ("a", "mine", "sub/b")} == {
        "a": "new",
        "mine": "old",
        "sub/b": "new",
    }
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_folder_that_fails_changes_nothing(tmp_path: Path, failure: type[BaseException]) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "a").write_text("old")

    def fail_half_way() -> None:
        with output_folder(target) as folder:
            (folder / "a").write_text("new")
            raise failure

    with pytest.raises(failure):
        fail_half_way()
    assert (target / "a").read_text() == "old"
    assert os.listdir(tmp_path) == ["out"]


def test_a_file_does_not_replace_a_folder(tmp_path: Path) -> None:
    target = tmp_path / "out"
    (target / "b").mkdir(parents=True)

    def write_both() -> None:
        with output_folder(target) as folder:
            (folder / "a").write_text("new")
            (folder / "b").write_text("new")

    with pytest.raises(InputError, match=r"out/b: is a folder"):
        write_both()
    assert os.listdir(target) == ["b"]
