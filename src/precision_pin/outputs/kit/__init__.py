"""Building blocks of outputs: the style of figures, HTML elements, SVG."""
