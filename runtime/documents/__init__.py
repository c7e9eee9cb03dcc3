"""Files and documents of numbers: strict reading, whole-or-nothing writing."""
