"""The drawings of ``sources.md`` and ``model.md``: what the settings of a source measure, with the geometry of its formula."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import cos, exp, pi, radians, sin, sqrt
from typing import Final

from docs.drawings.canvas import Canvas


def axis_install() -> str:
    """Return the drawing of an axis that runs through A and B."""
    view = Canvas("A joint's real axis runs through A and B; start and span are measured along the nominal axis", 400)
    x, origin, low, high = 230.0, 330.0, 250.0, 90.0  # start and span along the axis
    a, b = (x - 34, low + 6), (x + 44, high - 5)
    slope = (b[0] - a[0]) / (b[1] - a[1])

    def on_axis(y: float) -> tuple[float, float]:
        return a[0] + slope * (y - a[1]), y

    view.line(x, 375, x, 28, "grey dashed")
    view.text(x - 8, 24, "nominal axis, z", "grey", "end")
    for y, name in ((low, "z = start"), (high, "z = start + span")):
        view.ellipse(x, y, 76, 22, "blue fill-blue soft")
        view.text(x + 90, y + 5, f"plane {name}", "grey small")
    view.line(x, low, x + 76, low, "blue")
    view.text(x + 18, low - 4, "radius", "blue small")
    view.line(*on_axis(372), *on_axis(30), "red thick")
    view.text(on_axis(30)[0] + 10, 34, "real axis", "red")
    for (px, py), name, shift, anchor in ((a, "A", -12, "end"), (b, "B", 12, "start")):
        view.dot(px, py, "fill-red", 6)
        view.text(px + shift, py - 8, name, "bold", anchor)
    seat = on_axis(origin)
    view.arrow(x, origin, *seat, "green", "thick")
    view.text((x + seat[0]) / 2, origin - 9, "d", "green bold", "middle")
    view.dot(x, origin, "fill-ink", 5)
    view.text(x + 12, origin + 6, "origin of the joint in the URDF")
    view.dimension(110, origin, 110, low, "start", (56, (origin + low) / 2 + 5))
    view.dimension(110, low, 110, high, "span", (60, (low + high) / 2 + 5))
    view.line(100, low, x - 80, low, "grey thin")
    view.line(100, high, x - 80, high, "grey thin")
    view.line(100, origin, x - 72, origin, "grey thin")
    view.text(345, 168, "the seat turns by", "small red")
    view.text(345, 190, "δ = (−AE_y, AE_x, 0)/span", "small red")
    view.text(x + 60, 366, "and moves by d = A − AE·start/span", "small green")
    view.text(345, 212, "AE = B − A, in x and y", "small grey")
    return view.finish()


def clearance() -> str:
    """Return the drawing of two journals in their bores: one above the other, and a bore from above."""
    view = Canvas(
        "Two bearings with play: the load presses each journal to a side of its bore, by half the clearance", 360
    )
    x, low, high, play = 160.0, 270.0, 120.0, 16.0
    view.line(x, 345, x, 40, "grey dashed")
    tilt = 2 * play / (low - high)

    def middle(y: float) -> float:
        return x + play - tilt * (y - high)

    shaft = [(middle(70) - 20, 70), (middle(70) + 20, 70), (middle(322) + 20, 322), (middle(322) - 20, 322)]
    view.path(shaft, "red fill-red soft", closed=True)
    for y in (low, high):
        for left in (x - 40 - play - 26, x + 40 + play):
            view.box(left, y - 20, 26, 40, "ink fill-grey")
        view.box(middle(y) - 40, y - 15, 80, 30, "red fill-red soft")
    view.line(middle(40), 40, middle(345), 345, "red thick")
    view.text(middle(40) + 8, 34, "real axis", "red", "middle")
    view.arrow(x - 70, 76, x - 4, 76, "blue", "thick")
    view.text(x - 78, 81, "P_B", "blue bold", "end")
    view.arrow(x + 70, 314, x + 4, 314, "blue", "thick")
    view.text(x + 78, 319, "P_A", "blue bold")
    view.text(x + 88, low + 6, "A", "bold")
    view.text(x + 88, high + 6, "B", "bold")
    view.dimension(48, low, 48, high, "span", (6, (low + high) / 2 + 5))
    cx, cy, bore, journal = 410.0, 170.0, 84.0, 60.0
    view.ellipse(cx, cy, bore, bore, "ink fill-grey soft")
    view.ellipse(cx + bore - journal, cy, journal, journal, "red fill-red soft")
    view.line(cx, cy - bore - 10, cx, cy + bore + 10, "grey dashed")
    view.arrow(cx - 130, cy, cx - bore - 6, cy, "blue", "thick")
    view.text(cx - 112, cy - 10, "load", "blue small", "middle")
    view.dot(cx, cy, "fill-ink", 4)
    view.dot(cx + bore - journal, cy, "fill-red", 5)
    view.dimension(cx - bore, cy + 112, cx - bore + 2 * (bore - journal), cy + 112, "diametral", (cx - 20, cy + 117))
    view.line(cx - bore, cy + 30, cx - bore, cy + 120, "grey thin")
    view.line(cx - bore + 2 * (bore - journal), cy + 30, cx - bore + 2 * (bore - journal), cy + 120, "grey thin")
    view.text(cx, 30, "one bearing, along the axis", "", "middle")
    view.text(cx, 52, "the journal lies off centre", "small", "middle")
    view.text(cx, 70, "by diametral/2", "small", "middle")
    view.text(cx, 318, "direction: load — as shown", "small", "middle")
    view.text(cx, 340, "direction: random — any side", "small", "middle")
    return view.finish()


def beam() -> str:
    """Return the drawing of a link as a cantilever with its loads."""
    view = Canvas(
        "A link as a cantilever of length l: loads F and M at its end, q along it, deflection w and slope θ", 350
    )
    x, y, length, drop = 90.0, 130.0, 300.0, 84.0

    def bent(along: float) -> tuple[float, float]:
        share = along / length
        return x + along, y + drop * (3 * share**2 - share**3) / 2

    view.box(x - 26, y - 46, 26, 92)
    view.line(x, y, x + length + 124, y, "grey dashed")
    view.tip(x + length + 130, y, 0, "grey")
    view.text(x + length + 118, y - 12, "x", "grey")
    upper = [bent(length * k / 40) for k in range(41)]
    view.path(
        [(px, py - 11) for px, py in upper] + [(px, py + 11) for px, py in reversed(upper)],
        "blue fill-blue soft",
        closed=True,
    )
    view.path(upper, "blue dashed")
    end = bent(length)
    for k in range(1, 9):
        px, py = bent(length * k / 9)
        view.arrow(px, py - 50, px, py - 16, "amber")
    view.path([(px, py - 50) for px, py in upper[4:37]], "amber")
    view.text(x + 150, y - 46, "q, its own weight", "amber")
    view.arrow(end[0], end[1] + 14, end[0], end[1] + 76, "red", "thick")
    view.text(end[0] + 10, end[1] + 72, "F", "red bold")
    view.arc(end[0], end[1], 34, -0.9, 1.1, "red")
    view.text(end[0] + 30, end[1] - 26, "M", "red bold")
    view.dot(*end, "fill-red", 5)
    view.dimension(end[0] + 112, y, end[0] + 112, end[1], "w", (end[0] + 120, (y + end[1]) / 2 + 5))
    view.line(*end, end[0] + 88, end[1] + 88 * 1.5 * drop / length, "green")
    view.line(end[0], end[1], end[0] + 118, end[1], "grey thin dotted")
    view.text(end[0] + 94, end[1] + 28, "θ", "green bold")
    view.dimension(x, 314, end[0], 314, "length l of the chain link", (x + 60, 336))
    view.line(x, y + 100, x, 322, "grey thin")
    view.line(end[0], end[1] + 80, end[0], 322, "grey thin")
    view.text(x - 70, y + 72, "joint's origin,")
    view.text(x - 70, y + 92, "clamped")
    view.text(x + 190, 30, "w = F l³/3EI + M l²/2EI + q l⁴/8EI", "", "middle")
    view.text(x + 190, 54, "θ = F l²/2EI + M l/EI + q l³/6EI", "", "middle")
    return view.finish()


def backlash() -> str:
    """Return the drawing of a tooth in its gap, and of the joint's deviation over the torque."""
    view = Canvas(
        "Backlash b: the load lays the tooth on one flank, b/2 off the middle; below the band it lies anywhere", 330
    )
    for x, place, words in ((95.0, 1.0, "τ > band"), (95.0, 0.0, "|τ| < band")):
        top = 70.0 if place else 205.0
        view.path(
            [(x - 70, top), (x - 46, top), (x - 40, top + 66), (x + 60, top + 66), (x + 66, top), (x + 90, top)],
            "ink thick",
        )
        middle = x + 10
        shift = 24.0 * place
        tooth = [(-22, -14), (22, -14), (16, 56), (-16, 56)]
        if not place:
            for side in (-22.0, 22.0):
                view.path([(middle + side + px, top + py) for px, py in tooth], "red thin dotted", closed=True)
        view.path([(middle + shift + px, top + py) for px, py in tooth], "red fill-red soft", closed=True)
        view.line(middle, top - 26, middle, top + 80, "grey dashed")
        if place:
            view.arrow(middle - 20, top - 36, middle + 44, top - 36, "blue", "thick")
            view.text(middle - 28, top - 30, "τ", "blue bold", "end")
        view.text(middle, top + 96, words, "", "middle")
    view.line(340, 270, 340, 60, "grey")
    view.tip(340, 56, -pi / 2, "grey")
    view.line(230, 165, 540, 165, "grey")
    view.tip(546, 165, 0, "grey")
    view.text(348, 62, "Δθ", "grey")
    view.text(532, 186, "τ", "grey")
    view.line(236, 225, 296, 225, "red thick")
    view.line(384, 105, 520, 105, "red thick")
    view.box(296, 105, 88, 120, "red fill-red soft")
    view.line(334, 105, 384, 105, "grey thin dotted")
    view.line(296, 225, 348, 225, "grey thin dotted")
    view.text(328, 101, "b/2", "", "end")
    view.text(348, 244, "−b/2")
    view.text(388, 186, "band")
    view.text(292, 157, "−band", "", "end")
    view.line(384, 160, 384, 170, "ink")
    view.line(296, 160, 296, 170, "ink")
    view.text(400, 268, "within the band:", "small red")
    view.text(400, 288, "anywhere in the gap,", "small red")
    view.text(400, 308, "uniform", "small red")
    return view.finish()


