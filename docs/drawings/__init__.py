"""The drawings of the pages, made in code: ``python -m docs.drawings`` writes them to ``docs/images``."""
