"""Matplotlib figures inside a page: SVG whose colours follow the reader's light or dark scheme.

Only shapes and embedded images are kept. Text becomes outlines, so no name can be markup; identifiers begin with the
figure's name, so that figures of one page do not clash.
"""

from __future__ import annotations

import io
import re
import warnings
import xml.etree.ElementTree as ElementTree
from typing import Final

from matplotlib.figure import Figure

from precision_pin.render.figure_style import style
from precision_pin.render.html import Child, Html, element

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

_COLOUR: Final = re.compile(r"#[0-9a-fA-F]{6}\b")
_REFERENCE: Final = re.compile(r"url\(#([^)]*)\)")
_IMAGE: Final = "data:image/png;base64,"
_MOST_DECIMALS: Final = re.compile(r"(\d+\.\d{2})\d+")
_POINTS_TO_PIXELS: Final = 96 / 72
_ENLARGED: Final = 1.45


def figure(drawn: Figure, name: str, label: str, caption: Child, class_: str = "") -> Html:
    """Return a figure with its caption.

    Args:
        name: Unique name in plain letters; identifiers begin with it.
        label: What it shows, in numbers, for readers who cannot see it.
        class_: Class for the page's style.
    """
    svg = element(
        "div", _inline(drawn, name, label), class_="drawing", role="region", tabindex="0", aria_label=f"figure {name}"
    )
    return element("figure", svg, element("figcaption", caption), class_=class_, id=f"figure-{name}")


def _inline(drawn: Figure, name: str, label: str) -> Html:
    root = ElementTree.fromstring(_svg(drawn))
    for parent in list(root.iter()):
        # the metadata, and a style that would reach beyond this figure
        for child in [child for child in parent if _local(child.tag) in ("metadata", "style")]:
            parent.remove(child)
    used = {found for node in root.iter() for value in node.attrib.values() for found in _references(value)}
    for node in root.iter():
        node.tag = _local(node.tag)
        node.attrib = {
            _local(key): _rewritten(_local(key), value, name)
            for key, value in node.attrib.items()
            if (key != "id" or value in used) and (key != "style" or node.tag != "image")
        }
        node.text = node.tail = None
    _, _, width, _ = (float(number) for number in root.attrib["viewBox"].split())
    view_box = root.attrib["viewBox"]
    pixels = round(width * _POINTS_TO_PIXELS * _ENLARGED)
    root.attrib = {"viewBox": view_box, "role": "img", "style": f"max-width: {pixels}px"}
    root.set("aria-label", label)
    return Html(ElementTree.tostring(root, encoding="unicode"))


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


def _references(value: str) -> list[str]:
    return [value[1:]] if value.startswith("#") else _REFERENCE.findall(value)


def _rewritten(key: str, value: str, name: str) -> str:
    match key:
        case "id":
            return f"{name}-{value}"
        case "href" if value.startswith(_IMAGE):
            return "".join(value.split())
        case "href":
            return f"#{name}-{value.removeprefix('#')}"
        case "d" | "transform" | "x" | "y" | "points":
            # a hundredth of a point; outlines of letters are drawn in units of their own, far smaller
            return _MOST_DECIMALS.sub(r"\1", " ".join(value.split())) if key != "transform" else value
        case _:
            coloured = _COLOUR.sub(lambda found: COLOURS.get(found[0].lower(), found[0]), value)
            return _REFERENCE.sub(lambda found: f"url(#{name}-{found[1]})", coloured)
