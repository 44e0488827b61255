"""What every source of scans or frames offers: items in a fixed order, read one by one, as often as asked for."""

import abc
import contextlib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, Literal, TypeVar

from jaxgeo.errors import DetectError, InputError, ScanError
from jaxgeo.io.input_warning import InputWarning

OnBad = Literal["raise", "skip"]
Item = TypeVar("Item")


class UnreadableItemError(ScanError):
    """One scan or frame of a source cannot be read; the others may well be."""


class ItemSource(abc.ABC, Generic[Item]):
    """Items in a fixed order. Holds no open file between calls.

    Attributes:
        noun: what an item is called in messages.
        on_bad: what an unreadable item does: `raise` a ScanError, or be left out, counted and warned of (`skip`).
        bad: index -> message of the unreadable items met so far.
        error: what is raised of the source, `unreadable` of a single item.
    """

    error: ClassVar[type[InputError]] = ScanError
    unreadable: ClassVar[type[InputError]] = UnreadableItemError
    noun: str
    on_bad: OnBad
    bad: dict[int, str]

    def __init__(self, noun: str, on_bad: OnBad) -> None:
        if on_bad not in ("raise", "skip"):
            raise self.error(f"on_bad is {on_bad!r}, expected 'raise' or 'skip'.")
        self.noun = noun
        self.on_bad = on_bad
        self.bad = {}

    def __iter__(self) -> Iterator[Item]:
        return self._items(0)

    def _items(self, start: int) -> Iterator[Item]:
        """The items from the one with index `start` on; earlier ones are passed over.

        Warns:
            InputWarning: of the first unreadable item, and of their number at the end, if `on_bad` is `skip`.

        Raises:
            ScanError: `start` is negative; an item is unreadable and `on_bad` is `raise`.
        """
        if start < 0:
            raise self.error(f"Reading is to start at {self.noun} {start}, expected 0 or more.")
        n_bad = 0
        for index, read in self._entries(start):
            try:
                item = read()
            except self.unreadable as failure:
                if self.on_bad == "raise":
                    raise
                self.bad[index] = str(failure)
                n_bad += 1
                if n_bad == 1:
                    warnings.warn(f"{failure} The {self.noun} is left out.", InputWarning, stacklevel=2)
                continue
            yield item
        if n_bad > 1:
            warnings.warn(
                f"{self._name()}: {n_bad} {self.noun}s could not be read and are left out.", InputWarning, stacklevel=2
            )

    @abc.abstractmethod
    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Item]]]:
        """(index, what reads it) of the items from `start` on; reading raises UnreadableItemError."""

    @abc.abstractmethod
    def _name(self) -> str:
        """What the source is called in messages: its path."""


@contextlib.contextmanager
def raised_as(error: type[ScanError]) -> Iterator[None]:
    """Errors of the readers shared with images become errors of scans and frames, in the same words."""
    try:
        yield
    except DetectError as failure:
        raise error(str(failure)) from None


def check_keys(
    path: str | Path, kind: str, given: Mapping[str, Any], keys: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """The arguments that are given, if all of them say something about a source of this kind.

    Raises:
        ScanError: an unknown kind, or an argument of another.
    """
    if kind not in keys:
        raise ScanError(f"{path}: kind {kind!r}, expected one of {', '.join(keys)}.")
    given = {key: value for key, value in given.items() if value is not None}
    for key in given:
        if key not in keys[kind]:
            raise ScanError(
                f"{path}: {key!r} says nothing about a source of kind {kind!r}, which has {', '.join(keys[kind])}. "
                "Remove it, or is the kind another one?"
            )
    return given


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is that of a ROS 2 bag."""
    return (path / "metadata.yaml").exists() or any(path.glob("*.mcap")) or any(path.glob("*.db3"))
