"""Report section: instructions for reproducing the report."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Sequence

from precision_pin.analyses.collect import Results
from precision_pin.base.versions import versions
from precision_pin.render.html import Child, Html, definitions, element, joined, paragraph, section, table

_DRAWN_WITH = ("matplotlib", "meshcat")


def reproduction(poses: Sequence[Results]) -> Html:
    """Return command line, seed, versions, platform and the files' SHA-256."""
    results = poses[0]
    command = element("pre", element("code", shlex.join(results.command)), tabindex="0", aria_label="Command line")
    known = versions(*_DRAWN_WITH)
    entries: list[tuple[str, Child]] = [
        ("Seed", str(results.analysis.seed)),
        ("Samples", f"{results.analysis.samples:,}"),
        ("Versions", ", ".join(f"{name} {version}" for name, version in known.items())),
        ("Platform", f"{platform.system()} {platform.machine()}"),
    ]
    files = table(
        "Files that were read",
        ["file", "SHA-256"],
        [[name, element("code", digest, class_="digest")] for name, digest in results.digests],
        words=(1,),
    )
    note = "Files are named without their folders. The same files, command and versions give the same page."
    return section(
        "reproduce",
        "How to reproduce this",
        joined([command, definitions(entries), files, paragraph(note, class_="note")]),
    )
