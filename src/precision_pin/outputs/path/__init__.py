"""The law along a path as table and figure."""
