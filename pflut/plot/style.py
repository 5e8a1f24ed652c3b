"""Colors, figures and how they are saved."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pflut._files import replacing

# M. Okabe, K. Ito, "Color universal design" (2008): told apart by the color-blind
BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#000000", "#8C8C8C"
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, BLACK)
# perceptually uniform, and the same order in grey
COLORMAP = "viridis"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches that makes room for its labels."""
    return Figure(figsize=(width, height), layout="constrained")


def tidy(axes: Axes, *, grid: bool = True) -> None:
    """Take away what carries no data."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = 150) -> None:
    """Write a figure, atomically, in the format of the path's suffix.

    Parameters
    ----------
    figure : Figure
    path : path
        ``.png``, ``.pdf``, ``.svg``, ...; its folder must exist.
    dpi : int
        Dots per inch of a raster format.

    Raises
    ------
    ValueError
        If the suffix is no format that Matplotlib writes.
    """
    suffix = Path(path).suffix.removeprefix(".").lower()
    known = figure.canvas.get_supported_filetypes()
    if suffix not in known:
        raise ValueError(f"{path}: no format for figures, expected one of {', '.join(known)}")
    # without the date, and with names that are no random numbers, the same figure gives the same
    # bytes
    undated = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with replacing(path) as temporary, rc_context({"svg.hashsalt": "pflut"}):
        figure.savefig(temporary, dpi=dpi, metadata=undated.get(suffix))