def encoder() -> str:
    """Return the drawing of an eccentric disc, and of the errors of its reading over a turn."""
    view = Canvas(
        "An encoder's disc that sits off its shaft reads wrong once a turn; its steps add ± half a resolution", 330
    )
    x, y, radius, off = 125.0, 165.0, 90.0, 22.0
    view.ellipse(x, y, radius, radius, "blue fill-blue soft")
    for k in range(36):
        c, s = cos(pi * k / 18), sin(pi * k / 18)
        view.line(x + 74 * c, y + 74 * s, x + 86 * c, y + 74 * s + 12 * s, "blue thin")
    view.dot(x, y, "fill-blue", 4)
    view.dot(x + off, y, "fill-red", 5)
    view.line(x, y - 8, x, y - 112, "grey thin")
    view.line(x + off, y - 10, x + off, y - 112, "grey thin")
    view.arrow(x - 24, y - 106, x, y - 106, "grey", "thin")
    view.arrow(x + off + 24, y - 106, x + off, y - 106, "grey", "thin")
    view.text(x + 11, y - 122, "eccentricity", "small", "middle")
    view.arrow(x, y, x - radius * cos(radians(40)) + 4, y + radius * sin(radians(40)) - 4, "blue")
    view.text(x - 58, y + 22, "radius", "blue small")
    view.arc(x + off, y, 30, -0.1, 1.5, "red")
    view.text(x + off + 14, y + 46, "θ", "red bold")
    view.box(x + radius + 4, y - 10, 24, 20)
    view.text(x + radius + 16, y - 18, "head", "small", "middle")
    left, base, turn, height = 300.0, 165.0, 220.0, 62.0
    view.line(left, 270, left, 50, "grey")
    view.tip(left, 46, -pi / 2, "grey")
    view.line(left, base, 540, base, "grey")
    view.tip(546, base, 0, "grey")
    view.text(left + 8, 54, "error of the joint", "grey")
    view.text(524, base + 22, "θ", "grey")

    def wave(share: float) -> float:
        return base - height * sin(2 * pi * share + 0.6)

    view.path([(left + turn * k / 60, wave(k / 60)) for k in range(61)], "blue thick")
    steps: list[tuple[float, float]] = []
    for k in range(20):
        steps += [
            (left + turn * k / 20, wave((k + 0.5) / 20) + 12),
            (left + turn * (k + 1) / 20, wave((k + 0.5) / 20) - 12),
        ]
    view.path(steps, "red thin")
    peak = left + turn * (pi / 2 - 0.6) / (2 * pi)
    view.dimension(peak, base, peak, base - height, "", (0.0, 0.0))
    view.text(peak + 22, 92, "amplitude", "small")
    view.line(left + turn, 72, left + turn, base + 10, "grey thin dotted")
    view.text(left + turn + 20, 66, "one turn", "small", "end")
    view.text(left - 4, 288, "blue: amplitude · sin(order · θ + φ),", "small blue")
    view.text(left - 4, 308, "φ random, kept by a robot", "small blue")
    view.text(20, 288, "red: reading in steps,", "small red")
    view.text(20, 308, "uniform, ± resolution/2", "small red")
    return view.finish()


