"""Execute the tutorial notebook and write it back with its outputs.

    python docs/execute_notebook.py [NOTEBOOK]

Nothing is kept that changes from one execution to the next: no times, no versions of the kernel.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

TUTORIAL = Path(__file__).parent / "tutorial.ipynb"


def executed(path: Path) -> NotebookNode:
    """Return a notebook as a clean kernel leaves it."""
    notebook = nbformat.read(path, as_version=4)
    # in the notebook's folder, as a reader would; times are not recorded
    client = NotebookClient(notebook, timeout=300, record_timing=False, resources={"metadata": {"path": path.parent}})
    client.execute()
    notebook.metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return notebook


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else TUTORIAL
    nbformat.write(executed(target), target)
