"""Charts of error against cost, and a table of difficult cases: this package beside other integrators."""
