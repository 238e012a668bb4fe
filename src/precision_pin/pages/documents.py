"""The 3-D view and the report of a model in Python: shown in a notebook, written to a file."""

from __future__ import annotations

import os
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from precision_pin.analyses.collect import collect_poses
from precision_pin.analyses.provenance import Pose, Poses, listed_poses
from precision_pin.base.arguments import check_choice, check_flag, check_instance, check_path, check_whole
from precision_pin.base.errors import InputError
from precision_pin.base.files import write_text
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages import view as pages_of_view
from precision_pin.pages.report.page import page as report_page
from precision_pin.render.html import escaped
from precision_pin.sampling import check_samples
from precision_pin.statistics.plan import Specifications, listed_specifications

_HEIGHT = 640
"""Height of the frame in a notebook, CSS pixels: the settings of the view beside its picture on a laptop's screen."""


@dataclass(frozen=True)
class Page:
    """A self-contained HTML page, which needs no network. A notebook shows it in a frame.

    Attributes:
        text: The HTML.

    Examples:
        >>> page = pp.Page("<!DOCTYPE html><title>empty</title>")
        >>> page.save("empty.html")
    """

    text: str = field(repr=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page; its name ends in ``.html``."""
        name = os.fspath(check_path("the path of the page", path))
        if Path(name).suffix.lower() not in (".html", ".htm"):
            raise InputError(f"{name} is no name of an HTML page; it ends in .html")
        write_text(Path(name), self.text)

    def _repr_html_(self) -> str:
        frame = f'srcdoc="{escaped(self.text)}" sandbox="allow-scripts" width="100%" height="{_HEIGHT}"'
        return f'<iframe {frame} style="border: 0"></iframe>'


def view(
    error_model: ErrorModel,
    /,
    poses: Poses = None,
    *,
    samples: int = pages_of_view.DEFAULT_POINTS,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
) -> Page:
    """Return the arm and its sampled errors in 3-D, as ``precision-pin view`` does.

    Args:
        error_model: The arm and its errors.
        poses: A pose or a list of poses, each a name or joint values; by default the model's first.
        samples: Number of robots at each pose.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors.
        specifications: Limits; the page says whether the robots it shows keep them.

    Raises:
        InputError: A wrong pose or number.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> page = pp.view(model, samples=100)
        >>> page.save("view.html")
    """
    check_instance("the error model", error_model, ErrorModel, "as ErrorModel.load returns it")
    check_whole("the number of samples", samples, 1, pages_of_view.MOST_POINTS)
    check_seed(seed)
    check_choice("model", model, ("exact", "linear"))
    named_poses = [(pose, error_model.pose_name(pose)) for pose in listed_poses(poses)]
    limits = listed_specifications(specifications)
    view_poses, _ = pages_of_view.sample_views(
        error_model, named_poses, samples=samples, seed=seed, model=model, specifications=limits
    )
    return Page(
        pages_of_view.page(
            view_poses,
            seed=seed,
            model_name=model,
            points=samples,
            specifications=limits,
            remarks=pages_of_view.remarks_on(error_model, view_poses),
        )
    )


def report(
    error_model: ErrorModel,
    /,
    poses: Poses = None,
    *,
    samples: int = 100_000,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    specifications: Specifications = (),
    is_full: bool = False,
) -> Page:
    """Return the report of a model at one or several poses, as ``precision-pin report`` does.

    Args:
        error_model: A model that was read from a sheet.
        poses: A pose or a list of poses, each a name or joint values; by default the model's first.
        samples, seed, model, specifications: As for :func:`precision_pin.view`.
        is_full: Open all sections.

    Raises:
        InputError: A model without a sheet; a wrong pose or number.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> page = pp.report(model, samples=1000, specifications="25 mm @ 95 %")
        >>> print("Verdict" in page.text)
        True
    """
    check_instance("the error model", error_model, ErrorModel, "as ErrorModel.load returns it")
    sheet = error_model.sheet
    if sheet is None:
        raise InputError("a report names the sheet, and this model was made without one; ErrorModel.load reads one")
    check_samples(samples)
    check_seed(seed)
    check_choice("model", model, ("exact", "linear"))
    check_flag("is_full", is_full)
    sheet = replace(sheet, beyond_limits=error_model.beyond_limits)
    pose_list: list[Pose] = listed_poses(poses)
    results = collect_poses(
        sheet, pose_list, samples=samples, seed=seed, model=model, specifications=listed_specifications(specifications),
        command=["pp.report(model)"], package_dirs=(), step=lambda *_: nullcontext(lambda _: None),
    )  # fmt: skip
    return Page(report_page(results, full=is_full))
