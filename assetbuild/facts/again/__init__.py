"""Two files of one kind compared, whatever they describe: one comparer for each kind of file.

`files.rows_of` picks the comparer. Each returns what differs in meaning as `Row`s: none where the
file is only written differently.
"""
