"""What outputs are made of: the style of figures, HTML elements, SVG."""
