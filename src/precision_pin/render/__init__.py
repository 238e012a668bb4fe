"""Building blocks of all outputs: tables, notebook views, HTML, figures, scenes."""
