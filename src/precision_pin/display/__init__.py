"""How results are shown, whatever they are of: HTML, tables, progress."""
