"""Display of results, whatever they are of: HTML, tables, progress."""
