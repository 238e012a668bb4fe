"""One self-contained HTML page about one pose of an arm: everything that the other commands find out.

Each section is one file, a function from :class:`~precision_pin.analyses.collect.Results` to markup. Markup is made of
values (:mod:`precision_pin.render.html`) that escape all text, so that no name of a URDF or a sheet is ever markup.
"""
