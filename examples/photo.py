"""The picture to approximate: read and resized."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from teg.errors import InputError, MissingPackageError


def read_target(photo: str | Path | None, size: int, bundled: str = "astronaut", square: bool = True) -> np.ndarray:
    """Returns the picture as an array of shape (rows, columns, 3), sRGB values in [0, 1]; `None` is scikit-image's `bundled` one.

    Any file that Pillow reads (of an animation the first frame): turned according to its EXIF data, transparency on white, resized so that
    its longer side has `size` pixels. `square` crops it to the square in its middle first, and says so. Raises InputError if the file is
    missing or not a picture, or so narrow that its shorter side would have less than 2 pixels.
    """
    image = _bundled(bundled) if photo is None else _read(Path(photo))
    if square and image.width != image.height:
        side = min(image.size)
        left, top = (image.width - side) // 2, (image.height - side) // 2
        if photo is not None:
            print(f"the photo has {image.width} × {image.height} pixels: only the square in its middle is used")
        image = image.crop((left, top, left + side, top + side))
    scale = size / max(image.size)
    width, height = (round(scale * n) for n in image.size)
    if min(width, height) < 2:
        what = f"a picture of {image.width} × {image.height} pixels would have {width} × {height}"
        raise InputError(what, None, "a larger --size, or a picture less narrow")
    return np.asarray(image.resize((width, height), Image.Resampling.LANCZOS), dtype=float) / 255


def _bundled(name: str) -> Image.Image:
    try:
        from skimage import data
    except ImportError:
        raise MissingPackageError(
            "the default photo is scikit-image's, which is not installed",
            None,
            'pip install "teg-compiler[demo]", or name a photo of your own: teg demo … photo.jpg',
        ) from None
    picture: np.ndarray = getattr(data, name)()
    return Image.fromarray(picture)


def _read(path: Path) -> Image.Image:
    """Returns the picture in a file, 8 bits a channel."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as file:
                return _as_rgb(ImageOps.exif_transpose(file))
    except FileNotFoundError:
        raise InputError(f"there is no file {str(path)!r}", None, _hint(path)) from None
    except UnidentifiedImageError:
        what = f"{str(path)!r} is not a picture that Pillow can read"
        raise InputError(what, None, "use a PNG or JPEG file") from None
    except Image.DecompressionBombError as problem:
        raise InputError(f"{str(path)!r} is too large", None, f"make it smaller first ({problem})") from None
    except (OSError, SyntaxError, ValueError, EOFError) as problem:  # raised by Pillow for damaged files
        raise InputError(f"{str(path)!r} cannot be read", None, f"Pillow says: {problem}") from None


def _as_rgb(image: Image.Image) -> Image.Image:
    if image.mode.startswith(("I", "F")):  # more than 8 bits a pixel, of grey
        grey = np.nan_to_num(np.asarray(image, dtype=float)).clip(min=0)
        fractions = image.mode == "F" and grey.max() <= 1
        white = 1 if fractions else 255 if grey.max() <= 255 else max(grey.max(), 65535)
        image = Image.fromarray(np.rint(grey * (255 / white)).astype(np.uint8))
    if image.has_transparency_data:
        image = image.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image)
    return image.convert("RGB")


def _hint(path: Path) -> str:
    folder = path.parent
    return f"there is no folder {str(folder)!r} either" if not folder.is_dir() else f"looked in {str(folder.resolve())!r}"
