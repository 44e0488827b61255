"""How alike images are, from their features alone: VLAD with words learned from the session itself.

Jegou, Douze, Schmid, Perez, "Aggregating local descriptors into a compact image representation", CVPR 2010; signed
square roots and normalisation word by word: Arandjelovic and Zisserman, "All about VLAD", CVPR 2013.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.mapping.image_features import Features

_SAMPLE = 30_000  # descriptors the words are learned from
_ROUNDS = 12
_ENOUGH_IMAGES = 10


def image_vectors(images: Sequence[Features], words: int = 32, seed: int = 0) -> Float[np.ndarray, "n d"]:
    """One float32 vector of unit length an image; the likeness of two images is their inner product.

    Of every word, the descriptors nearest to it are summed as differences from it. An image without features gets
    zeros: it is like none. A vector takes 4 * words * d bytes (16 kB for SIFT); no list of words is shipped or loaded.
    """
    described = [image for image in images if len(image)]
    if not described:
        return np.zeros((len(images), 1), dtype=np.float32)
    centres = _learned_words([image.descriptors for image in described], words, seed)
    vectors = np.zeros((len(images), centres.size), dtype=np.float32)
    for row, image in enumerate(images):
        if len(image):
            vectors[row] = _aggregate(image.descriptors, centres)
    if len(described) >= _ENOUGH_IMAGES:  # what all images share tells nothing: the light, the most common words
        vectors[[len(image) > 0 for image in images]] -= vectors.sum(axis=0) / len(described)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _learned_words(descriptors: list[Float[np.ndarray, "n d"]], words: int, seed: int) -> Float[np.ndarray, "k d"]:
    """Lloyd's k-means on a sample: the same words for the same images."""
    random = np.random.default_rng(seed)
    each = max(1, _SAMPLE // len(descriptors))
    sample = np.concatenate([one[random.permutation(len(one))[:each]] for one in descriptors]).astype(np.float32)
    centres = sample[random.permutation(len(sample))[:words]]
    for _ in range(_ROUNDS):
        nearest = _nearest(sample, centres)
        count = np.bincount(nearest, minlength=len(centres))
        sums = np.zeros_like(centres)
        np.add.at(sums, nearest, sample)
        centres = np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], centres).astype(np.float32)
    return centres


def _nearest(descriptors: Float[np.ndarray, "n d"], centres: Float[np.ndarray, "k d"]) -> Int[np.ndarray, "n"]:
    return np.argmin(np.sum(centres**2, axis=1) - 2.0 * descriptors @ centres.T, axis=1)


def _aggregate(descriptors: Float[np.ndarray, "n d"], centres: Float[np.ndarray, "k d"]) -> Float[np.ndarray, "kd"]:
    nearest = _nearest(descriptors, centres)
    sums = np.zeros_like(centres)
    np.add.at(sums, nearest, descriptors - centres[nearest])
    sums = np.sign(sums) * np.sqrt(np.abs(sums))
    return (sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)).ravel()
