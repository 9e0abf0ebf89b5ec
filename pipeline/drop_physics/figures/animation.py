"""Writes images as an animation, in the format given by the file's suffix."""

from __future__ import annotations

import importlib.util
import io
import itertools
import struct
import warnings
import zlib
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

from PIL import Image

from drop_physics.errors import DropError, ScenarioError, check_suffix
from drop_physics.figures.gif import MAX_FPS as GIF_MAX_FPS
from drop_physics.figures.gif import MIN_FPS as GIF_MIN_FPS
from drop_physics.figures.gif import write_gif

MAX_FPS = {".gif": GIF_MAX_FPS, ".webp": 1000.0, ".apng": 1000.0, ".mp4": 240.0}
"""Largest number of frames per second of each format; delays in WebP and APNG are whole
milliseconds."""
MIN_FPS = 1e-4
"""Lowest frame rate [1/s]: nobody waits three hours for a frame."""


def check_animation(path: Path, fps: float | None) -> None:
    """Check that an animation can be written, before any work is done for it.

    Raises
    ------
    ScenarioError
        If the suffix is that of no supported format, or the format does not support `fps`.
    DropError
        If the format needs a library that is not installed.
    """
    check_suffix("--out", path, MAX_FPS)
    if path.suffix == ".mp4" and importlib.util.find_spec("av") is None:
        raise DropError("an .mp4 needs PyAV; try: pip install av")
    if fps is None:
        return
    most, least = MAX_FPS[path.suffix], GIF_MIN_FPS if path.suffix == ".gif" else MIN_FPS
    if not 0 < fps <= most:
        values = {"most": most, "fps": fps, "try_": f"{most:g}" if fps > most else "20"}
        if path.suffix == ".gif":
            raise ScenarioError(
                "--fps must be above 0 and at most {most:g} in a .gif (viewers play faster gifs at "
                "10), got {fps:g}; try --fps {try_}",
                **values,
            )
        raise ScenarioError(
            "--fps must be above 0 and at most {most:g} in a {suffix}, got {fps:g}; try --fps "
            "{try_}",
            suffix=path.suffix,
            **values,
        )
    if fps < least and path.suffix == ".gif":
        raise ScenarioError(
            "--fps must be at least {least:.6f} (a gif shows a frame for at most 655.35 s), got "
            "{fps:g}; try --fps 1",
            least=least,
            fps=fps,
        )
    if fps < least:
        raise ScenarioError(
            "--fps must be at least {least:.6f}, got {fps:g}; try --fps 1", least=least, fps=fps
        )


def decoded(pngs: Iterable[bytes]) -> Iterator[Image.Image]:
    """Decode PNGs to RGB images; consecutive equal PNGs give the same object.

    Raises
    ------
    ValueError
        If the data of an image are not a PNG.
    """
    before, image = b"", None
    for number, png in enumerate(pngs):
        if image is None or png != before:
            before, image = png, _decoded(png, number)
        yield image


def _decoded(png: bytes, number: int) -> Image.Image:
    try:
        with warnings.catch_warnings(action="error", category=Image.DecompressionBombWarning):
            image = Image.open(io.BytesIO(png), formats=["PNG"])
        image.load()
    except (
        OSError,
        SyntaxError,
        ValueError,
        IndexError,
        struct.error,
        zlib.error,
        Image.DecompressionBombError,
        Image.DecompressionBombWarning,
    ) as error:
        raise ValueError(f"every frame must be a PNG, got frame {number}: {error}") from None
    return image if image.mode == "RGB" else image.convert("RGB")


def write_animation(
    images: Iterable[Image.Image], stream: BinaryIO, *, suffix: str, fps: float
) -> int:
    """Write RGB images of one size as an animation, which loops except as .mp4.

    A .gif or .mp4 is written image by image; for .webp and .apng, Pillow keeps all images in
    memory.

    Parameters
    ----------
    images
        The images, at least one.
    stream
        A seekable stream to write to.
    suffix, fps
        The format and the frame rate, accepted by `check_animation`.

    Returns
    -------
    The number of images.

    Raises
    ------
    ValueError
        If there is no image, or an image has another size.
    """
    if suffix == ".gif":
        return write_gif(images, stream, fps=fps)
    if suffix == ".mp4":
        return _write_mp4(images, stream, fps=fps)
    pictures = list(images)
    if not pictures:
        raise ValueError("an animation needs at least one frame, got none; record with a camera")
    starts_ms = [round(1000 * number / fps) for number in range(len(pictures) + 1)]
    how = {"lossless": True} if suffix == ".webp" else {}
    pictures[0].save(
        stream,
        format="webp" if suffix == ".webp" else "png",
        save_all=True,
        append_images=pictures[1:],
        duration=[end - start for start, end in itertools.pairwise(starts_ms)],
        loop=0,
        **how,
    )
    return len(pictures)


def _write_mp4(images: Iterable[Image.Image], stream: BinaryIO, *, fps: float) -> int:
    """Write H.264 in 4:2:0, which every player supports; the size must be even."""
    import av

    rate, frames = Fraction(fps).limit_denominator(10_000), 0
    with av.open(stream, "w", format="mp4") as container:
        video = container.add_stream("libx264", rate, options={"crf": "16", "threads": "1"})
        video.pix_fmt = "yuv420p"
        for image in images:
            even = tuple(side + side % 2 for side in image.size)
            if not frames:
                video.width, video.height = even
            picture = Image.new("RGB", even, image.getpixel((0, image.height - 1)))  # type: ignore[arg-type]
            picture.paste(image)
            frame = av.VideoFrame.from_image(picture)  # type: ignore[no-untyped-call]
            container.mux(video.encode(frame))
            frames += 1
        if not frames:
            raise ValueError("a film needs at least one frame, got none; record with a camera")
        container.mux(video.encode())
    return frames
