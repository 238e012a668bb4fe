"""``python -m precision_pin``."""

from precision_pin.cli import main

if __name__ == "__main__":
    main()
