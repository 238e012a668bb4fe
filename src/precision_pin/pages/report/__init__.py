"""Report: one self-contained HTML page with the results of all other commands at a pose.

Each section is a function from :class:`~precision_pin.analyses.collect.Results` to markup. Markup consists of
values (:mod:`precision_pin.render.html`) that escape all text, so that no name of a URDF or a sheet becomes markup.
"""
