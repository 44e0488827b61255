"""Plain JSON: NumPy turned into lists and numbers; NaN and infinity, which JSON does not know, into null."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np


def json_text(value: Any, indent: int | None = 2) -> str:
    """The value as JSON, one line feed at the end; `indent=None` puts it on one line."""
    return json.dumps(json_ready(value), indent=indent, allow_nan=False, ensure_ascii=False) + "\n"


def json_ready(value: Any) -> Any:
    """Dicts, lists, strings, finite numbers, booleans and None only.

    Raises:
        TypeError: the value is of a kind that JSON has no word for.
    """
    if isinstance(value, dict):
        return {str(k): json_ready(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return json_ready(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, (str, int, bool)):
        return value
    if hasattr(value, "__array__"):  # a JAX array
        return json_ready(np.asarray(value))
    raise TypeError(f"cannot write a {type(value).__name__} to JSON: {value!r}")
