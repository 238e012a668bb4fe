"""Size, style, caption and legend of all figures, without pyplot and its global state."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from types import FunctionType
from typing import Any, Final, Protocol

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from precision_pin.base.errors import visible

SINGLE_COLUMN: Final = 85.0
"""Width of a figure of one quantity, mm."""

DOUBLE_COLUMN: Final = 174.0
"""Width of a figure of several quantities, mm."""

LINE_HEIGHT: Final = 3.6
"""Height of a text line, mm."""

_MILLIMETRES_PER_INCH: Final = 25.4
_CHARACTERS_PER_MILLIMETRE: Final = 0.62
_CAPTION_CHARACTERS: Final = 105
_NOTEBOOK_DPI: Final = 144
_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.title_fontsize": 7,
    "figure.titlesize": 8,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "text.usetex": False,
    "text.parse_math": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "precision-pin",
    "savefig.bbox": None,
    "savefig.facecolor": "white",
    "path.simplify": True,
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the package's style inside the context."""
    with mpl.rc_context(_STYLE):
        yield


class _ShownFigure(Figure):
    def draw(self, renderer: Any) -> None:
        """Draw the figure, or only lay it out when Matplotlib disables drawing for that purpose."""
        engine = self.get_layout_engine()
        if engine is None or not self.axes or not isinstance(renderer.draw_path, FunctionType):
            super().draw(renderer)
            return
        with suppress(ValueError):  # as Matplotlib does
            engine.execute(self)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        with style():
            self.savefig(stream, format="png", dpi=_NOTEBOOK_DPI, metadata={"Software": None})
        return stream.getvalue()


def new_figure(width: float) -> Figure:
    """Return an empty figure of a width in mm."""
    inches = (width / _MILLIMETRES_PER_INCH, 1.0)
    figure = _ShownFigure(figsize=inches, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05))
    FigureCanvasAgg(figure)
    return figure


def figure_of(axes: Axes) -> Figure:
    """Return the figure of some axes."""
    found = axes.get_figure(root=True)
    assert found is not None
    return found


def set_height(figure: Figure, height: float) -> None:
    """Set the height of a figure in mm."""
    figure.set_size_inches(figure.get_size_inches()[0], height / _MILLIMETRES_PER_INCH)


def wrapped(text: str, figure: Figure) -> list[str]:
    """Return a text wrapped to the width of a figure."""
    width = figure.get_size_inches()[0] * _MILLIMETRES_PER_INCH
    return textwrap.wrap(text, int(width * _CHARACTERS_PER_MILLIMETRE))


class _Arm(Protocol):
    @property
    def robot(self) -> str: ...
    @property
    def base(self) -> str: ...
    @property
    def tip(self) -> str: ...


class _Pose(Protocol):
    @property
    def name(self) -> str: ...


def caption(what: str, provenance: _Arm, pose: _Pose) -> list[str]:
    """Return the caption lines of a 174 mm figure: content, arm and pose."""
    named = f" at pose {visible(pose.name)}" if pose.name else ""
    arm = f"{visible(provenance.robot)}, {visible(provenance.base)} to {visible(provenance.tip)}"
    return textwrap.wrap(f"{what} of {arm}{named}", _CAPTION_CHARACTERS)


def labelled(panels: Iterable[Axes]) -> dict[str, Any]:
    """Return the artists of some axes by label, each label once."""
    found: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return found


def legend_below(figure: Figure, entries: Mapping[str, Any], columns: int, lines: Sequence[str] = ()) -> None:
    """Add a legend below all axes and below the caption lines."""
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        title="\n".join(lines),
        handlelength=2.6,
    )


def frame(figure: Figure, panels: Iterable[Axes], title: str, caption: str, height: float, columns: int = 4) -> None:
    """Add a title above, caption and legend below, and set the height: so many mm plus the text."""
    entries, lines = labelled(panels), wrapped(caption, figure)
    figure.suptitle("\n".join(wrapped(title, figure)))
    legend_below(figure, entries, columns, lines)
    set_height(figure, height + (len(lines) + 1 + len(entries) / columns) * LINE_HEIGHT)


def end_figure(figure: Figure, panels: Iterable[Axes], lines: Sequence[str], height: float, columns: int = 2) -> None:
    """Add lines and a legend below, and set the height, mm."""
    legend_below(figure, labelled(panels), columns, lines)
    set_height(figure, height)


def shortened(name: str, most: int) -> str:
    """Return a name, without its middle if longer than ``most`` characters."""
    half = (most - 1) // 2
    return name if len(name) <= most else f"{name[:half]}…{name[-half:]}"
