"""Benchmarks: classes in the style of asv, and one table of ratios: ``python -m benchmarks``.

Every figure is a ratio to a named reference that does the same work in the same run, so that the
machine cancels out. Inputs are seeded. Times are process CPU seconds unless a row says "wall".
"""
