"""What a picture shows, as numbers."""

from pathlib import Path

import numpy as np
from PIL import Image


def pixels(path: Path) -> np.ndarray:
    """The colours (H, W, 3) of a picture, 0 to 255."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def shades(image: np.ndarray) -> int:
    """How many colours occur."""
    return len(np.unique(np.asarray(image).reshape(-1, 3), axis=0))


def share(image: np.ndarray, colour: tuple[int, int, int], within: int = 40) -> float:
    """Share of the pixels whose colour is that, give or take `within` in each part."""
    return float((np.abs(np.asarray(image, dtype=int) - colour).max(axis=-1) <= within).mean())


def inked(image: np.ndarray) -> float:
    """Share of the pixels that are not white."""
    return 1.0 - share(image, (255, 255, 255), 8)


def differing(image: np.ndarray, other: np.ndarray) -> float:
    """Share of the pixels at which two pictures of one size differ visibly."""
    return float((np.abs(np.asarray(image, dtype=int) - np.asarray(other, dtype=int)).max(axis=-1) > 20).mean())
