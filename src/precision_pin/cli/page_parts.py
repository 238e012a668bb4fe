"""Parts of the report and the view beside the poses: their options, inputs and results, as the analyses declare them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from precision_pin.analyses.declaration import Asked, Declaration, Job, PagePart
from precision_pin.analyses.registry import declarations, fitting_specs
from precision_pin.cli import options as shared
from precision_pin.cli.analyses import echo_new_warnings, make_option
from precision_pin.cli.options import progress_bar
from precision_pin.cli.poses import columns_of, read_grid, read_path

if TYPE_CHECKING:
    from precision_pin.model.error_model import ErrorModel
    from precision_pin.render.scene import Chapter, Layer
    from precision_pin.sheet import Sheet


def _declared(layers: bool) -> list[tuple[Declaration, PagePart]]:
    """Return the parts in the order of the chapters, or those with a layer."""
    parts = [(declaration, declaration.part) for declaration in declarations().values() if declaration.part is not None]
    return sorted((pair for pair in parts if pair[1].layer or not layers), key=lambda pair: pair[1].place)


def part_options(*, layers: bool = False) -> shared.Decorator:
    """Return the options of all parts, or of those with a layer."""
    return shared.together(*(make_option(part.option) for _, part in _declared(layers)))


def part_files(options: shared.Options) -> list[str]:
    """Return the files that the options of parts name, which no output may overwrite."""
    files = (options.get(part.option.argument) for _, part in _declared(layers=False) if part.option.kind is Path)
    return [file for file in files if file is not None]


@dataclass(frozen=True)
class Part:
    """A part that the command line asks for, with what it runs."""

    declaration: Declaration
    of_page: PagePart
    job: Job

    @property
    def name(self) -> str:
        """Title in the list of steps."""
        title = self.declaration.title
        return title if title.isupper() else title.lower()

    def run(self) -> Any:
        """Return the result with progress; print its warnings."""
        job = self.job
        with progress_bar(job.steps or 0, self.of_page.what or job.what, job.unit) as progress:
            result = job.run() if job.steps is None else job.run(progress=progress)
        echo_new_warnings(job, result)
        return result

    def chapter(self, result: Any) -> Chapter:
        """Return the chapter of a result."""
        chapter: Chapter = self.declaration.output(self.of_page.chapter)(result)
        return chapter

    def layers(self, result: Any, model: ErrorModel) -> list[Layer]:
        """Return the layer of a result, if the part has one."""
        return [self.declaration.output(self.of_page.layer).of(result, model)] if self.of_page.layer else []

    def headline(self, result: Any) -> tuple[str, ...]:
        """Return the answer above that of the page and the name of the page's, if the part has one."""
        return self.declaration.output(self.of_page.headline)(result) if self.of_page.headline else ()

    def missed(self, result: Any) -> list[str]:
        """Return where a specification is not met."""
        return [self.of_page.missed] if self.of_page.missed and not result.met else []


def read_parts(
    sheet: Sheet, options: shared.Options, poses: Sequence[Any] = (), *, layers: bool = False, **settings: Any
) -> list[Part]:
    """Return the parts that the options ask for, with their inputs read, or those with a layer.

    ``poses`` are those of the page; ``settings`` are values of the analyses' shared options by argument. The findings of
    the sheet are already on the page.
    """
    asked = [
        (declaration, part, value)
        for declaration, part in _declared(layers)
        if (value := options[part.option.argument]) not in (None, False)
    ]
    for _, part, _ in asked:
        if part.check is not None:
            part.check(sheet)
    read: dict[str, Callable[[Any], Any]] = {
        "": lambda _: None,
        "page": lambda _: [next(iter(sheet.poses)) if pose is None else pose for pose in poses],
        "grid": lambda file: read_grid(sheet, file),
        "path": lambda file: read_path(sheet, file, options),
    }

    def named(part: PagePart, file: Any) -> Sheet:
        if part.option.kind is not Path or options.get("columns") is None:
            return sheet
        columns = columns_of(sheet, options, file)
        return replace(
            sheet, measurements=tuple(replace(measurement, columns=columns) for measurement in sheet.measurements)
        )

    return [
        Part(
            declaration,
            part,
            _job(declaration, named(part, value), read[part.poses](value), {**settings, **part.settings(value)}),
        )
        for declaration, part, value in asked
    ]


def _job(declaration: Declaration, sheet: Sheet, poses: Any, given: shared.Options) -> Job:
    assert declaration.prepare is not None
    values: dict[str, Any] = {"seed": 0, "model": "exact", "specs": ()}
    for option in declaration.own_options:
        value = option.initial
        values[option.argument] = value if option.read is None or value is None else option.read(value)
        if option.flag == "--spec":
            values[option.argument] = tuple(spec.text for spec in fitting_specs(sheet, option.check) if not spec.poses)
    quiet = {"": replace(sheet, findings=())}
    asked = Asked(quiet, {**values, **given}, (), lambda: poses, lambda: poses, lambda: sheet.measurements)
    return declaration.prepare(asked)
