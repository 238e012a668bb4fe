"""Measured extents of the text of a figure."""

import itertools

from matplotlib.figure import Figure
from matplotlib.text import Text


def drawn_texts(figure: Figure) -> list[Text]:
    """Every text that ends on the page: not hidden, not empty, no tick outside its axis."""
    outside: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                hidden = not (low - slack <= tick.get_loc() <= high + slack)
                outside |= {id(label) for label in (tick.label1, tick.label2) if hidden or not label.get_visible()}
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and id(text) not in outside
    ]


def overlaps(figure: Figure) -> list[tuple[str, str]]:
    renderer = figure.canvas.get_renderer()
    with renderer._draw_disabled():  # all of it is put in its place, and nothing is painted
        Figure.draw(figure, renderer)
    boxes = [(text, text.get_window_extent()) for text in drawn_texts(figure)]
    return [
        (one.get_text(), other.get_text())
        for (one, box), (other, beside) in itertools.combinations(boxes, 2)
        # turned labels are parallel, so that only their boxes overlap
        if box.overlaps(beside) and (one.get_rotation() % 90 == 0 or one.get_rotation() != other.get_rotation())
    ]


def small_or_cut(figure: Figure) -> list[str]:
    """Texts below 7 pt, or not wholly on the page."""
    page = figure.bbox
    boxes = [(text, text.get_window_extent()) for text in drawn_texts(figure)]
    return [
        text.get_text()
        for text, box in boxes
        if text.get_fontsize() < 7
        or not (page.x0 <= box.x0 <= box.x1 <= page.x1 and page.y0 <= box.y0 <= box.y1 <= page.y1)
    ]
