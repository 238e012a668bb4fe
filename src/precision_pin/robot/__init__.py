"""The nominal robot: its file, its chain, poses, loads and statics."""
