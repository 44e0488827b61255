"""The kinds of values that a config is made of, each with what it accepts and how it refuses."""

import difflib
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator
from pydantic import ValidationInfo as Info

DATA_VARIABLE = "JAXGEO_DATA"


def nearest(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` and the known words, for messages about an unknown one."""
    known = list(known)
    folded = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.5)
    return (f"; did you mean {folded[close[0]]!r}?" if close else "") + f" (known: {', '.join(known)})"


class Section(BaseModel):
    """A mapping with fixed keys: an unknown or a missing one is refused by name."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        for key in value:
            if key not in cls.model_fields:
                raise ValueError(f"unknown key {key!r}{nearest(str(key), cls.model_fields)}")
        for name, field in cls.model_fields.items():
            if field.is_required() and name not in value:
                raise ValueError(f"missing key {name!r}: {field.description}")
        return value


def _name(value: Any) -> Any:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if not isinstance(value, str) or not value.strip():
        raise ValueError("expected a name; write it in quotes")
    return value


def _file_name(value: Any) -> Any:
    if not isinstance(value, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", value):
        raise ValueError("it names output files: expected letters, digits, '.', '_' and '-' only, at most 100")
    return value


def _crs(value: Any) -> Any:
    if not isinstance(value, str) or not re.fullmatch(r"local|epsg:\d+(\+\d+)?", value.lower()):
        raise ValueError("expected EPSG:<code>, EPSG:<horizontal>+<vertical>, or local for a site frame")
    return "local" if value.lower() == "local" else value.upper()


def _column(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int) or value == "":
        raise ValueError("expected a header name or a 0-based column number")
    if isinstance(value, int) and value < 0:
        raise ValueError("expected a column number counted from 0")
    return value


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("expected three numbers [x, y, z]")
    return tuple(value)


def _per_axis(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value, value, value)
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("expected one number, or three for the three axes")
    return tuple(value)


def _marker_sizes(value: Any) -> Any:
    return value if isinstance(value, dict) else {"default": value}


def _input_file(value: Any, info: Info) -> Path:
    """Expand `${JAXGEO_DATA}`; resolve against the config's folder, `info.context["folder"]`, where there is one."""
    if isinstance(value, Path):
        return value
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise ValueError("expected the path of a file")
    marker = "${" + DATA_VARIABLE + "}"
    if marker in value:
        root = os.environ.get(DATA_VARIABLE)
        if not root:
            raise ValueError(f"the environment variable {DATA_VARIABLE} is not set: set it to the folder of the data")
        value = value.replace(marker, root)
    if "${" in value:
        raise ValueError(f"only {marker} is expanded in paths")
    folder = (info.context or {}).get("folder")
    return Path(value) if folder is None else Path(os.path.abspath(Path(folder) / value))


Name = Annotated[str, BeforeValidator(_name)]
Crs = Annotated[str, BeforeValidator(_crs)]
FileName = Annotated[str, BeforeValidator(_file_name)]
# What a column holds -> its header name or 0-based number. Which keys a table can have is known by its reader alone.
Columns = dict[str, Annotated[str | int, PlainValidator(_column)]]
InputFile = Annotated[Path, BeforeValidator(_input_file)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Vector = Annotated[tuple[float, float, float], BeforeValidator(_three)]
PositivePerAxis = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_per_axis)]
NonNegativePerAxis = Annotated[tuple[NonNegative, NonNegative, NonNegative], BeforeValidator(_per_axis)]
MarkerSizes = Annotated[dict[str, Positive], BeforeValidator(_marker_sizes)]
