"""Single changes planted in the files of a bundle, to see whether the product finds them.

The generator walks the files themselves and knows no vocabulary of quantities: what a reader of
facts forgets, it changes all the same. Run it with `python -m tests.mutations BUNDLE`.
"""