UNIT_VALUES: Final = (8.0, -14.0)
POSE_VALUES: Final = ((-10.0, 12.0), (15.0, -6.0))
VISIT_VALUES: Final = (((-4.0, 13.0, 5.0), (-15.0, 2.0, 9.0)), ((11.0, -12.0, 1.0), (6.0, 14.0, -8.0)))
"""Numbers as they may be drawn, in pixels: by robot, by pose, by visit."""


def scopes() -> str:
    """Return the drawing of one random number with each of the three scopes."""
    view = Canvas(
        "What scope means: unit, one number for a robot; pose, one for each pose; visit, one for each visit", 330
    )
    left, wide = 110.0, 34.0
    rows: Sequence[tuple[str, str, Callable[[int, int, int], float]]] = (
        ("unit", "blue", lambda unit, pose, visit: UNIT_VALUES[unit]),
        ("pose", "green", lambda unit, pose, visit: POSE_VALUES[unit][pose]),
        ("visit", "red", lambda unit, pose, visit: VISIT_VALUES[unit][pose][visit]),
    )
    for unit in range(2):
        start = left + unit * (6 * wide + 20)
        view.text(start + 3 * wide, 28, f"robot {unit}", "bold", "middle")
        for pose in range(2):
            view.text(start + (3 * pose + 1.5) * wide, 54, f"pose {'AB'[pose]}", "", "middle")
            for visit in range(3):
                view.text(start + (3 * pose + visit + 0.5) * wide, 76, str(visit + 1), "small grey", "middle")
    view.text(94, 76, "visit", "small grey", "end")
    for place, (name, colour, value) in enumerate(rows):
        y = 122 + 72 * place
        view.text(94, y - 2, name, f"{colour} bold", "end")
        view.text(94, y + 16, ("a part", "a pose", "a load")[place], "small grey", "end")
        for unit in range(2):
            start = left + unit * (6 * wide + 20)
            view.line(start, y, start + 6 * wide, y, "grey thin dotted")
            view.line(start + 3 * wide, y - 26, start + 3 * wide, y + 26, "grey thin dotted")
            points = [
                (start + (3 * pose + visit + 0.5) * wide, y - value(unit, pose, visit))
                for pose in range(2)
                for visit in range(3)
            ]
            same = {0: [points], 1: [points[:3], points[3:]], 2: []}[place]
            for group in same:
                view.line(*group[0], *group[-1], colour)
            for point in points:
                view.dot(*point, f"fill-{colour}", 5)
    view.text(280, 318, "height: the deviation of one random number", "small grey", "middle")
    return view.finish()


