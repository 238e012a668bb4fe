"""Arms and readers for the tests of the 3-D page."""

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import umsgpack

from precision_pin.base import se3
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.pages.view import ViewPose, page
from precision_pin.robot.chain import Chain
from precision_pin.sources import Source


def arm_text(visuals: Sequence[str] = ("", "", ""), name: str = "two links") -> str:
    """Return a URDF: base, a joint about z 0.2 m up, upper link of 0.5 m, a joint about y, forearm of 0.3 m to tool."""
    base, upper, fore = visuals
    return f"""<?xml version="1.0"?>
<robot name="{name}">
  <link name="base">{base}</link>
  <link name="upper">{upper}</link>
  <link name="fore">{fore}</link>
  <link name="tool"/>
  <joint name="turn" type="revolute">
    <origin xyz="0 0 0.2"/><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="bend" type="revolute">
    <origin xyz="0.5 0 0" rpy="0.3 0 0"/><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed"><origin xyz="0.3 0 0"/><parent link="fore"/><child link="tool"/></joint>
</robot>
"""


def arm_model(folder: Path, text: str, *sources: Source) -> ErrorModel:
    path = folder / "arm.urdf"
    path.write_text(text, "utf-8")
    return ErrorModel(Chain.from_urdf(path, tip="tool"), Space(), sources, {"p": [0.4, -0.7], "q": [-0.4, 0.9]})


def pose_model(folder: Path, text: str, *sources: Source) -> PoseModel:
    return arm_model(folder, text, *sources).at("p")


def made_up_errors(count: int, seed: int = 0, size: float = 1e-4) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(6, count)) * size


def simple_page(model: PoseModel, errors: np.ndarray | None = None, name: str | None = None, **settings: object) -> str:
    values = made_up_errors(50) if errors is None else errors
    return pages([ViewPose(model, values, name)], **settings)


def pages(shown: Sequence[ViewPose], **settings: object) -> str:
    return page(shown, **{"title": "a test", "seed": 1, "model_name": "exact", **settings})  # type: ignore[arg-type]


def page_at(model: ErrorModel, pose: str = "paper", **settings: object) -> str:
    """Return the page of 40 samples of a model at a named pose."""
    at = model.at(pose)
    return pages([ViewPose(at, at.exact(at.space.sample(0, 0, 40)), pose)], **settings)


def floats(text: str) -> np.ndarray:
    """Return numbers that a page packs as base64 of float32."""
    return np.frombuffer(base64.b64decode(text), "<f4").astype(float)


def matrix(numbers: Sequence[float]) -> np.ndarray:
    """Return a matrix that a page keeps by columns, as three.js does."""
    return np.array(numbers, dtype=float).reshape(4, 4).T


def enlarged(displacement: np.ndarray, factor: float) -> np.ndarray:
    """Return ``(4, 4)`` of a displacement ``[d; δ]`` times the factor, turned by 90° at most."""
    angle = factor * np.linalg.norm(displacement[3:])
    turn = factor * displacement[3:] * min(1.0, np.pi / 2 / angle if angle else 1.0)
    return se3.displacement(np.concatenate([factor * displacement[:3], turn]))


def composed(frames: Sequence[np.ndarray], displacements: np.ndarray, factor: float) -> list[np.ndarray]:
    """Return how the first 0, 1, … of the targets together move what lies beyond them, ``(4, 4)`` in the base."""
    motions = [np.eye(4)]
    for frame, moved in zip(frames, displacements, strict=True):
        motions.append(motions[-1] @ frame @ enlarged(moved, factor) @ np.linalg.inv(frame))
    return motions


def likeness(
    settings: dict, number: int, displacements: np.ndarray, factor: float
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the poses of the arm's parts by name, and of the tip, as a page's script is to put them."""
    pose = settings["poses"][number]
    motions = composed([matrix(numbers) for numbers in floats(pose["targets"]).reshape(-1, 16)], displacements, factor)
    parts = {
        part["name"]: motions[before] @ matrix(pose["links"][part["link"]]) @ matrix(part["frame"])
        for part, before in zip(settings["parts"], pose["before"], strict=True)
    }
    return parts, motions[-1] @ matrix(pose["tip"])


@dataclass
class Node:
    """What the commands put at one path: an object as three.js has it, and a local transform."""

    object: dict | None = None
    transform: np.ndarray | None = None
    properties: dict | None = None


def data_block(text: str, name: str) -> object:
    return json.loads(re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', text, re.DOTALL)[1])


def commands_of(text: str) -> list[dict]:
    return [umsgpack.unpackb(base64.b64decode(packed)) for packed in data_block(text, "scene")]


def nodes_of(text: str) -> dict[str, Node]:
    nodes: dict[str, Node] = {}
    for command in commands_of(text):
        node = nodes.setdefault(command["path"], Node())
        if command["type"] == "set_object":
            node.object = command["object"]
        elif command["type"] == "set_transform":
            node.transform = np.array(command["matrix"]).reshape(4, 4).T
        else:
            node.properties = {command["property"]: command["value"]}
    return nodes


def opened(context: Any, folder: Path, text: str, fragment: str = "") -> Any:
    """Open a page in a browser, with all of its panel, and return the visit."""
    from support.browser import visited  # importing Playwright takes its time

    path = folder / "page.html"
    path.write_text(text, "utf-8")
    visit = visited(context, path.as_uri() + fragment)
    visit.page.wait_for_selector("body[data-ready=yes]", state="attached")
    visit.page.evaluate("document.getElementById('more').open = true")
    return visit
