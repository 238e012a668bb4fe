"""Display of results: HTML, tables, progress."""
