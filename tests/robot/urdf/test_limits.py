"""The limits that the documentation states are those of the code."""

from __future__ import annotations

from pathlib import Path

import pytest

from precision_pin.base.text_escape import LONGEST_LINE
from precision_pin.pages.view.meshes import MOST_FACES
from precision_pin.robot.urdf import Limits
from precision_pin.robot.urdf.findings import MOST_FINDINGS
from precision_pin.robot.urdf.meshes import MOST_BYTES, MOST_TEXT_BYTES
from precision_pin.robot.urdf.meshscenes import MOST_DEPTH, MOST_TRIANGLES
from precision_pin.robot.urdf.xmltree import ENCODINGS

ROOT = Path(__file__).parents[3]
LIMITS = Limits()


@pytest.mark.parametrize(
    ("page", "stated"),
    [
        ("docs/urdf.md", f"| file | {LIMITS.file_bytes >> 20} MiB |"),
        ("docs/urdf.md", f"| a name or attribute | {LIMITS.text_length:,} characters |"),
        ("docs/urdf.md", f"| depth of elements | {LIMITS.xml_depth} |"),
        ("docs/urdf.md", f"| elements and attributes | {LIMITS.elements:,} |"),
        ("docs/urdf.md", f"| moving joints | {LIMITS.moving_joints} |"),
        ("docs/urdf.md", f"| links in a row, from root to tip | {LIMITS.links_in_depth} |"),
        ("docs/urdf.md", f"| {MOST_BYTES >> 20} MiB each, as text {MOST_TEXT_BYTES >> 20} MiB |"),
        ("docs/urdf.md", f"every instance counted | {MOST_TRIANGLES:,} |"),
        ("docs/urdf.md", f"holds {MOST_FACES:,} triangles"),
        ("SECURITY.md", f"{LIMITS.file_bytes >> 20} MiB; {LIMITS.xml_depth} levels; {LIMITS.elements:,} elements"),
        ("SECURITY.md", f"{LIMITS.text_length:,} characters a name or attribute; {LIMITS.moving_joints} moving joints"),
        ("SECURITY.md", f"{LIMITS.links_in_depth} links in a row"),
        (
            "SECURITY.md",
            f"{MOST_BYTES >> 20} MiB a file, {MOST_TEXT_BYTES >> 20} MiB as text; {MOST_TRIANGLES:,} triangles",
        ),
        ("SECURITY.md", f"every instance counted; {MOST_DEPTH} levels |"),
        ("SECURITY.md", f"| {MOST_FACES:,} triangles, 200 poses, 100,000 samples |"),
        ("SECURITY.md", f"cut to {LONGEST_LINE:,} characters and {MOST_FINDINGS:,} of a kind"),
    ],
)
def test_limits_of_the_pages_are_those_of_the_code(page, stated):
    assert stated in " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_every_encoding_is_listed():
    page = (ROOT / "docs" / "urdf.md").read_text(encoding="utf-8").lower()
    for name in ("utf-8", "utf-16", "iso-8859-1", "iso-8859-15", "windows-1252", "us-ascii"):
        assert name in ENCODINGS
        assert name in page
