"""What every source of scans offers."""

from collections.abc import Iterator

from jaxgeo.data import Scan
from jaxgeo.io.item_source import ItemSource, OnBad, UnreadableItemError


class ScanSource(ItemSource[Scan]):
    """Scans in a fixed order, by stamp, each read when it is its turn. Holds no open file between calls.

    Attributes:
        n_scans: how many there are, unreadable ones included; None where nothing tells.
        on_bad: what an unreadable scan does: `raise` a ScanError, or be left out, counted and warned of (`skip`).
        bad: index -> message of the unreadable scans met so far.
    """

    n_scans: int | None

    def __init__(self, n_scans: int | None, on_bad: OnBad) -> None:
        super().__init__("scan", on_bad)
        self.n_scans = n_scans

    def scans(self, start: int = 0) -> Iterator[Scan]:
        """The scans from the one with index `start` on; earlier ones are passed over.

        Warns:
            InputWarning: of the first unreadable scan, and of their number at the end, if `on_bad` is `skip`.

        Raises:
            ScanError: `start` is negative; a scan is unreadable and `on_bad` is `raise`.
        """
        return self._items(start)


class UnreadableScanError(UnreadableItemError):
    """One scan of a source cannot be read; the others may well be."""
