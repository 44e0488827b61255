"""Damage done to a valid file, of the kinds that copying, editing and exporting do, and worse.

Every choice is the generator's: hypothesis hands in one that it can shrink, atheris one seeded by its own.
"""

import copy
import json
import random
from collections.abc import Callable, Sequence
from typing import Any, Literal

import yaml

from jaxgeo.io.yaml_text import dump_yaml, parse_yaml

Kind = Literal["text", "binary", "json", "yaml"]

TOKENS = (
    *("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "-0", "-0.0", "0", "1", "-1", "", " ", '"', "'", "#", "\\"),
    *("1e999", "1e-999", "1e99999999", "1_000", "0x10", "1,5", "1;5", "--5", "+-1", "1e", ".", "-", "e5", "%s", "{0}"),
    *("9" * 25, "9" * 400, "9" * 5000, "-" + "9" * 30, "4294967296", "18446744073709551616", "9223372036854775807"),
    *(
        "٣",
        "１２",
        "²",
        "½",
        "é",
        "\u2028",
        "\ufeff",
        "\u0000",
        "null",
        "true",
        "None",
        "A" * 300,
        "[",
        "{",
        "*a",
        "&a",
    ),
    *("2147483647", "-2147483648", "1e17", "1e18", "1e300", "0.30000000000000004", "VERTEX_SE3:QUAT", "EDGE_SE3"),
)
NUMBERS = (0, 1, 2, 3, 4, 7, 8, 15, 16, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**64 - 1)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 3, 1.5, -0.0, 1e308, 5e-324, 10**30, -(10**30), 2**63, "", " ", "a", "A" * 300),
    *([], {}, [None], [[]], [1, 2, 3], [1.0, "x", None], {"a": 1}, {"": None}, {"kind": "poses"}, [[1, 2], [3]]),
    *("${JAXGEO_DATA}", "${HOME}", "../../../etc/passwd", "\0", "nan", ".inf", "٣", "\u2028", "EPSG:0", "local", "é"),
    *("epsg:" + "9" * 30, "default", float("nan"), float("inf"), [1e308] * 3, [[1e308] * 4] * 4, "\ud800"),
)
_ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "utf-8-sig")
_SEPARATORS = (",", ";", "\t", " ", "  ")


def mutate(
    data: bytes, kind: Kind, rng: random.Random, others: Sequence[bytes] = (), keys: Sequence[str] = ()
) -> bytes:
    """The file with one to four things done to it; now and then bytes that never were one.

    Args:
        data: what to damage.
        kind: which damage suits it: bytes; lines and cells too; the tree of a JSON or YAML file too.
        rng: makes every choice.
        others: further valid files of the same kind, to be spliced in.
        keys: names that a mapping in the file may have.
    """
    if rng.randrange(40) == 0:
        return bytes(rng.randrange(256) for _ in range(rng.randrange(64)))
    for _ in range(rng.choice((1, 1, 2, 4))):
        data = _once(data, kind, rng, others, keys)
    return data


def _once(data: bytes, kind: Kind, rng: random.Random, others: Sequence[bytes], keys: Sequence[str]) -> bytes:
    if kind in ("json", "yaml") and rng.randrange(4):
        try:
            return _mutated_tree(data, kind, rng, keys)
        except (ValueError, RecursionError, yaml.YAMLError):  # damaged before: go on with its bytes
            pass
    if kind != "binary" and rng.randrange(5):
        return rng.choice(_OF_TEXT)(data, rng)
    if others and rng.randrange(10) == 0:
        other = rng.choice(others)
        return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
    return rng.choice(_OF_BYTES)(data, rng)


