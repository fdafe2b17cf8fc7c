"""Writes docs/effects, text and figures: ``python -m benchmarks.effect_pages``."""
