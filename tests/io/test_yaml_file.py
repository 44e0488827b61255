from pathlib import Path

import pytest

from jaxgeo.errors import ConfigError, SightingError
from jaxgeo.io import read_yaml


def test_a_mapping_is_read_with_its_numbers(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1e-3\r\nb: {c: [1, .5e1]}\r\n")
    assert read_yaml(path) == {"a": 1e-3, "b": {"c": [1, 5.0]}}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", r"c\.yaml: line 3, column 1: the key 'a' stands twice"),
        ("a: [1, 2\nb: 3\n", r"c\.yaml: line 2, column 2: .*Check the indentation"),
        ("- 1\n- 2\n", r"c\.yaml: holds a list, expected a mapping"),
        ("# nothing\n", r"c\.yaml: holds nothing but comments, expected a mapping"),
        (
            "a: !!python/object/apply:os.system [ls]\n",
            r"c\.yaml: line 1, column 4: the tag .* is not plain data: remove it",
        ),
        ("", r"c\.yaml: the file is empty"),
    ],
)
def test_bad_files_raise_what_the_reader_asked_for(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    for error in (ConfigError, SightingError):
        with pytest.raises(error, match=message):
            read_yaml(path, error)
