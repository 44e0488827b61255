"""What a reader owes for any bytes at all, and the one function that holds a reader to it."""

import dataclasses
import random
import re
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.fuzz.mutations import Kind, mutate
from jaxgeo.errors import JaxgeoError
from jaxgeo.io.input_warning import InputWarning

LONGEST_MESSAGE = 2000  # a message that quotes a whole file helps nobody
LONGEST_S = 10.0  # of computing, for files of some kilobytes


class BrokenContractError(AssertionError):
    """A reader did what it must not do."""


@dataclasses.dataclass(frozen=True)
class Target:
    """A reader, and files to damage for it.

    Attributes:
        name: short, for the command line.
        suffix: of the file that it reads.
        kind: what its files are, which chooses the damage.
        read: reads the file at a path, to its end.
        check: raises AssertionError where what came back is not valid data.
        examples: valid files, made on demand.
        covers: the readers' dotted names.
        once_crashed: files, by what was wrong then, at which a reader broke its contract. They must give a refusal, or
            valid data.
        places: messages name the file; false where what is read is made of the file.
        keys: names that a mapping in the file may have.
    """

    name: str
    suffix: str
    kind: Kind
    read: Callable[[Path], Any]
    check: Callable[[Any], None]
    examples: Callable[[], tuple[bytes, ...]]
    covers: tuple[str, ...]
    once_crashed: Mapping[str, bytes] = dataclasses.field(default_factory=dict)
    places: bool = True
    keys: tuple[str, ...] = ()

    def mutated(self, rng: random.Random, data: bytes | None = None) -> bytes:
        """A file, by default one of the valid ones, damaged."""
        examples = self.examples()
        return mutate(rng.choice(examples) if data is None else data, self.kind, rng, examples, self.keys)


def attempt(target: Target, data: bytes, folder: Path) -> JaxgeoError | None:
    """Let a target read these bytes; the refusal, or None where they were read.

    Args:
        target: the reader.
        data: content of the file.
        folder: an empty one; it holds the file alone afterwards.

    Raises:
        BrokenContractError: any other exception, a warning of Python, NumPy or a library, data that are not valid, a
            message that does not say where, a file written or changed, or more than `LONGEST_S`.
    """
    path = folder / f"input{target.suffix}"
    path.write_bytes(data)
    begin_s = time.process_time()  # the machine may be busy with others
    refusal = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", InputWarning)
            target.check(target.read(path))
    except JaxgeoError as failure:
        refusal = failure
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # a panic of a Rust library is no Exception
        raise BrokenContractError(f"{target.name}: {type(failure).__name__}: {failure}") from failure
    taken_s = time.process_time() - begin_s
    if taken_s > LONGEST_S:
        raise BrokenContractError(f"{target.name}: took {taken_s:.1f} s for {len(data)} bytes")
    if refusal is not None:
        _check_message(target, path, data, refusal)
    if [each.name for each in folder.iterdir()] != [path.name] or path.read_bytes() != data:
        raise BrokenContractError(f"{target.name}: wrote beside or into the file")
    return refusal


def _check_message(target: Target, path: Path, data: bytes, refusal: JaxgeoError) -> None:
    text = str(refusal)
    if refusal.exit_code not in (2, 3):
        raise BrokenContractError(f"{target.name}: exit code {refusal.exit_code}")
    if target.places and str(path) not in text:
        raise BrokenContractError(f"{target.name}: the message does not name the file: {text[:300]}")
    if len(text) > LONGEST_MESSAGE:
        raise BrokenContractError(f"{target.name}: a message of {len(text)} characters: {text[:300]}")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise BrokenContractError(f"{target.name}: a message that cannot be printed: {text[:300]!r}") from None
    lines = len(re.split(rb"\r\n|\r|\n", data)) + 1  # where a file ends too soon, the line that is missing
    for line in re.findall(re.escape(str(path)) + r":(\d+): ", text):
        if target.kind != "binary" and not 1 <= int(line) <= lines:
            raise BrokenContractError(f"{target.name}: names line {line} of {lines}: {text[:300]}")
