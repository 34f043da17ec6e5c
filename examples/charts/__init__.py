"""Charts of error against cost, and a table of difficult cases: this package beside what one would use instead."""
