"""Estimators of the literature that are no passes over a program: image filters of rasterisers, and a boundary term of light paths.

    python -m teg.examples.estimators.pictures [FOLDER]

draws them beside the exact derivatives. What each does, with its source, stands in its file: `opendr`, `nmr`, `psdr`.
"""
