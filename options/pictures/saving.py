"""Writes a picture in the format that the file's name asks for."""

from __future__ import annotations

from pathlib import Path

from options.pictures.picture import Picture
from options.pictures.svg import to_svg
from swarm.errors import PictureError

ENDINGS = (".png", ".svg", ".pdf")


def check_target(path: Path) -> None:
    """Raises PictureError where no picture can be written: before anything is computed for it."""
    if path.suffix.lower() not in ENDINGS:
        raise PictureError(
            f"picture {path} has no ending that says its format; allowed: {', '.join(ENDINGS)}"
        )
    if not path.parent.is_dir():
        raise PictureError(f"picture {path} cannot be written: there is no directory {path.parent}")


def save(picture: Picture, path: Path) -> None:
    """Writes a picture as PNG, SVG or PDF, by the file's ending; a file that is there is replaced.

    Raises PictureError for another ending, a directory that is not there, a file that cannot be
    written, or a missing Matplotlib (PNG and PDF).
    """
    check_target(path)
    try:
        path.write_bytes(rendered(picture, path.suffix.lower()))
    except OSError as error:
        raise PictureError(f"picture {path} cannot be written: {error.strerror}") from error


def rendered(picture: Picture, ending: str) -> bytes:
    """The file's bytes, for one of ENDINGS. Raises PictureError without Matplotlib."""
    if ending == ".svg":
        return to_svg(picture).encode()
    try:
        from options.pictures.figure import to_figure
    except ModuleNotFoundError as error:
        raise PictureError(
            f"a picture as {ending} needs the package {error.name!r}, which is not installed: "
            "pip install 'coadapt-edge[figures]'; an .svg needs nothing"
        ) from error
    return to_figure(picture, "png" if ending == ".png" else "pdf")