def places() -> str:
    """Return the drawing of an arm with seats, ends and frames."""
    view = Canvas("The places of a chain: each joint's seat, each link's end, frames on the way, the tip", 330)
    joints = ((120.0, 230.0), (200.0, 110.0), (370.0, 110.0))
    tip = (470.0, 205.0)
    view.line(60, 282, 180, 282, "ink thick")
    for k in range(8):
        view.line(64 + 15 * k, 294, 74 + 15 * k, 282, "grey thin")
    way = [(120.0, 282.0), *joints, tip]
    for start, end in pairwise(way):
        view.line(*start, *end, "grey thick")
    for number, (x, y) in enumerate(joints, 1):
        view.ellipse(x, y, 17, 17, "ink fill-paper")
        view.text(x, y + 6, str(number), "bold", "middle")
    # a link's end and the next joint's seat share a frame: the end first, then the seat
    for x, y, towards in ((120, 252, (0, 1)), (187, 130, (-0.6, 0.8)), (348, 110, (-1, 0))):
        view.dot(x + 12 * towards[0], y + 12 * towards[1], "fill-blue", 6)
        view.dot(x, y, "fill-red", 6)
    view.dot(*tip, "fill-blue", 7)
    view.path([(284, 98), (284, 122)], "green thick")
    view.dot(284, 110, "fill-green", 6)
    view.text(28, 300 - 46, "link 0", "grey")
    view.text(92, 176, "link 1", "grey")
    view.text(222, 98, "link 2", "grey")
    view.text(432, 154, "link 3", "grey")
    view.text(470, 232, "end of link 3 = tip", "blue small", "middle")
    view.text(300, 142, "frame", "green small", "middle")
    view.text(300, 160, "on the way", "green small", "middle")
    view.text(396, 98, "joint 3", "")
    view.text(20, 34, "A place is where a small displacement", "small")
    view.text(20, 54, "Trans(d)·Exp(δ) is put into the chain", "small")
    view.dot(250, 256, "fill-blue", 6)
    view.text(264, 261, "end of a link: length, beam, thermal", "small")
    view.dot(250, 282, "fill-red", 6)
    view.text(264, 287, "seat of the next joint: axis_install, …", "small")
    view.ellipse(250, 308, 7, 7, "ink fill-paper")
    view.text(264, 313, "the joint's value: joint_offset, backlash", "small")
    return view.finish()


