"""Training data: squares cut out of photos, anywhere and at several scales, turned and mirrored."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from teg.examples.photo import read_target

TRAINING = ("coffee", "chelsea", "rocket", "retina")  # scikit-image's
SCALES = (96, 128, 192)  # pixels a side of a whole photo


def training_photos(names: Sequence[str] = TRAINING, scales: Sequence[int] = SCALES) -> list[np.ndarray]:
    """Returns every photo at every scale, (size, size, 3) each."""
    return [read_target(None, size, name).astype(np.float32) for name in names for size in scales]


def cut_crops(photos: Sequence[np.ndarray], size: int, count: int, seed: Sequence[int]) -> np.ndarray:
    """Returns random squares of size² pixels, (count, size, size, 3), the same for the same seed."""
    random = np.random.default_rng(list(seed))
    crops = []
    for _ in range(count):
        photo = photos[int(random.integers(len(photos)))]
        row, column = random.integers(0, len(photo) - size + 1, 2)
        crop = np.rot90(photo[row : row + size, column : column + size], int(random.integers(4)))
        crops.append(crop[::-1] if random.integers(2) else crop)
    return np.stack(crops)
