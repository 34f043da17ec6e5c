"""Printers of the scheduled program: NumPy, C and JAX.

The folder stands at the top of the checkout but is the package `teg.backends`; imported under any other name every class
in it would exist twice, so that is refused.
"""

if __name__ != "teg.backends":
    raise ImportError("import this package as 'teg.backends' (installing the project maps it there), not as " + repr(__name__))
