"""What all tests need of the process they run in."""

import signal

# a shell that starts the tests in the background has Ctrl-C ignored, and so would every command that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)