def _flipped(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return data
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3))):
        out[_place(rng, len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _set_byte(data: bytes, rng: random.Random) -> bytes:
    at = _place(rng, len(data))
    return data[:at] + bytes([rng.choice((0, 1, 9, 10, 32, 127, 128, 255))]) + data[at + 1 :]


def _set_number(data: bytes, rng: random.Random) -> bytes:
    """A count, a size or an offset of the file's head becomes another, in either byte order."""
    size = rng.choice((1, 2, 4, 4, 8))
    value = rng.choice(NUMBERS) % (1 << 8 * size)
    at = _place(rng, len(data))
    return data[:at] + value.to_bytes(size, rng.choice(("little", "little", "big"))) + data[at + size :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _without_piece(data: bytes, rng: random.Random) -> bytes:
    at = _place(rng, len(data))
    return data[:at] + data[at + rng.choice((1, 2, 4, 8, 64)) :]


def _piece_twice(data: bytes, rng: random.Random) -> bytes:
    at, size = _place(rng, len(data)), rng.choice((1, 4, 16, 256))
    return data[: at + size] + data[at : at + size] * rng.choice((1, 1, 8)) + data[at + size :]


def _place(rng: random.Random, size: int) -> int:
    """Somewhere in the file; in every other case in its head, where the counts and sizes stand."""
    return rng.randrange(max(1, min(size, 128) if rng.randrange(2) else size))


def _byte_order_mark(data: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\n\n", b"\0")) + data


def _line_ends(data: bytes, rng: random.Random) -> bytes:
    return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\n\r", b"\x0b", b"\x0c\n", b"\0\n", b" \n", b"")))


def _other_encoding(data: bytes, rng: random.Random) -> bytes:
    return data.decode("utf-8", "replace").encode(rng.choice(_ENCODINGS), "replace")


def _lines_moved(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            lines.insert(at, lines[other])
        case 1:
            del lines[at]
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines.insert(at, rng.choice((b"", b"#", b" ", b"# a b c", b",,,", b"\t", b"a,b,c")))
        case _:
            del lines[min(at, other) : max(at, other)]
    return b"\n".join(lines)


def _cells_changed(data: bytes, rng: random.Random) -> bytes:
    """One cell of a line becomes another token, or goes, comes twice, or changes places."""
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    separator = _separator(lines[at])
    cells = lines[at].split(separator)
    one, other = rng.randrange(len(cells)), rng.randrange(len(cells))
    match rng.randrange(6):
        case 0:
            del cells[one]
        case 1:
            cells.insert(one, cells[other])
        case 2:
            cells[one], cells[other] = cells[other], cells[one]
        case _:
            cells[one] = rng.choice(TOKENS).encode()
    lines[at] = separator.join(cells)
    return b"\n".join(lines)


def _column_changed(data: bytes, rng: random.Random) -> bytes:
    """The same done to a whole column."""
    lines = data.split(b"\n")
    separator = _separator(lines[len(lines) // 2])
    at, what, token = rng.randrange(12), rng.randrange(4), rng.choice(TOKENS).encode()
    for i, line in enumerate(lines):
        cells = line.split(separator)
        if at >= len(cells) or len(cells) == 1:
            continue
        if what == 0:
            del cells[at]
        elif what == 1:
            cells.insert(at, cells[at])
        else:
            cells[at] = token
        lines[i] = separator.join(cells)
    return b"\n".join(lines)


def _other_separator(data: bytes, rng: random.Random) -> bytes:
    return data.replace(_separator(data), rng.choice(_SEPARATORS).encode())


def _separator(line: bytes) -> bytes:
    return next((mark for mark in (b",", b";", b"\t") if mark in line), b" ")


def _token_inserted(data: bytes, rng: random.Random) -> bytes:
    at = _place(rng, len(data))
    return data[:at] + rng.choice(TOKENS).encode() + data[at:]


_OF_BYTES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_flipped, _flipped, _set_byte, _set_number, _set_number, _cut, _without_piece, _piece_twice, _byte_order_mark),
)
_OF_TEXT: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_cells_changed, _cells_changed, _cells_changed, _lines_moved, _lines_moved, _column_changed, _column_changed),
    *(_line_ends, _other_encoding, _other_separator, _token_inserted, _byte_order_mark),
)


def _mutated_tree(data: bytes, kind: Kind, rng: random.Random, keys: Sequence[str]) -> bytes:
    text = data.decode("utf-8")
    tree = json.loads(text) if kind == "json" else parse_yaml(text)
    for _ in range(rng.choice((1, 1, 2, 3))):
        tree = changed_tree(tree, rng, keys)
    return (json.dumps(tree) if kind == "json" else dump_yaml(tree)).encode("utf-8", "surrogatepass")


def changed_tree(tree: Any, rng: random.Random, keys: Sequence[str] = ()) -> Any:
    """Plain data with one node changed: another type, out of range, gone, twice, or under a misspelt key.

    Args:
        tree: mappings, lists and scalars.
        rng: makes every choice.
        keys: names that a mapping may be given beside its own.
    """
    tree = copy.deepcopy(tree)
    inner = [node for node in _nodes(tree) if isinstance(node, dict | list) and node]
    if not inner:
        return rng.choice(VALUES)
    node = rng.choice(inner)
    key = rng.choice(list(node)) if isinstance(node, dict) else rng.randrange(len(node))
    match rng.randrange(8):
        case 0:
            del node[key]
        case 1 if isinstance(node, dict):
            node[_misspelt(str(key), rng)] = node.pop(key)
        case 1:
            node.insert(key, node[key])
        case 2 if isinstance(node, dict):
            node[rng.choice(keys) if keys else "x"] = rng.choice(VALUES)
        case 3:
            node[key] = copy.deepcopy(rng.choice(inner))
        case 4:
            node[key] = rng.choice(([node[key]], {"a": node[key]}, str(node[key])))
        case _:
            node[key] = rng.choice(VALUES)
    return tree


def _misspelt(word: str, rng: random.Random) -> str:
    at = rng.randrange(len(word) + 1)
    return rng.choice(
        (word[:at] + "x" + word[at:], word[:at] + word[at + 1 :], word.upper(), f"{word}.{word}", "", "é")
    )


def _nodes(tree: Any) -> list[Any]:
    found = [tree]
    for value in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        found += _nodes(value)
    return found
