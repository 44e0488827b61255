"""Everything that decides the results of a study, and how a folder says which study it holds."""

import dataclasses
import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from eval.montecarlo.regimes import Regime
from jaxgeo import __version__
from jaxgeo.errors import InputError
from jaxgeo.export.json_text import json_ready
from jaxgeo.simulate import UAV, Layout
from jaxgeo.simulate.session import VISIT_SIGMA_M
from jaxgeo.solve.correct import Settings

FORMAT = 1
SOLVE = Settings(extra_sigma_m=VISIT_SIGMA_M)
# The longest trajectory of the reference study.
N_POSES = 1829
LAYOUT = dataclasses.replace(UAV, n_poses=N_POSES)
# On a CPU sessions run one after the other, this many a device and call: few wait for the last one, and a call takes
# seconds. On an accelerator they run side by side.
CPU_BATCH, ACCELERATOR_BATCH = 8, 256
CPU_CHUNK = 64
_PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "scipy")


@dataclasses.dataclass(frozen=True)
class StudySettings:
    """A study. Session i belongs to regime i modulo their number, its seed is `seed` + i.

    Attributes:
        draws: sessions.
        seed: of the first.
        regimes: in turn.
        layout: of every session.
        chunk: sessions a file.
        batch: sessions a device works on in one call.
        platform: of the devices: `cpu`, `gpu`, ...: another one rounds in other places.
    """

    draws: int
    seed: int
    regimes: tuple[Regime, ...]
    layout: Layout
    chunk: int
    batch: int
    platform: str

    @property
    def side_by_side(self) -> bool:
        """Whether a device works on its sessions together: on a CPU all would wait for the slowest."""
        return self.platform != "cpu"

    def regime_of(self, session: int) -> Regime:
        return self.regimes[session % len(self.regimes)]

    def seed_of(self, session: int) -> int:
        return self.seed + session

    def chunks(self) -> tuple[range, ...]:
        """The sessions of every file."""
        return tuple(range(i, min(i + self.chunk, self.draws)) for i in range(0, self.draws, self.chunk))

    def as_dict(self) -> dict[str, Any]:
        """As `settings.json` has it."""
        versions = {"jaxgeo": __version__, "python": platform.python_version()}
        found = {
            "what": "Monte-Carlo study of learned odometry noise",
            "simulated": True,
            "format": FORMAT,
            "draws": self.draws,
            "seed": self.seed,
            "regimes": {regime.name: _plain(dataclasses.asdict(regime)) for regime in self.regimes},
            "order_of_regimes": [regime.name for regime in self.regimes],
            "layout": dataclasses.asdict(self.layout),
            "chunk": self.chunk,
            "batch": self.batch,
            "platform": self.platform,
            "solve": dataclasses.asdict(SOLVE),
            "versions": versions | {name: version(name) for name in _PACKAGES},
        }
        return json_ready(found)

    @property
    def digest(self) -> str:
        """Short fingerprint, kept in every chunk."""
        text = json.dumps(self.as_dict(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def study_settings(
    draws: int,
    seed: int,
    regimes: tuple[Regime, ...],
    *,
    platform: str,
    poses: int = N_POSES,
    chunk: int | None = None,
    batch: int | None = None,
) -> StudySettings:
    """Settings with the defaults of the platform filled in."""
    if batch is None:
        batch = CPU_BATCH if platform == "cpu" else ACCELERATOR_BATCH
    if chunk is None:
        chunk = CPU_CHUNK if platform == "cpu" else 2 * batch
    layout = dataclasses.replace(LAYOUT, n_poses=poses)
    return StudySettings(draws, seed, regimes, layout, chunk, batch, platform)


def check_same(ours: Mapping[str, Any], theirs: Mapping[str, Any], place: str) -> None:
    """Refuse to go on with another study's chunks.

    Raises:
        InputError: naming the first key that differs.
    """
    difference = _difference(ours, theirs, "")
    if difference is None:
        return
    key, here, there = difference
    raise InputError(
        f"{place}: holds a study with other settings: {key} is {_short(there)} there and {_short(here)} here. Use its "
        "settings to go on with it, or name another folder."
    )


def _difference(ours: Any, theirs: Any, key: str) -> tuple[str, Any, Any] | None:
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
        for name in dict.fromkeys([*ours, *theirs]):
            found = _difference(ours.get(name), theirs.get(name), f"{key}.{name}" if key else str(name))
            if found is not None:
                return found
        return None
    return None if ours == theirs else (key, ours, theirs)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain(value: Any) -> Any:
    """Infinity, which JSON has no word for, as text: a study of normal noise is not one of an unknown noise."""
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    return str(value) if isinstance(value, float) and value in (float("inf"), float("-inf")) else value
