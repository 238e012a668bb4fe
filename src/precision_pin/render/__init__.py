"""What every output is made with: tables, notebook views, HTML, figures, scenes."""
