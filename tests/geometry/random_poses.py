"""Random transforms as jaxlie samples them in its own tests: uniform, tangent-normal and near-identity."""

import numpy as np
from scipy.spatial.transform import Rotation

KINDS = ("uniform", "tangent_normal", "near_identity")
BATCHES = ((), (4,), (2, 3))


def random_tangents(kind: str, batch: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """(*batch, 6) translation, rotation; rotations below half a turn."""
    rng = np.random.default_rng([seed, KINDS.index(kind), len(batch)])
    if kind == "uniform":
        quat = rng.normal(size=(*batch, 4)).reshape(-1, 4)
        rotvec = Rotation.from_quat(quat).as_rotvec().reshape(*batch, 3)
        return np.concatenate([rng.uniform(-10.0, 10.0, (*batch, 3)), rotvec], axis=-1)
    size = 0.8 if kind == "tangent_normal" else 1e-6
    tangent = rng.normal(size=(*batch, 6))
    # In near-identity transforms the translation stays large: that is where a careless left Jacobian shows.
    tangent[..., 3:] *= size
    return tangent


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(rng=rng).as_matrix()
