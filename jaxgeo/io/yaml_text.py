"""YAML as configs use it: plain data, keys as they are written, no surprises.

YAML 1.1 reads `no` as false, `1:30` as 90, `012` as 10, `1e-3` as text and `2026-01-02` as a date. Here, as in YAML
1.2, only true and false are booleans, numbers are decimal, and the rest is text; `012` stays text: it may be a name.
"""

import re
from typing import Any, ClassVar

import yaml

MAX_BYTES = 1 << 20
# Each alias can at most triple or so what went before it: ten keep a file of nested aliases harmless.
MAX_ALIASES = 10

_NUMBER = r"(?:0|[1-9][0-9]*)"
# (tag, pattern, first characters): PyYAML looks a scalar up by its first character.
_RESOLVERS = (
    ("bool", r"(?:true|True|TRUE|false|False|FALSE)\Z", "tTfF"),
    ("int", rf"[-+]?{_NUMBER}\Z", "-+0123456789"),
    ("float", rf"[-+]?(?:{_NUMBER}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\Z", "-+.0123456789"),
    ("float", r"(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z", "-+."),
    ("null", r"(?:~|null|Null|NULL|)\Z", ("~", "n", "N", "")),
    ("merge", r"<<\Z", "<"),
)


def _resolvers() -> dict[str, list[tuple[str, re.Pattern[str]]]]:
    table: dict[str, list[tuple[str, re.Pattern[str]]]] = {}
    for tag, pattern, first in _RESOLVERS:
        for character in first:
            table.setdefault(character, []).append((f"tag:yaml.org,2002:{tag}", re.compile(pattern)))
    return table


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers = _resolvers()
    n_aliases = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if not self.check_event(yaml.AliasEvent):
            return super().compose_node(parent, index)
        mark = self.peek_event().start_mark
        node = super().compose_node(parent, index)
        self.n_aliases += 1
        if self.n_aliases > MAX_ALIASES:
            raise yaml.MarkedYAMLError(problem=f"more than {MAX_ALIASES} aliases (*name)", problem_mark=mark)
        if node is not None and node.end_mark is None:  # not closed yet
            raise yaml.MarkedYAMLError(problem="an alias inside of what it stands for", problem_mark=mark)
        return node

    def compose_scalar_node(self, anchor: Any) -> Any:
        node = super().compose_scalar_node(anchor)
        if any("\ud800" <= character <= "\udfff" for character in node.value):
            raise yaml.MarkedYAMLError(
                problem="half a character (\\ud800 to \\udfff alone)", problem_mark=node.start_mark
            )
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key must be plain text", problem_mark=key.start_mark)
            if key.value in seen:
                raise yaml.MarkedYAMLError(problem=f"the key {key.value!r} stands twice", problem_mark=key.start_mark)
            seen.add(key.value)
        self.flatten_mapping(node)
        # Keys as they are written: marker ids such as 38 and 007 are names.
        return {key.value: self.construct_object(value, deep=deep) for key, value in node.value}


class _Dumper(yaml.SafeDumper):
    # Text is quoted where either reading would make it something else, so that other readers agree.
    yaml_implicit_resolvers: ClassVar = {
        first: [*yaml.SafeDumper.yaml_implicit_resolvers.get(first, []), *_resolvers().get(first, [])]
        for first in {*yaml.SafeDumper.yaml_implicit_resolvers, *_resolvers()}
    }

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _int(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    if len(text) > 30:
        raise yaml.MarkedYAMLError(problem=f"a number of {len(text)} digits", problem_mark=node.start_mark)
    return int(text)


def _float(loader: _Loader, node: yaml.ScalarNode) -> float:
    text = loader.construct_scalar(node).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


def _unknown_tag(loader: _Loader, node: yaml.Node) -> Any:
    raise yaml.MarkedYAMLError(
        problem=f"the tag {node.tag!r} is not plain data: remove it", problem_mark=node.start_mark
    )


_Loader.add_constructor("tag:yaml.org,2002:int", _int)
_Loader.add_constructor(None, _unknown_tag)  # pyright: ignore[reportArgumentType]  (None: all other tags)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)


def parse_yaml(text: str) -> Any:
    """One YAML document as plain data.

    Raises:
        ValueError: not YAML, a key that stands twice, too large, too many aliases, or nested too deeply; says where.
    """
    if len(text) > MAX_BYTES:
        raise ValueError(f"{len(text)} characters; expected at most {MAX_BYTES}: is this a config?")
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ValueError(f"{place}{error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from None
    except RecursionError:
        raise ValueError("nested too deeply") from None


def dump_yaml(data: Any) -> str:
    """Plain data as YAML that `parse_yaml` reads back to the same data."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
