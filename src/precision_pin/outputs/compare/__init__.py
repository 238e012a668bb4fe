"""A comparison of models as table and figure."""
