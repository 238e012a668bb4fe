"""The sampled pose error at several poses, as text and picture."""
