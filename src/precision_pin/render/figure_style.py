"""Size, style, caption and legend of all figures, without pyplot's global state; and figures as SVG inside a page.

In a page colours follow the reader's light or dark scheme. Only shapes and embedded images are kept: text becomes
outlines, so no name can be markup; identifiers begin with the figure's name, so that figures of one page do not clash.
"""

from __future__ import annotations

import bisect
import io
import re
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from types import FunctionType
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
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
_MARGIN: Final = 0.06
"""Room between text or axes and the figure's edge, inches."""
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
    figure = _ShownFigure(figsize=inches, layout=ConstrainedLayoutEngine(w_pad=_MARGIN, h_pad=0.05))
    FigureCanvasAgg(figure)
    return figure


def figure_of(axes: Axes) -> Figure:
    """Return the figure of some axes."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure


def set_height(figure: Figure, height: float) -> None:
    """Set the height of a figure in mm."""
    figure.set_size_inches(figure.get_size_inches()[0], height / _MILLIMETRES_PER_INCH)


def _wrap(text: str, figure: Figure, size: str) -> list[str]:
    """Return the lines of a text, each wrapped to the width of a figure at the size of a text of the style."""
    canvas: Any = figure.canvas
    renderer = canvas.get_renderer()
    font = FontProperties(family=_STYLE["font.family"], size=_STYLE[size])
    width = (figure.get_size_inches()[0] - 2 * _MARGIN) * figure.dpi

    def advance(word: str) -> float:
        """Return the length of a word and the space after it, pixels; between bars, since only ink is measured."""
        ends = (renderer.get_text_width_height_descent(part, font, False)[0] for part in (f"|{word} |", "||"))
        return float(next(ends) - next(ends))

    lines: list[str] = []
    with _missing_glyphs_ignored():
        for paragraph in text.split("\n"):
            room = 0.0
            # a number stays with what it counts
            for word in re.split(r" (?![=\d%]|mm|mrad)", paragraph):
                # a word wider than the figure, such as the name of a file, is cut
                while (length := advance(word)) > width:
                    end = bisect.bisect_left(range(2, len(word)), width, key=lambda end: advance(word[:end])) + 1
                    lines.append(word[:end])
                    word, room = word[end:], 0.0
                if length > room:
                    lines.append("")
                    room = width
                lines[-1] += f"{word} "
                room -= length
    return [line.rstrip() for line in lines if line.strip()]


def caption(what: str, provenance: Any, pose: Any) -> str:
    """Return the first line of a caption: content, arm (its robot, base and tip) and pose (its name)."""
    named = f" at pose {visible(pose.name)}" if pose.name else ""
    arm = f"{visible(provenance.robot)}, {visible(provenance.base)} to {visible(provenance.tip)}"
    return f"{what} of {arm}{named}{visible(provenance.datum.text) if provenance.datum else ''}"


def _labelled(panels: Iterable[Axes]) -> dict[str, Any]:
    """Return the artists of some axes by label, each label once."""
    artists: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            artists.setdefault(label, handle)
    return artists


def frame(figure: Figure, panels: Iterable[Axes], title: str, caption: str, height: float, columns: int = 4) -> None:
    """Add a title above, caption and legend below, and set the height: this many mm plus the text.

    Title and caption, each of one or several lines, are wrapped to the width of the figure.
    """
    entries = _labelled(panels)
    above, below = _wrap(title, figure, "figure.titlesize"), _wrap(caption, figure, "legend.title_fontsize")
    if above:
        figure.suptitle("\n".join(above))
    if entries or below:
        figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            title="\n".join(below),
            handlelength=2.6,
        )
    rows = -(-sum(1 + label.count("\n") for label in entries) // columns)
    set_height(figure, height + (len(above) + len(below) + rows) * LINE_HEIGHT)


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
    used = {identifier for value in values for identifier in re.findall(r"(?:^|url\()#([^)]*)", value)}
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


@contextmanager
def _missing_glyphs_ignored() -> Iterator[None]:
    """Accept names with letters that the font of the figures lacks; tables show them."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing", category=UserWarning)
        yield


def _svg(drawn: Figure) -> bytes:
    stream = io.BytesIO()
    with style(), _missing_glyphs_ignored():
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
            coloured = re.sub(r"#[0-9a-fA-F]{6}\b", lambda match: COLOURS.get(match[0].lower(), match[0]), value)
            return re.sub(r"url\(#([^)]*)\)", rf"url(#{name}-\1)", coloured)
