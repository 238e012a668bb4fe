"""What comes in: arguments, arrays, files and how much memory a request takes; all is checked here."""
