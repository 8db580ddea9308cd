"""A robot as a table of facts: one vocabulary, one reader for each format, one comparison.

`vocabulary` declares every quantity once. A reader (`readers/`) turns the files of one format into
a `Table`; `reference` turns the robot of a bundle into the table that the format must hold;
`compare` is the difference of two tables. Equality checks, `validate`, `diff` and the read-backs of
simulators are all made of these.
"""
