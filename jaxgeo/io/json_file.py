"""JSON files of others, as plain data."""

import json
from pathlib import Path
from typing import Any

from jaxgeo.errors import InputError
from jaxgeo.io.text_file import read_lines


def read_json(path: str | Path, expected: str, error: type[InputError] = InputError) -> Any:
    """What a JSON file holds.

    Args:
        path: the file.
        expected: what it should be, for messages: `a noise.json`.
        error: the kind of error to raise.

    Raises:
        error: the file cannot be read, is no JSON, is nested too deeply, or holds half characters, with which no file
            can be written; with file and line.
    """
    text = "\n".join(read_lines(path, error))
    try:
        content = json.loads(text)
        if "\\u" in text:
            json.dumps(content, ensure_ascii=False).encode()
    except json.JSONDecodeError as failure:
        problem = f"{path}:{failure.lineno}: {failure.msg}: not JSON"
        raise error(f"{problem}; expected {expected}. Was writing it cut off?") from None
    except UnicodeEncodeError:
        raise error(f"{path}: holds half a character (\\ud800 to \\udfff alone); expected {expected}.") from None
    except (ValueError, RecursionError) as failure:  # a number of thousands of digits; thousands of brackets
        why = "nested too deeply" if isinstance(failure, RecursionError) else str(failure)[:80]
        raise error(f"{path}: not JSON that can be read ({why}); expected {expected}.") from None
    return content
