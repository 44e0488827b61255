"""A piece of a point cloud, with its columns under the names that all formats share."""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt16

from jaxgeo.io.input_warning import InputWarning

COLOUR = ("red", "green", "blue")
NORMAL = ("nx", "ny", "nz")

Columns = Mapping[str, np.dtype]


@dataclasses.dataclass(frozen=True)
class CloudChunk:
    """Successive points of a cloud.

    Attributes:
        points_m: (n, 3) in the coordinates of the file, without its `origin_enh_m`.
        columns: (n,) each, by name. Shared by all formats: `red`, `green`, `blue` (uint16, the full range used),
            `intensity`, `stamp_s`, `pose_index`, `nx`, `ny`, `nz` (unit normal). Others as the file calls them.
    """

    points_m: Float[np.ndarray, "n 3"]
    columns: Mapping[str, Shaped[np.ndarray, "n"]]

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def colour(self) -> UInt16[np.ndarray, "n 3"] | None:
        return self._together(COLOUR)

    @property
    def normal(self) -> Float[np.ndarray, "n 3"] | None:
        return self._together(NORMAL)

    @property
    def intensity(self) -> Shaped[np.ndarray, "n"] | None:
        return self.columns.get("intensity")

    @property
    def stamp_s(self) -> Float[np.ndarray, "n"] | None:
        return self.columns.get("stamp_s")

    @property
    def pose_index(self) -> Int[np.ndarray, "n"] | None:
        return self.columns.get("pose_index")

    def rows(self, keep: np.ndarray) -> "CloudChunk":
        """These points only: a mask or indices."""
        return CloudChunk(self.points_m[keep], {name: values[keep] for name, values in self.columns.items()})

    def _together(self, names: Sequence[str]) -> np.ndarray | None:
        if not all(name in self.columns for name in names):
            return None
        return np.column_stack([self.columns[name] for name in names])


def warn_left_out(path: str | Path, names: Sequence[str], why: str) -> None:
    """Say which columns of a cloud are not carried on."""
    if names:
        warnings.warn(f"{path}: the columns {', '.join(names)[:400]} are left out: {why}.", InputWarning, stacklevel=3)
