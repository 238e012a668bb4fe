"""Size, style, caption and legend of all figures, without pyplot's global state; and figures as SVG inside a page.

In a page colours follow the reader's light or dark scheme. Only shapes and embedded images are kept: text becomes
outlines, so no name can be markup; identifiers begin with the figure's name, so that figures of one page do not clash.
"""

from __future__ import annotations

import io
import re
import textwrap
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from types import FunctionType
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from precision_pin.base.errors import visible
from precision_pin.render.html import Child, Html, element

SINGLE_COLUMN: Final = 85.0
"""Width of a figure of one quantity, mm."""

DOUBLE_COLUMN: Final = 174.0
"""Width of a figure of several quantities, mm."""

LINE_HEIGHT: Final = 3.6
"""Height of a text line, mm."""

_MILLIMETRES_PER_INCH: Final = 25.4
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
            self.savefig(stream, format="png", dpi=144, metadata={"Software": None})
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
    return textwrap.wrap(text, int(width * 0.62))


def caption(what: str, provenance: Any, pose: Any) -> list[str]:
    """Return the caption lines of a 174 mm figure: content, arm (its robot, base and tip) and pose (its name)."""
    named = f" at pose {visible(pose.name)}" if pose.name else ""
    arm = f"{visible(provenance.robot)}, {visible(provenance.base)} to {visible(provenance.tip)}"
    return textwrap.wrap(f"{what} of {arm}{named}", 105)


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


COLOURS: Final = {
    "#000000": "currentColor",
    "#ffffff": "var(--paper)",
    "#0072b2": "var(--blue)",
    "#1f77b4": "var(--blue)",
    "#56b4e9": "var(--sky)",
    "#d55e00": "var(--vermilion)",
    "#009e73": "var(--green)",
    "#cc79a7": "var(--purple)",
}
"""CSS variables of the figures' colours."""


def inline_figure(drawn: Figure, name: str, label: str, caption: Child, class_: str = "") -> Html:
    """Return a figure with its caption.

    Args:
        name: Unique name in plain letters; identifiers begin with it.
        label: What it shows, in numbers, for readers who cannot see it.
        class_: Class for the page's style.
    """
    root = ElementTree.fromstring(_svg(drawn))
    for parent in list(root.iter()):
        # the metadata, and a style that would reach beyond this figure
        for child in [child for child in parent if _local(child.tag) in ("metadata", "style")]:
            parent.remove(child)
    values = (value for node in root.iter() for value in node.attrib.values())
    used = {found for value in values for found in re.findall(r"(?:^|url\()#([^)]*)", value)}
    for node in root.iter():
        node.tag = _local(node.tag)
        node.attrib = {
            _local(key): _rewritten(_local(key), value, name)
            for key, value in node.attrib.items()
            if (key != "id" or value in used) and (key != "style" or node.tag != "image")
        }
        node.text = node.tail = None
    view_box = root.attrib["viewBox"]
    # from points to CSS pixels, enlarged
    pixels = round(float(view_box.split()[2]) * (96 / 72) * 1.45)
    root.attrib = {"viewBox": view_box, "role": "img", "style": f"max-width: {pixels}px", "aria-label": label}
    svg = Html(ElementTree.tostring(root, encoding="unicode"))
    region = element("div", svg, class_="drawing", role="region", tabindex="0", aria_label=f"figure {name}")
    return element("figure", region, element("figcaption", caption), class_=class_, id=f"figure-{name}")


def _svg(drawn: Figure) -> bytes:
    stream = io.BytesIO()
    with style(), warnings.catch_warnings():
        # a name may hold letters that the font of the figures does not have; the tables of the page show them
        warnings.filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        drawn.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return stream.getvalue()


def _local(name: str) -> str:
    """Return a name without its namespace, which SVG inside a page does not need."""
    return name.rpartition("}")[2]


def _rewritten(key: str, value: str, name: str) -> str:
    match key:
        case "id":
            return f"{name}-{value}"
        case "href" if value.startswith("data:image/png;base64,"):
            return "".join(value.split())
        case "href":
            return f"#{name}-{value.removeprefix('#')}"
        case "d" | "x" | "y" | "points":
            # a hundredth of a point; outlines of letters are drawn in units of their own, far smaller
            return re.sub(r"(\d+\.\d{2})\d+", r"\1", " ".join(value.split()))
        case _:
            coloured = re.sub(r"#[0-9a-fA-F]{6}\b", lambda found: COLOURS.get(found[0].lower(), found[0]), value)
            return re.sub(r"url\(#([^)]*)\)", rf"url(#{name}-\1)", coloured)
