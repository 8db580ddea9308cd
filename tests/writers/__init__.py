"""Bugs planted in the code of the writers, to see whether a build says "not ready".

`tests.mutations` changes the files of a bundle; here the code that writes them is changed, robots
are built with it, and what the files mean decides whether the bug counts. Run it with
`python -m tests.writers --count 100`.
"""
