"""DISK features and LightGlue through kornia, where their weights lie on this machine: the only file here with torch.

DISK: Tyszkiewicz, Fua, Trulls, NeurIPS 2020. LightGlue: Lindenberger, Sarlin, Pollefeys, ICCV 2023. kornia's own
loaders fetch what is missing; here only files that are there are read, and only as tensors.
"""

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int, UInt8

from jaxgeo.errors import InputError
from jaxgeo.mapping.image_features import DISK_FILE, Features, match_mutual

LIGHTGLUE_FILES = ("disk_lightglue_v0-1_arxiv.pth", "disk_lightglue.pth")
_RATIO = 0.95  # learned descriptors of neighbouring places are more alike than SIFT's: mutual choice does the work
_SIDE_PX = 16  # DISK halves the image four times


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weight files on this machine.

    Attributes:
        disk: of the features.
        lightglue: of the matcher; None: mutual nearest neighbours instead.
    """

    disk: Path
    lightglue: Path | None


def find_weights(folder: Path | None = None) -> Weights | None:
    """The weights in a folder, or in torch.hub's cache; None where those of DISK are not there."""
    folder = folder or _hub_cache()
    if not (folder / DISK_FILE).is_file():
        return None
    lightglue = next((folder / name for name in LIGHTGLUE_FILES if (folder / name).is_file()), None)
    return Weights(folder / DISK_FILE, lightglue)


class DiskFeatures:
    """DISK, paired by LightGlue where its weights are there too; on the CPU.

    Args:
        weights: the files, see `find_weights`.
        max_features: at most so many an image, the strongest.

    Raises:
        InputError: torch or kornia are not installed, or a file does not hold these weights.
    """

    name = "disk"

    def __init__(self, weights: Weights, max_features: int = 1500):
        self._torch, feature = _libraries()
        self._max_features = max_features
        self._disk = feature.DISK()
        self._load(self._disk, weights.disk, lambda state: state["extractor"])
        self._lightglue = None
        if weights.lightglue is not None:
            self._lightglue = feature.LightGlue(features=None, weights=None, input_dim=128)
            self._load(self._lightglue, weights.lightglue, self._renamed)

    def extract(self, image: UInt8[np.ndarray, "h w 3"]) -> Features:
        height, width = image.shape[:2]
        scaled = np.ascontiguousarray(image[..., ::-1].transpose(2, 0, 1)[None], dtype=np.float32) / 255.0
        with self._torch.inference_mode():
            found = self._disk(
                self._torch.from_numpy(scaled),
                n=self._max_features,
                pad_if_not_divisible=bool(height % _SIDE_PX or width % _SIDE_PX),
            )[0]
        points = found.keypoints.numpy().astype(np.float64)
        descriptors = found.descriptors.numpy()
        strongest = np.argsort(-found.detection_scores.numpy(), kind="stable")
        descriptors = descriptors / np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-12)
        return Features(points[strongest], descriptors[strongest], (width, height))

    def match(self, first: Features, second: Features) -> Int[np.ndarray, "m 2"]:
        if self._lightglue is None or min(len(first), len(second)) < 2:
            return match_mutual(first, second, _RATIO)
        with self._torch.inference_mode():
            found = self._lightglue({"image0": self._batch(first), "image1": self._batch(second)})
        return found["matches"][0].numpy().astype(np.int64).reshape(-1, 2)

    def _batch(self, features: Features) -> dict[str, Any]:
        return {
            "keypoints": self._torch.from_numpy(features.points_px.astype(np.float32))[None],
            "descriptors": self._torch.from_numpy(features.descriptors)[None],
            "image_size": self._torch.tensor([features.resolution_px], dtype=self._torch.float32),
        }

    def _load(self, model: Any, path: Path, state_of: Any) -> None:
        try:
            state = self._torch.load(path, map_location="cpu", weights_only=True)
            model.load_state_dict(state_of(state))
        except Exception as failure:  # torch raises a dozen kinds, from pickle's to its own
            reason = str(failure).strip().splitlines()
            raise InputError(
                f"{path}: does not hold the weights of {type(model).__name__} ({reason[0] if reason else failure!r}). "
                "Fetch the file again, or use features sift."
            ) from None
        model.eval()

    @staticmethod
    def _renamed(state: dict[str, Any]) -> dict[str, Any]:
        """Published weights name a layer `self_attn.3.…` or `cross_attn.3.…`, kornia `transformers.3.self_attn.…`."""
        names = {}
        for name, value in state.items():
            part, _, rest = name.partition(".")
            number, _, tail = rest.partition(".")
            attention = part in ("self_attn", "cross_attn") and number.isdigit()
            names[f"transformers.{number}.{part}.{tail}" if attention else name] = value
        return names


def _hub_cache() -> Path:
    """Where torch.hub keeps weights, without importing torch."""
    home = os.environ.get("TORCH_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "torch"
    return Path(home) / "hub" / "checkpoints"


def _libraries() -> tuple[Any, Any]:
    try:
        import torch
        from kornia import feature
    except ImportError as failure:
        raise InputError(
            f"features disk needs torch and kornia, which cannot be imported ({failure}): pip install 'jaxgeo[vision]'."
        ) from None
    return torch, feature