def laws() -> str:
    """Return the drawing of the densities of the laws of one number, with the half-width that a sheet gives."""
    view = Canvas("Densities of the laws of a sheet: what the half-width t of each one means", 330)

    def uniform(u: float) -> float:
        return 0.5 if abs(u) <= 1 else 0.0

    def normal(u: float) -> float:
        return 3 / sqrt(2 * pi) * exp(-((3 * u) ** 2) / 2)

    def triangular(u: float) -> float:
        return max(0.0, 1 - abs(u))

    def arcsine(u: float) -> float:
        return 1 / (pi * sqrt(1 - u * u)) if abs(u) < 1 else 0.0

    shapes: Sequence[tuple[str, str, Callable[[float], float] | None]] = (
        ("uniform: t", "σ = t/√3", uniform),
        ("normal: t", "σ = t/3, unbounded", normal),
        ("triangular: t", "σ = t/√6", triangular),
        ("arcsine: t", "σ = t/√2", arcsine),
        ("two_point: t", "σ = t", None),
        ("disc: t", "two numbers, in the disc", None),
    )
    for place, (name, spread, density) in enumerate(shapes):
        x, y = 100.0 + 180 * (place % 3), 118.0 + 160 * (place // 3)
        view.text(x, y - 88, name, "bold", "middle")
        view.text(x, y + 40, spread, "small", "middle")
        if name.startswith("disc"):
            view.ellipse(x, y - 34, 36, 36, "blue fill-blue soft")
            view.line(x, y - 34, x + 36, y - 34, "grey")
            view.text(x + 18, y - 38, "t", "grey small", "middle")
            view.dot(x, y - 34, "fill-ink", 3)
            continue
        view.line(x - 78, y, x + 78, y, "grey")
        if density is None:
            for side in (-52.0, 52.0):
                view.line(x + side, y, x + side, y - 60, "blue thick")
        else:
            steps = [k / 40 for k in range(-58, 59)]
            curve = [(x + 52 * u, y - min(66.0, 52 * density(u))) for u in steps]
            view.path([(x - 75.4, y), *curve, (x + 75.4, y)], "blue fill-blue soft", closed=True)
        for side, mark in ((-52.0, "−t"), (52.0, "+t")):
            view.line(x + side, y, x + side, y + 6, "ink")
            view.text(x + side, y + 20, mark, "small grey", "middle")
        view.text(x, y + 20, "mean", "small grey", "middle")
    return view.finish()


DRAWINGS: Final[dict[str, Callable[[], str]]] = {
    "axis_install.svg": axis_install,
    "clearance.svg": clearance,
    "beam.svg": beam,
    "backlash.svg": backlash,
    "encoder.svg": encoder,
    "scopes.svg": scopes,
    "places.svg": places,
    "laws.svg": laws,
}
"""Every drawing by the name of its file."""


def draw_all() -> dict[str, str]:
    """Return the drawings by the names of their files."""
    return {name: draw() for name, draw in DRAWINGS.items()}
